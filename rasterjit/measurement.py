"""Measure what a frame costs: each of its stages, each effect it has, and some it could have."""

from __future__ import annotations

import copy
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rasterjit import plan_resources
from rasterjit.arguments import choose_camera
from rasterjit.frame import Frame
from rasterjit.io.meshes import as_scene
from rasterjit.plan import RenderPlan, plan_render
from rasterjit.plan_answers import MAPS
from rasterjit.plan_lights import has_cube
from rasterjit.plan_quality import shadow_under
from rasterjit.render import Renderer
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.camera import Camera
from rasterjit.scene.environment import Environment
from rasterjit.scene.light import Shadow
from rasterjit.scene.material import TEXTURE_FIELDS, Material
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Node, Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.tone_map import ToneMap
from rasterjit.validation import image_size
from rasterjit.workers import available_processors

ROUNDS = 7
"""Frames of each kind; their median counts."""

MOST_TEXELS_TO_TRY = 1 << 26
"""Of the shadow maps that are tried where nobody asked for them: 268 MB."""

SAMPLES_TO_TRY = 4
"""Samples of a pixel whose cost is told where edges are not smoothed."""


class Change(NamedTuple):
    """What a frame costs with one thing changed."""

    name: str
    what: str
    """``"off"``, or in words what was tried."""
    seconds: float
    """Median time of such a frame."""
    difference: float
    """By how much it is slower than the frame as it is; below 0 if it is faster."""


@dataclass(frozen=True)
class Measurement:
    """
    What a frame consists of and what that costs; prints as a table.

    Attributes
    ----------
    plan : RenderPlan
    threads : int
    rounds : int
        How many frames each time is the median of.
    stages : dict of float
        Seconds of each stage, in order; compiling is no part of them.
    changes : tuple of Change
        The same frame without each effect that is in, and with what it could have besides.
    """

    plan: RenderPlan
    threads: int
    rounds: int
    stages: dict[str, float]
    total: float
    changes: tuple[Change, ...]

    def __str__(self) -> str:
        rows = [(stage, f"{1e3 * seconds:9.2f} ms") for stage, seconds in self.stages.items()]
        rows.append(("frame", f"{1e3 * self.total:9.2f} ms"))
        rows += [
            (f"{change.name}: {change.what}", f"{1e3 * change.difference:+9.2f} ms")
            for change in self.changes
        ]
        widest = max(len(name) for name, _ in rows)
        times = "\n".join(f"  {name:<{widest}}  {text}" for name, text in rows)
        heading = f"times (median of {self.rounds} frames, {self.threads} threads)"
        return f"{plan_resources.describe(self.plan)}\n\n{heading}\n{times}"


