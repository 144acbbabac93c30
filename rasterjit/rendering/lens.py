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
from rasterjit.rendering import view_warnings
from rasterjit.rendering.lens_views import (
    NOWHERE,
    LensSight,
    LensViews,
    Picture,
    camera_of,
    look,
    see,
    world_axes,
)
from rasterjit.rendering.planning import (
    FrameRequest,
    PlannedFrame,
    choose_camera,
    cut_alike,
    cut_open,
    find_earlier,
    look_from,
    naming,
    needs_settling,
    plan_views,
)
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import Workers, rows_per_task
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
from rasterjit.survey.effect import FrameContext, LensEffect, UsedEffect, list_screen_effects
from rasterjit.survey.object_transforms import ViewTransforms
from rasterjit.survey.packed_scene import make_placement
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.view_summary import LensProjection

Float64 = NDArray[np.float64]
Draw = Callable[[PlannedFrame, StageClock], tuple[Frame, RasterizedView]]

COUNTS = ("triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn",
          "clipped")  # fmt: skip

POINTS = ("now", "before")
"""Names of what motion is found from: where a point is, and was, in the axes of the lens."""


class LensPlan(NamedTuple):
    """A planned frame with a lens."""

    lens: Lens
    camera: Camera
    size: tuple[int, int]
    outputs: tuple[str, ...]
    looks: LensViews
    sight: LensSight
    pictures: tuple[PlannedFrame, ...]
    behind: Backdrop
    """The background that was given, or black: shown beyond the lens's field of view; an image also
    where no face is."""
    plan: RenderPlan
    """That of the first picture, with the size and the camera of the frame."""
    compared: tuple[Scene, Camera, LensSight] | None
    """The earlier view that it is compared with."""


def plan_lensed(
    lens: Any,
    request: FrameRequest,
    scene: Scene,
    camera: Camera | None,
    workers: Workers,
    known: SceneCache | None = None,
    last: LensPlan | None = None,
) -> LensPlan:
    """
    Check the arguments of a frame with a lens, and decide which pictures it takes.

    ``known`` is what an earlier frame of the scene was drawn from, ``last`` an earlier frame with a
    lens: where its pixels look is not found again for the same camera elsewhere.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    _, quality, outputs, background, _, diagnose, previous = request
    lens, size = check_lens("lens", lens), request.size
    camera = choose_camera(scene, camera, size)
    _refuse(outputs, diagnose)
    sight = see(lens, camera, size)
    if last is not None and (last.lens, last.size) == (lens, size) and last.sight.same(sight):
        looks = last.looks
    else:
        looks = look(lens, size, sight, workers)
    if "depth" in outputs and looks.least_cosine <= 0.0:
        raise ValueError(
            "outputs has 'depth', which is along the viewing axis and above 0 less than 90 degrees "
            "from it alone, and lens sees more: ask for 'distance', which is along the ray"
        )
    drawn = tuple(name for name in outputs if name != "motion") or ("face_id",)
    behind = read_background("black" if background is None else background)
    if isinstance(behind, BackgroundImage):
        # It is what the lens has seen, and comes behind at the end.
        behind.check_size(size)
        background = "transparent"
    asked = camera
    if needs_settling(camera):
        # One camera has its planes in one place, in all pictures.
        seen = [
            look_from(
                scene, camera, picture.size, quality, None, camera_of(picture, camera, size, sight)
            )
            for picture in looks.pictures
        ]
        camera = move_planes(camera, *merge_needs(seen).steps)
    whole = []
    for picture in looks.pictures:
        seen_by = camera_of(picture, camera, size, sight)
        own = request._replace(size=picture.size, outputs=drawn, background=background)
        own = own._replace(diagnose=False, previous=None)
        one = plan_views(own, scene, seen_by, known)
        known = one.cache
        whole.append(one)
    _refuse_effects([one.plan for one in whole])
    # What is drawn over the finished picture waits for it.
    pictures = [
        one._replace(
            plan=one.plan.for_picture(lambda planned: "overlay" not in planned.effect.places)
        )
        for one in whole
    ]
    text = f"{type(lens).__name__}: {looks.described}"
    pixels, eye = _pixels_of(lens, sight, camera, size), camera.eye_position()
    effects = tuple(
        replace(one, data=one.effect.distort(one.data, eye, pixels))
        if isinstance(one, UsedEffect) and isinstance(one.effect, LensEffect)
        else one
        for one in whole[0].plan.effects
    )
    plan = whole[0].plan.for_picture(
        outputs=outputs, size=size, camera=camera, lens=text, effects=effects
    )
    earlier = find_earlier(previous, plan, scene, asked)
    compared = None
    if earlier is not None:
        with naming("previous.camera"):
            before = cut_alike(earlier[0], cut_open(scene))
            compared = before, earlier[1], see(lens, earlier[1], size)
    return LensPlan(
        lens, camera, size, outputs, looks, sight, tuple(pictures), behind, plan, compared
    )


def through_lens(planned: LensPlan) -> LensProjection:
    """Return the projection of a frame's lens, for `CameraView`."""
    lens, sight = planned.lens, planned.sight
    axes = world_axes(planned.camera, planned.size)

    def directions(columns: Float64, rows: Float64) -> Float64:
        return _mixed(lens.unproject(sight.places(columns, rows)), axes)

    pictures = (one.plan for one in planned.pictures)
    clips = tuple(clip_from_relative(plan.camera, plan.size) for plan in pictures)
    pixels = _pixels_of(lens, sight, planned.camera, planned.size)
    return LensProjection(pixels, directions, clips)


