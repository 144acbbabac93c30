"""Where the cameras of a data set stand, and which recipes there are."""

import json
import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.dataset.recipe import Recipe, view_cameras


@pytest.fixture
def scene(cube):
    made = rj.Scene()
    made.add(cube, rj.transforms.translate((5.0, -2.0, 1.0)))
    return made


def directions(scene, recipe, name=""):
    """From the middle of the scene to the cameras."""
    center, _ = scene.bounding_sphere()
    offsets = np.array([camera.eye for camera in view_cameras(scene, recipe, name)]) - center
    return offsets / np.linalg.norm(offsets, axis=1, keepdims=True)


@pytest.mark.parametrize("layout", ["sphere", "random", "ring"])
@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 2, 3)])
def test_all_cameras_see_the_whole_mesh_from_one_distance(scene, layout, up):
    cameras = view_cameras(scene, Recipe(views=9, layout=layout, up=up, size=(40, 30)))
    center, radius = scene.bounding_sphere()
    assert len(set(cameras)) == 9
    for camera in cameras:
        distance = math.dist(camera.eye, center)
        assert camera.target == tuple(center)
        assert distance == pytest.approx(math.dist(cameras[0].eye, center), rel=1e-12)
        assert math.sin(math.radians(22.5)) * distance >= radius
        assert camera.near < distance - radius < distance + radius < camera.far


def test_views_all_around_are_even(scene):
    found = directions(scene, Recipe(views=100))
    assert np.abs(found.mean(axis=0)).max() < 0.01
    nearest = np.sort(found @ found.T, axis=1)[:, -2]
    angles = np.degrees(np.arccos(nearest))
    # A hundred equal caps of the sphere are 23 degrees wide.
    assert angles.min() > 15.0
    assert angles.max() < 24.0


def test_views_at_random_are_all_around_too(scene):
    found = directions(scene, Recipe(views=2000, layout="random"))
    assert np.abs(found.mean(axis=0)).max() < 0.05
    assert np.abs((found**2).mean(axis=0) - 1 / 3).max() < 0.03


def test_views_at_random_depend_on_seed_and_name_alone(scene):
    one = directions(scene, Recipe(layout="random", seed=1), "a.obj")
    assert np.array_equal(one, directions(scene, Recipe(layout="random", seed=1), "a.obj"))
    for seed, name in ((2, "a.obj"), (1, "b.obj")):
        other = directions(scene, Recipe(layout="random", seed=seed), name)
        assert np.abs(one - other).max() > 0.1


def test_views_at_random_are_those_of_every_machine(scene):
    found = directions(scene, Recipe(views=1, layout="random", seed=7), "x")
    # From Python's generator, seeded with the text "7/x".
    assert found[0] == pytest.approx([-0.8905296, 0.2594570, -0.3736832], abs=1e-6)


def test_a_ring_is_level_and_even(scene):
    found = directions(scene, Recipe(views=8, layout="ring", elevation=30.0))
    assert found[:, 1] == pytest.approx(np.full(8, 0.5))
    turned = np.degrees(np.arctan2(found[:, 0], found[:, 2])) % 360
    assert turned == pytest.approx(np.arange(8) * 45.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": 0}, "views must be a whole number in 1..10000"),
        ({"views": 2.0}, "views must be a whole number"),
        ({"views": True}, "views must be a whole number"),
        ({"outputs": ()}, "outputs must name at least one"),
        ({"outputs": ("color", "colour")}, "outputs must be one of"),
        ({"outputs": 7}, "outputs must name"),
        ({"outputs": ("motion",)}, "outputs must be one of"),
        ({"outputs": ("color", "motion_visible")}, "outputs must be one of"),
        ({"outputs": ("coco", "mask")}, "outputs must name color with coco"),
        ({"size": (0, 4)}, "size must be"),
        ({"size": 512}, "size must be"),
        ({"layout": "cube"}, "layout must be one of"),
        ({"seed": -1}, "seed must be"),
        ({"elevation": 91}, "elevation must be in"),
        ({"fov_y": 180}, "fov_y"),
        ({"up": (0, 0, 0)}, "up must"),
        ({"background": "no colour"}, "background"),
        ({"quality": "best"}, "quality must be"),
        ({"on_invalid": "repair"}, "on_invalid must be one of"),
        ({"on_damage": "repair"}, "on_damage must be one of"),
        ({"max_bytes": 0}, "max_bytes must be a whole number above 0, got 0"),
        ({"max_bytes": "8G"}, "max_bytes must be a whole number above 0, got '8G'"),
    ],
)
def test_what_is_no_recipe_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Recipe(**options)


def test_a_recipe_is_described_by_json():
    recipe = Recipe(outputs={"mask", "color"}, background=(0.1, 0.2, 0.3), size=[8, 6])
    assert json.loads(json.dumps(recipe.describe())) == recipe.describe()
    assert recipe.outputs == ("color", "mask")
    assert (
        recipe.describe()
        == Recipe(
            outputs=["mask", "color", "mask"], background=(0.1, 0.2, 0.3, 1.0), size=(8, 6)
        ).describe()
    )
