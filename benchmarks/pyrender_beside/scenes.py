"""
Scenes of pyrender's interface, built from whichever module has it.

A scene is built anew at each call, from arrays that were made once. Nothing here imports RasterJIT:
the original builds the same scenes in an environment of its own.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

SIZE = 640, 480

Float64 = NDArray[np.float64]
Built = Any
"""A ``Scene`` of the module that was handed over."""

SCENES: dict[str, Callable[[Any], Built]] = {}
"""What builds each scene, by its name."""
POINT_SIZES = {"points": 5.0}
"""Pixels, where not 1."""


def scene_of(build: Callable[[Any], Built]) -> Callable[[Any], Built]:
    """Enter a function among the scenes."""
    SCENES[build.__name__] = build
    return build


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Float64:
    """Return the pose that moves by (x, y, z)."""
    return trimesh.transformations.translation_matrix([x, y, z])


def towards(
    eye: tuple[float, float, float], target: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Float64:
    """Return the pose of a camera or light that looks from one place to another, y up."""
    back = np.subtract(eye, target)
    back = back / np.linalg.norm(back)
    side = np.cross((0.0, 1.0, 0.0), back)
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3] = np.column_stack([side, np.cross(back, side), back, eye])
    return pose


def seen_from(
    pr: Any, eye: tuple[float, float, float] = (0.0, 0.6, 3.0), sun: float = 3.0, **options: Any
) -> Built:
    """Return a scene with a camera that looks at the origin and, if asked, a light beside it."""
    scene = pr.Scene(**options)
    scene.add(pr.PerspectiveCamera(yfov=np.pi / 4.0), pose=towards(eye))
    if sun:
        scene.add(pr.DirectionalLight(color=np.ones(3), intensity=sun), pose=towards(eye))
    return scene


@functools.cache
def knot(around: int = 220, along: int = 159) -> trimesh.Trimesh:
    """Return a bent tube, closed; 70 000 faces, its normals computed."""
    turn = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)[:, None]
    ring = np.linspace(0.0, 2.0 * np.pi, along, endpoint=False)[None, :]
    wide = 0.75 + (0.28 + 0.06 * np.cos(3.0 * turn)) * np.cos(ring)
    points = np.stack(
        [
            wide * np.cos(turn),
            (0.28 + 0.06 * np.cos(3.0 * turn)) * np.sin(ring) + 0.2 * np.sin(2.0 * turn),
            wide * np.sin(turn),
        ],
        axis=-1,
    ).reshape(-1, 3)
    rows, columns = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
    here, right = rows * along + columns, rows * along + (columns + 1) % along
    below, across = (
        (rows + 1) % around * along + columns,
        (rows + 1) % around * along + (columns + 1) % along,
    )
    faces = np.concatenate(
        [np.stack([here, right, below], -1), np.stack([right, across, below], -1)]
    ).reshape(-1, 3)
    mesh = trimesh.Trimesh(points, faces, process=False)
    mesh.vertex_normals  # noqa: B018 - made once, not in the time of a scene
    return mesh


@functools.cache
def ball(subdivisions: int = 4) -> trimesh.Trimesh:
    """Return a ball of radius 1."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    mesh.vertex_normals  # noqa: B018
    return mesh


def box(*extents: float) -> trimesh.Trimesh:
    """Return a box with corners of its own for each side."""
    found = trimesh.creation.box(extents=extents)
    found.unmerge_vertices()
    return found


def plain_material(pr: Any, color: tuple[float, ...], **options: Any) -> Any:
    """Return an opaque material, neither metallic nor smooth unless told."""
    options = {"metallicFactor": 0.0, "roughnessFactor": 0.7, "alphaMode": "OPAQUE", **options}
    return pr.MetallicRoughnessMaterial(baseColorFactor=color, **options)


