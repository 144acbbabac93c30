"""Buffers of the nearest face hold what plain arithmetic finds from its number and weights."""

from __future__ import annotations

import math
from fractions import Fraction

import naive
import naive_layers
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.fragments.fragment_bands import SAMPLE_POSITIONS
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.scene.material import SHADINGS

SIZE = (48, 36)
BUFFERS = (
    "distance", "object_position", "nocs", "geometric_normal", "material_id", "instance_id",
    "coverage", "normal_camera", "position_camera",
)  # fmt: skip
TRUTH = ("face_id", "object_id", "barycentric", "position", "depth")
T = rj.transforms


@pytest.fixture(scope="module")
def scene():
    """Two meshes, one three times: turned, stretched and mirrored; three materials, two equal."""
    rng = np.random.default_rng(4)
    shiny, diffuse = rj.Material("phong", "red"), rj.Material("flat", "blue", specular=0.0)
    spiky = np.array([[0, 0, 1], [0.8, 0.1, -0.5], [-0.7, 0.6, -0.4], [-0.2, -0.9, -0.6]])
    sides = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]
    rock = rj.Mesh(spiky + (3.0, 0.0, -1.0), sides, material=diffuse)
    sheet = rj.Mesh(rng.random((12, 3)), np.arange(12).reshape(4, 3), material=shiny)
    twin = rj.Mesh(spiky, sides, material=rj.Material("phong", "red"))
    found = rj.Scene()
    found.add(sheet, T.compose(T.translate((-1.0, -1.0, 0.5)), T.scale((2.0, 2.0, 0.2))))
    found.add(rock, T.translate((-3.5, 0.8, 1.2)))
    found.add(twin, T.translate((1.0, -0.7, 0.5)))
    found.add(rock, T.compose(T.translate((1.0, 0.6, 3.3)), T.rotate_y(90.0)))
    found.add(rock, T.compose(T.scale((-1.0, 0.5, 1.0)), T.translate((-2.0, -0.2, 1.0))))
    return found


CAMERAS = {
    "perspective": rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=0.5, far=30.0),
    "near plane through it": rj.PerspectiveCamera((0.6, 0.8, 2.6), (0, 0, 0), near=1.5),
    "parallel": rj.OrthographicCamera((1.0, 1.2, 4.5), (0, 0, 0), height=3.5, far=20.0),
}


@pytest.fixture(scope="module", params=list(CAMERAS))
def seen(scene, request):
    """A frame, with the camera and what is known of each pixel that shows a face."""
    camera = CAMERAS[request.param]
    frame = rj.render(scene, camera, size=SIZE, outputs=(*BUFFERS, *TRUTH))
    owners = [(n, face) for n, node in enumerate(scene.nodes) for face in node.mesh.faces]
    pixels = []
    for row, column in np.argwhere(frame.face_id >= 0).tolist():
        number, face = owners[frame.face_id[row, column]]
        weights = frame.barycentric[row, column].astype(float)
        pixels.append((row, column, scene.nodes[number], face, weights))
    assert len({id(pixel[2]) for pixel in pixels}) == len(scene.nodes)
    return frame, camera, pixels


def test_nothing_is_where_no_face_is(seen):
    frame, _, _ = seen
    empty = frame.face_id < 0
    assert empty.any()
    assert (frame.distance[empty] == np.inf).all()
    assert np.isnan(frame.object_position[empty]).all()
    assert np.isnan(frame.nocs[empty]).all()
    for name, value in (("geometric_normal", 0), ("material_id", -1), ("instance_id", -1)):
        assert (getattr(frame, name)[empty] == value).all()


def test_object_position_is_that_of_the_weights(seen):
    frame, _, pixels = seen
    for row, column, node, face, weights in pixels:
        want = weights @ node.mesh.vertices[face]
        np.testing.assert_allclose(frame.object_position[row, column], want, atol=2e-6)


def test_object_position_is_placed_where_the_position_is(seen):
    frame, _, pixels = seen
    for row, column, node, _, _ in pixels:
        model = frame.object_position[row, column].astype(float)
        want = T.apply(node.world_from_model, model)
        np.testing.assert_allclose(frame.position[row, column], want, atol=1e-5)


