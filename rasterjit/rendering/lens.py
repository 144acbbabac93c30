"""
Render with a lens (distortion, fisheye ...): draw pinhole pictures, then resample them.

Filtered outputs (`Output.is_mixed`) are averaged over the pixel's footprint, linear and
premultiplied; the others are taken from the sample nearest to its centre, at most half the diagonal
of a sample away, 0.36 of a pixel, and mostly less than a quarter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import motion, output_table
from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.motion import Moment
from rasterjit.outputs.output_table import MIXED_OUTPUTS
from rasterjit.pipeline import resampling, srgb_encoding
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import planning, view_warnings
from rasterjit.rendering.lens_views import (
    NOWHERE,
    LensIntrinsics,
    LensViews,
    PinholePicture,
    find_lens_views,
    make_lens_intrinsics,
    make_picture_camera,
    world_axes,
)
from rasterjit.rendering.planning import FrameRequest, PlannedFrame
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import Workers, split_into_bands
from rasterjit.scene.background import Backdrop, BackgroundImage, read_background
from rasterjit.scene.camera import Camera, move_planes
from rasterjit.scene.color import decoding_table
from rasterjit.scene.lens import Equirectangular, Lens, check_lens
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import boolean
from rasterjit.survey import object_transforms
from rasterjit.survey.cache import SceneCache, update_cache
from rasterjit.survey.clip_planes import merge_needs
from rasterjit.survey.effect import (
    FrameContext,
    LensEffect,
    TracedEffect,
    UsedEffect,
    list_screen_effects,
)
from rasterjit.survey.object_transforms import ViewTransforms
from rasterjit.survey.packed_scene import make_placement
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.view_summary import LensProjection

Float64 = NDArray[np.float64]
Draw = Callable[[PlannedFrame, StageClock], tuple[Frame, RasterizedView]]

COUNTS = ("triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn",
          "clipped")  # fmt: skip

POINTS = ("now", "before")
"""Names of the arrays that motion is found from: current and previous points, in lens axes."""


class LensPlan(NamedTuple):
    """A planned frame with a lens."""

    lens: Lens
    camera: Camera
    size: tuple[int, int]
    outputs: tuple[str, ...]
    lens_views: LensViews
    intrinsics: LensIntrinsics
    pictures: tuple[PlannedFrame, ...]
    backdrop: Backdrop
    """The given background, or black: shown beyond the lens's field of view; an image also where no
    face is."""
    plan: RenderPlan
    """The plan of the first picture, with the size and the camera of the frame."""
    previous: tuple[Scene, Camera, LensIntrinsics] | None
    """The previous view, for motion."""


def plan_with_lens(
    lens: Any,
    request: FrameRequest,
    scene: Scene,
    camera: Camera | None,
    workers: Workers,
    cache: SceneCache | None = None,
    last: LensPlan | None = None,
) -> LensPlan:
    """
    Check the arguments of a frame with a lens, and plan the pinhole pictures that it takes.

    ``cache`` is that of the scene's last frame. ``last`` is the plan of any frame with a lens: its
    rays are reused if lens and projection are the same.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    _, quality, outputs, background, _, diagnose, previous = request
    lens, size = check_lens("lens", lens), request.size
    camera = planning.choose_camera(scene, camera, size)
    _check_supported(outputs, diagnose)
    intrinsics = make_lens_intrinsics(lens, camera, size)
    if (
        last is not None
        and (last.lens, last.size) == (lens, size)
        and last.intrinsics.has_same_projection(intrinsics)
    ):
        lens_views = last.lens_views
    else:
        lens_views = find_lens_views(lens, size, intrinsics, workers)
    if "depth" in outputs and lens_views.min_cosine <= 0.0:
        raise ValueError(
            "outputs has 'depth', which is along the viewing axis and above 0 less than 90 degrees "
            "from it alone, and lens sees more: ask for 'distance', which is along the ray"
        )
    drawn = tuple(name for name in outputs if name != "motion") or ("face_id",)
    backdrop = read_background("black" if background is None else background)
    if isinstance(backdrop, BackgroundImage):
        # The image is already distorted: it is added behind at the end.
        backdrop.check_size(size)
        background = "transparent"
    given_camera = camera
    if planning.has_open_plane(camera):
        # All pictures have the same near and far planes.
        seen = [
            planning.find_scene_plane_needs(
                scene,
                camera,
                picture.size,
                quality,
                None,
                make_picture_camera(picture, camera, size, intrinsics),
            )
            for picture in lens_views.pictures
        ]
        camera = move_planes(camera, *merge_needs(seen).steps)
    frames = []
    for picture in lens_views.pictures:
        picture_camera = make_picture_camera(picture, camera, size, intrinsics)
        picture_request = request._replace(size=picture.size, outputs=drawn, background=background)
        picture_request = picture_request._replace(diagnose=False, previous=None)
        frames.append(planning.plan_frame(picture_request, scene, picture_camera, cache))
        cache = frames[-1].cache
    _check_effects([frame.plan for frame in frames])
    pictures = [frame._replace(plan=_plan_without_overlays(frame.plan)) for frame in frames]
    text = f"{type(lens).__name__}: {lens_views.description}"
    pixels, eye = _pixels_of(lens, intrinsics, camera, size), camera.eye_position()
    effects = tuple(
        replace(planned, data=planned.effect.distort(planned.data, eye, pixels))
        if isinstance(planned, UsedEffect) and isinstance(planned.effect, LensEffect)
        else planned
        for planned in frames[0].plan.effects
    )
    plan = frames[0].plan.for_picture(
        outputs=outputs, size=size, camera=camera, lens=text, effects=effects
    )
    previous_view = planning.resolve_previous_view(previous, plan, scene, given_camera)
    previous_with_intrinsics = None
    if previous_view is not None:
        with planning.naming("previous.camera"):
            previous_scene = planning.cut_previous_scene(
                previous_view[0], planning.cut_by_section(scene)
            )
            previous_intrinsics = make_lens_intrinsics(lens, previous_view[1], size)
        previous_with_intrinsics = previous_scene, previous_view[1], previous_intrinsics
    return LensPlan(
        lens,
        camera,
        size,
        outputs,
        lens_views,
        intrinsics,
        tuple(pictures),
        backdrop,
        plan,
        previous_with_intrinsics,
    )


