"""
Fill the ground-truth buffers: facts about the face and the point seen at each pixel's centre.

All of them follow from the number of the face and the position of the point on it.

The depth buffer is metric. Passes that compare depths get the reversed depth instead, in whatever
format the frame's own depths were compared.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import motion
from rasterjit.outputs.motion import Motion
from rasterjit.outputs.table import row_of
from rasterjit.pipeline.geometry import barycentric as interpolation
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import fields, point_shapes
from rasterjit.pipeline.visibility import depth as depths
from rasterjit.pipeline.visibility import draw
from rasterjit.pipeline.visibility.point_coverage import SPHERE
from rasterjit.pipeline.visibility.points import PointsSeen
from rasterjit.runtime.threads import Workers, fill_rows
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.survey.cache import SceneCache, Shapes
from rasterjit.survey.depth_format import DepthFormat
from rasterjit.survey.facts import NORMAL_OUTPUTS
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from rasterjit.survey.sections import Cut

PIXELS_AT_ONCE = 1 << 15
"""Pixels that NumPy does at once: their float64 copies stay in L2."""

Buffers = dict[str, NDArray[Any]]

SAMPLES_AT_ONCE = 1 << 15
"""Samples whose depth is converted at once: their float64 copies stay in L2, and a small frame
is done in one step."""


def fill_buffers(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    coverage: draw.Coverage,
    compared: Motion | None,
    result: Buffers,
    workers: Workers,
) -> None:
    """Make the ground-truth buffers that were asked for, but for the coverage of pixels."""
    shapes, face_id = cache.shapes, coverage.face_id
    if "face_id" in plan.outputs:
        result["face_id"] = face_id if cache.cut is None else cache.cut.face_numbers[face_id]
    if plan.facts.fills_nothing:
        return
    if "depth" in plan.outputs:
        result["depth"] = metric_depth(
            plan.depth_format, plan.camera, coverage, plan.size, plan.corner
        )
    if "barycentric" in plan.outputs:
        places = shapes.listed_places
        result["barycentric"] = fill_barycentric(face_id, geometry, places, workers)
        if cache.cut is not None:
            _weigh_whole_faces(cache.cut, face_id, result["barycentric"])
    if "uv" in plan.outputs:
        result["uv"] = fill_attribute(face_id, geometry, shapes.uv, workers)
    if "scalar" in plan.outputs:
        result["scalar"] = _fill_scalars(shapes, geometry, face_id, workers)
    for name in plan.facts.attributes.keys() & set(plan.outputs):
        result[name] = _show_attribute(name, plan, shapes, geometry, face_id, workers)
    _fill_numbers(plan, cache, face_id, result)
    points = coverage.points if plan.facts.seen.points else None
    _fill_places(plan, cache, geometry, placement, face_id, points, result, workers)
    _fill_normals(plan, cache, geometry, placement, face_id, points, result, workers)
    if compared is not None:
        shared = face_id, geometry, shapes.arrays.face_starts
        if "motion" in plan.outputs:
            result["motion"] = motion.fill_motion(*shared, compared, workers)
        if compared.sighting is not None:
            seen = compared.before, compared.sighting
            result["motion_visible"] = motion.fill_visible(*shared, *seen, workers)


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that fill the buffers that were asked for."""
    attributes = plan.facts.attributes
    by_numpy = {name for name, attribute in attributes.items() if not attribute.of_vertices}
    kernels = dict.fromkeys(row_of(name).kernel for name in plan.outputs if name not in by_numpy)
    rows = [KernelRow(kernel, _way_of_weights(plan)) for kernel in kernels if kernel]
    if plan.facts.seen.spheres and interpolation.fill_positions in kernels:
        rows.append(KernelRow(point_shapes.fill_sphere_positions))
    if plan.facts.seen.points and interpolation.fill_normals in kernels:
        rows.append(KernelRow(point_shapes.fill_point_normals))
    return rows


def _way_of_weights(plan: RenderPlan) -> str:
    """Return how values are interpolated, if not perspective-correctly."""
    return "affine weights" if plan.is_affine else ""


