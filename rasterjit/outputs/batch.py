"""Hold the result of a batch of views: one array for each output."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from typing import Any

from numpy.typing import NDArray

from rasterjit.outputs.frame import FrameStats, RenderedOutputs
from rasterjit.outputs.output_table import is_attribute
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.validation import brief


class Batch(RenderedOutputs):
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

    _HOLDER = "batch"

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
            raise TypeError(_index_message(number, self._outputs)) from None
        count = len(self)
        if not -count <= index < count:
            views = "1 view" if count == 1 else f"{count} views"
            raise IndexError(f"this batch has {views}, got the number {brief(number)}")
        return {name: array[index] for name, array in self._outputs.items()}

    def __iter__(self) -> Iterator[dict[str, NDArray[Any]]]:
        return (self[number] for number in range(len(self)))


def _index_message(key: Any, outputs: Iterable[str]) -> str:
    """Return the message for an index that is no integer, with an expression to write instead."""
    names = [*outputs]
    name = key if isinstance(key, str) and key in names else names[0]
    expression = f"batch.attribute({name.removeprefix(ATTRIBUTE)!r})"
    if not is_attribute(name):
        expression = f"batch.{name}"
    text = brief(key)
    return f"batch[n] takes a whole number, got {text}; {expression} is an array of all views"