def test_nocs_is_the_place_in_the_box_of_unit_diagonal(seen):
    frame, _, pixels = seen
    for row, column, node, face, weights in pixels:
        used = node.mesh.vertices[np.unique(node.mesh.faces)]
        low, high = used.min(axis=0), used.max(axis=0)
        place = weights @ node.mesh.vertices[face]
        want = (place - (low + high) / 2.0) / math.dist(low, high) + 0.5
        np.testing.assert_allclose(frame.nocs[row, column], want, atol=2e-6)
        assert (frame.nocs[row, column] >= 0.0).all()
        assert (frame.nocs[row, column] <= 1.0).all()


def test_distance_is_the_length_of_the_ray(seen):
    frame, camera, pixels = seen
    forward = -np.array(camera.view_matrix())[2, :3]
    for row, column, node, face, weights in pixels:
        world = T.apply(node.world_from_model, weights @ node.mesh.vertices[face])
        way = world - camera.eye_position()
        parallel = isinstance(camera, rj.OrthographicCamera)
        want = way @ forward if parallel else np.linalg.norm(way)
        assert frame.distance[row, column] == pytest.approx(want, rel=1e-6)


def test_distance_of_parallel_rays_is_the_depth(scene):
    frame = rj.render(scene, CAMERAS["parallel"], size=SIZE, outputs=("distance", "depth"))
    np.testing.assert_allclose(frame.distance, frame.depth, rtol=1e-5)


def test_distance_and_depth_are_those_of_one_pixel_ray():
    # A wall across the axis: the depth is the same everywhere, the distance grows sideways.
    wall = rj.Mesh([[-50, -50, -2], [50, -50, -2], [0, 90, -2]], [[0, 1, 2]])
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=90.0)
    frame = rj.render(wall, camera, size=(5, 5), outputs=("distance", "depth"))
    x = (np.arange(5) + 0.5) / 2.5 - 1.0
    want = 2.0 * np.sqrt(1.0 + x**2 + x[:, np.newaxis] ** 2)
    np.testing.assert_allclose(frame.distance, want, rtol=1e-6)
    np.testing.assert_allclose(frame.depth, 2.0, rtol=1e-6)


def test_geometric_normal_is_that_of_the_plane_that_is_seen(seen):
    frame, camera, pixels = seen
    for row, column, node, face, weights in pixels:
        a, b, c = T.apply(node.world_from_model, node.mesh.vertices[face])
        normal = np.array(naive.unit(np.cross(b - a, c - a)))
        to_eye = camera.eye_position() - (weights[0] * a + weights[1] * b + weights[2] * c)
        if isinstance(camera, rj.OrthographicCamera):
            to_eye = np.array(camera.view_matrix())[2, :3]
        want = normal if normal @ to_eye >= 0.0 else -normal
        np.testing.assert_allclose(frame.geometric_normal[row, column], want, atol=2e-6)


# Camera space

SPACES = ("position", "position_camera", "normal", "normal_camera", "face_id", "depth")

VIEWS = {
    # As cameras of other programs may be: scaled and leaning.
    "scaled": np.diag([0.01, 0.01, 0.01, 1.0]),
    "tiny": np.diag([1e-200, 1e-200, 1e-200, 1.0]),
    "leaning": np.array([[1, 0.3, 0, 0.1], [0, 0.8, 0.2, 0], [0.1, 0, 1.5, 0], [0, 0, 0, 1.0]]),
}


def check_camera_space(frame, camera):
    """Compare with products of what is known in the world, one pixel after the other."""
    view, seen = camera.view_matrix(), frame.face_id >= 0
    assert seen.any()
    turn = np.linalg.inv(view[:3, :3]).T / np.abs(np.linalg.inv(view[:3, :3])).max()
    rounding = max(2e-6 * np.abs(view[:3]).max(), 1e-45)
    for point, found, normal, turned in zip(
        frame.position[seen], frame.position_camera[seen], frame.normal[seen],
        frame.normal_camera[seen], strict=True,
    ):  # fmt: skip
        want = view @ (*point.astype(float), 1.0)
        np.testing.assert_allclose(found, want[:3], rtol=1e-6, atol=rounding)
        np.testing.assert_allclose(turned, naive.unit(turn @ normal.astype(float)), atol=3e-7)
    assert np.isnan(frame.position_camera[~seen]).all()
    assert (frame.normal_camera[~seen] == 0.0).all()


