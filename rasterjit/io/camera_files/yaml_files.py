"""Read YAML, also that of OpenCV, whose first line and matrices are no plain YAML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from rasterjit.io.gltf.json_checks import get_integer, get_list, quote
from rasterjit.scene.arrays import Float64
from rasterjit.scene.validation import finite_array

MATRIX_TAG = "tag:yaml.org,2002:opencv-matrix"

_FLOAT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.inf|\.nan", re.I)
"""Numbers as YAML 1.2 has them: 1e-5 is one, which 1.1 took for a text."""


def read_yaml(file: Path) -> dict[str, Any]:
    """Return the mapping that a YAML file is, or raise ``ValueError``."""
    try:
        import yaml
    except ImportError as error:
        raise ValueError(
            f"reading it needs a package that is not installed ({error}); "
            "pip install 'rasterjit[cameras]' brings it"
        ) from error

    class Loader(yaml.SafeLoader):
        """Plain values alone, and OpenCV's matrices as mappings."""

    Loader.add_constructor(MATRIX_TAG, Loader.construct_yaml_map)
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT_ALONE, list("-+.0123456789"))
    lines = file.read_text("utf-8").splitlines(keepends=True)
    text = "".join(lines[1:] if lines and lines[0].startswith("%YAML") else lines)
    try:
        document = yaml.load(text, Loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None
    if not isinstance(document, dict):
        raise ValueError(f"it must hold keys and values, got {quote(document)}")
    return document


_FLOAT_ALONE = re.compile(rf"(?:{_FLOAT.pattern})$", re.I)


def get_matrix(values: dict[str, Any], key: str) -> Float64:
    """Return a matrix of ``rows``, ``cols`` and ``data``, or raise ``ValueError``."""
    held = values.get(key)
    if not isinstance(held, dict):
        raise ValueError(f"{key} must be a matrix of rows, cols and data, got {quote(held)}")
    try:
        rows, columns = get_integer(held, "rows"), get_integer(held, "cols")
        data = finite_array("data", get_list(held, "data"), (rows * columns,))
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    return data.reshape(rows, columns)
