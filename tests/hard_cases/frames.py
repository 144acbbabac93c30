"""
Small frames that use every feature, and the recorded hashes of all their outputs.

Nothing here depends on a math library or a random generator: coordinates are whole numbers,
quotients and square roots, whose bits IEEE 754 fixes, and the "random" ones are a small generator
of whole numbers. So the same frames are made everywhere.

``python tests/hard_cases/frames.py`` writes ``frame_hashes.json``; with ``--print`` it prints the
hashes of this run instead, of all outputs or of those named behind it.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import rasterjit as rj

HERE = Path(__file__).parent
MODELS = HERE.parent.parent / "models"
RECORDED = HERE / "frame_hashes.json"

BUFFERS = ("depth", "face_id", "object_id", "barycentric", "normal", "position")
"""What any scene can show, but for its colours."""
EVERYTHING = ("color", "linear", *BUFFERS)
GROUND_TRUTH = (
    "distance", "object_position", "nocs", "geometric_normal", "material_id", "instance_id",
    "coverage", "motion", "motion_visible",
)  # fmt: skip
"""What else it can show, of motion beside an earlier view."""

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Shot:
    """A scene and what `rasterjit.render` is asked about it."""

    scene: rj.Scene
    camera: Any
    size: tuple[int, int] = (120, 80)
    outputs: tuple[str, ...] = EVERYTHING
    bits: int = 8
    samples: int | str = 1
    options: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    """Of the quality, besides."""

    @property
    def quality(self) -> rj.Quality:
        """How accurately it is rendered."""
        return rj.Quality(self.bits, self.samples, **self.settings)

    def draw(self, threads: int = 1) -> Arrays:
        """Render in a renderer of its own."""
        with rj.Renderer(self.size, quality=self.quality, threads=threads) as renderer:
            return self.draw_with(renderer)

    def draw_with(self, renderer: rj.Renderer) -> Arrays:
        """Render in one that may have rendered before."""
        frame = renderer.render(self.scene, self.camera, outputs=self.outputs, **self.options)
        return frame.arrays()

    def rotated(self, turn: int) -> Shot:
        """Return the same shot with every face spelled from another of its vertices."""
        again: dict[int, rj.Mesh] = {}
        scene, options = respelled(self.scene, turn, again), dict(self.options)
        if "previous" in options:
            previous = options["previous"]
            earlier = respelled(previous.scene, turn, again)
            options["previous"] = replace(previous, scene=earlier)
        return replace(self, scene=scene, options=options)


@dataclass(frozen=True)
class Peeled:
    """A scene and what `rasterjit.render_layers` is asked about it."""

    shot: Shot
    layers: int

    def draw(self, threads: int = 1) -> Arrays:
        """Find the layers."""
        shot = self.shot
        frame = rj.render_layers(
            shot.scene, shot.camera, k=self.layers, size=shot.size, quality=shot.quality,
            outputs=shot.outputs, threads=threads, **shot.options,
        )  # fmt: skip
        return frame.arrays()

    def rotated(self, turn: int) -> Peeled:
        """Return the same with every face spelled from another of its vertices."""
        return replace(self, shot=self.shot.rotated(turn))


@dataclass(frozen=True)
class Soup:
    """Loose triangles in clip space and what `rasterjit.rasterize` is asked about them."""

    clip_positions: np.ndarray
    faces: np.ndarray
    size: tuple[int, int] = (128, 96)
    options: dict[str, Any] = field(default_factory=dict)

    def draw(self, threads: int = 1) -> Arrays:
        """Rasterize."""
        seen = rj.rasterize(
            self.clip_positions, self.faces, self.size, threads=threads, **self.options
        )
        return {"face_id": seen.face_id, "depth": seen.depth, "barycentric": seen.barycentric}

    def rotated(self, turn: int) -> Soup:
        """Return the same soup with every face spelled from another of its vertices."""
        return replace(self, faces=np.roll(self.faces, -turn, axis=1))


@dataclass(frozen=True)
class Canvas:
    """What is drawn straight into a framebuffer."""

    paint: Callable[[rj.Framebuffer, int], None]
    size: tuple[int, int] = (140, 100)
    turn: int = 0

    def draw(self, threads: int = 1) -> Arrays:
        """Draw; a framebuffer has one thread."""
        del threads
        target = rj.Framebuffer(*self.size)
        self.paint(target, self.turn)
        return {"color": target.color, "depth": target.depth}

    def rotated(self, turn: int) -> Canvas:
        """Return the same canvas with every triangle spelled from another of its vertices."""
        return replace(self, turn=turn)


def respelled(scene: rj.Scene, turn: int, again: dict[int, rj.Mesh]) -> rj.Scene:
    """Return a scene with every face spelled from another vertex; ``again`` holds the meshes."""
    found = copy.copy(scene)
    found.nodes = []
    for node in scene.nodes:
        mesh = node.mesh
        if id(mesh) not in again:
            again[id(mesh)] = with_faces(mesh, np.roll(mesh.faces, -turn, axis=1))
        found.add(again[id(mesh)], node.world_from_model, node.name)
    return found


def with_faces(mesh: rj.Mesh, faces: np.ndarray) -> rj.Mesh:
    """Return a mesh with other faces, as many as it had; lines and points as they are."""
    if mesh.primitive != "triangles":
        return mesh
    colors = mesh.vertex_colors if mesh.face_colors is None else mesh.face_colors
    return rj.Mesh(
        mesh.vertices, faces, colors=colors, normals=mesh.normals, uv=mesh.uv,
        material=mesh.material, on_invalid="drop",
    )  # fmt: skip


def numbers(seed: int, count: int, low: int, high: int) -> np.ndarray:
    """Return whole numbers in low..high, (count,) float64, from a linear congruential generator."""
    found = np.empty(count)
    for n in range(count):
        seed = (seed * 1103515245 + 12345) % 2**31
        found[n] = low + (seed >> 8) % (high - low + 1)
    return found


def ball(rows: int = 6, **kwargs: Any) -> rj.Mesh:
    """Return a ball of radius 1: the octahedron, each side cut into rows**2 triangles."""
    places: dict[tuple[int, int, int], int] = {}
    faces = []
    for sx, sy, sz in [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]:

        def place(i: int, j: int, signs: tuple[int, int, int] = (sx, sy, sz)) -> int:
            corner = (i * signs[0], j * signs[1], (rows - i - j) * signs[2])
            return places.setdefault(corner, len(places))

        for i in range(rows):
            for j in range(rows - i):
                some = [(place(i, j), place(i + 1, j), place(i, j + 1))]
                if i + j < rows - 1:
                    some.append((place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)))
                faces += [t if sx * sy * sz > 0 else t[::-1] for t in some]
    points = np.array([[c / math.sqrt(sum(d * d for d in p)) for c in p] for p in places])
    return rj.Mesh(points, faces, **kwargs)


def plane(cells: int, half: float, **kwargs: Any) -> rj.Mesh:
    """Return a square in y = 0, seen from above, with uv over it."""
    steps = [2.0 * half * k / cells - half for k in range(cells + 1)]
    points = [(x, 0.0, z) for z in steps for x in steps]
    faces = []
    for row in range(cells):
        for column in range(cells):
            a = row * (cells + 1) + column
            c = a + cells + 1
            faces += [(a, c, a + 1), (a + 1, c, c + 1)]
    uv = [(column / cells, row / cells) for row in range(cells + 1) for column in range(cells + 1)]
    return rj.Mesh(points, faces, uv=uv, **kwargs)


def rainbow(count: int) -> np.ndarray:
    """Return many different sRGB colours, (count, 3) uint8."""
    k = np.arange(count)
    return np.stack([k * 37 % 256, k * 91 % 256, 255 - k * 53 % 256], axis=1).astype(np.uint8)


def colored(mesh: rj.Mesh, by: str, shading: str, **kwargs: Any) -> rj.Mesh:
    """Return a mesh with a colour for each vertex or face."""
    colors = rainbow(len(mesh.vertices if by == "vertex" else mesh.faces))
    material = rj.Material(shading=shading, base_color="white", **kwargs)
    return rj.Mesh(mesh.vertices, mesh.faces, colors=colors, uv=mesh.uv, material=material)


def scene_of(*meshes: rj.Mesh, apart: float = 0.0) -> rj.Scene:
    """Return a scene of meshes side by side."""
    scene = rj.Scene()
    for n, mesh in enumerate(meshes):
        scene.add(mesh, rj.transforms.translate((apart * (n - (len(meshes) - 1) / 2), 0.0, 0.0)))
    return scene


def looking(eye=(2.0, 1.5, 4.0), target=(0.0, 0.0, 0.0), **kwargs: Any) -> rj.PerspectiveCamera:
    return rj.PerspectiveCamera(eye=eye, target=target, **kwargs)


def loaded(name: str) -> rj.Scene:
    """Return a model, whatever it holds that is not shown."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return rj.load(MODELS / name)


