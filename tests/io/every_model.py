"""
Load and draw every glTF file below folders, and say in a line each what became of it.

``python tests/io/every_model.py FOLDER ...``: drawn, warned (with what the warning says), refused
(why), or empty where nothing is seen; an error of any other kind ends it.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

import rasterjit as rj

SIZE = (256, 256)


def outcome_of(path: Path) -> tuple[str, str]:
    """Return what becomes of a file, and why."""
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = rj.load(path)
            camera = rj.fit_camera(scene)
            frame = rj.render(scene, camera, size=SIZE, outputs=("color", "face_id"))
    except rj.MeshFileError as error:
        return "refused", str(error)
    if not np.any(frame.face_id >= 0):
        return "empty", ""
    said = " ".join(str(one.message) for one in caught)
    return ("warned" if said else "drawn"), said


if __name__ == "__main__":
    counts: Counter[str] = Counter()
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).rglob("*")):
            if path.suffix.lower() in (".gltf", ".glb") and path.is_file():
                outcome, why = outcome_of(path)
                counts[outcome] += 1
                short = re.sub(r"\s+", " ", why.replace(str(path), ""))[:160]
                print(f"{outcome:8}{path.relative_to(folder)} {short}".rstrip(), flush=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.most_common()))
