"""
Depth peeling: the nearest surfaces of each pixel one behind the other, whatever their alpha.

The layers are found as those of transparent surfaces are, all faces taken for transparent, and are
buffers of face numbers and depths: what else is known of a pixel follows as for any frame.

References
----------
.. [1] C. Everitt, "Interactive Order-Independent Transparency", NVIDIA, 2001.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import ground_truth, output_table
from rasterjit.outputs.frame import LayeredFrame
from rasterjit.outputs.output_table import Outputs
from rasterjit.pipeline.fragments import fragment_bands
from rasterjit.pipeline.fragments.a_buffer import remove_discarded
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.tile_rasterizer import get_empty_depth
from rasterjit.rendering import frame_shading, planning, view_warnings
from rasterjit.rendering.planning import Cull, PlannedFrame, check_request, plan_frame
from rasterjit.rendering.renderer import count_stats, find_visible, prepare_motion
from rasterjit.runtime.background_compile import compile_in_background
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import Workers, split_range
from rasterjit.scene.camera import Camera
from rasterjit.scene.previous_view import PreviousView
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.validation import image_size, thread_count
from rasterjit.survey.deformation import pose_input


def render_layers(
    what: Any,
    camera: Camera | None = None,
    *,
    k: int,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    outputs: Outputs = ("depth", "face_id", "object_id"),
    cull: Cull = "none",
    previous: PreviousView | None = None,
    threads: int | None = None,
) -> LayeredFrame:
    """
    Find the k nearest surfaces of each pixel, at its centre, nearest first (depth peeling).

    Every face that covers a pixel's centre is a layer of it, whatever its alpha, but for the holes
    of cut-out materials and what ``quality.visible_alpha`` leaves out. Faces at the same depth are
    layers in the order of their numbers. The first layer holds what ``render`` shows, bit for bit.

    Parameters
    ----------
    what, camera, size, quality, cull, previous, threads
        As `rasterjit.render` takes them.
    k : int
        Layers, 1..4096. They take k times the memory of a frame.
    outputs : sequence of str
        What ``render`` takes, but for color, linear and coverage, which are the whole pixel's.

    Returns
    -------
    LayeredFrame
        Its arrays are those of a `Frame` with an axis of k layers in front: (K, H, W, ...). Where
        a pixel has fewer surfaces they hold what they hold where nothing is.

    Raises
    ------
    ValueError
        Naming the argument that is wrong, before any kernel runs; or if more than 4096 surfaces of
        cut-out materials lie behind each other at a pixel.

    Examples
    --------
    >>> import numpy as np
    >>> import rasterjit as rj
    >>> frame = rj.render_layers(rj.load("models/teapot.obj"), k=4, size=(320, 240))
    >>> is_seen = np.isfinite(frame.depth[1])
    >>> thickness = frame.depth[1, is_seen] - frame.depth[0, is_seen]
    """
    if isinstance(k, bool) or not isinstance(k, (int, np.integer)):
        raise ValueError(f"k must be a whole number of layers, got {k!r}")
    if not 1 <= k <= fragment_bands.MAX_LAYERS:
        raise ValueError(f"k must be in 1..{fragment_bands.MAX_LAYERS}, got {k!r}")
    refused = [
        name for name in output_table.check_outputs(outputs) if output_table.find_row(name).is_mixed
    ]
    if refused:
        raise ValueError(
            f"outputs has {refused[0]!r}, which a layer does not have; possible are "
            f"{', '.join(output_table.LAYER_OUTPUTS)}"
        )
    quality, size = check_quality(quality), image_size("size", size)
    clock, workers = StageClock(), Workers(thread_count("threads", threads))
    try:
        request = check_request(size, quality, outputs, None, cull, previous=previous)
        planned = plan_frame(request, pose_input(what), camera)
        if planned.plan.facts.has_round_points:
            raise ValueError(
                "what must have no discs or spheres, of which several in a pixel are not found; "
                "points may be squares"
            )
        planned = planned._replace(plan=planned.plan.for_picture(surfaces=int(k)))
        with compile_in_background(
            partial(planning.list_compile_tasks, planned.plan), workers.threads
        ):
            frame = _draw_layers(planned, int(k), workers, clock)
    finally:
        workers.close()
    view_warnings.warn(view_warnings.warnings_of(frame.plan, frame.stats), set())
    return frame


def _draw_layers(
    planned: PlannedFrame, count: int, workers: Workers, clock: StageClock
) -> LayeredFrame:
    """Run the stages of a frame, and those from face numbers on for each layer."""
    plan, cache, views = planned[:3]
    seen = find_visible(plan, cache, workers, clock, views)
    finder = fragment_bands.Finder(seen.geometry, frame_shading.find_hit_tests(plan, cache))
    depths, faces = peel(count, seen, finder, workers)
    clock("layers")
    motion_inputs = prepare_motion(planned, workers, clock)
    arrays: dict[str, NDArray[Any]] = {}
    for n in range(count):
        layer = seen.coverage._replace(depth=depths[n], face_id=faces[n])
        filled: dict[str, NDArray[Any]] = {}
        ground_truth.fill_buffers(
            plan, cache, seen.geometry, seen.placement, layer, motion_inputs, filled, workers
        )
        is_empty = not (faces[n] >= 0).any()
        for name in plan.outputs:
            if n == 0:
                shape = count, *filled[name].shape
                arrays[name] = np.empty(shape, filled[name].dtype)
            # Behind an empty layer all are empty.
            arrays[name][n : count if is_empty else n + 1] = filled[name]
        if is_empty:
            break
    clock("buffers")
    stats, face_starts = count_stats(seen.coverage, clock.seconds), cache.face_starts
    return LayeredFrame(arrays, plan, stats, face_starts=face_starts)


def peel(
    count: int,
    seen: visibility_pass.RasterizedView,
    finder: fragment_bands.Finder,
    workers: Workers,
) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """
    Return the nearest surfaces of each pixel, nearest first.

    Parameters
    ----------
    count : int
        How many.
    seen : Seen
        With the lists of its coverage.
    finder : Finder
    workers : Workers

    Returns
    -------
    depths : (K, H, W)
        Stored depth, of the type that depths are compared in.
    faces : (K, H, W) int32
        -1 where a pixel has fewer surfaces.
    """
    finder = fragment_bands.make_sampled_finder(finder, 1)
    viewport = finder.geometry.viewport
    everything = np.ones(len(seen.objects.face_starts) - 1, np.uint8)
    lists = fragment_bands.split_tile_lists(seen.coverage, viewport, everything, workers)
    shape = count, viewport.height, viewport.width
    depths = np.full(shape, get_empty_depth(lists.depth_type), lists.depth_type)
    faces = np.full(shape, -1, np.int32)
    # A surface with a hole gives its place to the next one.
    kept = count if finder.alpha_tests is None else None

    def peel_tiles(first: int, last: int) -> None:
        rows = first, last
        for band in fragment_bands.find_layers(rows, lists, 1, finder, workers.memory, kept):
            assert band.depths is not None
            found = band.transparent[0], band.depths[0]
            if finder.alpha_tests is not None:
                found = remove_discarded(band.first_row, *found, finder.alpha_tests)
            target = slice(band.first_row, band.first_row + found[0].shape[1])
            faces[:, target][: len(found[0])] = found[0][:count]
            depths[:, target][: len(found[1])] = found[1][:count]

    workers.run(peel_tiles, split_range(viewport.height, TILE_SIZE))
    return depths, faces
