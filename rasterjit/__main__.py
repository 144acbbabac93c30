"""Run the command line with ``python -m rasterjit``."""

from rasterjit.cli import main

if __name__ == "__main__":
    main()
