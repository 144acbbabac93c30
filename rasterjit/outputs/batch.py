"""What a batch of views returns: the outputs of all of them, one array each."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import FrameStats, output_named
from rasterjit.outputs.table import is_attribute
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.validation import in_short


class Batch:
    """
    The pictures and buffers of many views of one scene; `rasterjit.render_batch` returns it.

    Every output is that of a `Frame` with an axis of N views in front: ``color`` is (N, H, W, 4)
    uint8, ``depth`` (N, H, W) float32, and so on; reading one that was not asked for raises an
    error that names it. ``len`` is N; ``batch[n]`` has the arrays of one view, views of these, by
    name; a loop over it goes through all of them.
    ``imageio.v3.imwrite("view.png", batch.color[n])`` writes a view's picture to a file.

    Attributes
    ----------
    stats : FrameStats
        The sums of all views; ``seconds`` has the wall-clock time of them all.
    """

    def __init__(self, outputs: dict[str, NDArray[Any]], stats: FrameStats) -> None:
        self._outputs = outputs
        self.stats = stats

    def __repr__(self) -> str:
        count, height, width = next(iter(self._outputs.values())).shape[:3]
        return f"Batch({count} of {width} x {height}: {', '.join(self._outputs)})"

    def __len__(self) -> int:
        return len(next(iter(self._outputs.values())))

    def __getitem__(self, number: int) -> dict[str, NDArray[Any]]:
        """
        Return the outputs of a view by name, (H, W, ...) each; they are views of the whole arrays.

        Parameters
        ----------
        number : int
            From 0; negative ones count from the end.

        Raises
        ------
        IndexError
            If there is no such view.
        TypeError
            If it is no whole number.
        """
        try:
            index = operator.index(number)
        except TypeError:
            raise TypeError(_no_number(number, self._outputs)) from None
        count = len(self)
        if not -count <= index < count:
            views = "1 view" if count == 1 else f"{count} views"
            raise IndexError(f"this batch has {views}, got the number {in_short(number)}")
        at = index % count
        return {name: array[at] for name, array in self._outputs.items()}

    def __iter__(self) -> Iterator[dict[str, NDArray[Any]]]:
        return (self[number] for number in range(len(self)))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all outputs by name, (N, H, W, ...) each."""
        return dict(self._outputs)

    def attribute(self, name: str) -> NDArray[np.float32]:
        """
        Return an attribute of the meshes, (N, H, W, D); takes what `Frame.attribute` takes.

        Parameters
        ----------
        name : str

        Raises
        ------
        OutputNotRequestedError
            If the output was not asked for.
        """
        full = f"{ATTRIBUTE}{name}"
        return self._output(name if is_attribute(name) and full not in self._outputs else full)

    @property
    def color(self) -> NDArray[np.uint8]:
        """(N, H, W, 4) uint8; see `Frame.color`."""
        return self._output("color")

    @property
    def linear(self) -> NDArray[np.float32]:
        """(N, H, W, 4) float32; see `Frame.linear`."""
        return self._output("linear")

    @property
    def depth(self) -> NDArray[np.float32]:
        """(N, H, W) float32; see `Frame.depth`."""
        return self._output("depth")

    @property
    def distance(self) -> NDArray[np.float32]:
        """(N, H, W) float32; see `Frame.distance`."""
        return self._output("distance")

    @property
    def face_id(self) -> NDArray[np.int32]:
        """(N, H, W) int32; see `Frame.face_id`."""
        return self._output("face_id")

    @property
    def object_id(self) -> NDArray[np.int32]:
        """(N, H, W) int32; see `Frame.object_id`."""
        return self._output("object_id")

    @property
    def instance_id(self) -> NDArray[np.int32]:
        """(N, H, W) int32; see `Frame.instance_id`."""
        return self._output("instance_id")

    @property
    def material_id(self) -> NDArray[np.int32]:
        """(N, H, W) int32; see `Frame.material_id`."""
        return self._output("material_id")

    @property
    def barycentric(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.barycentric`."""
        return self._output("barycentric")

    @property
    def uv(self) -> NDArray[np.float32]:
        """(N, H, W, 2) float32; see `Frame.uv`."""
        return self._output("uv")

    @property
    def scalar(self) -> NDArray[np.float32]:
        """(N, H, W) float32; see `Frame.scalar`."""
        return self._output("scalar")

    @property
    def normal(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.normal`."""
        return self._output("normal")

    @property
    def geometric_normal(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.geometric_normal`."""
        return self._output("geometric_normal")

    @property
    def normal_camera(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.normal_camera`."""
        return self._output("normal_camera")

    @property
    def position(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.position`."""
        return self._output("position")

    @property
    def position_camera(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.position_camera`."""
        return self._output("position_camera")

    @property
    def object_position(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.object_position`."""
        return self._output("object_position")

    @property
    def nocs(self) -> NDArray[np.float32]:
        """(N, H, W, 3) float32; see `Frame.nocs`."""
        return self._output("nocs")

    @property
    def coverage(self) -> NDArray[np.float32]:
        """(N, H, W) float32; see `Frame.coverage`."""
        return self._output("coverage")

    def _output(self, name: str) -> NDArray[Any]:
        return output_named(name, self._outputs, "batch")


def _no_number(key: Any, outputs: Iterable[str]) -> str:
    """Say of a key that is no whole number what gives outputs of a batch."""
    names = [*outputs]
    name = key if isinstance(key, str) and key in names else names[0]
    whole = f"batch.attribute({name.removeprefix(ATTRIBUTE)!r})"
    if not is_attribute(name):
        whole = f"batch.{name}"
    shown = in_short(key)
    return f"batch[n] takes a whole number, got {shown}; {whole} is an array of all views"
