"""
Decide, from the scene, the camera and the outputs, what a frame needs; all else is ``None``.

This is the only place that decides, and the border to the kernels: the arrays that they read are
cast and joined here, once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import transforms
from rasterjit.kernels import records
from rasterjit.kernels.records import Encoding, Lighting, Objects, Surface, Viewport
from rasterjit.kernels.resolve import encoding_table
from rasterjit.kernels.setup import GUARD_PIXELS
from rasterjit.plan_effects import (
    SMOOTH,
    Contents,
    Effect,
    Grounds,
    contents_of,
    list_effects,
    textures_read,
)
from rasterjit.plan_layers import Layers, Transparency, find_transparency, is_outside
from rasterjit.plan_lights import lighting_of
from rasterjit.scene.ambient_occlusion import RADIUS_OF_SCENE, AmbientOcclusion
from rasterjit.scene.camera import Camera
from rasterjit.scene.color import linear_color
from rasterjit.scene.light import (
    AmbientLight,
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
)
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Node, Scene, Wireframe
from rasterjit.validation import image_size, one_of

OUTPUTS = (
    "color", "depth", "face_id", "object_id", "barycentric", "uv", "normal", "position", "linear",
)  # fmt: skip
"""What a frame can hold."""

CULL_MODES = ("none", "back", "front")

MODELS = {
    "unlit": records.UNLIT,
    "flat": records.FLAT,
    "gouraud": records.GOURAUD,
    "phong": records.PHONG,
    "pbr": records.PBR,
}

HEADLIGHT_DIRECTION = (-0.3, -0.5, -1.0)
"""Direction of the default light in view space: over the viewer's right shoulder."""
HEADLIGHT_INTENSITY = 0.9
HEADLIGHT_AMBIENT = 0.1
"""The default light's two parts add up to 1, so a white surface facing it is white."""


class _WritableView:
    """Shows the memory of a read-only array to NumPy as writable, and keeps it alive."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface


@dataclass(frozen=True)
class RenderPlan:
    """
    What one frame consists of; prints as a table.

    Attributes
    ----------
    size : (int, int)
        Width and height, pixels.
    outputs : tuple of str
    grounds : Grounds
        What the decisions rest on.
    """

    size: tuple[int, int]
    camera: Camera
    quality: Quality
    outputs: tuple[str, ...]
    background: NDArray[np.float32]
    cull: str
    wireframe: Wireframe | None
    ambient_occlusion: AmbientOcclusion | None
    outline: Outline | None
    draws_faces: bool
    lighting: Lighting | None
    needs_normals: bool
    needs_gouraud: bool
    diagnose: bool
    needs_textures: bool
    needs_matt_light: bool
    grounds: Grounds
    encoding: Encoding
    layers: Layers | None
    """What a pixel shows besides its nearest face; ``None`` -> nothing."""

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """What is in and what is out, with the reason; made when first asked for."""
        return list_effects(self.grounds)

    @property
    def needs_depth(self) -> bool:
        """Whether the depth of the whole frame is kept."""
        hides_edges = self.wireframe is not None and self.draws_faces
        looks_around = self.ambient_occlusion is not None or self.outline is not None
        return "depth" in self.outputs or hides_edges or looks_around or self.diagnose

    @property
    def needs_faces(self) -> bool:
        """Whether the face at every pixel is found: shown, in front of edges, or in a buffer."""
        return self.draws_faces or self.diagnose or bool({*self.outputs} - {"color", "linear"})

    @property
    def needs_color(self) -> bool:
        """Whether any output shows colour."""
        return self.grounds.is_colored

    def __str__(self) -> str:
        width, height = self.size
        rows = [
            ("size", f"{width} x {height} pixels"),
            ("outputs", ", ".join(self.outputs)),
            ("sub-pixel bits", str(self.quality.subpixel_bits)),
            ("culling", self.cull),
        ]
        rows += [
            (effect.name, f"{'in ' if effect.used else 'out'} ({effect.reason})")
            for effect in self.effects
        ]
        widest = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{widest}}  {text}" for name, text in rows)


def plan_render(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    outputs: Sequence[str],
    background: Any,
    cull: str,
    diagnose: bool = False,
    contents: Contents | None = None,
) -> RenderPlan:
    """
    Check the arguments of a frame and decide what it needs.

    ``contents`` are those of the scene's meshes, where they are known already.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size = image_size("size", size)
    outputs = check_outputs(outputs)
    one_of("cull", cull, CULL_MODES)
    if not isinstance(diagnose, bool):
        raise ValueError(f"diagnose must be True or False, got {diagnose!r}")
    if contents is None:
        check_scene(scene)
        contents = contents_of([node.mesh for node in scene.nodes])
    kinds = tuple(type(light).__name__ for light in scene.lights)
    grounds = Grounds(
        outputs=outputs,
        contents=contents,
        light_kinds=kinds,
        wireframe=scene.wireframe,
        diagnose=diagnose,
        environment=scene.environment,
        fog=scene.fog,
        tone_map=scene.tone_map,
        ambient_occlusion=scene.ambient_occlusion,
        outline=scene.outline,
        quality=quality,
        has_ambient_light=has_ambient_light(scene.lights),
        transparency=_transparency(scene, camera, size, outputs, contents),
    )
    if "uv" in outputs and not contents.has_uv:
        raise ValueError("outputs has 'uv', but no mesh of the scene has texture coordinates")
    if grounds.shades and contents.lacks_uv:
        _refuse_texture(scene.nodes)
    is_lit = grounds.is_lit
    return RenderPlan(
        size=size,
        camera=camera,
        quality=quality,
        outputs=outputs,
        background=linear_color("background", background),
        cull=cull,
        wireframe=scene.wireframe if grounds.draws_edges else None,
        ambient_occlusion=_sized_occlusion(scene) if grounds.occludes else None,
        outline=scene.outline if grounds.draws_outlines else None,
        draws_faces=grounds.draws_faces,
        lighting=_lighting(scene, camera, contents.highlights) if is_lit else None,
        needs_normals=grounds.needs_normals,
        needs_gouraud=is_lit and "gouraud" in contents.shadings,
        diagnose=diagnose,
        needs_textures=grounds.needs_textures,
        # The highlights of vertices lie on top of a texture: they are added up apart.
        needs_matt_light=is_lit and contents.has_textured_highlight,
        grounds=grounds,
        encoding=Encoding(encoding_table()),
        layers=_layers(grounds),
    )


