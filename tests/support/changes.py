"""Everything that may change from one frame to the next: a scene, and changes of it by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from cubes import CUBE_FACES, CUBE_VERTICES

import rasterjit as rj

SIZE = (80, 72)
"""Two rows and columns of tiles."""

FAR_OFF = rj.transforms.translate((0.0, 0.0, 500.0))
SKY = np.random.default_rng(7).random((8, 16, 3), np.float32)


def ball():
    """Return a coarse ball of radius 1, its normals those of a ball."""
    polar, around = np.meshgrid(np.linspace(-1.2, 1.2, 6), np.linspace(0.0, 5.6, 8), indexing="ij")
    points = np.stack(
        [np.cos(polar) * np.cos(around), np.sin(polar), -np.cos(polar) * np.sin(around)], axis=-1
    )
    first = (np.arange(5)[:, np.newaxis] * 8 + np.arange(8)).ravel()
    after = first - first % 8 + (first + 1) % 8
    faces = np.concatenate(
        [
            np.stack([first, after, after + 8], axis=1),
            np.stack([first, after + 8, first + 8], axis=1),
        ]
    )
    return points.reshape(-1, 3), faces


def painted(texels):
    """Return a material with a texture."""
    return rj.Material(base_color_texture=rj.Texture(np.array(texels), filter="nearest"))


def changing_scene():
    """Return a cube, a ball in colours, a cube with holes and a textured ball, in two lights."""
    scene, (points, faces) = rj.Scene(), ball()
    scene.add(rj.Mesh(CUBE_VERTICES, CUBE_FACES), name="box")
    colors = np.linspace(0.0, 1.0, 3 * len(points)).reshape(-1, 3)
    scene.add(
        rj.Mesh(points, faces, colors=colors), rj.transforms.translate((-0.6, 0.8, 1.4)), "ball"
    )
    holed = rj.Mesh(
        CUBE_VERTICES, CUBE_FACES, colors=np.linspace(0, 1, 32).reshape(8, 4),
        material=rj.Material("gouraud", alpha_mode="mask"), attributes={"heat": np.eye(8)[:, :1]},
    )  # fmt: skip
    scene.add(holed, rj.transforms.translate((0.5, -1.0, -2.0)), "holed")
    laid = rj.Mesh(
        points, faces, uv=points[:, :2] * 0.5 + 0.5, scalars=points[:, 2],
        material=painted(((0.9, 0.1), (0.2, 0.6))),
    )  # fmt: skip
    scene.add(laid, rj.transforms.translate((1.4, 0.6, 0.8)), "painted")
    scene.lights = [
        rj.PointLight((4.0, 5.0, 6.0), intensity=30.0, range=20.0),
        rj.DirectionalLight((-0.2, -1.0, -0.3)),
        rj.AmbientLight(intensity=0.1),
    ]
    return scene


class Asked:
    """What is asked of frames, beside the scene and the camera."""

    def __init__(self, outputs=("color", "object_id")):
        self.options = {"size": SIZE, "quality": rj.Quality.standard(), "outputs": outputs}

    def ask(self, **options):
        self.options.update(options)

    def quality(self, **changes):
        self.options["quality"] = replace(self.options["quality"], **changes)


def placed(scene, number, matrix):
    scene.nodes[number].world_from_model = matrix


def material(scene, number, **changes):
    mesh = scene.nodes[number].mesh
    mesh.material = replace(mesh.material, **changes)


def light(scene, number, **changes):
    scene.lights[number] = replace(scene.lights[number], **changes)


def give(scene, **fields):
    for name, value in fields.items():
        setattr(scene, name, value)


def turned_to(scale):
    return rj.transforms.scale(scale)


SHIFT, TURN = rj.transforms.translate, rj.transforms.rotate_x
PLANE = rj.SectionPlane((0.1, 0.0, 0.0), (1.0, 0.2, 0.1), cap=False)

CHANGES = {
    # What stands where.
    "move": lambda s, a: placed(s, 1, SHIFT((0.3, 0.1, 0.9))),
    "turn": lambda s, a: placed(s, 0, TURN(20.0)),
    "mirror": lambda s, a: placed(s, 0, turned_to((-1.0, 1.0, 1.0)) @ TURN(20.0)),
    "flatten": lambda s, a: placed(s, 0, np.diag((1.0, 0.0, 1.0, 1.0))),
    "uneven": lambda s, a: [a.quality(renormalize=False), placed(s, 0, turned_to((1, 1.3, 1)))],
    "out of view": lambda s, a: placed(s, 1, FAR_OFF),
    "all out of view": lambda s, a: [placed(s, n, FAR_OFF) for n in range(len(s.nodes))],
    "mesh": lambda s, a: give(s.nodes[1], mesh=s.nodes[0].mesh),
    "another mesh": lambda s, a: give(s.nodes[0], mesh=rj.Mesh(*ball())),
    "add": lambda s, a: s.add(s.nodes[1].mesh, SHIFT((0.0, 1.2, 0.0))),
    "remove": lambda s, a: s.remove(s.nodes[0]),
    "reverse": lambda s, a: s.nodes.reverse(),
    "other objects": lambda s, a: give(s, nodes=changing_scene().nodes[:2]),
    # How it looks.
    "no holes": lambda s, a: material(s, 2, alpha_mode="opaque"),
    "other holes": lambda s, a: material(s, 2, alpha_cutoff=0.9),
    "glass": lambda s, a: material(s, 0, alpha_mode="blend", base_color=(1, 1, 1, 0.3)),
    "colour": lambda s, a: material(s, 1, base_color=(1.0, 0.0, 0.5)),
    "texture": lambda s, a: give(s.nodes[3].mesh, material=painted(((0.0, 1.0), (1.0, 0.0)))),
    "unlit": lambda s, a: [material(s, n, shading="unlit") for n in range(len(s.nodes))],
    "flat": lambda s, a: material(s, 0, shading="flat"),
    "light on vertices": lambda s, a: material(s, 0, shading="gouraud", specular=0.7),
    "facets": lambda s, a: material(s, 0, shading="pbr"),
    "emission": lambda s, a: material(s, 0, emissive=(0.5, 0.0, 0.0)),
    "one side": lambda s, a: material(s, 0, double_sided=False),
    # What lights it.
    "brighter": lambda s, a: light(s, 0, intensity=44.0),
    "elsewhere": lambda s, a: light(s, 0, position=(-4.0, 5.0, 6.0)),
    "black": lambda s, a: light(s, 1, intensity=0.0),
    "range": lambda s, a: light(s, 0, range=0.1),
    "shadow": lambda s, a: light(s, 1, shadow=rj.Shadow(size=64)),
    "shadows of the other": lambda s, a: light(s, 0, shadow=rj.Shadow(size=32)),
    "cone": lambda s, a: s.lights.append(rj.SpotLight((0.0, 3.0, 3.0), (0.0, -1.0, -1.0))),
    "ambient": lambda s, a: s.lights.append(rj.AmbientLight(intensity=0.3)),
    "brighter all around": lambda s, a: light(s, 2, intensity=0.4),
    "no lights": lambda s, a: s.lights.clear(),
    # What it asks for besides.
    "fog": lambda s, a: give(s, fog=rj.Fog(mode="exp", density=0.2)),
    "fog by height": lambda s, a: give(
        s, fog=rj.Fog("gray", density=0.3, mode="exp", height=0.2, falloff=0.5)
    ),
    "fog behind": lambda s, a: give(s, fog=rj.Fog("red", mode="linear", start=4.2, end=9.0)),
    "tone map": lambda s, a: give(s, tone_map=rj.ToneMap("aces")),
    "other tones": lambda s, a: give(s, tone_map=rj.ToneMap("reinhard", 0.9)),
    "environment": lambda s, a: give(s, environment=rj.Environment.gradient()),
    "unseen environment": lambda s, a: give(s, environment=rj.Environment(SKY, background=False)),
    "outline": lambda s, a: give(s, outline=rj.Outline()),
    "wireframe": lambda s, a: give(s, wireframe=rj.Wireframe("red")),
    "wires alone": lambda s, a: give(s, wireframe=rj.Wireframe("red", "only")),
    "occlusion": lambda s, a: [
        s.lights.append(rj.AmbientLight()), give(s, ambient_occlusion=rj.AmbientOcclusion())
    ],
    "eye dome": lambda s, a: give(s, eye_dome=rj.EyeDome()),
    "vignette": lambda s, a: give(s, vignette=rj.Vignette(0.8)),
    "section": lambda s, a: give(s, section=PLANE),
    "caps": lambda s, a: give(s, section=replace(PLANE, cap=True)),
    # What is asked of the frame.
    "background": lambda s, a: a.ask(background="red"),
    "picture": lambda s, a: a.ask(background=np.full((*a.options["size"][::-1], 3), 9, np.uint8)),
    "back faces": lambda s, a: a.ask(cull="back"),
    "front faces": lambda s, a: a.ask(cull="front"),
    "diagnose": lambda s, a: a.ask(diagnose=True),
    "outputs": lambda s, a: a.ask(outputs=("linear", "position", "face_id")),
    "more outputs": lambda s, a: a.ask(outputs=("color", "normal", "uv", "scalar", "barycentric")),
    "no colour": lambda s, a: a.ask(outputs=("depth", "object_id", "distance")),
    "attribute": lambda s, a: a.ask(outputs=("linear", "attribute:heat")),
    "coverage": lambda s, a: a.ask(outputs=("coverage", "color")),
    "motion": lambda s, a: a.ask(outputs=("motion", "color"), previous=rj.PreviousView()),
    "size": lambda s, a: a.ask(size=(72, 80)),
    "small": lambda s, a: a.ask(size=(40, 30)),
    "samples": lambda s, a: a.quality(samples=4),
    "bits": lambda s, a: a.quality(subpixel_bits=4),
    "depth format": lambda s, a: a.quality(depth_format="float64"),
    "precision": lambda s, a: a.quality(precision="float32"),
    "affine": lambda s, a: a.quality(interpolation="affine"),
    "draft": lambda s, a: a.ask(quality=rj.Quality.draft()),
}  # fmt: skip
"""Each changes a scene, or what is asked of frames."""

GRADIENT = rj.Environment.gradient()
EFFECTS = {
    "fog": (rj.Fog(density=0.2), rj.Fog("gray", "exp", density=0.3, height=0.2, falloff=0.5)),
    "tone_map": (rj.ToneMap("neutral", 0.5), rj.ToneMap("reinhard", 0.9)),
    "environment": (GRADIENT, replace(GRADIENT, intensity=2.0)),
    "vignette": (rj.Vignette(), rj.Vignette(0.2)),
    "section": (PLANE, replace(PLANE, point=(0.2, 0.0, 0.0))),
    "outline": (rj.Outline(), rj.Outline("red")),
    "wireframe": (rj.Wireframe(), rj.Wireframe("red")),
    "eye_dome": (rj.EyeDome(), rj.EyeDome(0.1)),
    "ambient_occlusion": (rj.AmbientOcclusion(), rj.AmbientOcclusion(0.2)),
    "lights": (
        [rj.SpotLight((-1.2, 4, -1), (0, -1, 0))],
        [rj.SpotLight((-1.2, 4, -1), (0, -1, 0), outer_angle=9.0)],
    ),
}  # fmt: skip
"""Two values of what a scene may have, by the name of the field."""


def walk(number):
    """Return a camera of a walk around the scene, which comes near and goes away."""
    angle = 0.7 * number
    eye = 4.0 + 2.0 * np.sin(1.3 * number)
    return rj.PerspectiveCamera((eye * np.sin(angle), 1.0, eye * np.cos(angle)), (0.0, 0.2, 0.0))
