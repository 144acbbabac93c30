"""
Compare pictures with recorded ones, bit by bit: a plug-in of pytest, its fixture ``golden``.

In ``conftest.py``::

    pytest_plugins = ["rasterjit.compat.golden"]

In a test::

    def test_teapot(golden):
        golden(rasterjit.render("teapot.obj"))

``pytest --golden-update`` records what tests draw. RasterJIT's pictures have the same bits on every
machine, so they need no tolerance.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.images import save_image
from rasterjit.outputs.frame import Frame

FOLDER = "golden"
"""Folder of recorded pictures, beside the file of the test."""

FAILURES = "golden-failures"
"""Folder of pictures that show differences, below pytest's root folder."""

GAP_COLUMNS = 8
"""Columns between the pictures of a comparison."""

DIFFERENCE_COLOR = (255, 0, 255)
"""Colour of pixels that differ, over the recorded picture at a quarter of its light."""

RECORDED_PROPERTY = "golden-recorded"
"""Property of a test that holds the path of its recorded picture."""


class Golden:
    """
    Compares pictures with the recorded ones of a test.

    Attributes
    ----------
    folder : Path
        Where they lie.
    """

    def __init__(self, request: pytest.FixtureRequest) -> None:
        self.folder = request.path.parent / FOLDER / request.path.stem
        self._test = _make_file_name(request.node)
        self._node, self._config = request.node, request.config
        self._names: set[str] = set()

    def __call__(self, picture: Frame | NDArray[Any], name: str | None = None) -> None:
        """
        Fail if a picture differs from the recorded one, even in one bit.

        Parameters
        ----------
        picture : Frame or ndarray
            Of a frame its colour. Pictures of 8 bits, (H, W), (H, W, 3) or (H, W, 4), are recorded
            as PNG, other arrays as ``.npy``.
        name : str, optional
            Tells several pictures of a test apart. Default: the first has the test's name alone,
            further ones are counted.

        Raises
        ------
        ValueError
            If it is no picture, the test has used the name before, or pictures of another test
            have the same files.
        """
        array = picture.color if isinstance(picture, Frame) else np.ascontiguousarray(picture)
        if array.dtype.hasobject or array.size == 0:
            raise ValueError(
                f"picture must be a Frame or an array, got {array.dtype} {array.shape}"
            )
        path = (
            self.folder
            / f"{self._make_unique_name(name)}{'.png' if _is_picture(array) else '.npy'}"
        )
        if self._config.getoption("golden_update"):
            self._record(path, array)
        elif not path.exists():
            pytest.fail(f"no picture is recorded at {path}: run pytest --golden-update", False)
        else:
            self._compare(path, array)

    def _make_unique_name(self, name: str | None) -> str:
        """Return the file name of a picture, without its suffix."""
        self._check_file_name()
        if name is None:
            count = len(self._names) + 1
            name = self._test if count == 1 else f"{self._test}--{count}"
        elif re.fullmatch(r"[\w.-]+", name):
            name = f"{self._test}--{name}"
        else:
            raise ValueError(f"name must be letters, digits, '_', '-' and '.', got {name!r}")
        if name in self._names:
            raise ValueError(f"name must be used once in a test, got {name!r} again")
        self._names.add(name)
        return name

    def _check_file_name(self) -> None:
        """Raise ValueError if another collected test has the same file name."""
        for item in self._node.session.items:
            same_file = item.path == self._node.path and _make_file_name(item) == self._test
            if same_file and item.nodeid != self._node.nodeid:
                raise ValueError(
                    f"each test must have a file name of its own, but {item.nodeid} and "
                    f"{self._node.nodeid} both have {self._test}: name one of them by "
                    "pytest.param(..., id=...)"
                )

    def _record(self, path: Path, array: NDArray[Any]) -> None:
        """Record a picture, if it differs from the recorded one."""
        if path.exists() and _describe_difference(_read_picture(path), array) is None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".png":
            save_image(path, array)
        else:
            with atomic_file(path) as temporary, temporary.open("wb") as file:
                np.save(file, array)
        other = path.with_suffix(".npy" if path.suffix == ".png" else ".png")
        other.unlink(missing_ok=True)
        self._node.user_properties.append((RECORDED_PROPERTY, str(path)))

    def _compare(self, path: Path, array: NDArray[Any]) -> None:
        """Fail if a picture differs from the recorded one."""
        recorded = _read_picture(path)
        difference = _describe_difference(recorded, array)
        if difference is None:
            return
        lines = [difference, f"recorded: {path}"]
        sheet = draw_side_by_side(recorded, array)
        if sheet is not None:
            sheet_path = self._config.rootpath / FAILURES / f"{self.folder.name}-{path.stem}.png"
            sheet_path.parent.mkdir(exist_ok=True)
            save_image(sheet_path, sheet)
            lines.append(f"recorded, drawn and where they differ: {sheet_path}")
        lines.append("if the new picture is right, record it: pytest --golden-update")
        pytest.fail("\n".join(lines), False)


