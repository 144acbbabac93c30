"""What is kept of the plan of the frame before is what would be planned anew."""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering.planning import FrameRequest, plan_frame
from rasterjit.survey.effect import Effect
from rasterjit.survey.object_counts import Inventory

SIZE = (48, 40)


def content(value):
    """Return all that a plan says as something that can be compared."""
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.shape, value.tobytes()
    if isinstance(value, Inventory):
        return value.contents
    if isinstance(value, Effect):
        return value.name
    if isinstance(value, dict):
        return [(name, content(one)) for name, one in value.items()]
    if isinstance(value, (tuple, list)):
        return [content(one) for one in value]
    if dataclasses.is_dataclass(value):
        named = {one.name: getattr(value, one.name) for one in dataclasses.fields(value)}
        # Answers of effects hold the facts as well.
        return type(value).__name__, content(named)
    return value


def told(planned):
    plan = planned.plan
    answers = [(one.name, one.used, one.reason) for one in plan.effects]
    return content(plan), answers, str(plan), content(planned.views)


def made(cube, sphere):
    """A cube, a ball seen through beside it, a cut out one behind, with three lamps."""
    scene = rj.Scene()
    scene.add(cube, name="box")
    pane = rj.Mesh(sphere.vertices, sphere.faces)
    pane.material = rj.Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend")
    scene.add(pane, rj.transforms.translate((-0.6, 0.8, 1.4)), "pane")
    holed = rj.Mesh(
        cube.vertices, cube.faces, colors=np.linspace(0, 1, 32).reshape(8, 4),
        attributes={"heat": np.ones((8, 1))},
    )  # fmt: skip
    holed.material = rj.Material("gouraud", alpha_mode="mask")
    scene.add(holed, rj.transforms.translate((0.5, -1.0, -2.0)), "holed")
    scene.lights = [
        rj.PointLight((4.0, 5.0, 6.0), intensity=30.0, range=20.0),
        rj.DirectionalLight((-0.2, -1.0, -0.3), shadow=rj.Shadow(size=64)),
    ]
    return scene


@pytest.fixture
def scene(cube, sphere):
    return made(cube, sphere)


class Asked:
    """What is asked of a frame, beside the scene."""

    def __init__(self, camera):
        self.camera = camera
        self.size, self.quality = SIZE, rj.Quality.standard()
        self.outputs, self.background = ("color",), None
        self.cull, self.diagnose = "none", False

    def plan(self, scene, *last):
        request = FrameRequest(
            self.size, self.quality, self.outputs, self.background, self.cull, self.diagnose
        )
        return plan_frame(request, scene, self.camera, *last)


def placed(node, place):
    node.world_from_model = rj.transforms.compose(rj.transforms.translate(place))


def material(node, **changes):
    node.mesh.material = dataclasses.replace(node.mesh.material, **changes)


FAR_OFF = (0.0, 0.0, 500.0)

