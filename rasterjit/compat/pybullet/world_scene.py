"""A scene whose nodes follow the visual shapes of a client of PyBullet."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from rasterjit.compat.pybullet.noted_calls import GivenMesh, get_notes
from rasterjit.compat.unit_shapes import (
    Triangulation,
    join,
    make_rectangle,
    make_unit_shape,
    scale_and_shift,
)
from rasterjit.io.meshes import load
from rasterjit.scene.color import decoding_table
from rasterjit.scene.light import AmbientLight, DirectionalLight, Shadow
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.validation import read_only
from rasterjit.scene.warning import warn_caller

Float64 = NDArray[np.float64]

BASE = -1
"""PyBullet's number of the link that is a body's base."""

LINK_SHIFT = 24
"""Bit of a segmentation's value from which on it counts links."""

RIGID_BODY, SOFT_BODY = 1, 3
"""Types of bodies in ``getDynamicsInfo``: of maximal coordinates, and soft ones."""

SHADOW_SHARE = 0.2
"""Share of the light that a shadow takes, as TinyRenderer has it."""

SHADOW_TEXELS = 2048
"""Side of a shadow map, which covers what is seen: mostly a floor up to the far plane."""

SHININESS = 2.0
"""Exponent of highlights."""

SLICES, STACKS = 24, 12
"""Divisions of round shapes around their axis and along it."""

PLANE_HALF_SIZE = 128.0
"""Half the side of the square that stands for a plane."""

BOX_SIDES = (
    ((0.125, 0.375), (0.0, 0.0, -0.25), (0.0, -0.25, 0.0)),
    ((0.625, 0.125), (0.0, 0.25, 0.0), (0.0, 0.0, 0.25)),
    ((0.125, 0.125), (0.25, 0.0, 0.0), (0.0, 0.0, 0.25)),
    ((0.375, 0.375), (0.25, 0.0, 0.0), (0.0, 0.0, -0.25)),
    ((0.875, 0.125), (0.25, 0.0, 0.0), (0.0, -0.25, 0.0)),
    ((0.375, 0.125), (-0.25, 0.0, 0.0), (0.0, -0.25, 0.0)),
)
"""Of the sides of a box, +x, -x, +y, -y, +z and -z: uv in the middle, and what u and v are by."""

CHECKER = np.array([[(173, 199, 255), (255, 255, 255)], [(255, 255, 255), (173, 199, 255)]])
"""Texels of what planes show, (2, 2, 3)."""


class LightSettings(NamedTuple):
    """Arguments of `getCameraImage` that light depends on."""

    direction: tuple[float, ...]
    """Towards the light, of unit length."""
    color: tuple[float, ...]
    has_shadow: bool
    ambient: float
    diffuse: float
    specular: float


class Part(NamedTuple):
    """What is drawn as one node."""

    mesh: Mesh
    source: Mesh
    """The mesh of the same shape that it is a copy of."""
    local: Float64
    """Its place in the frame of its link, (4, 4)."""
    link: int


class Body(NamedTuple):
    """What is drawn of a body, and what it was made from."""

    key: Any
    parts: list[Part]
    nodes: list[Node]
    links: list[int]
    """Links with shapes, but the base."""
    is_soft: bool