@functools.cache
def globe(rows: int = 48, columns: int = 96) -> dict[str, NDArray[Any]]:
    """Return a ball with texture coordinates and tangents, as arguments of a primitive."""
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, columns + 1))
    around, down = 2.0 * np.pi * u.T.ravel(), np.pi * v.T.ravel()
    points = np.stack(
        [np.sin(down) * np.cos(around), np.cos(down), -np.sin(down) * np.sin(around)], -1
    )
    tangents = np.stack([-np.sin(around), 0.0 * around, -np.cos(around), np.ones_like(around)], -1)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + columns + 1, first + 1], -1),
            np.stack([first + 1, first + columns + 1, first + columns + 2], -1),
        ]
    )
    return {
        "positions": points, "normals": points, "tangents": tangents, "indices": faces,
        "texcoord_0": np.stack([u.T.ravel(), 1.0 - v.T.ravel()], -1),
    }  # fmt: skip


@functools.cache
def tiles(size: int = 256) -> NDArray[np.uint8]:
    """Return a picture of squares and a gradient, (S, S, 3)."""
    rows, columns = np.mgrid[:size, :size]
    squares = ((rows // 16 + columns // 16) % 2).astype(float)
    return np.stack(
        [80 + 150 * squares, 255 * rows / size, 40 + 200 * columns / size * (1 - 0.5 * squares)], -1
    ).astype(np.uint8)


@functools.cache
def bumps(size: int = 256) -> NDArray[np.uint8]:
    """Return a map of normals with round bumps, (S, S, 3)."""
    rows, columns = np.mgrid[:size, :size] * (2.0 * np.pi * 8.0 / size)
    slopes = np.stack([0.6 * np.cos(columns), 0.6 * np.cos(rows), np.ones_like(rows)], -1)
    slopes /= np.linalg.norm(slopes, axis=-1, keepdims=True)
    return np.rint(127.5 * (slopes + 1.0)).astype(np.uint8)


@scene_of
def plain(pr: Any) -> Built:
    """70 000 faces with the default material under two lights: what is timed."""
    scene = seen_from(pr, (0.0, 1.4, 2.4), sun=2.0)
    scene.add(pr.Mesh.from_trimesh(knot()))
    spot = pr.SpotLight(intensity=12.0, innerConeAngle=0.3, outerConeAngle=0.6)
    scene.add(spot, pose=towards((1.5, 2.5, 1.0)))
    return scene


@scene_of
def body(pr: Any) -> Built:
    """A mesh as body renderers draw it: matt, opaque, three lights, an intrinsics camera."""
    scene = pr.Scene(bg_color=[0.0, 0.0, 0.0, 0.0], ambient_light=(0.5, 0.5, 0.5))
    skin = pr.MetallicRoughnessMaterial(
        metallicFactor=0.0, alphaMode="OPAQUE", baseColorFactor=(0.65, 0.74, 0.86, 1.0)
    )
    scene.add(pr.Mesh.from_trimesh(knot(60, 40), material=skin))
    scene.add(pr.IntrinsicsCamera(fx=900.0, fy=900.0, cx=320.0, cy=240.0), pose=at(z=4.0))
    for place in ((0.0, -1.0, 1.0), (0.0, 1.0, 1.0), (1.0, 1.0, 2.0)):
        light = pr.DirectionalLight(color=[1.0, 1.0, 1.0], intensity=1.0)
        scene.add(light, pose=towards(place))
    return scene


@scene_of
def vertex_colors(pr: Any) -> Built:
    """Colours of vertices, smooth."""
    mesh = ball().copy()
    mesh.visual.vertex_colors = np.uint8(127.5 * (mesh.vertices + 1.0))
    scene = seen_from(pr)
    scene.add(pr.Mesh.from_trimesh(mesh))
    return scene


@scene_of
def face_colors(pr: Any) -> Built:
    """Colours of faces, and no smoothing."""
    mesh = ball(2).copy()
    mesh.visual.face_colors = np.random.default_rng(1).integers(0, 256, (len(mesh.faces), 3))
    scene = seen_from(pr)
    scene.add(pr.Mesh.from_trimesh(mesh, smooth=False))
    return scene


@scene_of
def textured(pr: Any) -> Built:
    """A base colour texture, of the kind that files bring."""
    uv = globe()["texcoord_0"]
    visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(tiles()))
    mesh = trimesh.Trimesh(
        globe()["positions"], globe()["indices"], vertex_normals=globe()["normals"],
        visual=visual, process=False,
    )  # fmt: skip
    scene = seen_from(pr)
    scene.add(pr.Mesh.from_trimesh(mesh))
    return scene


@scene_of
def all_maps(pr: Any) -> Built:
    """Maps of normals, metal and roughness, occlusion and emission."""
    rough = tiles().copy()
    rough[..., 0] = 255
    glow = np.zeros((64, 64, 3), np.uint8)
    glow[24:40, ::8] = (255, 120, 0)
    shade = np.repeat(np.linspace(90, 255, 64).astype(np.uint8)[:, None, None], 64, axis=1)
    material = pr.MetallicRoughnessMaterial(
        alphaMode="OPAQUE", baseColorFactor=(0.9, 0.8, 0.7, 1.0), emissiveFactor=(1.0, 1.0, 1.0),
        normalTexture=pr.Texture(source=bumps(), source_channels="RGB"),
        metallicRoughnessTexture=pr.Texture(source=rough, source_channels="RGB"),
        occlusionTexture=pr.Texture(source=np.repeat(shade, 3, axis=2), source_channels="RGB"),
        emissiveTexture=pr.Texture(source=glow, source_channels="RGB"),
    )  # fmt: skip
    scene = seen_from(pr, ambient_light=(0.2, 0.2, 0.2))
    scene.add(pr.Mesh([pr.Primitive(**globe(), material=material)]))
    return scene


def courtyard(pr: Any, lights: tuple[str, ...]) -> Built:
    """Return boxes and a ball on a floor under lights of some kinds."""
    scene = seen_from(pr, (2.0, 2.5, 4.0), sun=0.0, ambient_light=(0.1, 0.1, 0.1))
    floor = pr.Mesh.from_trimesh(box(4.0, 0.1, 4.0), material=plain_material(pr, (0.8, 0.8, 0.8)))
    scene.add(floor, pose=at(y=-0.55))
    red = pr.Mesh.from_trimesh(box(0.8, 1.0, 0.8), material=plain_material(pr, (0.9, 0.2, 0.2)))
    scene.add(red, pose=at(-0.7))
    blue = plain_material(pr, (0.2, 0.3, 0.9), metallicFactor=0.5, roughnessFactor=0.4)
    scene.add(pr.Mesh.from_trimesh(ball(), material=blue), pose=at(0.7, 0.0, 0.3) @ scaled(0.5))
    if "sun" in lights:
        sun = pr.DirectionalLight(color=[1.0, 0.9, 0.8], intensity=3.0)
        scene.add(sun, pose=towards((2.0, 3.0, 1.0)))
    if "spot" in lights:
        spot = pr.SpotLight(
            color=[0.6, 1.0, 0.6], intensity=30.0, innerConeAngle=0.3, outerConeAngle=0.5
        )
        scene.add(spot, pose=towards((-2.0, 3.0, 1.5)))
    if "bulb" in lights:
        scene.add(pr.PointLight(color=[0.8, 0.8, 1.0], intensity=10.0), pose=at(0.2, 1.5, 1.0))
    return scene


def scaled(size: float) -> Float64:
    """Return the pose that scales."""
    return np.diag([size, size, size, 1.0])


@scene_of
def three_lights(pr: Any) -> Built:
    """A light of each kind."""
    return courtyard(pr, ("sun", "spot", "bulb"))


@scene_of
def sun_and_spot(pr: Any) -> Built:
    """The two kinds that cast shadows in the original."""
    return courtyard(pr, ("sun", "spot"))


@scene_of
def smooth_floor(pr: Any) -> Built:
    """A floor, z up, whose corners share their normals with its sides, under one low sun."""
    scene = pr.Scene(ambient_light=(0.2, 0.2, 0.2))
    upright = trimesh.transformations.rotation_matrix(np.pi / 2.0, (1.0, 0.0, 0.0))
    scene.add(
        pr.PerspectiveCamera(yfov=np.pi / 4.0),
        pose=upright @ towards((1.8, 1.4, -1.2), (0, 0.3, 0)),
    )
    scene.add(
        pr.Mesh.from_trimesh(trimesh.creation.box(extents=(2.0, 2.0, 0.02))), pose=at(z=-0.26)
    )
    post = trimesh.creation.cylinder(radius=0.05, height=0.5, sections=48)
    scene.add(pr.Mesh.from_trimesh(post))
    scene.add(pr.Mesh.from_trimesh(post), pose=at(0.2, 0.0, 0.5))
    scene.add(pr.Mesh.from_trimesh(ball()), pose=at(0.4, 0.2, -0.1) @ scaled(0.15))
    turn = trimesh.transformations.euler_matrix(-0.7, 0.3, 0.0)
    scene.add(pr.DirectionalLight(intensity=4.0), pose=turn)
    return scene


@scene_of
def six_suns(pr: Any) -> Built:
    """More lights of a kind than four: the nearest of the mesh count."""
    scene = seen_from(pr, sun=0.0)
    scene.add(pr.Mesh.from_trimesh(ball(), material=plain_material(pr, (0.3, 0.3, 0.3))))
    colors = np.eye(3)[[0, 1, 2, 0, 1, 2]] * 0.5 + 0.5
    for number, color in enumerate(colors):
        turn = number * np.pi / 3.0
        place = (2.0 * np.cos(turn), 2.0 * np.sin(turn), 1.5 + 0.3 * number)
        scene.add(pr.DirectionalLight(color=color, intensity=1.0), pose=towards(place))
    return scene


@scene_of
def ambient_only(pr: Any) -> Built:
    """No light but the ambient one."""
    scene = seen_from(pr, sun=0.0, ambient_light=(0.3, 0.4, 0.5), bg_color=(0.2, 0.2, 0.2))
    scene.add(pr.Mesh.from_trimesh(ball(), material=plain_material(pr, (0.8, 0.6, 0.4))))
    return scene


@scene_of
def metal_and_rough(pr: Any) -> Built:
    """Balls: metallic from left to right, rough from bottom to top."""
    scene = seen_from(pr, (0.0, 0.0, 4.0), sun=2.5, ambient_light=(0.05, 0.05, 0.05))
    scene.add(pr.PointLight(intensity=15.0), pose=at(1.5, 1.5, 2.5))
    for row in range(4):
        for column in range(5):
            look = plain_material(
                pr, (0.9, 0.6, 0.3), metallicFactor=column / 4, roughnessFactor=0.1 + 0.3 * row
            )
            place = at(0.75 * (column - 2), 0.75 * (row - 1.5)) @ scaled(0.33)
            scene.add(pr.Mesh.from_trimesh(ball(3), material=look), pose=place)
    return scene


@scene_of
def blended(pr: Any) -> Built:
    """Boxes seen through, one behind the other, before a solid one."""
    scene = seen_from(pr, (0.5, 0.8, 4.0), bg_color=(1.0, 1.0, 1.0, 0.0))
    solid = plain_material(pr, (0.9, 0.8, 0.2))
    scene.add(pr.Mesh.from_trimesh(box(2.4, 0.4, 0.4), material=solid), pose=at(z=-1.0))
    colors = ((0.9, 0.1, 0.1, 0.5), (0.1, 0.8, 0.1, 0.8), (0.1, 0.2, 0.9, 0.3))
    for number, color in enumerate(colors):
        look = plain_material(pr, color, alphaMode="BLEND")
        mesh = pr.Mesh.from_trimesh(box(0.8, 0.8, 0.8), material=look)
        scene.add(mesh, pose=at(0.6 * (number - 1), 0.2 * number - 0.2, 0.7 * number - 0.4))
    return scene


@scene_of
def blended_vertices(pr: Any) -> Built:
    """Alpha of vertices."""
    mesh = ball().copy()
    colors = np.full((len(mesh.vertices), 4), 255, np.uint8)
    colors[:, :3] = 127.5 * (mesh.vertices + 1.0)
    colors[:, 3] = 60.0 + 190.0 * (mesh.vertices[:, 1] > 0.0)
    mesh.visual.vertex_colors = colors
    scene = seen_from(pr)
    behind = pr.Mesh.from_trimesh(box(1.0, 3.0, 0.1), material=plain_material(pr, (0.2, 0.2, 0.2)))
    scene.add(behind, pose=at(z=-2.0))
    scene.add(pr.Mesh.from_trimesh(mesh))
    return scene


@scene_of
def opaque_alpha(pr: Any) -> Built:
    """Opaque in name, with an alpha below 1; and a mask of a texture."""
    scene = seen_from(pr, (0.0, 0.6, 3.6))
    look = plain_material(pr, (0.9, 0.3, 0.2, 0.5))
    scene.add(pr.Mesh.from_trimesh(box(0.9, 0.9, 0.9), material=look), pose=at(-0.7))
    holes = np.dstack([tiles(), np.where(tiles()[..., 0] > 128, 255, 60)]).astype(np.uint8)
    mask = plain_material(
        pr, (1.0, 1.0, 1.0, 1.0), alphaMode="MASK", alphaCutoff=0.5,
        baseColorTexture=pr.Texture(source=holes, source_channels="RGBA"),
    )  # fmt: skip
    mesh = pr.Mesh([pr.Primitive(**globe(), material=mask)])
    scene.add(mesh, pose=at(0.8) @ scaled(0.6))
    return scene


@scene_of
def wires(pr: Any) -> Built:
    """A mesh drawn as its edges, and one with colours of vertices, beside a solid one."""
    scene = seen_from(pr, (0.0, 0.6, 3.6))
    edges = plain_material(pr, (0.9, 0.3, 0.3), wireframe=True)
    scene.add(pr.Mesh.from_trimesh(ball(2), material=edges), pose=at(-0.8) @ scaled(0.6))
    mesh = ball(2).copy()
    mesh.visual.vertex_colors = np.uint8(127.5 * (mesh.vertices + 1.0))
    scene.add(pr.Mesh.from_trimesh(mesh, wireframe=True), pose=at(0.8) @ scaled(0.6))
    solid = pr.Mesh.from_trimesh(box(0.5, 1.5, 0.5), material=plain_material(pr, (0.3, 0.5, 0.9)))
    scene.add(solid, pose=at(z=-0.8))
    return scene


@scene_of
def points(pr: Any) -> Built:
    """Points of five pixels with colours."""
    places = np.random.default_rng(2).normal(size=(3000, 3)) * 0.5
    colors = np.clip(places * 0.5 + 0.5, 0.0, 1.0)
    scene = seen_from(pr)
    scene.add(pr.Mesh.from_points(places, colors=colors))
    return scene


@scene_of
def lines(pr: Any) -> Built:
    """Lines, a strip and a loop of them, with colours."""
    turn = np.linspace(0.0, 4.0 * np.pi, 200)
    curve = np.stack([np.cos(turn), turn / 6.0 - 1.0, np.sin(turn)], -1)
    colors = np.stack([turn / turn[-1], 1.0 - turn / turn[-1], 0.5 + 0.0 * turn], -1)
    scene = seen_from(pr)
    look = plain_material(pr, (1.0, 1.0, 1.0))
    for mode, step in ((1, -0.5), (3, 0.0), (2, 0.5)):
        line = pr.Primitive(positions=curve, color_0=colors, mode=mode, material=look)
        scene.add(pr.Mesh([line]), pose=at(step) @ scaled(0.6))
    return scene


@scene_of
def instances(pr: Any) -> Built:
    """A hundred places of one mesh."""
    rows, columns = np.mgrid[-4.5:5.0, -4.5:5.0]
    poses = np.tile(np.eye(4), (100, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = 0.25 * columns.ravel(), 0.25 * rows.ravel()
    poses[:, 2, 3] = 0.3 * np.sin(columns.ravel()) * np.cos(rows.ravel())
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    mesh.visual.vertex_colors = np.uint8(127.5 * (mesh.vertices * 10.0 + 1.0))
    scene = seen_from(pr, (0.0, 0.0, 3.6))
    scene.add(pr.Mesh.from_trimesh(mesh, poses=poses))
    return scene


@scene_of
def flat_faces(pr: Any) -> Built:
    """Faces with normals of their own, of a mesh with few."""
    scene = seen_from(pr)
    look = plain_material(pr, (0.7, 0.7, 0.3), metallicFactor=0.4)
    scene.add(pr.Mesh.from_trimesh(ball(1), material=look, smooth=False))
    return scene


@scene_of
def both_sides(pr: Any) -> Built:
    """An open bowl that shows its inner side, and one that does not."""
    keep = ball().triangles_center[:, 1] < 0.2
    bowl = trimesh.Trimesh(ball().vertices, ball().faces[keep], process=False)
    scene = seen_from(pr, (0.0, 2.0, 3.4))
    for step, is_double in ((-0.8, True), (0.8, False)):
        look = plain_material(pr, (0.4, 0.8, 0.6), doubleSided=is_double)
        scene.add(pr.Mesh.from_trimesh(bowl, material=look), pose=at(step) @ scaled(0.7))
    return scene


@scene_of
def intrinsics(pr: Any) -> Built:
    """A camera as calibration gives it, its principal point beside the middle."""
    scene = pr.Scene(ambient_light=(0.1, 0.1, 0.1))
    camera = pr.IntrinsicsCamera(fx=700.0, fy=650.0, cx=250.5, cy=300.0, znear=0.1, zfar=20.0)
    scene.add(camera, pose=towards((0.5, 0.5, 3.0)))
    scene.add(pr.SpotLight(intensity=20.0, innerConeAngle=0.2, outerConeAngle=0.5),
              pose=towards((0.5, 0.5, 3.0)))  # fmt: skip
    scene.add(pr.Mesh.from_trimesh(knot(60, 40), material=plain_material(pr, (0.8, 0.5, 0.5))))
    return scene


@scene_of
def orthographic(pr: Any) -> Built:
    """A parallel projection."""
    scene = pr.Scene()
    scene.add(pr.OrthographicCamera(xmag=1.6, ymag=1.2, znear=0.1, zfar=10.0),
              pose=towards((1.0, 1.5, 3.0)))  # fmt: skip
    scene.add(pr.DirectionalLight(intensity=3.0), pose=towards((0.0, 1.0, 1.0)))
    scene.add(pr.Mesh.from_trimesh(knot(60, 40), material=plain_material(pr, (0.5, 0.8, 0.5))))
    return scene


@scene_of
def weak_perspective(pr: Any) -> Built:
    """A camera of one's own, as body renderers with a scale and a shift have it."""

    class Weak(pr.Camera):  # type: ignore[misc, name-defined]
        def get_projection_matrix(self, width: Any = None, height: Any = None) -> Float64:
            found = np.eye(4)
            found[0, 0], found[1, 1], found[2, 2] = 0.7, 0.9, -1.0
            found[0, 3], found[1, 3] = 0.1, -0.05
            return found

    scene = pr.Scene(bg_color=[0.0, 0.0, 0.0, 0.0], ambient_light=(0.3, 0.3, 0.3))
    scene.add(Weak(znear=0.05, zfar=1000.0))
    small = knot(60, 40).copy()
    small.apply_scale(0.7)
    look = plain_material(pr, (0.9, 0.8, 0.6), metallicFactor=0.2)
    scene.add(pr.Mesh.from_trimesh(small, material=look))
    scene.add(pr.DirectionalLight(intensity=3.0), pose=towards((0.0, 1.0, 1.0)))
    return scene