def through_lens(planned: LensPlan) -> LensProjection:
    """Return the projection of a frame's lens, for `CameraView`."""
    lens, intrinsics = planned.lens, planned.intrinsics
    axes = world_axes(planned.camera, planned.size)

    def directions(columns: Float64, rows: Float64) -> Float64:
        return _combine_axes(lens.unproject(intrinsics.to_lens_coordinates(columns, rows)), axes)

    plans = (picture.plan for picture in planned.pictures)
    clips = tuple(clip_from_relative(plan.camera, plan.size) for plan in plans)
    pixels = _pixels_of(lens, intrinsics, planned.camera, planned.size)
    return LensProjection(pixels, directions, clips)


def _pixels_of(
    lens: Lens, intrinsics: LensIntrinsics, camera: Camera, size: tuple[int, int]
) -> Callable[[Float64], Float64]:
    """Return a function from points relative to the eye, (N, 3), to pixels, (N, 2)."""
    axes = world_axes(camera, size)

    def pixels(points: Float64) -> Float64:
        return intrinsics.to_pixels(lens.project(_combine_axes(points, axes.T)))

    return pixels


def _combine_axes(shares: Float64, axes: Float64) -> Float64:
    """Return linear combinations, (..., 3), of three axes, summed in one order on every CPU."""
    x, y, z = (shares[..., n, np.newaxis] for n in range(3))
    return x * axes[0] + y * axes[1] + z * axes[2]


