"""
Fill the ground-truth buffers: facts about the face and the point seen at each pixel's centre.

All of them follow from the number of the face and the position of the point on it.

The depth buffer is metric. Passes that compare depths get the reversed depth instead, in whatever
format the frame's own depths were compared.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs import motion
from rasterjit.outputs.motion import MomentPair
from rasterjit.outputs.output_table import find_row
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import point_normals, scalar_colors
from rasterjit.pipeline.visibility import reversed_depth, visibility_pass
from rasterjit.pipeline.visibility.point_pass import PicturePoints
from rasterjit.pipeline.visibility.point_rasterizer import SPHERE
from rasterjit.runtime.jit import Kernel
from rasterjit.runtime.threads import Workers, fill_rows
from rasterjit.scene import transforms
from rasterjit.scene.arrays import Float32, Float64, Int32, UInt8
from rasterjit.scene.camera import Camera
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.survey.cache import SceneCache, Shapes
from rasterjit.survey.depth_format import DepthFormat
from rasterjit.survey.facts import NORMAL_OUTPUTS
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from rasterjit.survey.cross_sections import Cut

PIXELS_PER_BLOCK = 1 << 15
"""Pixels that NumPy processes at once: their float64 copies stay in L2."""

Buffers = dict[str, NDArray[Any]]


def fill_buffers(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    coverage: visibility_pass.Coverage,
    moments: MomentPair | None,
    buffers: Buffers,
    workers: Workers,
) -> None:
    """Fill the requested ground-truth buffers, except the coverage of pixels."""
    face_id = coverage.face_id
    if "face_id" in plan.outputs:
        buffers["face_id"] = face_id if cache.cut is None else cache.cut.face_numbers[face_id]
    if plan.facts.needs_no_buffers:
        return
    if "depth" in plan.outputs:
        buffers["depth"] = find_metric_depth(
            plan.depth_format, plan.camera, coverage, plan.size, plan.corner
        )
    points = coverage.points if plan.facts.visible.points else None
    for name, fill in list_fills(plan, cache, placement).items():
        buffers[name] = fill.run(face_id, geometry, workers)
    _fill_object_ids(plan, cache, face_id, buffers)
    if points is not None:
        _overwrite_round_points(plan, cache, geometry, placement, face_id, points, buffers, workers)
    _postprocess_buffers(plan, cache, placement, face_id, buffers, workers)
    if moments is not None:
        faces = face_id, geometry, cache.shapes.arrays.face_starts
        if "motion" in plan.outputs:
            buffers["motion"] = motion.fill_motion(*faces, moments, workers)
        if moments.previous_faces is not None:
            previous = moments.before, moments.previous_faces
            buffers["motion_visible"] = motion.fill_motion_visible(*faces, *previous, workers)


class FillCall(NamedTuple):
    """A kernel call that fills a buffer, of one view or of many, from the face at each pixel."""

    kernel: Kernel
    channels: tuple[int, ...]
    """() of a buffer (H, W), (C,) of one (H, W, C)."""
    arguments: tuple[Any, ...]
    """Arguments of the kernel between the geometry and the buffer."""

    def run(self, face_id: Int32, geometry: Geometry, workers: Workers) -> Float32:
        """Return the buffer, filled for the faces of a picture, (H, W)."""
        buffer = workers.memory.empty((*face_id.shape, *self.channels), np.float32)
        fill_rows(self.kernel, face_id, (geometry, *self.arguments, buffer), workers)
        return buffer


POSITIONS = {"position", "position_camera", "object_position", "nocs", "distance"}
"""Buffers of positions, each in the space of its `_position_matrices`."""


def list_fills(
    plan: RenderPlan,
    cache: SceneCache,
    placement: Placement,
    world_from_model: Float64 | None = None,
) -> dict[str, FillCall]:
    """
    Return the kernel calls that fill the requested buffers, by name of the buffer.

    The buffer of ``distance`` holds points relative to the eye at first. ``world_from_model``,
    (O, 3, 4), replaces the scene's matrices.
    """
    shapes, requested, fills = cache.shapes, set(plan.outputs), {}
    if "barycentric" in requested:
        arguments = (shapes.corner_offsets,)
        fills["barycentric"] = FillCall(barycentric.fill_barycentric, (3,), arguments)
    if "uv" in requested:
        fills["uv"] = FillCall(barycentric.fill_attribute, (2,), (shapes.uv,))
    if "scalar" in requested:
        fills["scalar"] = FillCall(scalar_colors.fill_scalars, (), shapes.scalars[:1])
    for name in plan.facts.attributes.keys() & requested:
        attribute = plan.facts.attributes[name]
        values, _ = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
        if values is not None:
            fills[name] = FillCall(barycentric.fill_attribute, (attribute.columns,), (values,))
    for name in POSITIONS & requested:
        matrices = _position_matrices(name, plan, cache, placement)
        if name == "position" and world_from_model is not None:
            matrices = world_from_model
        posed = _position_placement(name, cache, placement), matrices
        fills[name] = FillCall(barycentric.fill_positions, (3,), posed)
    # The kernel gets an empty table where there are no vertex normals.
    count = len(shapes.meshes)
    no_normals = np.zeros((1, 3), np.float32), np.zeros(count, np.uint8)
    if not requested.isdisjoint(NORMAL_OUTPUTS):
        normals = (
            (shapes.normals, np.ones(count, np.uint8)) if plan.facts.shows_normals else no_normals
        )
        fills["normal"] = FillCall(barycentric.fill_normals, (3,), (placement, normals))
    if "geometric_normal" in requested:
        normals = _find_point_normals(shapes, no_normals)
        fills["geometric_normal"] = FillCall(barycentric.fill_normals, (3,), (placement, normals))
    return fills


def _position_placement(name: str, cache: SceneCache, placement: Placement) -> Placement:
    """Return the placement for a buffer of positions: unposed for those in model space."""
    return cache.shapes.at_rest(placement) if name in ("object_position", "nocs") else placement


def _position_matrices(
    name: str, plan: RenderPlan, cache: SceneCache, placement: Placement
) -> Float64:
    """Return the matrices from model space to the space of a buffer of positions, (O, 3, 4)."""
    if name == "position":
        return np.ascontiguousarray(cache.transforms.world_from_model[:, :3])
    if name == "position_camera":
        return _camera_from_model(plan.camera, placement.relative_from_model)
    if name == "object_position":
        return np.tile(np.eye(3, 4), (len(cache.shapes.meshes), 1, 1))
    return map_boxes(_rest_boxes(cache)) if name == "nocs" else placement.relative_from_model


def _direction_matrices(
    name: str, plan: RenderPlan, cache: SceneCache, points: PicturePoints
) -> Float64:
    """Return the matrices from world directions to the space of such a buffer, (O, 3, 3)."""
    if name == "position_camera":
        view = np.asarray(plan.camera.view_matrix())[:3, :3]
        return np.tile(view, (len(cache.shapes.meshes), 1, 1))
    if name not in ("object_position", "nocs"):
        return np.tile(np.eye(3), (len(cache.shapes.meshes), 1, 1))
    matrices = _model_from_world(cache.transforms.world_from_model, points)
    if name == "nocs":
        matrices = matrices * map_boxes(_rest_boxes(cache))[:, :1, :1]
    return matrices


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that fill the requested buffers."""
    attributes = plan.facts.attributes
    by_numpy = {name for name, attribute in attributes.items() if not attribute.of_vertices}
    kernels = dict.fromkeys(find_row(name).kernel for name in plan.outputs if name not in by_numpy)
    rows = [KernelRow(kernel, _weights_note(plan)) for kernel in kernels if kernel]
    if plan.facts.visible.spheres and barycentric.fill_positions in kernels:
        rows.append(KernelRow(point_normals.fill_sphere_positions))
    if plan.facts.visible.points and barycentric.fill_normals in kernels:
        rows.append(KernelRow(point_normals.fill_point_normals))
    return rows


