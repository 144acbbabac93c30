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
from rasterjit.pipeline.passes import ShadingArrays, ShadingNeeds, bind
from rasterjit.pipeline.records import Geometry, Lighting, Placement, Surface
from rasterjit.pipeline.srgb_encoding import Encoding, encode_color, make_encoding_table
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.rendering import shading_passes
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.spinning_threads import Call
from rasterjit.runtime.stage_runner import BlockMemory, StageList, Step, block_memory
from rasterjit.runtime.state_block import WORD, RecordType, count_block_words, type_from_annotation
from rasterjit.runtime.threads import Workers
from rasterjit.survey.effect import ActiveEffect

_BLOCK = type_from_annotation(Block)
assert isinstance(_BLOCK, RecordType)
BLOCK: RecordType = _BLOCK
"""Layout of a block of samples."""

THREAD_BLOCK = BlockMemory(BLOCK)
"""A block of samples for each thread."""


def make_shading_arrays(
    needs: ShadingNeeds,
    geometry: Geometry | None,
    placement: Placement,
    surface: Surface,
    lighting: Lighting | None,
    viewer: NDArray[np.float32] | None = None,
) -> ShadingArrays:
    """
    Collect the arrays that the passes of a picture read.

    ``viewer`` is ``placement.toward_viewer`` in float32; given if both are filled later.
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
        First, and one past the last; may belong to several objects.
    vertex_starts : (O+1,) int64
        Object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``.
    placement, surface, lighting : records
        ``surface.normals`` is present; ``surface.face_colors`` is not read.
    effects : sequence of Active
        Only those that act on lights and ambient light count.
    lit_vertices : (V, 2, 3) float32
        Written for these vertices: linear colour, for a viewer in front and one behind.
    """
    listed = vertices, vertex_starts
    steps = list_vertex_steps(needs, listed, placement, surface, lighting, effects, lit_vertices)
    THREAD_BLOCK.block[: rows.COUNT_ELEMENTS] = 0
    StageList(steps).run(THREAD_BLOCK.block, BLOCK)


def list_vertex_steps(
    needs: ShadingNeeds,
    listed: tuple[tuple[int, int], NDArray[np.int64]],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[ActiveEffect],
    lit_vertices: NDArray[np.float32],
    viewer: NDArray[np.float32] | None = None,
) -> list[Step]:
    """Return the stages that light some vertices, given the first vertex of each object."""
    needs = needs.of_vertices(lighting.highlights is not None)
    arrays = make_shading_arrays(needs, None, placement, surface, lighting, viewer)
    return bind(shading_passes.vertex_passes(needs, effects, listed, lit_vertices), arrays)


