"""Assignments that would do nothing, or change what is frozen, say what to write instead."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import re

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.animation import TransformTrack
from rasterjit.scene.attribute_guard import similar_names
from rasterjit.scene.environment import Panorama
from rasterjit.scene.material import DefaultMaterial
from rasterjit.scene.scene import EFFECT_FIELDS
from rasterjit.viewer.controls import Fly, Orbit

MESH = rj.Mesh(np.eye(3), [[0, 1, 2]])
SCENE = rj.Scene()
SCENE.add(MESH)
EYE = {"eye": (0, 0, 5), "target": (0, 0, 0)}

FROZEN = [
    rj.AmbientLight(intensity=0.5),
    rj.AmbientOcclusion(),
    rj.CalibratedCamera(rj.PerspectiveCamera(**EYE), (64, 48)),
    rj.DirectionalLight((0, -1, 0), shadow=rj.Shadow(512)),
    rj.Environment.gradient(),
    rj.Environment(np.ones((4, 8, 3))),
    Panorama(np.ones((4, 8, 3))),
    rj.Environment.gradient().sky,
    rj.Contours([1.0, 2.0], 2.0, "red"),
    rj.Equirectangular(),
    rj.FisheyeLens(0.1),
    rj.PinholeDistortion(0.1),
    rj.EyeDome(),
    rj.Fog(mode="linear", start=1.0, end=2.0),
    rj.Label((0, 1, 0), "text", background="white"),
    rj.Material("pbr", "orange", base_color_texture=rj.Texture(np.ones((2, 2)))),
    DefaultMaterial(),
    rj.MatrixCamera(np.eye(4), np.eye(4)),
    rj.OrthographicCamera(**EYE),
    rj.Outline(),
    rj.PerspectiveCamera(**EYE),
    rj.SectionPlane((0, 1, 0), (0, 1, 0)),
    rj.PointLight((0, 1, 0)),
    rj.Quality(),
    rj.Shadow(),
    rj.SpotLight((0, 1, 0), (0, -1, 0)),
    rj.Texture(np.ones((2, 2, 3)), anisotropy=4),
    rj.ToneMap("neutral"),
    rj.PreviousView(camera=rj.PerspectiveCamera(**EYE)),
    rj.Vignette(),
    rj.Wireframe(),
    rj.dataset.Recipe(),
    Orbit.from_camera(rj.PerspectiveCamera(**EYE), SCENE),
    Fly.from_camera(rj.PerspectiveCamera(**EYE), SCENE),
]

REPORTS = {
    rj.Diagnostics, rj.FrameProfile, rj.FrameStats, rj.PixelExplanation, rj.QualityChoice,
    rj.RenderPlan, rj.CrossSection, rj.LineDrawing,
}  # fmt: skip
"""Frozen, and made by no one but this package: there is no changed copy to make."""


def name_of(thing):
    return type(thing).__name__


def fields_of(thing):
    return [field.name for field in dataclasses.fields(thing)]


def test_a_misspelt_field_of_a_camera_is_named_with_the_right_one_and_the_way_to_change_it():
    camera = rj.PerspectiveCamera(**EYE)
    with pytest.raises(dataclasses.FrozenInstanceError) as told:
        camera.fov = 30.0
    assert str(told.value) == (
        "PerspectiveCamera has no 'fov'; did you mean 'fov_y'? Its fields are eye, target, up, "
        "fov_y, near, far, min_aspect, pixel_aspect, and it is never changed: make another with "
        "dataclasses.replace(old, fov_y=...), and assign that"
    )
    with pytest.raises(dataclasses.FrozenInstanceError) as told:
        camera.fov_y = 30.0
    assert str(told.value) == (
        "PerspectiveCamera is never changed: make another with dataclasses.replace(old, "
        "fov_y=...), and assign that"
    )
    assert dataclasses.replace(camera, fov_y=30.0).fov_y == 30.0
    assert camera.fov_y == 45.0


@pytest.mark.parametrize("thing", FROZEN, ids=name_of)
def test_every_description_says_how_to_make_a_changed_copy_and_it_can_be_made(thing):
    for name in fields_of(thing):
        with pytest.raises(
            dataclasses.FrozenInstanceError, match=rf"replace\(old, {name}=\.\.\.\)"
        ):
            setattr(thing, name, None)
    told = "; its fields are" if fields_of(thing) else ", nor any field"
    with pytest.raises(dataclasses.FrozenInstanceError, match=f"has no 'qqq'{told}"):
        thing.qqq = 1
    with pytest.raises(AttributeError):
        delattr(thing, [*fields_of(thing), "directions"][0])
    for twin in (dataclasses.replace(thing), copy.copy(thing), pickle.loads(pickle.dumps(thing))):
        assert type(twin) is type(thing)
        assert repr(twin) == repr(thing)


def test_every_public_description_is_among_those():
    frozen = {
        kind for name in rj.__all__
        if dataclasses.is_dataclass(kind := getattr(rj, name))
    }  # fmt: skip
    assert frozen - REPORTS <= {type(thing) for thing in FROZEN}
    assert all(kind.__dataclass_params__.frozen for kind in frozen)


def test_a_class_made_from_a_description_may_keep_more():
    class Marked(rj.Vignette):
        pass

    marked = Marked()
    marked.mark = 3
    assert marked.mark == 3
    with pytest.raises(dataclasses.FrozenInstanceError, match=r"replace\(old, strength="):
        marked.strength = 0.1


@pytest.mark.parametrize(
    ("thing", "name", "told"),
    [
        (rj.Scene(), "fogg", "Scene has no 'fogg'; did you mean 'fog'? What can be assigned is no"),
        (rj.Scene(), "tonemap", "did you mean 'tone_map'?"),
        (rj.Scene(), "add", "Scene.add is a method: call it"),
        (MESH, "vertices", "Mesh.vertices cannot be assigned: make another Mesh"),
        (rj.Node(), "world_matrix", "Node.world_matrix cannot be assigned: assign world_"),
        (rj.Node(), "children", "Node.children cannot be assigned: assign world_from_model, or tr"),
        (MESH, "materials", "did you mean 'material'?"),
        (rj.Renderer((8, 8)), "qualtiy", "Renderer has no 'qualtiy'; did you mean 'quality'?"),
        (rj.Framebuffer(8, 8), "colour", "Framebuffer has no 'colour', and nothing to assign: dr"),
        (rj.Framebuffer(8, 8), "color", "Framebuffer.color cannot be assigned: draw into it, or "),
        (rj.ClassicPipeline(), "scale", "ClassicPipeline.scale is a method: call it"),
        (rj.ClassicPipeline(), "fov", "ClassicPipeline has no 'fov', and nothing to assign: its"),
        (TransformTrack([0.0, 1.0], [np.eye(4)] * 2), "time", "did you mean 'times'?"),
    ],
)  # fmt: skip
def test_what_is_not_there_cannot_be_assigned(thing, name, told):
    before = dict(vars(thing))
    with pytest.raises(AttributeError, match=re.escape(told)):
        setattr(thing, name, None)
    assert vars(thing) == before


def test_a_class_made_from_a_guarded_one_may_have_settings_of_its_own():
    class Titled(rj.Renderer):
        @property
        def title(self):
            return self._title

        @title.setter
        def title(self, value):
            self._title = value

    renderer = Titled((8, 8))
    renderer.title = "front"
    assert renderer.title == "front"


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("size", (0, 5), "size must be two whole numbers in 1..16384, got (0, 5)"),
        ("size", (16385, 5), "size must be two whole numbers in 1..16384"),
        ("size", 5, "size must be (width, height)"),
        ("quality", "high", "quality must be a rasterjit.Quality, got str"),
        ("on_picture", 3, "on_picture must be a function or None, got 3"),
        ("warned", "view", "warned must be a set or None, got 'view'"),
        ("warned", ["view"], "warned must be a set or None, got list"),
    ],
)
def test_what_a_renderer_is_assigned_is_checked_at_once(name, value, told):
    renderer = rj.Renderer((8, 8))
    before = dict(vars(renderer))
    with pytest.raises(ValueError, match=re.escape(told)):
        setattr(renderer, name, value)
    assert vars(renderer) == before


@pytest.mark.parametrize("name", EFFECT_FIELDS)
def test_what_a_scene_is_assigned_is_checked_at_once(name):
    scene = rj.Scene()
    kind = EFFECT_FIELDS[name].__name__
    for value, got in (("black", "'black'"), (True, "True"), (1e9, "1000000000.0")):
        with pytest.raises(ValueError, match=rf"{name} must be an? {kind}.* or None, got {got}"):
            setattr(scene, name, value)
    with pytest.raises(ValueError, match=name) as told:
        setattr(scene, name, [1.0] * 99_999)
    assert len(str(told.value)) < 200
    assert getattr(scene, name) is None


def test_what_a_renderer_is_assigned_is_kept():
    renderer, told = rj.Renderer((8, 8)), {"view"}
    renderer.size, renderer.warned, renderer.on_picture = (4, 5), told, print
    renderer.quality = None
    assert (renderer.size, renderer.quality) == ((4, 5), rj.Quality.standard())
    assert renderer.warned is told
    assert renderer.on_picture is print
    renderer.warned = renderer.on_picture = None
    assert renderer.warned is renderer.on_picture is None


def test_no_mutable_public_class_takes_any_name():
    unguarded = {
        kind for name in rj.__all__
        if inspect.isclass(kind := getattr(rj, name))
        and kind.__setattr__ is object.__setattr__
        and not issubclass(kind, (Exception, tuple))
    }  # fmt: skip
    # What a render returns sets nothing.
    assert unguarded == {rj.Batch, rj.Frame, rj.LayeredFrame, rj.RasterizedFaces}


def test_names_are_alike_by_what_they_hold_and_how_they_are_spelt():
    fields = ["base_color", "metallic", "roughness", "base_color_texture"]
    assert similar_names("color", fields)[0] == "base_color"
    assert similar_names("baseColor", fields)[0] == "base_color"
    assert similar_names("roughnes", fields) == ["roughness", "roughness"]
    assert similar_names("shininess", ["eye", "target"]) == []
