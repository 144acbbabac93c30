"""
Make wheels with machine code from the pure wheel, and the text that source packages bring.

``python -m rasterjit.cli.wheels WHEEL PLATFORM ...`` compiles every form of every kernel and stage
for the levels of some platforms (``runtime/targets.py``), also for other machines than this one,
links a shared library of each (``shared_libraries.py``), and puts a wheel for each platform beside
the pure one. The same sources, Python, Numba, llvmlite and ziglang give the same bytes.
``python -m rasterjit.cli.wheels texts FOLDER PLATFORM ...`` goes half of the way: it writes LLVM's
text, optimized for each level, into a folder. Wheels are made of that where it came with the
sources. ``python -m rasterjit.cli.wheels check`` makes again what came with an installation, and
compares.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.cli import shared_libraries
from rasterjit.io.atomic_write import atomic_file
from rasterjit.runtime import background_compile, jit, prebuilt_kernels, store
from rasterjit.runtime.background_compile import Task
from rasterjit.runtime.prebuilt_kernels import Index
from rasterjit.runtime.targets import LEVELS, PLATFORMS, Platform, Target, split_triple

HERE = "rasterjit.cli.wheels"
"""This module's name, also when it runs as ``__main__``."""

PLACE = f"{prebuilt_kernels.FOLDER.parent.name}/{prebuilt_kernels.FOLDER.name}"
"""Folder of the code in a wheel."""

MODE = 0o100644 << 16
"""Permissions of a file in a wheel: readable by all."""


CPU = "cpu.json"
"""File in a folder of optimized modules: a target with their CPU."""

RESULT, TEXT = ".returns", ".ll"
"""How files end that say what a form returns, and that hold its optimized module."""


def compile_for(
    module: str, name: str, number: int, lowered: str, *targets: tuple[str, Target]
) -> None:
    """
    Compile a form of a kernel or a stage for targets of one CPU.

    Parameters
    ----------
    module, name, number : str, str, int
        The function, and the form by its number.
    lowered : str
        Folder of the optimized modules for that CPU. What it lacks is written there.
    *targets : (str, Target)
        The folder that gets the object code for each.
    """
    function = getattr(importlib.import_module(module), name)
    symbol = prebuilt_kernels.symbol_name(function, number)
    path = Path(lowered, symbol + TEXT)
    if not path.exists():
        kind, target = (
            function.declared[number],
            Target(*json.loads(Path(lowered, CPU).read_text())),
        )
        returns, text = shared_libraries.optimized_text(function, kind, symbol, target)
        path.with_suffix(RESULT).write_text(returns)
        # Whole or not at all: who finds it does not compile.
        path.with_suffix(".part").write_text(text)
        path.with_suffix(".part").replace(path)
    for folder, target in targets:
        code = shared_libraries.object_code(path.read_text(), symbol, Target(*target))
        Path(folder, symbol + shared_libraries.OBJECT).write_bytes(code)


def made_with() -> str:
    """Return the compiler's and the linker's packages and versions, which decide the code."""
    numba, _, llvmlite = (store.compiler_versions() or "unknown unknown").partition(" ")
    version = ".".join(platform.python_version_tuple()[:2])
    return (
        f"{platform.python_implementation()} {version}, Numba {numba}, llvmlite {llvmlite}, "
        f"ziglang {importlib.metadata.version('ziglang')}"
    )


def sources() -> dict[str, Any]:
    """Return the files that the kernels follow from, and a hash over them."""
    modules = {one.__module__ for one in background_compile.find_every_kernel()}
    paths = {path for module in modules for path in store.list_all_sources(module)}
    files = sorted(path.relative_to(store.ROOT).as_posix() for path in paths)
    return {"files": files, "hash": prebuilt_kernels.hash_sources(files)}


class Compiled(NamedTuple):
    """What was compiled for a level of CPUs."""

    lowered: Path
    """Folder of the optimized modules."""
    objects: dict[Target, Path]
    """Folder of the object code for each target."""

    def forms(self) -> dict[str, str]:
        """Return what each form returns, by its symbol."""
        return {path.stem: path.read_text() for path in sorted(self.lowered.glob(f"*{RESULT}"))}

    def texts(self) -> dict[str, str]:
        """Return the optimized modules, by their symbols."""
        return {path.stem: path.read_text() for path in sorted(self.lowered.glob(f"*{TEXT}"))}


def compile_all(
    platforms: Sequence[Platform], place: Path, is_text_alone: bool = False
) -> dict[tuple[str, str], Compiled]:
    """
    Compile everything for platforms, in one process per core: of each CPU once for all systems.

    Parameters
    ----------
    platforms : sequence of Platform
    place : Path
        An empty folder.
    is_text_alone : bool
        Whether to make no object code, and all text anew.

    Returns
    -------
    dict of Compiled
        By the kind of CPU and the level.

    Raises
    ------
    Exception
        What could not be compiled.
    """
    levels: dict[tuple[str, str], Compiled] = {}
    shipped = {} if is_text_alone else shipped_texts()
    for target in (target for one in platforms for target in one.targets()):
        key = split_triple(target.triple)[0], target.cpu
        if key not in levels:
            levels[key] = Compiled(place / str(len(levels)), {})
            lowered = levels[key].lowered
            lowered.mkdir()
            (lowered / CPU).write_text(json.dumps(target))
            for symbol, (returns, text) in shipped.get(key, {}).items():
                (lowered / (symbol + RESULT)).write_text(returns)
                (lowered / (symbol + TEXT)).write_text(text)
        if not is_text_alone:
            folder = levels[key].objects[target] = levels[key].lowered / target.triple
            folder.mkdir()
    tasks = [
        Task(
            HERE, "compile_for",
            (one.__module__, one.__name__, number, str(level.lowered),
             *((str(folder), target) for target, folder in level.objects.items())),
        )
        for level in levels.values()
        for one in background_compile.find_every_kernel()
        for number in range(len(one.declared))
    ]  # fmt: skip
    # Here, what went wrong shows.
    for task in background_compile.run_tasks(tasks, lambda: None):
        compile_for(*task.arguments)
    return levels