LIGHTS = [
    rj.AmbientLight("#334455", 0.5),
    rj.DirectionalLight((-1.0, -2.0, -1.5), "orange", 0.75),
    rj.DirectionalLight((2.0, 0.0, -1.0), (0.1, 0.3, 0.9), 0.5),
    rj.PointLight((0.5, 1.5, 1.0), "white", 1.25),
]


def teapot() -> Shot:
    scene = loaded("teapot.obj")
    return Shot(scene, rj.fit_camera(scene, aspect=200 / 150), (200, 150))


def torus_knot() -> Shot:
    scene = loaded("torus_knot.obj")
    camera = rj.fit_camera(scene, (1, 2, 3), projection="orthographic", zoom=1.5)
    return Shot(scene, camera, (150, 120), options={"background": "#204060"})


def gltf_scene() -> Shot:
    scene = loaded("scene.glb")
    return Shot(scene, scene.camera, (160, 120), (*EVERYTHING, "uv"))


def textures() -> Shot:
    picture = rainbow(13 * 6).reshape(6, 13, 3)
    shadings = ("unlit", "flat", "gouraud", "phong", "phong")
    wraps = ("repeat", "clamp", "mirror", ("repeat", "mirror"), "repeat")
    filters = ("trilinear", "nearest", "bilinear", "trilinear", "nearest")
    scene = rj.Scene()
    scene.lights = LIGHTS
    for n, (shading, wrap, kind) in enumerate(zip(shadings, wraps, filters, strict=True)):
        texture = rj.Texture(picture, wrap=wrap, filter=kind)
        strip = plane(3, 1.0)
        mesh = rj.Mesh(
            strip.vertices, strip.faces, uv=(strip.uv - 0.3) * (2.5, -7.0),
            colors=rainbow(len(strip.vertices)) if n == 4 else None,
            material=rj.Material(shading, base_color_texture=texture),
        )  # fmt: skip
        place = rj.transforms.translate((2.1 * (n - 2), 0.0, 0.0))
        scene.add(mesh, rj.transforms.compose(place, rj.transforms.scale((1.0, 1.0, 9.0))))
    scene.add(ball(3), rj.transforms.translate((0.0, 1.0, -6.0)))
    # The strips pass below the eye, cut by the near plane.
    camera = looking((0.5, 1.5, 4.0), (0.2, 0.0, -2.0), fov_y=75.0)
    return Shot(scene, camera, outputs=(*EVERYTHING, "uv"))


