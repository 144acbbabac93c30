"""
Render scenes in styles: finished looks of lights, a background, effects or materials.

Each style is a function that takes a scene and returns a `Style`: a copy of the scene with the
style's lights, effects or materials, and arguments to render it with. The scene itself stays as it
is.

>>> import rasterjit as rj
>>> scene = rj.load("models/teapot.obj")
>>> frame = rj.styles.studio(scene).render(size=(640, 480))

To make your own, copy one and change it. ``rasterjit render`` draws `studio`; ``--style`` chooses
another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from rasterjit.io.meshes import as_scene
from rasterjit.scene import transforms
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.camera_fitting import default_camera
from rasterjit.scene.environment import Environment, Panorama
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.light import DirectionalLight, Shadow
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.outline import HiddenLines, Outline
from rasterjit.scene.points import Points
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.vectors import dot
from rasterjit.scene.wireframe import Wireframe
from rasterjit.styles import style
from rasterjit.styles.style import Gradient, GroundLight, Style, choose_exposure, copy_with_changes
from rasterjit.survey.deformation import pose_scene

__all__ = [
    "STYLES", "Gradient", "GroundLight", "Style", "clay", "depth", "normals", "plain", "studio",
    "technical", "wireframe", "xray",
]  # fmt: skip

SAMPLES: Final = 4
"""Samples a pixel."""

ANISOTROPY = 8
"""Anisotropy of textures, against blur at grazing angles."""

KEY_DIRECTION = (-0.62, 0.95, 0.62)
"""Direction towards the key light: right, up, and towards the camera along the ground."""

KEY_INTENSITY = 0.58

KEY_SHADOW = Shadow(size=1024, filter="soft", light_size=8.0, bias=8.0)
"""Shadow of a lamp 8 degrees wide. The bias hides the faces of coarse meshes in penumbras."""

SKY_LIGHT = (0.50, 0.36, 0.20)
"""Light from overhead, from the horizon and from below, linear greys."""

SKY_ROWS = 64
"""Rows of the sky's panorama if another axis than y is up."""

GREY_BACKGROUND = Gradient(0x7E, 0xB2)
"""The background: a grey between black and white objects, lit or shaded."""

GROUND_LIGHT = GroundLight(None, (0.45, 0.5))
"""Light on the ground; its shadow removes only a part, for a soft grey."""

CLAY = "#b7a596"

INK, PAPER = "#20242a", "#fbfbf8"

SMOOTH = Quality(samples=SAMPLES, lines="coverage")
"""Quality of styles that are drawn in areas, with lines that the scene may have."""

LINES = Quality(lines="coverage")
"""Quality of styles that are drawn in lines."""

BLUE_FILM, DARKROOM = (0.55, 0.78, 1.0, 0.22), "#0c1220"