@pytest.mark.parametrize("name", list(CAMERAS))
def test_camera_space_is_the_view_of_the_world(scene, name):
    camera = CAMERAS[name]
    frame = rj.render(scene, camera, size=SIZE, outputs=SPACES)
    check_camera_space(frame, camera)
    seen = frame.face_id >= 0
    # The camera looks along -z; the depth is that of vertices on the sub-pixel grid.
    np.testing.assert_allclose(-frame.position_camera[seen][:, 2], frame.depth[seen], rtol=5e-4)


@pytest.mark.parametrize("name", list(VIEWS))
def test_camera_space_of_any_view_matrix(scene, name):
    near = 0.1 * np.abs(VIEWS[name][:3, :3]).max()
    looking = rj.PerspectiveCamera((1.0, 1.2, 4.5), (0, 0, 0), near=near)
    view = T.compose(VIEWS[name], looking.view_matrix())
    camera = rj.MatrixCamera(view, looking.projection_matrix(SIZE))
    frame = rj.render(scene, camera, size=SIZE, outputs=SPACES)
    check_camera_space(frame, camera)
    lengths = np.linalg.norm(frame.normal_camera[frame.face_id >= 0], axis=1)
    np.testing.assert_allclose(lengths[lengths > 0.0], 1.0, rtol=2e-7)


def test_camera_space_has_x_right_y_up_and_looks_along_minus_z():
    # A wall that faces a camera on the x axis.
    wall = rj.Mesh([[-2, -5, 5], [-2, -5, -5], [-2, 5, -5], [-2, 5, 5]], [[0, 1, 2], [0, 2, 3]])
    camera = rj.PerspectiveCamera((2, 0, 0), (0, 0, 0), fov_y=90.0)
    frame = rj.render(wall, camera, size=(4, 4), outputs=SPACES)
    x = (np.arange(4) + 0.5) / 2.0 - 1.0
    right, up = np.meshgrid(4.0 * x, -4.0 * x)
    want = np.stack([right, up, np.full((4, 4), -4.0)], axis=2)
    np.testing.assert_allclose(frame.position_camera, want, rtol=1e-6)
    np.testing.assert_allclose(frame.normal_camera, np.full((4, 4, 3), (0, 0, 1)), atol=1e-7)


def test_camera_space_keeps_its_digits_far_from_the_origin(scene):
    near = CAMERAS["perspective"]
    here = rj.render(scene, near, size=SIZE, outputs=SPACES)
    away = np.array((2.0**23, -(2.0**22), 2.0**24))
    moved = rj.Scene()
    for node in scene.nodes:
        moved.add(node.mesh, T.compose(T.translate(away), node.world_from_model))
    camera = rj.PerspectiveCamera(away + near.eye, away + near.target, near=0.5, far=30.0)
    there = rj.render(moved, camera, size=SIZE, outputs=SPACES)
    same = (here.face_id == there.face_id) & (here.face_id >= 0)
    assert same.sum() > 0.9 * (here.face_id >= 0).sum()
    np.testing.assert_allclose(
        there.position_camera[same], here.position_camera[same], rtol=0, atol=1e-4
    )
    # In the world they are lost.
    assert np.abs(there.position[same] - away - here.position[same]).max() > 0.1


@pytest.mark.parametrize("samples", [4, 64])
def test_camera_space_is_that_of_the_centre_in_layers_regions_and_samples(scene, samples):
    camera, names = CAMERAS["perspective"], ("normal_camera", "position_camera")
    size, region = (96, 72), Region(0, 0, 64, 64)
    whole = rj.render(scene, camera, size=size, outputs=names).arrays()
    layers = rj.render_layers(scene, camera, k=2, size=size, outputs=names).arrays()
    with RegionRenderer(scene, camera, size=size, outputs=names) as renderer:
        part = renderer.render_region(region).arrays()
    quality = rj.Quality(samples=samples)
    fine = rj.render(scene, camera, size=size, quality=quality, outputs=(*names, "color")).arrays()
    for name in names:
        assert layers[name][0].tobytes() == whole[name].tobytes()
        assert part[name].tobytes() == whole[name][:64, :64].tobytes()
        assert fine[name].tobytes() == whole[name].tobytes()


