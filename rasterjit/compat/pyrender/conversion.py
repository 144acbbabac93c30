"""Convert a scene of this adapter to one of RasterJIT's."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.opengl_camera import make_matrix_camera
from rasterjit.compat.pyrender.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.compat.pyrender.constants import GLTF, SHADOW_TEX_SZ, RenderFlags
from rasterjit.compat.pyrender.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.primitive import Primitive, zero_nonfinite
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.scene import scene as scenes
from rasterjit.scene import transforms
from rasterjit.scene.camera import MatrixCamera, mirrors
from rasterjit.scene.light import AmbientLight, Shadow
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.mesh import Mesh as SceneMesh
from rasterjit.scene.normals import dot_rows, unit_rows
from rasterjit.scene.reference_shader import DepthMap, ReferenceShading, decode_codes
from rasterjit.scene.validation import read_only
from rasterjit.scene.vectors import cross, dot, length

Float64 = NDArray[np.float64]

LINE_MODES = (GLTF.LINES, GLTF.LINE_LOOP, GLTF.LINE_STRIP)
"""Modes of primitives that are lines."""

LINE_WIDTH = 1.0
"""Width of lines, pixels."""

LINE_DEPTH_OFFSET = 0.5, 0.5
"""
Offset, pixels, at which Mesa reads depths and attributes of lines with several samples a pixel: to
the right of each sample and above it, which is below in pictures drawn upside down.
"""

NORMAL_COLOR = 0.1, 0.1, 1.0
"""Colour of normals, shares of 255."""

NORMAL_LENGTH = 0.05
"""Length of normals, as a share of their primitive's scale."""