def has_ambient_light(lights: Sequence[Light]) -> bool:
    """Tell whether any of a scene's lights has no direction; without lights, the headlight has."""
    return not lights or any(
        isinstance(light, AmbientLight) and light.intensity * max(light.color) > 0.0
        for light in lights
    )


def _sized_occlusion(scene: Scene) -> AmbientOcclusion:
    """Return the scene's ambient occlusion, with a radius in scene units."""
    effect = scene.ambient_occlusion
    if effect.radius is not None:
        return effect
    _, radius = scene.bounding_sphere()
    # A scene of one point has no size; nothing occludes there.
    return replace(effect, radius=RADIUS_OF_SCENE * radius if radius > 0.0 else 1.0)


def _transparency(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    outputs: tuple[str, ...],
    contents: Contents,
) -> Transparency:
    """Decide which objects are laid over what lies behind them."""
    only_edges = scene.wireframe is not None and scene.wireframe.mode == "only"
    shades = not only_edges and not {"color", "linear"}.isdisjoint(outputs)
    nodes = [scene.nodes[n] for n in contents.see_through] if shades else []
    outside = []
    if nodes:
        views = view_nodes(nodes, camera, size)
        outside = [
            n
            for n, node, matrix in zip(
                contents.see_through, nodes, views.relative_from_model, strict=True
            )
            if is_outside(node.mesh, matrix, views.clip_from_relative)
        ]
    return find_transparency(
        len(scene.nodes), shades, contents.has_blended, contents.see_through, outside,
        [scene.nodes[n].name for n in outside],
    )  # fmt: skip


def _layers(grounds: Grounds) -> Layers | None:
    """Return what pixels show besides their nearest faces; ``None`` if nothing."""
    used, samples = grounds.transparency.used, grounds.quality.samples
    if not used and not grounds.antialiases:
        return None
    return Layers(grounds.transparency.is_blended, used, samples)


def _refuse_texture(nodes: Sequence[Node]) -> None:
    """Raise ``ValueError`` naming the object that has a texture and nothing to lay it by."""
    for node in nodes:
        for name in textures_read(node.mesh.material) if node.mesh.uv is None else ():
            raise ValueError(
                f"the mesh of {node.name!r} must have uv, for its material has a {name}; got none"
            )