def cube() -> Shot:
    scene = loaded("cube.ply")
    return Shot(scene, rj.fit_camera(scene, (0, 1, 0)), (96, 64))


def unlit_vertex_colours() -> Shot:
    return Shot(scene_of(colored(ball(), "vertex", "unlit")), looking(fov_y=35.0))


def flat_face_colours() -> Shot:
    scene = scene_of(colored(ball(), "face", "flat", specular=0.8, shininess=7.5))
    scene.lights = LIGHTS
    return Shot(scene, looking(fov_y=35.0), options={"background": (0.25, 0.5, 0.75, 0.5)})


def gouraud_vertex_colours() -> Shot:
    scene = scene_of(colored(ball(4), "vertex", "gouraud", specular=0.5, shininess=20.0))
    scene.lights = LIGHTS
    return Shot(scene, looking(fov_y=35.0))


def phong_highlights() -> Shot:
    gloss = ((0.3, 0.5), (1.0, 15.0), (5.0, 900.0))
    materials = [rj.Material("phong", "orange", specular=s, shininess=n) for s, n in gloss]
    scene = scene_of(*(ball(5, material=material) for material in materials), apart=2.1)
    scene.lights = LIGHTS
    return Shot(scene, looking((0.0, 2.0, 7.0)), (160, 80))


def all_shadings() -> Shot:
    models = ("unlit", "flat", "gouraud", "phong")
    meshes = [colored(ball(4), by, s) for s, by in zip(models, ("vertex", "face") * 2, strict=True)]
    scene = scene_of(*meshes, apart=2.2)
    scene.lights = LIGHTS
    return Shot(scene, looking((1.0, 1.0, 9.0)), (200, 70), bits=4)


def light_near_surface() -> Shot:
    scene = scene_of(plane(6, 3.0, material=rj.Material("phong", "white", specular=1.0)))
    scene.lights = [
        rj.PointLight((0.3, 2.0**-20, 0.1), "red", 0.01),
        rj.PointLight((-1.0, 0.0, 0.0), "blue", 1.0),
        rj.PointLight((1.5, 0.125, -1.0), "green", 0.5),
    ]
    return Shot(scene, looking((0.5, 1.5, 3.5)))


def wireframe_overlay() -> Shot:
    scene = scene_of(ball(5))
    scene.wireframe = rj.Wireframe("#c04020", "overlay")
    return Shot(scene, looking(fov_y=35.0), (140, 110))


