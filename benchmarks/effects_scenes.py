"""
Scenes that call for one effect each, beside the same scenes without it.

A variant is a scene with some effects; ``EFFECTS`` names the pairs whose difference is the cost of
one. Every variant is the same numbers on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import meshes
from benchmarks.meshes import SEED, look_at, perspective
from benchmarks.targets import Target

SIZE = (1280, 720)
"""Width and height, pixels."""
RINGS, SIDES = 264, 133
"""Of the torus: seventy thousand faces."""
EYE, FOV_Y = (0.4, -1.6, 3.3), 44.5
TO_LIGHT = (0.48, 0.64, 0.6)
"""Unit, world space: toward the one directional light, white, of intensity 1."""
AMBIENT = 0.1
"""Of Phong; microfacets have no light from all sides, which has no short formula there."""
SPECULAR, SHININESS = 0.25, 50.0
METALLIC, ROUGHNESS = 0.5, 0.4

TEXTURE_SIDE = 1024
TEXTURE_REPEATS = (6.0, 3.0)
"""Times that the picture goes around the torus, and around its tube."""
ANISOTROPY = 8
ALPHA_CUTOFF = 0.5

FOG_COLOR, FOG_DENSITY = (0.6, 0.7, 0.8), 0.2
FOG_HEIGHT, FOG_FALLOFF = -0.5, 0.8
"""World y where fog by height is that dense, and how fast it thins out upwards."""
SHADOW_SIDE = 2048
CUBE_SIDE = 1024
"""Of each of the six maps around a point light."""
LAMP, LAMP_INTENSITY, LAMP_ANGLES = (1.6, 2.2, 2.6), 12.0, (20.0, 50.0)
"""Place of a point or spot light, its intensity, and the inner and outer angle of its cone."""
SUN_ANGLE = 3.0
"""Degrees under which the sun of soft shadows is seen."""
SAMPLES = 4
LAYERS, LAYER_ALPHA = 8, 0.5
EXPOSURE = 1.5
SKY, GROUND = (0.5, 0.6, 0.8), (0.3, 0.25, 0.2)
"""Light of an environment from above and from below, linear."""


@dataclass(frozen=True)
class Part:
    """One mesh in world space."""

    positions: NDArray[np.float32]
    """(V, 3)"""
    faces: NDArray[np.int32]
    """(F, 3)"""
    normals: NDArray[np.float32]
    """(V, 3), unit."""
    uv: NDArray[np.float32]
    """(V, 2), v up."""
    colors: NDArray[np.float32] | None = None
    """(V, 4), linear; ``None``: white."""


@dataclass(frozen=True)
class EffectScene:
    """Meshes, a camera, and what is to be done to them."""

    parts: tuple[Part, ...]
    clip_from_world: NDArray[np.float64]
    """(4, 4)"""
    eye: tuple[float, float, float] = EYE
    size: tuple[int, int] = SIZE
    shading: str = "unlit"
    """``"unlit"``, ``"flat"``, ``"gouraud"``, ``"phong"`` or ``"pbr"``: metallic-roughness."""
    filter: str | None = None
    """Of a texture: ``"nearest"``, ``"bilinear"``, ``"trilinear"`` or ``"anisotropic"``."""
    alpha: str = "opaque"
    """``"opaque"``, ``"mask"`` or ``"blend"``."""
    maps: bool = False
    """Whether textures give normals, metallic and roughness, occlusion and emission as well."""
    samples: int | str = 1
    """Of a pixel, or ``"area"``."""
    light: str = "sun"
    """``"sun"``: directional, toward ``TO_LIGHT``; ``"spot"`` or ``"point"``: at ``LAMP``."""
    shadow: str | None = None
    """``"pcf"`` or ``"soft"``."""
    fog: str | None = None
    """``"exp2"``, or ``"height"``: exponential, and denser below."""
    tone_map: str | None = None
    """The curve."""
    environment: bool = False
    backdrop: bool = False
    """Whether the environment is seen behind everything."""
    occlusion: bool = False
    """Whether corners are darkened in screen space."""
    eye_dome: bool = False
    """Whether what lies behind a neighbour on the screen is darkened."""
    outline: tuple[str, ...] = ()
    """Edges that lines are drawn along."""
    wireframe: bool = False
    """Whether the edges of all faces are drawn over them."""


TWIN = "opengl_effects"
"""The contestant that draws the same by OpenGL."""


class Effect(NamedTuple):
    """Two variants that differ by one effect."""

    title: str
    off: str
    on: str
    target: Target | None = None
    """How many times as long as RasterJIT Mesa has to take with the effect."""
    twins: tuple[str, ...] = (TWIN,)
    """Contestants that draw it as well."""
    alike: float = 0.99
    """
    Share of the pixels whose colours must be Mesa's to three steps; less where rules differ.

    A texture that is not filtered shows another texel where float32 decides, anisotropic filters
    are the driver's own, and Mesa rounds to 8 bits after every layer.
    """


def torus_part(rings: int = RINGS, sides: int = SIDES) -> Part:
    """Return a torus about the z axis, cut open where its texture begins."""
    u, v = np.meshgrid(np.arange(rings + 1) / rings, np.arange(sides + 1) / sides, indexing="ij")
    around, across = 2.0 * np.pi * u.ravel(), 2.0 * np.pi * v.ravel()
    normals = np.stack(
        [np.cos(across) * np.cos(around), np.cos(across) * np.sin(around), np.sin(across)], axis=1
    )
    ring = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], axis=1)
    stretch = np.array([1.6, 1.0, 1.0])
    positions = (ring + meshes.TUBE_RADIUS * normals) * stretch
    normals /= stretch
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv = np.stack([u.ravel(), v.ravel()], axis=1) * TEXTURE_REPEATS
    faces = grid_faces(rings, sides)
    return Part(
        positions.astype(np.float32), faces, normals.astype(np.float32), uv.astype(np.float32)
    )


def grid_faces(columns: int, rows: int) -> NDArray[np.int32]:
    """Return two faces for each cell of a grid of vertices, column by column."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    a = (i * (rows + 1) + j).ravel()
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3).astype(np.int32)