CHANGES = {
    # What stands where, and looks how.
    "mesh": lambda scene, asked: setattr(scene.nodes[2], "mesh", scene.nodes[0].mesh),
    "add": lambda scene, asked: scene.add(scene.nodes[2].mesh),
    "remove": lambda scene, asked: scene.remove(scene.nodes[2]),
    "swap": lambda scene, asked: scene.nodes.reverse(),
    "out of view": lambda scene, asked: placed(scene.nodes[2], FAR_OFF),
    "pane out of view": lambda scene, asked: placed(scene.nodes[1], FAR_OFF),
    "all out of view": lambda scene, asked: [placed(node, FAR_OFF) for node in scene.nodes],
    "uneven": lambda scene, asked: (
        setattr(asked, "quality", rj.Quality(renormalize=False)),
        setattr(scene.nodes[0], "world_from_model", rj.transforms.scale((1.0, 1.3, 1.0))),
    ),
    "shading": lambda scene, asked: material(scene.nodes[0], shading="unlit"),
    "facets": lambda scene, asked: material(scene.nodes[0], shading="pbr"),
    "alpha": lambda scene, asked: material(scene.nodes[1], alpha_mode="opaque"),
    "texture": lambda scene, asked: setattr(
        scene.nodes[0],
        "mesh",
        rj.Mesh(
            *(scene.nodes[0].mesh.vertices, scene.nodes[0].mesh.faces),
            uv=np.zeros((8, 2)),
            material=rj.Material(base_color_texture=rj.Texture(np.ones((2, 2)))),
        ),
    ),
    # What lights it.
    "add a light": lambda scene, asked: scene.lights.append(rj.AmbientLight()),
    "no lights": lambda scene, asked: scene.lights.clear(),
    "another light": lambda scene, asked: scene.lights.__setitem__(0, rj.AmbientLight()),
    "brighter": lambda scene, asked: scene.lights.__setitem__(
        0, dataclasses.replace(scene.lights[0], intensity=31.0)
    ),
    "black": lambda scene, asked: scene.lights.__setitem__(
        0, dataclasses.replace(scene.lights[0], intensity=0.0)
    ),
    "range": lambda scene, asked: scene.lights.__setitem__(
        0, dataclasses.replace(scene.lights[0], range=0.01)
    ),
    "no shadow": lambda scene, asked: scene.lights.__setitem__(
        1, dataclasses.replace(scene.lights[1], shadow=None)
    ),
    # What it asks for besides.
    "wireframe": lambda scene, asked: setattr(scene, "wireframe", rj.Wireframe("red", "only")),
    "occlusion": lambda scene, asked: setattr(scene, "ambient_occlusion", rj.AmbientOcclusion()),
    "outline": lambda scene, asked: setattr(scene, "outline", rj.Outline()),
    "eye dome": lambda scene, asked: setattr(scene, "eye_dome", rj.EyeDome()),
    "fog": lambda scene, asked: setattr(
        scene, "fog", rj.Fog(mode="exp", density=0.1, height=0.0, falloff=1.0)
    ),
    "tone map": lambda scene, asked: setattr(scene, "tone_map", rj.ToneMap("aces")),
    "vignette": lambda scene, asked: setattr(scene, "vignette", rj.Vignette()),
    "section": lambda scene, asked: setattr(
        scene, "section", rj.SectionPlane((0.0, 0.0, 0.1), (0.0, 0.1, 1.0), cap=False)
    ),
    "environment": lambda scene, asked: setattr(scene, "environment", rj.Environment.constant()),
    # What is asked of the frame.
    "outputs": lambda scene, asked: setattr(asked, "outputs", ("linear", "normal")),
    "no color": lambda scene, asked: setattr(asked, "outputs", ("depth",)),
    "attribute": lambda scene, asked: setattr(asked, "outputs", ("attribute:heat",)),
    "background": lambda scene, asked: setattr(asked, "background", "red"),
    "picture": lambda scene, asked: setattr(asked, "background", np.ones((40, 48, 3), np.uint8)),
    "cull": lambda scene, asked: setattr(asked, "cull", "back"),
    "diagnose": lambda scene, asked: setattr(asked, "diagnose", True),
    "samples": lambda scene, asked: setattr(asked, "quality", rj.Quality(samples=4)),
    "layers": lambda scene, asked: setattr(asked, "quality", rj.Quality(transparency_layers=1)),
    "shadow size": lambda scene, asked: setattr(asked, "quality", rj.Quality(shadow_size=32)),
    "size": lambda scene, asked: setattr(asked, "size", (40, 48)),
    "near by": lambda scene, asked: setattr(
        asked, "camera", rj.PerspectiveCamera((0.0, 0.0, 1.2), (0.0, 0.0, 0.0))
    ),
    "parallel": lambda scene, asked: setattr(
        asked, "camera", rj.OrthographicCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), height=1.0)
    ),
}
"""Each changes a scene, or what is asked of a frame; all of it is in its plan."""


@pytest.mark.parametrize("name", CHANGES)
def test_what_changes_is_planned_anew(scene, camera, name):
    asked = Asked(camera)
    before = asked.plan(scene)
    was = told(before)
    CHANGES[name](scene, asked)
    after, alone = asked.plan(scene, before.cache, before.plan), asked.plan(scene)
    assert told(after) == told(alone)
    assert told(alone) != was
    # What was planned before stays as it was, and what is the same again is found again.
    assert told(before) == was
    assert told(asked.plan(scene, after.cache, after.plan)) == told(alone)


def test_every_order_of_changes_is_planned_anew(cube, sphere, camera):
    rng, planned = np.random.default_rng(4), None
    for _ in range(15):
        scene, asked = made(cube, sphere), Asked(camera)
        for name in rng.choice([*CHANGES], 3, replace=False).tolist():
            # Some leave nothing for others to change, or ask for what there is no more.
            with contextlib.suppress(IndexError):
                CHANGES[name](scene, asked)
            try:
                alone = asked.plan(scene)
            except ValueError:
                break
            last = () if planned is None else (planned.cache, planned.plan)
            planned = asked.plan(scene, *last)
            assert told(planned) == told(alone)