@pytest.fixture
def shaded(sphere):
    """Return what makes a stretched, mirrored ball and loose faces, shaded in some way."""
    rng = np.random.default_rng(8)
    leaning = sphere.vertices + rng.normal(size=sphere.vertices.shape) * 0.2
    loose, directions = rng.random((12, 3)) * (4, 3, 0.1), rng.normal(size=(12, 3))
    stretched = T.compose(T.scale((-1.0, 0.6, 1.0)), T.translate((0.2, 0.1, 1.0)))

    def make(shading, gives_normals=True):
        scene, material = rj.Scene(), rj.Material(shading)
        for vertices, faces, normals, place in (
            (sphere.vertices, sphere.faces, leaning, stretched),
            (loose, np.arange(12).reshape(4, 3), directions, T.translate((-2.0, -1.5, 0.0))),
        ):
            own = {"normals": normals} if gives_normals else {}
            scene.add(rj.Mesh(vertices, faces, material=material, **own), place)
        return scene

    return make


NORMALS = ("normal", "geometric_normal", "face_id", "object_id", "barycentric")


@pytest.mark.parametrize("gives_normals", [True, False], ids=["given", "averaged"])
@pytest.mark.parametrize("shading", SHADINGS)
def test_normal_is_interpolated_whatever_the_shading(shading, gives_normals, shaded):
    camera = CAMERAS["perspective"]
    made = shaded(shading, gives_normals)
    frame = rj.render(made, camera, size=SIZE, outputs=NORMALS)
    faces = np.concatenate([node.mesh.faces for node in made.nodes])
    for row, column in np.argwhere(frame.face_id >= 0):
        node = made.nodes[frame.object_id[row, column]]
        corners = faces[frame.face_id[row, column]]
        weights = frame.barycentric[row, column].astype(float)
        normal = T.normal_matrix(node.world_from_model) @ (
            weights @ node.mesh.vertex_normals()[corners].astype(float)
        )
        found, side = frame.normal[row, column], frame.geometric_normal[row, column].astype(float)
        a, b, c = T.apply(node.world_from_model, node.mesh.vertices[corners])
        turn = np.linalg.det(node.world_from_model[:3, :3])
        is_front = turn * (np.cross(b - a, c - a) @ side) > 0.0
        want = np.array(naive.unit(normal)) * (1.0 if is_front else -1.0)
        np.testing.assert_allclose(found, want, atol=2e-5)
    # Interpolated is not the face's.
    seen = frame.face_id >= 0
    assert np.abs(frame.normal - frame.geometric_normal)[seen].max() > 0.05
    # All ways of shading say the same, to the last bit.
    wanted = rj.render(shaded("phong", gives_normals), camera, size=SIZE, outputs=NORMALS)
    assert frame.normal.tobytes() == wanted.normal.tobytes()


@pytest.mark.parametrize("shading", SHADINGS)
def test_normals_of_layers_and_regions_are_those_of_any_shading(shading, shaded):
    camera = CAMERAS["perspective"]
    scene, smooth = shaded(shading), shaded("phong")
    layers = [
        rj.render_layers(one, camera, k=2, size=SIZE, outputs=NORMALS) for one in (scene, smooth)
    ]
    assert (layers[0].face_id[1] >= 0).any()
    assert layers[0].normal.tobytes() == layers[1].normal.tobytes()
    size, region = (96, 72), Region(0, 0, 64, 64)
    whole = rj.render(smooth, camera, size=size, outputs=NORMALS).normal
    with RegionRenderer(scene, camera, size=size, outputs=NORMALS) as renderer:
        part = renderer.render_region(region).normal
    assert part.tobytes() == whole[:64, :64].tobytes()
    # Nor does it depend on what a quality makes of the shading.
    quality = rj.Quality(shading="face")
    coarse = rj.render(smooth, camera, size=size, quality=quality, outputs=NORMALS)
    assert coarse.normal.tobytes() == whole.tobytes()


@pytest.mark.parametrize("shading", SHADINGS)
def test_the_output_normal_changes_no_colour(shading, shaded):
    camera = CAMERAS["perspective"]
    scene = shaded(shading, True)
    scene.nodes[1].mesh.material = rj.Material("pbr")
    scene.lights = [rj.DirectionalLight((-1, -2, -2), shadow=rj.Shadow(size=256))]
    colors = ("color", "linear")
    alone, beside = (
        rj.render(scene, camera, size=SIZE, outputs=outputs)
        for outputs in (colors, (*colors, "normal"))
    )
    for name in colors:
        assert alone.arrays()[name].tobytes() == beside.arrays()[name].tobytes()


