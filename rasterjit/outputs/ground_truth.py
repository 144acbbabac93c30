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
from rasterjit.outputs.motion import Motion
from rasterjit.outputs.output_table import row_of
from rasterjit.pipeline.geometry import barycentric as interpolation
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import point_normals, scalar_colors
from rasterjit.pipeline.visibility import reversed_depth as depths
from rasterjit.pipeline.visibility import visibility_pass
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

SAMPLES_PER_BLOCK = 1 << 15
"""Samples whose depth is converted at once: their float64 copies stay in L2, and a small frame
is done in one step."""


def fill_buffers(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    coverage: visibility_pass.Coverage,
    compared: Motion | None,
    result: Buffers,
    workers: Workers,
) -> None:
    """Fill the requested ground-truth buffers, except the coverage of pixels."""
    shapes, face_id = cache.shapes, coverage.face_id
    if "face_id" in plan.outputs:
        result["face_id"] = face_id if cache.cut is None else cache.cut.face_numbers[face_id]
    if plan.facts.needs_no_buffers:
        return
    if "depth" in plan.outputs:
        result["depth"] = metric_depth(
            plan.depth_format, plan.camera, coverage, plan.size, plan.corner
        )
    points = coverage.points if plan.facts.visible.points else None
    for name, fill in list_fills(plan, cache, placement).items():
        result[name] = fill.run(face_id, geometry, workers)
    _fill_object_ids(plan, cache, face_id, result)
    if points is not None:
        _overwrite_round_points(plan, cache, geometry, placement, face_id, points, result, workers)
    _complete_buffers(plan, cache, placement, face_id, result, workers)
    if compared is not None:
        shared = face_id, geometry, shapes.arrays.face_starts
        if "motion" in plan.outputs:
            result["motion"] = motion.fill_motion(*shared, compared, workers)
        if compared.sighting is not None:
            previous = compared.before, compared.sighting
            result["motion_visible"] = motion.fill_visible(*shared, *previous, workers)


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
"""Buffers of positions, each in the space that `_matrices` lead to."""


def list_fills(
    plan: RenderPlan,
    cache: SceneCache,
    placement: Placement,
    world_from_model: Float64 | None = None,
) -> dict[str, FillCall]:
    """
    Return the kernel calls for the requested buffers, by name, one for each row of the table.

    Of ``distance`` that is the point relative to the eye. ``world_from_model`` is (O, 3, 4), where
    it is not that of the scene.
    """
    shapes, asked, fills = cache.shapes, set(plan.outputs), {}
    if "barycentric" in asked:
        vertices = (shapes.corner_offsets,)
        fills["barycentric"] = FillCall(interpolation.fill_barycentric, (3,), vertices)
    if "uv" in asked:
        fills["uv"] = FillCall(interpolation.fill_attribute, (2,), (shapes.uv,))
    if "scalar" in asked:
        fills["scalar"] = FillCall(scalar_colors.fill_scalars, (), shapes.scalars[:1])
    for name in plan.facts.attributes.keys() & asked:
        attribute = plan.facts.attributes[name]
        values, _ = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
        if values is not None:
            fills[name] = FillCall(interpolation.fill_attribute, (attribute.columns,), (values,))
    for name in POSITIONS & asked:
        matrices = _matrices(name, plan, cache, placement)
        if name == "position" and world_from_model is not None:
            matrices = world_from_model
        arguments = _placement(name, cache, placement), matrices
        fills[name] = FillCall(interpolation.fill_positions, (3,), arguments)
    # The kernel is the same without vertex normals: it is given an empty table.
    count = len(shapes.meshes)
    no_normals = np.zeros((1, 3), np.float32), np.zeros(count, np.uint8)
    if not asked.isdisjoint(NORMAL_OUTPUTS):
        normals = (
            (shapes.normals, np.ones(count, np.uint8)) if plan.facts.shows_normals else no_normals
        )
        fills["normal"] = FillCall(interpolation.fill_normals, (3,), (placement, normals))
    if "geometric_normal" in asked:
        normals = _normals_of_points(shapes, no_normals)
        fills["geometric_normal"] = FillCall(interpolation.fill_normals, (3,), (placement, normals))
    return fills


def _placement(name: str, cache: SceneCache, placement: Placement) -> Placement:
    """Return the placement for a buffer of positions: unposed for those in model space."""
    return cache.shapes.at_rest(placement) if name in ("object_position", "nocs") else placement