def test_another_picture_behind_is_planned(scene, camera):
    asked = Asked(camera)
    asked.background = np.full((40, 48, 3), 1, np.uint8)
    before = asked.plan(scene)
    asked.background = np.full((40, 48, 3), 2, np.uint8)
    after, alone = asked.plan(scene, before.cache, before.plan), asked.plan(scene)
    assert told(after) == told(alone) != told(before)


def test_an_object_that_becomes_uneven_is_noticed(cube, camera):
    scene, asked = rj.Scene(), Asked(camera)
    node = scene.add(cube)
    asked.quality = rj.Quality(renormalize=False)
    before = asked.plan(scene)
    node.transform = rj.transforms.scale((1.0, 1.3, 1.0))
    after, alone = asked.plan(scene, before.cache, before.plan), asked.plan(scene)
    assert told(after) == told(alone)
    assert after.plan.facts.renormalizes
    assert not before.plan.facts.renormalizes


def test_names_in_reasons_are_those_of_the_nodes(scene, camera):
    asked = Asked(camera)
    placed(scene.nodes[1], FAR_OFF)
    before = asked.plan(scene)
    assert "object 'pane' lies outside the view" in str(before.plan)
    scene.nodes[1].name = "window"
    after = asked.plan(scene, before.cache, before.plan)
    assert "object 'window' lies outside the view" in str(after.plan)
    assert "object 'pane' lies outside the view" in str(before.plan)


def test_another_camera_changes_no_facts(scene, camera):
    asked = Asked(camera)
    planned = asked.plan(scene)
    eye = tuple(part + 0.1 for part in camera.eye)
    asked.camera = dataclasses.replace(camera, eye=eye)
    other = asked.plan(scene, planned.cache, planned.plan)
    assert other.plan.facts is planned.plan.facts
    for before, after in zip(planned.plan.effects, other.plan.effects, strict=True):
        assert after is before or not after.effect.needs_facts_only
    assert sum(one.effect.needs_facts_only for one in other.plan.effects) > 20
    assert other.plan.camera.eye == eye


@pytest.mark.parametrize("name", [name for name in CHANGES if name not in ("near by", "parallel")])
def test_a_frame_is_planned_again_for_another_camera(scene, camera, name):
    asked = Asked(camera)
    CHANGES[name](scene, asked)
    before = asked.plan(scene)
    asked.camera = rj.OrthographicCamera((3.0, 4.0, 9.0), (0.0, 0.0, 0.0), height=5.0)
    after = asked.plan(scene, before.cache, before.plan)
    assert told(after) == told(asked.plan(scene))


class Unseen:
    """Stands for a frame that is being planned: who looks at it does not follow facts alone."""

    def __getattr__(self, name):
        raise AssertionError(f"the answer follows from {name} as well")


@pytest.mark.parametrize("name", CHANGES)
def test_answers_that_are_kept_follow_from_facts_alone(scene, camera, name):
    asked = Asked(camera)
    for change in ("fog", "occlusion", name):
        CHANGES[change](scene, asked)
    plan = asked.plan(scene).plan
    for answer in plan.effects:
        if answer.effect.needs_facts_only:
            again = answer.effect.decide(plan.facts, Unseen())
            assert again.used == answer.used
            assert not answer.used or content([again.data]) == content([answer.data])


def test_what_looks_beyond_facts_is_asked_again(scene, camera):
    asked = Asked(camera)
    CHANGES["fog"](scene, asked)
    scene.lights.append(rj.AmbientLight())
    CHANGES["occlusion"](scene, asked)
    before = asked.plan(scene)
    placed(scene.nodes[2], (0.5, -1.0, -5.0))
    asked.camera = dataclasses.replace(camera, eye=(2.5, 3.2, 4.0))
    after, alone = asked.plan(scene, before.cache, before.plan), asked.plan(scene)
    assert after.plan.facts is before.plan.facts
    for name in ("fog", "ambient occlusion"):
        data = [content(one.plan.data(name)) for one in (before, after, alone)]
        assert data[1] == data[2] != data[0]