class LitLines(Lines):
    """
    Lines with normals and texture coordinates, which any material can shade.

    Parameters
    ----------
    points : (V, 3) array_like
    segments : (S, 2) array_like of int
    normals : (V, 3) array_like, optional
        Of any length; interpolated along segments.
    uv : (V, 2) array_like, optional
    colors : (V, 4) array_like, optional
    material : Material
    depth_offset : (float, float)
        Offset at which depths and attributes are read, to the right of each sample and below it,
        pixels.

    Raises
    ------
    ValueError
        If an array has the wrong shape.
    """

    def __init__(
        self,
        points: Any,
        segments: Any,
        *,
        normals: Any = None,
        uv: Any = None,
        colors: Any = None,
        material: Material,
        depth_offset: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__(
            points, segments, colors=colors, width=LINE_WIDTH, caps="butt", material=material,
            on_invalid="drop",
        )  # fmt: skip
        self._depth_offset = depth_offset
        # `Lines` takes neither normals nor uv: a mesh checks them.
        checked = Mesh(points, [[0, 0, 0]], normals=normals, uv=uv, on_invalid="drop")
        self._normals = self._vertex_normals = checked.normals
        self._uv = checked.uv

    @property
    def links(self) -> NDArray[np.int32]:
        """(S, 2) int32: -1, as no segments are joined."""
        if self._links is None:
            self._links = np.full((len(self), 2), -1, np.int32)
        return self._links

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        Mesh._check_material(name, value)

    def select_segments(self, is_picked: NDArray[np.bool_]) -> LitLines:
        """Return lines with the marked segments, (S,) bool, of the same points."""
        selected = copy.copy(self)
        selected._faces = read_only(self._faces[is_picked])
        selected._links = selected._bounds = None
        return selected

    def with_material(self, material: Material) -> LitLines:
        """Return the lines with another material."""
        if self._material == material:
            return self
        other = copy.copy(self)
        other.material = material
        return other


class _Edges:
    """The edges of a primitive's faces."""

    def __init__(self, primitive: Primitive, material: Material) -> None:
        faces = primitive.list_faces()
        self._segments, self._of_faces = _list_edges(faces)
        self._planes = _compute_planes(primitive.positions.astype(np.float64)[faces])
        self._all = _make_lit_lines(primitive, self._segments, material, LINE_DEPTH_OFFSET)
        self._eye: Float64 | None = None
        self._drawn: tuple[NDArray[np.bool_], LitLines] | None = None

    def get_all(self, material: Material) -> LitLines:
        """Return all edges."""
        self._all = self._all.with_material(material)
        return self._all

    def get_front(self, material: Material, clip_from_model: Float64) -> LitLines | None:
        """Return the edges of faces that appear counterclockwise, or None without any."""
        eye = _compute_eye(clip_from_model)
        if self._eye is None or not np.array_equal(self._eye, eye):
            self._select_front(eye)
            self._eye = eye
        if self._drawn is None:
            return None
        self._drawn = self._drawn[0], self._drawn[1].with_material(material)
        return self._drawn[1]

    def _select_front(self, eye: Float64) -> None:
        """Select the edges of faces in front of an eye, homogeneous (4,)."""
        # The side of each plane that the eye is on.
        (a, b, c, d), (x, y, z, w) = self._planes, eye
        is_front = ((a * x + b * y) + c * z) + d * w > 0.0
        is_picked = np.zeros(len(self._segments), np.bool_)
        is_picked[self._of_faces[is_front]] = True
        if not is_picked.any():
            self._drawn = None
        elif self._drawn is None or not np.array_equal(self._drawn[0], is_picked):
            self._drawn = is_picked, self._all.select_segments(is_picked)


def make_edges(
    primitive: Primitive, pose: Float64, material: Material, camera: MatrixCamera | None
) -> LitLines | None:
    """
    Return the edges of a primitive's triangles, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    pose : (4, 4) float64
        ``world_from_model``.
    material : Material
    camera : MatrixCamera, optional
        Culls back faces; without it all faces have edges.
    """
    key = "edges", material.shading
    if key not in primitive._drawn:
        primitive._drawn[key] = _Edges(primitive, material)
    edges: _Edges = primitive._drawn[key]
    if camera is None:
        return edges.get_all(material)
    clip_from_model = transforms.compose(camera.clip_from_view, camera.view_from_world, pose)
    return edges.get_front(material, clip_from_model)


def make_lines(
    primitive: Primitive, material: Material, depth_offset: tuple[float, float] = LINE_DEPTH_OFFSET
) -> LitLines | None:
    """
    Return the lines of a primitive of lines, a loop or a strip, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    material : Material
    depth_offset : (float, float)
        Offset at which depths and attributes are read; see `LitLines`.
    """
    segments = _list_segments(primitive)
    if not len(segments):
        return None
    key = "lines", material.shading, depth_offset
    lines = primitive._drawn.get(key)
    lines = lines or _make_lit_lines(primitive, segments, material, depth_offset)
    primitive._drawn[key] = lines.with_material(material)
    return primitive._drawn[key]


def _make_lit_lines(
    primitive: Primitive,
    segments: NDArray[np.int64],
    material: Material,
    depth_offset: tuple[float, float],
) -> LitLines:
    """Return lines between vertices of a primitive."""
    return LitLines(
        primitive.positions,
        segments,
        normals=zero_nonfinite(primitive.normals),
        uv=zero_nonfinite(primitive.texcoord_0),
        colors=primitive.get_colors(material.shading == "pbr"),
        material=material,
        depth_offset=depth_offset,
    )


def make_normal_lines(
    primitive: Primitive, of_vertices: bool, of_faces: bool, color: NDArray[np.float32]
) -> Lines | None:
    """
    Return a primitive's normals as lines, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    of_vertices, of_faces : bool
        Whether to draw the normals of vertices and of faces. Points have those of vertices.
    color : (4,) float32, linear
    """
    if primitive.normals is None:
        return None
    starts, directions = [], []
    faces, positions = primitive.list_faces(), primitive.positions.astype(np.float64)
    if of_vertices or not len(faces):
        starts.append(positions)
        directions.append(unit_rows(primitive.normals.astype(np.float64)))
    if of_faces and len(faces):
        a, b, c = np.moveaxis(positions[faces], 1, 0)
        starts.append((a + b + c) / 3.0)
        directions.append(unit_rows(np.cross(b - a, c - a)))
    if not starts:
        return None
    first = np.concatenate(starts)
    last = first + NORMAL_LENGTH * float(primitive.scale) * np.concatenate(directions)
    numbers = np.arange(len(first))
    return Lines(
        np.concatenate([first, last]), np.stack([numbers, numbers + len(first)], axis=1),
        colors=np.tile(color, (len(first), 1)), width=LINE_WIDTH, caps="butt", on_invalid="drop",
    )  # fmt: skip


def is_winding_flipped(camera: MatrixCamera, pose: Float64) -> bool:
    """
    Tell whether front faces appear clockwise, so that OpenGL takes them for back faces.

    OpenGL goes by the picture alone: mirrored poses and projections flip the winding.
    """
    clip = camera.clip_from_view
    # The row that grows with depth: w of a perspective, else z.
    depth_row = 3 if clip[3, :3].any() else 2
    is_clip_positive = _compute_volume(clip[[0, 1, depth_row], :3]) > 0.0
    return is_clip_positive != (_compute_volume(pose[:3, :3]) < 0.0)


def _list_segments(primitive: Primitive) -> NDArray[np.int64]:
    """Return the vertex numbers of the ends of each segment, (S, 2)."""
    numbers = primitive.list_vertices()
    if primitive.mode == GLTF.LINES:
        return numbers[: len(numbers) // 2 * 2].reshape(-1, 2)
    ends = np.roll(numbers, -1) if primitive.mode == GLTF.LINE_LOOP else numbers[1:]
    return np.stack([numbers[: len(ends)], ends], axis=1)


def _list_edges(
    faces: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each edge once, (E, 2), in the order of faces, and the edges of each face, (F, 3)."""
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1).astype(np.int64)
    _, first, inverse = np.unique(
        low * (int(high.max(initial=0)) + 1) + high, return_index=True, return_inverse=True
    )
    order = np.argsort(first, kind="stable")
    ranks = np.empty_like(order)
    ranks[order] = np.arange(len(order))
    return ends[first[order]], ranks[inverse].reshape(-1, 3)


def _compute_planes(corners: Float64) -> Float64:
    """Return the planes of triangles, (F, 3, 3), as coefficients, (4, F)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    return np.stack([*normals.T, -dot_rows(normals, a)])


def _compute_eye(clip_from_model: Float64) -> list[float]:
    """
    Return the eye in model space, four homogeneous numbers: clip x, y and w map it to 0.

    Its product with the plane of a triangle is the determinant of clip x, y and w of the corners,
    which is above 0 where they appear counterclockwise.
    """
    rows = clip_from_model[[0, 1, 3]]
    return [(1.0, -1.0)[k % 2] * _compute_volume(np.delete(rows, k, axis=1)) for k in range(4)]


def _compute_volume(rows: Float64) -> float:
    """Return the signed volume that three vectors, (3, 3), span."""
    a, b, c = rows.tolist()
    return dot(a, cross(b, c))


_SHADOW = Shadow(size=SHADOW_TEX_SZ)
_SHADOW_FLAGS = {
    DirectionalLight: RenderFlags.SHADOWS_DIRECTIONAL,
    SpotLight: RenderFlags.SHADOWS_SPOT,
    PointLight: RenderFlags.SHADOWS_POINT,
}
_MAX_LIGHTS = {DirectionalLight: 4, SpotLight: 4, PointLight: 4}
"""Most lights of a kind that light an object."""
_SPARE_TEXTURES = 26
"""Texture units left for shadow maps: a fragment shader has 32, materials use 6."""
_SHAPE_FLAGS = RenderFlags.DEPTH_ONLY | RenderFlags.SEG
"""Flags that ignore materials: faces are filled and culled."""


class Viewpoint(NamedTuple):
    """The camera and the viewport of a picture."""

    camera: MatrixCamera
    size: tuple[int, int]
    """Width and height of the viewport, pixels."""
    point_size: float
    """Side of points, pixels."""


class LightView(NamedTuple):
    """The shadow map of a light: its camera and depths."""

    camera: MatrixCamera
    depths: NDArray[np.float32]
    """(S, S), as in ``scene.reference_shader.DepthMap``."""


class ConvertedScene(NamedTuple):
    """A scene of RasterJIT's made of one of this adapter."""

    scene: scenes.Scene
    owners: list[Node]
    """The adapter's node of each object."""
    is_blended: bool
    """Whether any object is blended."""
    fades: bool
    """Whether any alpha is below 1, blended or not."""


def check_flags(flags: int) -> RenderFlags:
    """Return the flags, or raise ``ValueError`` if they are none."""
    try:
        return RenderFlags(int(flags))
    except (TypeError, ValueError):
        raise ValueError(f"flags must be RenderFlags, got {flags!r}") from None


def quantize_background(scene: Scene) -> NDArray[np.uint8]:
    """Return the background colour as codes, (4,) uint8."""
    return np.floor(np.clip(scene.bg_color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def decode_background(codes: NDArray[np.uint8], flags: RenderFlags) -> NDArray[np.float32]:
    """Return the linear RGBA, (4,), that a picture shows as these codes."""
    light = decode_codes("as is" if flags & RenderFlags.FLAT else "gamma 2.2")
    return np.append(light[codes[:3]], decode_codes("as is")[codes[3]])


def make_camera(scene: Scene, size: tuple[int, int]) -> MatrixCamera:
    """Return the main camera for a viewport, or raise ``ValueError`` if there is none."""
    node = scene.main_camera_node
    if node is None or node.camera is None:
        raise ValueError("scene must have a camera: add one, such as PerspectiveCamera(yfov=1.0)")
    clip = np.array(node.camera.get_projection_matrix(*size), np.float64)
    return _make_unmirrored_camera(_invert_pose("camera", scene.get_pose(node)), clip)


def _invert_pose(what: str, pose: Float64) -> Float64:
    """Return the inverse of a pose, or raise ``ValueError`` naming whose it is."""
    try:
        return transforms.inverse(pose)
    except ValueError:
        raise ValueError(
            f"pose of the {what} must be finite and have an inverse, got {pose.tolist()}"
        ) from None


def _make_unmirrored_camera(view: Float64, clip: Float64) -> MatrixCamera:
    """Return a camera of two matrices, whose view does not mirror."""
    view[3] = 0.0, 0.0, 0.0, 1.0
    if mirrors(view):
        # Flip x in both: the picture is the same.
        view[0], clip[:, 0] = -view[0], -clip[:, 0]
    return make_matrix_camera(view, clip)


def convert_scene(
    scene: Scene,
    flags: RenderFlags,
    *,
    only: set[Node] | None = None,
    shapes_alone: bool = False,
    alphas_alone: bool = False,
    views: Mapping[Node, LightView] | None = None,
    viewpoint: Viewpoint | None = None,
) -> ConvertedScene:
    """
    Convert a scene with its lights to RasterJIT's, in the order in which nodes were added.

    Parameters
    ----------
    scene : Scene
    flags : RenderFlags
    only : set of Node, optional
        Nodes that are drawn; default: all visible ones.
    shapes_alone : bool
        Whether only depth and numbers are requested: then everything is opaque.
    alphas_alone : bool
        Whether alphas are drawn as greys, without lights.
    views : mapping of Node to LightView, optional
        Shadow maps of lights; other lights have shadows of RasterJIT's.
    viewpoint : Viewpoint, optional
        Needed for points and for culling edges: without it points are left out, and edges of all
        faces are drawn.
    """
    drawn, owners, is_blended, fades = scenes.Scene(), [], False, False
    if alphas_alone:
        flags |= RenderFlags.FLAT
    faces_viewer: list[bool] = []
    are_squares: list[bool] = []
    gains: list[NDArray[np.float32]] = []
    # The shapes, and for each what shading like the reference's reads.
    for node in _drawing_order(scene):
        mesh = node.mesh
        if mesh is None or not mesh.is_visible or (only is not None and node not in only):
            continue
        pose = scene.get_pose(node)
        if not np.isfinite(pose).all():
            continue
        for primitive in mesh.primitives:
            if primitive.is_empty:
                continue
            fades = fades or primitive.fades
            if alphas_alone:
                primitive = primitive.show_alpha()
            material = _make_material(primitive, flags, shapes_alone)
            is_blended = is_blended or material.alpha_mode == "blend"
            for instance_pose in _list_instance_poses(pose, primitive.poses):
                shape, own = _make_shape(primitive, instance_pose, material, flags, viewpoint)
                if shape is not None:
                    drawn.add(shape, own, node.name or "points")
                    owners.append(node)
                    faces_viewer.append(primitive.normals is None)
                    are_squares.append(primitive.mode == GLTF.POINTS)
                    gains.append(primitive.compute_gains())
                lines = _make_normals(primitive, flags)
                if lines is not None:
                    drawn.add(lines, instance_pose, f"normals of {node.name}")
                    owners.append(node)
                    faces_viewer.append(False)
                    are_squares.append(False)
                    gains.append(np.ones(6, np.float32))
    if not shapes_alone:
        drawn._reference_shading = _make_reference_shading(
            drawn, owners, (faces_viewer, are_squares, gains), scene, flags, views or {}
        )
    return ConvertedScene(drawn, owners, is_blended, fades)


def _list_instance_poses(pose: Float64, instances: Float64 | None) -> list[Float64]:
    """Return the finite poses of instances; without instances, the pose alone."""
    if instances is None:
        return [pose]
    return [transforms.compose(pose, own) for own in instances if np.isfinite(own).all()]


def _make_normals(primitive: Primitive, flags: RenderFlags) -> SceneMesh | None:
    """Return the normals that flags request as lines; None if they request none."""
    of_vertices, of_faces = (
        bool(flags & flag) for flag in (RenderFlags.VERTEX_NORMALS, RenderFlags.FACE_NORMALS)
    )
    if not (of_vertices or of_faces):
        return None
    codes = np.round(np.append(NORMAL_COLOR, 1.0) * 255.0).astype(np.uint8)
    return make_normal_lines(primitive, of_vertices, of_faces, decode_background(codes, flags))


def _drawing_order(scene: Scene) -> list[Node]:
    """Return the nodes with meshes, transparent ones last and from far to near."""
    nodes = scene._list_drawn_nodes()
    blended = [node for node in nodes if node.mesh.is_transparent]
    if not blended or scene.main_camera_node is None:
        return nodes
    eye = scene.get_pose(scene.main_camera_node)[:3, 3]
    away = {node: length(scene.get_pose(node)[:3, 3] - eye) for node in blended}
    solid = [node for node in nodes if node not in away]
    return solid + sorted(blended, key=away.__getitem__, reverse=True)


def _make_shape(
    primitive: Primitive,
    pose: Float64,
    material: Material,
    flags: RenderFlags,
    viewpoint: Viewpoint | None,
) -> tuple[SceneMesh | None, Float64]:
    """Return the mesh, lines or squares of a primitive, None for nothing, and their pose."""
    if primitive.mode == GLTF.POINTS:
        is_lit = material.shading == "pbr"
        shape = None if viewpoint is None else _make_squares(primitive, pose, viewpoint, is_lit)
        if shape is not None:
            shape.material = material
        return shape, np.eye(4)
    if primitive.mode in LINE_MODES:
        is_sampled = not flags & RenderFlags.SEG
        depth_offset = LINE_DEPTH_OFFSET if is_sampled else (0.0, 0.0)
        return make_lines(primitive, material, depth_offset), pose
    if _is_wire(primitive, flags):
        culling = None if viewpoint is None or material.double_sided else viewpoint.camera
        return make_edges(primitive, pose, material, culling), pose
    is_turned = viewpoint is not None and is_winding_flipped(viewpoint.camera, pose)
    return primitive.convert(not flags & RenderFlags.FLAT, material, is_turned), pose


def _make_material(primitive: Primitive, flags: RenderFlags, shapes_alone: bool) -> Material:
    """Return the material of a primitive."""
    if flags & _SHAPE_FLAGS:
        return Material("unlit", double_sided=False)
    is_culled = not flags & RenderFlags.SKIP_CULL_FACES and primitive.mode != GLTF.POINTS
    if shapes_alone:
        return Material("unlit", double_sided=primitive.material.doubleSided or not is_culled)
    return primitive.material.convert(
        has_uv=primitive.texcoord_0 is not None and primitive.mode != GLTF.POINTS,
        is_lit=not flags & RenderFlags.FLAT,
        is_culled=is_culled,
        least_alpha=primitive.least_alpha,
    )


def _is_wire(primitive: Primitive, flags: RenderFlags) -> bool:
    """Tell whether a primitive's edges are drawn in place of its faces."""
    if flags & _SHAPE_FLAGS:
        return False
    is_flipped = bool(flags & RenderFlags.FLIP_WIREFRAME)
    return bool(flags & RenderFlags.ALL_WIREFRAME) or primitive.material.wireframe != is_flipped


def _make_reference_shading(
    drawn: scenes.Scene, owners: list[Node],
    object_rows: tuple[list[bool], list[bool], list[NDArray[np.float32]]], scene: Scene,
    flags: RenderFlags, views: Mapping[Node, LightView],
) -> ReferenceShading:  # fmt: skip
    """
    Add the lights; return their radiance, the objects that each lights, and the objects' rows.

    ``object_rows`` tells of each object whether its normals face the viewer, whether it consists of
    squares, and its gains.
    """
    faces_viewer, are_squares, gains = object_rows
    nodes = [node for node in scene._list_nodes() if node.light is not None]
    if flags & RenderFlags.FLAT:
        nodes = []
    # A light of no effect, so that a scene without lights stays without a headlight.
    drawn.lights.append(AmbientLight())
    radiance = np.zeros((len(nodes) + 1, 3), np.float32)
    for n, node in enumerate(nodes, start=1):
        casts = node not in views and casts_shadows(node.light, flags)
        drawn.lights.append(node.light.convert(scene.get_pose(node), _SHADOW if casts else None))
        radiance[n] = node.light.radiance
    light_mask = np.ones((len(owners), len(nodes) + 1), np.uint8)
    kinds = [next(kind for kind in _MAX_LIGHTS if isinstance(node.light, kind)) for node in nodes]
    most = _count_max_lights(flags)
    if any(kinds.count(kind) > most[kind] for kind in _MAX_LIGHTS):
        rows = {node: _mark_nearest_lights(scene, node, nodes, kinds, most) for node in {*owners}}
        light_mask[:, 1:] = [rows[node] for node in owners]
    light_views = ((n, views.get(node)) for n, node in enumerate(nodes, start=1))
    return ReferenceShading(
        "as is" if flags & RenderFlags.FLAT else "gamma 2.2", radiance,
        np.float32(scene.ambient_light), light_mask, np.array(faces_viewer, np.uint8),
        np.array(are_squares, np.uint8), np.array(gains, np.float32).reshape(-1, 6),
        tuple(
            DepthMap(n, transforms.compose(view.camera.clip_from_view, view.camera.view_from_world),
                     view.camera.clip_from_view, view.depths)
            for n, view in light_views if view is not None
        ),
    )  # fmt: skip


def casts_shadows(light: Light, flags: RenderFlags) -> bool:
    """Tell whether flags request shadows of a light's kind."""
    return bool(flags & _SHADOW_FLAGS.get(type(light), RenderFlags.NONE))


def make_light_camera(scene: Scene, node: Node) -> MatrixCamera:
    """
    Return the camera of the shadow map of a directional or spot light.

    Its planes and size are those of pyrender 0.1.45: all of the scene and much around it.
    """
    pose, scale, light = scene.get_pose(node).copy(), float(scene.scale), node.light
    near, far = 0.01 * scale, 10.0 * scale
    if isinstance(light, SpotLight):
        angle = min(2.0 * light.outerConeAngle + math.pi / 16.0, math.pi)
        clip = PerspectiveCamera(angle, near, far, aspectRatio=1.0).get_projection_matrix()
    else:
        pose[:3, 3] = scene.centroid + pose[:3, 2] * scale
        clip = OrthographicCamera(scale, scale, near, far).get_projection_matrix()
    return _make_unmirrored_camera(_invert_pose("light", pose), np.array(clip, np.float64))


def add_lights(drawn: scenes.Scene, added: Sequence[tuple[Light, Float64]]) -> None:
    """Add lights at their poses to a converted scene; they light all objects."""
    before, count = drawn._reference_shading, len(added)
    drawn.lights += [light.convert(pose, None) for light, pose in added]
    radiance = np.array([light.radiance for light, _ in added], np.float32).reshape(-1, 3)
    new_columns = np.ones((len(before.light_mask), count), np.uint8)
    drawn._reference_shading = replace(
        before, radiance=np.concatenate([before.radiance, radiance]),
        light_mask=np.hstack([before.light_mask, new_columns]),
    )  # fmt: skip


def _count_max_lights(flags: RenderFlags) -> dict[type, int]:
    """Return the most lights of each kind that light an object."""
    most, shaded = dict(_MAX_LIGHTS), [kind for kind in _MAX_LIGHTS if flags & _SHADOW_FLAGS[kind]]
    for kind in shaded:
        most[kind] = _SPARE_TEXTURES // len(shaded)
    if DirectionalLight in shaded:
        most[DirectionalLight] += _SPARE_TEXTURES % len(shaded)
    return most


def _mark_nearest_lights(
    scene: Scene, owner: Node, nodes: list[Node], kinds: list[type], most: dict[type, int]
) -> NDArray[np.uint8]:
    """Mark the lights that are among the nearest of their kind to a node, (L,)."""
    position = scene.get_pose(owner)[:3, 3]
    away = [length(scene.get_pose(node)[:3, 3] - position) for node in nodes]
    left, is_near = dict(most), np.zeros(len(nodes), np.uint8)
    for n in np.argsort(away, kind="stable"):
        is_near[n] = left[kinds[n]] > 0
        left[kinds[n]] -= 1
    return is_near


def _make_squares(
    primitive: Primitive, pose: Float64, viewpoint: Viewpoint, is_lit: bool
) -> SceneMesh | None:
    """Return a square that faces the camera at each visible point; None without any."""
    camera, size, point_size = viewpoint
    view, clip = camera.view_matrix(), camera.projection_matrix(size)
    centers = transforms.apply(pose, primitive.positions)
    x, y, z = transforms.apply(view, centers).T
    w = z * clip[3, 2] + clip[3, 3]
    # OpenGL leaves out points outside the picture, even if parts of their squares lie inside.
    across, high = (row[0] * x + row[1] * y + row[2] * z + row[3] for row in clip[:2])
    is_seen = (w > 0.0) & (np.abs(across) <= w) & (np.abs(high) <= w)
    if not is_seen.any():
        return None
    right = point_size / size[0] / clip[0, 0] * view[0, :3]
    up = point_size / size[1] / clip[1, 1] * view[1, :3]
    steps = np.stack([-right - up, right - up, right + up, up - right])
    corners = centers[is_seen, None] + w[is_seen, None, None] * steps
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + (0, 1, 2), first + (0, 2, 3)], axis=1).reshape(-1, 3)
    if primitive.normals is None:
        normals = camera.eye_position() - centers
    else:
        # Normals of a transform are turned by its inverse transpose.
        rows = transforms.normal_matrix(pose)[:, :, None]
        x, y, z = zero_nonfinite(primitive.normals).T
        normals = (rows[:, 0] * x + rows[:, 1] * y + rows[:, 2] * z).T
    colors = primitive.get_colors(is_lit)
    return SceneMesh(
        corners.reshape(-1, 3), faces, normals=np.repeat(normals[is_seen], 4, axis=0),
        colors=None if colors is None else np.repeat(colors[is_seen], 4, axis=0),
    )  # fmt: skip
