"""Run the command line with ``python -m rasterjit``."""

from rasterjit.cli import main

main()