def wireframe_only() -> Shot:
    scene = scene_of(colored(ball(4), "vertex", "phong"), plane(5, 2.0))
    scene.wireframe = rj.Wireframe((0.2, 0.4, 0.9), "only")
    return Shot(scene, looking(fov_y=35.0), options={"background": "transparent"})


def wireframe_clipped() -> Shot:
    scene = scene_of(plane(12, 40.0))
    scene.wireframe = rj.Wireframe("white", "overlay")
    return Shot(scene, looking((0.0, 0.5, 0.0), (1.0, 0.25, -2.0)), options={"background": "gray"})


def occluded_and_outlined() -> Shot:
    scene = scene_of(ball(), plane(6, 2.0), apart=0.0)
    scene.lights = [
        rj.AmbientLight(intensity=0.6),
        rj.DirectionalLight((-1, -2, -3), intensity=0.4),
    ]
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=0.75)
    scene.outline = rj.Outline("#20304f", width=2, crease_angle=30.0)
    return Shot(scene, looking())


def darkened_corners() -> Shot:
    scene = scene_of(ball(), plane(6, 2.0), apart=0.0)
    scene.vignette = rj.Vignette(0.8, 0.2)
    return Shot(scene, looking(), (121, 80))


def behind_neighbours() -> Shot:
    scene = scene_of(ball(), plane(6, 2.0), apart=0.0)
    scene.eye_dome = rj.EyeDome(0.5, 2.0)
    return Shot(scene, looking())


def behind_neighbours_in_parallel() -> Shot:
    camera = rj.OrthographicCamera(eye=(2, 1, 4), target=(0, 0, 0), height=4.0, near=0.5, far=30.0)
    return replace(behind_neighbours(), camera=camera)


def cut_open() -> Shot:
    """Return a shot of balls, one inside the other, cut by two planes."""
    scene = scene_of(ball(), apart=0.0)
    scene.add(ball(5), rj.transforms.scale(0.5) @ rj.transforms.rotate_x(40.0))
    scene.section = [
        rj.SectionPlane((0.1, 0.0, 0.2), (0.3, 0.2, 1.0), cap_color="#b04030", lines=True),
        rj.SectionPlane(
            (0.0, 0.3, 0.0), (0.0, 1.0, 0.1), line_color="#203060", line_width=3, lines=True
        ),
    ]
    return Shot(scene, looking())


def coarse_geometry() -> Shot:
    """Return a shot whose depths, vertices and weights are those of the least accurate settings."""
    settings = {"depth_format": "unorm16", "precision": "float32", "interpolation": "affine"}
    return replace(occluded_and_outlined(), settings=settings)


def checked(rows: int, columns: int, *colors: Any) -> np.ndarray:
    """Return a board of colours in turn, (rows, columns, channels), linear."""
    return np.array(colors)[np.indices((rows, columns)).sum(axis=0) % len(colors)]


def sky() -> np.ndarray:
    """Return a panorama that differs in every direction, (8, 16, 3), linear."""
    return 2.0 * rainbow(128).reshape(8, 16, 3).astype(np.float64) ** 2


def materials_under_a_sky() -> Shot:
    scene = rj.Scene()
    bumps = rj.Texture(
        checked(8, 8, (0.3, 0.6, 0.9), (0.6, 0.4, 0.8)), color_space="linear", anisotropy=4
    )
    polish = rj.Texture(checked(4, 4, (0.9, 0.2, 1.0), (0.4, 0.8, 0.1)), color_space="linear")
    glow = rj.Texture(checked(5, 3, (0.0, 0.0, 0.0), (0.9, 0.5, 0.1)))
    metal = rj.Material(
        "pbr", "orange", metallic=0.9, roughness=0.4, normal_texture=bumps,
        metallic_roughness_texture=polish, occlusion_texture=polish,
    )  # fmt: skip
    lamp = rj.Material("pbr", "#203080", emissive=(1.0, 0.8, 0.5), emissive_texture=glow)
    for n, material in enumerate((metal, lamp, rj.Material("gouraud"), rj.Material("unlit"))):
        place = rj.transforms.translate((2.2 * n - 3.3, 0.0, 0.0))
        shape = ball(5)
        mesh = rj.Mesh(shape.vertices, shape.faces, uv=shape.vertices[:, :2], material=material)
        scene.add(mesh, place)
    scene.environment = rj.Environment(sky(), intensity=0.8, rotation=30.0)
    scene.fog = rj.Fog("gray", "exp", density=0.05, height=0.0, falloff=0.5)
    scene.tone_map = rj.ToneMap("neutral", 0.5)
    return Shot(scene, looking((1.0, 1.5, 7.0)))


