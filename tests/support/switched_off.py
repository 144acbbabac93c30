"""A scene of all effects, and the scene without each; no pixel is drawn."""

from __future__ import annotations

import dataclasses

import numpy as np

import rasterjit as rj
from rasterjit.rendering.planning import list_kernels, list_passes
from rasterjit.scene.material import TEXTURE_FIELDS

SIZE = (8, 6)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
UV = SQUARE[:, :2] / 2.0 + 0.5
CAMERA = rj.PerspectiveCamera(eye=(0.5, 1.5, 6.0), target=(0, 0, 0), near=0.5, far=30.0)


def picture(side, **options):
    image = np.full((side, side, 4), 0.5, np.float32)
    return rj.Texture(image, filter="bilinear", color_space="linear", **options)


def square(material, place, **arrays):
    return rj.Mesh(SQUARE, FACES, uv=UV, material=material, **arrays), place


def full_scene():
    """A scene that calls for every effect: one square for each kind of material."""
    colors = np.tile([0.9, 0.5, 0.4, 1.0], (4, 1))
    colors[0, 3] = 0.0
    squares = [
        square(
            rj.Material(
                "pbr", base_color_texture=picture(2), normal_texture=picture(4),
                metallic_roughness_texture=picture(4), occlusion_texture=picture(4),
                emissive_texture=picture(2), clearcoat=1.0, clearcoat_texture=picture(2),
                sheen_color="white", ior=1.3,
            ),
            (-1.2, 1.2, 0.0),
        ),
        square(rj.Material("phong", alpha_mode="mask"), (1.2, 1.2, 0.0), colors=colors),
        square(
            rj.Material(
                "gouraud",
                base_color_texture=rj.Texture(np.ones((4, 4, 4), np.float32), anisotropy=4),
            ),
            (-1.2, -1.2, 0.0),
        ),
        square(
            rj.Material("flat", base_color_texture=picture(2).with_transform((0.1, 0.0))),
            (1.2, -1.2, 0.0),
        ),
        square(rj.Material("phong", "red"), (0.0, 0.0, -1.0), colors=np.ones((2, 3))),
        square(rj.Material("phong", (0.1, 0.2, 0.9, 0.5), alpha_mode="blend"), (0.3, 0.2, 1.0)),
        square(rj.Material("phong"), (0.0, 0.0, -2.0), scalars=[0, 1, 2, 3], contours=3),
        square(
            rj.Material(
                "pbr", transmission=0.5, thickness=0.1, transmission_texture=picture(2),
                thickness_texture=picture(2),
            ),
            (-0.3, 0.1, 0.5),
        ),
    ]  # fmt: skip
    scene = rj.Scene()
    for mesh, place in squares:
        scene.add(mesh, rj.transforms.translate(place))
    shadow = rj.Shadow(size=16)
    scene.lights = [
        rj.AmbientLight(), rj.DirectionalLight((-0.2, -0.3, -1.0), shadow=shadow),
    ]  # fmt: skip
    scene.environment = rj.Environment.gradient()
    scene.eye_dome = rj.EyeDome()
    scene.fog = rj.Fog(density=0.05)
    scene.tone_map = rj.ToneMap("aces")
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=1.0)
    scene.outline = rj.Outline()
    scene.vignette = rj.Vignette()
    scene.wireframe = rj.Wireframe("black")
    # It cuts nothing.
    scene.section = rj.SectionPlane((0.0, 0.0, 50.0), (0.0, 0.0, 1.0))
    scene.add(rj.Label((0.0, 0.0, 1.5), "label"))
    return scene


def with_materials(scene, change):
    for node in scene.nodes:
        node.mesh.material = change(node.mesh.material)


def lacking(**fields):
    """Take fields of all materials away."""

    def switch(scene):
        with_materials(scene, lambda material: dataclasses.replace(material, **fields))

    return switch


