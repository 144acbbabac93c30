"""BOP's renderer against formulas: whole pixels, planes and Lambert's law."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest
import trimesh

from rasterjit.compat import bop

WIDTH, HEIGHT = 24, 18
FX, FY, CX, CY = 30.0, 20.0, 11.3, 9.6
DISTANCE = 200.0
NO_TURN = np.eye(3)


def write(path, corners, **kwargs):
    """Write a quad through four corners as PLY, and return its path."""
    faces = [(0, 1, 2), (0, 2, 3)]
    trimesh.Trimesh(corners, faces, process=False, **kwargs).export(path, vertex_normal=True)
    return path


def quad_over(low, high, distance=DISTANCE):
    """Return corners that a camera of K sees at the pixel coordinates ``low`` to ``high``."""
    pixels = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return [((x - CX) / FX * distance, (y - CY) / FY * distance, distance) for x, y in pixels]


@pytest.mark.parametrize(("first", "options"), [(0.0, {}), (-0.5, {"pixel_center": 0.0})])
def test_principal_point_counts_from_the_corner_or_from_the_centre(tmp_path, first, options):
    # Pixel 5, 3 and no other: from its first side to its last in these coordinates.
    low = np.array([5.0, 3.0]) + first + 0.01
    path = write(tmp_path / "one.ply", quad_over(low, low + 0.98))
    renderer = bop.Renderer(WIDTH, HEIGHT, "depth", **options)
    renderer.add_object(7, path)
    depth = renderer.render_object(7, NO_TURN, np.zeros((3, 1)), FX, FY, CX, CY)["depth"]
    assert depth.dtype == np.float32
    assert np.argwhere(depth).tolist() == [[3, 5]]
    assert depth[3, 5] == pytest.approx(DISTANCE, rel=1e-6)
    # On a canvas, as the toolkit's scripts draw: the principal point moves by whole pixels.
    wide = bop.Renderer(3 * WIDTH, 3 * HEIGHT, "depth", **options)
    wide.add_object(7, path)
    depth = wide.render_object(7, NO_TURN, np.zeros(3), FX, FY, CX + WIDTH, CY + HEIGHT)["depth"]
    assert np.argwhere(depth).tolist() == [[3 + HEIGHT, 5 + WIDTH]]


@pytest.mark.parametrize("shading", ["phong", "flat"])
@pytest.mark.parametrize("is_back", [False, True])
def test_light_is_ambient_plus_lamberts(tmp_path, shading, is_back):
    corners = [(-900, -900, 0), (900, -900, 0), (900, 900, 0), (-900, 900, 0)]
    normals = [(0.0, 0.0, 1.0)] * 4
    path = write(tmp_path / "wall.ply", corners, vertex_normals=normals)
    renderer = bop.create_renderer(WIDTH, HEIGHT, "vispy", shading=shading)
    renderer.set_light_cam_pos((30.0, 50.0, -20.0))
    renderer.set_light_ambient_weight(0.25)
    color = np.array([1.0, 0.5, 0.2])
    renderer.add_object(1, path, surf_color=color)
    turn = NO_TURN if is_back else np.diag([1.0, -1.0, -1.0])  # The wall's z goes away, or nears.
    rgb = renderer.render_object(1, turn, (0, 0, DISTANCE), FX, FY, CX, CY)["rgb"]
    x = (np.arange(WIDTH) + 0.5 - CX) / FX * DISTANCE
    y = -(np.arange(HEIGHT)[:, None] + 0.5 - CY) / FY * DISTANCE
    to_light = np.stack(np.broadcast_arrays(30.0 - x, 50.0 - y, -20.0 + DISTANCE), axis=-1)
    cosine = to_light[..., 2] / np.linalg.norm(to_light, axis=-1)
    # Normals of vertices do not turn to the eye; those of faces are towards it.
    if is_back and shading == "phong":
        cosine = 0.0 * cosine
    expected = 255.0 * color * np.minimum(0.25 + cosine, 1.0)[..., None]
    assert np.abs(rgb - expected).max() <= 0.5 + 1e-2


def test_colours_are_codes_of_the_file(tmp_path):
    corners = quad_over((0, 0), (WIDTH, HEIGHT))
    codes = np.array([(200, 100, 50, 255)] * 4, np.uint8)
    plain = write(tmp_path / "plain.ply", corners)
    colored = write(tmp_path / "colored.ply", corners, vertex_colors=codes)
    textured = tmp_path / "textured.ply"
    iio.imwrite(tmp_path / "one.png", np.full((2, 2, 3), (30, 60, 90), np.uint8))
    rows = [f"{x} {y} {z} 0 0 -1 0.5 0.5" for x, y, z in corners]
    names = ("x", "y", "z", "nx", "ny", "nz", "texture_u", "texture_v")
    textured.write_text("\n".join([
        "ply", "format ascii 1.0", "comment TextureFile one.png", "element vertex 4",
        *(f"property float {name}" for name in names), "element face 2",
        "property list uchar int vertex_indices", "end_header", *rows, "3 0 1 2", "3 0 2 3", "",
    ]))  # fmt: skip
    renderer = bop.Renderer(WIDTH, HEIGHT, "rgb", bg_color=(0.2, 0.4, 0.6, 1.0))
    renderer.set_light_ambient_weight(1.0)
    for path, expected in ((plain, 128), (colored, (200, 100, 50)), (textured, (30, 60, 90))):
        renderer.add_object("one", path)
        drawn = renderer.render_object("one", NO_TURN, (0, 0, 0), FX, FY, CX, CY)
        assert drawn.keys() == {"rgb"}
        assert (drawn["rgb"] == np.broadcast_to(expected, 3)).all()
    away = renderer.render_object("one", NO_TURN, (0, 0, -2 * DISTANCE), FX, FY, CX, CY)["rgb"]
    assert (away == (51, 102, 153)).all()
    renderer.remove_object("one")
    with pytest.raises(ValueError, match=r"obj_id must be one .*\(no object\), got 'one'"):
        renderer.render_object("one", NO_TURN, (0, 0, 0), FX, FY, CX, CY)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0, 10), "width, height must"), ((10, 10, "color"), "mode must be one of"),
        ((10, 10, "rgb", "gouraud"), "shading must be one of"),
        ((10, 10, "rgb", "flat", (1, 2, 3)), "bg_color must be 3 or 4 codes from 0 to 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(arguments, said):
    with pytest.raises(ValueError, match=said):
        bop.Renderer(*arguments)


def test_wrong_poses_lights_and_types_are_named(tmp_path):
    renderer = bop.Renderer(WIDTH, HEIGHT)
    renderer.add_object(1, write(tmp_path / "one.ply", quad_over((0, 0), (9, 9))))
    for R, t, fx, said in (
        (2.0 * NO_TURN, (0, 0, 0), FX, "rotation must hold a rotation"),
        (NO_TURN, (0, 0), FX, "translation must"), (NO_TURN, (0, 0, 0), 0.0, "focal lengths"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            renderer.render_object(1, R, t, fx, FY, CX, CY)
    for call, value, said in (
        (renderer.set_light_cam_pos, (1, 2), "light_cam_pos must"),
        (renderer.set_light_ambient_weight, 2.0, "light_ambient_weight must"),
        (lambda one: bop.create_renderer(8, 8, one), "htt", "renderer_type must be one of"),
        (lambda one: renderer.add_object(1, one), tmp_path / "none.ply", "none.ply"),
    ):
        with pytest.raises(ValueError, match=said):
            call(value)