def _make_file_name(item: pytest.Item) -> str:
    """Return the file name of a test: its class, too, and no two dashes in a row."""
    name = item.nodeid.split("::", 1)[-1]
    return re.sub(r"[^\w.]+", "-", name).strip("-")


def _is_picture(array: NDArray[Any]) -> bool:
    """Tell whether an array can be stored as PNG."""
    return array.dtype == np.uint8 and (
        array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))
    )


def _read_picture(path: Path) -> NDArray[Any]:
    """Read a recorded picture."""
    if path.suffix == ".npy":
        return np.load(path)
    with Image.open(path) as image:
        return np.asarray(image)


def _describe_difference(recorded: NDArray[Any], drawn: NDArray[Any]) -> str | None:
    """Describe how two pictures differ; None if all bits are the same."""
    if (recorded.shape, recorded.dtype) != (drawn.shape, drawn.dtype):
        return (
            f"the picture is {drawn.shape} {drawn.dtype}, the recorded one {recorded.shape} "
            f"{recorded.dtype}"
        )
    if recorded.tobytes() == drawn.tobytes():
        return None
    differs = _mark_differences(recorded, drawn)
    first = tuple(int(one) for one in np.argwhere(differs)[0])
    return (
        f"{np.count_nonzero(differs)} of {differs.size} pixels differ, the first at row, column "
        f"{first}: {recorded[first].tolist()} was recorded, {drawn[first].tolist()} is drawn"
    )


def _mark_differences(recorded: NDArray[Any], drawn: NDArray[Any]) -> NDArray[np.bool_]:
    """Return the mask of pixels that differ in a bit, (H, W); of other arrays, of elements."""
    size = recorded.dtype.itemsize
    shape = (*recorded.shape, size)
    old, new = (np.frombuffer(one.tobytes(), np.uint8).reshape(shape) for one in (recorded, drawn))
    differs = old != new
    return differs.any(axis=tuple(range(min(2, recorded.ndim), differs.ndim)))


def draw_side_by_side(recorded: NDArray[Any], drawn: NDArray[Any]) -> NDArray[np.uint8] | None:
    """
    Return the recorded picture, the drawn one and their difference, (H, W, 4) uint8.

    Arrays of floats and numbers are shown between the least and largest of both. None for arrays
    that are no pictures.
    """
    both = [recorded, drawn]
    if any(one.ndim not in (2, 3) or one.shape[2:] not in ((), (3,), (4,)) for one in both):
        return None
    panels = [_to_rgba(one, both) for one in both]
    if recorded.shape == drawn.shape and recorded.dtype == drawn.dtype:
        changes = panels[0] // 4
        changes[..., 3] = 255
        changes[_mark_differences(recorded, drawn), :3] = DIFFERENCE_COLOR
        panels.append(changes)
    height = max(one.shape[0] for one in panels)
    columns = []
    for one in panels:
        gap = 0 if one is panels[-1] else GAP_COLUMNS
        columns.append(np.pad(one, ((0, height - one.shape[0]), (0, gap), (0, 0))))
    return np.hstack(columns)


def _to_rgba(array: NDArray[Any], both: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """Convert an array to a picture, (H, W, 4) uint8."""
    if not all(one.dtype == np.uint8 for one in both):
        values = np.concatenate([np.asarray(one, np.float64).ravel() for one in both])
        values = values[np.isfinite(values)]
        low, high = (values.min(), values.max()) if len(values) else (0.0, 0.0)
        scale = 255.0 / (high - low) if high > low else 0.0
        finite = np.nan_to_num(np.asarray(array, np.float64), nan=low, posinf=high, neginf=low)
        array = ((finite - low) * scale).astype(np.uint8)
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.shape[2] == 4:
        return array
    return np.dstack([array, np.full(array.shape[:2], 255, np.uint8)])


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Golden:
    """Compare a frame or an array with the recorded one: ``golden(frame)``."""
    return Golden(request)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--golden-update``."""
    parser.getgroup("rasterjit").addoption(
        "--golden-update", action="store_true",
        help="record what tests with the fixture golden draw, in place of comparing",
    )  # fmt: skip


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List recorded pictures; processes of pytest-xdist send them with their reports."""
    reports = terminalreporter.stats.get("passed", []) + terminalreporter.stats.get("failed", [])
    for report in reports:
        for name, path in report.user_properties:
            if name == RECORDED_PROPERTY and report.when == "call":
                terminalreporter.write_line(f"golden: recorded {path}")