def _weights_note(plan: RenderPlan) -> str:
    """Return a note on how values are interpolated, if not perspective-correctly."""
    return "affine weights" if plan.is_affine else ""


def _convert_to_whole_face_weights(cut: Cut, face_id: Int32, weights: Float32) -> None:
    """Convert weights of corners of clipped faces, (H, W, 3), to those of the whole faces."""
    rows, columns = np.nonzero(cut.is_piece[face_id])
    for start in range(0, len(rows), PIXELS_PER_BLOCK):
        block = rows[start : start + PIXELS_PER_BLOCK], columns[start : start + PIXELS_PER_BLOCK]
        piece_weights, corners = weights[block], cut.weights[face_id[block]]
        a, b, c = (piece_weights[:, k, np.newaxis] * corners[:, k] for k in range(3))
        weights[block] = (a + b) + c


def _fill_object_ids(plan: RenderPlan, cache: SceneCache, face_id: Int32, buffers: Buffers) -> None:
    """Fill the requested ids of objects, instances and materials; -1 for the background."""
    names = [name for name in ("object_id", "instance_id", "material_id") if name in plan.outputs]
    if not names:
        return
    # Face -1 takes the last id. Half as long as an index takes.
    shapes, object_id = cache.shapes, cache.shapes.object_numbers.take(face_id, mode="wrap")
    if cache.cut is not None:
        # Ids in the scene before a section cut it.
        shapes, object_id = Shapes(list(cache.cut.meshes)), cache.cut.owners[object_id]
    for name in names:
        is_object = name == "object_id"
        buffers[name] = object_id if is_object else list_object_ids(name, shapes)[object_id]