def wall_part() -> Part:
    """Return a wall behind the torus that fills the picture."""
    corners = np.array([(-9, -7, -1), (9, -7, -1), (9, 7, -1), (-9, 7, -1)], np.float32)
    return Part(
        corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        np.tile(np.float32([0.0, 0.0, 1.0]), (4, 1)), corners[:, :2].copy(),
    )  # fmt: skip


def layer_parts() -> tuple[Part, ...]:
    """Return full-screen quads in clip space, each of its own colours, in no order of depth."""
    random = np.random.default_rng(SEED)
    depths = random.permutation(np.linspace(-0.8, 0.8, LAYERS))
    parts = []
    for depth in depths:
        positions, faces = meshes.quads(np.array([depth]))
        colors = random.uniform(0.0, 1.0, (4, 4)).astype(np.float32)
        colors[:, 3] = LAYER_ALPHA
        normals = np.tile(np.float32([0.0, 0.0, 1.0]), (4, 1))
        parts.append(Part(positions, faces, normals, positions[:, :2].copy(), colors))
    return tuple(parts)


def camera(size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the camera, clip from world, (4, 4)."""
    return perspective(FOV_Y, size[0] / size[1], 0.5, 20.0) @ look_at(EYE)


def torus_scene(**effects: Any) -> EffectScene:
    """Return seventy thousand faces on about half of 1280x720."""
    return EffectScene((torus_part(),), camera(SIZE), **effects)


def wall_scene(**effects: Any) -> EffectScene:
    """Return the torus in front of a wall."""
    return EffectScene((torus_part(), wall_part()), camera(SIZE), shading="phong", **effects)


def layer_scene(**effects: Any) -> EffectScene:
    """Return eight layers over the whole picture."""
    return EffectScene(layer_parts(), np.eye(4), **effects)


VARIANTS: dict[str, Callable[[], EffectScene]] = {
    "unlit": torus_scene,
    "nearest": partial(torus_scene, filter="nearest"),
    "bilinear": partial(torus_scene, filter="bilinear"),
    "trilinear": partial(torus_scene, filter="trilinear"),
    "anisotropic": partial(torus_scene, filter="anisotropic"),
    "mask": partial(torus_scene, filter="bilinear", alpha="mask"),
    "flat": partial(torus_scene, shading="flat"),
    "gouraud": partial(torus_scene, shading="gouraud"),
    "phong": partial(torus_scene, shading="phong"),
    "pbr": partial(torus_scene, shading="pbr"),
    "pbr_textured": partial(torus_scene, shading="pbr", filter="trilinear", environment=True),
    "maps": partial(torus_scene, shading="pbr", filter="trilinear", environment=True, maps=True),
    "environment": partial(torus_scene, shading="pbr", environment=True),
    "backdrop": partial(torus_scene, shading="pbr", environment=True, backdrop=True),
    "fog": partial(torus_scene, shading="phong", fog="exp2"),
    "height_fog": partial(torus_scene, shading="phong", fog="height"),
    "tone_map": partial(torus_scene, shading="phong", tone_map="reinhard"),
    "aces": partial(torus_scene, shading="phong", tone_map="aces"),
    "neutral": partial(torus_scene, shading="phong", tone_map="neutral"),
    "occlusion": partial(wall_scene, occlusion=True),
    "eye_dome": partial(wall_scene, eye_dome=True),
    "outline": partial(wall_scene, outline=("silhouette", "object")),
    "creases": partial(wall_scene, outline=("silhouette", "object", "crease")),
    "wireframe": partial(torus_scene, shading="phong", wireframe=True),
    "unlit_msaa": partial(torus_scene, samples=SAMPLES),
    "phong_msaa_2": partial(torus_scene, shading="phong", samples=2),
    "phong_msaa": partial(torus_scene, shading="phong", samples=SAMPLES),
    "phong_msaa_8": partial(torus_scene, shading="phong", samples=8),
    "phong_msaa_16": partial(torus_scene, shading="phong", samples=16),
    "phong_area": partial(torus_scene, shading="phong", samples="area"),
    "wall": wall_scene,
    "shadow": partial(wall_scene, shadow="pcf"),
    "soft_shadow": partial(wall_scene, shadow="soft"),
    "spot": partial(wall_scene, light="spot"),
    "spot_shadow": partial(wall_scene, light="spot", shadow="pcf"),
    "point": partial(wall_scene, light="point"),
    "point_shadow": partial(wall_scene, light="point", shadow="pcf"),
    "opaque_layers": layer_scene,
    "layers": partial(layer_scene, alpha="blend"),
}

SORTED = "opengl_sorted"
FOUR_TIMES, TWICE = Target(4.0), Target(2.0)

EFFECTS: tuple[Effect, ...] = (
    Effect("texture, nearest", "unlit", "nearest", alike=0.97),
    Effect("texture, bilinear", "unlit", "bilinear", FOUR_TIMES),
    Effect("texture, trilinear", "unlit", "trilinear", FOUR_TIMES),
    Effect(f"texture, anisotropic x{ANISOTROPY}", "unlit", "anisotropic", alike=0.0),
    Effect("alpha mask, bilinear", "bilinear", "mask"),
    Effect("flat", "unlit", "flat", twins=()),
    Effect("Gouraud", "unlit", "gouraud", twins=()),
    Effect("Phong", "unlit", "phong"),
    Effect("microfacets", "unlit", "pbr"),
    Effect("four maps, trilinear", "pbr_textured", "maps", twins=()),
    Effect("environment light", "pbr", "environment", twins=()),
    Effect("environment background", "environment", "backdrop", twins=()),
    Effect("fog, exp2", "phong", "fog"),
    Effect("fog, by height", "phong", "height_fog"),
    Effect("tone map, Reinhard", "phong", "tone_map"),
    Effect("tone map, ACES", "phong", "aces"),
    Effect("tone map, neutral", "phong", "neutral"),
    Effect("ambient occlusion", "wall", "occlusion", twins=()),
    Effect("eye-dome lighting", "wall", "eye_dome", twins=()),
    Effect("outline, silhouettes", "wall", "outline", twins=()),
    Effect("outline, creases too", "wall", "creases", twins=()),
    Effect("wireframe over faces", "phong", "wireframe", twins=()),
    Effect(f"{SAMPLES}x MSAA, unlit", "unlit", "unlit_msaa", FOUR_TIMES),
    Effect("2x MSAA, Phong", "phong", "phong_msaa_2", twins=()),
    Effect(f"{SAMPLES}x MSAA, Phong", "phong", "phong_msaa", FOUR_TIMES),
    Effect("8x MSAA, Phong", "phong", "phong_msaa_8", twins=()),
    Effect("16x MSAA, Phong", "phong", "phong_msaa_16", twins=()),
    Effect("exact areas, Phong", "phong", "phong_area", twins=()),
    Effect(f"shadow map {SHADOW_SIDE}, PCF 3x3", "wall", "shadow", FOUR_TIMES),
    Effect(f"soft shadow, {SHADOW_SIDE}", "wall", "soft_shadow", twins=()),
    Effect(f"spot light's shadow, {SHADOW_SIDE}", "spot", "spot_shadow", twins=()),
    Effect(f"point light's shadow, 6x {CUBE_SIDE}", "point", "point_shadow", twins=()),
    Effect(
        f"{LAYERS} transparent layers", "opaque_layers", "layers", TWICE, (TWIN, SORTED), 0.9
    ),
)  # fmt: skip

SMALL = ":small"
"""What follows the name of a variant drawn in a small picture of a coarse torus."""
SMALL_SIZE, SMALL_RINGS, SMALL_SIDES = (160, 90), 32, 16


def find_variant(name: str) -> EffectScene:
    """Return a variant by its name, perhaps followed by ``SMALL``."""
    variant = name.removesuffix(SMALL)
    scene = VARIANTS[variant]()
    return made_small(scene) if name.endswith(SMALL) else scene


def made_small(scene: EffectScene) -> EffectScene:
    """Return a scene of the same kind that takes next to no time."""
    parts = scene.parts
    if len(parts[0].faces) > 2 * SMALL_RINGS * SMALL_SIDES:
        parts = (torus_part(SMALL_RINGS, SMALL_SIDES), *parts[1:])
    return replace(scene, parts=parts, size=SMALL_SIZE)


def picture() -> NDArray[np.uint8]:
    """Return the picture of the texture, (TEXTURE_SIDE, TEXTURE_SIDE, 4) sRGB and alpha."""
    random = np.random.default_rng(SEED)
    y, x = np.mgrid[0:TEXTURE_SIDE, 0:TEXTURE_SIDE]
    fields = (x // 64 + y // 64) % 2
    image = np.empty((TEXTURE_SIDE, TEXTURE_SIDE, 4), np.uint8)
    image[:, :, 0] = 60 + 120 * fields
    image[:, :, 1] = 255 * x // TEXTURE_SIDE
    image[:, :, 2] = 255 * y // TEXTURE_SIDE
    image[:, :, :3] //= 2
    image[:, :, :3] += random.integers(0, 64, (TEXTURE_SIDE, TEXTURE_SIDE, 1), np.uint8)
    image[:, :, 3] = 255 * (((x % 128 - 64) ** 2 + (y % 128 - 64) ** 2) < 50**2)
    return image


def map_pictures() -> dict[str, NDArray[np.uint8]]:
    """Return the pictures of four maps, (TEXTURE_SIDE, TEXTURE_SIDE, 3) each, by their field."""
    y, x = (2.0 * np.pi * 16.0 / TEXTURE_SIDE) * np.mgrid[0:TEXTURE_SIDE, 0:TEXTURE_SIDE]
    bumps = np.stack([0.3 * np.sin(x), 0.3 * np.sin(y), np.ones_like(x)], axis=2)
    bumps /= np.linalg.norm(bumps, axis=2, keepdims=True)
    half = 0.5 + 0.5 * np.sin(x) * np.sin(y)
    lamps = np.maximum(4.0 * half - 3.0, 0.0)
    shares = {
        "normal_texture": 0.5 + 0.5 * bumps,
        "metallic_roughness_texture": np.stack([np.zeros_like(x), 1.0 - 0.5 * half, half], axis=2),
        "occlusion_texture": np.stack([1.0 - 0.5 * half] * 3, axis=2),
        "emissive_texture": np.stack([lamps, 0.5 * lamps, np.zeros_like(x)], axis=2),
    }
    return {name: np.rint(255.0 * share).astype(np.uint8) for name, share in shares.items()}
