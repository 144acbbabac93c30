"""The report of a study: page, plots and files."""