def shaded(old, new):
    """Shade otherwise what is shaded in one way."""

    def switch(scene):
        with_materials(
            scene,
            lambda material: (
                dataclasses.replace(material, shading=new) if material.shading == old else material
            ),
        )

    return switch


def without_field(name):
    def switch(scene):
        setattr(scene, name, None)

    return switch


def without_labels(scene):
    scene.remove(scene.labelled[0])


def without_shadows(scene):
    scene.lights = [scene.lights[0], dataclasses.replace(scene.lights[1], shadow=None)]


def without_background(scene):
    scene.environment = dataclasses.replace(scene.environment, background=False)


def without_environment_light(scene):
    scene.environment = rj.Environment(scene.environment.sky, intensity=0.0)


def without_colors(number):
    def switch(scene):
        mesh = scene.nodes[number].mesh
        scene.nodes[number].mesh = rj.Mesh(SQUARE, FACES, uv=UV, material=mesh.material)

    return switch


def without_transform(scene):
    texture = scene.nodes[3].mesh.material.base_color_texture
    scene.nodes[3].mesh.material = dataclasses.replace(
        scene.nodes[3].mesh.material, base_color_texture=texture.with_transform()
    )


def without_anisotropy(scene):
    material = scene.nodes[2].mesh.material
    texture = dataclasses.replace(material.base_color_texture, anisotropy=1)
    scene.nodes[2].mesh.material = dataclasses.replace(material, base_color_texture=texture)


def opaque(mode):
    """Make opaque what has this alpha mode."""

    def switch(scene):
        with_materials(
            scene,
            lambda material: (
                dataclasses.replace(material, alpha_mode="opaque")
                if material.alpha_mode == mode
                else material
            ),
        )

    return switch


MAPS = TEXTURE_FIELDS[1:]


WITHOUT = {
    "textures": lacking(**dict.fromkeys(TEXTURE_FIELDS)),
    "texture transforms": without_transform,
    "anisotropic filter": without_anisotropy,
    "maps and emission": lacking(**dict.fromkeys(MAPS), emissive="black"),
    "normal maps": lacking(normal_texture=None),
    "alpha masks": opaque("mask"),
    "vertex colors": without_colors(1),
    "face colors": without_colors(4),
    "scalar fields": without_colors(6),
    "highlights": lacking(specular=0.0),
    "microfacets": shaded("pbr", "phong"),
    "clearcoat": lacking(clearcoat=0.0),
    "sheen": lacking(sheen_color="black"),
    "specular and ior": lacking(ior=1.5),
    "Gouraud": shaded("gouraud", "phong"),
    "flat": shaded("flat", "phong"),
    "shadows": without_shadows,
    "environment light": without_environment_light,
    "environment background": without_background,
    "environment": without_field("environment"),
    "eye-dome lighting": without_field("eye_dome"),
    "fog": without_field("fog"),
    "transmission": lacking(transmission=0.0),
    "tone mapping": without_field("tone_map"),
    "ambient occlusion": without_field("ambient_occlusion"),
    "vignette": without_field("vignette"),
    "outline": without_field("outline"),
    "section": without_field("section"),
    "wireframe": without_field("wireframe"),
    "labels": without_labels,
    "transparency": opaque("blend"),
}


def told(scene, samples):
    """Return the names of the kernels and of the stages that a frame of a scene calls for."""
    plan = rj.explain(
        scene, CAMERA, rj.Quality(samples=samples), size=SIZE, outputs=("color", "linear")
    )
    return {one.name for one in (*list_kernels(plan), *list_passes(plan))}


def told_with_and_without():
    """Return what the scene of all effects calls for, and what without each, by its name."""
    found = {"": told(full_scene(), 4), "anti-aliasing": told(full_scene(), 1)}
    for name, switch in WITHOUT.items():
        scene = full_scene()
        switch(scene)
        # Opaque faces at several samples have a kernel of their own.
        found[name] = told(scene, 1 if name == "transparency" else 4)
    return found
