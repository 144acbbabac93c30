"""
Scenes that combine effects, so that every two of them meet in one, for few compiled kernels.

What is not in a scene is there as data that does next to nothing, not as None: an object behind the
ground, a light of next to no intensity, fog of next to no density. So all scenes share the forms of
kernels that the ways of mixing faces ask for: one face a pixel, blended layers of four samples, and
areas.

For one more effect, run ``python tests/support/combined.py``: it prints `ROWS` with one more bit.
Then add a name at the end of `SWITCHES`, and to `scene_of` what it switches.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

import rasterjit as rj

SIZE = (72, 68)
"""Four tiles, so that threads share the work."""

SWITCHES = (
    "filter", "mask", "facets", "highlight", "spot", "point", "environment", "fog", "occlusion",
    "outline", "wireframe", "vignette", "tone", "parallel", "label", "dome", "section",
)  # fmt: skip
"""Effects that are on or off."""

MIXES = ("nearest", "layers", "area")
"""The nearest face; blended faces over each other, four samples; the areas of opaque faces."""

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = [[0, 1, 2], [0, 2, 3]]
BEHIND = (0.0, 0.0, -4.0)
"""In view, but for the ground before it."""


def named(row):
    """A row's name: what is on, and the mix."""
    return "+".join([*(n for n, on in zip(SWITCHES, row, strict=False) if on), row[-1]])


def pairs_of(row):
    """All pairs of a row's settings, each as (number of a switch or the mix, setting)."""
    return set(combinations(enumerate(row), 2))


def all_pairs():
    """All pairs that there are."""
    settings = [(True, False)] * len(SWITCHES) + [MIXES]
    return {
        ((i, a), (j, b))
        for (i, some), (j, others) in combinations(enumerate(settings), 2)
        for a in some
        for b in others
    }


ROWS = (
    ("11010110111111111", "nearest"),
    ("00101000010100111", "layers"),
    ("10111111101100111", "area"),
    ("11000001000111111", "nearest"),
    ("01000111001101111", "layers"),
    ("01111000100111110", "area"),
    ("00100101110010000", "nearest"),
    ("11011000111110001", "layers"),
    ("00010010010001000", "area"),
    ("00111010101101101", "nearest"),
    ("10001010111011110", "layers"),
    ("01100011100011011", "area"),
)
"""Settings, one for each switch, and the mix: every pair of settings is in one of them."""


def settings_of(bits, mix):
    """The settings of a row, switches as booleans."""
    return (*(bit == "1" for bit in bits), mix)


def rows_for_one_more():
    """`ROWS` with a bit for one more switch, so that every pair is in one of them; None if none."""
    rows = [settings_of(*row) for row in ROWS]
    wanted = [set(settings) for settings in zip(*rows, strict=True)]
    for bits in product("10", repeat=len(ROWS)):
        # Where it is on, and where it is off, all other settings are.
        halves = ([row for row, bit in zip(rows, bits, strict=True) if bit == on] for on in "10")
        if all([{*settings} for settings in zip(*half, strict=True)] == wanted for half in halves):
            return tuple((old + bit, mix) for (old, mix), bit in zip(ROWS, bits, strict=True))
    return None


def noise(side, low=0.0, channels=3, **options):
    values = np.random.default_rng(side).uniform(low, 1.0, (side, side, channels))
    return rj.Texture(values.astype(np.float32), color_space="linear", **options)


def square(material, **arrays):
    return rj.Mesh(SQUARE, FACES, uv=SQUARE[:, :2], material=material, **arrays)


