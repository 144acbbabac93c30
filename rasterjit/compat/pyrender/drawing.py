"""Turn a scene of the adapter's into one of RasterJIT's."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.opengl_camera import matrix_camera
from rasterjit.compat.pyrender.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.compat.pyrender.constants import GLTF, SHADOW_TEX_SZ, RenderFlags
from rasterjit.compat.pyrender.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.primitive import Primitive, finite
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

WIDTH = 1.0
"""Of lines, pixels."""

DEPTH_OFFSET = 0.5, 0.5
"""
Where Mesa takes depths and attributes of lines from, with several samples a pixel: half a pixel to
the right of each and above it, which is below in pictures that are drawn upside down.
"""

NORMAL_COLOR = 0.1, 0.1, 1.0
"""What normals are drawn in, shares of 255."""

NORMAL_LENGTH = 0.05
"""Of normals, of their primitive's scale."""


class LitLines(Lines):
    """
    Lines that have normals and texture coordinates, so that any material will do.

    Parameters
    ----------
    points : (V, 3) array_like
    segments : (S, 2) array_like of int
    normals : (V, 3) array_like, optional
        Of any length; they change along segments.
    uv : (V, 2) array_like, optional
    colors : (V, 4) array_like, optional
    material : Material
    depth_offset : (float, float)
        Where depths and attributes are taken from: how far to the right of each sample and below
        it, pixels.

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
            points, segments, colors=colors, width=WIDTH, caps="butt", material=material,
            on_invalid="drop",
        )  # fmt: skip
        self._depth_offset = depth_offset
        # What lines have none of by themselves, checked as that of faces is.
        own = Mesh(points, [[0, 0, 0]], normals=normals, uv=uv, on_invalid="drop")
        self._normals = self._vertex_normals = own.normals
        self._uv = own.uv

    @property
    def links(self) -> NDArray[np.int32]:
        """(S, 2) int32: -1, for nothing is joined."""
        if self._links is None:
            self._links = np.full((len(self), 2), -1, np.int32)
        return self._links

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        Mesh._check_material(name, value)

    def picked(self, is_picked: NDArray[np.bool_]) -> LitLines:
        """Return some of the segments, (S,) bool, of the same points."""
        some = copy.copy(self)
        some._faces = read_only(self._faces[is_picked])
        some._links = some._bounds = None
        return some

    def shown_by(self, material: Material) -> LitLines:
        """Return the lines under another material."""
        if self._material == material:
            return self
        other = copy.copy(self)
        other.material = material
        return other


class _Edges:
    """The edges of a primitive's faces."""

    def __init__(self, primitive: Primitive, look: Material) -> None:
        faces = primitive.faces()
        self._segments, self._of_faces = _edges_between(faces)
        self._planes = _planes_of(primitive.positions.astype(np.float64)[faces])
        self._all = _lit_lines(primitive, self._segments, look, DEPTH_OFFSET)
        self._eye: Float64 | None = None
        self._drawn: tuple[NDArray[np.bool_], LitLines] | None = None

    def all_of_them(self, look: Material) -> LitLines:
        """Return all edges."""
        self._all = self._all.shown_by(look)
        return self._all

    def of_front_faces(self, look: Material, clip_from_model: Float64) -> LitLines | None:
        """Return the edges of faces that are seen counterclockwise, or None without any."""
        eye = _eye_of(clip_from_model)
        if self._eye is None or not np.array_equal(self._eye, eye):
            self._pick(eye)
            self._eye = eye
        if self._drawn is None:
            return None
        self._drawn = self._drawn[0], self._drawn[1].shown_by(look)
        return self._drawn[1]

    def _pick(self, eye: Float64) -> None:
        """Find what is drawn where the eye is here, (4,); with w 0 it is infinitely far away."""
        # Which side of a plane it is on.
        (a, b, c, d), (x, y, z, w) = self._planes, eye
        is_front = ((a * x + b * y) + c * z) + d * w > 0.0
        is_picked = np.zeros(len(self._segments), np.bool_)
        is_picked[self._of_faces[is_front]] = True
        if not is_picked.any():
            self._drawn = None
        elif self._drawn is None or not np.array_equal(self._drawn[0], is_picked):
            self._drawn = is_picked, self._all.picked(is_picked)


