"""Read one mutated file as a program would, and judge what came of it."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import rasterjit as rj
from benchmarks.fuzz_files.all_samples import SAMPLES
from benchmarks.fuzz_files.foreign_counts import Counts, Held, counts_of
from benchmarks.fuzz_files.mutations import mutated
from benchmarks.fuzz_files.samples import Files, opened
from benchmarks.fuzz_files.strict import points_of, triangles_of
from benchmarks.memory import reset_peak, resident
from rasterjit.io.gltf.scene import GLTF_FORMATS
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.io.meshes import BUILTIN_FORMATS
from rasterjit.io.resources import extension_of

MAX_BYTES = 32 << 20
"""What each file may take; loading may take twice that."""

SLACK = 4 << 20
"""Bytes by which a process grows for other reasons, such as modules that it imports."""

OWN = (*BUILTIN_FORMATS, *GLTF_FORMATS, "3mf", "binvox")
"""Formats that no package of others reads: what cannot be told by the letter is not counted."""

ON_DAMAGE = ("error", "warn")

PICTURE = (16, 16)


def sample_of(number: int) -> str:
    """Return the name of the sample that a case starts from; they take turns."""
    return list(SAMPLES)[number % len(SAMPLES)]


def files_of(seed: int, number: int) -> tuple[Files, str]:
    """Return the files of a case, and how they were changed."""
    return mutated(SAMPLES[sample_of(number)](), np.random.default_rng([seed, number]))


def read_sound_files(folder: Path) -> None:
    """Read and draw every sample as it is, so that what is imported and compiled then is there."""
    for sample, make in SAMPLES.items():
        files = make()
        for name, content in files.items():
            (folder / name).write_bytes(content)
        faults: list[str] = []
        scene, _, _ = _read(folder / opened(files), sample, ON_DAMAGE[0], faults)
        if scene is not None:
            _draw(scene, sample, faults)
        if faults:
            raise RuntimeError(f"the sample {sample!r} as it is: {faults}")


def judge(seed: int, number: int, folder: Path) -> dict[str, Any]:
    """Judge the files of a case; most are read so that damage is an error."""
    files, how = files_of(seed, number)
    on_damage = ON_DAMAGE[number // len(SAMPLES) % 4 == 3]
    return {
        "number": number,
        "how": how,
        **judge_files(sample_of(number), files, folder, on_damage),
    }


def judge_files(sample: str, files: Files, folder: Path, on_damage: str) -> dict[str, Any]:
    """
    Write the files of a sample into a folder, read the one that is opened, and draw it small.

    Returns
    -------
    dict
        ``outcome``: ``"loaded"``, ``"warned"`` or ``"refused"``; ``said``: what the warning or the
        error says; ``faults``: what must not be, in words; ``seconds`` of the processor;
        ``peak``: bytes by which the process grew beyond its peak.
    """
    for name, content in files.items():
        (folder / name).write_bytes(content)
    path = folder / opened(files)
    faults: list[str] = []
    # Above the peak so far: where it cannot start again, this call pays for no other.
    reset_peak()
    before, start = resident("VmHWM"), time.process_time()
    scene, outcome, said = _read(path, sample, on_damage, faults)
    seconds, peak = time.process_time() - start, resident("VmHWM") - before
    if peak > 2 * MAX_BYTES + SLACK:
        faults.append(f"it took {peak:,} bytes")
    if outcome == "loaded" and not sample.startswith("sky"):
        faults += _lost(scene, sample, files, path)
    if scene is not None:
        _draw(scene, sample, faults)
    return {
        "sample": sample, "outcome": outcome, "said": said, "faults": faults, "seconds": seconds,
        "peak": peak,
    }  # fmt: skip


def _read(path: Path, sample: str, on_damage: str, faults: list[str]) -> tuple[Any, str, str]:
    """Return what a file holds, what came of reading it, and what was said."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            if sample.startswith("sky"):
                scene = rj.Environment.from_file(path, max_bytes=MAX_BYTES)
            else:
                scene = rj.load(path, on_damage=on_damage, max_bytes=MAX_BYTES)
        except ValueError as error:
            if str(path) not in str(error):
                faults.append(f"the error does not name the file: {error}")
            return None, "refused", str(error)
        except Exception as error:
            faults.append(f"a foreign exception, {type(error).__name__}: {error}")
            return None, "refused", str(error)
    for one in told:
        if not issubclass(one.category, LoadWarning):
            faults.append(f"a foreign warning, {one.category.__name__}: {one.message}")
        elif str(path) not in str(one.message):
            faults.append(f"the warning does not name the file: {one.message}")
    said = " ".join(str(one.message) for one in told)
    return scene, "warned" if said else "loaded", said


def _lost(scene: Any, sample: str, files: Files, path: Path) -> list[str]:
    """Return what a scene that was loaded without a word lacks or has beyond its file."""
    points = points_of(sample, files)
    if points is not None:
        held: Any = {"points": Held(points)}
    else:
        held = triangles_of(sample, files)
    if held is None and extension_of(path) not in OWN:
        # What stops the other package, it does not count.
        with contextlib.suppress(Exception):
            held = counts_of(path)
    if held is None:
        return []
    if isinstance(held, int):
        held = {"triangles": Held(held)}
    if isinstance(held, dict):
        return _fewer(scene, held)
    meshes = [node.mesh for node in scene.nodes if node.mesh.primitive == "triangles"]
    count = sum(len(mesh.faces) for mesh in meshes)
    if 3 * count != len(held):
        return [f"lost without a word: {count} of {len(held) // 3} triangles"]
    found = [np.empty((0, 3)), *(mesh.vertices[mesh.faces].reshape(-1, 3) for mesh in meshes)]
    mine, expected = (
        np.sort(np.array(rows, np.float32).view("f4,f4,f4").reshape(-1))
        for rows in (np.concatenate(found), np.array(held).reshape(-1, 3))
    )
    return [] if np.array_equal(mine, expected) else ["other corners than the file's"]


def _fewer(scene: Any, held: Counts) -> list[str]:
    """Return of what a scene has fewer, or more, than its file."""
    found = Counter[str]()
    for node in scene.nodes:
        mesh = node.mesh
        parts = {"triangles": "faces", "lines": "segments", "points": "vertices"}
        what = "segments" if mesh.primitive == "lines" else mesh.primitive
        found[what] += len(getattr(mesh, parts[mesh.primitive]))
    return [
        f"lost without a word: {found[what]} of {least} {what}"
        for what, (least, is_exact) in held.items()
        if found[what] < least or (is_exact and found[what] > least)
    ]


def _draw(loaded: Any, sample: str, faults: list[str]) -> None:
    """Draw what was read, small."""
    scene = loaded
    if sample.startswith("sky"):
        scene = rj.Scene()
        scene.environment = loaded
        scene.add(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            rj.render(scene, size=PICTURE, threads=1)
        except ValueError:
            # What cannot be seen by any camera is refused by name.
            pass
        except Exception as error:
            faults.append(f"drawing: a foreign exception, {type(error).__name__}: {error}")
    faults += [
        f"drawing: a foreign warning, {one.message}"
        for one in told
        if not issubclass(one.category, rj.ViewWarning)
    ]