def scene_of(row):
    """The scene, camera and quality of a row."""
    on, mix = dict(zip(SWITCHES, row, strict=False)), row[-1]
    scene, place = rj.Scene(), rj.transforms.translate
    texture = noise(8, filter="trilinear" if on["filter"] else "nearest")
    floor = rj.Material(
        "phong", base_color_texture=texture, specular=0.6 if on["highlight"] else 1e-9
    )
    ground = place((0, 0, -1.5)) @ np.diag([2.6, 2.6, 1.0, 1.0])
    scene.add(square(floor), ground, "ground")
    holes = rj.Material(
        "phong", "#c05040", specular=0.0, base_color_texture=noise(4, channels=4),
        alpha_mode="mask",
    )  # fmt: skip
    scene.add(square(holes), place((-0.9, 0.7, 0.2) if on["mask"] else BEHIND), "holes")
    facets = rj.Material(
        "pbr", "#d0b060", metallic=0.8, roughness=0.6, normal_texture=noise(2, 0.4),
        metallic_roughness_texture=noise(4), occlusion_texture=noise(2, 0.5),
        emissive_texture=noise(2), emissive=(0.1, 0.0, 0.2),
    )  # fmt: skip
    scene.add(square(facets), place((0.9, 0.5, -0.4) if on["facets"] else BEHIND), "facets")
    layered = rj.Material(
        "pbr", "#a03020", roughness=0.7, clearcoat=0.9, clearcoat_roughness=0.2,
        clearcoat_texture=noise(2, 0.5), clearcoat_normal_texture=noise(2, 0.4),
        sheen_color="#8060a0", sheen_roughness=0.5, specular_color=(3.0, 1.0, 0.5), ior=1.4,
    )  # fmt: skip
    scene.add(square(layered), place((-0.3, 1.1, -0.7) if on["facets"] else BEHIND), "layered")
    clear = rj.Material(
        "pbr", "#c0e0ff", roughness=0.2, transmission=0.8, thickness=0.4, ior=1.4,
        attenuation_distance=1.0, attenuation_color="#80c0a0", thickness_texture=noise(2),
    )  # fmt: skip
    scene.add(square(clear), place((0.6, -0.5, 0.1) if on["facets"] else BEHIND), "clear")
    scene.add(square(rj.Material("phong", "#60a0d0")), place((0.2, -0.9, -1.2)), "plain")
    if mix == "layers":
        glass = rj.Material("phong", (0.2, 0.8, 0.4, 0.5), alpha_mode="blend")
        scene.add(square(glass), place((-0.2, 0.1, 0.8)), "glass")
        scene.add(square(glass), place((0.3, -0.3, 0.5)), "glass too")
    shadow = rj.Shadow(size=32)
    scene.lights = [
        rj.AmbientLight(intensity=0.2),
        rj.SpotLight(
            (1.0, 2.0, 4.0),
            (-0.2, -0.5, -1.0),
            intensity=9.0 if on["spot"] else 1e-9,
            shadow=shadow,
        ),
        rj.PointLight((-1.0, 1.0, 2.5), intensity=4.0 if on["point"] else 1e-9, shadow=shadow),
    ]
    scene.environment = rj.Environment(SKY, intensity=0.7 if on["environment"] else 1e-9)
    scene.fog = rj.Fog("#8090a0", density=0.1 if on["fog"] else 1e-9)
    scene.ambient_occlusion = rj.AmbientOcclusion(0.8, 1.0 if on["occlusion"] else 1e-9)
    scene.tone_map = rj.ToneMap("aces", 0.5) if on["tone"] else rj.ToneMap("none", 1e-9)
    scene.outline = rj.Outline("#102060") if on["outline"] else None
    scene.wireframe = rj.Wireframe("white") if on["wireframe"] else None
    scene.vignette = rj.Vignette(0.8, 0.1) if on["vignette"] else None
    if on["label"]:
        # Hidden by nothing, and by the ground.
        scene.add(rj.Label((0.4, 0.2, 1.0), "Label\ntwo", 11, background="#ffd0a0c0", hidden=True))
        scene.add(rj.Label((-0.5, 0.0, -3.0), "never", 30, hidden=True))
    scene.eye_dome = rj.EyeDome(0.2) if on["dome"] else None
    # All objects are open: none has a cap.
    plane = rj.SectionPlane(
        (1.3, 0.9, 0.0), (1.0, 0.6, 0.2), cap=False, lines=True, line_color="#208040"
    )
    scene.section = plane if on["section"] else None
    looking = {"eye": (0.8, 1.2, 6.0), "target": (0, 0, 0), "near": 0.5, "far": 30.0}
    if on["parallel"]:
        camera = rj.OrthographicCamera(height=6.4, **looking)
    else:
        camera = rj.PerspectiveCamera(fov_y=40.0, **looking)
    samples = {"nearest": 1, "layers": 4, "area": "area"}[mix]
    return scene, camera, rj.Quality(samples=samples)


SKY = rj.Environment.gradient().sky
"""One object, so that it is filtered once."""


if __name__ == "__main__":
    print(*(rows_for_one_more() or ["no bits do: add a row to ROWS, of any bits"]), sep=",\n")