def edges_of(
    primitive: Primitive, place: Float64, look: Material, camera: MatrixCamera | None
) -> LitLines | None:
    """
    Return the edges of a primitive's triangles, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    place : (4, 4) float64
        ``world_from_model``.
    look : Material
    camera : MatrixCamera, optional
        What culls faces; without it all have edges.
    """
    key = "edges", look.shading
    if key not in primitive._drawn:
        primitive._drawn[key] = _Edges(primitive, look)
    edges: _Edges = primitive._drawn[key]
    if camera is None:
        return edges.all_of_them(look)
    clip_from_model = transforms.compose(camera.clip_from_view, camera.view_from_world, place)
    return edges.of_front_faces(look, clip_from_model)


def lines_of(
    primitive: Primitive, look: Material, depth_offset: tuple[float, float] = DEPTH_OFFSET
) -> LitLines | None:
    """
    Return the lines of a primitive of lines, a loop or a strip, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    look : Material
    depth_offset : (float, float)
        Where depths and attributes are taken from; see `LitLines`.
    """
    segments = _segments_of(primitive)
    if not len(segments):
        return None
    key = "lines", look.shading, depth_offset
    known = primitive._drawn.get(key) or _lit_lines(primitive, segments, look, depth_offset)
    primitive._drawn[key] = known.shown_by(look)
    return primitive._drawn[key]


def _lit_lines(
    primitive: Primitive,
    segments: NDArray[np.int64],
    look: Material,
    depth_offset: tuple[float, float],
) -> LitLines:
    """Return lines between vertices of a primitive."""
    return LitLines(
        primitive.positions, segments, normals=finite(primitive.normals),
        uv=finite(primitive.texcoord_0), colors=primitive.colors(look.shading == "pbr"),
        material=look, depth_offset=depth_offset,
    )  # fmt: skip


def normals_of(
    primitive: Primitive, of_vertices: bool, of_faces: bool, color: NDArray[np.float32]
) -> Lines | None:
    """
    Return a primitive's normals as lines, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    of_vertices, of_faces : bool
        Of which there are normals. Points have those of vertices.
    color : (4,) float32, linear
    """
    if primitive.normals is None:
        return None
    starts, ways = [], []
    faces, positions = primitive.faces(), primitive.positions.astype(np.float64)
    if of_vertices or not len(faces):
        starts.append(positions)
        ways.append(unit_rows(primitive.normals.astype(np.float64)))
    if of_faces and len(faces):
        a, b, c = np.moveaxis(positions[faces], 1, 0)
        starts.append((a + b + c) / 3.0)
        ways.append(unit_rows(np.cross(b - a, c - a)))
    if not starts:
        return None
    first = np.concatenate(starts)
    last = first + NORMAL_LENGTH * float(primitive.scale) * np.concatenate(ways)
    numbers = np.arange(len(first))
    return Lines(
        np.concatenate([first, last]), np.stack([numbers, numbers + len(first)], axis=1),
        colors=np.tile(color, (len(first), 1)), width=WIDTH, caps="butt", on_invalid="drop",
    )  # fmt: skip


def turns(camera: MatrixCamera, place: Float64) -> bool:
    """
    Tell whether front faces are seen clockwise, so that OpenGL takes them for back faces.

    It goes by the picture alone: mirrored poses and projections turn faces over.
    """
    clip = camera.clip_from_view
    # What grows with depth: w of a perspective, else z.
    deep = 3 if clip[3, :3].any() else 2
    return (_volume(clip[[0, 1, deep], :3]) > 0.0) != (_volume(place[:3, :3]) < 0.0)