def _show_attribute(
    name: str,
    plan: RenderPlan,
    shapes: Shapes,
    geometry: Geometry,
    face_id: NDArray[np.int32],
    workers: Workers,
) -> NDArray[np.float32]:
    """Return an attribute of one's own, (H, W, D); NaN where nothing is or an object has none."""
    attribute = plan.facts.attributes[name]
    of_vertices, of_faces = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
    if of_vertices is None:
        return of_faces[face_id]
    shown = fill_attribute(face_id, geometry, of_vertices, workers)
    if of_faces is not None:
        has_none = np.isnan(shown[..., 0])
        shown[has_none] = of_faces[face_id[has_none]]
    return shown


def _fill_scalars(
    shapes: Shapes, geometry: Geometry, face_id: NDArray[np.int32], workers: Workers
) -> NDArray[np.float32]:
    """Return the scalars, (H, W); NaN where nothing is or an object has none."""
    of_vertices, of_faces = shapes.scalars
    scalar = workers.memory.empty(face_id.shape, np.float32)
    fill_rows(fields.fill_scalars, face_id, (geometry, of_vertices, scalar), workers)
    if of_faces is not None:
        has_own = shapes.has_face_scalars[face_id]
        scalar[has_own] = of_faces[face_id[has_own]]
    return scalar


def _weigh_whole_faces(
    cut: Cut, face_id: NDArray[np.int32], barycentric: NDArray[np.float32]
) -> None:
    """Turn weights in parts of faces, (H, W, 3), into those in the whole faces."""
    rows, columns = np.nonzero(cut.is_piece[face_id])
    for start in range(0, len(rows), SAMPLES_AT_ONCE):
        some = rows[start : start + SAMPLES_AT_ONCE], columns[start : start + SAMPLES_AT_ONCE]
        own, corners = barycentric[some], cut.weights[face_id[some]]
        a, b, c = (own[:, k, np.newaxis] * corners[:, k] for k in range(3))
        barycentric[some] = (a + b) + c


def _fill_numbers(
    plan: RenderPlan, cache: SceneCache, face_id: NDArray[np.int32], result: Buffers
) -> None:
    """Fill the buffers of numbers that belong to whole objects, -1 where nothing is."""
    wanted = {"object_id", "instance_id", "material_id"}.intersection(plan.outputs)
    if not wanted:
        return
    # Nothing, -1, finds the last number. Half as long as an index takes.
    shapes, object_id = cache.shapes, cache.shapes.object_numbers.take(face_id, mode="wrap")
    if cache.cut is not None:
        # Of the scene before it was cut.
        shapes, object_id = Shapes(list(cache.cut.meshes)), cache.cut.owners[object_id]
    if "object_id" in wanted:
        result["object_id"] = object_id
    if "instance_id" in wanted:
        result["instance_id"] = shapes.instance_numbers[object_id]
    if "material_id" in wanted:
        result["material_id"] = material_numbers(shapes)[object_id]


def material_numbers(shapes: Shapes) -> NDArray[np.int32]:
    """
    Return the number of each object's material, (O+1,), as they are first used in the scene.

    Equal materials have one number. The last entry, which object -1 finds, is -1.
    """
    numbers: dict[Any, int] = {}
    # Meshes by identity first: hashing a material takes longer.
    of_meshes = {mesh: numbers.setdefault(mesh.material, len(numbers)) for mesh in shapes.distinct}
    return np.array([*(of_meshes[mesh] for mesh in shapes.meshes), -1], np.int32)