def _matrices(name: str, plan: RenderPlan, cache: SceneCache, placement: Placement) -> Float64:
    """Return the matrices from objects to the space of a buffer of positions, (O, 3, 4)."""
    if name == "position":
        return np.ascontiguousarray(cache.transforms.world_from_model[:, :3])
    if name == "position_camera":
        return _view_matrices(plan.camera, placement.relative_from_model)
    if name == "object_position":
        return np.tile(np.eye(3, 4), (len(cache.shapes.meshes), 1, 1))
    return box_matrices(_rest_boxes(cache)) if name == "nocs" else placement.relative_from_model


def _rotations(name: str, plan: RenderPlan, cache: SceneCache, points: PicturePoints) -> Float64:
    """Return the matrices from world directions to that space, (O, 3, 3)."""
    if name == "position_camera":
        view = np.asarray(plan.camera.view_matrix())[:3, :3]
        return np.tile(view, (len(cache.shapes.meshes), 1, 1))
    if name not in ("object_position", "nocs"):
        return np.tile(np.eye(3), (len(cache.shapes.meshes), 1, 1))
    axes = _model_axes(cache.transforms.world_from_model, points)
    if name == "nocs":
        axes = axes * box_matrices(_rest_boxes(cache))[:, :1, :1]
    return axes


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that fill the buffers that were asked for."""
    attributes = plan.facts.attributes
    by_numpy = {name for name, attribute in attributes.items() if not attribute.of_vertices}
    kernels = dict.fromkeys(row_of(name).kernel for name in plan.outputs if name not in by_numpy)
    rows = [KernelRow(kernel, _weights_note(plan)) for kernel in kernels if kernel]
    if plan.facts.visible.spheres and interpolation.fill_positions in kernels:
        rows.append(KernelRow(point_normals.fill_sphere_positions))
    if plan.facts.visible.points and interpolation.fill_normals in kernels:
        rows.append(KernelRow(point_normals.fill_point_normals))
    return rows


def _weights_note(plan: RenderPlan) -> str:
    """Return a note on how values are interpolated, if not perspective-correctly."""
    return "affine weights" if plan.is_affine else ""


def _unclip_weights(cut: Cut, face_id: Int32, barycentric: Float32) -> None:
    """Convert weights in clipped parts of faces, (H, W, 3), to weights in the whole faces."""
    rows, columns = np.nonzero(cut.is_piece[face_id])
    for start in range(0, len(rows), SAMPLES_PER_BLOCK):
        block = rows[start : start + SAMPLES_PER_BLOCK], columns[start : start + SAMPLES_PER_BLOCK]
        weights, corners = barycentric[block], cut.weights[face_id[block]]
        a, b, c = (weights[:, k, np.newaxis] * corners[:, k] for k in range(3))
        barycentric[block] = (a + b) + c


def _fill_object_ids(plan: RenderPlan, cache: SceneCache, face_id: Int32, result: Buffers) -> None:
    """Fill the buffers of numbers that belong to whole objects, -1 where nothing is."""
    asked = [name for name in ("object_id", "instance_id", "material_id") if name in plan.outputs]
    if not asked:
        return
    # Nothing, -1, finds the last number. Half as long as an index takes.
    shapes, object_id = cache.shapes, cache.shapes.object_numbers.take(face_id, mode="wrap")
    if cache.cut is not None:
        # Of the scene before it was cut.
        shapes, object_id = Shapes(list(cache.cut.meshes)), cache.cut.owners[object_id]
    for name in asked:
        is_own = name == "object_id"
        result[name] = object_id if is_own else object_table(name, shapes)[object_id]


def object_table(name: str, shapes: Shapes) -> Int32:
    """Return the values of a buffer of numbers for each object, (O+1,); -1 for object -1."""
    if name == "object_id":
        return np.array([*range(len(shapes.meshes)), -1], np.int32)
    return shapes.instance_numbers if name == "instance_id" else material_numbers(shapes)


def material_numbers(shapes: Shapes) -> Int32:
    """
    Number the materials of objects, (O+1,), by their first use in the scene.

    Equal materials have one number. The last entry, which object -1 finds, is -1.
    """
    numbers: dict[Any, int] = {}
    # Meshes by identity first: hashing a material takes longer.
    of_meshes = {mesh: numbers.setdefault(mesh.material, len(numbers)) for mesh in shapes.distinct}
    return np.array([*(of_meshes[mesh] for mesh in shapes.meshes), -1], np.int32)


def _overwrite_round_points(
    plan: RenderPlan,
    cache: SceneCache,
    geometry: Geometry,
    placement: Placement,
    face_id: Int32,
    points: PicturePoints,
    result: Buffers,
    workers: Workers,
) -> None:
    """Fill positions and normals anew where they are those of points' shapes, not of faces."""
    if points.has_spheres:
        for name in POSITIONS & result.keys():
            placed = _placement(name, cache, placement), _matrices(name, plan, cache, placement)
            rotations = _rotations(name, plan, cache, points)
            inputs = geometry.faces, *points.read, *placed, rotations, result[name]
            fill_rows(point_normals.fill_sphere_positions, face_id, inputs, workers)
    for name in ("normal", "geometric_normal"):
        if name in result:
            arguments = geometry.faces, *points.read, placement, result[name]
            fill_rows(point_normals.fill_point_normals, face_id, arguments, workers)


