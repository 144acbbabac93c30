"""The command line: ``rasterjit`` and ``python -m rasterjit``."""

import sys

from rasterjit import interrupts


def main() -> None:
    """Run the command line, in a process of its own."""
    try:
        interrupts.set_handler(interrupts.end_now)
        from rasterjit.cli.commands import main as run

        sys.unraisablehook = interrupts.print_unraisable
        try:
            interrupts.set_handler(interrupts.interrupt)
            run()
        finally:
            # What is left is Python's own end.
            interrupts.set_handler(interrupts.end_now)
    except KeyboardInterrupt:
        interrupts.end_now()