def _fill_places(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    face_id: NDArray[np.int32],
    points: PointsSeen | None,
    result: Buffers,
    workers: Workers,
) -> None:
    """Fill the buffers of positions, each in the space that some matrices lead to."""
    has_spheres = points is not None and points.has_spheres

    def places(
        matrices: NDArray[np.float64], from_world: NDArray[np.float64] | None = None,
        placement: Placement = placement,
    ) -> NDArray[np.float32]:  # fmt: skip
        """
        Return positions, (H, W, 3), where ``matrices``, (O, 3, 4), put them; NaN if nothing.

        Takes what brings ways in world axes there, (O, 3, 3); default: these are its own.
        """
        position = workers.memory.empty((*face_id.shape, 3), np.float32)
        matrices = np.ascontiguousarray(matrices)
        arguments = geometry, placement, matrices, position
        fill_rows(interpolation.fill_positions, face_id, arguments, workers)
        if has_spheres:
            turns = np.tile(np.eye(3), (count, 1, 1)) if from_world is None else from_world
            seen = geometry.faces, *points.read, placement, matrices, turns, position
            fill_rows(point_shapes.fill_sphere_positions, face_id, seen, workers)
        return position

    def into_models(scales: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return what takes ways in world axes to those of models, (O, 3, 3), scaled."""
        if not has_spheres:
            return None
        return _model_axes(cache.places.world_from_model, points) * scales[:, None, None]

    count = len(cache.shapes.meshes)
    if "position" in plan.outputs:
        result["position"] = places(cache.places.world_from_model[:, :3])
    if "position_camera" in plan.outputs:
        view = np.tile(np.asarray(plan.camera.view_matrix())[:3, :3], (count, 1, 1))
        matrices = _into_view(plan.camera, placement.relative_from_model)
        result["position_camera"] = places(matrices, view)
    if "object_position" in plan.outputs:
        own = np.tile(np.eye(3, 4), (count, 1, 1))
        made = cache.shapes.at_rest(placement)
        result["object_position"] = places(own, into_models(np.ones(count)), made)
    if "nocs" in plan.outputs:
        boxes = box_matrices(_whole_boxes(cache))
        nocs = places(boxes, into_models(boxes[:, 0, 0]), cache.shapes.at_rest(placement))
        np.clip(nocs, 0.0, 1.0, out=nocs)
        result["nocs"] = nocs
    if "distance" in plan.outputs:
        relative = places(placement.relative_from_model)
        result["distance"] = _distances(relative, plan, placement, workers)


def _whole_boxes(cache: SceneCache) -> NDArray[np.float64]:
    """Return the box of each object, (O, 2, 3), before it was posed and a section cut it."""
    if cache.cut is None:
        return cache.shapes.rest_boxes
    return Shapes(list(cache.cut.meshes)).rest_boxes[cache.cut.owners[:-1]]


def _model_axes(world_from_model: NDArray[np.float64], points: PointsSeen) -> NDArray[np.float64]:
    """Return what takes ways in world axes to those of models, (O, 3, 3); 0 but for spheres."""
    axes = np.zeros((len(world_from_model), 3, 3))
    for number in np.flatnonzero(points.rows.shapes[:, 0] == SPHERE):
        # What is flattened has no way back.
        with suppress(ValueError):
            axes[number] = transforms.inverse(world_from_model[number])[:3, :3]
    return axes


def _into_view(camera: Camera, relative_from_model: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what takes each object into camera space, (O, 3, 4), given its matrix to the eye."""
    shift = transforms.translate(camera.eye_position())
    view = transforms.compose(camera.view_matrix(), shift)[:3, :, np.newaxis]
    m = relative_from_model[:, np.newaxis]
    with np.errstate(over="ignore", invalid="ignore"):
        # In one order on every CPU, which products from BLAS are not.
        placed = (view[:, 0] * m[..., 0, :] + view[:, 1] * m[..., 1, :]) + view[:, 2] * m[..., 2, :]
        placed[..., 3] += view[:, 3, 0]
    return placed


def box_matrices(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return what takes each object into a cube of side 1, (O, 3, 4), given its box, (O, 2, 3).

    The middle of the box goes to (1/2, 1/2, 1/2), and its diagonal has length 1 there.
    """
    matrices = np.zeros((len(boxes), 3, 4))
    low, high = boxes[:, 0], boxes[:, 1]
    with np.errstate(all="ignore"):
        half, middle = high / 2.0 - low / 2.0, low / 2.0 + high / 2.0
        # Scale the sides first: squares of very long or very short ones overflow or vanish.
        largest = half.max(axis=1, keepdims=True)
        x, y, z = (half / largest).T
        scales = 0.5 / (largest[:, 0] * np.sqrt(x * x + y * y + z * z))
        scales[~np.isfinite(scales)] = 0.0
        for k in range(3):
            matrices[:, k, k] = scales
        offsets = 0.5 - middle * scales[:, np.newaxis]
    matrices[:, :, 3] = np.where(np.isfinite(offsets), offsets, 0.5)
    return matrices


def _distances(
    relative: NDArray[np.float32],
    plan: RenderPlan,
    placement: Placement,
    workers: Workers,
) -> NDArray[np.float32]:
    """Return how far points (H, W, 3), relative to the eye, are from it, (H, W); inf for NaN."""
    height, width, _ = relative.shape
    distance = workers.memory.empty((height, width), np.float32)
    x, y, z = np.asarray(plan.camera.view_matrix())[2, :3].tolist()
    size = np.sqrt(x * x + y * y + z * z)
    is_parallel = placement.toward_viewer[3] == 0.0

    def measure_some(first: int) -> None:
        some = slice(first, first + rows)
        right, up, back = (relative[some, :, k].astype(np.float64) for k in range(3))
        with np.errstate(over="ignore"):
            if is_parallel:
                far = -((x * right + y * up) + z * back) / size
            else:
                far = np.sqrt((right * right + up * up) + back * back)
            distance[some] = np.where(np.isnan(far), np.inf, far)

    rows = max(1, PIXELS_AT_ONCE // width)
    workers.run(measure_some, [(first,) for first in range(0, height, rows)])
    return distance


def _fill_normals(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    face_id: NDArray[np.int32],
    points: PointsSeen | None,
    result: Buffers,
    workers: Workers,
) -> None:
    """Fill the buffers of normals, zero where nothing is."""
    count, wanted = len(cache.shapes.meshes), plan.outputs
    # The kernel is the same without vertex normals: it is given an empty table.
    flat = np.zeros((1, 3), np.float32), np.zeros(count, np.uint8)
    is_shown = plan.facts.shows_normals
    smooth = (cache.shapes.normals, np.ones(count, np.uint8)) if is_shown else flat

    def normals(given: tuple[NDArray[np.float32], NDArray[np.uint8]]) -> NDArray[np.float32]:
        """Return normals, (H, W, 3), world space."""
        normal = workers.memory.empty((*face_id.shape, 3), np.float32)
        fill_rows(
            interpolation.fill_normals, face_id, (geometry, placement, given, normal), workers
        )
        if points is not None:
            own = geometry.faces, *points.read, placement, normal
            fill_rows(point_shapes.fill_point_normals, face_id, own, workers)
        return normal

    if not set(NORMAL_OUTPUTS).isdisjoint(wanted):
        result["normal"] = normals(smooth)
    if "normal_camera" in wanted:
        result["normal_camera"] = _turned_into_view(result["normal"], plan.camera, workers)
    if "geometric_normal" in wanted:
        result["geometric_normal"] = normals(_normals_of_points(cache.shapes, flat))


def _normals_of_points(
    shapes: Shapes, flat: tuple[NDArray[np.float32], NDArray[np.uint8]]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return the normals that points were given, and the objects that have some."""
    has_own = [mesh.primitive == "points" and mesh.normals is not None for mesh in shapes.meshes]
    return (shapes.normals, np.array(has_own, np.uint8)) if any(has_own) else flat


def _turned_into_view(
    normal: NDArray[np.float32], camera: Camera, workers: Workers
) -> NDArray[np.float32]:
    """Return unit normals, (H, W, 3), of world space in camera space; zero ones stay zero."""
    height, width, _ = normal.shape
    turned = workers.memory.empty(normal.shape, np.float32)
    axes = transforms.normal_matrix(camera.view_matrix())
    # So that the squares stay in range.
    axes = (axes / np.abs(axes).max()).tolist()

    def turn_some(first: int) -> None:
        some = slice(first, first + rows)
        right, up, back = (normal[some, :, k].astype(np.float64) for k in range(3))
        x, y, z = ((a * right + b * up) + c * back for a, b, c in axes)
        length = np.sqrt((x * x + y * y) + z * z)
        scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        for k, along in enumerate((x, y, z)):
            turned[some, :, k] = along * scale

    rows = max(1, PIXELS_AT_ONCE // width)
    workers.run(turn_some, [(first,) for first in range(0, height, rows)])
    return turned


def depth_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that find the reversed depth of what is seen, if a pass reads it."""
    if not plan.reads_depth or plan.depth_format.is_reversed:
        return []
    rows = [KernelRow(depths.fill_depths, _way_of_weights(plan))]
    if plan.facts.contents.points:
        rows.append(KernelRow(point_shapes.fill_point_depths))
    return rows


def add_reversed_depth(
    depth_format: DepthFormat,
    camera: Camera,
    geometry: Geometry,
    coverage: draw.Coverage,
    workers: Workers,
    placement: Placement,
) -> draw.Coverage:
    """
    Return the coverage with the reversed depth of what is seen, and that of the vertices.

    Where depths were compared in another way they are found anew for the faces that were seen, so
    that nothing is rounded to the format.

    Parameters
    ----------
    depth_format : DepthFormat
    camera : Camera
    geometry : Geometry
    coverage : Coverage
        Its depth is kept.
    workers : Workers
    placement : Placement
    """
    depth, vertex_depths = coverage.depth, coverage.screen.depth
    if not depth_format.is_reversed:
        coefficients = camera.depth_coefficients()
        vertex_depths = _reversed_vertices(depth_format, coefficients, coverage)
        depth = workers.memory.empty(coverage.face_id.shape, np.float32)
        arguments = geometry, vertex_depths, coefficients, depth
        fill_rows(depths.fill_depths, coverage.face_id, arguments, workers)
        if coverage.points is not None:
            seen = geometry.faces, *coverage.points.read, placement, coefficients, depth
            fill_rows(point_shapes.fill_point_depths, coverage.face_id, seen, workers)
    elif depth.dtype != np.float32:
        depth = depth.astype(np.float32)
    return coverage._replace(reversed_depth=depth, reversed_vertex_depth=vertex_depths)


def _reversed_vertices(
    depth_format: DepthFormat,
    coefficients: tuple[float, float, float],
    coverage: draw.Coverage,
) -> NDArray[np.float64]:
    """Return the reversed depth of the vertices; of those behind the eye anything."""
    _, deeper, rest = depth_format.coefficients
    c0, c1, c2 = coefficients
    screen = coverage.screen
    with np.errstate(all="ignore"):
        return (c0 / screen.w + c1 * ((screen.depth - rest) / deeper)) + c2


def metric_depth(
    depth_format: DepthFormat,
    camera: Camera,
    coverage: draw.Coverage,
    size: tuple[int, int],
    corner: tuple[int, int] = (0, 0),
) -> NDArray[np.float32]:
    """
    Return the depth in scene units along the viewing axis; ``inf`` where nothing is.

    What the depth format holds: infinite beyond its last step before an infinite far plane. Takes
    the size of the whole picture, and column and row of the first pixel of this part of it.
    """
    depth = np.full(coverage.face_id.shape, np.inf, np.float32)
    (width, height), (left, top) = size, corner
    rows = max(1, SAMPLES_AT_ONCE // depth.shape[1])
    for row in range(0, len(depth), rows):
        band = slice(row, row + rows)
        if coverage.first_depth is None:
            stored, seen = coverage.depth[band], coverage.face_id[band] >= 0
        else:
            stored = coverage.first_depth[band]
            seen = stored != draw.nearest.empty_depth(stored.dtype)
        stored = stored[seen]
        if not depth_format.is_reversed:
            down, across = np.nonzero(seen)
            x = (2.0 * (left + across) + 1.0) / width - 1.0
            y = 1.0 - (2.0 * (top + row + down) + 1.0) / height
            stored = depth_format.reversed_depth(stored, x, y)
        with np.errstate(over="ignore"):
            depth[band][seen] = camera.view_depth(stored)
    return depth


def fill_attribute(
    face_id: NDArray[np.int32],
    geometry: Geometry,
    values: NDArray[np.float32],
    workers: Workers,
) -> NDArray[np.float32]:
    """Return values of vertices, (V, D), at each sample, (H, W, D); NaN where nothing is."""
    attribute = workers.memory.empty((*face_id.shape, values.shape[1]), np.float32)
    arguments = geometry, values, attribute
    fill_rows(interpolation.fill_attribute, face_id, arguments, workers)
    return attribute


def fill_barycentric(
    face_id: NDArray[np.int32], geometry: Geometry, places: NDArray[np.uint8], workers: Workers
) -> NDArray[np.float32]:
    """
    Return the weights of each sample, (H, W, 3); zero where nothing is.

    Takes at which place the first corner of each face is listed: `first_corners.listed_places`.
    """
    barycentric = workers.memory.empty((*face_id.shape, 3), np.float32)
    arguments = geometry, places, barycentric
    fill_rows(interpolation.fill_barycentric, face_id, arguments, workers)
    return barycentric
