"""Read objects of other packages, and files by these packages, isolated in a process."""
