"""
Make wheels with machine code from the pure wheel.

``python -m rasterjit.cli.wheels WHEEL PLATFORM ...`` compiles every form of every kernel and stage
for the levels of some platforms (``runtime/targets.py``), also for other machines than this one,
and puts a wheel for each platform beside the pure one. The same sources, Python, Numba and llvmlite
give the same bytes. ``python -m rasterjit.cli.wheels check`` compiles again what came with an
installation, and compares.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import os
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from rasterjit.runtime import background_compile, isolated_numba, jit, prebuilt_kernels, store
from rasterjit.runtime.background_compile import Task
from rasterjit.runtime.targets import PLATFORMS, Platform, Target

HERE = "rasterjit.cli.wheels"
"""This module's name, also when it runs as ``__main__``."""

PLACE = f"{prebuilt_kernels.FOLDER.parent.name}/{prebuilt_kernels.FOLDER.name}"
"""Folder of the code in a wheel."""

MODE = 0o100644 << 16
"""Permissions of a file in a wheel: readable by all."""


def compile_for(module: str, name: str, number: int, place: str, *target: str) -> None:
    """Compile a form of a kernel or a stage for a target, into a file of a folder."""
    function, wanted = getattr(importlib.import_module(module), name), Target(*target)
    kind = function.declared[number]
    symbol = store.name_of(function, kind, wanted)
    returns, code = isolated_numba.compiler().compile_form(function, kind, symbol, wanted)
    header = store.header_of(function, kind, returns, wanted)
    store.write(Path(place) / f"{symbol}{store.SUFFIX}", header, code)


def made_with() -> str:
    """Return the compiler's packages and versions, which decide the machine code."""
    numba, _, llvmlite = (store.versions() or "unknown unknown").partition(" ")
    version = ".".join(platform.python_version_tuple()[:2])
    return f"{platform.python_implementation()} {version}, Numba {numba}, llvmlite {llvmlite}"


def pack_of(target: Target) -> bytes:
    """
    Compile everything for a target, in one process per core.

    Returns
    -------
    bytes
        The content of a file of machine code (``runtime/prebuilt_kernels.py``).

    Raises
    ------
    Exception
        What could not be compiled.
    """
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        tasks = [
            Task(HERE, "compile_for",
                 (one.__module__, one.__name__, number, place, *target))
            for one in background_compile.every_kernel()
            for number in range(len(one.declared))
        ]  # fmt: skip
        # Here, what went wrong shows.
        for task in background_compile.do_all(tasks, lambda: None):
            compile_for(*task.arguments)
        forms = {}
        for path in Path(place).glob(f"*{store.SUFFIX}"):
            kept = store.read(path)
            if kept is not None:
                forms[path.stem] = kept[0].returns, kept[1]
    if len(forms) != len(tasks):
        raise RuntimeError(f"{len(forms)} of {len(tasks)} forms were compiled and kept")
    return prebuilt_kernels.content_of(
        prebuilt_kernels.file_name(target), target, made_with(), forms
    )


def make_wheel(pure: Path, platform: Platform, packs: dict[str, bytes]) -> Path:
    """
    Write the wheel of a platform beside the pure one: the same files, and machine code.

    Parameters
    ----------
    pure : Path
        A wheel whose tag is ``py3-none-any``.
    platform : Platform
    packs : dict of bytes
        Files of machine code by their names.

    Raises
    ------
    ValueError
        The wheel is none that fits any platform.
    """
    if not pure.name.endswith("-py3-none-any.whl"):
        raise ValueError(f"wheel = {str(pure)!r} must end with -py3-none-any.whl")
    made = pure.with_name(pure.name.replace("-any.whl", f"-{platform.tag}.whl"))
    with zipfile.ZipFile(pure) as archive:
        files = {one: archive.read(one) for one in archive.namelist() if not one.endswith("/")}
        date = archive.infolist()[0].date_time
    record = next(name for name in files if name.endswith(".dist-info/RECORD"))
    about = record.replace("RECORD", "WHEEL")
    text = re.sub(r"(?m)^(Root-Is-Purelib|Tag):.*\n", "", files[about].decode()).rstrip("\n")
    tags = [f"Tag: py3-none-{tag}" for tag in platform.tag.split(".")]
    files[about] = "\n".join((text, "Root-Is-Purelib: false", *tags, "")).encode()
    files |= {f"{PLACE}/{name}": content for name, content in packs.items()}
    del files[record]
    # Installers read what is about the wheel from its end.
    names = sorted(files, key=lambda name: (".dist-info/" in name, name))
    lines = [f"{name},sha256={_digest(files[name])},{len(files[name])}" for name in names]
    files[record] = "\n".join((*lines, f"{record},,", "")).encode()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in (*names, record):
            entry = zipfile.ZipInfo(name, date)
            entry.external_attr, entry.compress_type = MODE, zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])
    return made


def other_sources(pure: Path) -> list[str]:
    """Return the names of the sources in a wheel that are not what is compiled here, sorted."""
    base = store.ROOT.parent
    with zipfile.ZipFile(pure) as archive:
        return sorted(
            name for name in archive.namelist()
            if name.endswith(".py")
            and not ((base / name).is_file() and archive.read(name) == (base / name).read_bytes())
        )  # fmt: skip


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")


def check() -> bool:
    """Compile the installation's machine code again; print and return whether it is equal."""
    files = sorted(prebuilt_kernels.FOLDER.glob(f"*{prebuilt_kernels.SUFFIX}"))
    if not files:
        print(f"no machine code came with this installation: {prebuilt_kernels.FOLDER} has none")
    same = bool(files)
    for path in files:
        try:
            pack = prebuilt_kernels.read(path)
        except (prebuilt_kernels.UnfitError, OSError) as error:
            print(error)
            same = False
            continue
        is_same = pack.content == pack_of(pack.target)
        print(f"{path}: {'the same' if is_same else 'other'} bytes (made with {pack.made_with})")
        same = same and is_same
    print(f"here: {made_with()}")
    return same


def main(arguments: Sequence[str]) -> int:
    """Make the wheels, or check what is installed; return the exit status."""
    if jit.DISABLED or jit.CHECKED:
        print("nothing is compiled: NUMBA_DISABLE_JIT or NUMBA_BOUNDSCHECK is set", file=sys.stderr)
        return 2
    if list(arguments) == ["check"]:
        return 0 if check() else 1
    wheel, *names = arguments or ("",)
    unknown = [name for name in names if name not in PLATFORMS]
    if unknown or not names or not os.path.isfile(wheel):
        usage = f"WHEEL PLATFORM ... (of {', '.join(PLATFORMS)}), or check"
        print(f"python -m rasterjit.cli.wheels {usage}", file=sys.stderr)
        return 2
    others = other_sources(Path(wheel))
    if others:
        print(
            f"{wheel} is of other sources than {store.ROOT}, which would be compiled: "
            f"{len(others)} files differ, {others[0]} first", file=sys.stderr,
        )  # fmt: skip
        return 2
    for name in names:
        packs = {prebuilt_kernels.file_name(one): pack_of(one) for one in PLATFORMS[name].targets()}
        print(make_wheel(Path(wheel), PLATFORMS[name], packs), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
