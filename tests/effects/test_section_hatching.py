"""Hatched caps, their colours by parts or scalars, and section lines through lenses."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.survey.cross_sections import PART_COLORS, cut_scene

SIZE = (96, 72)
CUT = {"point": (0, 0, 0.1), "normal": (0, 0, 1)}
FRONT = rj.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), height=3.0)


def boxes(*places, size=(1.0, 1.0, 1.0), **fields):
    """Return a scene of white boxes that a plane cuts."""
    scene, shape = rj.Scene(), trimesh.creation.box(size)
    for place in places:
        mesh = rj.Mesh(shape.vertices, shape.faces, material=rj.Material("unlit", "white"))
        scene.add(mesh, rj.transforms.translate(place))
    scene.section = rj.SectionPlane(**CUT, **{"cap_color": "white", **fields})
    return scene


def shown(scene, camera=FRONT, **options):
    return rj.render(scene, camera, **{"size": SIZE, "threads": 1, **options})


def true_coverage(angle, spacing, width, samples=64):
    """Return what lines cover of the pixels of a picture, by many samples across them."""
    angle = np.radians(angle)
    y, x = np.indices(SIZE[::-1]) + 0.5
    across = x * np.sin(angle) + y * np.cos(angle)
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    periods = (across[..., np.newaxis] + steps) / spacing
    return (np.abs(periods % 1.0 - 0.5) * spacing <= width / 2.0).mean(axis=2)


@pytest.mark.parametrize(
    ("angle", "spacing", "width"), [(45.0, 8.0, 1.0), (0.0, 6.0, 2.0), (-20.0, 5.0, 0.5),
                                    (90.0, 10.5, 3.25)],
)  # fmt: skip
@pytest.mark.parametrize("blending", ["srgb8", "linear"])
def test_lines_cover_what_they_cover_of_a_pixel(angle, spacing, width, blending):
    scene = boxes(
        (0, 0, 0), size=(2, 2, 2), hatch=spacing, hatch_angle=angle, hatch_width=width,
        hatch_color="black",
    )  # fmt: skip
    frame = shown(scene, quality=rj.Quality(blending=blending), outputs=("color", "face_id"))
    is_cap = frame.face_id == 12
    assert is_cap.mean() > 0.3
    wanted = true_coverage(angle, spacing, width)[is_cap]
    code = frame.color[is_cap][:, 0] / 255.0
    light = code if blending == "srgb8" else np.where(
        code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4
    )  # fmt: skip
    np.testing.assert_allclose(1.0 - light, wanted, atol=0.025)


def test_only_caps_are_hatched_and_only_in_color():
    outputs = ("color", "linear", "depth", "object_id", "face_id")
    plain, hatched = (
        shown(boxes((0, 0, 0), hatch=hatch), outputs=outputs) for hatch in (None, 4.0)
    )
    assert not plain.plan.has("section hatching")
    assert hatched.plan.has("section hatching")
    for name in outputs[1:]:
        assert hatched.arrays()[name].tobytes() == plain.arrays()[name].tobytes(), name
    is_other = (plain.color != hatched.color).any(axis=2)
    assert is_other.any()
    assert (plain.face_id[is_other] == 12).all()


def test_objects_that_meet_have_other_lines():
    scene = boxes((0, 0, 0), (1, 0, 0), (2, 0, 0), (9, 0, 0), (1, 1, 0), hatch=6.0)
    assert cut_scene(scene).nodes.cut.hatchings.tolist() == [0, 1, 0, 0, 2]
    scene = boxes((-0.5, 0, 0), (0.5, 0, 0), hatch=6.0, hatch_angle=0.0, hatch_width=2.0)
    frame = shown(scene, outputs=("color", "object_id"))
    left, right = (frame.color[26:46, :, 0][:, frame.object_id[36] == n] for n in (0, 1))
    # Level lines, then upright ones.
    assert (left == left[:, :1]).all()
    assert (right == right[:1]).all()
    assert len(np.unique(left)) > 1
    assert len(np.unique(right)) > 1


def test_hatchings_have_the_same_bits_in_all_ways():
    scene = boxes((-0.4, 0, 0), (0.4, 0.2, 0), hatch=5.0, lines=False, cap_color="parts")
    camera = rj.PerspectiveCamera((1.0, 1.0, 4.0), (0.0, 0.0, 0.0), fov_y=40.0)
    wanted = shown(scene, camera).color
    assert (shown(scene, camera, threads=4).color == wanted).all()
    batch = rj.render_batch(scene, [camera, FRONT], size=SIZE)
    assert (batch.color[0] == wanted).all()
    with RegionRenderer(scene, camera, size=SIZE, threads=1) as regions:
        for (x, y, width, height), frame in regions.render_regions(64):
            assert (frame.color == wanted[y : y + height, x : x + width]).all()


def test_hatchings_are_drawn_through_a_lens():
    scene = boxes((0, 0, 0), hatch=5.0)
    camera = rj.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_y=50.0)
    frame = shown(scene, camera, lens=rj.PinholeDistortion(k1=-0.2), outputs=("color", "face_id"))
    assert set(np.unique(frame.face_id)) == {-1, 12}
    is_cap = frame.face_id == 12
    dark = (frame.color[..., 0] < 200) & is_cap
    assert 0.1 < dark.sum() / is_cap.sum() < 0.4


def test_parts_have_colors_of_their_own():
    places = [(2.2 * n - 9.9, 0, 0) for n in range(10)]
    scene = boxes(*places, cap_color="parts")
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=18.0)
    frame = shown(scene, camera, outputs=("color", "object_id"))
    for number in range(10):
        color = frame.color[frame.object_id == number]
        assert len(color)
        code = PART_COLORS[number % len(PART_COLORS)]
        assert (color[:, :3] == [int(code[k : k + 2], 16) for k in (1, 3, 5)]).all()


def with_scalars(shape, values, **fields):
    """Return a scene of a mesh with scalars at its vertices, cut by a plane across."""
    scene = rj.Scene()
    scene.add(rj.Mesh(shape.vertices, shape.faces, scalars=values, material=rj.Material("flat")))
    scene.section = rj.SectionPlane((0, 0, 0.05), (0.1, 0.05, 1), cap_color="scalars", **fields)
    return scene


SHAPES = {
    "ball": trimesh.creation.icosphere(3),
    "box": trimesh.creation.box((2.0, 1.0, 1.4)).subdivide(),
    "torus": trimesh.creation.torus(1.0, 0.4, 24, 12),
    "pipe": trimesh.creation.annulus(0.5, 1.0, 1.0, sections=16),
}


@pytest.mark.parametrize("name", SHAPES)
def test_scalars_that_are_linear_in_space_are_so_on_caps(name):
    shape, slope = SHAPES[name], np.array([1.0, -2.0, 0.5])
    scene = with_scalars(shape, shape.vertices @ slope)
    # A core takes a part of the cap, and has a cap in a colour of its own.
    core = trimesh.creation.box((0.3, 0.3, 4.0))
    scene.add(rj.Mesh(core.vertices, core.faces), rj.transforms.translate((0.7, 0.1, 0.0)))
    camera = rj.PerspectiveCamera((0.5, 0.4, 5.0), (0, 0, 0), fov_y=35.0)
    frame = shown(scene, camera, outputs=("scalar", "position", "face_id"))
    is_cap = frame.face_id == len(shape.faces) + len(core.faces)
    assert is_cap.mean() > 0.05
    wanted = frame.position[is_cap] @ slope
    np.testing.assert_allclose(frame.scalar[is_cap], wanted, atol=2e-6)


def test_scalars_on_caps_depend_on_the_outline_alone():
    # One box, its sides cut into triangles in two ways, and one with points that change nothing.
    rng = np.random.default_rng(3)
    shape = trimesh.creation.box((2.0, 2.0, 2.0))
    corners = rng.normal(size=8)
    quads = trimesh.creation.box((2.0, 2.0, 2.0)).apply_transform(np.diag([-1.0, 1, 1, 1]))
    found = []
    for one in (shape, quads):
        nearest = [np.abs(shape.vertices - v).sum(axis=1).argmin() for v in one.vertices]
        scene = with_scalars(one, corners[nearest])
        # Across the corners' values, sides differ inside: the cut goes along edges of the box.
        scene.section = rj.SectionPlane((0, 0, 1.0 - 1e-9), (0, 0, 1), cap_color="scalars")
        found.append(shown(scene, outputs=("scalar",)).scalar)
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)
    low, high = corners.min(), corners.max()
    inside = found[0][np.isfinite(found[0])]
    assert low - 1e-6 <= inside.min() < inside.max() <= high + 1e-6
    # The middle of a square is as far from all corners.
    middle = found[0][SIZE[1] // 2 - 1 : SIZE[1] // 2 + 1, SIZE[0] // 2 - 1 : SIZE[0] // 2 + 1]
    top = shape.vertices[:, 2] > 0.0
    assert middle.mean() == pytest.approx(corners[top].mean(), abs=1e-4)


def test_scalars_that_are_not_there_leave_the_color_as_it_is():
    shape = SHAPES["ball"]
    for values in (None, np.arange(len(shape.faces))):
        scene = with_scalars(shape, values)
        by_scalars = shown(scene).color
        scene.section = rj.SectionPlane((0, 0, 0.05), (0.1, 0.05, 1))
        assert (shown(scene).color == by_scalars).all()
    # What is NaN somewhere is spread from the rest of the outline.
    values = np.array(shape.vertices[:, 0])
    values[np.abs(shape.vertices[:, 0] - 0.9) < 0.05] = np.nan
    frame = shown(with_scalars(shape, values), outputs=("scalar", "face_id"))
    is_cap = frame.face_id == len(shape.faces)
    assert np.isfinite(frame.scalar[is_cap]).mean() > 0.9


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"hatch": 0.5}, r"hatch must be above hatch_width \(1\) and at most 1024 pixels, got 0.5"),
        ({"hatch": 2000}, "hatch must be above hatch_width"),
        ({"hatch": "thin"}, "hatch must be"),
        ({"hatch": 8, "hatch_width": 8}, r"hatch must be above hatch_width \(8\)"),
        ({"hatch_width": 0}, "hatch_width must be"),
        ({"hatch_width": 65}, "hatch_width must be at most 64 pixels, got 65"),
        ({"hatch_angle": 400}, "hatch_angle must be"),
        ({"hatch_angle": np.nan}, "hatch_angle must be"),
        ({"hatch_color": "no colour"}, "hatch_color"),
        ({"cap_color": "part"}, "cap_color"),
    ],
)
def test_bad_hatchings_are_named(fields, match):
    with pytest.raises(ValueError, match=match):
        rj.SectionPlane(**CUT, **fields)


LENSES = rj.PinholeDistortion(k1=-0.15), rj.FisheyeLens(), rj.Equirectangular()


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: type(lens).__name__)
@pytest.mark.parametrize("lines", ["bresenham", "coverage"])
def test_section_lines_are_bent_by_lenses(lens, lines):
    size = (200, 100) if isinstance(lens, rj.Equirectangular) else SIZE
    scene = boxes((0, 0, 0), lines=True, line_color="red", line_width=2, size=(1.4, 1.0, 1.0))
    # A wall hides the left of the cut.
    wall = rj.Mesh([[-2, -2, 0], [-0.3, -2, 0], [-0.3, 2, 0], [-2, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    wall.material = rj.Material("unlit", "white")
    scene.add(rj.Node(wall, rj.transforms.translate((0, 0, 0.6)), section=False))
    camera = rj.PerspectiveCamera((0.1, 0.2, 1.5), (0.0, 0.0, 0.0), fov_y=60.0)
    frame = shown(scene, camera, size=size, lens=lens, quality=rj.Quality(lines=lines))
    assert frame.plan.has("section lines")
    red = (frame.color[..., 0] > 150) & (frame.color[..., 1] < 140)
    seen, hidden = [], []
    (outline,) = rj.cross_section(scene, scene.section).outlines[0]
    for a, b in itertools.pairwise(outline):
        points = a + np.linspace(0.0, 1.0, 200)[:, np.newaxis] * (b - a)
        # Where the ray to each point crosses the plane of the wall.
        along = (1.5 - 0.6) / (1.5 - points[:, 2])
        at_wall = 0.1 + along * (points[:, 0] - 0.1)
        seen.append(points[at_wall > -0.25])
        hidden.append(points[at_wall < -0.35])
    seen, hidden = np.concatenate(seen), np.concatenate(hidden)
    at = [lens_pixels(lens, camera, size, points) for points in (seen, hidden)]
    column, row = np.floor(at[0]).astype(int).T
    near = red | np.roll(red, 1, 0) | np.roll(red, -1, 0) | np.roll(red, 1, 1) | np.roll(red, -1, 1)
    assert near[row, column].all()
    # Nothing is red far from the lines that are seen, nor where they are hidden.
    y, x = np.nonzero(red)
    away = np.abs(at[0][:, np.newaxis] - np.stack([x + 0.5, y + 0.5], axis=1)).max(axis=2)
    assert away.min(axis=0).max() < 4.0
    column, row = np.floor(at[1]).astype(int).T
    assert len(hidden) > 100
    assert not red[row, column].any()


def lens_pixels(lens, camera, size, points):
    """Return where a lens shows points, (N, 2), by OpenCV's axes."""
    view = camera.view_matrix()
    local = points @ view[:3, :3].T + view[:3, 3]
    places = lens.project(local * (1.0, -1.0, -1.0))
    if isinstance(lens, rj.Equirectangular):
        return (places / (2 * np.pi, np.pi) + 0.5) * size
    focal = camera.projection_matrix(size)[1, 1] * size[1] / 2.0
    return places * focal + np.array(size) / 2.0