class Shading:
    """
    The shading passes of a picture, with the arrays that they read.

    Shades any image of face numbers, in several threads at once.

    Parameters
    ----------
    needs : ShadingNeeds
    geometry, placement, surface, lighting : records
        ``lighting`` None: every object shows its own colour.
    effects : sequence of Active
    encoding : str
        Transfer function of codes: see ``srgb_encoding.Encoding``.
    background : (4,) float32, linear
        Colour where no face is.
    viewer : (4,) float32, optional
        See `make_shading_arrays`.
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
        self._arrays = make_shading_arrays(
            self._needs, geometry, placement, surface, lighting, viewer
        )
        passes, self._color_row = shading_passes.shading_passes(self._needs, effects)
        self._stages = StageList(bind(passes, self._arrays))
        self._faces, self._face_starts = geometry.faces, placement.face_starts
        self._effects, self._table = tuple(effects), make_encoding_table(encoding)
        self._background_colors = background, encode_color(background, encoding)
        self._free_lists: defaultdict[tuple[bool, bool], list[StageList]] = defaultdict(list)

    def shade(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        background: tuple[NDArray[np.float32], int] | None = None,
    ) -> None:
        """
        Write the colours of some rows of a frame, or of several images of these rows.

        Parameters
        ----------
        faces : (R, W) int32, or (J, R, W)
            The visible faces of these rows, -1 where none is.
        first_row : int
            Their first row in the frame.
        linear : (R, W, 4) float32, or (R, 0, 4); or (J, R, W, 4), (J, R, 0, 4)
            Written: red, green, blue in linear light, and alpha.
        color : (R, W) uint32, or (R, 0); or (J, R, W), (J, R, 0)
            Written: sRGB codes, RGBA bytes from the lowest up.
        background : ((4,) float32, int), optional
            Where no face is: linear colour, and code. Default: that of the frame.
        """
        height = faces.shape[-2]
        if faces.ndim == 3:
            count = height * len(faces)
            faces, color = faces.reshape(count, -1), color.reshape(count, color.shape[2])
            linear = linear.reshape(count, linear.shape[2], 4)
        background_colors = self._background_colors if background is None else background
        stages = self._acquire_stages(faces, first_row, height, background_colors, linear, color)
        stages.run(THREAD_BLOCK.block, BLOCK)
        self._release_stages(stages, linear, color)

    def shade_bands(
        self,
        face_id: NDArray[np.int32],
        rows_of_band: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
        workers: Workers,
    ) -> None:
        """
        Write the colours of a frame in bands of rows, shared among threads.

        Parameters
        ----------
        face_id : (H, W) int32
        rows_of_band : int
        linear, color : arrays
            As `shade` takes them.
        workers : Workers
        """
        stage_lists = []

        def make_calls() -> Iterator[Call]:
            for first in range(0, len(face_id), rows_of_band):
                band = slice(first, first + rows_of_band)
                faces, colors = face_id[band], self._background_colors
                stages = self._acquire_stages(
                    faces, first, len(faces), colors, linear[band], color[band]
                )
                stage_lists.append(stages)
                yield stages.call()

        count = -(-len(face_id) // rows_of_band)
        workers.call_machine(make_calls(), count, count_block_words(BLOCK))
        for stages in stage_lists:
            self._release_stages(stages, linear, color)

    def _acquire_stages(self, *arguments: Any) -> StageList:
        """Return a free list of stages, with the arguments of `list_stages`."""
        *_, linear, color = arguments
        try:
            stages = self._free_lists[bool(linear.shape[1]), bool(color.shape[1])].pop()
        except IndexError:
            return self.list_stages(*arguments)
        stages.set_arguments(self._list_output_steps(*arguments))
        return stages

    def _release_stages(
        self, stages: StageList, linear: NDArray[np.float32], color: NDArray[np.uint32]
    ) -> None:
        # Do not keep the pictures alive.
        stages.release_arguments()
        self._free_lists[bool(linear.shape[1]), bool(color.shape[1])].append(stages)

    def list_stages(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        background_colors: tuple[NDArray[np.float32], int] | None,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> StageList:
        """Return the stages that `shade` runs, for images of a height, one below the other."""
        background_colors = background_colors or self._background_colors
        return StageList(
            self._list_output_steps(faces, first_row, height, background_colors, linear, color)
        )

    def _list_output_steps(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        background_colors: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Empty the thread's block; return the stages from listing samples to writing colours."""
        steps = self._list_color_steps(faces, first_row, height, background_colors, linear, color)
        inputs = self._needs, self._color_row, self._table, self._effects
        passes = shading_passes.output_passes(*inputs, linear, color)
        return steps + bind(passes, self._arrays)

    def resolve(self, *arguments: Any) -> None:
        """Resolve the faces of some rows over the background; see `list_resolve_stages`."""
        self.list_resolve_stages(*arguments).run(THREAD_BLOCK.block, BLOCK)

    def list_resolve_stages(
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
            Coverage of each face in its pixel.
        rest : (R, W) float32
            Coverage of the background.
        mixed : (R, 4, W) float32
            Background colours, to which the faces are added; linear with straight alpha, or codes.
        has_codes : bool
            Whether codes are resolved: each face is tone mapped, and rounded to codes.
        """
        layers, height, width = faces.shape
        faces = faces.reshape(layers * height, width)
        empty_linear = np.empty((len(faces), 0, 4), np.float32)
        empty_color = np.empty((len(faces), 0), np.uint32)
        steps = self._list_color_steps(
            faces, first_row, height, self._background_colors, empty_linear, empty_color
        )
        inputs = self._needs, self._color_row, self._table, self._effects
        passes = shading_passes.mixing_passes(*inputs, has_codes, (shares, rest, mixed))
        return StageList([*steps, *bind(passes, self._arrays)])

    def _list_color_steps(
        self,
        faces: NDArray[np.int32],
        first_row: int,
        height: int,
        background_colors: tuple[NDArray[np.float32], int],
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> list[Step | StageList]:
        """Empty the thread's block; return the stages from listing samples to their colours."""
        THREAD_BLOCK.block[: rows.COUNT_ELEMENTS] = 0
        arguments = (
            faces, first_row, height, self._faces, self._face_starts, *background_colors, linear,
            color,
        )  # fmt: skip
        return [Step(list_samples, arguments), self._stages]


Condition = tuple[NDArray[np.int64], int, int]
"""An array, and the least and greatest value of its first number for which a call is made."""


class CoverageArguments(NamedTuple):
    """Arguments of ``coverage_resolve.list_coverage``, for N samples of R rows."""

    opaque: NDArray[np.int32]
    """(N, B, W): the faces at all samples of a band."""
    rows: tuple[int, int]
    """The first row of the band that is resolved, and one past the last."""
    shown: NDArray[np.int32]
    """(N, R, W), written: the faces of each pixel."""
    shares: NDArray[np.float32]
    """(N, R, W), written: the coverage of these faces."""
    rest: NDArray[np.float32]
    """(R, W), written: the coverage of the background."""
    scratch: NDArray[np.int32]
    """(2, C)."""


class ImmediateCalls:
    """Calls kernels and stages at once."""

    def call(self, kernel: Any, *arguments: Any, when: Condition | None = None) -> None:
        """Call a kernel, if its condition holds."""
        if when is None or when[1] <= when[0][0] <= when[2]:
            kernel(*arguments)

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: Condition | None = None,
    ) -> None:  # fmt: skip
        """Write the linear colour of faces, as `Shading.shade` does."""
        self.call(shading.shade, faces, first_row, linear, empty_color(linear), when=when)

    def resolve(
        self, shading: Shading, first_row: int, coverage: CoverageArguments,
        behind: NDArray[np.float32], mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """
        Resolve the faces of samples over the background, (R, W, 4) or (1, 1, 4).

        ``mixed``, (R, 4, W), is written: see `Shading.list_resolve_stages`.
        """
        count = int(coverage_resolve.list_coverage(*coverage))
        mixed[:] = behind.transpose(0, 2, 1)
        faces = coverage.shown[:count]
        shading.resolve(faces, first_row, coverage.shares, coverage.rest, mixed, has_codes)


IMMEDIATE = ImmediateCalls()


class RecordedCalls:
    """
    Records kernels and stages with their arguments, as a table of calls.

    Must stay alive while its table is in use.
    """

    def __init__(self) -> None:
        self.owners: list[Any] = []
        """Owners of the memory behind the addresses."""
        self._calls: list[tuple[int, ...]] = []
        self._limits: list[tuple[int, int]] = []
        self._block = block_memory(BLOCK)

    @property
    def count(self) -> int:
        """Number of calls so far."""
        return len(self._calls)

    def bind(self, kernel: Any, *arguments: Any) -> Bound:
        """Bind a kernel to its arguments, without a call, and keep these alive."""
        bound = Bound(kernel, *arguments)
        self.owners.append(bound)
        return bound

    def add(
        self, bound: Bound, view_number_address: int = 0, when: Condition | None = None
    ) -> None:
        """Record the call of a bound kernel; the view's number is first written to an address."""
        address, state = bound.words.tolist()
        self._calls.append((address, state, 0, view_number_address, *self._condition_words(when)))

    def call(self, kernel: Any, *arguments: Any, when: Condition | None = None) -> None:
        """Record the call of a kernel."""
        self.add(self.bind(kernel, *arguments), when=when)

    def run_stages(self, stages: StageList, when: Condition | None = None) -> None:
        """Record a run of stages over an empty block."""
        bound = stages.bind(self._block)
        self.owners.append(bound)
        self._calls.append((*bound.words, 0, *self._condition_words(when)))

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: Condition | None = None,
    ) -> None:  # fmt: skip
        """Record what `ImmediateCalls.shade` does."""
        color = empty_color(linear)
        stages = shading.list_stages(faces, first_row, len(faces), None, linear, color)
        self.run_stages(stages, when)

    def resolve(
        self, shading: Shading, first_row: int, coverage: CoverageArguments,
        behind: NDArray[np.float32], mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """Record what `ImmediateCalls.resolve` does."""
        stages = shading.list_resolve_stages(
            coverage.shown, first_row, coverage.shares, coverage.rest, mixed, has_codes
        )
        # `list_coverage` finds how many images of faces there are.
        count_address = stages.address_of(0) + WORD
        self.call(
            start_resolve,
            self.bind(coverage_resolve.list_coverage, *coverage).words,
            count_address,
            behind,
            mixed,
        )
        self.run_stages(stages)

    def add_limit(self, watched: NDArray[np.int64], highest: int) -> None:
        """Reject views after which an array's first number exceeds ``highest``."""
        self.owners.append(watched)
        self._limits.append((watched.ctypes.data, highest))

    def table(self) -> NDArray[np.int64]:
        """Return the table of calls, (C, 7), as ``pipeline/batch_driver.py`` takes it."""
        return np.array(self._calls, np.int64).reshape(-1, 7)

    def limits(self) -> NDArray[np.int64]:
        """Return the table of limits, (L, 2), as ``pipeline/batch_driver.py`` takes it."""
        return np.array(self._limits, np.int64).reshape(-1, 2)

    def _condition_words(self, when: Condition | None) -> tuple[int, int, int]:
        if when is None:
            return 0, 0, 0
        self.owners.append(when[0])
        return when[0].ctypes.data, *when[1:]


AnyCalls = ImmediateCalls | RecordedCalls


class RecordingWorkers(Workers):
    """Workers of one thread, which record calls instead of making them."""

    def __init__(self, calls: RecordedCalls) -> None:
        super().__init__(1)
        self._calls = calls

    def run(self, task: Any, arguments: Iterable[tuple]) -> list[Any]:
        """Record the call of a kernel for each tuple."""
        for each in arguments:
            self._calls.call(task, *each)
        return []

    def keep_alive(self, owner: Any) -> None:
        """Keep the owner of memory that tasks read alive as long as the calls."""
        self._calls.owners.append(owner)


def empty_color(linear: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return an empty array in place of an 8-bit output, for linear pixels (..., W, 4)."""
    return np.empty((*linear.shape[:-2], 0), np.uint32)