def shadows_of_all_lights() -> Shot:
    scene = rj.Scene()
    floor = plane(3, 4.0)
    board = rj.Texture(checked(6, 6, (1.0, 1.0, 1.0, 1.0), (1.0, 0.5, 0.2, 0.0)))
    screen = rj.Material("phong", alpha_mode="mask", base_color_texture=board)
    scene.add(floor, rj.transforms.translate((0.0, -1.0, 0.0)))
    scene.add(ball(5, material=rj.Material("pbr", roughness=0.3)))
    scene.add(
        rj.Mesh(floor.vertices / 4.0, floor.faces, uv=floor.uv, material=screen),
        rj.transforms.translate((-1.8, 0.5, 0.0)),
    )
    scene.lights = [
        rj.DirectionalLight((-1, -2, -0.5), intensity=0.4, shadow=rj.Shadow(64, "pcf")),
        rj.SpotLight((2, 3, 2), (-1, -2, -1), "yellow", 6.0, 10, 40, 9, rj.Shadow(64, "hard")),
        rj.PointLight((-1, 2, 2), "cyan", 2.0, 7, rj.Shadow(32, "soft", 0.3)),
    ]
    return Shot(scene, looking((2.0, 2.0, 5.0)))


def shadows_where_surfaces_touch() -> Shot:
    """Draw walls and a lid on the ground, in the light of three suns."""
    scene = rj.Scene()
    scene.add(plane(2, 3.0))
    walls = [[-2, 0, -1], [-2, 0, 1], [-2, 1, 1], [-2, 1, -1], [0, 0, -1], [0, 1, -1], [1, 0, 1],
             [1, 1, 0]]  # fmt: skip
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [3, 5, 4], [4, 5, 6], [5, 7, 6], [3, 2, 5]]
    scene.add(rj.Mesh(walls, faces, material=rj.Material("flat", "orange")))
    scene.lights = [
        rj.DirectionalLight((-2, -3, 1), "red", 0.5, rj.Shadow(48, "hard")),
        rj.DirectionalLight((2, -3, 2), "green", 0.5, rj.Shadow(64, "pcf")),
        rj.DirectionalLight((1, -2, -2), "blue", 0.5, rj.Shadow(64, "soft", 2.0)),
    ]
    return Shot(scene, looking((1.0, 3.0, 5.0)))


def glass(samples: int | str, size: tuple[int, int]) -> Shot:
    """Return surfaces that cross and are seen through each other, one with holes."""
    scene = shadows_of_all_lights().scene
    scene.lights = LIGHTS
    scene.tone_map = rj.ToneMap("aces")
    clear = rj.Material("phong", (0.3, 0.6, 0.9, 0.4), alpha_mode="blend")
    colors = np.hstack([rainbow(16) / 255.0, np.linspace(0.1, 1.0, 16)[:, np.newaxis]])
    scene.add(ball(4, material=clear), rj.transforms.translate((0.5, 0.0, 0.5)))
    scene.add(
        rj.Mesh(plane(3, 2.0).vertices, plane(3, 2.0).faces, colors=colors, material=clear),
        rj.transforms.rotate_x(70.0),
    )
    return Shot(scene, looking((2.0, 2.0, 5.0)), size, samples=samples)


def layers_of_glass() -> Shot:
    return glass(1, (120, 80))


def layers_in_four_samples() -> Shot:
    return glass(4, (120, 80))


def edges_in_eight_samples() -> Shot:
    scene = scene_of(colored(ball(4), "vertex", "phong"), plane(3, 2.0))
    return Shot(scene, looking(), samples=8)


def many_pictures() -> Shot:
    """Return each of 64 samples shaded by itself, before a background that is seen through."""
    clear = rj.Material("phong", (0.3, 0.6, 0.9, 0.4), alpha_mode="blend")
    scene = scene_of(ball(1), plane(1, 2.0), rj.Mesh(ball(1).vertices * 1.5, ball(1).faces,
                     material=clear))  # fmt: skip
    scene.lights = [rj.DirectionalLight((-1.0, -2.0, -0.5), shadow=rj.Shadow(16))]
    scene.tone_map = rj.ToneMap("aces")
    options = {"background": (0.2, 0.4, 0.6, 0.5)}
    return Shot(scene, looking(), (12, 9), samples=64, options=options)