def draw_with_lens(planned: LensPlan, workers: Workers, draw: Draw) -> Frame:
    """
    Draw a frame with a lens.

    Parameters
    ----------
    planned : LensPlan
    workers : Workers
    draw : callable
        Draws a planned frame.
    """
    lens_views, outputs, clock = planned.lens_views, planned.outputs, StageClock()
    targets: dict[str, NDArray[Any]] = {}
    comparison = _make_comparison(planned)
    counts = dict.fromkeys(COUNTS, 0)
    traces: list[dict[str, list[Float64]]] = []
    for number, picture in enumerate(lens_views.pictures):
        planned_picture = planned.pictures[number]
        frame, seen = draw(planned_picture, clock)
        traces.append(_trace_overlays(planned, number, seen, workers))
        arrays = {**frame.arrays(), "face_id": seen.coverage.face_id}
        if "depth" in outputs:
            arrays["depth"] = _depth_along_axis(picture, arrays["depth"])
        if comparison is not None:
            arrays |= comparison.points(planned_picture, seen, workers)
        _resample(arrays, picture, lens_views, targets, workers)
        counts = {name: counts[name] + getattr(frame.stats, name) for name in COUNTS}
        clock("lens")
    if comparison is not None:
        targets["motion"] = comparison.motion(*(targets[name] for name in POINTS))
    backdrop = planned.backdrop
    result = {
        name: _finish_output(name, targets, lens_views, backdrop, workers) for name in outputs
    }
    planned_picture = planned.pictures[0]
    cut = planned_picture.cache.cut
    if "face_id" in outputs and cut is not None:
        # Numbers of the scene before a section cut it.
        result["face_id"] = cut.face_numbers[targets["face_id"]]
    placement = make_placement(planned_picture.cache.shapes.arrays, planned_picture.views)
    # Overlays that lenses support read only the faces.
    seen = seen._replace(coverage=seen.coverage._replace(face_id=targets["face_id"]))
    context = FrameContext(planned.plan, planned_picture.cache, placement, workers, seen)
    lit = view_warnings.lit_pixels(planned.plan.facts, planned_picture.cache, targets["face_id"])
    share = 0.0 if lit is None else view_warnings.white_share(lit, result["color"])
    for overlay in planned.plan.effects_at("overlay"):
        if isinstance(overlay.effect, TracedEffect):
            kinds = zip(*(trace[overlay.name] for trace in traces), strict=True)
            pieces = [np.concatenate(parts) for parts in kinds]
            overlay.effect.draw_traced(overlay.data, pieces, context, result["color"])
        else:
            overlay.effect.places["overlay"](overlay.data, context, result["color"])
    stats = FrameStats(**counts, seconds=clock.seconds, face_id=targets["face_id"])
    if "face_id" in outputs:
        # The caller may write to it.
        _ = stats.pixels_covered
    clock("lens")
    frame = Frame(result, planned.plan, stats, None, planned_picture.cache.face_starts)
    frame._white_share = share
    return frame


