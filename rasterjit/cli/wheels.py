"""
Make wheels with machine code from the pure wheel.

``python -m rasterjit.cli.wheels WHEEL PLATFORM ...`` compiles every form of every kernel and stage
for the levels of some platforms (``runtime/targets.py``), also for other machines than this one,
links a shared library of each (``shared_libraries.py``), and puts a wheel for each platform beside
the pure one. The same sources, Python, Numba, llvmlite and ziglang give the same bytes. ``python -m
rasterjit.cli.wheels check`` makes again what came with an installation, and compares.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rasterjit.cli import shared_libraries
from rasterjit.io.atomic_write import atomic_file
from rasterjit.runtime import background_compile, jit, prebuilt_kernels, store
from rasterjit.runtime.background_compile import Task
from rasterjit.runtime.prebuilt_kernels import Index
from rasterjit.runtime.targets import PLATFORMS, Platform, Target, parts_of

HERE = "rasterjit.cli.wheels"
"""This module's name, also when it runs as ``__main__``."""

PLACE = f"{prebuilt_kernels.FOLDER.parent.name}/{prebuilt_kernels.FOLDER.name}"
"""Folder of the code in a wheel."""

MODE = 0o100644 << 16
"""Permissions of a file in a wheel: readable by all."""


RESULT = ".returns"
"""How a file ends that says what a form returns, beside its object code."""


def compile_for(module: str, name: str, number: int, *targets: tuple[str, Target]) -> None:
    """Compile a form of a kernel or a stage for targets of one CPU, each into its folder."""
    function = getattr(importlib.import_module(module), name)
    symbol = prebuilt_kernels.symbol_of(function, number)
    returns, codes = shared_libraries.compile_form(
        function, function.declared[number], symbol, [Target(*one) for _, one in targets]
    )
    for (place, _), code in zip(targets, codes, strict=True):
        Path(place, symbol + shared_libraries.OBJECT).write_bytes(code)
        Path(place, symbol + RESULT).write_text(returns)


def made_with() -> str:
    """Return the compiler's and the linker's packages and versions, which decide the code."""
    numba, _, llvmlite = (store.versions() or "unknown unknown").partition(" ")
    version = ".".join(platform.python_version_tuple()[:2])
    return (
        f"{platform.python_implementation()} {version}, Numba {numba}, llvmlite {llvmlite}, "
        f"ziglang {importlib.metadata.version('ziglang')}"
    )


def sources() -> dict[str, Any]:
    """Return the files that the kernels follow from, and a hash over them."""
    modules = {one.__module__ for one in background_compile.every_kernel()}
    paths = {path for module in modules for path in store.all_sources(module)}
    files = sorted(path.relative_to(store.ROOT).as_posix() for path in paths)
    return {"files": files, "hash": prebuilt_kernels.hash_of(files)}


def files_of(platforms: Sequence[Platform]) -> list[dict[str, bytes]]:
    """
    Compile everything for platforms, in one process per core: of each CPU once for all systems.

    Returns
    -------
    list of dict of bytes
        Of each platform what its wheel has in ``machine_code``, by the names of the files.

    Raises
    ------
    Exception
        What could not be compiled or linked.
    """
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        made: dict[Target, str] = {}
        groups: dict[tuple[str, ...], list[tuple[str, Target]]] = {}
        for target in (one for platform in platforms for one in platform.targets()):
            made[target] = os.path.join(place, str(len(made)))
            os.mkdir(made[target])
            kind = parts_of(target.triple)[0], target.cpu, target.features
            groups.setdefault(kind, []).append((made[target], target))
        tasks = [
            Task(HERE, "compile_for", (one.__module__, one.__name__, number, *targets))
            for targets in groups.values()
            for one in background_compile.every_kernel()
            for number in range(len(one.declared))
        ]
        # Here, what went wrong shows.
        for task in background_compile.do_all(tasks, lambda: None):
            compile_for(*task.arguments)
        forms = {path.stem: path.read_text() for path in Path(place).glob(f"*/*{RESULT}")}
        return [_linked(platform, made, forms) for platform in platforms]


def _linked(
    platform: Platform, folders: Mapping[Target, str], forms: dict[str, str]
) -> dict[str, bytes]:
    """Return the libraries of a platform and their index, of object code in folders."""
    files, libraries = {}, []
    for target in platform.targets():
        name, place = target.cpu + platform.suffix, Path(folders[target])
        objects = [place / (symbol + shared_libraries.OBJECT) for symbol in sorted(forms)]
        files[name] = shared_libraries.link(target, name, objects)
        libraries.append([name, hashlib.sha256(files[name]).hexdigest(), *target])
    index = Index(made_with(), sources(), libraries, forms)
    return {**files, prebuilt_kernels.INDEX: prebuilt_kernels.content_of(index)}


def make_wheel(pure: Path, platform: Platform, code: dict[str, bytes]) -> Path:
    """
    Write the wheel of a platform beside the pure one: the same files, and machine code.

    Parameters
    ----------
    pure : Path
        A wheel whose tag is ``py3-none-any``.
    platform : Platform
    code : dict of bytes
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
    files |= {f"{PLACE}/{name}": content for name, content in code.items()}
    del files[record]
    # Installers read what is about the wheel from its end.
    names = sorted(files, key=lambda name: (".dist-info/" in name, name))
    lines = [f"{name},sha256={_digest(files[name])},{len(files[name])}" for name in names]
    files[record] = "\n".join((*lines, f"{record},,", "")).encode()
    with atomic_file(made) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
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
            if name.endswith((".py", ".c"))
            and not ((base / name).is_file() and archive.read(name) == (base / name).read_bytes())
        )  # fmt: skip


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")


def check() -> bool:
    """Make the installation's machine code again; print and return whether it is equal."""
    path = prebuilt_kernels.FOLDER / prebuilt_kernels.INDEX
    try:
        index = prebuilt_kernels.read_index(path)
    except FileNotFoundError:
        print(f"no machine code came with this installation: there is no {path}")
        return False
    except (prebuilt_kernels.UnfitError, OSError) as error:
        print(error)
        return False
    triples = {Target(*target).triple for _, _, *target in index.libraries}
    platforms = [one for one in PLATFORMS.values() if {one.triple} == triples]
    if not platforms:
        known = sorted(one.triple for one in PLATFORMS.values())
        print(f"{path} is for {sorted(triples)}, but must be for one of {known}")
        return False
    (made,) = files_of(platforms)
    others = []
    for name, content in made.items():
        file = path.with_name(name)
        is_same = file.is_file() and file.read_bytes() == content
        print(f"{file}: {'the same' if is_same else 'other'} bytes")
        others += [] if is_same else [file]
    print(f"made with {index.made_with}; here: {made_with()}")
    return not others


def main(arguments: Sequence[str]) -> int:
    """Make the wheels, or check what is installed; return the exit status."""
    if jit.DISABLED or jit.CHECKED:
        print("nothing is compiled: NUMBA_DISABLE_JIT or NUMBA_BOUNDSCHECK is set", file=sys.stderr)
        return 2
    missing = [name for name in ("numba", "ziglang") if importlib.util.find_spec(name) is None]
    if missing:
        remedy = 'pip install "rasterjit[wheels]"'
        print(f"to compile and link needs {' and '.join(missing)}: {remedy}", file=sys.stderr)
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
    platforms = [PLATFORMS[name] for name in names]
    for one, code in zip(platforms, files_of(platforms), strict=True):
        print(make_wheel(Path(wheel), one, code), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
