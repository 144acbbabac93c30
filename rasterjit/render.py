"""
The main path: a scene and a camera become a frame, one line for each stage.

See ``Renderer.render``; the stages themselves are in ``stages`` and ``kernels``.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from rasterjit import diagnostics as diagnosing
from rasterjit import dial, ground_truth, motion, passes, plan_views, stages, supersampling
from rasterjit import plan as planning
from rasterjit.arguments import choose_camera, find_earlier, plan_earlier
from rasterjit.frame import Frame, Stats
from rasterjit.io.meshes import as_scene
from rasterjit.kernels.jit import COMPILE_CLOCK
from rasterjit.kernels.records import Placement
from rasterjit.plan import RenderPlan
from rasterjit.plan_arrays import SceneArrays
from rasterjit.plan_views import Views
from rasterjit.prepared import Prepared, prepare
from rasterjit.reversed_depth import add_reversed_depth
from rasterjit.scene.camera import Camera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.view import View
from rasterjit.supersampling import Accumulation, Seen
from rasterjit.validation import image_size, positive_number, thread_count


def render(
    what: Any,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    max_error: float | None = None,
    time_budget: float | None = None,
    outputs: Sequence[str] = ("color",),
    background: Any = None,
    cull: str = "none",
    diagnose: bool = False,
    previous: View | None = None,
    threads: int | None = None,
) -> Frame:
    """
    Render one frame.

    Parameters
    ----------
    what : Scene, Mesh, trimesh.Trimesh or trimesh.Scene
    camera : Camera, optional
        Default: the scene's own camera, else one that fits the scene.
    size : (int, int)
        Width and height, pixels, each in 1..16384.
    quality : Quality, optional
        Default ``Quality.standard()``.
    max_error : float, optional
        In place of a quality: the fastest is chosen whose picture is expected to be that near to
        the one of ``Quality.reference()``, as the root mean square difference in linear light (and
        of alpha, before a background that is seen through). Two small pictures are drawn first to
        find out, and take their time.
    time_budget : float, optional
        In place of a quality: the most accurate one is chosen that is drawn in so many seconds,
        compiling apart. When a scene is seen first, frames of it are drawn to find out;
        ``Frame.choice`` tells what was expected and what came of it. If even the fastest quality
        takes longer, that is drawn.
    outputs : sequence of str
        Any of color, linear, depth, distance, face_id, object_id, instance_id, material_id,
        barycentric, uv, normal, geometric_normal, position, object_position, nocs, coverage,
        motion and motion_visible: see `Frame`. All but color, linear and coverage are those of the
        nearest face at the pixel's centre.
    background : color, optional
        ``"white"``, ``"#rrggbb"``, ``"transparent"``, or linear floats (see ``linear_color``).
        Default: the scene's environment, if it is a background; else white.
    cull : {"none", "back", "front"}
        Faces that are dropped. Counter-clockwise is the front.
    diagnose : bool
        Whether to count what became of every face; see ``Frame.diagnostics``.
    previous : View, optional
        How things were before, for the outputs motion and motion_visible, which need it.
    threads : int, optional
        Default: all processors. The frame has the same bits for any number.

    Returns
    -------
    Frame

    Raises
    ------
    ValueError
        Naming the argument that is wrong, before any kernel runs.
    """
    for name, value in (("max_error", max_error), ("time_budget", time_budget)):
        if value is not None and quality is not None:
            raise ValueError(f"quality must be None where {name} is given, got {quality!r}")
    with Renderer(size, quality=quality, threads=threads) as renderer:
        if time_budget is not None and max_error is None:
            options = outputs, background, cull, diagnose, previous
            return renderer._render_in_time(time_budget, what, camera, options, is_lone=True)
        return renderer.render(
            what, camera, max_error=max_error, time_budget=time_budget, outputs=outputs,
            background=background, cull=cull, diagnose=diagnose, previous=previous,
        )  # fmt: skip


def explain(
    what: Any,
    camera: Camera | None = None,
    quality: Quality | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    outputs: Sequence[str] = ("color",),
    background: Any = None,
    cull: str = "none",
    diagnose: bool = False,
    previous: View | None = None,
) -> RenderPlan:
    """
    Say what a render of these arguments would do, without doing it.

    Takes the arguments of `render`; the plan prints as a table.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    scene = as_scene(what)
    size = image_size("size", size)
    camera = choose_camera(scene, camera, size)
    plan = planning.plan_render(
        scene, camera, size, check_quality(quality), outputs, background, cull, diagnose
    )
    earlier = find_earlier(previous, plan, scene)
    return plan if earlier is None else replace(plan, previous=plan_earlier(plan, *earlier))


