"""Hidden lines are the edges that surfaces hide, dashed evenly along whole curves."""

from __future__ import annotations

import naive_lines
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.outline import feature_edges, hidden
from rasterjit.scene.color import decoding_table

SIZE = (90, 70)
SOLID = (1024.0, 1.0)
"""Dashes longer than any line here."""

WHITE = rj.Material("unlit", "white")


def scene_of(*meshes, **settings):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=WHITE))
    scene.outline = rj.Outline(**{"color": "red", "hidden": "dashed", **settings})
    return scene


def shares(scene, camera, **options):
    """Return how much of each pixel red lines cover on white: green is what is left."""
    options = {"threads": 1, "background": "white", "size": SIZE, **options}
    return 1.0 - decoding_table()[rj.render(scene, camera, **options).color[..., 1]]


def looking(eye=(3.0, 2.0, 4.0)):
    return rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=40.0, near=0.5)


def far_from(segments, distance):
    """Return which pixels are farther than a distance from all segments, (H, W)."""
    return naive_lines.stroke_shares(segments, distance, SIZE, steps=2) == 0.0


@pytest.mark.parametrize("eye", [(3.0, 2.0, 4.0), (-1.5, 2.0, 3.5)])
def test_hidden_edges_are_those_of_exact_visibility(cube, sphere, eye):
    smaller = rj.Mesh(0.7 * sphere.vertices + (1.3, 0.2, 0.1), sphere.faces)
    scene, camera = scene_of(cube, smaller, width=3.0, dash=SOLID), looking(eye)
    smooth = rj.Quality(lines="coverage")
    found = shares(scene, camera, quality=smooth)
    drawing = rj.line_drawing(
        scene, camera, SIZE, edges=("boundary", "silhouette", "crease"), crease_angle=40.0
    )
    lines = drawing.segments.reshape(-1, 4)
    unseen, seen = lines[~drawing.visible], lines[drawing.visible]
    assert len(unseen) > 5
    want = naive_lines.stroke_shares(unseen, 0.75, SIZE)
    # Away from what is seen, and from where objects pierce each other: no edge of either.
    scene.outline = rj.Outline("red", 3.0)
    away = far_from(seen, 4.0) & (shares(scene, camera, quality=smooth) == 0)
    points = unseen.reshape(-1, 2)
    ends = far_from(np.concatenate([points, points + 0.01], axis=1), 2.0)
    assert (want[away & ends] > 0.5).sum() > 20
    assert np.abs(found - want)[away & ends].max() < 0.1