class WorldScene(Scene):
    """
    A scene whose nodes follow a client's bodies; `follow` updates it.

    Light is computed with sRGB codes, as OpenGL does it, for pictures of the output ``"linear"``.

    Parameters
    ----------
    client : int
    """

    def __init__(self, client: int) -> None:
        super().__init__()
        self._notes = get_notes(client)
        self._numbers = np.full(1, -1, np.int32)
        self._client, self._bodies = client, dict[int, Body]()
        self._light: Any = None
        self._warned: set[str] = set()

    def follow(self, light: LightSettings, is_opaque: bool) -> None:
        """
        Update nodes and light to the world as it is.

        Parameters
        ----------
        light : LightSettings
        is_opaque : bool
            Whether nothing is seen through.
        """
        self._set_light(light)
        # Highlights follow one ratio of the specular to the diffuse light.
        look = is_opaque, light.specular / max(light.diffuse, 1e-6)
        client, keys, missing = self._client, dict[int, Any](), list[str]()
        for n in range(pybullet.getNumBodies(physicsClientId=client)):
            number = pybullet.getBodyUniqueId(n, physicsClientId=client)
            shapes = pybullet.getVisualShapeData(number, 1, physicsClientId=client)
            keys[number] = shapes, look, (self._notes.version, self._notes.versions[number])
        old = self._bodies
        kept = {number: body for number, body in old.items() if keys.get(number) == body.key}
        # Meshes of what has changed its colour, or stood in an earlier world, serve again.
        spare: dict[int, list[Mesh]] = {}
        for part in (part for n, body in old.items() if n not in kept for part in body.parts):
            spare.setdefault(id(part.source), []).append(part.mesh)
        bodies = {
            number: kept.get(number) or self._make_body(number, key, spare, missing)
            for number, key in keys.items()
        }
        if [*map(id, bodies.values())] != [*map(id, self._bodies.values())]:
            self._bodies = bodies
            self.nodes[:] = [node for body in bodies.values() for node in body.nodes]
            numbers = [
                number + ((part.link + 1) << LINK_SHIFT)
                for number, body in bodies.items()
                for part in body.parts
            ]
            self._numbers = np.array([*numbers, -1], np.int64).astype(np.int32)
        self._place_nodes()
        self.warn(missing)

    @property
    def is_current(self) -> bool:
        """Whether the client is still the one that the scene was made for."""
        return self._notes is get_notes(self._client)

    @property
    def numbers(self) -> NDArray[np.int32]:
        """Segmentation with links of each node, and of none, (O + 1,)."""
        return self._numbers

    def warn(self, missing: Iterable[str]) -> None:
        """Warn once of each thing that is not drawn."""
        new = [name for name in dict.fromkeys(missing) if name not in self._warned]
        if new:
            self._warned.update(new)
            warn_caller(f"not drawn: {', '.join(new)}")

    # Poses.

    def _place_nodes(self) -> None:
        """Move all nodes to where the links of their bodies are."""
        client = self._client
        frames, rows, locals_ = list[Any](), list[int](), list[Float64]()
        for number, body in self._bodies.items():
            first = {BASE: len(frames)}
            if body.is_soft:
                # Its vertices are told in the world.
                frames.append((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
                self._deform(number, body)
            else:
                place = pybullet.getBasePositionAndOrientation(number, physicsClientId=client)
                frames.append((*place[0], *place[1]))
            if body.links:
                first.update({link: len(frames) + k for k, link in enumerate(body.links)})
                states = pybullet.getLinkStates(number, body.links, physicsClientId=client)
                frames.extend((*state[4], *state[5]) for state in states)
            rows.extend(first[part.link] for part in body.parts)
            locals_.extend(part.local for part in body.parts)
        if not rows:
            return
        matrices = read_only(_make_poses(np.array(frames))[rows] @ np.array(locals_))
        for node, matrix in zip(self.nodes, matrices, strict=True):
            node._move(matrix, None)

    def _deform(self, number: int, body: Body) -> None:
        """Set the mesh of a soft body to its present shape."""
        count, points = pybullet.getMeshData(number, BASE, physicsClientId=self._client)
        for node in body.nodes:
            old = node.mesh
            uv = None
            if old.uv is not None and old.faces.size == count:
                uv = old.uv[old.faces.reshape(-1)]
            faces = np.arange(count).reshape(-1, 3)
            node.mesh = Mesh(np.array(points), faces, uv=uv, material=old.material)

    # Bodies.

    def _make_body(
        self, number: int, key: Any, spare: dict[int, list[Mesh]], missing: list[str]
    ) -> Body:
        """Return the parts of a body, with new nodes; add the names of what is not drawn."""
        shapes, (is_opaque, gain), _ = key
        info = pybullet.getDynamicsInfo(number, BASE, physicsClientId=self._client)
        # Bodies are told by their centre of mass; shapes lie in the frame of the base.
        from_center = np.eye(4)
        if info[10] not in (RIGID_BODY, SOFT_BODY):
            from_center = np.linalg.inv(_make_poses(np.array([(*info[3], *info[4])]))[0])
        is_soft = info[10] == SOFT_BODY
        parts, counts = list[Part](), dict[int, int]()
        for shape in shapes:
            link, color = shape[1], shape[7]
            index = counts[link] = counts.get(link, -1) + 1
            if color[3] <= 0.0:
                continue
            try:
                pieces = self._find_pieces(shape, index)
            except ValueError as error:
                missing.append(str(error))
                continue
            ends = self._find_ends(shape, index, sum(one[1] == link for one in shapes))
            if isinstance(ends, str):
                missing.append(ends)
                continue
            local = _make_poses(np.array([(*shape[5], *shape[6])]))[0]
            if ends is not None:
                local = _make_pose_between(*ends)
            if link == BASE:
                local = from_center @ local
            if is_soft:
                local = np.eye(4)
            try:
                override = self._find_texture(number, link, index)
            except ValueError as error:
                missing.append(str(error))
                override = None
            flags = self._find_flags(number, link, index)
            for mesh, matrix, own in pieces:
                texture = own if override is None else override or None
                material = _make_material(
                    tuple(color), texture, is_opaque, gain,
                    bool(flags & pybullet.VISUAL_SHAPE_DOUBLE_SIDED) or is_soft,
                )  # fmt: skip
                copies = spare.get(id(mesh))
                shown = copies.pop() if copies else _copy_mesh(mesh)
                shown.material = material
                parts.append(Part(shown, mesh, local @ matrix, link))
        links = sorted({part.link for part in parts} - {BASE})
        return Body(key, parts, [Node(part.mesh) for part in parts], links, is_soft)

    def _find_ends(self, shape: Any, index: int, count: int) -> Float64 | str | None:
        """Return the ends of a shape, (2, 3), None if it has a pose, or the name of what lacks."""
        number, link, kind = shape[:3]
        has_pose = any(shape[5]) or tuple(shape[6]) != (0.0, 0.0, 0.0, 1.0)
        if kind not in (pybullet.GEOM_CAPSULE, pybullet.GEOM_CYLINDER) or has_pose:
            return None
        by_link = self._notes.ends.get(number)
        if by_link is None:
            return None
        client = self._client
        if link == BASE:
            name = pybullet.getBodyInfo(number, physicsClientId=client)[0]
        else:
            name = pybullet.getJointInfo(number, link, physicsClientId=client)[12]
        ends = by_link.get(name.decode(), [])
        if len(ends) != count:
            return f"capsules and cylinders of {name.decode()}, which PyBullet tells no place of"
        return ends[index]

    def _find_pieces(self, shape: Any, index: int) -> list[tuple[Mesh, Float64, Texture | None]]:
        """Return meshes, their places and textures of a visual shape; or raise ``ValueError``."""
        number, link, kind, size, name = shape[:5]
        if kind == pybullet.GEOM_BOX:
            return [(_get_box(), np.diag([*(0.5 * side for side in size), 1.0]), None)]
        if kind == pybullet.GEOM_SPHERE:
            return [(_get_ball(), np.diag([*3 * size[:1], 1.0]), None)]
        if kind in (pybullet.GEOM_CYLINDER, pybullet.GEOM_CAPSULE):
            is_capsule = kind == pybullet.GEOM_CAPSULE
            return [(_get_tube(size[1], size[0], is_capsule), np.eye(4), None)]
        if kind == pybullet.GEOM_PLANE:
            return [(_get_plane(), np.eye(4), _get_checker())]
        if kind == pybullet.GEOM_HEIGHTFIELD:
            field = self._notes.fields.get(self._notes.field_bodies.get(number, -1))
            if field is None:
                raise ValueError("height fields of files, or made before the import")
            return [(_make_given_mesh(field), np.eye(4), _get_checker())]
        if kind != pybullet.GEOM_MESH:
            raise ValueError(f"shapes of type {kind}")
        scale = np.diag([*size, 1.0])
        file = name.decode(errors="surrogateescape")
        if file and file != "unknown_file":
            path = self._notes.find_file(file)
            try:
                changed = path.stat().st_mtime_ns
            except OSError as error:
                raise ValueError(f"{file} ({error})") from None
            pieces = _load_pieces(path, changed)
            has_texture = shape[8] >= 0
            return [(mesh, scale @ m, own if has_texture else None) for mesh, m, own in pieces]
        noted = self._notes.shapes.get(self._notes.bodies.get((number, link), -1), [])
        given = noted[index][0] if index < len(noted) else None
        if given is None:
            raise ValueError(
                "meshes that were made of vertices before the import of rasterjit.compat.pybullet"
            )
        return [(_make_given_mesh(given), scale, None)]

    def _find_texture(self, number: int, link: int, index: int) -> Texture | bool | None:
        """Return a texture that the program gave a shape, False for none; None if it gave none."""
        given = _find_noted(self._notes.overrides, number, link, index)
        if given is None:
            return None
        if given < 0:
            return False
        source = self._notes.textures.get(given)
        if source is None:
            raise ValueError(
                f"texture {given}, which was loaded before the import of rasterjit.compat.pybullet"
            )
        if isinstance(source, Path):
            return _load_texture(source, source.stat().st_mtime_ns)
        return Texture(source, color_space="linear")

    def _find_flags(self, number: int, link: int, index: int) -> int:
        """Return the flags of a shape, as far as they are known."""
        noted = self._notes.shapes.get(self._notes.bodies.get((number, link), -1), [])
        own = noted[index][1] if index < len(noted) else 0
        given = _find_noted(self._notes.flags, number, link, index)
        return own if given is None else given

    # Light.

    def _set_light(self, light: LightSettings) -> None:
        """Set the lights, if they have changed."""
        if light == self._light:
            return
        self._light = light
        down = [-part for part in light.direction]
        strength = max(light.diffuse, 1e-6)
        shares: list[tuple[float, Shadow | None]] = [(1.0, None)]
        if light.has_shadow:
            shares = [(1.0 - SHADOW_SHARE, None), (SHADOW_SHARE, Shadow(size=SHADOW_TEXELS))]
        brightest = max(1.0, *light.color)
        color = [part / brightest for part in light.color]
        self.lights[:] = [
            AmbientLight((1.0, 1.0, 1.0), light.ambient),
            *(
                DirectionalLight(down, color, share * strength * brightest, shadow)
                for share, shadow in shares
            ),
        ]


def _find_noted(table: dict[Any, int], number: int, link: int, index: int) -> int | None:
    """Return what is noted of one shape of a link, else of all its shapes."""
    return table.get((number, link, index), table.get((number, link, -1)))


def _make_poses(frames: Float64) -> Float64:
    """Return matrices, (N, 4, 4), of positions and quaternions x, y, z, w, (N, 7)."""
    x, y, z, w = frames[:, 3:].T / np.linalg.norm(frames[:, 3:], axis=1)
    poses = np.zeros((len(frames), 4, 4))
    poses[:, 0, 0], poses[:, 0, 1] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w)
    poses[:, 1, 0], poses[:, 1, 1] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z)
    poses[:, 2, 0], poses[:, 2, 1] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w)
    poses[:, 0, 2], poses[:, 1, 2] = 2.0 * (x * z + y * w), 2.0 * (y * z - x * w)
    poses[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    poses[:, :3, 3], poses[:, 3, 3] = frames[:, :3], 1.0
    return poses


def _make_pose_between(start: Float64, end: Float64) -> Float64:
    """Return a pose in the middle of two points, (4, 4), whose z axis leads to the second."""
    pose = np.eye(4)
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
    across = np.cross(np.eye(3)[np.abs(along).argmin()], along)
    across /= np.linalg.norm(across)
    pose[:3, :3] = np.stack([across, np.cross(along, across), along], axis=1)
    pose[:3, 3] = 0.5 * (start + end)
    return pose


# Meshes, textures and materials.


def _copy_mesh(mesh: Mesh) -> Mesh:
    """Return a copy that shares what is found of a mesh once."""
    mesh._faces_to_draw()
    with suppress(ValueError):  # Without faces it has no bounds.
        mesh.bounds()
    return mesh._with()


def _make_mesh(surface: Triangulation) -> Mesh:
    return Mesh(surface.positions, surface.faces, normals=surface.normals, uv=surface.uv)


@functools.cache
def _get_box() -> Mesh:
    """Return a box of size 1 whose sides show places of a texture as PyBullet's do."""
    box = make_unit_shape("box", SLICES, STACKS, 1)
    uv = np.empty((24, 2))
    for n, (middle, across, up) in enumerate(BOX_SIDES):
        own = slice(4 * n, 4 * n + 4)
        uv[own] = middle + 0.5 * box.positions[own] @ np.array([across, up]).T
    return _make_mesh(box._replace(uv=uv))


@functools.cache
def _get_ball() -> Mesh:
    """Return a ball of radius 1 whose texture is about its y axis."""
    ball = make_unit_shape("ball", SLICES, STACKS, 1)
    assert ball.uv is not None
    turn = np.array([(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)])
    uv = np.stack([ball.uv[:, 0], 0.5 + 0.5 * ball.positions[:, 2]], axis=1)
    return _make_mesh(Triangulation(ball.positions @ turn.T, ball.faces, ball.normals @ turn.T, uv))


@functools.lru_cache(maxsize=256)
def _get_tube(radius: float, length: float, is_capsule: bool) -> Mesh:
    """Return a cylinder, or a capsule, about the z axis."""
    across = radius, radius
    if not is_capsule:
        whole = make_unit_shape("cylinder", SLICES, 1, 1)
        return _make_mesh(_wrap_around_y(scale_and_shift(whole, (*across, 0.5 * length))))
    parts = [scale_and_shift(make_unit_shape("tube", SLICES, 1, 1), (*across, 0.5 * length))]
    for name, sign in (("top", 0.5), ("bottom", -0.5)):
        cap = make_unit_shape(name, SLICES, STACKS, 1)
        parts.append(scale_and_shift(cap, (*across, radius), sign * length))
    return _make_mesh(_wrap_around_y(join(parts)))


def _wrap_around_y(shape: Triangulation) -> Triangulation:
    """Return a shape that shows a texture in each direction where a ball shows it."""
    corners = shape.positions[shape.faces]
    x, y, z = np.moveaxis(corners / np.linalg.norm(corners, axis=2, keepdims=True), 2, 0)
    u = 0.5 + np.arctan2(x, z) / (2.0 * np.pi)
    # Faces on the seam go on beyond 1, where the texture repeats itself.
    u += u.max(axis=1, keepdims=True) - u > 0.5
    uv = np.stack([u, 0.5 + 0.5 * y], axis=2).reshape(-1, 2)
    faces = np.arange(shape.faces.size).reshape(-1, 3)
    every = shape.faces.ravel()
    return Triangulation(shape.positions[every], faces, shape.normals[every], uv)


@functools.cache
def _get_plane() -> Mesh:
    """Return the square that stands for a plane."""
    half = PLANE_HALF_SIZE
    square = make_rectangle((-half, half), (-half, half))
    uv = square.positions[:, :2] @ np.array([(0.0, 0.5), (-0.5, 0.0)])
    return _make_mesh(square._replace(uv=uv))


@functools.cache
def _get_checker() -> Texture:
    """Return what planes show."""
    return Texture(np.kron(CHECKER, np.ones((32, 32, 1))).astype(np.uint8), color_space="linear")


@functools.lru_cache(maxsize=256)
def _load_pieces(path: Path, changed: int) -> list[tuple[Mesh, Float64, Texture | None]]:
    """Return meshes, places and textures of a file; ``changed`` tells its versions apart."""
    # PyBullet has read the file in this process, too.
    scene = load(path, crease_angle=0.0, on_damage="warn", isolate=False)
    up = np.eye(4)
    if path.suffix.lower() == ".dae" and scene.up == (0.0, 1.0, 0.0):
        up[1:3, 1:3] = (0.0, -1.0), (1.0, 0.0)
    pieces = []
    for node in scene.every_node():
        mesh = node.mesh
        if isinstance(mesh, Mesh):
            uv = _complete_uv(mesh.uv, len(mesh.vertices))
            bare = Mesh(mesh.vertices, mesh.faces, normals=mesh.normals, uv=uv)
            texture = mesh.material.base_color_texture
            pieces.append((bare, up @ node.world_matrix, texture and _as_codes(texture)))
    return pieces


def _complete_uv(uv: NDArray[Any] | None, count: int) -> NDArray[Any]:
    """Return texture coordinates, (V, 2); a mesh without shows the middle of textures."""
    return np.full((count, 2), 0.5) if uv is None else uv


@functools.lru_cache(maxsize=64)
def _load_texture(path: Path, changed: int) -> Texture:
    """Return the texture of a file; ``changed`` tells its versions apart."""
    return Texture.from_file(path, color_space="linear")


def _as_codes(texture: Texture) -> Texture:
    """Return a texture whose light is what was its code; for equal pictures the same one."""
    codes = np.interp(texture.image[..., :3], decoding_table(), np.arange(256))
    picture = np.rint(codes).astype(np.uint8)
    return _get_texture(picture.shape, picture.tobytes(), texture.wrap)


@functools.lru_cache(maxsize=64)
def _get_texture(shape: tuple[int, ...], codes: bytes, wrap: Any) -> Texture:
    """Return the texture of a picture of codes; parts of a robot often share one."""
    return Texture(np.frombuffer(codes, np.uint8).reshape(shape), wrap=wrap, color_space="linear")


@functools.lru_cache(maxsize=256)
def _find_mean(texture: Texture) -> float:
    """Return the mean of a texture's colours."""
    return float(texture.image[..., :3].mean())


@functools.lru_cache(maxsize=256)
def _make_given_mesh(given: GivenMesh) -> Mesh:
    """Return the mesh of arrays; without normals its faces are flat."""
    uv = _complete_uv(given.uv, len(given.positions))
    if given.normals is None:
        return Mesh(given.positions, given.faces, uv=uv).split_creases(0.0)
    return Mesh(given.positions, given.faces, normals=given.normals, uv=uv)


@functools.lru_cache(maxsize=1024)
def _make_material(
    color: tuple[float, ...], texture: Texture | None, is_opaque: bool, gain: float,
    is_double_sided: bool,
) -> Material:  # fmt: skip
    """Return the material of a shape."""
    *rgb, alpha = np.clip(color, 0.0, 1.0).tolist()
    is_blended = alpha < 1.0 and not is_opaque
    # PyBullet multiplies highlights by the colour, here they are white: use its mean.
    mean = float(np.mean(rgb)) * (1.0 if texture is None else _find_mean(texture))
    return Material(
        "phong", (*rgb, alpha if is_blended else 1.0), specular=gain * mean, shininess=SHININESS,
        base_color_texture=texture, alpha_mode="blend" if is_blended else "opaque",
        double_sided=is_double_sided,
    )  # fmt: skip