def _complete_buffers(
    plan: RenderPlan,
    cache: SceneCache,
    placement: Placement,
    face_id: Int32,
    result: Buffers,
    workers: Workers,
) -> None:
    """Complete, with NumPy, the buffers that kernels have filled."""
    shapes = cache.shapes
    if "barycentric" in result and cache.cut is not None:
        _unclip_weights(cache.cut, face_id, result["barycentric"])
    for name in plan.facts.attributes.keys() & set(plan.outputs):
        attribute = plan.facts.attributes[name]
        of_vertices, of_faces = shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)
        if of_faces is None:
            continue
        if of_vertices is None:
            result[name] = of_faces[face_id]
        else:
            has_none = np.isnan(result[name][..., 0])
            result[name][has_none] = of_faces[face_id[has_none]]
    if "scalar" in result and (of_faces := shapes.scalars[1]) is not None:
        has_own = shapes.has_face_scalars[face_id]
        result["scalar"][has_own] = of_faces[face_id[has_own]]
    if "nocs" in result:
        np.clip(result["nocs"], 0.0, 1.0, out=result["nocs"])
    if "distance" in result:
        result["distance"] = _distances(result["distance"], plan, placement, workers)
    if "normal_camera" in plan.outputs:
        result["normal_camera"] = _camera_normals(result["normal"], plan.camera, workers)


def _rest_boxes(cache: SceneCache) -> Float64:
    """Return the box of each object, (O, 2, 3), before it was posed and a section cut it."""
    if cache.cut is None:
        return cache.shapes.rest_boxes
    return Shapes(list(cache.cut.meshes)).rest_boxes[cache.cut.owners[:-1]]


def _model_axes(world_from_model: Float64, points: PicturePoints) -> Float64:
    """Return the matrices from world to model directions, (O, 3, 3); 0 but for spheres."""
    axes = np.zeros((len(world_from_model), 3, 3))
    for number in np.flatnonzero(points.rows.shapes[:, 0] == SPHERE):
        # What is flattened has no way back.
        with suppress(ValueError):
            axes[number] = transforms.inverse(world_from_model[number])[:3, :3]
    return axes


def _view_matrices(camera: Camera, relative_from_model: Float64) -> Float64:
    """Return the matrices from objects to camera space, (O, 3, 4), given those to the eye."""
    shift = transforms.translate(camera.eye_position())
    view = transforms.compose(camera.view_matrix(), shift)[:3, :, np.newaxis]
    m = relative_from_model[:, np.newaxis]
    with np.errstate(over="ignore", invalid="ignore"):
        # In one order on every CPU, which products from BLAS are not.
        result = (view[:, 0] * m[..., 0, :] + view[:, 1] * m[..., 1, :]) + view[:, 2] * m[..., 2, :]
        result[..., 3] += view[:, 3, 0]
    return result


