"""What a picked pixel shows has the numbers of the buffers, and of rays through exact geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.distributed import sort_last
from rasterjit.distributed.frames import RemoteFrame
from rasterjit.outputs.frame import PICK_OUTPUTS
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.planning import FrameRequest
from rasterjit.rendering.regions import RegionRenderer

T = rj.transforms
SIZE = (48, 36)
OUTPUTS = (*PICK_OUTPUTS, "object_id", "depth")
CAMERAS = {
    "perspective": rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=0.5, far=30.0),
    "near plane through it": rj.PerspectiveCamera((0.6, 0.8, 2.6), (0, 0, 0), near=1.9),
    "parallel": rj.OrthographicCamera((1.0, 1.2, 4.5), (0, 0, 0), height=3.5, far=20.0),
}


@pytest.fixture
def scene(cube, sphere):
    found = rj.Scene()
    found.add(sphere, T.compose(T.translate((-1.0, 0.2, 0.3)), T.scale((0.8, 0.5, 1.0))))
    found.add(cube, T.scale((0.5, 0.5, 0.5)))
    found.add(sphere, T.compose(T.translate((0.8, 1.0, -1.0)), T.scale((-0.7, 0.7, 0.7))))
    return found


def rays(camera, size, x, y):
    """Return start and end of the line of sight through a pixel's centre, world space."""
    clip = camera.projection_matrix(size) @ camera.view_matrix()
    at = (x + 0.5) / size[0] * 2.0 - 1.0, 1.0 - (y + 0.5) / size[1] * 2.0
    ends = [np.linalg.solve(clip, (*at, z, 1.0)) for z in (-1.0, 0.5)]
    return [end[:3] / end[3] for end in ends]


@pytest.mark.parametrize("name", list(CAMERAS))
def test_a_pick_has_the_numbers_of_the_buffers_and_lies_on_the_line_of_sight(scene, name):
    camera = CAMERAS[name]
    frame = rj.render(scene, camera, size=SIZE, outputs=OUTPUTS)
    starts = np.cumsum([0, *(len(node.mesh.faces) for node in scene.nodes)])
    objects = set()
    for y, x in np.ndindex(*SIZE[::-1]):
        pick = frame.pick(x, y)
        if frame.face_id[y, x] < 0:
            assert pick is None
            continue
        assert type(pick) is rj.PickedPixel
        assert pick.node == frame.object_id[y, x]
        assert pick.face + starts[pick.node] == frame.face_id[y, x]
        assert pick.weights.tobytes() == frame.barycentric[y, x].tobytes()
        assert pick.position.tobytes() == frame.position[y, x].tobytes()
        # The point is that of the face's vertices, and the pixel's centre sees it.
        node = scene.nodes[pick.node]
        corners = T.apply(node.world_from_model, node.mesh.vertices[node.mesh.faces[pick.face]])
        np.testing.assert_allclose(pick.weights @ corners, pick.position, atol=2e-6)
        start, end = rays(camera, SIZE, x, y)
        along = (end - start) / np.linalg.norm(end - start)
        away = np.linalg.norm(np.cross(pick.position - start, along))
        assert away < 2e-3
        objects.add(pick.node)
    assert objects == {0, 1, 2}


