"""Random scenes of everything that a scene can hold, and what of it is out of a frame."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

import rasterjit as rj

SEED = "RANDOM_SCENES_SEED"
"""Environment variable with the seed of a run that is to be repeated."""

SIZE = (72, 40)
NEAR, FAR = 0.5, 40.0
SHADINGS = "unlit", "flat", "gouraud", "phong", "pbr"
OUTPUTS = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "material_id", "barycentric",
    "normal", "geometric_normal", "position", "object_position", "coverage",
)  # fmt: skip
NUMBERS = "face_id", "object_id", "material_id", "instance_id"
"""Outputs that name things by their place in a list."""


def seed_of_run():
    """Return a seed that changes from run to run, and print it; or that of the environment."""
    given = os.environ.get(SEED)
    seed = int(given) if given else int.from_bytes(os.urandom(4), "big")
    print(f"{SEED}={seed} repeats this")
    return seed


def chance(random, share):
    return bool(random.uniform() < share)


def noise(random, channels=3, low=0.0, **options):
    side = int(random.choice([1, 2, 8]))
    values = random.uniform(low, 1.0, (side, side, channels)).astype(np.float32)
    filters = str(random.choice(["nearest", "bilinear", "trilinear"]))
    return rj.Texture(values, color_space="linear", filter=filters, **options)


def random_material(random, shading=None, sees_through=True, with_maps=True):
    """Return a material of any kind."""
    shading = shading or str(random.choice(SHADINGS, p=[0.2, 0.1, 0.1, 0.35, 0.25]))
    fields = {
        "base_color": (*random.uniform(0.1, 1.0, 3), 1.0), "specular": random.choice([0.0, 0.4]),
        "shininess": random.choice([5.0, 80.0, 900.0]), "roughness": random.uniform(0.05, 1.0),
        "metallic": random.choice([0.0, 1.0]), "double_sided": chance(random, 0.8),
    }  # fmt: skip
    if chance(random, 0.3):
        fields["base_color_texture"] = noise(random)
    if shading != "unlit" and with_maps and chance(random, 0.25):
        fields["normal_texture"] = noise(random, low=0.4)
    if shading != "unlit" and chance(random, 0.15):
        fields |= {"emissive": (0.2, 0.0, 0.1), "emissive_texture": noise(random)}
        fields["occlusion_texture"] = noise(random)
    if shading == "pbr" and chance(random, 0.4):
        fields |= [
            {"clearcoat": 0.8}, {"sheen_color": "white"}, {"ior": 1.3},
            {"metallic_roughness_texture": noise(random)},
            {"transmission": 0.6, "roughness": random.choice([0.0, 0.4])},
        ][random.integers(5 if sees_through else 4)]  # fmt: skip
    if sees_through and chance(random, 0.2):
        fields |= {"alpha_mode": "blend", "base_color": (*random.uniform(0.1, 1.0, 3), 0.5)}
    elif chance(random, 0.15):
        fields |= {"alpha_mode": "mask", "base_color_texture": noise(random, 4)}
    return rj.Material(shading, **fields)


def random_arrays(random, count, faces):
    """Return colours or scalars of vertices or faces, texture coordinates and tangents."""
    arrays = {"uv": random.uniform(-1.0, 2.0, (count, 2)).astype(np.float32)}
    kind = random.choice(["none", "vertices", "faces", "scalars"], p=[0.3, 0.4, 0.15, 0.15])
    if kind == "vertices":
        arrays["colors"] = random.uniform(0.0, 1.0, (count, 3)).astype(np.float32)
    elif kind == "faces":
        arrays["colors"] = random.uniform(0.0, 1.0, (faces, 3)).astype(np.float32)
    elif kind == "scalars":
        arrays |= {"scalars": random.uniform(0.0, 1.0, count), "range": (0.0, 1.0)}
        if chance(random, 0.4):
            arrays["contours"] = 4
    return arrays


def shape(random, size=1.0):
    """Return vertices, normals and faces: a soup, a bumpy ground or a ball."""
    kind = random.integers(3)
    if kind == 0:
        count = int(random.integers(3, 25))
        faces = random.integers(0, count, (2 * count, 3))
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])]
        faces = faces[faces[:, 0] != faces[:, 2]]
        faces = faces if len(faces) else np.array([[0, 1, 2]])
        # Of two at one place the one with the lower number is seen.
        _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        faces = faces[np.sort(first)]
        normals = random.normal(size=(count, 3))
        return random.normal(size=(count, 3)) * size, normals, faces
    # Of a ball of two, both halves are flat, and one.
    rows = int(random.integers(3, 12))
    across, down = (part.ravel() for part in np.meshgrid(*[np.linspace(-1, 1, rows + 1)] * 2))
    first = (np.arange(rows)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    a, b, c, d = first, first + 1, first + rows + 1, first + rows + 2
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    if kind == 1:
        points = np.stack([across, random.uniform(-0.2, 0.2, len(across)), down], axis=1)
        normals = random.normal(0.0, 0.3, points.shape) + (0.0, 1.0, 0.0)
    else:
        around, up = np.pi * across, 0.5 * np.pi * down
        points = np.stack(
            [np.cos(around) * np.cos(up), np.sin(up), np.sin(around) * np.cos(up)], axis=1
        )
        normals = points
    return points * size, normals, faces


def random_mesh(random, size=1.0, **material):
    points, normals, faces = shape(random, size)
    own = random_material(random, **material)
    if chance(random, 0.3) and own.shading != "unlit":
        # Rounded as a mesh rounds its own.
        normals = None
    return rj.Mesh(
        points, faces, normals=normals, material=own,
        **random_arrays(random, len(points), len(faces)),
    )  # fmt: skip


def random_pose(random):
    """Return a matrix that puts a thing before the cameras of `random_camera`."""
    turn = rj.transforms.rotate(random.normal(size=3), random.uniform(0.0, 360.0))
    scales = random.uniform(0.4, 1.4, 3) if chance(random, 0.3) else random.uniform(0.4, 1.4)
    place = rj.transforms.translate(random.uniform(-1.5, 1.5, 3))
    return place @ turn @ rj.transforms.scale(scales)


def random_camera(random):
    """Return a camera at about (0, 0, 6) that looks at about the origin; planes are its own."""
    looking = {
        "eye": random.uniform(-1.0, 1.0, 3) + (0.0, 0.0, 6.0),
        "target": random.uniform(-0.5, 0.5, 3), "near": NEAR, "far": FAR,
    }  # fmt: skip
    if chance(random, 0.25):
        return rj.OrthographicCamera(height=4.0, **looking)
    return rj.PerspectiveCamera(fov_y=40.0, **looking)


def random_light(random, shadows=False):
    """Return a light of any kind that may reach what `random_pose` places."""
    color, shadow = random.uniform(0.3, 1.0, 3), None
    if shadows and chance(random, 0.5):
        shadow = rj.Shadow(size=64)
    place = random.uniform(-3.0, 3.0, 3)
    ending = float(random.uniform(1.0, 8.0)) if chance(random, 0.5) else None
    kind = random.integers(4)
    if kind == 0:
        return rj.AmbientLight(color, random.uniform(0.1, 0.4))
    if kind == 1:
        return rj.DirectionalLight(random.normal(size=3), color, 0.8, shadow)
    strong = float(random.choice([0.05, 2.0, 30.0]))
    if kind == 2:
        return rj.PointLight(place, color, strong, ending, shadow)
    outer = float(random.uniform(5.0, 90.0))
    return rj.SpotLight(
        place, random.normal(size=3), color, strong, outer * random.uniform(0.2, 1.0), outer,
        ending, shadow,
    )  # fmt: skip


def random_scene(random, shadows=False, effects=True, **material):
    """Return a scene in view of `random_camera`, lit by at least one light."""
    scene = rj.Scene()
    for _ in range(random.integers(1, 5)):
        scene.add(random_mesh(random, **material), random_pose(random))
    scene.lights = [random_light(random, shadows) for _ in range(random.integers(1, 4))]
    if effects:
        for name, make in EFFECTS.items():
            if chance(random, 0.12):
                setattr(scene, name, make(random))
    return scene


EFFECTS = {
    "fog": lambda random: rj.Fog(density=0.1),
    "tone_map": lambda random: rj.ToneMap(
        str(random.choice(["none", "aces", "neutral"])), float(random.choice([-1.5, 0.5, 2.5]))
    ),
    "ambient_occlusion": lambda random: rj.AmbientOcclusion(0.5),
    "outline": lambda random: rj.Outline(),
    "vignette": lambda random: rj.Vignette(),
    "eye_dome": lambda random: rj.EyeDome(),
    "wireframe": lambda random: rj.Wireframe("white"),
    "environment": lambda random: rj.Environment.gradient(),
    "section": lambda random: rj.SectionPlane((0.3, 0.2, 0.0), (1.0, 0.4, 0.2)),
}


def random_quality(random):
    kinds = ["1", "4", "8", "area", "64"]
    samples = str(random.choice(kinds, p=[0.6, 0.15, 0.1, 0.1, 0.05]))
    return rj.Quality(
        samples="area" if samples == "area" else int(samples),
        interpolation_precision="float64" if chance(random, 0.1) else "adaptive",
        blending="srgb8" if chance(random, 0.15) else "linear",
        renormalize=chance(random, 0.9),
        interpolation="affine" if chance(random, 0.05) else "perspective",
    )


def perhaps_codes(random, quality):
    """Return a quality that now and then mixes textures in codes."""
    if not chance(random, 0.3):
        return quality
    texture_filter = str(random.choice(["nearest", "bilinear"]))
    return replace(quality, texture_mixing="srgb8", texture_filter=texture_filter)


def random_outputs(random):
    """Return what is asked for: colours, mostly with some of the others."""
    wanted = [name for name in OUTPUTS if chance(random, 0.35)]
    return (*dict.fromkeys([str(random.choice(["color", "linear"])), *wanted]),)


# What is out


def out_of_view(random, camera):
    """Return a matrix that puts a thing of size one where the camera surely sees nothing of it."""
    eye, target = (np.asarray(part, float) for part in (camera.eye, camera.target))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    places = {
        "behind": eye - 9.0 * ahead, "far": eye + (FAR + 9.0) * ahead,
        "beside": eye + 6.0 * ahead + 60.0 * right * random.choice([-1, 1]),
        "above": eye + 6.0 * ahead + 60.0 * np.cross(right, ahead) * random.choice([-1, 1]),
    }  # fmt: skip
    place = places[str(random.choice([*places]))]
    return rj.transforms.translate(place) @ rj.transforms.scale(random.uniform(0.2, 0.6))


def add_mesh(random, scene, camera):
    """Add a mesh out of view."""
    node = scene.add(random_mesh(random, sees_through=False), out_of_view(random, camera))
    if chance(random, 0.3):
        scene.nodes.insert(0, scene.nodes.pop(scene.nodes.index(node)))


def with_material(**fields):
    """Return what adds a mesh out of view that has some fields in its material."""

    def add(random, scene, camera):
        points, normals, faces = shape(random)
        made = {name: value(random) if callable(value) else value for name, value in fields.items()}
        material = rj.Material(made.pop("shading", str(random.choice(SHADINGS))), **made)
        arrays = random_arrays(random, len(points), len(faces))
        if material.alpha_mode == "mask":
            arrays = {"uv": arrays["uv"]}
        mesh = rj.Mesh(points, faces, normals=normals, material=material, **arrays)
        scene.add(mesh, out_of_view(random, camera))

    return add


def with_scalars(random, scene, camera):
    points, normals, faces = shape(random)
    lines = {"contours": 3} if chance(random, 0.5) else {"norm": "symlog"}
    mesh = rj.Mesh(
        points, faces, normals=normals, scalars=random.uniform(size=len(points)), **lines,
        material=rj.Material(str(random.choice(SHADINGS))),
    )  # fmt: skip
    scene.add(mesh, out_of_view(random, camera))


def add_lines(random, scene, camera):
    """Add lines or points out of view, of all kinds."""
    spots, unit = random.normal(size=(5, 3)), str(random.choice(["pixel", "world"]))
    size = 0.2 if unit == "world" else 3.0
    if chance(random, 0.4):
        thing = rj.Lines(spots, [(0, 1), (1, 2), (3, 4)], width=size, unit=unit)
    else:
        form = str(random.choice(["square", "disc", *(["sphere"] if unit == "world" else [])]))
        thing = rj.Points(spots, size=size, unit=unit, shape=form)
    scene.add(thing, out_of_view(random, camera))


def dark_light(random, scene, camera):
    light = random_light(random)
    change = {"intensity": 0.0} if chance(random, 0.5) else {"color": "black"}
    scene.lights.insert(random.integers(len(scene.lights) + 1), replace(light, **change))


def far_light(random, scene, camera):
    """Add a lamp that does not reach what is in view, at most 30 around the origin."""
    place = random.normal(size=3)
    place *= float(random.choice([40.0, 300.0])) / np.linalg.norm(place)
    shadow = rj.Shadow(size=64) if chance(random, 0.3) else None
    if chance(random, 0.5):
        light = rj.PointLight(place, intensity=50.0, range=5.0, shadow=shadow)
    else:
        light = rj.SpotLight(
            place, place, intensity=90.0, outer_angle=float(random.uniform(5.0, 80.0)),
            range=5.0 if chance(random, 0.3) else None, shadow=shadow,
        )  # fmt: skip
    scene.lights.append(light)


def dark_shadow(random, scene, camera):
    light = rj.DirectionalLight(random.normal(size=3), "black", shadow=rj.Shadow(size=64))
    scene.lights.append(light)


def effect(name, *values):
    """Return what gives a scene that has none of an effect one that has nothing to do."""

    def add(random, scene, camera):
        if getattr(scene, name) is None:
            setattr(scene, name, values[random.integers(len(values))])

    return add


def add_label(random, scene, camera):
    eye, target = (np.asarray(part, float) for part in (camera.eye, camera.target))
    if isinstance(camera, rj.PerspectiveCamera):
        scene.add(rj.Label(tuple(eye - (target - eye)), "never seen"))


def without_colors(name):
    """Return what gives a scene an effect that a frame without colours has no use for."""

    def add(random, scene, camera):
        if getattr(scene, name) is None:
            setattr(scene, name, EFFECTS[name](random))

    add.asks_for_no_color = True
    return add


OUT = {
    "shading": [add_mesh, add_lines],
    "lights": [dark_light, far_light],
    "shadows": [dark_shadow, far_light],
    "smooth normals": [with_material(shading="phong"), with_material(shading="gouraud")],
    "textures": [with_material(base_color_texture=noise)],
    "scalar fields": [with_scalars],
    "alpha masks": [
        with_material(alpha_mode="mask", base_color_texture=lambda random: noise(random, 4))
    ],
    "microfacets": [with_material(shading="pbr", roughness=0.1, metallic=1.0)],
    "normal maps": [
        with_material(shading="phong", normal_texture=noise),
        with_material(shading="pbr", normal_texture=noise),
    ],
    "metallic-roughness maps": [with_material(shading="pbr", metallic_roughness_texture=noise)],
    "occlusion maps": [with_material(shading="pbr", occlusion_texture=noise)],
    "emission": [
        with_material(shading="pbr", emissive="white"),
        with_material(shading="phong", emissive="white", emissive_texture=noise),
    ],
    "clearcoat": [
        with_material(shading="pbr", clearcoat=1.0, clearcoat_texture=noise),
        with_material(shading="pbr", clearcoat=0.5, clearcoat_normal_texture=noise),
    ],
    "sheen": [with_material(shading="pbr", sheen_color="white", sheen_color_texture=noise)],
    "specular and ior": [
        with_material(shading="pbr", ior=1.7),
        with_material(shading="pbr", specular_color="red", specular_factor_texture=noise),
    ],
    "single-sided objects": [with_material(double_sided=False)],
    "environment light": [
        effect("environment", replace(rj.Environment.gradient(), intensity=0.0, background=False))
    ],
    "environment background": [without_colors("environment")],
    "background image": [],
    "eye-dome lighting": [effect("eye_dome", rj.EyeDome(0.0)), without_colors("eye_dome")],
    "fog": [
        without_colors("fog"),
        effect("fog", rj.Fog(density=0.0), rj.Fog(mode="linear", start=1e6, end=2e6)),
    ],
    "transmission": [
        with_material(shading="pbr", transmission=0.7, roughness=0.0),
        with_material(shading="pbr", transmission=0.7, roughness=0.5, thickness=0.3),
    ],
    "tone mapping": [without_colors("tone_map"), effect("tone_map", rj.ToneMap("none"))],
    "ambient occlusion": [effect("ambient_occlusion", rj.AmbientOcclusion(0.5, strength=0.0))],
    "vignette": [effect("vignette", rj.Vignette(strength=0.0))],
    "hidden lines": [without_colors("outline")],
    "outline": [without_colors("outline")],
    "section": [effect("section", rj.SectionPlane((0.0, 90.0, 0.0), (0.0, 1.0, 0.0)))],
    "section hatching": [
        effect("section", rj.SectionPlane((0.0, 90.0, 0.0), (0.0, 1.0, 0.0), hatch=6.0))
    ],
    "section lines": [
        effect("section", rj.SectionPlane((0.0, 90.0, 0.0), (0.0, 1.0, 0.0), lines=True))
    ],
    "transparency": [
        with_material(alpha_mode="blend", base_color=(0.5, 0.5, 0.5, 0.4)),
        with_material(alpha_mode="blend", base_color=(0.5, 0.5, 0.5, 1.0)),
    ],
    "anti-aliasing": [],
    "wireframe": [without_colors("wireframe")],
    "labels": [add_label],
    "diagnostics": [],
}  # fmt: skip
"""Of each row of the effects' table, what asks for it in vain; empty: arguments decide, not the
scene, and `arguments_in_vain` has them."""


def arguments_in_vain(random, outputs):
    """Return arguments of a frame that have nothing to do there, by row of the effects' table."""
    found = {"diagnostics": {"diagnose": True}}
    if not {"color", "linear"} & {*outputs}:
        picture = random.uniform(0.0, 1.0, (*SIZE[::-1], 3)).astype(np.float32)
        found["background image"] = {"background": picture}
        if "coverage" not in outputs:
            found["anti-aliasing"] = {"quality": {"samples": 4}}
    return found