class Comparison(NamedTuple):
    """Inputs for motion between a frame and its previous view."""

    lens: Lens
    intrinsics: LensIntrinsics
    previous_intrinsics: LensIntrinsics
    previous: Moment
    object_to_lens: tuple[NDArray[np.float64], NDArray[np.float64]]
    """(O, 3, 4) each: from model space to the axes of the lens, current and previous."""

    def points(
        self, picture: PlannedFrame, seen: RasterizedView, workers: Workers
    ) -> dict[str, Any]:
        """Return the current and previous points of a picture's pixels, (h, w, 3), in lens axes."""
        arrays = picture.cache.shapes.arrays
        now = Moment(arrays.positions, arrays.faces, self.object_to_lens[0])
        previous_moment = self.previous._replace(matrices=self.object_to_lens[1])
        return {
            name: _find_points(moment, arrays.faces, seen, workers)
            for name, moment in zip(POINTS, (now, previous_moment), strict=True)
        }

    def motion(self, now: NDArray[np.float32], before: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the motion of points, (H, W, 3), across the picture, (H, W, 2), pixels."""
        moved = self.intrinsics.to_pixels(self.lens.project(now.astype(np.float64)))
        moved -= self.previous_intrinsics.to_pixels(self.lens.project(before.astype(np.float64)))
        if isinstance(self.lens, Equirectangular):
            # The shorter way around.
            width = len(now[0])
            moved[..., 0] -= width * np.floor(moved[..., 0] / width + 0.5)
        return moved.astype(np.float32)


def _check_supported(outputs: Sequence[str], diagnose: Any) -> None:
    """Raise ``ValueError`` naming an argument that is not supported with a lens."""
    if boolean("diagnose", diagnose):
        raise ValueError("diagnose must be False where a lens is given, got True")
    if "motion_visible" in outputs:
        raise ValueError("outputs has 'motion_visible', which is not found where a lens is given")


def _plan_without_overlays(plan: RenderPlan) -> RenderPlan:
    """Return a picture's plan: overlays are drawn over the finished one, some traced before."""
    traced = plan.for_picture(
        effects=tuple(
            replace(planned, effect=planned.effect.tracer)
            if isinstance(planned, UsedEffect) and isinstance(planned.effect, TracedEffect)
            else planned
            for planned in plan.effects
        )
    )
    return traced.for_picture(lambda used: "overlay" not in used.effect.places)


def _trace_overlays(
    planned: LensPlan, number: int, seen: RasterizedView, workers: Workers
) -> dict[str, list[Float64]]:
    """
    Trace the lines of overlays in a pinhole picture.

    Returns
    -------
    dict
        By the name of the overlay its lines where the lens takes this picture, pixels of the frame,
        (N, 2, 2) for each kind.
    """
    picture, views = planned.pictures[number], planned.lens_views
    context = FrameContext(picture.plan, picture.cache, seen.placement, workers, seen)
    pixels = _pixels_of(planned.lens, planned.intrinsics, planned.camera, planned.size)

    def bend(pieces: Float64) -> Float64:
        ends = pixels(pieces.reshape(-1, 3)).reshape(-1, 2, 2)
        ends = ends[np.isfinite(ends).all(axis=(1, 2))]
        column, row = np.floor((ends[:, 0] + ends[:, 1]) * 0.5).astype(np.int64).T
        width, height = planned.size
        is_inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        # A panorama's lines do not cross the whole picture where it closes.
        is_inside &= (np.abs(ends[:, 1] - ends[:, 0]) < 0.5 * width).all(axis=1)
        ends, column, row = ends[is_inside], column[is_inside], row[is_inside]
        return ends[views.picture_number[row, column] == views.pictures[number].number]

    return {
        overlay.name: [bend(pieces) for pieces in overlay.effect.trace(overlay.data, context)]
        for overlay in planned.plan.effects_at("overlay")
        if isinstance(overlay.effect, TracedEffect)
    }


def _check_effects(plans: Sequence[RenderPlan]) -> None:
    """Raise ``ValueError`` naming an effect that reads pixels of the finished picture."""
    for plan in plans:
        for effect, _ in list_screen_effects(plan.planned):
            if isinstance(effect, TracedEffect):
                continue
            looks_around = effect.scope == "neighbours"
            if "overlay" in effect.places and (looks_around or effect.reads_clip_positions):
                raise ValueError(
                    f"{effect.refusal()} where a lens is given: its lines are as wide as "
                    "pixels of the finished picture"
                )
            if looks_around and len(plans) > 1:
                raise ValueError(
                    f"{effect.refusal()} where lens sees so much that it takes "
                    f"{len(plans)} pictures: it looks at neighbouring pixels, which others hold"
                )


def _depth_along_axis(picture: PinholePicture, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert the depth of a picture, (h, w), to depth along the axis of the lens."""
    if picture.is_ahead:
        return depth
    height, width = depth.shape
    _, _, ahead = picture.directions(np.arange(width), np.arange(height)[:, np.newaxis])
    with np.errstate(invalid="ignore"):
        turned = (depth * ahead).astype(np.float32)
    return np.where(np.isinf(depth), depth, turned)


def _resample(
    arrays: dict[str, Any],
    picture: PinholePicture,
    lens_views: LensViews,
    targets: dict[str, NDArray[Any]],
    workers: Workers,
) -> None:
    """Resample a pinhole picture into the pixels whose rays it shows."""
    mixed = set(MIXED_OUTPUTS).intersection(arrays)
    sources = {name: _to_premultiplied(name, arrays[name]) for name in mixed}
    nearest = {name: array for name, array in arrays.items() if name not in sources}
    shape = lens_views.picture_number.shape
    for name, array in (sources | nearest).items():
        if name not in targets:
            empty = 0.0 if name in sources else _empty_value(name)
            targets[name] = np.full((*shape, *array.shape[2:]), empty, array.dtype)
    (width, height), (origin_x, origin_y) = picture.size, picture.origin
    picture_numbers = lens_views.picture_number
    window = picture.number, picture.density, origin_x, origin_y

    def resample_rows(first: int, last: int) -> None:
        for name, source in sources.items():
            resampling.filter_rows(
                source, picture_numbers, lens_views.position, lens_views.footprint, window,
                (first, last), targets[name],
            )  # fmt: skip
        is_here = picture_numbers[first:last] == picture.number
        x, y = (lens_views.position[first:last][is_here].astype(np.float64) * picture.density).T
        column = np.clip(np.floor(x + origin_x), 0, width - 1).astype(np.int64)
        row = np.clip(np.floor(y + origin_y), 0, height - 1).astype(np.int64)
        for taken, array in nearest.items():
            targets[taken][first:last][is_here] = array[row, column]

    workers.run(resample_rows, split_into_bands(picture_numbers.shape, workers))


def _empty_value(name: str) -> float:
    """Return the value of an unfiltered output where no face is."""
    return math.nan if name in POINTS else output_table.find_row(name).empty


def _to_premultiplied(name: str, array: NDArray[Any]) -> NDArray[np.float32]:
    """Return a filtered output as (h, w, C) float32; colours as linear light times alpha."""
    if array.ndim == 2:
        return np.ascontiguousarray(array, np.float32)[:, :, np.newaxis]
    light = _decode(array) if name == "color" else array.copy()
    if not (light[..., 3] == 1.0).all():
        light[..., :3] *= light[..., 3:]
    return light


def _decode(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Decode pixels, (h, w, 4), to linear light with straight alpha."""
    light = decoding_table()[codes]
    light[..., 3] = codes[..., 3] / np.float32(255.0)
    return light


def _finish_output(
    name: str,
    targets: dict[str, NDArray[Any]],
    lens_views: LensViews,
    backdrop: Backdrop,
    workers: Workers,
) -> NDArray[Any]:
    """Return an output in its final form; colours over the background."""
    target = targets[name]
    if name not in MIXED_OUTPUTS:
        return target
    if target.shape[2] == 1:
        return target[..., 0]
    alpha, is_nowhere = target[..., 3:], lens_views.picture_number == NOWHERE
    if isinstance(backdrop, BackgroundImage):
        image: NDArray[Any] = backdrop.image
        given = image if image.dtype == np.float32 else _decode(image)
        through = (1.0 - alpha) * given[..., 3:]
        target[..., :3] += through * given[..., :3]
        alpha += through
    np.divide(target[..., :3], alpha, out=target[..., :3], where=alpha > 0.0)
    if isinstance(backdrop, np.ndarray):
        target[is_nowhere] = backdrop
    if name != "color":
        return target
    color = np.empty(target.shape, np.uint8)
    packed, encoding = color.view(np.uint32)[:, :, 0], srgb_encoding.make_encoding_table()
    bands = [slice(*rows) for rows in split_into_bands(packed.shape, workers)]
    workers.run(
        srgb_encoding.encode_rows, [(target[band], encoding, packed[band]) for band in bands]
    )
    return color


def _make_comparison(planned: LensPlan) -> Comparison | None:
    """Return the inputs for motion from the previous view; ``None`` without one."""
    if planned.previous is None:
        return None
    scene, camera, previous_intrinsics = planned.previous
    cache, size = planned.pictures[0].cache, planned.size
    quality = planned.plan.quality
    old = update_cache(scene.nodes, cache, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, planned.camera, size)
    old_views = object_transforms.transform_to_view(old.transforms, camera, size)
    positions, faces = old.shapes.arrays.positions, old.shapes.rotate_like(cache.shapes)
    return Comparison(
        planned.lens, planned.intrinsics, previous_intrinsics,
        Moment(positions, faces, np.empty((0, 5, 4))),
        (
            _rotate_to_lens_axes(views, planned.camera, size),
            _rotate_to_lens_axes(old_views, camera, size),
        ),
    )  # fmt: skip


def _rotate_to_lens_axes(
    views: ViewTransforms, camera: Camera, size: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the transform of each object to the axes of the lens, (O, 3, 4)."""
    axes, model = world_axes(camera, size), views.relative_from_model
    found = np.zeros((len(model), 3, 4))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(3):
            found += axes[:, k, np.newaxis] * model[:, np.newaxis, k]
    return found


def _find_points(
    moment: Moment, faces: NDArray[np.int32], seen: RasterizedView, workers: Workers
) -> NDArray[np.float32]:
    """Return the points of a picture's pixels at a moment, (h, w, 3), by matrices (O, 3, 4)."""
    face_id, turned = seen.coverage.face_id, moment.matrices
    points = np.empty((*face_id.shape, 3), np.float32)
    # Motion is a difference of two screen positions, each divided by w. With all w = 1, and the
    # first position at the origin, it is the other position.
    flat = np.zeros((len(turned), 5, 4))
    flat[:, 3, 3] = 1.0
    for first, count in ((0, 2), (2, 1)):
        matrices = flat.copy()
        matrices[:, :count] = turned[:, first : first + count]
        inputs = motion.MomentPair(
            Moment(moment.positions, moment.faces, flat), moment._replace(matrices=matrices), None
        )
        moved = motion.fill_motion(
            face_id, seen.geometry, seen.placement.face_starts, inputs, workers
        )
        points[..., first : first + count] = -moved[..., :count]
    return points
