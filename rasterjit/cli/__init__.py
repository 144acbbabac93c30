"""The command line: ``rasterjit`` and ``python -m rasterjit``."""

from rasterjit.cli.commands import main

__all__ = ["main"]
