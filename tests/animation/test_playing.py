"""Frames of what moves: rendered when asked for, and everything is put back afterwards."""

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.animation import render_animation as playing_module
from rasterjit.animation import tracks as animation
from rasterjit.scene import transforms

SIZE = (24, 18)


@pytest.fixture
def scene(cube):
    made = rj.Scene()
    made.add(cube)
    made.add(cube, transforms.translate((3.0, 0.0, 0.0)))
    return made


@pytest.fixture(scope="module")
def renderer():
    with rj.Renderer(SIZE, threads=1) as made:
        yield made


def test_a_turntable_goes_around_once(scene):
    turn = animation.turntable(scene, seconds=4.0, azimuth=10.0, elevation=20.0, aspect=4 / 3)
    fitted = rj.fit_camera(
        scene, rj.orbit_direction(100.0, 20.0), up=rj.orbit_direction(100.0, 110.0), aspect=4 / 3,
        steady=True,
    )  # fmt: skip
    assert turn(1.0) == fitted
    assert turn(0.0) == turn(4.0)
    center, _ = scene.bounding_sphere()
    distances = [np.linalg.norm(turn(time).eye - center) for time in np.linspace(0, 4, 9)]
    assert np.ptp(distances) < 1e-9


def test_what_turns_keeps_its_size_without_a_camera(cube):
    scene = rj.Scene()
    node = scene.add(cube, transforms.scale((4.0, 1.0, 1.0)))
    spin = {node: lambda time: transforms.compose(
        transforms.rotate((0, 1, 0), 90.0 * time), transforms.scale((4.0, 1.0, 1.0)))}  # fmt: skip
    with rj.Renderer((32, 24), threads=1) as small:
        seen = playing_module.frames(small, scene, (0.0, 0.3, 1.0), transforms=spin)
        cameras = [frame.plan.camera for frame in seen]
    for camera in cameras:
        np.testing.assert_allclose(camera.eye, cameras[0].eye, atol=1e-9)


def test_a_turntable_cuts_nothing_off_in_upright_pictures(scene):
    turn = animation.turntable(scene)
    with rj.Renderer((24, 60), threads=1) as upright:
        for frame in playing_module.frames(
            upright, scene, (0.0, 0.25), camera=turn, outputs="face_id"
        ):
            seen = frame.face_id >= 0
            assert seen.any()
            assert not seen[:, [0, -1]].any()


def test_a_turntable_turns_around_the_axis_that_is_up(scene):
    turn = animation.turntable(scene, up=(0, 0, 1), azimuth=0.0, elevation=30.0)
    center, _ = scene.bounding_sphere()
    eyes = np.array([turn(time).eye for time in (0.0, 0.25, 0.5)]) - center
    assert np.ptp(eyes[:, 2]) < 1e-9
    assert eyes[0, 1] < 0 < eyes[2, 1]
    assert eyes[1, 0] > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seconds": 0.0}, "seconds must be above 0"),
        ({"azimuth": np.inf}, "azimuth must be finite"),
        ({"elevation": 91.0}, "elevation must be in"),
        ({"up": (0, 0, 0)}, "up must"),
        ({"zoom": -1.0}, "zoom must"),
        ({"projection": "fisheye"}, "projection must"),
    ],
)
def test_a_wrong_turntable_is_refused_at_once(scene, options, message):
    with pytest.raises(ValueError, match=message):
        animation.turntable(scene, **options)


def test_frames_are_what_render_gives_at_each_time(scene, renderer):
    turn = animation.turntable(scene, aspect=4 / 3)
    drop = animation.TransformTrack((0, 1), [np.eye(4), transforms.translate((0, -2, 0))])
    node, times = scene.nodes[0], (0.0, 0.3, 0.9)
    played = list(
        playing_module.frames(renderer, scene, times, camera=turn, transforms={node: drop})
    )
    for time, frame in zip(times, played, strict=True):
        still = rj.Scene()
        still.add(node.mesh, drop(time))
        still.add(node.mesh, scene.nodes[1].world_from_model)
        expected = rj.render(still, turn(time), size=SIZE, threads=1)
        assert np.array_equal(frame.color, expected.color)
    assert len({frame.color.tobytes() for frame in played}) == 3


