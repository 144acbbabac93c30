"""
Render a frame from a scene and a camera: the stages in order.

The way of a frame: `render` checks the arguments, `Renderer._plan_and_draw` plans the frame
(``planning.plan_frame``), and `draw_frame` draws it: `find_visible`, then shading, overlays and the
other outputs. The stages themselves are in ``pipeline``, the effects in ``effects``.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import diagnostics as diagnosing
from rasterjit.outputs import ground_truth, motion
from rasterjit.outputs.frame import Frame, FrameStats, select_outputs
from rasterjit.outputs.ground_truth import add_reversed_depth
from rasterjit.outputs.output_table import Outputs
from rasterjit.pipeline.fragments.fragment_bands import make_sampled_viewport
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.primitive_expansion import collect_primitives
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import (
    frame_shading,
    planning,
    quality_selection,
    supersample,
    view_warnings,
)
from rasterjit.rendering import lens as lenses
from rasterjit.rendering.planning import (
    Cull,
    FrameRequest,
    PlannedFrame,
    check_request,
    plan_frame,
)
from rasterjit.rendering.recorded_frames import RecordedFrames, assemble_frame, is_small
from rasterjit.rendering.supersample import Accumulation
from rasterjit.runtime.background_compile import compile_in_background
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import FrameCache, Workers
from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.lens import Lens
from rasterjit.scene.previous_view import PreviousView
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.survey import object_transforms
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.effect import FrameContext
from rasterjit.survey.object_transforms import ViewTransforms
from rasterjit.survey.packed_scene import SceneArrays, compute_front_windings, make_placement
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.view_summary import CameraView

MAX_CACHED_ELEMENTS = visibility_pass.VERTICES_PER_TASK
"""Most faces, and vertices, of a scene whose buffers are cached for the next frame: for larger ones
allocation costs little beside drawing, and the memory is better used otherwise."""


def render(
    what: Any,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    max_error: float | None = None,
    time_budget: float | None = None,
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
    diagnose: bool = False,
    previous: PreviousView | None = None,
    lens: Lens | None = None,
    threads: int | None = None,
) -> Frame:
    """
    Render one frame.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
    camera : Camera, optional
        Default: the scene's own camera, else one that fits the scene.
    size : (int, int)
        Width and height, pixels, each in 1..16384.
    quality : Quality, optional
        Default ``Quality.standard()``.
    max_error : float, optional
        In place of a quality: the fastest is chosen whose picture is that near to the one of
        ``Quality.reference()``, as the root mean square difference in linear light (and of alpha,
        before a background that is seen through). To find out, faster qualities and 4 to 256
        pictures of the reference are drawn first: the call takes as long as 5 to 70 standard frames
        where at most 8 samples do, and up to twice as long as the reference else.
    time_budget : float, optional
        In place of a quality: the most accurate one is chosen that is drawn in so many seconds,
        compiling apart; nine of ten frames keep to it, and not the first two after the machine has
        become slower. Where it is not known what a scene takes, frames of it are drawn to find out;
        ``Frame.choice`` tells what was expected and what came of it. If even the fastest quality
        takes longer, that is drawn.
    outputs : sequence of str
        Any of color, linear, depth, distance, face_id, object_id, instance_id, material_id,
        barycentric, uv, normal, geometric_normal, normal_camera, position, position_camera,
        object_position, nocs, coverage, motion, motion_visible and ``attribute:NAME`` of an
        attribute of meshes: see `Frame`. All but color, linear and coverage are those of the
        nearest face at the pixel's centre.
    background : color, path or array_like, optional
        ``"white"``, ``"#rrggbb"``, ``"transparent"``, or linear floats: see `types.ColorLike`. Or
        a picture of this size, which is seen where no face is, and through what is see-through, in
        colour and linear alone: a file's name (a path, or a string with a dot or slash), or (H, W,
        3) or (H, W, 4): ``uint8`` sRGB, red first (OpenCV's are blue first), or floats in 0..1,
        linear. Tone curves do not touch it. Default: the scene's environment, if it is a
        background; else white.
    cull : {"none", "back", "front"}
        Faces that are dropped. Counter-clockwise is the front.
    diagnose : bool
        Whether to count what became of every face; see ``Frame.diagnostics``.
    previous : PreviousView, optional
        How things were before, for the outputs motion and motion_visible, which need it.
    lens : PinholeDistortion, FisheyeLens or Equirectangular, optional
        Distorts the picture of a perspective camera, or makes a panorama of it. Pinhole pictures
        with at least 2 samples along each pixel are drawn first, one or some faces of a cube:
        ``explain`` tells which. Of them color, linear and coverage are filtered in linear light
        over all of the pixel; every other output is that of the sample nearest to the pixel's
        centre, at most 0.36 of a pixel away. Depth stays along the viewing axis; where the lens
        sees 90 degrees from it, as a panorama does, it is refused: ask for distance. Outlines,
        wireframes, diagnose and motion_visible are refused, too, and ambient occlusion where there
        are several pictures. Shadow maps are fitted to each of them.
    threads : int, optional
        Default: all processors. The frame has the same bits for any number. With 1, no second
        process compiles what is missing.

    Returns
    -------
    Frame

    Raises
    ------
    ValueError
        Naming the argument that is wrong, before anything is drawn.
    """
    for name, value in (("max_error", max_error), ("time_budget", time_budget)):
        if value is not None and quality is not None:
            raise ValueError(f"quality must be None where {name} is given, got {quality!r}")
    with Renderer(size, quality=quality, threads=threads) as renderer:
        # Only to an error bound, more frames follow.
        renderer._frame_cache.is_enabled = max_error is not None
        request = renderer._check_request(outputs, background, cull, diagnose, previous)
        if time_budget is not None and max_error is None and lens is None:
            frame = renderer._render_to_time_budget(
                time_budget, what, camera, request, is_lone=True
            )
        else:
            frame = renderer._render_request(max_error, time_budget, what, camera, request, lens)
    view_warnings.warn(view_warnings.warnings_of_frame(frame), set())
    return frame


def explain(
    what: Any,
    camera: Camera | None = None,
    quality: Quality | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
    diagnose: bool = False,
    previous: PreviousView | None = None,
    lens: Lens | None = None,
) -> RenderPlan:
    """
    Say what a render of these arguments would do, without doing it.

    Takes the arguments of `render`; the plan prints as a table. That begins with what the camera
    sees: where it looks, which axis of the world is up in the picture, and which share of the
    surfaces is in view, on how many pixels. Poses and angles in another program's convention look
    strange there; ``docs/guides/cameras.md`` shows how.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size, scene = check.image_size("size", size), pose_input(what)
    request = check_request(size, quality, outputs, background, cull, diagnose, previous)
    if lens is not None:
        planned = lenses.plan_with_lens(lens, request, scene, camera, Workers(1))
        plan, through = planned.plan, lenses.through_lens(planned)
        view = CameraView(tuple(scene.nodes), plan.camera, plan.size, through)
        return plan.for_picture(view=view)
    plan = plan_frame(request, scene, camera).plan
    return plan.for_picture(view=CameraView(tuple(scene.nodes), plan.camera, plan.size))


def draw_frame(
    planned: PlannedFrame,
    workers: Workers,
    accumulation: Accumulation | None = None,
    clock: StageClock | None = None,
    on_picture: Callable[[], None] | None = None,
    frame_cache: FrameCache | None = None,
    needs_seen: bool = True,
    **options: bool,
) -> tuple[Frame, RasterizedView]:
    """
    Draw a frame: all its stages, in order.

    Parameters
    ----------
    planned : PlannedFrame
    workers : Workers
    accumulation : Accumulation, optional
        The sum of the pictures drawn so far for this frame; those that are missing are added.
    clock : StageClock, optional
        Started when planning began.
    on_picture : callable, optional
        Called before the faces of each picture are found; what it raises ends the frame.
    frame_cache : FrameCache, optional
        With it, ``seen`` holds cached arrays, valid until the next frame.
    needs_seen : bool
        Whether the caller reads ``seen``; else colours may overwrite its faces.
    **options
        Fields of ``plan.visibility`` to replace: see `find_visible`.

    Returns
    -------
    frame : Frame
    seen : Seen
        The visible face at the centre of each pixel, with the geometry.
    """
    plan, cache, views = planned[:3]
    clock, accumulation = clock or StageClock(), accumulation or Accumulation()
    arrays = cache.shapes.arrays
    if (
        frame_cache is not None
        and max(len(arrays.faces), len(arrays.positions)) > MAX_CACHED_ELEMENTS
    ):
        frame_cache.clear()
        frame_cache = None

    def find(
        picture: RenderPlan, views: ViewTransforms | None = None, **options: Any
    ) -> RasterizedView:
        if on_picture is not None:
            on_picture()
        return find_visible(picture, cache, workers, clock, views, **options)

    with (
        workers.frame(),
        compile_in_background(partial(planning.list_compile_tasks, plan), workers.threads),
    ):
        # Find the visible face of each pixel.
        shared = None if needs_seen else frame_shading.allocate_shared_pixels(plan, workers)
        if plan.facts.finds_faces and not (needs_seen or plan.needs_centers):
            options |= {"draws": False, "depth": False}
        seen = find(plan, views, frame_cache=frame_cache, face_id=shared, **options)
        if seen.coverage.covered is None:
            # The statistics count covered pixels later.
            shared = None
        if plan.takes_first_depth:
            first_depth = workers.memory.empty(seen.coverage.face_id.shape, plan.depth_format.kind)
            seen = seen._replace(coverage=seen.coverage._replace(first_depth=first_depth))
        context = FrameContext(plan, cache, seen.placement, workers, seen)
        lit = view_warnings.lit_pixels(plan.facts, cache, seen.coverage.face_id)
        # Shade it.
        if plan.pictures == 1:
            result = frame_shading.shade_faces(
                frame_shading.with_opaque_pass(context, find), frame_cache, shared
            )
        else:
            result = supersample.shade_faces(context, accumulation, find, clock)
        share = 0.0 if lit is None else view_warnings.white_share(lit, result["color"])
        clock("shade, resolve")
        # Draw overlays.
        for overlay in plan.effects_at("overlay"):
            overlay.effect.places["overlay"](overlay.data, context, result["color"])
            clock(overlay.name)
        # Fill the other outputs.
        if "coverage" in plan.outputs:
            result["coverage"] = supersample.measure_coverage(context, accumulation, find)
            clock("coverage")
        ground_truth.fill_buffers(
            plan, cache, seen.geometry, seen.placement, seen.coverage,
            prepare_motion(planned, workers, clock), result, workers,
        )  # fmt: skip
        clock("buffers")
        diagnostics = None
        if plan.facts.diagnose:
            diagnostics = diagnosing.diagnose(
                seen.coverage, seen.objects, seen.geometry, plan.camera, workers, plan.depth_format
            )
            clock("diagnostics")
        # Assemble the frame.
        stats = count_stats(
            seen.coverage, clock.seconds, None if shared is None else seen.coverage.covered
        )
        if "face_id" in plan.outputs:
            # The caller may write to it.
            _ = stats.pixels_covered
        if missing := [name for name in plan.outputs if name not in result]:
            raise RuntimeError(f"nothing fills the outputs {missing}: see outputs/ground_truth.py")
        outputs = {name: result[name] for name in plan.outputs}
        frame = Frame(outputs, plan, stats, diagnostics, cache.face_starts)
        frame._white_share = share
        return frame, seen


def find_visible(
    plan: RenderPlan,
    cache: SceneCache,
    workers: Workers,
    clock: Callable[[str], None],
    views: ViewTransforms | None = None,
    frame_cache: FrameCache | None = None,
    face_id: NDArray[np.int32] | None = None,
    **changes: Any,
) -> RasterizedView:
    """
    Find the face at every pixel: transform, clip, set up, bin, draw.

    Parameters
    ----------
    plan : RenderPlan
    cache : SceneCache
    workers : Workers
    clock : callable
        Called with a stage's name when it ends.
    views : Views, optional
        The transforms for the plan's camera, if known.
    frame_cache : FrameCache, optional
        With it, all returned arrays but depth and faces are cached ones.
    face_id : (H, W) int32, optional
        Receives the visible faces.
    **changes
        Fields of ``plan.visibility`` to replace.
    """
    camera, arrays = plan.camera, cache.shapes.arrays
    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    if views is None:
        views = object_transforms.transform_to_view(cache.transforms, camera, plan.size)
    # Prepare the viewport and face culling.
    spacing = supersample.sample_spacing_of_camera(camera)
    viewport = frame_cache.get_or_make(
        "viewport", visibility_pass.make_viewport, plan.size, plan.quality.subpixel_bits,
        plan.region,
        spacing,
    )  # fmt: skip
    objects = frame_cache.get_or_make(
        "objects", object_transforms.cull_objects, plan.cull, views.screen_winding, views.mirrored,
        arrays.face_starts, cache.tables.is_single_sided, arrays.primitive_numbers,
    )  # fmt: skip
    clock("plan")
    # Collect vertices, faces, lines and points.
    vertices = visibility_pass.ModelVertices(
        cache.shapes.positions(plan.quality.precision), arrays.vertex_starts,
        views.relative_from_model, views.clip_from_relative, arrays.unused,
    )  # fmt: skip
    options = plan.visibility._replace(**changes)
    if plan.layers is not None and not options.draws:
        options = options._replace(
            sample_radius=make_sampled_viewport(viewport, plan.layers.samples).sample_radius
        )
    drawable = visibility_pass.Drawable(
        vertices, arrays.faces, objects, plan.depth_format.coefficients, viewport,
        alpha_tests=frame_shading.find_hit_tests(plan, cache),
        primitives=collect_primitives(
            arrays.primitives, views.relative_from_model, vertices.positions,
            views.clip_from_relative, plan.size,
            supersample.pixels_per_output_pixel(camera),
        ),
        hidden=_hidden_faces(plan, arrays), is_affine=plan.is_affine,
    )  # fmt: skip
    # Run visibility, then derive what shading and outputs read.
    coverage = visibility_pass.run_visibility(
        drawable, options, workers, clock, frame_cache=frame_cache, face_id=face_id
    )
    geometry = frame_cache.get_or_make(
        "geometry", visibility_pass.make_geometry, arrays.faces, coverage.screen,
        coverage.clip_positions, viewport, plan.is_affine,
    )  # fmt: skip
    placement = _place_objects(arrays, views, frame_cache)
    if plan.reads_depth:
        coverage = add_reversed_depth(
            plan.depth_format, camera, geometry, coverage, workers, placement
        )
        if not plan.depth_format.is_standard:
            clock("reversed depth")
    return RasterizedView(objects, camera.depth_coefficients(), geometry, placement, coverage)


def _hidden_faces(plan: RenderPlan, arrays: SceneArrays) -> list[tuple[int, int]]:
    """Return the ranges (first, stop) of faces that a picture leaves out, ascending."""
    if plan.hidden is None:
        return []
    starts = arrays.face_starts.tolist()
    return [(starts[n], starts[n + 1]) for n in np.flatnonzero(plan.hidden).tolist()]


def _place_objects(
    arrays: SceneArrays, views: ViewTransforms, frame_cache: FrameCache
) -> Placement:
    """Return the objects' placement, in cached arrays if the cache is enabled."""
    if not frame_cache.is_enabled:
        return make_placement(arrays, views)
    front_windings = frame_cache.get_or_make(
        "windings", compute_front_windings, views.screen_winding, views.mirrored
    )
    return frame_cache.get_or_make(
        "placement", Placement, arrays.face_starts, arrays.positions,
        frame_cache.copy_into("relative_from_model", views.relative_from_model[:, :3, :]),
        frame_cache.copy_into("normal_matrices", views.normal_matrices),
        frame_cache.copy_into("mirrored", views.mirrored),
        frame_cache.copy_into("front_windings", front_windings),
        frame_cache.copy_into("toward_viewer", views.toward_viewer),
    )  # fmt: skip


def prepare_motion(
    planned: PlannedFrame, workers: Workers, clock: Callable[[str], None]
) -> motion.MomentPair | None:
    """Return the inputs of motion between a frame and its previous view; ``None`` without one."""
    if planned.previous is None:
        return None
    now = planned.cache.shapes
    after, before = (
        motion.make_moment(each.cache.shapes, now, each.views, each.plan.camera, each.plan.size)
        for each in (planned, planned.previous)
    )
    previous_faces = None
    if "motion_visible" in planned.plan.outputs:
        plan, cache, views = planned.previous[:3]
        seen = find_visible(plan, cache, workers, clock, views)
        previous_faces = motion.PreviousFaces(seen.coverage.face_id, seen.objects.culled_windings)
    return motion.MomentPair(after, before, previous_faces)


def count_stats(
    coverage: visibility_pass.Coverage, seconds: dict[str, float], covered: int | None = None
) -> FrameStats:
    """Return the frame's statistics; ``covered`` pixels are counted when first read if None."""
    totals = coverage.totals
    return FrameStats(
        triangles_in=totals.faces_in,
        outside=totals.outside,
        culled=totals.culled,
        degenerate=totals.degenerate,
        unsampled=totals.unsampled,
        invalid=totals.invalid,
        drawn=totals.drawn,
        clipped=totals.clipped,
        seconds=seconds,
        face_id=coverage.face_id if covered is None else covered,
    )


def _callable_or_none(name: str, value: Any) -> Any:
    """Return a callable or ``None``; raise ``ValueError`` for anything else."""
    if value is not None and not callable(value):
        raise ValueError(f"{name} must be a function or None, got {check.brief(value)}")
    return value


def _set_or_none(name: str, value: Any) -> set[str] | None:
    """Return a set, not copied, or ``None``; raise ``ValueError`` for anything else."""
    if value is not None and not isinstance(value, set):
        raise ValueError(f"{name} must be a set or None, got {check.brief(value)}")
    return value


def _make_renderer(
    kind: type[Renderer], size: tuple[int, int], quality: Quality, threads: int | None
) -> Renderer:
    """Create a renderer, when one is unpickled."""
    return kind(size, quality=quality, threads=threads)


class Renderer(Guarded):
    """
    Renders frames of one size; keeps threads, and caches what frames have in common.

    Meshes, materials, transforms, lights and cameras may change from one frame to the next.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels, each in 1..16384.
    quality : Quality, optional
        Default ``Quality.standard()``.
    threads : int, optional
        Default: all processors this process may run on (of Macs, the fast ones). With 1, no second
        process compiles what is missing.

    Attributes
    ----------
    on_picture : callable or None
        Called before each of the pictures that a frame is made of; what it raises ends the frame.
    warned : set of str or None
        What `ViewWarning` has warned of, of each kind once; ``None`` -> it never does.

    Raises
    ------
    ValueError
        If a size, a quality or a number of threads is wrong, or what an attribute is assigned.
    AttributeError
        If an attribute is assigned that there is not.
    """

    _FIELDS = ("size", "quality", "on_picture", "warned")
    _CHECKS = MappingProxyType({
        "size": check.image_size,
        "quality": lambda _, value: check_quality(value),
        "on_picture": _callable_or_none,
        "warned": _set_or_none,
    })  # fmt: skip

    on_picture: Callable[[], None] | None = None
    warned: set[str] | None
    _scene_cache: SceneCache | None = None
    _last_plan: RenderPlan | None = None
    _last_lens_plan: lenses.LensPlan | None = None
    _is_timed = False

    def __init__(
        self, size: tuple[int, int], *, quality: Quality | None = None, threads: int | None = None
    ) -> None:
        self.size = size
        self.quality = check_quality(quality)
        self._threads = threads
        self._workers = Workers(check.thread_count("threads", threads))
        self._frame_cache = FrameCache(self._workers.memory)
        self._frame_cache_lock = threading.Lock()
        self._recorded_frames = RecordedFrames()
        self.warned = set()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle a renderer by its settings, without its caches."""
        warned = None if self.warned is None else set(self.warned)
        state = {"on_picture": self.on_picture, "warned": warned, "_is_timed": self._is_timed}
        return _make_renderer, (type(self), self.size, self.quality, self._threads), state

    def __repr__(self) -> str:
        width, height = self.size
        return f"Renderer({width} x {height}, {self.quality}, {self._workers.threads} threads)"

    @classmethod
    def timed(
        cls, size: tuple[int, int], quality: Quality, threads: int | None,
        cache: SceneCache | None = None,
    ) -> Renderer:  # fmt: skip
        """
        Return a renderer that draws each frame step by step, without recorded calls.

        For timing each stage; or for a pool, where recorded calls would take memory once per
        renderer.
        """
        renderer = cls(size, quality=quality, threads=threads)
        renderer._is_timed, renderer._scene_cache = True, cache
        return renderer

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def cached_bytes(self) -> int:
        """Memory of recorded calls and of cached arrays, about."""
        return self._recorded_frames.bytes + self._workers.memory.bytes

    def close(self) -> None:
        """Stop the threads and clear the caches; a later render starts the threads again."""
        self._workers.close()
        self._frame_cache.clear()
        self._recorded_frames.clear()

    def render(
        self,
        what: Any,
        camera: Camera | None = None,
        *,
        max_error: float | None = None,
        time_budget: float | None = None,
        outputs: Outputs = ("color",),
        background: Background = None,
        cull: Cull = "none",
        diagnose: bool = False,
        previous: PreviousView | None = None,
        lens: Lens | None = None,
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
            Naming the argument that is wrong, before anything is drawn.
        """
        request = self._check_request(outputs, background, cull, diagnose, previous)
        frame = self._render_request(max_error, time_budget, what, camera, request, lens)
        if self.warned is not None:
            view_warnings.warn(view_warnings.warnings_of_frame(frame), self.warned)
        return frame

    def _check_request(self, *arguments: Any) -> FrameRequest:
        """Check the arguments of a frame of this size and quality, and return them."""
        return check_request(self.size, self.quality, *arguments)

    def _render_request(
        self,
        max_error: float | None,
        time_budget: float | None,
        what: Any,
        camera: Camera | None,
        request: FrameRequest,
        lens: Lens | None,
    ) -> Frame:
        """Render one frame: with a lens, or in the given quality or one chosen by error or time."""
        if lens is not None:
            for name, value in (("max_error", max_error), ("time_budget", time_budget)):
                if value is not None:
                    raise ValueError(f"{name} must be None where a lens is given, got {value!r}")
            return self._render_with_lens(lens, pose_input(what), camera, request)
        if max_error is not None:
            return self._render_to_error_bound(
                max_error, time_budget, pose_input(what), camera, request
            )
        if time_budget is not None:
            return self._render_to_time_budget(time_budget, what, camera, request)
        return self._plan_and_draw(request, pose_input(what), camera)

    def _plan_and_draw(self, request: FrameRequest, scene: Scene, camera: Camera | None) -> Frame:
        """Render one frame of a scene that `pose_input` returned."""
        clock = StageClock()
        planned = self._plan(request, scene, camera)
        frame = self._replay_recorded_calls(planned, clock)
        return frame or self._draw_step_by_step(planned, clock=clock)

    def _render_with_lens(
        self, lens: Lens, scene: Scene, camera: Camera | None, request: FrameRequest
    ) -> Frame:
        """Render one frame with a lens."""
        planned = lenses.plan_with_lens(
            lens, request, scene, camera, self._workers, self._scene_cache, self._last_lens_plan
        )
        self._scene_cache, self._last_lens_plan = planned.pictures[-1].cache, planned

        def draw(picture: PlannedFrame, clock: StageClock) -> tuple[Frame, RasterizedView]:
            return draw_frame(picture, self._workers, None, clock, self.on_picture)

        return lenses.draw_with_lens(planned, self._workers, draw)

    def _render_to_time_budget(
        self,
        time_budget: float,
        what: Any,
        camera: Camera | None,
        request: FrameRequest,
        is_lone: bool = False,
    ) -> Frame:
        """Render one frame in the best quality within a time; ``is_lone``: without any cache."""
        budget = check.positive_number("time_budget", time_budget)
        scene = pose_input(what)
        circumstances = (
            self.size, self._workers.threads, request.outputs, request.cull, request.diagnose,
            is_lone,
        )  # fmt: skip

        def draw(quality: Quality) -> Frame:
            candidate = request._replace(quality=quality)
            if not is_lone:
                return self._plan_and_draw(candidate, scene, camera)
            with Renderer(self.size, threads=self._workers.threads) as renderer:
                return renderer._plan_and_draw(candidate, scene, camera)

        times = quality_selection.get_frame_times(what, circumstances)
        return quality_selection.draw_within_time(budget, times, draw)

    def _render_to_error_bound(
        self,
        max_error: float,
        time_budget: float | None,
        scene: Scene,
        camera: Camera | None,
        request: FrameRequest,
    ) -> Frame:
        """Render one frame in the fastest quality within an error bound."""
        max_error = check.positive_number("max_error", max_error)
        if time_budget is not None:
            raise ValueError(
                f"time_budget must be None where max_error is given, got {time_budget!r}"
            )
        requested = request.outputs
        request = request._replace(
            outputs=tuple(dict.fromkeys((*requested, *quality_selection.COMPARED_OUTPUTS)))
        )
        refined = self._refine(request, scene, camera, ())
        drawn: list[Frame] = []

        def draw(quality: Quality) -> Frame:
            drawn[:] = [self._plan_and_draw(request._replace(quality=quality), scene, camera)]
            return drawn[0]

        def sweep() -> Iterator[Frame]:
            picture = request._replace(
                quality=replace(Quality.reference(), samples=1),
                outputs=quality_selection.COMPARED_OUTPUTS, diagnose=False, previous=None,
            )  # fmt: skip
            for is_turned in (False, True):
                swept = supersample.SweptCamera(drawn[0].plan.camera, (0.0, 0.0), 1.0, is_turned)
                yield self._plan_and_draw(picture, scene, swept)

        frame = quality_selection.draw_within_error(max_error, draw, refined, sweep)
        return select_outputs(frame, requested)

    def refine(
        self,
        what: Any,
        camera: Camera | None = None,
        *,
        outputs: Outputs = ("color",),
        background: Background = None,
        cull: Cull = "none",
        diagnose: bool = False,
        previous: PreviousView | None = None,
        first: Sequence[Quality] = (Quality.draft(), Quality.standard()),
    ) -> Iterator[Frame]:
        """
        Render one frame again and again, each time more accurately.

        Takes what `rasterjit.render` takes, whatever the quality of this renderer. The scene must
        stay as it is while frames are taken; other frames may be rendered in between.

        Parameters
        ----------
        first : sequence of Quality
            What is drawn before the pictures of the reference.

        Yields
        ------
        Frame
            One of each quality in ``first``, and then the mean of the first 4, 16, 64 and at last
            all 256 pictures of ``Quality.reference()``: the bits that ``render`` gives.
            ``frame.plan.quality`` and ``frame.plan.pictures`` say which it is. No picture is drawn
            twice.

        Raises
        ------
        ValueError
            At once, naming the argument that is wrong.
        """
        qualities = [
            check_quality(each, "each of first") for each in check.sequence("first", first)
        ]
        request = self._check_request(outputs, background, cull, diagnose, previous)
        return self._refine(request, pose_input(what), camera, qualities)

    def _refine(
        self, request: FrameRequest, scene: Scene, camera: Camera | None, first: Sequence[Quality]
    ) -> Iterator[Frame]:
        """Render one frame in some qualities, and then as the reference, step by step."""
        *previews, reference = [
            self._plan(request._replace(quality=quality), scene, camera)
            for quality in (*first, Quality.reference())
        ]
        steps = [
            reference._replace(plan=plan) for plan in supersample.split_into_steps(reference.plan)
        ]
        return self._draw_progressively([*previews, *steps])

    def _draw_progressively(self, frames: Sequence[PlannedFrame]) -> Iterator[Frame]:
        """Draw frames one after the other, each from the pictures of those before it."""
        accumulation = Accumulation()
        for planned in frames:
            yield self._draw_step_by_step(planned, accumulation)

    def _replay_recorded_calls(self, planned: PlannedFrame, clock: StageClock) -> Frame | None:
        """Draw a frame by recorded calls; None: it must be drawn step by step."""
        is_observed = self._is_timed or self.on_picture is not None
        if is_observed or not is_small(planned):
            self._recorded_frames.clear()
            return None
        if not self._frame_cache_lock.acquire(blocking=False):
            return None
        try:
            drawn = self._recorded_frames.draw(planned, self._workers.memory)
        finally:
            self._frame_cache_lock.release()
        if drawn is None:
            return None
        clock("all stages")
        return assemble_frame(planned, *drawn, clock.seconds)

    def _draw_step_by_step(self, planned: PlannedFrame, *arguments: Any, **options: Any) -> Frame:
        """Draw a frame, stage by stage."""
        options |= {"on_picture": self.on_picture, "needs_seen": False}
        # Of concurrent frames, only one uses the cache.
        if not self._frame_cache_lock.acquire(blocking=False):
            return draw_frame(planned, self._workers, *arguments, **options)[0]
        options["frame_cache"] = self._frame_cache
        try:
            return draw_frame(planned, self._workers, *arguments, **options)[0]
        except BaseException:
            # A thread may still write to cached arrays.
            self._frame_cache.clear()
            raise
        finally:
            self._frame_cache_lock.release()

    def _plan(self, request: FrameRequest, scene: Scene, camera: Camera | None) -> PlannedFrame:
        """Decide what a frame needs, reusing what still holds of the last frame."""
        planned = plan_frame(request, scene, camera, self._scene_cache, self._last_plan)
        self._scene_cache, self._last_plan = planned.cache, planned.plan
        return planned
