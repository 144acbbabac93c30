"""Read YAML, also that of OpenCV, whose first line and matrices are no plain YAML."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from rasterjit.io.gltf.json_checks import get_integer, get_list, quote
from rasterjit.scene.arrays import Float64
from rasterjit.scene.validation import finite_array

OPENCV_TAGS = "tag:yaml.org,2002:opencv-"
"""Beginning of the tags of OpenCV's types; its matrices and others are mappings."""

MAX_VALUES = 10_000_000
"""Most values of a file, each counted as often as others name it."""

FLOAT_TAG = "tag:yaml.org,2002:float"
FLOAT = re.compile(r"(?:[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.inf|\.nan)$", re.I)
"""Numbers as YAML 1.2 has them: 1e-5 is one, which 1.1 took for a text."""

UNPRINTABLE = re.compile("[^\t\n\r -~\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What texts of YAML, and OpenCV's, do not hold: control characters and lone surrogates."""


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

    Loader.add_multi_constructor(
        OPENCV_TAGS, lambda loader, _, node: loader.construct_mapping(node, deep=True)
    )
    Loader.add_implicit_resolver(FLOAT_TAG, FLOAT, list("-+.0123456789"))
    text = re.sub(r"\A\s*%YAML.*", "", file.read_text("utf-8"))
    try:
        document = yaml.load(text, Loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None
    except (AttributeError, LookupError):
        raise ValueError("its values must be of their tags, such as !!timestamp") from None
    if _count_values(document, {}) > MAX_VALUES:
        raise ValueError(f"it must hold at most {MAX_VALUES} values")
    if not isinstance(document, dict):
        raise ValueError(f"it must hold keys and values, got {quote(document)}")
    return document


def _count_values(value: Any, counted: dict[int, int]) -> int:
    """Return how many values a value holds, those that it names several times as often."""
    if not isinstance(value, (dict, list)):
        return 1
    if id(value) not in counted:
        # What holds itself holds without end.
        counted[id(value)] = MAX_VALUES
        parts = value.values() if isinstance(value, dict) else value
        counted[id(value)] = 1 + sum(_count_values(part, counted) for part in parts)
    return counted[id(value)]


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


def quote_yaml(text: str) -> str:
    """Return a text as YAML's quoted one, as JSON's is, or raise ``ValueError``."""
    if found := UNPRINTABLE.search(text):
        raise ValueError(f"its name must have no {found[0]!r}, which YAML cannot hold")
    # OpenCV reads no escapes such as \u1234.
    return json.dumps(text, ensure_ascii=False)


def format_numbers(values: list[Any]) -> str:
    """Return numbers, or lists of them, as YAML has them; in YAML 1.1 all floats have a point."""
    return re.sub(r"(?<![.\d])(\d+)e", r"\1.0e", str(values))