def list_object_ids(name: str, shapes: Shapes) -> Int32:
    """Return the value of each object in a buffer of ids, (O+1,); -1 for object -1."""
    if name == "object_id":
        return np.array([*range(len(shapes.meshes)), -1], np.int32)
    return shapes.instance_numbers if name == "instance_id" else _number_materials(shapes)


def _number_materials(shapes: Shapes) -> Int32:
    """Return the material of each object, (O+1,), by first use; equal materials share a number."""
    numbers: dict[Any, int] = {}
    # Meshes by identity first: hashing a material takes longer.
    by_mesh = {mesh: numbers.setdefault(mesh.material, len(numbers)) for mesh in shapes.distinct}
    return np.array([*(by_mesh[mesh] for mesh in shapes.meshes), -1], np.int32)


def _overwrite_round_points(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    face_id: Int32,
    points: PicturePoints,
    buffers: Buffers,
    workers: Workers,
) -> None:
    """Overwrite positions and normals of spheres and of other shapes of points."""
    if points.has_spheres:
        for name in POSITIONS & buffers.keys():
            posed = _position_placement(name, cache, placement)
            matrices = _position_matrices(name, plan, cache, placement)
            rotations = _direction_matrices(name, plan, cache, points)
            sphere_inputs = geometry.faces, *points.read, posed, matrices, rotations, buffers[name]
            fill_rows(point_normals.fill_sphere_positions, face_id, sphere_inputs, workers)
    for name in ("normal", "geometric_normal"):
        if name in buffers:
            arguments = geometry.faces, *points.read, placement, buffers[name]
            fill_rows(point_normals.fill_point_normals, face_id, arguments, workers)


def _postprocess_buffers(
    plan: RenderPlan,
    cache: SceneCache,
    placement: Placement,
    face_id: Int32,
    buffers: Buffers,
    workers: Workers,
) -> None:
    """Finish the buffers in NumPy: sections, values of faces, ranges, distances, camera normals."""
    shapes = cache.shapes
    if "barycentric" in buffers and cache.cut is not None:
        _convert_to_whole_face_weights(cache.cut, face_id, buffers["barycentric"])
    for name in plan.facts.attributes.keys() & set(plan.outputs):
        attribute = plan.facts.attributes[name]
        vertex_values, face_values = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
        if face_values is None:
            continue
        if vertex_values is None:
            buffers[name] = face_values[face_id]
        else:
            is_missing = np.isnan(buffers[name][..., 0])
            buffers[name][is_missing] = face_values[face_id[is_missing]]
    if "scalar" in buffers and (face_values := shapes.scalars[1]) is not None:
        has_face_scalar = shapes.has_face_scalars[face_id]
        buffers["scalar"][has_face_scalar] = face_values[face_id[has_face_scalar]]
    if "nocs" in buffers:
        np.clip(buffers["nocs"], 0.0, 1.0, out=buffers["nocs"])
    if "distance" in buffers:
        buffers["distance"] = _measure_distances(buffers["distance"], plan, placement, workers)
    if "normal_camera" in plan.outputs:
        buffers["normal_camera"] = _rotate_normals(buffers["normal"], plan.camera, workers)


