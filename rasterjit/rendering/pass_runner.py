"""
Run the passes that shade a picture: over the samples of its pixels, and over its vertices.

``runtime/stage_runner.py`` runs them. The same code draws frames and batches: it calls kernels and
stages at once (`IMMEDIATE`), or records them (`RecordedCalls`) to be replayed for many views.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.batch_driver import start_resolve
from rasterjit.pipeline.fragments import coverage_resolve
from rasterjit.pipeline.passes import Pass, ShadingArrays, ShadingNeeds, bind
from rasterjit.pipeline.records import Geometry, Lighting, Placement, Surface
from rasterjit.pipeline.srgb_encoding import Encoding, encode_color, make_encoding_table
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.rendering import shading_passes
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.spinning_threads import Call
from rasterjit.runtime.stage_runner import BlockMemory, StageList, Step, block_memory
from rasterjit.runtime.state_block import WORD, RecordType, size_of, type_named
from rasterjit.runtime.threads import Workers
from rasterjit.survey.effect import ActiveEffect

_BLOCK = type_named(Block)
assert isinstance(_BLOCK, RecordType)
BLOCK: RecordType = _BLOCK
"""The types of the arrays of a block of samples."""

BLOCKS = BlockMemory(BLOCK)
"""The block of each thread."""


def shading_arrays(
    needs: ShadingNeeds,
    geometry: Geometry | None,
    placement: Placement,
    surface: Surface,
    lighting: Lighting | None,
    viewer: NDArray[np.float32] | None = None,
) -> ShadingArrays:
    """
    Return what the passes of a picture read.

    ``viewer`` is ``placement.toward_viewer`` in float32, where both are filled later.
    """
    seen, lit_base = placement, surface.materials
    if needs.pyrender is not None:
        seen = shading_passes.without_sides(placement, needs)
    if needs.multiplies_vertex_colors:
        lit_base = shading_passes.whitened(surface.materials)
    if viewer is None:
        viewer = placement.toward_viewer.astype(np.float32)
    parts: tuple[Any, Any, Any, Any] = geometry, placement, surface, lighting
    return ShadingArrays(*parts, viewer, seen, lit_base)


def light_vertices(
    needs: ShadingNeeds,
    vertices: tuple[int, int],
    vertex_starts: NDArray[np.int64],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[ActiveEffect],
    lit_vertices: NDArray[np.float32],
) -> None:
    """
    Light the vertices of the objects shaded by Gouraud.

    Parameters
    ----------
    needs : ShadingNeeds
        Of the picture.
    vertices : (int, int)
        The first, and one past the last; they may belong to several objects.
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    placement, surface, lighting : records
        ``surface.normals`` is present; ``surface.face_colors`` has no part in it.
    effects : sequence of ActiveEffect
        Those that act on lights and on light from all sides count, not those that act on pixels.
    lit_vertices : (V, 2, 3) float32
        Written for those vertices: linear colour, for a viewer in front and one behind.
    """
    listed = vertices, vertex_starts
    steps = vertex_steps(needs, listed, placement, surface, lighting, effects, lit_vertices)
    BLOCKS.block[: rows.COUNT_ELEMENTS] = 0
    StageList(steps).run(BLOCKS.block, BLOCK)


def vertex_steps(
    needs: ShadingNeeds,
    listed: tuple[tuple[int, int], NDArray[np.int64]],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[ActiveEffect],
    lit_vertices: NDArray[np.float32],
    viewer: NDArray[np.float32] | None = None,
) -> list[Step]:
    """Return the stages that light some vertices, of those that begin with each object."""
    needs = needs.of_vertices(lighting.highlights is not None)
    arrays = shading_arrays(needs, None, placement, surface, lighting, viewer)
    return bind(shading_passes.vertex_passes(needs, effects, listed, lit_vertices), arrays)


class Shading:
    """
    The shading passes of a picture, with the arrays that they read.

    It shades any image of face numbers, in several threads at once.

    Parameters
    ----------
    needs : ShadingNeeds
    geometry, placement, surface, lighting : records
        ``lighting`` None: every object shows its own colour.
    effects : sequence of ActiveEffect
    encoding : str
        What codes show: see ``srgb_encoding.Encoding``.
    background : (4,) float32, linear
        What `shade` paints where no face is.
    viewer : (4,) float32, optional
        ``placement.toward_viewer``, where both are filled later.
    """

    def __init__(
        self,
        needs: ShadingNeeds,
        geometry: Geometry,
        placement: Placement,
        surface: Surface,
        lighting: Lighting | None,
        effects: Sequence[ActiveEffect],
        encoding: Encoding,
        background: NDArray[np.float32],
        viewer: NDArray[np.float32] | None = None,
    ) -> None:
        self._needs = needs._replace(on_faces=geometry.viewport.sample_radius == 0)
        own = self._needs, geometry, placement, surface, lighting, viewer
        self._arrays = shading_arrays(*own)
        passes, self._shown = shading_passes.shading_passes(self._needs, effects)
        self._stages = StageList(bind(passes, self._arrays))
        self._faces, self._face_starts = geometry.faces, placement.face_starts
        self._effects, self._table = tuple(effects), make_encoding_table(encoding)
        self._painted = background, encode_color(background, encoding)
        self._spare: defaultdict[tuple[bool, bool], list[StageList]] = defaultdict(list)

    def shade(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        background: tuple[NDArray[np.float32], int] | None = None,
    ) -> None:
        """
        Write the colour of some rows of a frame; or of several images of these rows.

        Parameters
        ----------
        faces : (R, W) int32, or (J, R, W)
            The visible faces of these rows, -1 where none is.
        first_row : int
            Where they lie in the frame.
        linear : (R, W, 4) float32, or (R, 0, 4); or (J, R, W, 4), (J, R, 0, 4)
            Written: red, green, blue in linear light, and alpha.
        color : (R, W) uint32, or (R, 0); or (J, R, W), (J, R, 0)
            Written: what is to be shown of it in sRGB codes, RGBA bytes from the lowest up.
        background : ((4,) float32, int), optional
            Where no face is: linear, and as it is shown. Default: that of the frame.
        """
        height = faces.shape[-2]
        if faces.ndim == 3:
            count = height * len(faces)
            faces, color = faces.reshape(count, -1), color.reshape(count, color.shape[2])
            linear = linear.reshape(count, linear.shape[2], 4)
        painted = self._painted if background is None else background
        stages = self._take(faces, first_row, height, painted, linear, color)
        stages.run(BLOCKS.block, BLOCK)
        self._put_back(stages, linear, color)

    def shade_bands(
        self,
        face_id: NDArray[np.int32],
        rows_of_band: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        workers: Workers,
    ) -> None:
        """
        Write the colour of a frame in bands of rows, shared among threads.

        Parameters
        ----------
        face_id : (H, W) int32
        rows_of_band : int
        linear, color : arrays
            As `shade` takes them.
        workers : Workers
        """
        listed = []

        def calls() -> Iterator[Call]:
            for first in range(0, len(face_id), rows_of_band):
                band = slice(first, first + rows_of_band)
                faces, parts = face_id[band], (linear[band], color[band])
                stages = self._take(faces, first, len(faces), self._painted, *parts)
                listed.append(stages)
                yield stages.call()

        count = -(-len(face_id) // rows_of_band)
        workers.call_machine(calls(), count, size_of(BLOCK))
        for stages in listed:
            self._put_back(stages, linear, color)

    def _take(self, *own: Any) -> StageList:
        """Return a list of stages that is not in use, for what `listed` takes."""
        *_, linear, color = own
        try:
            stages = self._spare[bool(linear.shape[1]), bool(color.shape[1])].pop()
        except IndexError:
            return self.listed(*own)
        stages.renew(self._output(*own))
        return stages

    def _put_back(
        self, stages: StageList, linear: NDArray[np.float32], color: NDArray[np.uint32]
    ) -> None:
        # Do not keep the pictures alive.
        stages.let_go()
        self._spare[bool(linear.shape[1]), bool(color.shape[1])].append(stages)

    def listed(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int] | None,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> StageList:
        """Return the stages that `shade` runs, of images one below the other, each so high."""
        painted = painted or self._painted
        return StageList(self._output(faces, first_row, height, painted, linear, color))

    def _output(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Return the stages from listing samples to writing colours, an empty block at hand."""
        steps = self._list(faces, first_row, height, painted, linear, color)
        own = self._needs, self._shown, self._table, self._effects
        return steps + self._bound(shading_passes.output_passes(*own, linear, color))

    def mix(self, *arguments: Any) -> None:
        """Resolve the faces of some rows over the background; takes what `mixing` does."""
        self.mixing(*arguments).run(BLOCKS.block, BLOCK)

    def mixing(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        shares: NDArray[np.float32],
        rest: NDArray[np.float32],
        mixed: NDArray[np.float32],
        has_codes: bool,
    ) -> StageList:
        """
        Return the stages that resolve the faces of some rows over the background, by coverage.

        Parameters
        ----------
        faces : (J, R, W) int32
            The faces of each pixel, -1 behind the last.
        first_row : int
        shares : (J, R, W) float32
            The share that a face has in its pixel.
        rest : (R, W) float32
            The share that shows no face.
        mixed : (R, 4, W) float32
            Changed: linear colour with straight alpha, or codes of it.
        has_codes : bool
            Whether codes are mixed: the tones of each colour are mapped, it is rounded to codes.
        """
        layers, height, width = faces.shape
        faces = faces.reshape(layers * height, width)
        no_linear = np.empty((len(faces), 0, 4), np.float32)
        no_color = np.empty((len(faces), 0), np.uint32)
        steps = self._list(faces, first_row, height, self._painted, no_linear, no_color)
        own = self._needs, self._shown, self._table, self._effects
        mixed_by = shading_passes.mixing_passes(*own, has_codes, (shares, rest, mixed))
        return StageList([*steps, *self._bound(mixed_by)])

    def _bound(self, passes: Sequence[Pass]) -> list[Step]:
        return bind(passes, self._arrays)

    def _list(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        painted: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Return the stages from listing samples to their colours, with an empty block at hand."""
        BLOCKS.block[: rows.COUNT_ELEMENTS] = 0
        listed = (
            faces, first_row, height, self._faces, self._face_starts, *painted, linear, color,
        )  # fmt: skip
        return [Step(list_samples, listed), self._stages]


When = tuple[NDArray[np.int64], int, int]
"""An array, and the least and the most that its first number may be."""


class Sharing(NamedTuple):
    """Arguments of ``coverage_resolve.list_coverage``, for N samples of R rows."""

    opaque: NDArray[np.int32]
    """(N, B, W): the faces at all samples of a band."""
    rows: tuple[int, int]
    """The first of its rows that is resolved, and one past the last."""
    shown: NDArray[np.int32]
    """(N, R, W), written: the faces of each pixel."""
    shares: NDArray[np.float32]
    """(N, R, W), written: their coverage."""
    rest: NDArray[np.float32]
    """(R, W), written: that of the background."""
    others: NDArray[np.int32]
    """(2, C): scratch memory."""


class ImmediateCalls:
    """Calls kernels and stages at once."""

    def call(self, kernel: Any, *arguments: Any, when: When | None = None) -> None:
        """Call a kernel, if a number is between two others."""
        if when is None or when[1] <= when[0][0] <= when[2]:
            kernel(*arguments)

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: When | None = None,
    ) -> None:  # fmt: skip
        """Write the linear colour of faces, as `Shading.shade` does."""
        self.call(shading.shade, faces, first_row, linear, no_color(linear), when=when)

    def mix(
        self, shading: Shading, first_row: int, sharing: Sharing, behind: NDArray[np.float32],
        mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """
        Resolve the faces of samples over the background, (R, W, 4) or (1, 1, 4).

        ``mixed``, (R, 4, W), is written: see `Shading.mixing`.
        """
        count = int(coverage_resolve.list_coverage(*sharing))
        mixed[:] = behind.transpose(0, 2, 1)
        found = sharing.shown[:count], first_row, sharing.shares, sharing.rest
        shading.mix(*found, mixed, has_codes)


IMMEDIATE = ImmediateCalls()


class RecordedCalls:
    """
    Records kernels and stages with their arguments, as a table to be called in order.

    Keep it alive while its table is in use.
    """

    def __init__(self) -> None:
        self.kept: list[Any] = []
        """Owners of the memory behind the addresses."""
        self._calls: list[tuple[int, ...]] = []
        self._limits: list[tuple[int, int]] = []
        self._block = block_memory(BLOCK)

    def bound(self, kernel: Any, *arguments: Any) -> Bound:
        """Return a kernel with its arguments, kept as long as this; it is not called by it."""
        bound = Bound(kernel, *arguments)
        self.kept.append(bound)
        return bound

    def add(self, bound: Bound, number: int = 0, when: When | None = None) -> None:
        """Call a kernel that is bound, and tell it the view's number at an address."""
        address, state = bound.words.tolist()
        self._calls.append((address, state, 0, number, *self._watched(when)))

    def call(self, kernel: Any, *arguments: Any, when: When | None = None) -> None:
        """Call a kernel."""
        self.add(self.bound(kernel, *arguments), when=when)

    def run_stages(self, stages: StageList, when: When | None = None) -> None:
        """Run stages over an empty block."""
        bound = stages.bound(self._block)
        self.kept.append(bound)
        self._calls.append((*bound.words, 0, *self._watched(when)))

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: When | None = None,
    ) -> None:  # fmt: skip
        """Do what `ImmediateCalls.shade` does."""
        own = faces, first_row, len(faces), None, linear, no_color(linear)
        self.run_stages(shading.listed(*own), when)

    def mix(
        self, shading: Shading, first_row: int, sharing: Sharing, behind: NDArray[np.float32],
        mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """Do what `ImmediateCalls.mix` does."""
        found = sharing.shown, first_row, sharing.shares, sharing.rest
        stages = shading.mixing(*found, mixed, has_codes)
        # How many images of faces there are is known when they are listed.
        told = stages.place_of(0) + WORD
        self.call(
            start_resolve,
            self.bound(coverage_resolve.list_coverage, *sharing).words,
            told,
            behind,
            mixed,
        )
        self.run_stages(stages)

    def limit(self, watched: NDArray[np.int64], most: int) -> None:
        """Reject views in which an array's first number exceeds ``most`` at the end."""
        self.kept.append(watched)
        self._limits.append((watched.ctypes.data, most))

    def table(self) -> NDArray[np.int64]:
        """Return the table of calls, (C, 7), as ``pipeline/batch_driver.py`` takes it."""
        return np.array(self._calls, np.int64).reshape(-1, 7)

    def limits(self) -> NDArray[np.int64]:
        """Return the table of limits, (L, 2), as ``pipeline/batch_driver.py`` takes it."""
        return np.array(self._limits, np.int64).reshape(-1, 2)

    def _watched(self, when: When | None) -> tuple[int, int, int]:
        if when is None:
            return 0, 0, 0
        self.kept.append(when[0])
        return when[0].ctypes.data, *when[1:]


AnyCalls = ImmediateCalls | RecordedCalls


class RecordingWorkers(Workers):
    """One thread that records what it is to run."""

    def __init__(self, calls: RecordedCalls) -> None:
        super().__init__(1)
        self._calls = calls

    def run(self, task: Any, arguments: Iterable[tuple]) -> list[Any]:
        """Record the call of a kernel for each tuple."""
        for some in arguments:
            self._calls.call(task, *some)
        return []

    def hold(self, owner: Any) -> None:
        """Keep what owns memory that tasks read as long as the calls."""
        self._calls.kept.append(owner)


def no_color(linear: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return an empty array that stands for no 8-bit output, beside (..., W, 4)."""
    return np.empty((*linear.shape[:-2], 0), np.uint32)