def test_normals_that_cancel_are_of_one_side_and_given_ones_of_no_length_are_of_faces():
    corners, up = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [0, 0, 1]
    camera = rj.OrthographicCamera((0, 0, 3), (0, 0, 0), height=3.0)
    material = rj.Material("unlit")
    both = rj.Mesh(corners, [[0, 1, 2], [0, 2, 1]], material=material)
    with pytest.warns(UserWarning, match="3 normals of length 0"):
        zero = rj.Mesh(corners, [[0, 1, 2]], normals=np.zeros((3, 3)), material=material)
    for mesh in (both, zero):
        frame = rj.render(mesh, camera, size=(9, 9), outputs=NORMALS)
        seen = frame.face_id >= 0
        assert seen.any()
        assert (frame.normal[seen] == up).all()
        assert (frame.geometric_normal[seen] == up).all()


def test_materials_are_numbered_as_first_used_and_equal_ones_are_one(seen):
    frame, _, _ = seen
    want = np.array([0, 1, 0, 1, 1, -1])[frame.object_id]
    assert (frame.material_id == want).all()
    assert frame.material_id.dtype == np.int32


def test_materials_that_differ_in_their_name_are_two(cube):
    scene = rj.Scene()
    for n in (0, 1, 2):
        material = rj.Material(name="ab"[n % 2])
        scene.add(rj.Mesh(cube.vertices, cube.faces, material=material), T.translate((3 * n, 0, 0)))
    frame = rj.render(scene, size=SIZE, outputs=("material_id", "object_id"))
    assert (frame.material_id == np.array([0, 1, 0, -1])[frame.object_id]).all()
    assert set(np.unique(frame.material_id)) == {-1, 0, 1}


def test_instances_of_one_mesh_are_counted(seen):
    frame, _, _ = seen
    want = np.array([0, 0, 0, 1, 2, -1])[frame.object_id]
    assert (frame.instance_id == want).all()
    assert frame.instance_id.dtype == np.int32


def test_nocs_of_a_vast_and_of_a_tiny_object_are_those_of_any_other(cube):
    found = []
    for size in (1.0, 1e-200, 1e-30, 1e30, 1e120):
        scene = rj.Scene()
        scene.add(rj.Mesh(cube.vertices * size, cube.faces), T.scale((1.0 / size,) * 3))
        camera = rj.PerspectiveCamera((2.5, 3.0, 4.0), (0, 0, 0))
        found.append(rj.render(scene, camera, size=(12, 9), outputs="nocs").nocs)
    # Half the side of the cube whose diagonal is 1.
    side = 0.5 / math.sqrt(3.0)
    inside = found[0][np.isfinite(found[0])]
    assert inside.max() == pytest.approx(0.5 + side, abs=1e-6)
    assert 0.5 - side <= inside.min() < 0.25
    for nocs in found[1:]:
        np.testing.assert_allclose(nocs, found[0], rtol=0, atol=1e-6)


# Coverage


def test_coverage_of_one_sample_is_whether_a_face_is_seen(seen):
    frame, _, _ = seen
    assert (frame.coverage == (frame.face_id >= 0)).all()


@pytest.mark.parametrize("samples", [2, 4, 8, 16])
def test_coverage_counts_the_samples_that_exact_arithmetic_covers(samples):
    size, rng = (16, 8), np.random.default_rng(5)
    triangles = [
        (np.round(rng.uniform(-2.0, 11.0, (3, 2)) * 64.0) / 64.0, (0.5, 0.25, -0.5))
        for _ in range(3)
    ]
    counts = np.zeros((size[1], size[0]), int)
    for x, y in SAMPLE_POSITIONS[samples]:
        place = Fraction(8 + x, 16), Fraction(8 + y, 16)
        covered = set()
        for points, _ in triangles:
            covered |= oracle.covered_pixels(points, size, sample=place)
        for column, row in covered:
            counts[row, column] += 1
    scene = naive_layers.scene_of(naive_layers.mesh_of(*one, size) for one in triangles)
    quality = rj.Quality(samples=samples)
    frame = rj.render(scene, naive_layers.CAMERA, size=size, outputs="coverage", quality=quality)
    assert (frame.coverage == counts / samples).all()
    assert np.count_nonzero((counts > 0) & (counts < samples)) > 5