def files_of(platforms: Sequence[Platform]) -> list[dict[str, bytes]]:
    """
    Return of each platform what its wheel has in ``machine_code``, by the names of the files.

    Raises
    ------
    Exception
        What could not be compiled or linked.
    """
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        levels = compile_all(platforms, Path(place))
        return [_linked(platform, levels) for platform in platforms]


def _linked(platform: Platform, levels: Mapping[tuple[str, str], Compiled]) -> dict[str, bytes]:
    """Return the libraries of a platform and their index."""
    files, libraries, forms = {}, [], {}
    for target in platform.targets():
        level = levels[split_triple(target.triple)[0], target.cpu]
        name, forms = target.cpu + platform.suffix, level.forms()
        objects = [level.objects[target] / (one + shared_libraries.OBJECT) for one in forms]
        files[name] = shared_libraries.link(target, name, objects)
        libraries.append([name, hashlib.sha256(files[name]).hexdigest(), *target])
    return {**files, **_index_file(libraries, forms, [])}


def _index_file(
    libraries: list[list[str]], forms: dict[str, str], texts: list[list[str]]
) -> dict[str, bytes]:
    index = Index(made_with(), sources(), libraries, forms, texts)
    return {prebuilt_kernels.INDEX_FILE: prebuilt_kernels.encode_index(index)}


def text_files_of(platforms: Sequence[Platform]) -> dict[str, bytes]:
    """
    Return what source packages have in ``machine_code``, by the names of the files.

    Raises
    ------
    Exception
        What could not be compiled.
    """
    from llvmlite import binding

    files, texts, forms = {}, [], {}
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        for (kind, cpu), level in compile_all(platforms, Path(place), is_text_alone=True).items():
            name, forms = f"{cpu}.ll.xz", level.forms()
            files[name] = prebuilt_kernels.pack_texts(level.texts())
            checksum = hashlib.sha256(files[name]).hexdigest()
            texts.append([name, checksum, kind, cpu, str(binding.llvm_version_info[0])])
    return {**files, **_index_file([], forms, sorted(texts))}


def shipped_texts() -> dict[tuple[str, str], dict[str, tuple[str, str]]]:
    """
    Return what came with these sources, if this compiler made it.

    Returns
    -------
    dict of dict
        By the kind of CPU and the level, by symbol: what a form returns, and its optimized module.
    """
    folder = prebuilt_kernels.FOLDER
    try:
        index = prebuilt_kernels.read_index(folder / prebuilt_kernels.INDEX_FILE)
    except (prebuilt_kernels.UnusableError, OSError):
        return {}
    if (index.made_with, index.sources) != (made_with(), sources()):
        return {}
    found = {}
    for name, checksum, kind, cpu, _ in index.texts:
        texts = prebuilt_kernels.read_texts(folder / name, checksum)
        found[kind, cpu] = {one: (index.forms[one], text) for one, text in texts.items()}
    return found


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
        files = {
            one: archive.read(one) for one in archive.namelist()
            if not one.endswith("/") and not one.startswith(f"{PLACE}/")
        }  # fmt: skip
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
    """Make again what came with the installation; print and return whether it is equal."""
    path = prebuilt_kernels.FOLDER / prebuilt_kernels.INDEX_FILE
    try:
        index = prebuilt_kernels.read_index(path)
    except FileNotFoundError:
        print(f"no machine code came with this installation: there is no {path}")
        return False
    except (prebuilt_kernels.UnusableError, OSError) as error:
        print(error)
        return False
    if index.libraries:
        triples = {Target(*target).triple for _, _, *target in index.libraries}
        platforms = [one for one in PLATFORMS.values() if {one.triple} == triples]
    else:
        made_for = {(kind, cpu) for _, _, kind, cpu, _ in index.texts}
        platforms = [
            PLATFORMS[kind]._replace(
                levels=tuple(one for one in levels if (kind, one.cpu) in made_for)
            )
            for kind, levels in LEVELS.items()
            if any(kind == made for made, _ in made_for)
        ]
        triples = {one.triple for one in platforms}
    if not platforms:
        known = sorted(one.triple for one in PLATFORMS.values())
        print(f"{path} is for {sorted(triples)}, but must be for one of {known}")
        return False
    made = files_of(platforms)[0] if index.libraries else text_files_of(platforms)
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
    words = list(arguments)
    is_text = words[:1] == ["texts"]
    place, *names = words[is_text:] or ("",)
    unknown = [name for name in names if name not in PLATFORMS]
    if unknown or not names or not (os.path.isdir if is_text else os.path.isfile)(place):
        usage = (
            f"WHEEL PLATFORM ... (of {', '.join(PLATFORMS)}), texts FOLDER PLATFORM ..., or check"
        )
        print(f"python -m rasterjit.cli.wheels {usage}", file=sys.stderr)
        return 2
    platforms = [PLATFORMS[name] for name in names]
    if is_text:
        for name, content in text_files_of(platforms).items():
            Path(place, name).write_bytes(content)
        return 0
    others = other_sources(Path(place))
    if others:
        print(
            f"{place} is of other sources than {store.ROOT}, which would be compiled: "
            f"{len(others)} files differ, {others[0]} first", file=sys.stderr,
        )  # fmt: skip
        return 2
    for one, code in zip(platforms, files_of(platforms), strict=True):
        print(make_wheel(Path(place), one, code), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