def _rest_boxes(cache: SceneCache) -> Float64:
    """Return the model-space box of each unposed, uncut object, (O, 2, 3)."""
    if cache.cut is None:
        return cache.shapes.rest_boxes
    return Shapes(list(cache.cut.meshes)).rest_boxes[cache.cut.owners[:-1]]


def _model_from_world(world_from_model: Float64, points: PicturePoints) -> Float64:
    """Return the matrices from world to model directions, (O, 3, 3); 0 but for spheres."""
    matrices = np.zeros((len(world_from_model), 3, 3))
    for number in np.flatnonzero(points.rows.shapes[:, 0] == SPHERE):
        # A flattened object has no inverse.
        with suppress(ValueError):
            matrices[number] = transforms.inverse(world_from_model[number])[:3, :3]
    return matrices


def _camera_from_model(camera: Camera, relative_from_model: Float64) -> Float64:
    """Return the matrices from model to camera space, (O, 3, 4)."""
    world_from_relative = transforms.translate(camera.eye_position())
    view = transforms.compose(camera.view_matrix(), world_from_relative)[:3, :, np.newaxis]
    m = relative_from_model[:, np.newaxis]
    with np.errstate(over="ignore", invalid="ignore"):
        # In one order on every CPU, which products from BLAS are not.
        result = (view[:, 0] * m[..., 0, :] + view[:, 1] * m[..., 1, :]) + view[:, 2] * m[..., 2, :]
        result[..., 3] += view[:, 3, 0]
    return result


def map_boxes(boxes: Float64) -> Float64:
    """
    Return the matrices from model space to the unit cube, (O, 3, 4), for boxes, (O, 2, 3).

    The middle of a box goes to (1/2, 1/2, 1/2), and its diagonal has length 1 there.
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


def _split_rows(height: int, width: int) -> list[slice]:
    """Return bands of the rows of a picture, of about `PIXELS_PER_BLOCK` pixels each."""
    rows = max(1, PIXELS_PER_BLOCK // width)
    return [slice(first, first + rows) for first in range(0, height, rows)]


def _measure_distances(
    relative: Float32, plan: RenderPlan, placement: Placement, workers: Workers
) -> Float32:
    """Return the distances of points, (H, W, 3), relative to the eye; inf for NaN."""
    distance = workers.memory.empty(relative.shape[:2], np.float32)
    back_x, back_y, back_z = np.asarray(plan.camera.view_matrix())[2, :3].tolist()
    back_length = np.sqrt(back_x * back_x + back_y * back_y + back_z * back_z)
    is_parallel = placement.toward_viewer[3] == 0.0

    def measure_band(band: slice) -> None:
        x, y, z = (relative[band, :, k].astype(np.float64) for k in range(3))
        with np.errstate(over="ignore"):
            if is_parallel:
                distances = -((back_x * x + back_y * y) + back_z * z) / back_length
            else:
                distances = np.sqrt((x * x + y * y) + z * z)
            distance[band] = np.where(np.isnan(distances), np.inf, distances)

    workers.run(measure_band, [(band,) for band in _split_rows(*distance.shape)])
    return distance


def _find_point_normals(shapes: Shapes, no_normals: tuple[Float32, UInt8]) -> tuple[Float32, UInt8]:
    """Return the vertex normals, (V, 3), and which objects are points with normals, (O,)."""
    has_own = [mesh.primitive == "points" and mesh.normals is not None for mesh in shapes.meshes]
    return (shapes.normals, np.array(has_own, np.uint8)) if any(has_own) else no_normals


def _rotate_normals(world_normals: Float32, camera: Camera, workers: Workers) -> Float32:
    """Return unit normals of world space, (H, W, 3), in camera space; zero ones stay zero."""
    camera_normals = workers.memory.empty(world_normals.shape, np.float32)
    matrix = transforms.normal_matrix(camera.view_matrix())
    # So that the squares stay in range.
    matrix = (matrix / np.abs(matrix).max()).tolist()

    def rotate_band(band: slice) -> None:
        world_x, world_y, world_z = (world_normals[band, :, k].astype(np.float64) for k in range(3))
        x, y, z = ((a * world_x + b * world_y) + c * world_z for a, b, c in matrix)
        length = np.sqrt((x * x + y * y) + z * z)
        scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        for k, component in enumerate((x, y, z)):
            camera_normals[band, :, k] = component * scale

    workers.run(rotate_band, [(band,) for band in _split_rows(*world_normals.shape[:2])])
    return camera_normals


def list_depth_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that compute the reversed depth of pixels, if a pass reads it."""
    if not plan.reads_depth or plan.depth_format.is_reversed:
        return []
    rows = [KernelRow(reversed_depth.fill_reversed_depths, _weights_note(plan))]
    if plan.facts.counts.points:
        rows.append(KernelRow(point_normals.fill_point_depths))
    return rows