def measure(
    what: Any,
    camera: Camera | None = None,
    quality: Quality | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    outputs: Sequence[str] = ("color",),
    background: Any = None,
    cull: str = "none",
    threads: int | None = None,
    rounds: int = ROUNDS,
) -> Measurement:
    """
    Render a frame some times, without each effect that it uses, and with what it could use besides.

    What it could use is what needs no more than the scene has: samples, mip levels, shadows of its
    lights, ambient occlusion, an outline, a tone curve. The frames take turns, so that a machine
    that slows down slows all of them. Whatever has to be compiled is compiled before.

    Parameters
    ----------
    what, camera, quality, size, outputs, background, cull, threads
        As `rasterjit.render` takes them.
    rounds : int
        Frames of each kind, at least 1.

    Returns
    -------
    Measurement

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    if isinstance(rounds, bool) or not isinstance(rounds, int) or rounds < 1:
        raise ValueError(f"rounds must be a whole number above 0, got {rounds!r}")
    scene, quality, size = as_scene(what), check_quality(quality), image_size("size", size)
    camera = choose_camera(scene, camera, size)
    options = {"outputs": outputs, "background": background, "cull": cull}
    first = Subject(
        "", "as it is", scene, quality, Renderer(size, quality=quality, threads=threads)
    )
    with first.renderer:
        plan = first.draw(camera, options).plan
        subjects = [first]
        try:
            for name, label, changed, other in variations(plan, scene, quality):
                renderer = Renderer(size, quality=other, threads=threads)
                subjects.append(Subject(name, label, changed, other, renderer))
            frames = _take_turns(subjects, camera, options, rounds)
        finally:
            for subject in subjects[1:]:
                subject.renderer.close()
    own = [frame.stats.seconds for frame in frames[0]]
    stages = {
        stage: statistics.median(seconds[stage] for seconds in own)
        for stage in own[0]
        if stage != "compile"
    }
    times = [statistics.median(_duration(frame) for frame in some) for some in frames]
    changes = tuple(
        Change(subject.name, subject.what, time, time - times[0])
        for subject, time in zip(subjects[1:], times[1:], strict=True)
    )
    used = available_processors() if threads is None else threads
    return Measurement(plan, used, rounds, stages, times[0], changes)


class Subject(NamedTuple):
    """One kind of frame that is measured."""

    name: str
    what: str
    scene: Scene
    quality: Quality
    renderer: Renderer

    def draw(self, camera: Camera, options: dict[str, Any]) -> Frame:
        """Render it once."""
        return self.renderer.render(self.scene, camera, **options)


def _take_turns(
    subjects: Sequence[Subject], camera: Camera, options: dict[str, Any], rounds: int
) -> list[list[Frame]]:
    """Draw every kind of frame so often, in turn; one more of each before, to compile."""
    for subject in subjects:
        subject.draw(camera, options)
    frames: list[list[Frame]] = [[] for _ in subjects]
    for _ in range(rounds):
        for subject, taken in zip(subjects, frames, strict=True):
            taken.append(subject.draw(camera, options))
    return frames


def _duration(frame: Frame) -> float:
    """Return the seconds that a frame took, compiling apart."""
    seconds = 0.0
    for stage, duration in frame.stats.seconds.items():
        seconds += duration if stage != "compile" else 0.0
    return seconds


Variation = tuple[str, str, Scene, Quality]
"""Name of the effect, what was done with it, and what it gives."""

Addition = Callable[[Scene, Quality], tuple[str, Scene | None]]
"""Returns in words what it does to a scene, and a scene that has it; ``None`` if none could."""

OFF = "off"


def variations(plan: RenderPlan, scene: Scene, quality: Quality) -> list[Variation]:
    """Return the scene without each effect that is in, and with each that it could have."""
    used = {effect.name for effect in plan.effects if effect.used}
    found: list[Variation] = [
        (name, OFF, without(scene), quality) for name, without in SWITCHES.items() if name in used
    ]
    for name, addition in ADDITIONS:
        what, changed = addition(scene, quality)
        if changed is not None and _is_used(name, plan, changed):
            found.append((name, what, changed, quality))
    if "anti-aliasing" in used:
        found.append(("anti-aliasing", OFF, scene, replace(quality, samples=1)))
    elif "shading" in used and quality.subpixel_bits > 0:
        more = replace(quality, samples=SAMPLES_TO_TRY)
        found.append(("anti-aliasing", f"{SAMPLES_TO_TRY} samples", scene, more))
    return found


def _is_used(name: str, plan: RenderPlan, scene: Scene) -> bool:
    """Tell whether another scene would have an effect in a frame that is else planned alike."""
    background = plan.background if plan.grounds.has_background else None
    changed = plan_render(
        scene, plan.camera, plan.size, plan.quality, plan.outputs, background, plan.cull
    )
    return any(effect.used for effect in changed.effects if effect.name == name)


def _without_field(name: str) -> Callable[[Scene], Scene]:
    """Return what takes a field of the scene away."""

    def without(scene: Scene) -> Scene:
        changed = copy.copy(scene)
        setattr(changed, name, None)
        return changed

    return without


class SeenAlone(Environment):
    """An environment that is seen behind everything, and lights nothing."""

    lights = False


def _without_environment_light(scene: Scene) -> Scene:
    """Return the scene with an environment that is seen alone: no headlight takes its place."""
    changed, around = copy.copy(scene), scene.environment
    changed.environment = SeenAlone(
        around.sky, around.intensity, around.rotation, around.background
    )
    return changed


def _without_background(scene: Scene) -> Scene:
    """Return the scene with an environment that is not seen."""
    changed = copy.copy(scene)
    changed.environment = replace(scene.environment, background=False)
    return changed


def _without_shadows(scene: Scene) -> Scene:
    """Return the scene with lights that cast none."""
    changed = copy.copy(scene)
    changed.lights = [
        replace(light, shadow=None) if getattr(light, "shadow", None) is not None else light
        for light in scene.lights
    ]
    return changed


def _with_materials(change: Callable[[Material], Material]) -> Callable[[Scene], Scene]:
    """Return what changes all materials of a scene, on copies of its meshes."""

    def changed_scene(scene: Scene) -> Scene:
        changed, known = copy.copy(scene), {}
        changed.nodes = []
        for node in scene.nodes:
            if node.mesh not in known:
                known[node.mesh] = mesh = copy.copy(node.mesh)
                mesh.material = change(mesh.material)
            changed.nodes.append(Node(known[node.mesh], node.world_from_model, node.name))
        return changed

    return changed_scene


def _plain(*names: str) -> Callable[[Scene], Scene]:
    """Return what takes these textures away."""
    return _with_materials(lambda material: replace(material, **dict.fromkeys(names)))


def _with_field(name: str, value: Any, what: str) -> Addition:
    """Return what gives the scene a field, unless it has one that does something."""

    def addition(scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        held = getattr(scene, name)
        if held is not None and not _does_nothing(held):
            return what, None
        changed = copy.copy(scene)
        setattr(changed, name, value)
        return what, changed

    return addition


def _does_nothing(value: Any) -> bool:
    """Tell whether an effect that a scene asks for leaves it as it is."""
    return getattr(value, "strength", 1.0) == 0.0 or getattr(value, "is_neutral", False)


def _with_shadows(scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
    """Return the scene with a shadow of every light that could cast one and does not."""
    shadow = shadow_under(Shadow(), quality)
    dark = [hasattr(light, "shadow") and light.shadow is None for light in scene.lights]
    count = sum(dark)
    what = f"of {count} more light{'s' if count > 1 else ''}, maps of {shadow.size} x {shadow.size}"
    if not any(getattr(light, "shadow", None) is not None for light in scene.lights):
        what = what.replace(" more", "")
    changed = copy.copy(scene)
    changed.lights = [
        replace(light, shadow=shadow) if is_dark else light
        for light, is_dark in zip(scene.lights, dark, strict=True)
    ]
    maps = sum(6 if has_cube(light) else 1 for light in changed.lights if hasattr(light, "shadow"))
    is_bounded = maps * shadow.size * shadow.size <= MOST_TEXELS_TO_TRY
    return what, changed if count and is_bounded else None


def _with_mip_levels(scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
    """
    Return the scene with all textures that have no mip levels filtered between two of them.

    None where the quality says how they are filtered.
    """
    known: dict[Texture, Texture] = {}

    def filtered(texture: Texture | None) -> Texture | None:
        if texture is None or texture.filter == "trilinear":
            return texture
        if texture not in known:
            known[texture] = replace(texture, filter="trilinear")
        return known[texture]

    changed = _with_materials(
        lambda material: replace(
            material, **{name: filtered(getattr(material, name)) for name in TEXTURE_FIELDS}
        )
    )(scene)
    is_open = known and quality.texture_filter is None
    return f"mip levels for {len(known)} of them", changed if is_open else None


SWITCHES: dict[str, Callable[[Scene], Scene]] = {
    "textures": _plain(*TEXTURE_FIELDS),
    "alpha masks": _with_materials(lambda material: replace(material, alpha_mode="opaque")),
    "emission": _with_materials(
        lambda material: replace(material, emissive=(0.0, 0.0, 0.0), emissive_texture=None)
    ),
    **{name: _plain(TEXTURE_FIELDS[kind]) for name, kind in MAPS.items()},
    "shadows": _without_shadows,
    "environment light": _without_environment_light,
    "environment background": _without_background,
    "fog": _without_field("fog"),
    "tone mapping": _without_field("tone_map"),
    "ambient occlusion": _without_field("ambient_occlusion"),
    "outline": _without_field("outline"),
    "transparency": _with_materials(lambda material: replace(material, alpha_mode="opaque")),
    "wireframe": _without_field("wireframe"),
}
"""How to do without an effect, by its name in the plan."""

ADDITIONS: tuple[tuple[str, Addition], ...] = (
    ("textures", _with_mip_levels),
    ("shadows", _with_shadows),
    ("tone mapping", _with_field("tone_map", ToneMap(), "curve neutral")),
    ("ambient occlusion", _with_field("ambient_occlusion", AmbientOcclusion(), "on")),
    ("outline", _with_field("outline", Outline(), "on, one pixel wide")),
)
"""What a scene could have besides, by its name in the plan."""

PARTS_OF_OTHERS = (
    "shading", "lights", "smooth normals", "microfacets", "single-sided objects", "diagnostics",
    "anti-aliasing",
)  # fmt: skip
"""Effects that a frame is not itself without, or that `variations` switches in a way of its own."""
