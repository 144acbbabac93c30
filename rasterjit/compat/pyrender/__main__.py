"""Run a program that was written for pyrender, unedited."""

from __future__ import annotations

import io
import os
import runpy
import sys
import types
import zipfile
from collections.abc import Callable
from pathlib import Path

from rasterjit.compat.pyrender import install

USAGE = """\
usage: python -m rasterjit.compat.pyrender SCRIPT [ARGS ...]
       python -m rasterjit.compat.pyrender -m MODULE [ARGS ...]

Run a program that was written for pyrender, unedited: its "import pyrender" means RasterJIT, also
in the processes that it starts."""

_INTERRUPTED = 130
"""Exit status of a program that Ctrl+C ended."""


def main(arguments: list[str]) -> None:
    """
    Run a program as ``python SCRIPT ARGS...`` or ``python -m MODULE ARGS...`` does.

    Parameters
    ----------
    arguments : list of str
        Those of this command.

    Raises
    ------
    SystemExit
        With the program's own status; 1 after a traceback, 2 if no program is named.
    """
    if not arguments or arguments[0] in ("-h", "--help") or arguments == ["-m"]:
        asked = bool(arguments) and arguments != ["-m"]
        print(USAGE, file=sys.stdout if asked else sys.stderr)
        raise SystemExit(0 if asked else 2)
    install()
    _set_up_children()
    if arguments[0] == "-m":
        name = arguments[1]
        sys.argv = arguments[1:]
        _run_and_exit(lambda: runpy.run_module(name, run_name="__main__", alter_sys=True))
    sys.argv = arguments
    script = arguments[0]
    if Path(script).is_dir() or zipfile.is_zipfile(script):
        _run_and_exit(lambda: runpy.run_path(script, run_name="__main__"))
    _run_and_exit(lambda: _run_script(script))


def _set_up_children() -> None:
    """Let processes that the program starts find the stand-in for pyrender."""
    folder = str(Path(__file__).parent / "path")
    sys.path.insert(1, folder)
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = folder if not before else f"{folder}{os.pathsep}{before}"


def _run_script(script: str) -> None:
    """Run a file of source code as the main module."""
    path = os.path.abspath(script)
    try:
        with io.open_code(path) as file:
            source = file.read()
    except OSError as error:
        message = f"can't open file {path!r}: [Errno {error.errno}] {error.strerror}"
        print(f"{sys.executable}: {message}", file=sys.stderr)
        raise SystemExit(2) from None
    main_module = types.ModuleType("__main__")
    main_module.__dict__.update(
        __file__=path, __builtins__=__builtins__, __cached__=None, __loader__=None
    )
    # Classes of the program are found in it when they are pickled.
    sys.modules["__main__"] = main_module
    if not getattr(sys.flags, "safe_path", False):
        sys.path[0] = os.path.dirname(os.path.realpath(script))
    exec(compile(source, path, "exec"), main_module.__dict__)


def _run_and_exit(run: Callable[[], object]) -> None:
    """Run a program and exit as Python does, its traceback without the frames of this module."""
    try:
        run()
    except SystemExit:
        raise
    except BaseException as error:
        steps = error.__traceback__
        while steps is not None and _is_own_file(steps.tb_frame.f_code.co_filename):
            steps = steps.tb_next
        sys.excepthook(type(error), error.with_traceback(steps), steps)
        raise SystemExit(_INTERRUPTED if isinstance(error, KeyboardInterrupt) else 1) from None
    raise SystemExit(0)


def _is_own_file(file: str) -> bool:
    """Tell files that run the program from those of the program."""
    return file == __file__ or file.startswith("<frozen runpy") or file == runpy.__file__


if __name__ == "__main__":
    main(sys.argv[1:])