def ground_truth() -> Shot:
    """Return what is known of each pixel, and how far it has moved since."""
    bent = rj.Mesh(ball(4).vertices * (1.0, 0.8, 1.3), ball(4).faces)
    places = [rj.transforms.translate((0.4 * n, 0.1 * n, -0.9 * n)) for n in range(3)]
    scenes = [rj.Scene(), rj.Scene()]
    for n, place in enumerate(places):
        scenes[0].add(ball(4) if n == 1 else bent, place)
        scenes[1].add(bent, places[n - 1])
    for scene in scenes:
        scene.add(plane(3, 2.0))
    previous = rj.PreviousView(scenes[1], looking((0.3, 1.4, 4.2), (0.1, 0.0, 0.0), fov_y=44.0))
    options = {"previous": previous, "cull": "back"}
    outputs = ("depth", "face_id", *GROUND_TRUTH)
    return Shot(scenes[0], looking(), outputs=outputs, samples=4, options=options)


def layers_peeled() -> Peeled:
    """Return the layers of glass and of what has holes."""
    scene = rj.Scene()
    clear = rj.Material(base_color=(0.3, 0.6, 0.9, 0.4), alpha_mode="blend")
    scene.add(rj.Mesh(ball(4).vertices * 1.5, ball(4).faces, material=clear))
    strip = plane(3, 1.5)
    alphas = np.dstack([np.ones((4, 5, 3)), rainbow(20)[:, 0].reshape(4, 5) / 255.0])
    holes = rj.Material(base_color_texture=rj.Texture(alphas), alpha_mode="mask", alpha_cutoff=0.4)
    for n in range(4):
        place = rj.transforms.compose(
            rj.transforms.translate((0.0, 0.0, 0.5 * n)), rj.transforms.rotate_x(70.0 + 10.0 * n)
        )
        scene.add(rj.Mesh(strip.vertices, strip.faces, uv=strip.uv, material=holes), place)
    outputs = "depth", "face_id", "normal", "position", "distance"
    return Peeled(Shot(scene, looking(), (90, 70), outputs), 6)


def areas() -> Shot:
    return replace(shadows_of_all_lights(), size=(60, 40), samples="area")


def codes_of_glass() -> Shot:
    settings = {"blending": "srgb8", "transparency_layers": 2}
    return replace(glass(1, (120, 80)), settings=settings)


def codes_in_four_samples() -> Shot:
    shot = glass(4, (60, 40))
    return replace(shot, settings={"blending": "srgb8"}, options={"background": "transparent"})


def codes_of_many_pictures() -> Shot:
    return replace(many_pictures(), settings={"blending": "srgb8"})


def codes_at_edges() -> Shot:
    return replace(edges_in_eight_samples(), settings={"blending": "srgb8"})


def lines_by_coverage() -> Shot:
    return replace(wireframe_overlay(), settings={"lines": "coverage"})


def lines_by_coverage_in_codes() -> Shot:
    shot = wireframe_clipped()
    shot.scene.wireframe = rj.Wireframe("#c04020", "only")
    settings = {"lines": "coverage", "blending": "srgb8"}
    return replace(shot, settings=settings, options={"background": "transparent"})


def culled_back() -> Shot:
    scene = scene_of(ball(4), plane(3, 2.0))
    return Shot(scene, looking((1.0, -2.0, 4.0)), options={"cull": "back"})


def culled_front_and_mirrored() -> Shot:
    mesh = colored(ball(4), "face", "phong")
    scene = rj.Scene()
    turned = rj.transforms.rotate((1, 2, 3), 50.0)
    scene.add(mesh, rj.transforms.compose(rj.transforms.translate((-1.2, 0, 0)), turned))
    mirrored = rj.transforms.scale((-1.0, 0.5, 1.5))
    scene.add(mesh, rj.transforms.compose(rj.transforms.translate((1.2, 0, 0)), mirrored, turned))
    scene.lights = LIGHTS
    return Shot(scene, looking(), options={"cull": "front"})


def parallel() -> Shot:
    scene = scene_of(ball(6), plane(4, 3.0))
    camera = rj.OrthographicCamera((3, 2, 5), (0, 0, 0), (0.1, 1, 0), height=3.5, near=2.0, far=9.0)
    return Shot(scene, camera, bits=12)


def mirroring_matrices() -> Shot:
    scene = scene_of(colored(ball(5), "vertex", "phong"))
    clip = rj.transforms.orthographic(2.0, -1.5, -1.25, 1.5, 0.0, 10.0)
    return Shot(scene, rj.MatrixCamera(looking().view_matrix(), clip), (100, 90))


def intrinsics() -> Shot:
    scene = scene_of(ball(5), plane(4, 5.0))
    camera = rj.MatrixCamera.from_intrinsics(
        150.0, 140.0, 31.25, 47.5, (120, 90), view_from_world=looking().view_matrix(),
        near=0.5, far=8.0,
    )  # fmt: skip
    return Shot(scene, camera, (120, 90))


