"""Turn a scene of the adapter's into one of RasterJIT's."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.constants import GLTF, REFUSED, RenderFlags
from rasterjit.compat.pyrender.light import DirectionalLight, PointLight, SpotLight
from rasterjit.compat.pyrender.node import Node
from rasterjit.compat.pyrender.primitive import Primitive
from rasterjit.compat.pyrender.scene import Scene
from rasterjit.io.cameras import view_from_pose
from rasterjit.scene import scene as scenes
from rasterjit.scene import transforms
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.light import AmbientLight, Shadow
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh as SceneMesh

Float64 = NDArray[np.float64]

_SHADOW = Shadow(size=2048)
_SHADOW_FLAGS = {
    DirectionalLight: RenderFlags.SHADOWS_DIRECTIONAL,
    SpotLight: RenderFlags.SHADOWS_SPOT,
    PointLight: RenderFlags.SHADOWS_POINT,
}


class Drawing(NamedTuple):
    """A scene as RasterJIT draws it."""

    scene: scenes.Scene
    owners: list[Node]
    """The node that each of its objects belongs to."""
    is_blended: bool
    """Whether anything is seen through."""


def check_flags(flags: int) -> RenderFlags:
    """Return the flags, or raise ``ValueError`` if they cannot be honoured."""
    try:
        found = RenderFlags(int(flags))
    except (TypeError, ValueError):
        raise ValueError(f"flags must be RenderFlags, got {flags!r}") from None
    if found & REFUSED:
        raise ValueError(f"flags must not hold {found & REFUSED!r}: normals are not drawn as lines")
    return found


def background_codes(scene: Scene) -> NDArray[np.uint8]:
    """Return the background, (4,) uint8, as the picture shows it."""
    return np.floor(np.clip(scene.bg_color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def camera_of(scene: Scene, size: tuple[int, int]) -> MatrixCamera:
    """Return the main camera for a viewport, or raise ``ValueError`` if there is none."""
    node = scene.main_camera_node
    if node is None or node.camera is None:
        raise ValueError("scene must have a camera: add one, such as PerspectiveCamera(yfov=1.0)")
    projection = node.camera.get_projection_matrix(*size)
    return MatrixCamera(view_from_pose(scene.get_pose(node)), projection)


def convert(
    scene: Scene,
    flags: RenderFlags,
    *,
    only: set[Node] | None = None,
    shapes_alone: bool = False,
    points: tuple[MatrixCamera, tuple[int, int], float] | None = None,
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
    points : (MatrixCamera, (int, int), float), optional
        Camera, viewport and size in pixels of points; without it they are left out.
    """
    is_lit = not flags & RenderFlags.FLAT
    drawn, owners, wires, is_blended = scenes.Scene(), [], [], False
    for node in scene._ordered():
        mesh = node.mesh
        if mesh is None or not mesh.is_visible or (only is not None and node not in only):
            continue
        pose = scene.get_pose(node)
        for primitive in mesh.primitives:
            if primitive.is_empty:
                continue
            look = _material(primitive, flags, shapes_alone)
            is_blended = is_blended or look.alpha_mode == "blend"
            for instance in [np.eye(4)] if primitive.poses is None else primitive.poses:
                place = transforms.compose(pose, instance)
                if primitive.mode == GLTF.POINTS:
                    squares = (
                        None if points is None else _squares(primitive, place, is_lit, *points)
                    )
                    if squares is None:
                        continue
                    squares.material = look
                    drawn.add(squares, name=node.name or "points")
                else:
                    drawn.add(primitive.drawn(is_lit, look), place, node.name)
                    wires.append((_is_wire(primitive, flags), look))
                owners.append(node)
    drawn.wireframe = _wireframe(wires)
    if not shapes_alone:
        _light(drawn, scene, flags)
    return Drawing(drawn, owners, is_blended)


def _material(primitive: Primitive, flags: RenderFlags, shapes_alone: bool) -> Material:
    """Return the look of a primitive."""
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
    if flags & RenderFlags.ALL_SOLID:
        return False
    is_flipped = bool(flags & RenderFlags.FLIP_WIREFRAME)
    return bool(flags & RenderFlags.ALL_WIREFRAME) or primitive.material.wireframe != is_flipped


def _wireframe(wires: list[tuple[bool, Material]]) -> scenes.Wireframe | None:
    """Return how edges are drawn, or raise ``ValueError`` if only some meshes' are."""
    if not any(is_wire for is_wire, _ in wires):
        return None
    if not all(is_wire for is_wire, _ in wires):
        raise ValueError(
            "wireframe must be that of all meshes or of none; RenderFlags.ALL_WIREFRAME draws all "
            "edges, ALL_SOLID all faces"
        )
    return scenes.Wireframe(wires[0][1].base_color_over(False), "only")


def _light(drawn: scenes.Scene, scene: Scene, flags: RenderFlags) -> None:
    """Add the lights; even none at all is light that was chosen."""
    most = max(1.0, float(scene.ambient_light.max()))
    drawn.lights.append(AmbientLight((scene.ambient_light / most).tolist(), most))
    for node in scene._ordered():
        if node.light is not None:
            casts = flags & _SHADOW_FLAGS.get(type(node.light), RenderFlags.NONE)
            drawn.lights.append(node.light.placed(scene.get_pose(node), _SHADOW if casts else None))


def _squares(
    primitive: Primitive,
    place: Float64,
    is_lit: bool,
    camera: MatrixCamera,
    size: tuple[int, int],
    point_size: float,
) -> SceneMesh | None:
    """Return a square of so many pixels that faces the camera at each point in front of it."""
    view, clip = camera.view_matrix(), camera.projection_matrix(size)
    centers = transforms.apply(place, primitive.positions)
    depth = -transforms.apply(view, centers)[:, 2]
    w = depth * -clip[3, 2] + clip[3, 3]
    seen = w > 0.0
    if not seen.any():
        return None
    right = point_size / size[0] / clip[0, 0] * view[0, :3]
    up = point_size / size[1] / clip[1, 1] * view[1, :3]
    steps = np.stack([-right - up, right - up, right + up, up - right])
    corners = centers[seen, None] + w[seen, None, None] * steps
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + (0, 1, 2), first + (0, 2, 3)], axis=1).reshape(-1, 3)
    if primitive.normals is None:
        normals = camera.eye_position() - centers
    else:
        # Normals of a transform are turned by its inverse transpose.
        rows = transforms.normal_matrix(place)[:, :, None]
        x, y, z = primitive.normals.T
        normals = (rows[:, 0] * x + rows[:, 1] * y + rows[:, 2] * z).T
    colors = primitive.colors(is_lit)
    return SceneMesh(
        corners.reshape(-1, 3), faces, normals=np.repeat(normals[seen], 4, axis=0),
        colors=None if colors is None else np.repeat(colors[seen], 4, axis=0),
    )  # fmt: skip