def test_a_joint_moves_what_hangs_below_it(scene, renderer, camera):
    joint = rj.Node(name="joint")
    scene.nodes[1].parent = joint
    tracks = {joint: lambda time: transforms.rotate_z(90.0 * time)}
    moved = list(animation_frames(renderer, scene, camera, tracks))
    assert (moved[0].position != moved[1].position).any()
    for time, frame in zip((0.0, 1.0), moved, strict=True):
        flat = rj.Scene()
        flat.add(scene.nodes[0].mesh)
        flat.add(scene.nodes[1].mesh, transforms.compose(tracks[joint](time),
                                                         scene.nodes[1].transform))  # fmt: skip
        wanted = renderer.render(flat, camera, outputs=("position",))
        np.testing.assert_array_equal(frame.position, wanted.position)
    assert joint.transform.tolist() == np.eye(4).tolist()


def test_a_track_is_relative_to_the_parent_of_its_node(scene, renderer, camera):
    joint, node = rj.Node(None, transforms.rotate_z(30.0)), scene.nodes[1]
    node.parent = joint
    keys = transforms.translate((1, 0, 0)), transforms.translate((0, 1, 0))
    near = animation.TransformTrack((0, 1), keys)
    far = animation.TransformTrack((0, 1), [joint.world_matrix @ key for key in keys])

    def from_world(time):
        return transforms.inverse(node.parent.world_matrix) @ far(time)

    one = animation_frames(renderer, scene, camera, {node: near})
    other = animation_frames(renderer, scene, camera, {node: from_world})
    for seen, key in zip(one, keys, strict=True):
        np.testing.assert_allclose(node.world_matrix, joint.world_matrix @ key, atol=1e-12)
        np.testing.assert_allclose(seen.position, next(other).position, atol=1e-6)


def animation_frames(renderer, scene, camera, tracks):
    return playing_module.frames(
        renderer, scene, (0.0, 1.0), camera=camera, transforms=tracks, outputs=("position",)
    )


def test_a_morph_is_drawn(scene, renderer, cube, camera):
    track = animation.MorphTrack((0, 1), cube, [cube.vertices, 0.3 * cube.vertices])
    full, small = playing_module.frames(
        renderer, scene, (0, 1), camera=camera, meshes={scene.nodes[0]: track},
        outputs=("object_id",),
    )  # fmt: skip
    assert (small.object_id == 0).sum() < (full.object_id == 0).sum()


def test_everything_is_put_back_whatever_happens(scene, renderer, camera, cube):
    node = scene.nodes[0]
    place, mesh = node.world_from_model, node.mesh

    def track(time):
        if time > 1:
            raise RuntimeError("no further")
        return transforms.translate((time, 0, 0))

    options = {"camera": camera, "transforms": {node: track}, "meshes": {node: lambda t: cube}}
    playing = playing_module.frames(renderer, scene, (0.5, 1, 2), **options)
    next(playing)
    assert node.world_from_model[0, 3] == 0.5
    with pytest.raises(RuntimeError, match="no further"):
        list(playing)
    assert node.world_from_model is place or np.array_equal(node.world_from_model, place)
    assert node.mesh is mesh
    playing = playing_module.frames(renderer, scene, (0.5,), **options)
    next(playing)
    playing.close()
    assert np.array_equal(node.world_from_model, place)


def test_no_frame_is_rendered_before_it_is_asked_for(scene, renderer, camera):
    asked = []
    playing = playing_module.frames(
        renderer, scene, range(10**9), camera=lambda time: asked.append(time) or camera
    )
    next(playing), next(playing)
    assert asked == [0, 1]


def test_frames_and_arrays_are_saved_alike(tmp_path, scene, renderer):
    turn = animation.turntable(scene, aspect=4 / 3)
    frames = list(playing_module.frames(renderer, scene, (0, 0.25, 0.5), camera=turn))
    playing_module.save(frames, tmp_path / "a.apng", fps=5)
    playing_module.save([frame.color for frame in frames], tmp_path / "b.apng", fps=5)
    assert (tmp_path / "a.apng").read_bytes() == (tmp_path / "b.apng").read_bytes()
    with Image.open(tmp_path / "a.apng") as read:
        for number, frame in enumerate(frames):
            read.seek(number)
            assert np.array_equal(np.array(read.convert("RGBA")), frame.color)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"transforms": {"cube": lambda time: np.eye(4)}}, "nodes of the scene"),
        ({"meshes": {rj.Node(rj.Mesh(np.eye(3), [[0, 1, 2]]), np.eye(4), "x"): len}}, "nodes of"),
    ],
)
def test_nodes_of_another_scene_are_refused_at_once(scene, renderer, options, message):
    with pytest.raises(ValueError, match=message):
        playing_module.frames(renderer, scene, (0,), **options)