def ground_to_the_horizon() -> Shot:
    ground = plane(2, 1e6, material=rj.Material("phong", "#3c7832"))
    camera = looking((0.0, 1.7, 0.0), (3.0, 1.5, -10.0), near=0.01, far=5e4)
    return Shot(scene_of(ground), camera, (160, 100), (*EVERYTHING, "uv"))


def inside_a_ball() -> Shot:
    scene = scene_of(colored(ball(3), "vertex", "gouraud"))
    return Shot(scene, looking((0.3, 0.2, 0.1), (1.0, 0.5, -1.0), fov_y=120.0, near=0.05))


def slivers() -> Shot:
    points, faces = [], []
    for k in range(240):
        x = (k - 120) / 12.0
        points += [(x, -1.0, 0.0), (x + 1 / 4096, -1.0, 0.0), (x + (k % 7 - 3) / 5.0, 1.0, -k / 97)]
        faces.append((3 * k, 3 * k + 1, 3 * k + 2))
    mesh = rj.Mesh(points, faces, colors=rainbow(240), material=rj.Material("unlit", "white"))
    return Shot(scene_of(mesh), looking((0.0, 0.1, 1.2), fov_y=50.0), (1000, 30))


def far_from_the_origin() -> Shot:
    place = np.array((1e7, -2e7, 3e7))
    mesh = ball(5)
    scene = rj.Scene()
    scene.add(rj.Mesh(mesh.vertices + place, mesh.faces))
    scene.lights = [rj.PointLight(place + (1, 2, 2), "white", 4.0)]
    return Shot(scene, looking(place + (2, 1, 4), place))


def vast_and_tiny() -> Shot:
    mesh = ball(4)
    vast = rj.Mesh(mesh.vertices * 2.0**400, mesh.faces)
    tiny = rj.Mesh(mesh.vertices * 2.0**-300, mesh.faces, colors=rainbow(len(mesh.faces)))
    scene = rj.Scene()
    scene.add(vast, np.diag([2.0**-400, 2.0**-400, 2.0**-400, 1.0]))
    moved = np.diag([2.0**300, 2.0**300, 2.0**300, 1.0])
    moved[:3, 3] = (1.5, 0.5, 1.0)
    scene.add(tiny, moved)
    return Shot(scene, looking(near=1e-3, far=1e9))


def points_of_all_shapes() -> Shot:
    places = numbers(12, 180, -64, 64).reshape(60, 3) / 32.0
    colors = rainbow(60)
    scene = rj.Scene()
    scene.add(rj.Points(places, colors=colors, size=3.0))
    scene.add(rj.Points(places[::-1], colors=colors, size=0.3, unit="world", shape="disc",
                        normals=places + 0.125))  # fmt: skip
    scene.add(rj.Points(places[:, ::-1], colors=colors, size=0.5, unit="world", shape="sphere"))
    scene.add(plane(4, 3.0))
    scene.lights = [
        rj.AmbientLight(intensity=0.25),
        rj.DirectionalLight((-1, -2, -1.5), intensity=1.5, shadow=rj.Shadow(size=256)),
    ]
    return Shot(scene, looking(near=0.5, far=20.0))


def whole_pixels() -> Shot:
    return Shot(scene_of(colored(ball(5), "face", "unlit")), looking(fov_y=35.0), bits=0)


def equal_depths() -> Shot:
    scene = rj.Scene()
    for n, shading in enumerate(("unlit", "flat", "phong", "unlit")):
        mesh = colored(plane(3 + n, 1.0), "face", shading)
        scene.add(mesh, rj.transforms.translate((n / 4, 0.0, n / 8)))
    return Shot(scene, looking((0.0, 3.0, 2.0)), (130, 90), (*EVERYTHING, "uv"))


def soup() -> Soup:
    values = numbers(1, 900 * 4, -96, 96).reshape(-1, 4) / 32.0
    values[:, 3] = np.abs(values[:, 3]) + 1.0
    return Soup(values, np.arange(900).reshape(-1, 3), options={"quality": rj.Quality(12)})


def wild_soup() -> Soup:
    values = numbers(2, 600 * 4, -400, 400).reshape(-1, 4) / 64.0
    values[::41] *= 1e30
    values[::53, 1] = np.nan
    values[::67, 3] = 0.0
    faces = numbers(3, 900, 0, 599).reshape(-1, 3).astype(np.int64)
    return Soup(values, faces, (150, 110), {"depth": "reversed", "cull": "back"})