def plain(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene as `rasterjit.render` draws it: a headlight if it has no light, white behind.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    camera : Camera, optional
        Default: the scene's own, else one that fits the scene.
    """
    return Style("plain", copy_with_changes(as_scene(scene, "scene")), camera)


def studio(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene in the light of a photo studio.

    A large lamp over the left shoulder with a soft shadow, light from the sky, darker corners, 4
    samples a pixel, greys behind, neutral tones, sharp textures. The scene stands on an invisible
    ground, which shows its shadow and nothing else, unless it has a floor: faces at its bottom that
    look up, over most of its ground plan. Point clouds without colours, scalars and normals, and
    without meshes beside them, get eye-dome lighting: else they would be silhouettes.

    A scene that has lights or an environment keeps them: it gets no lamp and no sky, and on the
    ground lies the shadow of the sky alone. An environment that is a background, effects and a
    camera of its own stay, too. Where these lights would burn out what is seen, as physical units
    do, an exposure is chosen for it, unless the scene has a tone map.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    camera : Camera, optional
        The lamp stands beside it. Default: the scene's own, else one that fits the scene.
    """
    posed = pose_scene(as_scene(scene, "scene"))
    sharp = style.sharpen_textures(posed, ANISOTROPY)
    lighted, key, adds = _add_lights(sharp, camera)
    if sharp is not posed:
        adds["textures"] = "sharp where they are seen aslant"
    changes: dict[str, Any] = {}
    if lighted.ambient_occlusion is None:
        changes["ambient_occlusion"] = AmbientOcclusion(strength=0.8)
        adds["ambient occlusion"] = "darker corners"
    if lighted.eye_dome is None and _is_bare_point_cloud(lighted):
        changes["eye_dome"] = EyeDome()
        adds["eye-dome lighting"] = "points have neither colours nor normals"
    if lighted.tone_map is None:
        exposure = choose_exposure(lighted, camera)
        changes["tone_map"] = ToneMap("neutral", exposure)
        adds["tone mapping"] = "nothing is too bright to show"
        if exposure:
            adds["tone mapping"] += f", {exposure:+g} stops for what is seen"
    adds["anti-aliasing"] = f"{SAMPLES} samples"
    if lighted.environment is not None and lighted.environment.background:
        background = ground = None
    else:
        background, ground = GREY_BACKGROUND, GROUND_LIGHT._replace(key=key)
        adds["background image"] = "greys"
    return Style(
        "studio", copy_with_changes(lighted, **changes), camera, SMOOTH,
        background, ground, adds,
    )  # fmt: skip


def clay(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene of one dull material without textures in the light of `studio`: shape alone.

    Parameters
    ----------
    scene, camera
        As `studio` takes them.
    """
    material = Material(base_color=CLAY, specular=0.0)
    result = studio(style.recolor(as_scene(scene, "scene"), material), camera)
    return replace(result, name="clay", adds={**result.adds, "shading": "one material"})


def technical(scene: Any, camera: Camera | None = None, *, hidden: HiddenLines = "none") -> Style:
    """
    Return a scene as a drawing: flat paper-white faces, and ink along outlines and creases.

    Parameters
    ----------
    scene, camera
        As `plain` takes them.
    hidden : {"none", "dashed"}
        What is drawn of edges that surfaces hide, as `Outline` has it.

    Raises
    ------
    ValueError
        If ``hidden`` is neither.
    """
    paper = style.recolor(as_scene(scene, "scene"), Material(shading="unlit", base_color=PAPER))
    styled = copy_with_changes(
        paper, outline=Outline(INK, 1.5, hidden=hidden), environment=None, fog=None
    )
    adds = {"outline": "smooth lines along edges", "shading": "one colour"}
    return Style("technical", styled, camera, LINES, PAPER, adds=adds)


def xray(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene of thin film before a dark wall: all surfaces are seen through all others.

    Parameters
    ----------
    scene, camera
        As `plain` takes them.
    """
    film = Material(base_color=BLUE_FILM, alpha_mode="blend")
    styled = copy_with_changes(
        style.recolor(as_scene(scene, "scene"), film), lights=[], environment=None, fog=None
    )
    adds = {"transparency": "all surfaces are seen through", "anti-aliasing": f"{SAMPLES} samples"}
    return Style("xray", styled, camera, SMOOTH, DARKROOM, adds=adds)


def depth(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene in greys of its depth, the nearest white, before black.

    Depth is that along the viewing axis, as in the output of that name, and runs from the nearest
    vertex in front of the camera to the farthest.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    camera : Camera, optional
        What the depth is seen from. Default: the scene's own, else one that fits the scene.
    """
    scene = pose_scene(as_scene(scene, "scene"))
    # Only the viewing direction matters, so any fitted camera will do.
    colored = style.color_by_depth(scene, _view_camera(scene, camera))
    styled = copy_with_changes(colored, environment=None, fog=None, tone_map=None)
    adds = {"scalar fields": "the depth", "anti-aliasing": f"{SAMPLES} samples"}
    return Style("depth", styled, camera, SMOOTH, "black", adds=adds)


def normals(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene in colours of its normals: red x, green y, blue z of the world, 0..255 for -1..1.

    Parameters
    ----------
    scene, camera
        As `plain` takes them.
    """
    colored = style.color_by_normal(pose_scene(as_scene(scene, "scene")))
    styled = copy_with_changes(colored, environment=None, fog=None, tone_map=None)
    adds = {"shading": "colours of normals", "anti-aliasing": f"{SAMPLES} samples"}
    return Style("normals", styled, camera, SMOOTH, "black", adds=adds)


def wireframe(scene: Any, camera: Camera | None = None) -> Style:
    """
    Return a scene of the edges of all faces, smooth, without those that faces hide.

    Parameters
    ----------
    scene, camera
        As `plain` takes them.
    """
    paper = style.recolor(as_scene(scene, "scene"), Material(shading="unlit", base_color=PAPER))
    styled = copy_with_changes(paper, wireframe=Wireframe(INK), environment=None, fog=None)
    adds = {"wireframe": "smooth lines along edges", "shading": "one colour"}
    return Style("wireframe", styled, camera, LINES, PAPER, adds=adds)


STYLES: Mapping[str, Callable[..., Style]] = MappingProxyType(
    {f.__name__: f for f in (studio, plain, clay, technical, xray, depth, normals, wireframe)}
)
"""All styles by name; the default of the command line first."""

RECOLORED_STYLES = ("clay", "technical", "xray", "depth", "normals", "wireframe")
"""Styles with colours of their own."""


def _view_camera(scene: Scene, camera: Camera | None) -> Camera:
    """Return the camera, the scene's, or one that looks from where a fitted one does."""
    if camera is not None:
        return check_camera("camera", camera)
    return scene.camera or default_camera(scene, (1, 1))


def _is_bare_point_cloud(scene: Scene) -> bool:
    """Tell whether a scene has no faces, and points without colours, scalars and normals."""
    meshes = [node.mesh for node in scene.nodes]
    has_faces = any(type(mesh) is Mesh for mesh in meshes)
    return not has_faces and any(
        isinstance(mesh, Points)
        and mesh.colors is None
        and mesh.field is None
        and mesh.normals is None
        for mesh in meshes
    )


def _add_lights(
    scene: Scene, camera: Camera | None
) -> tuple[Scene, tuple[float, float, float] | None, dict[str, str]]:
    """Return a scene with lights, the direction towards the lamp, and the reasons of rows."""
    if scene.lights or scene.environment is not None or not scene.nodes:
        return copy_with_changes(scene), None, {}
    up = scene.up or (0.0, 1.0, 0.0)
    key = _find_key(_view_camera(scene, camera), up)
    lamp = DirectionalLight(
        tuple(-part for part in key), intensity=KEY_INTENSITY, shadow=KEY_SHADOW
    )
    adds = {
        "lights": "a lamp over the left shoulder",
        "shadows": "soft ones of the lamp",
        "environment light": "light from the sky",
    }
    return copy_with_changes(scene, lights=[lamp], environment=_make_sky(up)), key, adds


def _find_key(camera: Camera, up: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the unit direction towards the lamp for a camera, world space."""
    view = camera.view_matrix()
    back = view[2, :3].tolist()
    height = dot(back, up)
    horizontal = [a - height * b for a, b in zip(back, up, strict=True)]
    if max(map(abs, horizontal)) < MIN_HORIZONTAL_SHARE * max(map(abs, back)):
        # The camera looks straight down: the bottom of the picture is towards the viewer.
        horizontal = [-part for part in view[1, :3].tolist()]
    x, y, z = transforms.unit_triple("camera", horizontal)
    right = (up[1] * z - up[2] * y, up[2] * x - up[0] * z, up[0] * y - up[1] * x)
    a, b, c = KEY_DIRECTION
    key = [a * r + b * u + c * h for r, u, h in zip(right, up, (x, y, z), strict=True)]
    return transforms.unit_triple("camera", key)


MIN_HORIZONTAL_SHARE = 1e-6
"""Least horizontal share of the direction towards a camera that is not straight above or below."""


@lru_cache(8)
def _make_sky(up: tuple[float, float, float]) -> Environment:
    """Return light from the sky around an up axis; cached, so that it is filtered once."""
    zenith, horizon, ground = SKY_LIGHT
    if up == (0.0, 1.0, 0.0):
        return Environment.gradient((zenith,) * 3, (horizon,) * 3, (ground,) * 3, background=False)
    rows, columns = SKY_ROWS, 2 * SKY_ROWS
    latitudes = [transforms.sine_cosine(90.0 - 180.0 * (n + 0.5) / rows) for n in range(rows)]
    longitudes = [
        transforms.sine_cosine(360.0 * ((n + 0.5) / columns - 0.5)) for n in range(columns)
    ]
    y, radius = (np.array(parts)[:, None] for parts in zip(*latitudes, strict=True))
    z, x = (np.array(parts)[None, :] for parts in zip(*longitudes, strict=True))
    height = (radius * x * up[0] + y * up[1]) + radius * z * up[2]
    light = horizon + np.where(
        height > 0.0, height * (zenith - horizon), height * (horizon - ground)
    )
    image = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    return Environment(Panorama(image), background=False)
