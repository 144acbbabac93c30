"""
Decide which views of a scene have one plan, so that they are drawn in groups in machine code.

What a plan follows from differs with a camera in three ways alone: what the objects in view are,
not which; which lights reach them; and the answers of effects that look at more than facts, such as
fog that begins at a distance. That is the kind of a view (`kinds_of`). Each kind is planned once;
`can_share` tells whether all that its stages read follows from the plan, or from the camera and
where objects are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.table import is_attribute
from rasterjit.rendering.effects import EFFECTS
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.contents import Contents
from rasterjit.survey.effect import InGroups
from rasterjit.survey.lights import reach
from rasterjit.survey.many_views import Group
from rasterjit.survey.plan import RenderPlan

BY_KERNEL = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "instance_id", "material_id",
    "barycentric", "uv", "normal", "geometric_normal", "position", "object_position",
)  # fmt: skip
"""Outputs of which NumPy does nothing view by view; attributes of vertices, too."""

IN_GROUPS = tuple(one for one in EFFECTS if isinstance(one, InGroups))
"""Effects that views in groups may have."""

OWN_ANSWERS = tuple(one for one in IN_GROUPS if not one.follows_facts)
"""Effects of groups that answer by more than facts."""

LIGHTS = AmbientLight, DirectionalLight, PointLight, SpotLight
"""Kinds of lights whose rows are found for many views at once."""


def shared_lights(scene: Scene) -> list[int]:
    """Return the numbers of the lights that may have a row in ``Lighting.lights``."""
    return [
        n
        for n, light in enumerate(scene.lights)
        if not isinstance(light, AmbientLight) and light.intensity != 0.0 and any(light.color)
    ]


def can_share(plan: RenderPlan, scene: Scene, cache: SceneCache) -> bool:
    """Tell whether views of a plan like this one are drawn in groups."""
    facts = plan.facts
    if facts.contents.primitives or scene.section is not None or facts.imitation is not None:
        return False
    if plan.pictures != 1 or plan.reads_depth or plan.surfaces:
        return False
    if plan.layers is not None and not _is_laid_in_groups(plan):
        return False
    if not facts.finds_faces or (facts.is_colored and not facts.draws_faces):
        return False
    if not plan.depth_format.is_standard or not plan.quality.renormalize:
        return False
    if facts.background_image is not None or plan.keeps_clip_positions or facts.diagnose:
        return False
    # Others prepare something for each picture, from what is seen there.
    if not all(isinstance(one.effect, InGroups) for one in plan.planned if one.effect.places):
        return False
    if not all(map(_is_shared, scene.lights)):
        return False
    return all(name in BY_KERNEL or is_attribute(name) for name in plan.outputs) and all(
        cache.shapes.attribute(name.removeprefix(ATTRIBUTE), attribute)[1] is None
        for name, attribute in facts.attributes.items()
    )


def _is_laid_in_groups(plan: RenderPlan) -> bool:
    """Tell whether pixels show several samples, or transparent faces at one, mixed in light."""
    layers = plan.layers
    if layers.mixes_codes or layers.samples == "area":
        return False
    return not layers.has_blended or (layers.samples == 1 and layers.most is None)


def _is_shared(light: Light) -> bool:
    """Tell whether what is read of a light follows from the camera: shadow maps are fitted."""
    return type(light) in LIGHTS and getattr(light, "shadow", None) is None


def kind_of(contents: Contents) -> tuple:
    """Return what a plan follows from: not how many objects are what, but whether any is."""
    return tuple(
        tuple(count > 0 for count in part.values()) if isinstance(part, dict) else part > 0
        for part in contents
    )


def kind_of_plan(plan: RenderPlan) -> tuple:
    """Return the kind of the view that a plan is of."""
    facts = plan.facts
    told = tuple(plan.has(one.name) for one in OWN_ANSWERS)
    return kind_of(facts.seen), tuple(facts.lights.numbers), told


def kinds_of(
    scene: Scene, group: Group, contents: list[tuple | None], is_colored: bool,
    is_lit: list[bool],
) -> list[tuple | None]:  # fmt: skip
    """
    Return the kind of each view; None: nothing is in view.

    Parameters
    ----------
    scene : Scene
    group : Group
        The views.
    contents : list of (tuple or None)
        What is in view of each: see `kind_of`.
    is_colored : bool
        Whether any output shows colour.
    is_lit : list of bool
        Whether anything is that light falls on, in each.
    """
    count = len(contents)
    reached = np.zeros((count, 0), np.bool_)
    told: NDArray[Any] = np.zeros((count, len(OWN_ANSWERS)), np.bool_)
    if is_colored:
        reached = reach(scene.lights, group)
        for n, effect in enumerate(OWN_ANSWERS):
            told[:, n] = effect.answers(scene, group)
    return [
        None
        if own is None
        else (own, tuple(np.flatnonzero(lights).tolist()) if lit else (), tuple(answers))
        for own, lights, lit, answers in zip(contents, reached, is_lit, told.tolist(), strict=True)
    ]
