"""Run the command line with ``python -m rasterjit``."""

from rasterjit.cli.commands import main

main()