def check_scene(scene: Scene) -> None:
    """Raise ``ValueError`` if something in the scene's lists is not what belongs there."""
    for name, items, kinds in (
        ("nodes", scene.nodes, (Node,)),
        ("lights", scene.lights, (AmbientLight, DirectionalLight, PointLight, SpotLight)),
    ):
        if not isinstance(items, (list, tuple)):
            raise ValueError(f"scene.{name} must be a list, got {items!r}")
        if set(map(type, items)).issubset(kinds):
            continue
        for n, item in enumerate(items):
            if not isinstance(item, kinds):
                wanted = " or ".join(kind.__name__ for kind in kinds)
                raise ValueError(f"scene.{name}[{n}] must be a {wanted}, got {item!r}")
    if not scene.nodes:
        raise ValueError("scene must hold at least one mesh, got an empty scene")
    if scene.wireframe is not None and not isinstance(scene.wireframe, Wireframe):
        raise ValueError(f"scene.wireframe must be a Wireframe or None, got {scene.wireframe!r}")
    for name, kind in (("ambient_occlusion", AmbientOcclusion), ("outline", Outline)):
        value = getattr(scene, name)
        if value is not None and not isinstance(value, kind):
            raise ValueError(f"scene.{name} must be an {kind.__name__} or None, got {value!r}")