@pytest.mark.parametrize("samples", [1, 4, 16, "area", 64])
def test_coverage_is_the_alpha_of_an_opaque_scene_before_nothing(scene, samples):
    frame = rj.render(
        scene, CAMERAS["perspective"], size=(24, 18), quality=rj.Quality(samples=samples),
        outputs=("linear", "coverage"), background="transparent",
    )  # fmt: skip
    np.testing.assert_allclose(frame.coverage, frame.linear[..., 3], rtol=0, atol=1e-6)
    partly = (frame.coverage > 0.0) & (frame.coverage < 1.0)
    assert partly.any() == (samples != 1)


def test_coverage_by_area_is_the_exact_area_of_a_triangle():
    size, points = (8, 8), np.array([(0.5, 0.25), (7.5, 1.75), (1.25, 6.5)])
    scene = naive_layers.scene_of([naive_layers.mesh_of(points, (0, 0, 0), size)])
    quality = rj.Quality(samples="area")
    frame = rj.render(scene, naive_layers.CAMERA, size=size, outputs="coverage", quality=quality)
    for row, column in np.ndindex(*frame.coverage.shape):
        want = float(oracle.pixel_area(points.tolist(), column, row))
        assert frame.coverage[row, column] == pytest.approx(want, abs=1e-6)


@pytest.mark.parametrize("samples", [1, 4, 64])
def test_what_is_seen_through_covers_as_well(scene, samples):
    clear = rj.Scene()
    for node in scene.nodes:
        mesh, glass = node.mesh, rj.Material(base_color=(1, 1, 1, 0.1), alpha_mode="blend")
        clear.add(rj.Mesh(mesh.vertices, mesh.faces, material=glass), node.world_from_model)
    options = {"size": (24, 18), "quality": rj.Quality(samples=samples), "outputs": "coverage"}
    want = rj.render(scene, CAMERAS["perspective"], **options).coverage
    assert (rj.render(clear, CAMERAS["perspective"], **options).coverage == want).all()


@pytest.mark.parametrize("samples", [1, 4, "area", 64])
def test_holes_are_not_covered(samples):
    # The left half of the square is a hole.
    square = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    alphas = np.array([[[1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, 1.0]]])
    material = rj.Material(
        "unlit", base_color_texture=rj.Texture(alphas, filter="nearest"), alpha_mode="mask"
    )
    mesh = rj.Mesh(square, [[0, 1, 2], [0, 2, 3]], uv=np.array(square)[:, :2] / 2 + 0.5,
                   material=material)  # fmt: skip
    camera = rj.OrthographicCamera((0, 0, 3), (0, 0, 0), height=2.0)
    quality = rj.Quality(samples=samples)
    frame = rj.render(mesh, camera, size=(8, 8), outputs="coverage", quality=quality)
    assert (frame.coverage[:, :4] == 0.0).all()
    np.testing.assert_allclose(frame.coverage[:, 4:], 1.0, rtol=0, atol=1e-6)


def test_refining_ends_with_the_coverage_of_the_best_quality(scene):
    size, camera = (12, 9), CAMERAS["perspective"]
    with rj.Renderer(size, quality=rj.Quality.reference(), threads=1) as renderer:
        frames = list(renderer.refine(scene, camera, outputs=("linear", "coverage")))
        alone = renderer.render(scene, camera, outputs="coverage")
    assert frames[-1].coverage.tobytes() == alone.coverage.tobytes()
    for frame in frames[2:]:
        steps = frame.coverage * frame.plan.pictures
        assert (steps == np.round(steps)).all()


def test_any_number_of_threads_gives_the_same_bits(scene):
    for samples in (1, 4, "area"):
        found = [
            rj.render(
                scene, CAMERAS["perspective"], size=(150, 130), outputs=BUFFERS, threads=threads,
                quality=rj.Quality(samples=samples),
            ).arrays()
            for threads in (1, 3)
        ]  # fmt: skip
        for name in BUFFERS:
            assert found[0][name].tobytes() == found[1][name].tobytes(), name


def test_all_buffers_are_saved(scene, tmp_path):
    frame = rj.render(scene, size=(8, 6), outputs=BUFFERS)
    frame.save(tmp_path / "frame.npz")
    with np.load(tmp_path / "frame.npz") as saved:
        assert set(saved.files) == set(BUFFERS)
        for name in BUFFERS:
            assert saved[name].tobytes() == getattr(frame, name).tobytes()
