"""Pictures with lines: the same bits however they are drawn, and right in every output."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import rasterjit as rj
from rasterjit import transforms
from rasterjit.rendering import planning
from rasterjit.rendering.regions import RegionRenderer

SIZE = (150, 100)
CAMERA = rj.PerspectiveCamera((2.5, 2.0, 3.5), (0, 0, 0), fov_y=50.0)
OUTPUTS = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "instance_id", "material_id",
    "barycentric", "normal", "geometric_normal", "normal_camera", "position", "position_camera",
    "object_position", "nocs", "coverage", "scalar",
)  # fmt: skip
GLASS = rj.Material("unlit", base_color=(0.2, 0.4, 0.9, 0.4), alpha_mode="blend")


def helix():
    t = np.linspace(0.0, 12.0, 200)
    return np.stack([np.cos(t), t / 6.0 - 1.0, np.sin(t)], axis=1)


def scene_with(shadow=False, glass=False):
    scene = rj.Scene()
    scene.add(rj.Mesh([[-9, -1.1, -9], [-9, -1.1, 9], [9, -1.1, 9], [9, -1.1, -9.0]],
                      [[0, 1, 2], [0, 2, 3]]))  # fmt: skip
    points = helix()
    scene.add(rj.Lines(points, width=4.0, scalars=points[:, 1]))
    colors = np.random.default_rng(2).random((200, 3))
    scene.add(rj.Lines(1.3 * points, colors=colors, width=0.06, unit="world", dashes=[0.3, 0.1]))
    scene.add(rj.Grid(30.0, 30, center=(0, -1.0, 0)))
    if glass:
        scene.add(rj.Lines(points[::20] * 1.6, width=9.0, material=GLASS))
    if shadow:
        scene.lights = [rj.DirectionalLight((-0.3, -1, 0.2), shadow=rj.Shadow(size=256))]
    return scene


def draw(scene, camera=CAMERA, outputs=("color",), threads=1, size=SIZE, **options):
    return rj.render(scene, camera, size=size, outputs=outputs, threads=threads, **options)


@pytest.mark.parametrize("samples", [1, 4, "area", 64])
def test_threads_and_regions_change_no_bit(samples):
    scene, quality = scene_with(glass=samples in (1, 64)), rj.Quality(samples=samples)
    whole = draw(scene, outputs=OUTPUTS, quality=quality)
    other = draw(scene, outputs=OUTPUTS, quality=quality, threads=3)
    for name, array in whole.arrays().items():
        assert array.tobytes() == other.arrays()[name].tobytes(), name
    with RegionRenderer(
        scene, CAMERA, size=SIZE, quality=quality, outputs=OUTPUTS, threads=2
    ) as renderer:
        for region, frame in renderer.render_regions(64):
            left, top, width, height = region
            for name, array in frame.arrays().items():
                part = whole.arrays()[name][top : top + height, left : left + width]
                assert array.tobytes() == part.tobytes(), name


def test_outputs_of_lines_are_those_of_their_points():
    frame = draw(scene_with(), outputs=OUTPUTS)
    on_line = (frame.object_id == 1) | (frame.object_id == 2)
    assert on_line.sum() > 500
    assert not frame.barycentric[on_line].any()
    # Toward the viewer, from where it is.
    toward = CAMERA.eye_position() - frame.position[on_line]
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    for name in ("normal", "geometric_normal"):
        np.testing.assert_allclose(frame.arrays()[name][on_line], toward, atol=1e-5)
    assert frame.face_id[frame.object_id == 1].max() <= 2 + 198
    first = frame.object_id == 1
    np.testing.assert_allclose(frame.scalar[first], frame.position[first][:, 1], atol=1e-5)
    radius = np.linalg.norm(frame.position[first][:, [0, 2]], axis=1)
    np.testing.assert_allclose(radius, 1.0, atol=2e-3)
    # The depth of a pixel is that of a point near it: within what half a width changes.
    view = CAMERA.view_matrix()
    ahead = -(frame.position[first] @ view[2, :3] + view[2, 3])
    np.testing.assert_allclose(frame.depth[first], ahead, rtol=2e-2)


def test_a_line_has_its_width_in_pixels_with_any_samples_and_lens():
    camera = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0), fov_y=40.0)
    lines = rj.Lines([[0, -9, 0], [0, 9, 0.0]], width=6.0)
    for samples in (1, 4, 16, "area", 64):
        frame = draw(lines, camera, ("linear",), quality=rj.Quality(samples=samples))
        assert abs((1.0 - frame.linear[50, :, 0]).sum() - 6.0) < 0.02, samples
    lens = rj.PinholeDistortion(0.05)
    frame = draw(lines, camera, ("linear",), lens=lens, background="white")
    assert abs((1.0 - frame.linear[50, :, 0]).sum() - 6.0) < 0.3


def test_lines_in_scene_units_cast_shadows_and_others_do_not():
    ground = rj.Mesh([[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9.0]], [[0, 1, 2], [0, 2, 3]])
    camera = rj.PerspectiveCamera((0, 6, 0.01), (0, 0, 0), fov_y=50.0)

    def dark(**options):
        scene = rj.Scene()
        scene.add(ground)
        scene.add(rj.Lines([[-2, 1, 0], [2, 1, 0.0]], caps="butt", **options))
        scene.lights = [rj.DirectionalLight((0, -1, 1), shadow=rj.Shadow())]
        frame = draw(scene, camera, ("linear", "object_id"))
        return (frame.linear[..., 0] < 0.05) & (frame.object_id == 0)

    shadow = dark(width=0.4, unit="world")
    assert not dark(width=20.0).any()
    # It is as long as the line, and as wide: along z, at the slope of the light.
    pixel = 2 * 6.0 * np.tan(np.radians(25.0)) / SIZE[1]
    area = shadow.sum() * pixel**2
    assert 0.8 * 4 * 0.4 < area < 1.2 * 4 * 0.4 * np.sqrt(2.0)


def test_motion_of_lines_is_that_of_their_points():
    scene = rj.Scene()
    node = scene.add(rj.Lines([[-1, 0, 0], [1, 0, 0.0]], width=5.0))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0)
    before = rj.PreviousView(copy.deepcopy(scene), camera)
    node.transform = transforms.translate((0.1, 0, 0))
    frame = draw(scene, camera, ("motion", "motion_visible", "face_id"), previous=before)
    seen = frame.face_id == 0
    np.testing.assert_allclose(frame.motion[seen], [[5.0, 0.0]] * int(seen.sum()), atol=1e-4)
    assert frame.motion_visible[seen][2:].any()


def test_a_pixel_of_a_line_can_be_picked_and_explained():
    scene = scene_with()
    frame = draw(scene, outputs=("color", "face_id", "object_id", "barycentric", "position"))
    row, column = np.argwhere(frame.object_id == 1)[40].tolist()
    picked = frame.pick(column, row)
    assert picked.face == frame.face_id[row, column] - 2
    told = rj.explain_pixel(scene, CAMERA, SIZE, column, row)
    assert tuple(told.color[:3]) == tuple(frame.color[row, column, :3])
    assert f"the ends of segment {frame.face_id[row, column]}" in str(told)
    text = str(rj.explain(scene, CAMERA, size=SIZE))
    assert "\nlines " in text
    assert "3 objects" in text
    assert "\nlines " not in str(rj.explain(scene.nodes[0].mesh, CAMERA, size=SIZE))


@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_lines_have_no_back(cull):
    single = rj.Material("unlit", double_sided=False)
    lines = rj.Lines(helix(), width=3.0, material=single)
    frame = draw(lines, outputs=("face_id",), cull=cull, diagnose=True)
    assert frame.stats.drawn == 199
    found = frame.diagnostics
    assert found.culled == found.outside == found.clipped == 0
    assert found.visible + found.hidden + found.sub_pixel + found.degenerate == 199
    assert found.interpolation_error < 1e-6


def test_effects_see_lines_as_they_see_faces():
    scene = scene_with(shadow=True, glass=True)
    plain = draw(scene)
    scene.fog = rj.Fog(color="gray", density=0.2)
    scene.outline = rj.Outline()
    scene.ambient_occlusion = rj.AmbientOcclusion()
    scene.wireframe = rj.Wireframe()
    one = draw(scene, threads=2)
    assert (one.color != plain.color).any()
    assert one.color.tobytes() == draw(scene).color.tobytes()


def test_wireframes_draw_no_edges_of_lines():
    scene = rj.Scene()
    scene.add(rj.Lines(helix(), width=7.0))
    plain = draw(scene)
    scene.wireframe = rj.Wireframe("red")
    assert draw(scene).color.tobytes() == plain.color.tobytes()
    scene.add(rj.Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    color = draw(scene).color.astype(int)
    assert ((color[..., 0] > 200) & (color[..., 1] < 50)).any()


def test_a_scene_of_triangles_compiles_nothing_of_lines():
    mesh = rj.Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    lines = rj.Lines([[0.0, 0, 0], [1, 0, 0]])
    kernels = [
        {row.name for row in planning.list_kernels(rj.explain(what, size=SIZE))}
        for what in (mesh, lines)
    ]
    assert {name for name in kernels[1] - kernels[0] if "line" in name} == {
        "line_tessellation.project_segments", "line_tessellation.count_pieces",
        "line_tessellation.write_pieces",
    }  # fmt: skip
    assert not any("line_tessellation" in name for name in kernels[0])


class Displaced(rj.Lines):
    _depth_offset = (2.0, 1.0)


@pytest.mark.parametrize("is_parallel", [False, True])
def test_depths_are_those_of_another_place(is_parallel):
    lens = {"height": 3.0} if is_parallel else {"fov_y": 50.0}
    view = rj.OrthographicCamera if is_parallel else rj.PerspectiveCamera
    camera = view((0, 0, 3), (0, 0, 0), **lens)
    ends = np.array([[-1.0, 0.5, 0.8], [1.1, -0.4, -0.9]])
    plain, moved = (
        draw(kind(ends, width=8.0, caps="butt"), camera, outputs=("depth", "face_id"))
        for kind in (rj.Lines, Displaced)
    )
    np.testing.assert_array_equal(plain.face_id, moved.face_id)
    # What a line shows two pixels to the right and one below is what it shows there.
    there, here = plain.depth[1:, 2:], moved.depth[:-1, :-2]
    both = np.isfinite(there) & np.isfinite(here)
    assert both.sum() > 300
    np.testing.assert_allclose(here[both], there[both], rtol=2e-5)
    seen = plain.face_id >= 0
    assert (np.abs(moved.depth[seen] - plain.depth[seen]) > 1e-3).all()


def test_colors_are_those_of_another_place():
    ends, colors = (
        [[-1.0, 0.5, 0.8], [1.1, -0.4, -0.9]],
        [[1.0, 0.0, 0.2, 1.0], [0.0, 1.0, 0.7, 1.0]],
    )
    camera = rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), fov_y=50.0)
    plain, moved = (
        draw(
            kind(ends, width=8.0, caps="butt", colors=colors), camera, outputs=("color", "face_id")
        )
        for kind in (rj.Lines, Displaced)
    )
    np.testing.assert_array_equal(plain.face_id, moved.face_id)
    there, here = plain.color[1:, 2:].astype(int), moved.color[:-1, :-2].astype(int)
    # Not at the outline, which is mixed with the background.
    inside = plain.face_id >= 0
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= np.roll(plain.face_id >= 0, step, axis)
    both = inside[1:, 2:] & inside[:-1, :-2]
    assert both.sum() > 200
    assert np.abs(there - here)[both].max() <= 1
    assert np.abs(plain.color.astype(int) - moved.color)[inside].max() > 2


def test_depths_of_another_place_stay_before_the_eye_of_short_lines():
    ends = np.array([[0.0, 0.0, 2.0], [0.012, 0.0, -40.0]])
    camera = rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), fov_y=50.0)
    frame = draw(Displaced(ends, width=6.0), camera, outputs=("depth",))
    seen = frame.depth[np.isfinite(frame.depth)]
    assert len(seen) > 10
    assert (seen > 0.0).all()