def test_a_pick_is_the_callers(scene):
    frame = rj.render(scene, CAMERAS["parallel"], size=SIZE, outputs=PICK_OUTPUTS)
    pick = frame.pick(SIZE[0] // 2, SIZE[1] // 2)
    pick.weights[:] = 7.0
    pick.position[:] = 7.0
    assert frame.barycentric.max() <= 1.0
    assert frame.position[np.isfinite(frame.position)].max() < 7.0


def test_pixels_are_columns_and_rows_of_any_kind_of_whole_number(cube):
    frame = rj.render(cube, size=(8, 6), outputs=PICK_OUTPUTS)
    frame.face_id[0, 7] = frame.face_id.max()
    assert frame.pick(np.int64(7), np.uint8(0)) is not None
    assert frame.pick(0, 0) is None


def test_fractions_are_of_the_pixel_that_holds_them(cube):
    frame = rj.render(cube, size=(8, 6), outputs=PICK_OUTPUTS)
    for kind in (float, np.float32, np.float64):
        found, wanted = frame.pick(kind(4.75), kind(3.0)), frame.pick(4, 3)
        assert (found.node, found.face) == (wanted.node, wanted.face)
        assert found.position.tolist() == wanted.position.tolist()
    assert frame.pick(7.99, 5.99) is None
    for value in (math.nan, math.inf, -0.01, 8.0, np.float32(8.5)):
        with pytest.raises(ValueError, match=r"^x must be a point in the picture, .* below 8, got"):
            frame.pick(value, 0)
        with pytest.raises(ValueError, match=r"^y must be a point in the picture, .* below 6, got"):
            frame.pick(0, value)


@pytest.mark.parametrize("value", [-1, 8, "1", None, True, np.zeros(2)])
def test_what_is_no_pixel_is_named(cube, value):
    frame = rj.render(cube, size=(8, 6), outputs=PICK_OUTPUTS)
    with pytest.raises(ValueError, match=r"^x must be a whole number in 0\.\.7, got "):
        frame.pick(value, 0)
    with pytest.raises(ValueError, match=r"^y must be a whole number in 0\.\.5, got "):
        frame.pick(0, value)


def test_outputs_that_it_needs_are_named(cube):
    frame = rj.render(cube, size=(8, 6), outputs=("color", "face_id"))
    with pytest.raises(
        rj.OutputNotRequestedError,
        match=r"barycentric and position were not.*outputs=\(..., 'barycentric', 'position'\)",
    ):
        frame.pick(4, 3)
    frame = rj.render(cube, size=(8, 6), outputs=("barycentric", "face_id"))
    with pytest.raises(rj.OutputNotRequestedError, match=r"position was not.*\(..., 'position'\)"):
        frame.pick(4, 3)
    made = rj.render(cube, size=(8, 6), outputs=PICK_OUTPUTS)
    with pytest.raises(ValueError, match="made of arrays"):
        rj.Frame(made.arrays(), made.plan, made.stats).pick(4, 3)


def same(one, other):
    arrays = zip(one[2:4], other[2:4], strict=True)
    is_same = all(ours.tobytes() == theirs.tobytes() for ours, theirs in arrays)
    return is_same and (one[:2], one.scalar) == (other[:2], other.scalar)


def test_frames_that_are_drawn_in_other_ways_pick_the_same(scene):
    camera, size = CAMERAS["perspective"], (96, 72)
    want = rj.render(scene, camera, size=size, outputs=PICK_OUTPUTS).pick(48, 36)
    assert want is not None
    with RegionRenderer(scene, camera, size=size, outputs=PICK_OUTPUTS) as renderer:
        part = renderer.render_region(Region(0, 0, 64, 64))
    assert same(part.pick(48, 36), want)
    (many,) = rj.render_many(scene, [camera], size=size, outputs=PICK_OUTPUTS, threads=1)
    assert same(many.pick(48, 36), want)
    drawn = many.arrays(), many.stats, 0
    options = FrameRequest(size, rj.Quality.standard(), PICK_OUTPUTS, None, "none")
    assert same(RemoteFrame(drawn, scene, camera, options).pick(48, 36), want)
    quality = rj.Quality(samples=64)
    fine = rj.render(scene, camera, size=size, outputs=(*PICK_OUTPUTS, "color"), quality=quality)
    assert same(fine.pick(48, 36), want)
    layered = rj.render_layers(scene, camera, k=3, size=size, outputs=PICK_OUTPUTS)
    assert same(layered.pick(48, 36), want)
    second = layered.pick(48, 36, layer=1)
    eye = camera.eye_position()
    assert np.linalg.norm(second.position - eye) > np.linalg.norm(want.position - eye)
    assert second.node == np.searchsorted(
        np.cumsum([len(node.mesh.faces) for node in scene.nodes]),
        layered.face_id[1, 36, 48],
        "right",
    )
    assert layered.pick(0, 0, 2) is None
    with pytest.raises(ValueError, match=r"layer must be a whole number in 0\.\.2, got 3"):
        layered.pick(48, 36, 3)


def test_partitions_are_one_object(cube, sphere):
    flat, camera = rj.Material("flat"), CAMERAS["perspective"]
    options = FrameRequest(SIZE, rj.Quality.standard(), PICK_OUTPUTS, None, "none")
    parts = [
        rj.Mesh(sphere.vertices * 0.3, sphere.faces, material=flat),
        (cube.vertices, cube.faces),
    ]
    drawn = [sort_last.draw_part(part, rj.Scene(), flat, camera, options, 1) for part in parts]
    frame = sort_last.merge_images(*drawn).frame()
    pick = frame.pick(24, 18)
    assert pick.node == 0
    assert pick.face == frame.face_id[18, 24] >= len(sphere.faces)


def test_a_pick_has_the_scalar_if_it_was_asked_for(cube):
    scene = rj.Scene()
    scene.add(rj.Mesh(cube.vertices, cube.faces, scalars=np.arange(8.0)))
    scene.add(cube, T.translate((1.8, 0.0, 0.0)))
    camera = CAMERAS["perspective"]
    frame = rj.render(scene, camera, size=SIZE, outputs=(*PICK_OUTPUTS, "scalar"))
    bare = rj.render(scene, camera, size=SIZE, outputs=PICK_OUTPUTS)
    seen = {0: 0, 1: 0}
    for y, x in np.argwhere(frame.face_id >= 0)[::7].tolist():
        pick = frame.pick(x, y)
        if pick.node == 0:
            corners = scene.nodes[0].mesh.faces[pick.face]
            assert pick.scalar == frame.scalar[y, x]
            assert pick.scalar == pytest.approx(float(pick.weights @ corners), abs=1e-5)
        else:
            assert math.isnan(pick.scalar)
        seen[pick.node] += 1
        assert bare.pick(x, y).scalar is None
    assert min(seen.values()) > 3
    layers_of = rj.render_layers(scene, camera, k=2, size=SIZE, outputs=(*PICK_OUTPUTS, "scalar"))
    y, x = np.argwhere(layers_of.face_id[1] >= 0)[0].tolist()
    assert layers_of.pick(x, y, 1).scalar == layers_of.scalar[1, y, x]