def check_outputs(outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the outputs without repeats, or raise ``ValueError`` naming one that is unknown."""
    if isinstance(outputs, str):
        outputs = (outputs,)
    if not isinstance(outputs, (list, tuple, set, frozenset)):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    if not outputs:
        raise ValueError(f"outputs must name at least one of {', '.join(OUTPUTS)}; got none")
    for output in outputs:
        if output not in OUTPUTS:
            raise ValueError(
                f"outputs has {output!r}, which is unknown; possible are {', '.join(OUTPUTS)}"
            )
    return tuple(dict.fromkeys(outputs))


def viewport_of(size: tuple[int, int], subpixel_bits: int) -> Viewport:
    """Return the viewport record of an image (width, height), with its guard band."""
    width, height = size
    return Viewport(
        width,
        height,
        1.0 + 2.0 * GUARD_PIXELS / width,
        1.0 + 2.0 * GUARD_PIXELS / height,
        subpixel_bits,
        max(subpixel_bits, 1),
    )


class SceneArrays(NamedTuple):
    """The meshes of a scene, joined into one; a scene of one mesh is joined without a copy."""

    positions: NDArray[np.float64]
    """(V, 3), model space."""
    faces: NDArray[np.int32]
    """(F, 3), vertex numbers."""
    vertex_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``."""
    face_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""


def join_geometry(meshes: Sequence[Mesh]) -> SceneArrays:
    """Join positions and faces; faces are renumbered."""
    runs = runs_of(meshes)
    repeats = [count for _, count in runs]
    vertex_starts = _starts([len(mesh.vertices) for mesh, _ in runs], repeats)
    face_starts = _starts([len(mesh.faces) for mesh, _ in runs], repeats)
    if max(vertex_starts[-1], face_starts[-1]) >= 2**31 - 2**28:
        raise ValueError(
            f"scene must have fewer than {2**31 - 2**28} vertices and faces in all, got "
            f"{vertex_starts[-1]} and {face_starts[-1]}"
        )
    if len(meshes) == 1:
        positions, faces = writable(meshes[0].vertices), writable(meshes[0].faces)
        return SceneArrays(positions, faces, vertex_starts, face_starts)
    positions = _repeated([(mesh.vertices, count) for mesh, count in runs])
    faces = np.empty((face_starts[-1], 3), np.int32)
    place = 0
    for mesh, count in runs:
        firsts = vertex_starts[place : place + count].astype(np.int32)[:, np.newaxis, np.newaxis]
        rows = faces[face_starts[place] : face_starts[place + count]]
        np.add(mesh.faces, firsts, out=rows.reshape(count, -1, 3))
        place += count
    return SceneArrays(positions, faces, vertex_starts, face_starts)


def runs_of(meshes: Sequence[Mesh]) -> list[tuple[Mesh, int]]:
    """Return each mesh with how often it follows itself: instances are joined at once."""
    return [(mesh, sum(1 for _ in group)) for mesh, group in itertools.groupby(meshes)]


def _starts(sizes: Sequence[int], repeats: Sequence[int]) -> NDArray[np.int64]:
    """Return the running sum from 0 of sizes that repeat, (O+1,)."""
    starts = np.zeros(sum(repeats) + 1, np.int64)
    np.cumsum(np.repeat(np.array(sizes, np.int64), repeats), out=starts[1:])
    return starts


def _repeated(parts: Sequence[tuple[NDArray[Any], int]]) -> NDArray[Any]:
    """Join arrays (n, k) row by row, each as often as it says."""
    total = sum(len(array) * count for array, count in parts)
    first = parts[0][0]
    joined = np.empty((total, first.shape[1]), first.dtype)
    start = 0
    for array, count in parts:
        stop = start + len(array) * count
        joined[start:stop].reshape(count, *array.shape)[:] = array
        start = stop
    return joined


def join_normals(meshes: Sequence[Mesh]) -> NDArray[np.float32]:
    """Join the vertex normals of the smooth objects, (V, 3); zero for the others."""

    def normals(mesh: Mesh) -> NDArray[np.float32] | None:
        return mesh.vertex_normals() if mesh.material.shading in SMOOTH else None

    parts = [(normals(mesh), len(mesh.vertices), count) for mesh, count in runs_of(meshes)]
    return _join(parts, np.zeros(3, np.float32))


def join_uv(meshes: Sequence[Mesh]) -> NDArray[np.float32]:
    """Join the texture coordinates, (V, 2); NaN where an object has none."""
    parts = [(mesh.uv, len(mesh.vertices), count) for mesh, count in runs_of(meshes)]
    return _join(parts, np.full(2, np.nan, np.float32))


def join_surface(meshes: Sequence[Mesh], normals: NDArray[np.float32] | None) -> Surface:
    """Join what the objects look like; a kind of colour that no object has is ``None``."""
    runs = runs_of(meshes)
    rows = [
        (
            *mesh.material.base_color,
            mesh.material.specular,
            mesh.material.shininess,
            MODELS[mesh.material.shading],
        )
        for mesh, _ in runs
    ]
    materials = np.repeat(np.array(rows, np.float32), [count for _, count in runs], axis=0)
    white = np.ones(4, np.float32)
    vertex_colors = face_colors = None
    if any(mesh.vertex_colors is not None for mesh, _ in runs):
        parts = [(mesh.vertex_colors, len(mesh.vertices), count) for mesh, count in runs]
        vertex_colors = _join(parts, white)
    if any(mesh.face_colors is not None for mesh, _ in runs):
        parts = [(mesh.face_colors, len(mesh.faces), count) for mesh, count in runs]
        face_colors = _join(parts, white)
    return Surface(materials, vertex_colors, face_colors, normals, None, None, None)


class Views(NamedTuple):
    """The matrices of all objects, relative to the eye so that nothing is lost far from it."""

    relative_from_model: NDArray[np.float64]
    """(O, 4, 4): world axes, origin at the eye."""
    clip_from_relative: NDArray[np.float64]
    """(4, 4)."""
    normal_matrices: NDArray[np.float64]
    """(O, 3, 3), largest entry 1."""
    mirrored: NDArray[np.float64]
    """(O,): -1 where the transform turns faces inside out, else 1."""
    toward_viewer: NDArray[np.float64]
    """(4,): a point p, relative to the eye, is seen along ``xyz - w p``."""
    screen_turn: int
    """1 if the camera shows counter-clockwise faces counter-clockwise, -1 if it mirrors."""


class Places(NamedTuple):
    """Where the objects stand in the world, which no camera changes."""

    world_from_model: NDArray[np.float64]
    """(O, 4, 4)."""
    normal_matrices: NDArray[np.float64]
    """(O, 3, 3), largest entry 1."""
    mirrored: NDArray[np.float64]
    """(O,): -1 where the transform turns faces inside out, else 1."""


def place_objects(matrices: Sequence[NDArray[np.float64]]) -> Places:
    """Return where objects stand, given ``world_from_model``, (4, 4), of each."""
    world_from_model = np.concatenate(matrices).reshape(-1, 4, 4)
    normals = transforms.normal_matrices(world_from_model)
    # So that normals keep a length near 1 in float32.
    largest = np.abs(normals).max(axis=(1, 2), keepdims=True)
    np.divide(normals, largest, out=normals, where=largest > 0.0)
    return Places(world_from_model, normals, _mirrored(world_from_model[:, :3, :3]))


def _mirrored(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return -1 for each 3x3 matrix of a negative determinant, (O,), else 1; see `_turn`."""
    largest = np.abs(matrices).max(axis=2, keepdims=True)
    scaled = np.divide(matrices, largest, out=np.zeros_like(matrices), where=largest > 0.0)
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(scaled, 0, 2)
    determinants = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return np.where(determinants < 0.0, -1.0, 1.0)


def view_nodes(nodes: Sequence[Node], camera: Camera, size: tuple[int, int]) -> Views:
    """Return the matrices that take each object to the screen."""
    return view_places(place_objects([node.world_from_model for node in nodes]), camera, size)


def view_places(places: Places, camera: Camera, size: tuple[int, int]) -> Views:
    """Return the matrices that take objects at their places to the screen."""
    eye = camera.eye_position()
    relative_from_model = places.world_from_model.copy()
    relative_from_model[:, :3, 3] -= eye
    view_from_relative = transforms.compose(camera.view_matrix(), transforms.translate(eye))
    clip_from_view = camera.projection_matrix(size)
    *screen_axes, depth_row, away = (row[:3] for row in clip_from_view.tolist())
    toward_viewer = np.array([0.0, 0.0, 0.0, 1.0])
    if not any(away):
        # A parallel projection: depth grows with z in clip space; the viewer is the other way.
        away = depth_row
        axis = clip_from_view[2, :3, np.newaxis]
        toward_viewer[:3] = -(axis * view_from_relative[:3, :3]).sum(axis=0)
        toward_viewer[3] = 0.0
    view_axes = [row[:3] for row in view_from_relative[:3].tolist()]
    handedness = _turn([*screen_axes, away]) * _turn(view_axes)
    return Views(
        relative_from_model,
        transforms.compose(clip_from_view, view_from_relative),
        places.normal_matrices,
        places.mirrored,
        toward_viewer,
        1 if handedness < 0.0 else -1,
    )


def _turn(rows: Sequence[Sequence[float]]) -> float:
    """Return the sign of a 3x3 determinant; rows are scaled first, so that none overflows."""
    scaled = []
    for row in rows:
        largest = max(map(abs, row))
        if largest == 0.0:
            return 0.0
        scaled.append([entry / largest for entry in row])
    (a, b, c), (d, e, f), (g, h, i) = scaled
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return math.copysign(1.0, determinant) if determinant != 0.0 else 0.0


def cull_objects(cull: str, views: Views, face_starts: NDArray[np.int64]) -> Objects:
    """Return which way the faces of each object turn that are dropped (+1: clockwise)."""
    sign = {"none": 0, "back": 1, "front": -1}[cull] * views.screen_turn
    return Objects(face_starts, (sign * views.mirrored).astype(np.int8))


def _lighting(scene: Scene, camera: Camera, highlights: int) -> Lighting:
    """Return the lights as rows, relative to the eye; none in the scene means a headlight."""
    return lighting_of(scene.lights or _headlight(camera), camera, highlights)


def _headlight(camera: Camera) -> list[Light]:
    """Return the lights of a scene that has none."""
    # The rows of the inverse transpose are the columns of the inverse.
    columns = transforms.normal_matrix(camera.view_matrix()).tolist()
    x, y, z = HEADLIGHT_DIRECTION
    direction = tuple((a * x + b * y) + c * z for a, b, c in zip(*columns, strict=True))
    return [DirectionalLight(direction, intensity=HEADLIGHT_INTENSITY), _headlight_ambient()]


@cache
def _headlight_ambient() -> AmbientLight:
    """Return the part of the default light that has no direction."""
    return AmbientLight(intensity=HEADLIGHT_AMBIENT)


def _join(
    parts: Sequence[tuple[NDArray[np.float32] | None, int, int]], fill: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Join (array, rows, repeats) row by row, with ``fill`` for the rows of an absent array."""
    array, _, count = parts[0]
    if len(parts) == 1 and count == 1 and array is not None:
        return writable(array)
    return _repeated(
        [
            (np.broadcast_to(fill, (rows, len(fill))) if array is None else array, count)
            for array, rows, count in parts
        ]
    )


def writable(array: NDArray[Any]) -> NDArray[Any]:
    """
    Return the array in the one layout that kernels are compiled for, without a copy if it can be.

    A read-only array is a type of its own to Numba; kernels never write to a mesh, so it is passed
    as a writable view of the same memory.
    """
    return array if array.flags.writeable else np.asarray(_WritableView(array))
