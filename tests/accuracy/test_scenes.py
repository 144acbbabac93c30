import numpy as np
import pytest

import rasterjit as rj
from rasterjit.accuracy.test_scenes import MADE_FOR, SCENES, make
from rasterjit.scene.quality import LEVELS

SIZE = (96, 72)


def test_every_setting_has_a_scene_that_was_made_for_it():
    assert set(MADE_FOR) == set(LEVELS)
    assert set(MADE_FOR.values()) <= set(SCENES)


def test_an_unknown_scene_is_named_and_the_known_are_listed():
    with pytest.raises(ValueError, match=r"'floor', 'wires'.*'poster'; got 'roof'"):
        make("roof")


@pytest.mark.parametrize("name", list(SCENES))
def test_a_scene_shows_what_it_has_to(name):
    made = make(name)
    frame = rj.render(made.scene, made.camera, size=SIZE, outputs=("color", "object_id"))
    assert len(np.unique(frame.color.reshape(-1, 4), axis=0)) > 1
    shown = set(np.unique(frame.object_id)) - {-1}
    assert shown
    if name == "near-and-far":
        # Of each pair of plates the one in front alone.
        assert shown == set(range(1, 14, 2))


@pytest.mark.parametrize("name", list(SCENES))
def test_a_scene_is_the_same_every_time(name):
    first, again = make(name), make(name)
    assert first.camera == again.camera
    for one, other in zip(first.scene.nodes, again.scene.nodes, strict=True):
        assert np.array_equal(one.mesh.vertices, other.mesh.vertices)
        assert np.array_equal(one.world_from_model, other.world_from_model)


@pytest.mark.parametrize("name", ["slivers", "highlights"])
def test_scenes_of_what_is_within_faces_fill_the_picture(name):
    made = make(name)
    frame = rj.render(made.scene, made.camera, size=SIZE, outputs=("face_id",))
    assert (frame.face_id >= 0).all()