def test_what_is_no_function_of_time_is_refused_at_once(scene, renderer):
    with pytest.raises(ValueError, match="functions of time"):
        playing_module.frames(renderer, scene, (0,), transforms={scene.nodes[0]: np.eye(4)})


def test_a_frame_without_colour_cannot_be_saved(tmp_path, scene, renderer, camera):
    frames = playing_module.frames(renderer, scene, (0,), camera=camera, outputs=("depth",))
    with pytest.raises(rj.OutputNotRequestedError, match="color was not rendered"):
        playing_module.save(frames, tmp_path / "a.gif")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"renderer": None}, "renderer must be a Renderer, got None"),
        ({"scene": None}, "scene must be a Scene, got None"),
        ({"times": 5}, "times must be numbers, got 5"),
        ({"transforms": [1]}, "transforms must be functions by node, got list"),
        ({"meshes": 3}, "meshes must be functions by node, got 3"),
        ({"transforms": {1: print}}, "transforms must have nodes of the scene as keys"),
    ],
)
def test_wrong_arguments_are_named_at_once(scene, renderer, change, message):
    arguments = {"renderer": renderer, "scene": scene, "times": [0.0]} | change
    with pytest.raises(ValueError, match=message):
        playing_module.frames(**arguments)


def test_frames_of_a_series_have_one_bar(tmp_path, renderer):
    scene = rj.Scene()
    node = scene.add(rj.Mesh(np.eye(3), [[0, 1, 2]], scalars=[0, 1, 2], range=(0, 5)))
    track = animation.MorphTrack((0, 1), node.mesh, scalars=[[0, 1, 2], [3, 4, 5]])
    frames = list(playing_module.frames(renderer, scene, (0, 0.5, 1), meshes={node: track}))
    playing_module.save(frames, tmp_path / "a.gif", colorbar="Heat")
    bar = frames[0].colorbar("Heat")
    with Image.open(tmp_path / "a.gif") as read:
        assert read.n_frames == 3
        extra = read.width - renderer.size[0]
        assert extra - bar.shape[1] == (bar.shape[1] + renderer.size[0]) % 2
        for number in range(3):
            read.seek(number)
            shown = np.array(read.convert("RGB"))[:, renderer.size[0] :].astype(int)
            assert np.abs(shown[:, : bar.shape[1]] - bar[..., :3]).mean() < 3.0
    other = rj.render(node.mesh.with_scalars([0, 1, 2]), size=renderer.size, threads=1)
    lower = rj.render(node.mesh, size=(renderer.size[0], 20), threads=1)
    for wrong, words in (
        ([*frames, other], "colorbar must be False where frames differ"),
        ([*frames, frames[0].color], "colorbar must be False but for frames, got .* number 3"),
        ([frames[0], lower], "frames must all be .* high as the first is, got 20 as number 1"),
    ):
        with pytest.raises(ValueError, match=words):
            playing_module.save(wrong, tmp_path / "b.gif", colorbar=True)
    assert not (tmp_path / "b.gif").exists()


def test_no_frames_at_all_are_refused(tmp_path):
    with pytest.raises(ValueError, match="frames must be an iterable of frames, got 5"):
        playing_module.save(5, tmp_path / "a.gif")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_a_save_that_fails_puts_the_nodes_back(scene, renderer, tmp_path, monkeypatch, error):
    """Also while the iterator is still there, as a variable of the caller's."""

    def fail(path, pictures, *_):
        next(pictures)
        raise error

    monkeypatch.setattr("rasterjit.animation.video._write_gif", fail)
    node = scene.nodes[1]
    before = node.world_from_model.tobytes()
    tracks = {node: lambda time: transforms.translate((time + 1.0, 2.0, 3.0))}
    playing = playing_module.frames(renderer, scene, [0.0, 1.0, 2.0], transforms=tracks)
    with pytest.raises(type(error) if isinstance(error, OSError) else error):
        playing_module.save(playing, tmp_path / "a.gif")
    assert node.world_from_model.tobytes() == before
    assert next(playing, None) is None