def box_matrices(boxes: Float64) -> Float64:
    """
    Return the matrices from objects to a cube of side 1, (O, 3, 4), given their boxes.

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
    relative: Float32, plan: RenderPlan, placement: Placement, workers: Workers
) -> Float32:
    """Return the distances of points, (H, W, 3), relative to the eye; inf for NaN."""
    height, width, _ = relative.shape
    distance = workers.memory.empty((height, width), np.float32)
    x, y, z = np.asarray(plan.camera.view_matrix())[2, :3].tolist()
    size = np.sqrt(x * x + y * y + z * z)
    is_parallel = placement.toward_viewer[3] == 0.0

    def measure_some(first: int) -> None:
        band = slice(first, first + rows)
        right, up, back = (relative[band, :, k].astype(np.float64) for k in range(3))
        with np.errstate(over="ignore"):
            if is_parallel:
                far = -((x * right + y * up) + z * back) / size
            else:
                far = np.sqrt((right * right + up * up) + back * back)
            distance[band] = np.where(np.isnan(far), np.inf, far)

    rows = max(1, PIXELS_PER_BLOCK // width)
    workers.run(measure_some, [(first,) for first in range(0, height, rows)])
    return distance


def _normals_of_points(shapes: Shapes, no_normals: tuple[Float32, UInt8]) -> tuple[Float32, UInt8]:
    """Return the normals that points were given, and the objects that have some."""
    has_own = [mesh.primitive == "points" and mesh.normals is not None for mesh in shapes.meshes]
    return (shapes.normals, np.array(has_own, np.uint8)) if any(has_own) else no_normals


def _camera_normals(normal: Float32, camera: Camera, workers: Workers) -> Float32:
    """Return unit normals, (H, W, 3), of world space in camera space; zero ones stay zero."""
    height, width, _ = normal.shape
    result = workers.memory.empty(normal.shape, np.float32)
    axes = transforms.normal_matrix(camera.view_matrix())
    # So that the squares stay in range.
    axes = (axes / np.abs(axes).max()).tolist()

    def turn_some(first: int) -> None:
        band = slice(first, first + rows)
        right, up, back = (normal[band, :, k].astype(np.float64) for k in range(3))
        x, y, z = ((a * right + b * up) + c * back for a, b, c in axes)
        length = np.sqrt((x * x + y * y) + z * z)
        scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        for k, along in enumerate((x, y, z)):
            result[band, :, k] = along * scale

    rows = max(1, PIXELS_PER_BLOCK // width)
    workers.run(turn_some, [(first,) for first in range(0, height, rows)])
    return result


def depth_kernels(plan: RenderPlan) -> Rows:
    """Return the kernels that find the reversed depth of what is seen, if a pass reads it."""
    if not plan.reads_depth or plan.depth_format.is_reversed:
        return []
    rows = [KernelRow(depths.fill_depths, _weights_note(plan))]
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
        vertex_depths = _reversed_vertex_depths(depth_format, coefficients, coverage)
        depth = workers.memory.empty(coverage.face_id.shape, np.float32)
        arguments = geometry, vertex_depths, coefficients, depth
        fill_rows(depths.fill_depths, coverage.face_id, arguments, workers)
        if coverage.points is not None:
            seen = geometry.faces, *coverage.points.read, placement, coefficients, depth
            fill_rows(point_normals.fill_point_depths, coverage.face_id, seen, workers)
    elif depth.dtype != np.float32:
        depth = depth.astype(np.float32)
    return coverage._replace(reversed_depth=depth, reversed_vertex_depth=vertex_depths)


def _reversed_vertex_depths(
    depth_format: DepthFormat,
    coefficients: tuple[float, float, float],
    coverage: visibility_pass.Coverage,
) -> Float64:
    """Return the reversed depth of the vertices; of those behind the eye anything."""
    _, deeper, rest = depth_format.coefficients
    c0, c1, c2 = coefficients
    screen = coverage.screen
    with np.errstate(all="ignore"):
        return (c0 / screen.w + c1 * ((screen.depth - rest) / deeper)) + c2


def metric_depth(
    depth_format: DepthFormat,
    camera: Camera,
    coverage: visibility_pass.Coverage,
    size: tuple[int, int],
    corner: tuple[int, int] = (0, 0),
) -> Float32:
    """
    Return the depth in scene units along the viewing axis; ``inf`` where nothing is.

    What the depth format holds: infinite beyond its last step before an infinite far plane. Takes
    the size of the whole picture, and column and row of the first pixel of this part of it.
    """
    depth = np.full(coverage.face_id.shape, np.inf, np.float32)
    (width, height), (left, top) = size, corner
    rows = max(1, SAMPLES_PER_BLOCK // coverage.face_id.shape[1])
    for row in range(0, len(depth), rows):
        band = slice(row, row + rows)
        if coverage.first_depth is None:
            stored, seen = coverage.depth[band], coverage.face_id[band] >= 0
        else:
            stored = coverage.first_depth[band]
            seen = stored != visibility_pass.tile_rasterizer.empty_depth(stored.dtype)
        stored = stored[seen]
        if not depth_format.is_reversed:
            down, across = np.nonzero(seen)
            x = (2.0 * (left + across) + 1.0) / width - 1.0
            y = 1.0 - (2.0 * (top + row + down) + 1.0) / height
            stored = depth_format.reversed_depth(stored, x, y)
        with np.errstate(over="ignore"):
            depth[band][seen] = camera.view_depth(stored)
    return depth