def _segments_of(primitive: Primitive) -> NDArray[np.int64]:
    """Return the numbers of the points at the ends of each segment, (S, 2)."""
    numbers = primitive.order()
    if primitive.mode == GLTF.LINES:
        return numbers[: len(numbers) // 2 * 2].reshape(-1, 2)
    ends = np.roll(numbers, -1) if primitive.mode == GLTF.LINE_LOOP else numbers[1:]
    return np.stack([numbers[: len(ends)], ends], axis=1)


def _edges_between(
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


def _planes_of(corners: Float64) -> Float64:
    """Return the planes of triangles, (F, 3, 3), whose product with a point is a volume, (4, F)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    return np.stack([*normals.T, -dot_rows(normals, a)])


def _eye_of(clip_from_model: Float64) -> list[float]:
    """
    Return the point that clip x, y and w take to 0, four numbers, homogeneous.

    Its product with a plane is the determinant of clip x, y and w of three of its points, which is
    above 0 where they are seen counterclockwise.
    """
    rows = clip_from_model[[0, 1, 3]]
    return [(1.0, -1.0)[k % 2] * _volume(np.delete(rows, k, axis=1)) for k in range(4)]


def _volume(rows: Float64) -> float:
    """Return the signed volume that three vectors, (3, 3), span."""
    a, b, c = rows.tolist()
    return dot(a, cross(b, c))


_SHADOW = Shadow(size=SHADOW_TEX_SZ)
_SHADOW_FLAGS = {
    DirectionalLight: RenderFlags.SHADOWS_DIRECTIONAL,
    SpotLight: RenderFlags.SHADOWS_SPOT,
    PointLight: RenderFlags.SHADOWS_POINT,
}
_MAX = {DirectionalLight: 4, SpotLight: 4, PointLight: 4}
"""Most lights of a kind that fall on an object."""
_SPARE_TEXTURES = 26
"""Textures that are left for shadow maps where a fragment shader has 32 and materials 6."""
_SHAPE_FLAGS = RenderFlags.DEPTH_ONLY | RenderFlags.SEG
"""Flags with which materials do not count: faces are filled, and culled."""


class Seen(NamedTuple):
    """How a scene is seen."""

    camera: MatrixCamera
    size: tuple[int, int]
    """Of the viewport, pixels."""
    point_size: float
    """Side of points, pixels."""


class LightView(NamedTuple):
    """What a light sees."""

    camera: MatrixCamera
    depths: NDArray[np.float32]
    """(S, S): as ``scene.reference_shader.DepthMap`` has them."""


class Drawing(NamedTuple):
    """A scene as RasterJIT draws it."""

    scene: scenes.Scene
    owners: list[Node]
    """The node that each of its objects belongs to."""
    is_blended: bool
    """Whether anything is seen through."""
    fades: bool
    """Whether any alpha is below 1, seen through or not."""


def check_flags(flags: int) -> RenderFlags:
    """Return the flags, or raise ``ValueError`` if they are none."""
    try:
        return RenderFlags(int(flags))
    except (TypeError, ValueError):
        raise ValueError(f"flags must be RenderFlags, got {flags!r}") from None


def background_codes(scene: Scene) -> NDArray[np.uint8]:
    """Return the background, (4,) uint8, as the picture shows it."""
    return np.floor(np.clip(scene.bg_color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def background_light(codes: NDArray[np.uint8], flags: RenderFlags) -> NDArray[np.float32]:
    """Return what is shown as codes, (4,)."""
    light = decode_codes("as is" if flags & RenderFlags.FLAT else "gamma 2.2")
    return np.append(light[codes[:3]], decode_codes("as is")[codes[3]])


def camera_of(scene: Scene, size: tuple[int, int]) -> MatrixCamera:
    """Return the main camera for a viewport, or raise ``ValueError`` if there is none."""
    node = scene.main_camera_node
    if node is None or node.camera is None:
        raise ValueError("scene must have a camera: add one, such as PerspectiveCamera(yfov=1.0)")
    clip = np.array(node.camera.get_projection_matrix(*size), np.float64)
    return _camera(_inverse_of("camera", scene.get_pose(node)), clip)


def _inverse_of(what: str, pose: Float64) -> Float64:
    """Return the inverse of a pose, or raise ``ValueError`` naming whose it is."""
    try:
        return transforms.inverse(pose)
    except ValueError:
        raise ValueError(
            f"pose of the {what} must be finite and have an inverse, got {pose.tolist()}"
        ) from None


def _camera(view: Float64, clip: Float64) -> MatrixCamera:
    """Return a camera of these matrices."""
    view[3] = 0.0, 0.0, 0.0, 1.0
    if mirrors(view):
        # The same picture, of axes that are a right hand's.
        view[0], clip[:, 0] = -view[0], -clip[:, 0]
    return matrix_camera(view, clip)


def convert(
    scene: Scene,
    flags: RenderFlags,
    *,
    only: set[Node] | None = None,
    shapes_alone: bool = False,
    alphas_alone: bool = False,
    views: Mapping[Node, LightView] | None = None,
    seen: Seen | None = None,
) -> Drawing:
    """
    Return a scene with its lights, in the order in which nodes were added.

    Parameters
    ----------
    scene : Scene
    flags : RenderFlags
    only : set of Node, optional
        What is drawn; default: all that is visible.
    shapes_alone : bool
        Whether nothing but depth and numbers is asked for: then all is opaque.
    alphas_alone : bool
        Whether alphas are shown as greys, without lights.
    views : mapping of Node to LightView, optional
        What lights see; shadows of others are those of RasterJIT.
    seen : Seen, optional
        How it is seen; without it points are left out, and edges of all faces are drawn.
    """
    drawn, owners, is_blended, fades = scenes.Scene(), [], False, False
    if alphas_alone:
        flags |= RenderFlags.FLAT
    faces_viewer: list[bool] = []
    are_squares: list[bool] = []
    gains: list[NDArray[np.float32]] = []
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
                primitive = primitive.of_alphas()
            look = _material(primitive, flags, shapes_alone)
            is_blended = is_blended or look.alpha_mode == "blend"
            for place in [pose] if primitive.poses is None else _places(pose, primitive.poses):
                shape, own = _shape(primitive, place, look, flags, seen)
                if shape is not None:
                    drawn.add(shape, own, node.name or "points")
                    owners.append(node)
                    faces_viewer.append(primitive.normals is None)
                    are_squares.append(primitive.mode == GLTF.POINTS)
                    gains.append(primitive.gains())
                lines = _normals(primitive, flags)
                if lines is not None:
                    drawn.add(lines, place, f"normals of {node.name}")
                    owners.append(node)
                    faces_viewer.append(False)
                    are_squares.append(False)
                    gains.append(np.ones(6, np.float32))
    if not shapes_alone:
        of_objects = faces_viewer, are_squares, gains
        drawn._reference = _imitation(drawn, owners, of_objects, scene, flags, views or {})
    return Drawing(drawn, owners, is_blended, fades)


def _places(pose: Float64, instances: Float64) -> list[Float64]:
    """Return where instances stand whose poses are finite."""
    return [transforms.compose(pose, own) for own in instances if np.isfinite(own).all()]


def _normals(primitive: Primitive, flags: RenderFlags) -> SceneMesh | None:
    """Return the normals that flags ask for as lines, None without any."""
    of_vertices, of_faces = (
        bool(flags & flag) for flag in (RenderFlags.VERTEX_NORMALS, RenderFlags.FACE_NORMALS)
    )
    if not (of_vertices or of_faces):
        return None
    codes = np.round(np.append(NORMAL_COLOR, 1.0) * 255.0).astype(np.uint8)
    return normals_of(primitive, of_vertices, of_faces, background_light(codes, flags))


def _drawing_order(scene: Scene) -> list[Node]:
    """Return the nodes that have meshes, those seen through last and from far to near."""
    nodes = scene._drawn()
    blended = [node for node in nodes if node.mesh.is_transparent]
    if not blended or scene.main_camera_node is None:
        return nodes
    eye = scene.get_pose(scene.main_camera_node)[:3, 3]
    away = {node: length(scene.get_pose(node)[:3, 3] - eye) for node in blended}
    solid = [node for node in nodes if node not in away]
    return solid + sorted(blended, key=away.__getitem__, reverse=True)


def _shape(
    primitive: Primitive, place: Float64, look: Material, flags: RenderFlags, seen: Seen | None
) -> tuple[SceneMesh | None, Float64]:
    """Return what a primitive is drawn by, None if by nothing, and its pose."""
    if primitive.mode == GLTF.POINTS:
        is_lit = look.shading == "pbr"
        shape = None if seen is None else _squares(primitive, place, seen, is_lit)
        if shape is not None:
            shape.material = look
        return shape, np.eye(4)
    if primitive.mode in LINE_MODES:
        is_sampled = not flags & RenderFlags.SEG
        depth_offset = DEPTH_OFFSET if is_sampled else (0.0, 0.0)
        return lines_of(primitive, look, depth_offset), place
    if _is_wire(primitive, flags):
        culling = None if seen is None or look.double_sided else seen.camera
        return edges_of(primitive, place, look, culling), place
    is_turned = seen is not None and turns(seen.camera, place)
    return primitive.drawn(not flags & RenderFlags.FLAT, look, is_turned), place


def _material(primitive: Primitive, flags: RenderFlags, shapes_alone: bool) -> Material:
    """Return the look of a primitive."""
    if flags & _SHAPE_FLAGS:
        return Material("unlit", double_sided=False)
    is_culled = not flags & RenderFlags.SKIP_CULL_FACES and primitive.mode != GLTF.POINTS
    if shapes_alone:
        return Material("unlit", double_sided=primitive.material.doubleSided or not is_culled)
    return primitive.material.drawn(
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


def _imitation(
    drawn: scenes.Scene, owners: list[Node],
    ways: tuple[list[bool], list[bool], list[NDArray[np.float32]]], scene: Scene,
    flags: RenderFlags, views: Mapping[Node, LightView],
) -> ReferenceShading:  # fmt: skip
    """
    Add the lights; return how bright they are, what they fall on and what codes show of it.

    ``ways`` tells of each object whether its normals face the viewer, whether it is of squares, and
    its gains.
    """
    nodes = [node for node in scene._ordered() if node.light is not None]
    if flags & RenderFlags.FLAT:
        nodes = []
    # What is black by intent is lit, too.
    drawn.lights.append(AmbientLight())
    radiance = np.zeros((len(nodes) + 1, 3), np.float32)
    for n, node in enumerate(nodes, start=1):
        casts = node not in views and casts_shadows(node.light, flags)
        drawn.lights.append(node.light.placed(scene.get_pose(node), _SHADOW if casts else None))
        radiance[n] = node.light.radiance
    taken = np.ones((len(owners), len(nodes) + 1), np.uint8)
    kinds = [next(kind for kind in _MAX if isinstance(node.light, kind)) for node in nodes]
    most = _most_lights(flags)
    if any(kinds.count(kind) > most[kind] for kind in _MAX):
        rows = {node: _nearest(scene, node, nodes, kinds, most) for node in {*owners}}
        taken[:, 1:] = [rows[node] for node in owners]
    return ReferenceShading(
        "as is" if flags & RenderFlags.FLAT else "gamma 2.2", radiance,
        np.float32(scene.ambient_light), taken, np.array(ways[0], np.uint8),
        np.array(ways[1], np.uint8), np.array(ways[2], np.float32).reshape(-1, 6),
        tuple(
            DepthMap(n, transforms.compose(seen.camera.clip_from_view, seen.camera.view_from_world),
                     seen.camera.clip_from_view, seen.depths)
            for n, seen in ((n, views.get(node)) for n, node in enumerate(nodes, start=1))
            if seen is not None
        ),
    )  # fmt: skip


def casts_shadows(light: Light, flags: RenderFlags) -> bool:
    """Tell whether flags ask for a light's shadows."""
    return bool(flags & _SHADOW_FLAGS.get(type(light), RenderFlags.NONE))


def camera_of_light(scene: Scene, node: Node) -> MatrixCamera:
    """
    Return the camera that a directional or spot light sees the scene by.

    The planes and sizes are those of pyrender 0.1.45: all of the scene and much around it.
    """
    pose, scale, light = scene.get_pose(node).copy(), float(scene.scale), node.light
    near, far = 0.01 * scale, 10.0 * scale
    if isinstance(light, SpotLight):
        angle = min(2.0 * light.outerConeAngle + math.pi / 16.0, math.pi)
        clip = PerspectiveCamera(angle, near, far, aspectRatio=1.0).get_projection_matrix()
    else:
        pose[:3, 3] = scene.centroid + pose[:3, 2] * scale
        clip = OrthographicCamera(scale, scale, near, far).get_projection_matrix()
    return _camera(_inverse_of("light", pose), np.array(clip, np.float64))


def add_lights(drawn: scenes.Scene, added: Sequence[tuple[Light, Float64]]) -> None:
    """Add lights at their poses to a scene that was converted; they fall on all objects."""
    before, count = drawn._reference, len(added)
    drawn.lights += [light.placed(pose, None) for light, pose in added]
    radiance = np.array([light.radiance for light, _ in added], np.float32).reshape(-1, 3)
    taken = np.ones((len(before.light_mask), count), np.uint8)
    drawn._reference = replace(
        before, radiance=np.concatenate([before.radiance, radiance]),
        light_mask=np.hstack([before.light_mask, taken]),
    )  # fmt: skip


def _most_lights(flags: RenderFlags) -> dict[type, int]:
    """Return how many lights of a kind fall on an object."""
    most, shaded = dict(_MAX), [kind for kind in _MAX if flags & _SHADOW_FLAGS[kind]]
    for kind in shaded:
        most[kind] = _SPARE_TEXTURES // len(shaded)
    if DirectionalLight in shaded:
        most[DirectionalLight] += _SPARE_TEXTURES % len(shaded)
    return most


def _nearest(
    scene: Scene, owner: Node, nodes: list[Node], kinds: list[type], most: dict[type, int]
) -> NDArray[np.uint8]:
    """Return 1 for each light that is among the nearest of its kind to a node, else 0."""
    place = scene.get_pose(owner)[:3, 3]
    away = [length(scene.get_pose(node)[:3, 3] - place) for node in nodes]
    left, taken = dict(most), np.zeros(len(nodes), np.uint8)
    for n in np.argsort(away, kind="stable"):
        taken[n] = left[kinds[n]] > 0
        left[kinds[n]] -= 1
    return taken


def _squares(primitive: Primitive, place: Float64, seen: Seen, is_lit: bool) -> SceneMesh | None:
    """Return a square of so many pixels that faces the camera at each point in front of it."""
    camera, size, point_size = seen
    view, clip = camera.view_matrix(), camera.projection_matrix(size)
    centers = transforms.apply(place, primitive.positions)
    x, y, z = transforms.apply(view, centers).T
    w = z * clip[3, 2] + clip[3, 3]
    # OpenGL leaves out points that lie outside the picture, whatever of their squares does not.
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
        rows = transforms.normal_matrix(place)[:, :, None]
        x, y, z = finite(primitive.normals).T
        normals = (rows[:, 0] * x + rows[:, 1] * y + rows[:, 2] * z).T
    colors = primitive.colors(is_lit)
    return SceneMesh(
        corners.reshape(-1, 3), faces, normals=np.repeat(normals[is_seen], 4, axis=0),
        colors=None if colors is None else np.repeat(colors[is_seen], 4, axis=0),
    )  # fmt: skip