def _pixels_of(
    lens: Lens, sight: LensSight, camera: Camera, size: tuple[int, int]
) -> Callable[[Float64], Float64]:
    """Return what tells where points relative to the eye, (N, 3), are seen: pixels, (N, 2)."""
    axes = world_axes(camera, size)

    def pixels(points: Float64) -> Float64:
        return sight.pixels(lens.project(_mixed(points, axes.T)))

    return pixels


def _mixed(shares: Float64, axes: Float64) -> Float64:
    """Return sums of three axes, (3, 3), by shares (..., 3), in one order on every CPU."""
    x, y, z = (shares[..., n, np.newaxis] for n in range(3))
    return x * axes[0] + y * axes[1] + z * axes[2]


def draw_lensed(planned: LensPlan, workers: Workers, draw: Draw) -> Frame:
    """
    Draw a frame with a lens.

    Parameters
    ----------
    planned : LensPlan
    workers : Workers
    draw : callable
        Draws a frame that is decided on.
    """
    looks, outputs, clock = planned.looks, planned.outputs, StageClock()
    targets: dict[str, NDArray[Any]] = {}
    comparison = _compare(planned)
    counts = dict.fromkeys(COUNTS, 0)
    for picture, one in zip(looks.pictures, planned.pictures, strict=True):
        frame, seen = draw(one, clock)
        arrays = {**frame.arrays(), "face_id": seen.coverage.face_id}
        if "depth" in outputs:
            arrays["depth"] = _depth(picture, arrays["depth"])
        if comparison is not None:
            arrays |= comparison.points(one, seen, workers)
        _take(arrays, picture, looks, targets, workers)
        counts = {name: counts[name] + getattr(frame.stats, name) for name in COUNTS}
        clock("lens")
    if comparison is not None:
        targets["motion"] = comparison.motion(*(targets[name] for name in POINTS))
    behind = planned.behind
    result = {name: _finished(name, targets, looks, behind, workers) for name in outputs}
    one = planned.pictures[0]
    placement = make_placement(one.cache.shapes.arrays, one.views)
    # What draws over the finished picture of a lens reads the faces, no more.
    seen = seen._replace(coverage=seen.coverage._replace(face_id=targets["face_id"]))
    context = FrameContext(planned.plan, one.cache, placement, workers, seen)
    lit = view_warnings.lit_pixels(planned.plan.facts, one.cache, targets["face_id"])
    share = 0.0 if lit is None else view_warnings.white_share(lit, result["color"])
    for overlay in planned.plan.effects_at("overlay"):
        overlay.effect.places["overlay"](overlay.data, context, result["color"])
    stats = FrameStats(**counts, seconds=clock.seconds, face_id=targets["face_id"])
    if "face_id" in outputs:
        # The caller may write to it.
        _ = stats.pixels_covered
    clock("lens")
    frame = Frame(result, planned.plan, stats, None, one.cache.face_starts)
    frame._white_share = share
    return frame