class Planned(NamedTuple):
    """A frame that is decided on."""

    plan: RenderPlan
    prepared: Prepared
    views: Views
    earlier: Planned | None = None
    """What it is compared with; ``None`` -> nothing."""


class StageClock:
    """Notes how long each stage took; compiling is taken out of the stages and noted apart."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"compile": 0.0}
        self._since = time.perf_counter()
        self._compiled = COMPILE_CLOCK.read()

    def __call__(self, stage: str) -> None:
        """End a stage."""
        now, compiled = time.perf_counter(), COMPILE_CLOCK.read()
        compiling = compiled - self._compiled
        self.seconds["compile"] += compiling
        # Another thread may compile longer than this stage takes.
        own = max(0.0, now - self._since - compiling)
        self.seconds[stage] = self.seconds.get(stage, 0.0) + own
        self._since, self._compiled = now, compiled


class Renderer:
    """
    Renders frames of one size, keeping threads and what they have in common between them.

    Meshes, materials, transforms, lights and cameras may change from one frame to the next.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels, each in 1..16384.
    quality : Quality, optional
        Default ``Quality.standard()``.
    threads : int, optional
        Default: all processors this process may run on.

    Raises
    ------
    ValueError
        If the size or the number of threads is wrong.
    """

    def __init__(
        self, size: tuple[int, int], *, quality: Quality | None = None, threads: int | None = None
    ) -> None:
        self.size = image_size("size", size)
        self.quality = check_quality(quality)
        self._workers = stages.Workers(thread_count("threads", threads))
        self._lone: tuple[Mesh, Scene] | None = None
        self._prepared: Prepared | None = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let the threads go; a later render starts them again."""
        self._workers.close()

    def render(
        self,
        what: Any,
        camera: Camera | None = None,
        *,
        max_error: float | None = None,
        time_budget: float | None = None,
        outputs: Sequence[str] = ("color",),
        background: Any = None,
        cull: str = "none",
        diagnose: bool = False,
        previous: View | None = None,
    ) -> Frame:
        """
        Render one frame; takes what `rasterjit.render` takes.

        With ``max_error`` or ``time_budget`` the quality of this renderer does not count.

        Returns
        -------
        Frame
            Its arrays are its own: the next render does not touch them.

        Raises
        ------
        ValueError
            Naming the argument that is wrong, before any kernel runs.
        """
        options = outputs, background, cull, diagnose, previous
        if max_error is not None:
            return self._render_within(max_error, time_budget, what, camera, options)
        if time_budget is not None:
            return self._render_in_time(time_budget, what, camera, options)
        return self._render(self.quality, what, camera, *options)

    def _render(self, quality: Quality, *arguments: Any) -> Frame:
        """Render one frame of a quality."""
        clock = StageClock()
        planned = self._plan(quality, *arguments)
        return self._draw(planned, clock, Accumulation())

    def _render_in_time(
        self,
        time_budget: float,
        what: Any,
        camera: Camera | None,
        options: tuple,
        is_lone: bool = False,
    ) -> Frame:
        """Render one frame in the best quality that a time allows; a lone one keeps nothing."""
        budget = positive_number("time_budget", time_budget)
        scene = self._scene(what)
        outputs, _, _, diagnose, _ = options
        circumstances = (
            self.size, self._workers.threads, planning.check_outputs(outputs), bool(diagnose),
            is_lone,
        )  # fmt: skip

        def draw(quality: Quality) -> Frame:
            if not is_lone:
                return self._render(quality, scene, camera, *options)
            # What is kept from frame to frame is not there for a lone one.
            with Renderer(self.size, threads=self._workers.threads) as lone:
                return lone._render(quality, scene, camera, *options)

        return dial.draw_in_time(budget, dial.times_of(what, circumstances), draw)

    def _render_within(
        self,
        max_error: float,
        time_budget: float | None,
        what: Any,
        camera: Camera | None,
        options: tuple,
    ) -> Frame:
        """Render one frame in the fastest quality that is near enough to the reference."""
        bound = positive_number("max_error", max_error)
        if time_budget is not None:
            raise ValueError(
                f"time_budget must be None where max_error is given, got {time_budget!r}"
            )
        scene = self._scene(what)
        camera = choose_camera(scene, camera, self.size)
        _, background, cull, *_ = options
        # What is wrong is wrong before anything is drawn.
        self._plan(Quality.standard(), scene, camera, *options)
        shown = (("color", "linear"), background, cull, False, None)
        with ExitStack() as stack:
            small = [
                stack.enter_context(Renderer(size, threads=self._workers.threads))
                for size in dial.probe_sizes(self.size)
            ]
            return dial.draw_within_error(
                bound,
                lambda quality: self._render(quality, scene, camera, *options),
                [
                    lambda quality, one=one: one._render(quality, scene, camera, *shown)
                    for one in small
                ],
            )

    def refine(
        self,
        what: Any,
        camera: Camera | None = None,
        *,
        outputs: Sequence[str] = ("color",),
        background: Any = None,
        cull: str = "none",
        diagnose: bool = False,
        previous: View | None = None,
    ) -> Iterator[Frame]:
        """
        Render one frame again and again, each time more accurately.

        Takes what `rasterjit.render` takes, whatever the quality of this renderer. The scene must
        stay as it is while frames are taken; other frames may be rendered in between.

        Yields
        ------
        Frame
            One of ``Quality.draft()``, one of ``Quality.standard()``, and then the mean of the
            first 4, 16, 64 and at last all 256 pictures of ``Quality.reference()``: the bits that
            ``render`` gives. ``frame.plan.quality`` and ``frame.plan.pictures`` say which it is.
            No picture is drawn twice.

        Raises
        ------
        ValueError
            At once, naming the argument that is wrong.
        """
        qualities = Quality.draft(), Quality.standard(), Quality.reference()
        arguments = what, camera, outputs, background, cull, diagnose, previous
        *first, best = [self._plan(one, *arguments) for one in qualities]
        last = [best._replace(plan=step) for step in supersampling.steps(best.plan)]
        return self._draw_all([*first, *last])

    def _draw_all(self, planned: Sequence[Planned]) -> Iterator[Frame]:
        """Draw frames one after the other, each from the pictures of those before it."""
        accumulation = Accumulation()
        for one in planned:
            yield self._draw(one, StageClock(), accumulation)

    def _plan(
        self,
        quality: Quality,
        what: Any,
        camera: Camera | None,
        outputs: Sequence[str],
        background: Any,
        cull: str,
        diagnose: bool,
        previous: View | None,
    ) -> Planned:
        """Check the arguments of a frame, and decide what it needs."""
        scene = self._scene(what)
        camera = choose_camera(scene, camera, self.size)
        self._prepared = prepared = prepare(scene.nodes, self._prepared, quality)
        views = plan_views.view_places(prepared.places, camera, self.size)
        plan = planning.plan_render(
            scene, camera, self.size, quality, outputs, background, cull, diagnose,
            prepared.stock, views,
        )  # fmt: skip
        earlier = find_earlier(previous, plan, scene)
        if earlier is None:
            return Planned(plan, prepared, views)
        old = prepare(earlier[0].nodes, prepared, quality)
        old_views = plan_views.view_places(old.places, earlier[1], self.size)
        old_plan = plan_earlier(plan, *earlier, old.stock, old_views)
        return Planned(
            replace(plan, previous=old_plan), prepared, views, Planned(old_plan, old, old_views)
        )

    def _find_faces(
        self, plan: RenderPlan, prepared: Prepared, clock: StageClock, views: Views | None = None
    ) -> Seen:
        """Find the face at every pixel; ``views`` are those of the plan's camera, where known."""
        camera, workers, arrays = plan.camera, self._workers, prepared.shapes.arrays
        if views is None:
            views = plan_views.view_places(prepared.places, camera, plan.size)
        viewport = planning.viewport_of(plan.size, plan.quality.subpixel_bits, plan.region)
        objects = plan_views.cull_objects(
            plan.cull, views, arrays.face_starts, prepared.looks.is_single_sided
        )
        coefficients = camera.depth_coefficients()
        clock("plan")
        vertices = stages.ModelVertices(
            prepared.shapes.positions(plan.quality.precision), arrays.vertex_starts,
            views.relative_from_model, views.clip_from_relative,
        )  # fmt: skip
        coverage = self._find_visible(
            vertices, arrays.faces, objects, plan.depth_format.coefficients, viewport, workers,
            clock,
            keep_depth=plan.needs_depth,
            find_faces=plan.needs_faces,
            keep_lists=plan.keeps_lists,
            keep_clip_positions=plan.diagnose or plan.wireframe is not None,
            cutouts=passes.find_cutouts(plan, prepared),
            depth_type=plan.depth_format.kind,
            is_affine=plan.is_affine,
        )  # fmt: skip
        geometry = stages.geometry_of(
            arrays.faces, coverage.screen, coverage.clip_positions, viewport, plan.is_affine
        )
        if plan.reads_depth:
            coverage = add_reversed_depth(plan.depth_format, camera, geometry, coverage, workers)
            if not plan.depth_format.is_standard:
                clock("reversed depth")
        return Seen(objects, coefficients, geometry, placement_of(arrays, views), coverage)

    def _compare(self, planned: Planned, clock: StageClock) -> motion.Motion | None:
        """Return what it takes to compare a frame with its earlier view; ``None`` without one."""
        if planned.earlier is None:
            return None
        moments = [
            motion.moment_of(one.prepared.shapes.arrays, one.views, one.plan.camera, self.size)
            for one in (planned, planned.earlier)
        ]
        sighting = None
        if "motion_visible" in planned.plan.outputs:
            plan, prepared, views, _ = planned.earlier
            seen = self._find_faces(plan, prepared, clock, views)
            sighting = motion.Sighting(seen.coverage.face_id, seen.objects.culled_turns)
        return motion.Motion(*moments, sighting)

    def _draw(self, planned: Planned, clock: StageClock, accumulation: Accumulation) -> Frame:
        """Run all stages of a frame."""
        plan, prepared, views, _ = planned
        workers = self._workers
        workers.memory.next_frame()
        seen = self._find_faces(plan, prepared, clock, views)
        objects, coefficients, geometry, placement, coverage = seen
        find = functools.partial(self._find_faces, prepared=prepared, clock=clock)
        if plan.pictures == 1:
            result = passes.shade_faces(plan, prepared, geometry, placement, coverage, workers)
        else:
            result = supersampling.shade_faces(
                plan, prepared, seen, accumulation, find, clock, workers
            )
        clock("shade, resolve")
        if plan.outline is not None:
            passes.draw_outline(plan, geometry, placement, coverage, result, workers)
            clock("outline")
        if plan.wireframe is not None:
            edges = prepared.shapes.edges
            passes.draw_wireframe(plan, edges, geometry, coefficients, coverage, result, workers)
            clock("wireframe")
        if "coverage" in plan.outputs:
            result["coverage"] = supersampling.cover_pixels(
                plan, prepared, seen, accumulation, find, workers
            )
            clock("coverage")
        ground_truth.fill_buffers(
            plan, prepared, geometry, placement, coverage, self._compare(planned, clock), result,
            workers,
        )  # fmt: skip
        clock("buffers")
        diagnostics = None
        if plan.diagnose:
            diagnostics = diagnosing.diagnose(
                coverage, objects, geometry, plan.camera, workers, plan.depth_format
            )
            clock("diagnostics")
        stats = stats_of(coverage, clock.seconds)
        if "face_id" in plan.outputs:
            # The caller may write to it.
            _ = stats.pixels_covered
        return Frame({name: result[name] for name in plan.outputs}, plan, stats, diagnostics)

    def _find_visible(self, *arguments: Any, **options: Any) -> stages.Coverage:
        """Run the stages from transform to visibility."""
        return stages.find_visible(*arguments, **options)

    def _scene(self, what: Any) -> Scene:
        """Return anything that can be drawn as a scene, that of the last frame for a mesh again."""
        if not isinstance(what, Mesh):
            return as_scene(what)
        if self._lone is None or self._lone[0] is not what:
            self._lone = what, as_scene(what)
        return self._lone[1]


def placement_of(arrays: SceneArrays, views: Views) -> Placement:
    """Return the record of where the objects stand."""
    return Placement(
        arrays.face_starts,
        arrays.positions,
        np.ascontiguousarray(views.relative_from_model[:, :3, :]),
        views.normal_matrices,
        views.mirrored,
        -views.screen_turn * views.mirrored,
        views.toward_viewer,
    )


def stats_of(coverage: stages.Coverage, seconds: dict[str, float]) -> Stats:
    """Return the frame's statistics."""
    totals = coverage.totals
    return Stats(
        triangles_in=totals.faces_in,
        outside=totals.outside,
        culled=totals.culled,
        degenerate=totals.degenerate,
        unsampled=totals.unsampled,
        invalid=totals.invalid,
        drawn=totals.drawn,
        clipped=totals.clipped,
        seconds=seconds,
        face_id=coverage.face_id,
    )