def test_dashes_and_gaps_have_their_lengths():
    """A wall before a bar: one edge of it is straight, long and hidden."""
    wall = rj.Mesh([(-9, -9, 1), (9, -9, 1), (9, 9, 1), (-9, 9, 1)], [(0, 1, 2), (0, 2, 3)])
    bar = rj.Mesh([(-40, -0.1, 0), (40, -0.1, 0), (40, 9, 0), (-40, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=7.0, near=0.1, far=20.0)
    found = shares(scene_of(wall, bar, width=2.0, dash=(7.0, 5.0)), camera)
    along = found.sum(axis=0)
    # Dashes have round ends, half a pixel long each.
    assert along[9:81].mean() == pytest.approx(8.0 / 12.0, abs=0.03)
    spectrum = np.abs(np.fft.rfft(along[9:81] - along[9:81].mean()))
    assert np.argmax(spectrum) == 72 // 12
    solid = shares(scene_of(wall, bar, width=2.0, dash=SOLID), camera).sum(axis=0)
    assert solid[9:81] == pytest.approx(np.ones(72), abs=0.02)


@pytest.mark.parametrize("is_closed", [False, True])
def test_chains_are_measured_through_lines_in_any_order(is_closed):
    random = np.random.default_rng(3)
    count = 40
    lengths = random.uniform(0.5, 2.0, count)
    nodes = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    nodes[-1, 1] = 0 if is_closed else count
    order, turns = random.permutation(count), random.integers(0, 2, count).astype(bool)
    mixed = nodes[order].copy()
    mixed[turns] = mixed[turns, ::-1]
    flat = mixed.ravel()
    incident = np.argsort(flat, kind="stable")
    starts = np.searchsorted(flat[incident], np.arange(flat.max() + 2))
    distances, turned = np.full(count, -1.0), np.zeros(count, np.uint8)
    feature_edges.measure_chains(
        np.ascontiguousarray(mixed), lengths[order], starts.astype(np.int64), incident // 2,
        distances, turned,
    )  # fmt: skip
    found, flipped = np.empty(count), np.empty(count, bool)
    found[order], flipped[order] = distances, turned.astype(bool) ^ turns
    # It begins at either end, or somewhere, and runs on.
    assert flipped.all() or not flipped.any()
    if flipped.all():
        found, lengths = found[::-1], lengths[::-1]
    first = int(np.argmin(found))
    assert found[first] == 0.0
    assert first == 0 or is_closed
    want = np.cumsum(np.roll(lengths, -first)) - np.roll(lengths, -first)
    assert np.roll(found, -first) == pytest.approx(want)


def test_dashes_of_pieces_are_those_of_the_whole():
    points = np.rint(np.linspace((300, 700), (18000, 9300), 60)).astype(np.int32)
    depths = np.linspace(0.7, 0.2, 60)
    lines = np.concatenate([points[:-1], points[1:]], axis=1)
    of_lines = np.stack([depths[:-1], depths[1:]], axis=1)
    whole = np.concatenate([points[:1], points[-1:]], axis=1)
    one, _ = hidden.split_into_dashes(whole, np.array([[0.7, 0.2]]), (6.0, 4.0), 256)
    many, their = hidden.split_into_dashes(lines, of_lines, (6.0, 4.0), 256)
    length = np.linalg.norm(one[:, 2:] - one[:, :2], axis=1).sum()
    pieces = np.linalg.norm(many[:, 2:] - many[:, :2], axis=1)
    assert pieces.sum() == pytest.approx(length, rel=0.01)
    # Depth runs evenly along the line.
    share = (many[:, 0] - points[0, 0]) / (points[-1, 0] - points[0, 0])
    assert their[:, 0] == pytest.approx(0.7 - 0.5 * share, abs=1e-3)
    starts = one[:, :2].astype(float)
    nearest = np.abs(many[:, None, :2] - starts).max(axis=2).min(axis=0)
    assert nearest.max() <= 4.0


def test_edges_of_faces_wound_either_way_are_found(cube):
    turned = cube.faces.copy()
    turned[::3] = turned[::3, ::-1]
    camera = looking()
    alike = [
        shares(scene_of(rj.Mesh(cube.vertices, faces), dash=SOLID), camera)
        for faces in (cube.faces, turned)
    ]
    assert np.abs(alike[0] - alike[1]).max() < 0.02
    assert alike[0].sum() > 50


@pytest.mark.needs_jit
def test_threads_and_views_drawn_together_change_no_bit(sphere, cube):
    scene = scene_of(sphere, cube, width=4.0)
    cameras = [looking(), looking((1.0, 3.0, 3.0))]
    alone = [rj.render(scene, camera, size=(150, 120), threads=1).color for camera in cameras]
    again = [rj.render(scene, camera, size=(150, 120), threads=3).color for camera in cameras]
    batch = rj.render_batch(scene, cameras, size=(150, 120)).color
    assert np.array_equal(alone, again)
    assert np.array_equal(alone, batch)


def test_only_what_is_called_for(cube, monkeypatch):
    def refuse(*_):
        raise AssertionError("nobody asked for it")

    for name in ("look_at_faces", "list_feature_edges", "measure_chains"):
        monkeypatch.setattr(feature_edges, name, refuse)
    for scene, outputs in (
        (scene_of(cube, hidden="none"), ("color",)),
        (scene_of(cube), ("depth",)),
    ):
        rj.render(scene, looking(), size=(16, 16), outputs=outputs)
    with pytest.raises(AssertionError, match="nobody asked"):
        rj.render(scene_of(cube), looking(), size=(16, 16))


def test_the_technical_style_has_them_on_request(cube):
    plain, dashed = (rj.styles.technical(cube, hidden=one) for one in ("none", "dashed"))
    assert "hidden lines             out (scene.outline leaves them out)" in str(plain.explain())
    row = "hidden lines             in  (dashes of 5, gaps of 4, 0.75 wide, by coverage"
    assert row in str(dashed.explain())
    one, other = (style.render(size=(60, 60)).color.astype(int) for style in (plain, dashed))
    assert 0 < (one != other).any(axis=2).sum() < 300
    assert (other <= one).all()


def test_nothing_but_points_has_no_hidden_lines():
    scene = rj.Scene()
    scene.add(rj.Points([(0, 0, 0), (1, 0, 0)], size=5))
    scene.outline = rj.Outline(hidden="dashed")
    assert rj.render(scene, size=(20, 20)).color.shape == (20, 20, 4)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"hidden": "dotted"}, "hidden must be one of"),
        ({"dash": (3.0,)}, "dash must be the lengths of a dash and a gap"),
        ({"dash": (3.0, 0.0)}, r"dash\[1\] must be in 1..1024, got 0"),
        ({"dash": 3.0}, "dash must"),
    ],
)
def test_bad_input(fields, message):
    with pytest.raises(ValueError, match=message):
        rj.Outline(**fields)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_line_without_length_has_no_dashes():
    # An edge seen end-on joins two others.
    ends = np.array([[0, 0, 5120, 0], [5120, 0, 5120, 0], [5120, 0, 10240, 0]], np.int32)
    depths = np.array([[0.5, 0.5], [0.5, 0.6], [0.6, 0.6]])
    found, found_depths = hidden.split_into_dashes(ends, depths, (50.0, 4.0), 256)
    assert found.tolist() == ends[[0, 2]].tolist()
    assert found_depths.tolist() == depths[[0, 2]].tolist()
