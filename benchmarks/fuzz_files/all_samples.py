"""The samples of all formats, and what they leave out of what `rasterjit.load` takes."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from benchmarks.fuzz_files import foreign_samples, packed_samples, samples
from benchmarks.fuzz_files.samples import Files, opened
from rasterjit.io.resources import extension_of

SAMPLES: dict[str, Callable[[], Files]] = {
    **samples.SAMPLES, **packed_samples.SAMPLES, **foreign_samples.SAMPLES,
}  # fmt: skip
"""What makes each sample; those that begin with ``sky`` are environments."""

FORMATS = {
    "draco": "glTF, Draco", "meshopt": "glTF, meshopt", "ktx2": "glTF, KTX 2",
    "picture": "OBJ with a picture", "sky": "environments", "stl_ascii": "STL",
    **dict.fromkeys(("glb", "gltf", "vrm"), "glTF, GLB, VRM"),
    **dict.fromkeys(("bdf", "nas", "fem"), "BDF, NAS, FEM"),
    **dict.fromkeys(("ex2", "exo", "e"), "EX2, EXO, E"),
    **dict.fromkeys(("xdmf", "xmf"), "XDMF, XMF"), **dict.fromkeys(("tec", "dat"), "TEC, DAT"),
    **dict.fromkeys(("ele", "node"), "ELE, NODE"), **dict.fromkeys(("post", "dato"), "POST, DATO"),
    **dict.fromkeys(("mesh", "meshb"), "MESH, MESHB"), **dict.fromkeys(("las", "laz"), "LAS, LAZ"),
    **dict.fromkeys(("xyz", "xyzn", "xyzrgb", "pts", "asc", "txt", "csv"), "rows of points"),
    **dict.fromkeys(("zip", "tar.gz", "tar.bz2", "bz2"), "ZIP, TAR.GZ, TAR.BZ2, BZ2"),
}  # fmt: skip
"""What a table calls the formats of samples, by the first word of their names; others by that."""


def format_of(sample: str) -> str:
    """Return the format that a sample is of, as a table calls it."""
    word = sample.partition(" ")[0]
    return FORMATS.get(word, word.upper())


def extensions() -> set[str]:
    """Return the extensions of the files that are opened, but of environments."""
    return {
        extension_of(Path(opened(make())))
        for name, make in SAMPLES.items()
        if not name.startswith("sky")
    }


def without_package() -> dict[str, str]:
    """Return the extensions of samples that cannot be made or read here, and what they need."""
    return {
        name: package
        for name, package in foreign_samples.PACKAGES.items()
        if " " not in name and not find_spec(package)
    }
