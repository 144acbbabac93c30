"""Find the mesh files below a folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from rasterjit.scene.validation import in_short

WITH_EXTRAS = (".3dxml", ".dae", ".xaml", ".zae")
"""Mesh files that trimesh reads with ``rasterjit[formats]``: without it they fail, and say why."""

MOSTLY_OTHER = (".xml", ".dat", ".node")
"""Extensions of meshes that, in a folder, mostly end the names of something else."""


def mesh_files(folder: str | Path) -> list[Path]:
    """
    Return all mesh files below a folder that trimesh reads, in the order of their names.

    Hidden files and folders are left out, and ``.xml``, ``.dat`` and ``.node``: such names have
    many files that are no meshes, or are a part of one.

    Raises
    ------
    ValueError
        If there is no such folder.
    """
    place = existing_folder("folder", folder)
    suffixes = mesh_suffixes()
    found = []
    for root, folders, files in os.walk(place):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if not name.startswith(".") and Path(name).suffix.lower() in suffixes:
                found.append(Path(root, name))
    return sorted(found, key=lambda file: file.relative_to(place).as_posix())


def mesh_suffixes() -> frozenset[str]:
    """Return the extensions of files that are meshes wherever they lie, with a dot."""
    from trimesh.exchange.load import mesh_formats

    from rasterjit.io.gltf.scene import GLTF_FORMATS

    known = (*mesh_formats(), *GLTF_FORMATS, "3mf")
    return frozenset((*(f".{name}" for name in known), *WITH_EXTRAS)).difference(MOSTLY_OTHER)


def existing_folder(name: str, value: Any) -> Path:
    """Return the full path of an existing folder, or raise ``ValueError``."""
    if not isinstance(value, (str, os.PathLike)) or not Path(value).is_dir():
        told = repr(str(value)) if isinstance(value, os.PathLike) else in_short(value)
        raise ValueError(f"{name} must be an existing folder, got {told}")
    return Path(value).resolve()