def add_reversed_depth(
    depth_format: DepthFormat,
    camera: Camera,
    geometry: Geometry,
    coverage: visibility_pass.Coverage,
    workers: Workers,
    placement: Placement,
) -> visibility_pass.Coverage:
    """
    Return the coverage with the reversed depth of pixels and vertices.

    Where depths were compared in another format, those of the visible faces are computed anew, so
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
        vertex_depths = _reverse_vertex_depths(depth_format, coefficients, coverage)
        depth = workers.memory.empty(coverage.face_id.shape, np.float32)
        arguments = geometry, vertex_depths, coefficients, depth
        fill_rows(reversed_depth.fill_reversed_depths, coverage.face_id, arguments, workers)
        if coverage.points is not None:
            points = geometry.faces, *coverage.points.read, placement, coefficients, depth
            fill_rows(point_normals.fill_point_depths, coverage.face_id, points, workers)
    elif depth.dtype != np.float32:
        depth = depth.astype(np.float32)
    return coverage._replace(reversed_depth=depth, reversed_vertex_depth=vertex_depths)


def _reverse_vertex_depths(
    depth_format: DepthFormat,
    coefficients: tuple[float, float, float],
    coverage: visibility_pass.Coverage,
) -> Float64:
    """Return the reversed depth of the vertices; undefined for those behind the eye."""
    _, stored_c1, stored_c2 = depth_format.coefficients
    c0, c1, c2 = coefficients
    screen = coverage.screen
    with np.errstate(all="ignore"):
        return (c0 / screen.w + c1 * ((screen.depth - stored_c2) / stored_c1)) + c2


def find_metric_depth(
    depth_format: DepthFormat,
    camera: Camera,
    coverage: visibility_pass.Coverage,
    size: tuple[int, int],
    corner: tuple[int, int] = (0, 0),
) -> Float32:
    """
    Return the depth in scene units along the viewing axis; ``inf`` for the background.

    Also infinite beyond the last step of the format before an infinite far plane. ``size`` is that
    of the whole picture, ``corner`` the column and row of this part's first pixel.
    """
    depth = np.full(coverage.face_id.shape, np.inf, np.float32)
    (width, height), (left, top) = size, corner
    for band in _split_rows(*coverage.face_id.shape):
        if coverage.first_depth is None:
            stored, is_covered = coverage.depth[band], coverage.face_id[band] >= 0
        else:
            stored = coverage.first_depth[band]
            is_covered = stored != visibility_pass.tile_rasterizer.get_empty_depth(stored.dtype)
        stored = stored[is_covered]
        if not depth_format.is_reversed:
            rows, columns = np.nonzero(is_covered)
            x = (2.0 * (left + columns) + 1.0) / width - 1.0
            y = 1.0 - (2.0 * (top + band.start + rows) + 1.0) / height
            stored = depth_format.reversed_depth(stored, x, y)
        with np.errstate(over="ignore"):
            depth[band][is_covered] = camera.view_depth(stored)
    return depth