def lines_and_curves() -> Canvas:
    def paint(target: rj.Framebuffer, turn: int) -> None:
        del turn
        target.clear((10, 20, 30))
        ends = numbers(4, 240, -40, 180).reshape(-1, 4).astype(int)
        target.draw_lines(ends, rainbow(2 * len(ends)).reshape(-1, 2, 3))
        target.draw_line((-(2**31), 7), (2**31 - 1, 90), (255, 255, 255), (0, 0, 0, 128))
        for radius in (0, 1, 2, 17, 60, 90):
            target.draw_circle((70, 50), radius, (radius, 255 - radius, 128))
        target.draw_bezier([(5, 90), (60.25, -80), (135.5, 95)], (255, 0, 0), (0, 0, 255))
        target.draw_bezier([(0, 0), (200, 10), (-60, 90), (139, 99)], (0, 255, 0))
        for k in range(20):
            target.put_pixel(7 * k, 3 * k, (255, 255, 0))

    return Canvas(paint)


def many_lines() -> Canvas:
    def paint(target: rj.Framebuffer, turn: int) -> None:
        del turn
        ends = numbers(7, 4 * 9000, -40, 180).reshape(-1, 4).astype(int)
        ends[::9] *= 2**20
        target.draw_lines(ends, rainbow(2 * len(ends)).reshape(-1, 2, 3))

    return Canvas(paint)


def filled_triangles() -> Canvas:
    def paint(target: rj.Framebuffer, turn: int) -> None:
        corners = numbers(5, 40 * 6, -30, 160).reshape(-1, 3, 2).astype(int)
        depths = numbers(6, 40 * 3, 0, 64).reshape(-1, 3) / 64.0
        colors = rainbow(120).reshape(-1, 3, 3)
        for n in range(40):
            order = np.roll([0, 1, 2], -turn)
            target.fill_triangle(
                *corners[n][order],
                colors[n][order],
                edges=("top-left", "inclusive")[n % 2],
                method=("barycentric", "scanline")[n // 2 % 2],
                depth=depths[n][order] if n % 3 else None,
            )
        target.draw_triangle((5, 5), (130, 20), (60, 95), (255, 255, 255))

    return Canvas(paint)


FRAMES: dict[str, Callable[[], Shot | Soup | Canvas]] = {
    make.__name__: make
    for make in (
        teapot, torus_knot, gltf_scene, textures, cube, unlit_vertex_colours, flat_face_colours,
        gouraud_vertex_colours, phong_highlights, all_shadings, light_near_surface,
        wireframe_overlay, wireframe_only, wireframe_clipped, occluded_and_outlined,
        darkened_corners, behind_neighbours, behind_neighbours_in_parallel,
        cut_open,
        materials_under_a_sky, shadows_of_all_lights, shadows_where_surfaces_touch,
        layers_of_glass, layers_in_four_samples,
        edges_in_eight_samples, ground_truth, layers_peeled, many_pictures, areas, codes_of_glass,
        codes_in_four_samples,
        codes_of_many_pictures, codes_at_edges, lines_by_coverage, lines_by_coverage_in_codes,
        coarse_geometry,
        culled_back,
        culled_front_and_mirrored, parallel, mirroring_matrices, intrinsics,
        ground_to_the_horizon, inside_a_ball, slivers, far_from_the_origin, vast_and_tiny,
        points_of_all_shapes, whole_pixels, equal_depths, soup, wild_soup, lines_and_curves,
        many_lines,
        filled_triangles,
    )
}  # fmt: skip


def digest(array: np.ndarray) -> str:
    """Return the hash of an array's dtype, shape and bytes."""
    kind = f"{array.dtype.str} {array.shape} ".encode()
    return hashlib.sha256(kind + np.ascontiguousarray(array).tobytes()).hexdigest()


def digests(arrays: Arrays) -> dict[str, str]:
    """Return the hash of every output."""
    return {name: digest(arrays[name]) for name in sorted(arrays)}


def recorded() -> dict[str, dict[str, str]]:
    """Return the hashes in the repository, by frame and output."""
    return json.loads(RECORDED.read_text())


def every_digest(
    only: tuple[str, ...] = (), threads: int = 1
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each frame's name and hashes, of all outputs or of some that the stages make."""
    for name, make in FRAMES.items():
        thing = make()
        if only and isinstance(thing, Canvas):
            continue
        if only and isinstance(thing, Shot):
            thing = replace(thing, outputs=only)
        found = digests(thing.draw(threads))
        yield name, {k: v for k, v in found.items() if not only or k in only}


def main(arguments: list[str]) -> None:
    """Write the file of hashes, or print them."""
    # Some are cut, or out of view, on purpose.
    warnings.simplefilter("ignore", rj.ViewWarning)
    if arguments[:1] == ["--print"]:
        json.dump(dict(every_digest(tuple(arguments[1:]))), sys.stdout)
        return
    RECORDED.write_text(json.dumps(dict(every_digest()), indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