class Comparison(NamedTuple):
    """Inputs for motion between a frame and an earlier view."""

    lens: Lens
    sight: LensSight
    sight_before: LensSight
    before: Moment
    turns: tuple[NDArray[np.float64], NDArray[np.float64]]
    """(O, 3, 4) each: objects in the axes of the lens, now and before."""

    def points(self, one: PlannedFrame, seen: RasterizedView, workers: Workers) -> dict[str, Any]:
        """Return where what a picture shows is, and was, (h, w, 3), in the axes of the lens."""
        arrays = one.cache.shapes.arrays
        now = Moment(arrays.positions, arrays.faces, self.turns[0])
        earlier = self.before._replace(matrices=self.turns[1])
        return {
            name: _points_of(moment, arrays.faces, seen, workers)
            for name, moment in zip(POINTS, (now, earlier), strict=True)
        }

    def motion(self, now: NDArray[np.float32], before: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how far the points, (H, W, 3), have moved across the picture, (H, W, 2)."""
        moved = self.sight.pixels(self.lens.project(now.astype(np.float64)))
        moved -= self.sight_before.pixels(self.lens.project(before.astype(np.float64)))
        if isinstance(self.lens, Equirectangular):
            # The shorter way around.
            width = len(now[0])
            moved[..., 0] -= width * np.floor(moved[..., 0] / width + 0.5)
        return moved.astype(np.float32)


def _refuse(outputs: Sequence[str], diagnose: Any) -> None:
    """Raise ``ValueError`` naming what is not drawn with a lens."""
    if boolean("diagnose", diagnose):
        raise ValueError("diagnose must be False where a lens is given, got True")
    if "motion_visible" in outputs:
        raise ValueError("outputs has 'motion_visible', which is not found where a lens is given")


def _refuse_effects(plans: Sequence[RenderPlan]) -> None:
    """Raise ``ValueError`` naming an effect that counts the pixels of the finished picture."""
    for plan in plans:
        for effect, _ in list_screen_effects(plan.planned):
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


def _depth(picture: Picture, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the depth of a picture, (h, w), along the axis of the lens."""
    if picture.is_ahead:
        return depth
    height, width = depth.shape
    _, _, ahead = picture.directions(np.arange(width), np.arange(height)[:, np.newaxis])
    with np.errstate(invalid="ignore"):
        turned = (depth * ahead).astype(np.float32)
    return np.where(np.isinf(depth), depth, turned)


def _take(
    arrays: dict[str, Any],
    picture: Picture,
    looks: LensViews,
    targets: dict[str, NDArray[Any]],
    workers: Workers,
) -> None:
    """Resample a pinhole picture at the pixels that look at it."""
    mixed = set(MIXED_OUTPUTS).intersection(arrays)
    sources = {name: _linear(name, arrays[name]) for name in mixed}
    nearest = {name: array for name, array in arrays.items() if name not in sources}
    shape = looks.number.shape
    for name, array in (sources | nearest).items():
        if name not in targets:
            empty = 0.0 if name in sources else _empty(name)
            targets[name] = np.full((*shape, *array.shape[2:]), empty, array.dtype)
    (width, height), (origin_x, origin_y) = picture.size, picture.origin
    window = picture.number, picture.density, origin_x, origin_y

    def take_rows(first: int, last: int) -> None:
        for name, source in sources.items():
            resampling.filter_rows(
                source, looks.number, looks.place, looks.spread, window, (first, last),
                targets[name],
            )  # fmt: skip
        is_here = looks.number[first:last] == picture.number
        x, y = (looks.place[first:last][is_here].astype(np.float64) * picture.density).T
        column = np.clip(np.floor(x + origin_x), 0, width - 1).astype(np.int64)
        row = np.clip(np.floor(y + origin_y), 0, height - 1).astype(np.int64)
        for taken, array in nearest.items():
            targets[taken][first:last][is_here] = array[row, column]

    count, per_task = len(looks.number), rows_per_task(looks.number.shape, workers)
    workers.run(
        take_rows,
        [(first, min(first + per_task, count)) for first in range(0, count, per_task)],
    )


def _empty(name: str) -> float:
    """Return what an output that is not mixed holds where nothing is."""
    return math.nan if name in POINTS else output_table.find_row(name).empty


def _linear(name: str, array: NDArray[Any]) -> NDArray[np.float32]:
    """Return a mixed output as (h, w, C) float32: linear light times alpha, or what it is."""
    if array.ndim == 2:
        return np.ascontiguousarray(array, np.float32)[:, :, np.newaxis]
    light = _straight(array) if name == "color" else array.copy()
    if not (light[..., 3] == 1.0).all():
        light[..., :3] *= light[..., 3:]
    return light


def _straight(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return pixels, (h, w, 4), as linear light with straight alpha."""
    light = decoding_table()[codes]
    light[..., 3] = codes[..., 3] / np.float32(255.0)
    return light


def _finished(
    name: str,
    targets: dict[str, NDArray[Any]],
    looks: LensViews,
    behind: Backdrop,
    workers: Workers,
) -> NDArray[Any]:
    """Return an output as a frame holds it; of colours, before what is behind."""
    target = targets[name]
    if name not in MIXED_OUTPUTS:
        return target
    if target.shape[2] == 1:
        return target[..., 0]
    alpha, is_nowhere = target[..., 3:], looks.number == NOWHERE
    if isinstance(behind, BackgroundImage):
        image: NDArray[Any] = behind.image
        given = image if image.dtype == np.float32 else _straight(image)
        through = (1.0 - alpha) * given[..., 3:]
        target[..., :3] += through * given[..., :3]
        alpha += through
    np.divide(target[..., :3], alpha, out=target[..., :3], where=alpha > 0.0)
    if isinstance(behind, np.ndarray):
        target[is_nowhere] = behind
    if name != "color":
        return target
    color = np.empty(target.shape, np.uint8)
    packed, encoding = color.view(np.uint32)[:, :, 0], srgb_encoding.make_encoding_table()
    per_task = rows_per_task(packed.shape, workers)
    bands = [slice(first, first + per_task) for first in range(0, len(packed), per_task)]
    workers.run(
        srgb_encoding.encode_rows, [(target[band], encoding, packed[band]) for band in bands]
    )
    return color


def _compare(planned: LensPlan) -> Comparison | None:
    """Return what it takes to compare a frame with an earlier view; ``None`` without one."""
    if planned.compared is None:
        return None
    scene, camera, sight_before = planned.compared
    cache, size = planned.pictures[0].cache, planned.size
    quality = planned.plan.quality
    old = update_cache(scene.nodes, cache, quality, scene.environment is not None)
    views = object_transforms.transform_to_view(cache.transforms, planned.camera, size)
    old_views = object_transforms.transform_to_view(old.transforms, camera, size)
    positions, faces = old.shapes.arrays.positions, old.shapes.rotate_like(cache.shapes)
    return Comparison(
        planned.lens, planned.sight, sight_before,
        Moment(positions, faces, np.empty((0, 5, 4))),
        (_turned(views, planned.camera, size), _turned(old_views, camera, size)),
    )  # fmt: skip


def _turned(views: ViewTransforms, camera: Camera, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return what takes each object into the axes of the lens, (O, 3, 4)."""
    axes, model = world_axes(camera, size), views.relative_from_model
    found = np.zeros((len(model), 3, 4))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(3):
            found += axes[:, k, np.newaxis] * model[:, np.newaxis, k]
    return found


def _points_of(
    moment: Moment, faces: NDArray[np.int32], seen: RasterizedView, workers: Workers
) -> NDArray[np.float32]:
    """Return where the points of a picture are at a moment, (h, w, 3): given by (O, 3, 4)."""
    face_id, turned = seen.coverage.face_id, moment.matrices
    points = np.empty((*face_id.shape, 3), np.float32)
    # Motion is a difference of two places on the screen, each divided by w. Here all w are 1, and
    # the first place is the origin.
    flat = np.zeros((len(turned), 5, 4))
    flat[:, 3, 3] = 1.0
    for first, count in ((0, 2), (2, 1)):
        matrices = flat.copy()
        matrices[:, :count] = turned[:, first : first + count]
        compared = motion.MomentPair(
            Moment(moment.positions, moment.faces, flat), moment._replace(matrices=matrices), None
        )
        moved = motion.fill_motion(
            face_id, seen.geometry, seen.placement.face_starts, compared, workers
        )
        points[..., first : first + count] = -moved[..., :count]
    return points
