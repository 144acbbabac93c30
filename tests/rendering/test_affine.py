"""Affine interpolation: linear on the screen, against fractions, for every attribute."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.surface import uv_derivatives
from rasterjit.pipeline.surface.sample_block import UV_ROWS
from rasterjit.pipeline.surface.texture_lookup import RIGHT_U, U
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads
from rasterjit.scene import transforms

AFFINE = rj.Quality(interpolation="affine")
SIZE = (64, 64)


def dyadic(rng, count):
    return np.round(rng.uniform(-40, 104, (count, 2)) * 256) / 256


def test_weights_are_edge_functions_over_their_sum():
    rng, checked = np.random.default_rng(1), 0
    for _ in range(12):
        points, w = dyadic(rng, 3), 2.0 ** rng.integers(-3, 6, 3)
        positions = naive.clip_from_screen(points, SIZE, 0.0, w)
        seen = rj.rasterize(positions, [[0, 1, 2]], SIZE, quality=AFFINE, threads=1)
        corners = oracle.snap_triangle(points.tolist())
        for row, column in np.argwhere(seen.face_id == 0)[::37].tolist():
            exact = oracle.affine_weights(corners, naive.centre(column, row))
            for have, want in zip(seen.barycentric[row, column], exact, strict=True):
                assert abs(Fraction(float(have)) - want) <= Fraction(float(np.spacing(have)))
                checked += 1
    assert checked > 200


def slanted(**options):
    """Return a square that leans away from the camera, far wider in depth than on the screen."""
    options.setdefault("colors", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]])
    look = {"shading": "phong", "base_color": "white", **options.pop("look", {})}
    return rj.Mesh(
        [[-1.5, -1, 1.5], [1.5, -1, 1.5], [1.5, 1.2, -9], [-1.5, 1.2, -9]],
        [[0, 1, 2], [0, 2, 3]], uv=[[0, 0], [1, 0], [1, 1], [0, 1]],
        normals=[[0, 1, 0.1], [0.3, 1, 0], [0, 1, 1], [-0.5, 1, 0]],
        material=rj.Material(**look),
        **options,
    )  # fmt: skip


CAMERA = rj.PerspectiveCamera((0, 0.4, 4), (0, 0, 0), near=0.5, far=50.0)
OUTPUTS = ("uv", "position", "normal", "linear", "barycentric", "face_id", "depth")


def shown(quality, mesh=None, outputs=OUTPUTS, **options):
    return rj.render(
        slanted() if mesh is None else mesh, CAMERA, size=SIZE, outputs=outputs, quality=quality,
        threads=1, **options,
    )  # fmt: skip


def linear_misfit(values, weights):
    """Return how far the values of one face are from linear ones over the screen."""
    rows, columns = np.nonzero(weights)
    system = np.stack([rows, columns, np.ones(len(rows))], axis=1)
    found, *_ = np.linalg.lstsq(system, values[weights].astype(float), rcond=None)
    return np.abs(system @ found - values[weights]).max()


def test_uv_and_positions_are_linear_on_the_screen_and_depth_is_as_ever():
    affine, standard = shown(AFFINE), shown(rj.Quality())
    assert (affine.face_id == standard.face_id).all()
    assert (affine.depth == standard.depth)[affine.face_id >= 0].all()
    for face in (0, 1):
        mask = affine.face_id == face
        assert mask.sum() > 100
        for name, error in (("uv", 1e-6), ("position", 1e-5), ("barycentric", 1e-6)):
            assert linear_misfit(getattr(affine, name), mask) < error, name
            assert linear_misfit(getattr(standard, name), mask) > 0.05, name


def test_every_attribute_is_mixed_by_the_same_weights():
    look = {"shading": "unlit"}
    frame, smooth = shown(AFFINE, slanted(look=look)), shown(AFFINE, outputs=("normal",))
    mesh = slanted(look=look)
    colors, normals = mesh.vertex_colors, mesh.vertex_normals()
    for row, column in np.argwhere(frame.face_id >= 0)[::17].tolist():
        corners = mesh.faces[frame.face_id[row, column]]
        weights = frame.barycentric[row, column].astype(float)
        assert frame.uv[row, column] == pytest.approx(weights @ mesh.uv[corners], abs=1e-6)
        mixed = weights @ mesh.vertices[corners]
        assert frame.position[row, column] == pytest.approx(mixed, abs=1e-5)
        linear = weights @ colors[corners]
        assert frame.linear[row, column] == pytest.approx(linear, abs=1e-6)
        turned = weights @ normals[corners]
        turned /= np.sqrt((turned * turned).sum())
        assert smooth.normal[row, column] == pytest.approx(turned, abs=1e-5)


@pytest.mark.parametrize("samples", [1, 4, "area"])
def test_small_faces_have_the_weights_of_large_ones(samples):
    """Runs of one face and stretches of many go two ways; each is mixed by the exact weights."""
    cells = 12
    ticks = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(ticks, ticks))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate(
        [first[:, None] + [0, 1, cells + 2], first[:, None] + [0, cells + 2, cells + 1]]
    )
    vertices = np.stack([1.5 * x, y, -4.0 * y + x], axis=1)
    rng = np.random.default_rng(2)
    for some in (faces, faces[::7]):
        mesh = rj.Mesh(vertices, some, colors=rng.uniform(0, 1, (len(vertices), 3)),
                       material=rj.Material("unlit", "white"))  # fmt: skip
        quality = rj.Quality(interpolation="affine", samples=samples)
        frame = shown(quality, mesh, ("linear", "barycentric", "face_id"))
        seen = frame.face_id >= 0
        corners = mesh.vertex_colors[mesh.faces[frame.face_id[seen]]]
        want = (frame.barycentric[seen][:, :, None] * corners).sum(axis=1)
        off = np.abs(frame.linear[seen] - want).max(axis=1)
        if samples == 1:
            assert off.max() < 2e-6
        else:
            # Pixels that one face fills are shaded at their centres.
            assert np.quantile(off, 0.3) < 2e-6


def test_faces_at_one_distance_look_as_ever():
    flat = rj.Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]],
                   uv=[[0, 0], [1, 0], [1, 1], [0, 1]])  # fmt: skip
    camera = rj.PerspectiveCamera((0.3, 0.2, 4), (0.3, 0.2, 0), near=0.5, far=50.0)
    frames = [
        rj.render(flat, camera, size=SIZE, outputs=("uv", "face_id"), quality=one, threads=1)
        for one in (AFFINE, rj.Quality())
    ]
    seen = frames[0].face_id >= 0
    assert frames[0].uv[seen] == pytest.approx(frames[1].uv[seen], abs=3e-7)


def test_faces_that_were_clipped_keep_perspective_weights():
    near = rj.PerspectiveCamera((0, 0.4, 1.2), (0, 0, -1), near=0.5, far=50.0)
    frames = [
        rj.render(
            slanted(), near, size=SIZE, outputs=("uv", "linear", "face_id"), quality=one, threads=1
        )
        for one in (AFFINE, rj.Quality())
    ]
    assert frames[0].stats.clipped == 2
    for name in ("uv", "linear", "face_id"):
        one, other = (getattr(frame, name) for frame in frames)
        assert one.tobytes() == other.tobytes()


def checkered(filter, anisotropy=1):
    board = (np.indices((64, 64)) // 4).sum(axis=0) % 2
    image = np.repeat(board[:, :, None], 3, axis=2).astype(float)
    return rj.Texture(image, filter=filter, anisotropy=anisotropy, color_space="linear")


def test_a_textured_square_bends_along_its_diagonal():
    """What is seen of a face does not change, but where the texture lies on it."""
    look = {"shading": "unlit", "base_color_texture": checkered("nearest")}
    mesh = slanted(colors=None, look=look)
    affine, standard = (shown(one, mesh, ("linear", "uv", "face_id")) for one in (AFFINE, None))
    seen = affine.face_id >= 0
    # Each shows the texel that its own coordinates name.
    for frame in (affine, standard):
        u, v = frame.uv[seen].T
        texel = (np.floor(u * 16) + np.floor((1.0 - v) * 16)) % 2
        inside = (np.abs(u * 16 % 1 - 0.5) < 0.49) & (np.abs(v * 16 % 1 - 0.5) < 0.49)
        assert (frame.linear[seen][inside, 0] == texel[inside]).all()
    assert (affine.linear != standard.linear)[seen].any(axis=1).mean() > 0.2


@pytest.mark.parametrize("anisotropy", [1, 8])
def test_mip_levels_follow_the_steps_of_the_affine_coordinates(anisotropy):
    """A board whose squares shrink below a pixel turns grey, and is sharp where they are wide."""
    look = {"shading": "unlit", "base_color_texture": checkered("trilinear", anisotropy)}
    coordinates = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    for scale, is_grey in ((0.25, False), (256.0, True)):
        frame = shown(AFFINE, tiled(coordinates * scale, look), ("linear", "face_id"))
        red = frame.linear[..., 0][frame.face_id >= 0]
        if is_grey:
            assert red == pytest.approx(0.5, abs=0.02)
        else:
            assert np.quantile(red, 0.9) > 0.95
            assert np.quantile(red, 0.1) < 0.05


def tiled(uv, look):
    mesh = slanted(colors=None, look=look)
    return rj.Mesh(mesh.vertices, mesh.faces, uv=uv, material=mesh.material)


def test_steps_are_the_differences_of_neighbouring_coordinates():
    rng = np.random.default_rng(3)
    points = np.array([[3.0, 5.0], [60.0, 11.0], [22.0, 58.0]])
    positions = naive.clip_from_screen(points, SIZE, 0.0, [1.0, 4.0, 16.0])
    viewport, workers = make_viewport(SIZE, 8), threads.Workers(1)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    geometry = visibility_pass.make_geometry(
        np.array([[0, 1, 2]], np.int32), screen, positions, viewport, True
    )
    assert len(geometry.w) == 0
    uv = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
    places = np.zeros((UV_ROWS, 4))
    corners = np.uintp(0), np.uintp(1), np.uintp(2)
    found = np.empty((3, 2))
    for n, (column, row) in enumerate(((25, 20), (26, 20), (25, 21))):
        weights = barycentric.compute_sample_weights(*corners, column, row, geometry)
        found[n] = np.array(weights) @ uv.astype(float)
    places[U : U + 2, 0] = found[0]
    corner_places, corner_points = (
        uv.reshape(6, 1),
        np.ascontiguousarray(geometry.xy[:3]).reshape(6, 1),
    )
    uv_derivatives.write_mixed_uv_steps(
        *places[RIGHT_U : RIGHT_U + 4, :1], *places[U : U + 2, :1], *corner_places, *corner_points,
        *np.ones((3, 1)), *np.int32([[25], [20]]), viewport.grid_bits, 1.0, True,
    )  # fmt: skip
    want = np.concatenate([found[1] - found[0], found[2] - found[0]])
    assert places[RIGHT_U : RIGHT_U + 4, 0] == pytest.approx(want, abs=1e-12)


def test_holes_lie_where_the_affine_alpha_says():
    """A mask by vertex alphas: cut along the line where the affine mean is half."""
    colors = [[1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1]]
    look = {"shading": "unlit", "alpha_mode": "mask", "alpha_cutoff": 0.5}
    for quality, differs in ((AFFINE, True), (rj.Quality(), False)):
        frame = shown(quality, slanted(colors=colors, look=look), ("face_id", "uv"))
        whole = shown(AFFINE, slanted(look={"shading": "unlit"}), ("face_id", "uv"))
        v = whole.uv[..., 1]
        want = (whole.face_id >= 0) & (v >= 0.5)
        assert ((frame.face_id >= 0) != want).any() != differs
        assert (frame.face_id >= 0).sum() > 50


def test_a_pixel_is_explained_with_its_affine_weights():
    told = rj.explain_pixel(slanted(), CAMERA, SIZE, 32, 34, quality=AFFINE).faces[0]
    frame = shown(AFFINE)
    assert told.weights == told.affine_weights
    assert frame.barycentric[34, 32] == pytest.approx([float(w) for w in told.weights], abs=1e-6)


def test_the_plan_names_affine_interpolation():
    assert "interpolation            affine" in str(rj.explain(slanted(), CAMERA, AFFINE))
    assert "interpolation" not in str(rj.explain(slanted(), CAMERA))


def test_every_effect_renders_with_affine_weights():
    scene = rj.Scene()
    scene.add(slanted())
    scene.add(slanted(look={"base_color": (0.2, 0.4, 0.9, 0.5), "alpha_mode": "blend"}),
              transforms.translate((0.2, 0.5, 0.3)))  # fmt: skip
    scene.lights = [rj.AmbientLight(intensity=0.3),
                    rj.DirectionalLight((-1, -3, -1), shadow=rj.Shadow(64))]  # fmt: skip
    scene.ambient_occlusion, scene.outline = rj.AmbientOcclusion(radius=0.5), rj.Outline()
    scene.wireframe = rj.Wireframe("black")
    for samples in (1, 4):
        frames = []
        for way in ("affine", "perspective"):
            quality = rj.Quality(interpolation=way, samples=samples)
            frames.append(rj.render(scene, CAMERA, size=SIZE, quality=quality))
        off = np.abs(frames[0].color.astype(int) - frames[1].color.astype(int)).max(axis=2)
        assert 0.02 < (off > 4).mean() < 0.6
