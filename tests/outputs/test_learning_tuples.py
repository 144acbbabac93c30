"""Frames as PyTorch3D and nvdiffrast return them: by the formulas of their documentation."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.visibility.visibility_pass import Region
from rasterjit.rendering.regions import RegionRenderer

OUTPUTS = "face_id", "barycentric", "depth"
SIZES = (48, 36), (30, 44)
FINE = rj.Quality(subpixel_bits=12)
"""Corners are snapped to less than what the tests allow."""
EYE = {"eye": (2.0, 1.5, 4.0), "target": (0.2, 0.0, 0.0)}


@pytest.fixture
def cubes(cube):
    """Two cubes, of which one is turned, stretched and partly hidden."""
    scene = rj.Scene()
    scene.add(cube, rj.transforms.rotate_y(20.0))
    place = rj.transforms.translate((1.2, 0.3, -0.5)) @ rj.transforms.scale((0.9, 1.5, 0.6))
    scene.add(cube, place @ rj.transforms.rotate_x(30.0))
    return scene


def world_triangles(scene):
    """Return the corners of all faces in order, (F, 3, 3)."""
    parts = []
    for node in scene.nodes:
        homogeneous = np.column_stack([node.mesh.vertices, np.ones(len(node.mesh.vertices))])
        parts.append((homogeneous @ node.world_matrix.T)[:, :3][node.mesh.faces])
    return np.concatenate(parts)


def segment_distance(point, start, end):
    along = np.clip(
        ((point - start) * (end - start)).sum(1) / ((end - start) ** 2).sum(1), 0.0, 1.0
    )
    return np.hypot(*(point - start - along[:, None] * (end - start)).T)


@pytest.mark.parametrize("size", SIZES)
def test_fragments_hold_for_the_camera_of_pytorch3d(cubes, size):
    camera = rj.PerspectiveCamera(**EYE, fov_y=40.0)
    frame = rj.render(cubes, camera, size=size, outputs=OUTPUTS, quality=FINE)
    fragments = frame.to_pytorch3d(cubes)
    (width, height), seen = size, frame.face_id >= 0
    assert [array.shape for array in fragments] == [
        (1, height, width, 1), (1, height, width, 1), (1, height, width, 1, 3),
        (1, height, width, 1),
    ]  # fmt: skip
    assert [array.dtype for array in fragments] == ["int64", "float32", "float32", "float32"]
    assert 300 < seen.sum() < seen.size
    assert all((array[0, :, :, 0][~seen] == -1).all() for array in fragments)
    face, z, weights, dists = (array[0, :, :, 0][seen] for array in fragments)
    # Project by PyTorch3D's formula: rows of points times R, plus T; x left, y up, z forward.
    theirs = rj.cameras.to_pytorch3d(camera, size)
    view = world_triangles(cubes)[face] @ theirs.R + theirs.T
    ndc = view[..., :2] * theirs.focal_length / view[..., 2:] + theirs.principal_point
    # The centres of pixels: the shorter side goes from 1 to -1.
    rows, columns = seen.nonzero()
    centres = np.column_stack([width - 2 * columns - 1, height - 2 * rows - 1]) / min(size)
    np.testing.assert_allclose((weights * view[..., 2]).sum(1), z, rtol=1e-5)
    mixed = (weights[..., None] * view[..., 2:] * ndc).sum(1) / z[:, None]
    np.testing.assert_allclose(mixed, centres, atol=1e-5)
    edges = [segment_distance(centres, ndc[:, n], ndc[:, n - 1]) for n in range(3)]
    np.testing.assert_allclose(dists, -(np.min(edges, axis=0) ** 2), rtol=1e-4, atol=1e-9)
    assert (dists <= 0.0).all()
    assert frame.to_pytorch3d().dists is None


def test_dists_of_a_face_that_begins_behind_the_eye_are_those_of_its_visible_edges():
    mesh = rj.Mesh([(-1.0, 0.0, 9.0), (1.0, 0.0, 9.0), (0.3, 0.2, -9.0)], [(0, 1, 2)])
    camera = rj.PerspectiveCamera(eye=(0.0, 1.0, 4.0), target=(0.0, 0.0, 0.0), fov_y=60.0)
    frame = rj.render(mesh, camera, size=(40, 40), outputs=OUTPUTS)
    seen = frame.face_id >= 0
    assert seen.sum() > 50
    # The corner before the eye, and a point of each edge that is there, too, are of their lines.
    corners = mesh.vertices.astype(float)
    tip = camera.project(corners[2], (40, 40)).pixels
    sides = [camera.project(0.9 * corners[2] + 0.1 * corner, (40, 40)).pixels for corner in corners]
    rows, columns = seen.nonzero()
    pixels = np.column_stack([columns, rows]) + 0.5
    found = []
    for side in sides[:2]:
        x, y = (side - tip) / np.hypot(*(side - tip))
        found.append(np.abs((pixels - tip) @ (y, -x)) / 20.0)
    dists = frame.to_pytorch3d(mesh).dists[0, :, :, 0][seen]
    np.testing.assert_allclose(dists, -(np.min(found, axis=0) ** 2), rtol=1e-4, atol=1e-9)


def test_layers_are_faces_per_pixel(cubes):
    camera = rj.OrthographicCamera(**EYE, height=3.0)
    layers = rj.render_layers(cubes, camera, k=3, size=(30, 20), outputs=OUTPUTS)
    fragments, first = (
        layers.to_pytorch3d(cubes),
        rj.render(cubes, camera, size=(30, 20), outputs=OUTPUTS).to_pytorch3d(cubes),
    )
    assert [array.shape[:4] for array in fragments] == [(1, 20, 30, 3)] * 4
    for array, other in zip(fragments, first, strict=True):
        assert (array[:, :, :, :1] == other).all()
    z = np.where(fragments.pix_to_face < 0, np.inf, fragments.zbuf)[0]
    assert (z[..., 0] <= z[..., 1]).all()
    assert (fragments.pix_to_face[..., 2] >= 0).any()
    assert layers.to_nvdiffrast().shape == (3, 20, 30, 4)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "camera",
    [
        rj.PerspectiveCamera(**EYE, fov_y=40.0, near=0.5, far=20.0),
        rj.PerspectiveCamera(**EYE, fov_y=40.0),
        rj.OrthographicCamera(**EYE, height=3.0, near=0.1, far=9.0),
    ],
    ids=["perspective", "without planes", "orthographic"],
)
def test_pixels_of_nvdiffrast_are_those_of_its_formula(cubes, camera, size):
    frame = rj.render(cubes, camera, size=size, outputs=OUTPUTS, quality=FINE)
    found = frame.to_nvdiffrast()
    width, height = size
    assert (found.shape, found.dtype) == ((height, width, 4), np.float32)
    assert found.flags.c_contiguous
    assert (found[..., 3] == frame.face_id[::-1] + 1).all()
    seen = found[..., 3] > 0
    assert not found[~seen].any()
    # Weights and z/w of homogeneous corners, at the centre of a pixel counted from the lower left.
    planned = frame.plan.camera
    clip_from_world = planned.projection_matrix(size) @ planned.view_matrix()
    triangles = world_triangles(cubes)[found[seen][:, 3].astype(int) - 1]
    corners = np.concatenate([triangles, np.ones((*triangles.shape[:2], 1))], 2) @ clip_from_world.T
    rows, columns = seen.nonzero()
    x, y = (2 * columns + 1) / width - 1, (2 * rows + 1) / height - 1
    at = corners[..., :2] - np.stack([x, y], 1)[:, None] * corners[..., 3:]
    (x1, y1), (x2, y2) = (np.moveaxis(np.roll(at, -n, axis=1), 2, 0) for n in (1, 2))
    areas = x1 * y2 - y1 * x2
    weights = areas / areas.sum(1, keepdims=True)
    *_, z, w = np.einsum("nc,ncd->nd", weights, corners).T
    np.testing.assert_allclose(found[seen][:, :2], weights[:, :2], atol=5e-5)
    np.testing.assert_allclose(found[seen][:, 2], z / w, atol=5e-5)


def test_large_numbers_have_the_code_of_nvdiffrast(cube):
    frame = rj.render(cube, size=(4, 1), outputs=OUTPUTS)
    numbers = (1 << 24) + np.array([[-2, -1, 0, 12345]], np.int32)
    arrays = frame.arrays() | {"face_id": numbers, "depth": np.full((1, 4), 2.0, np.float32)}
    found = rj.Frame(arrays, frame.plan, frame.stats).to_nvdiffrast()[..., 3]
    assert found[0, :2].tolist() == [(1 << 24) - 1, 1 << 24]
    assert (found.view(np.int32)[0, 2:] - 0x4A800000).tolist() == (numbers[0, 2:] + 1).tolist()


@pytest.mark.parametrize("name", ["to_pytorch3d", "to_nvdiffrast"])
def test_what_no_triangles_or_outputs_give_is_refused(cube, name):
    frame = rj.render(cube, size=(8, 6), outputs=("face_id", "color"))
    message = (
        rf"^{name} needs .*; barycentric and depth were not rendered.*'barycentric', 'depth'\)"
    )
    with pytest.raises(ValueError, match=message):
        getattr(frame, name)()
    points = rj.render(rj.Points(np.eye(3)), size=(8, 6), outputs=OUTPUTS)
    with pytest.raises(ValueError, match=f"^{name} needs .* got one with points or lines"):
        getattr(points, name)()
    scene = rj.Scene()
    scene.add(cube)
    scene.section = rj.SectionPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    cut = rj.render(scene, rj.PerspectiveCamera(eye=(0.0, 0.0, 4.0), target=(0.0, 0.0, 0.0)),
                    size=(8, 6), outputs=OUTPUTS)  # fmt: skip
    with pytest.raises(ValueError, match=f"^{name} needs .* got one with caps of a section"):
        getattr(cut, name)()


def test_another_scene_and_a_lens_are_refused(cube):
    frame, two = rj.render(cube, size=(8, 6), outputs=OUTPUTS), rj.Scene()
    two.add(cube)
    two.add(cube)
    with pytest.raises(
        ValueError, match=r"what must be the scene that was drawn.*\[12\].*\[12, 12"
    ):
        frame.to_pytorch3d(two)
    lens = rj.PinholeDistortion(k1=0.1)
    bent = rj.render(cube, size=(8, 6), outputs=OUTPUTS, lens=lens)
    assert bent.to_pytorch3d().dists is None
    with pytest.raises(ValueError, match="dists needs a frame without a lens, got one with"):
        bent.to_pytorch3d(cube)
    with pytest.raises(ValueError, match="to_nvdiffrast needs a frame without a lens"):
        bent.to_nvdiffrast()


def test_a_part_of_a_picture_has_the_tuples_of_the_whole(cubes):
    options = {"size": (150, 100), "outputs": OUTPUTS}
    camera = rj.PerspectiveCamera(**EYE, fov_y=40.0)
    whole = rj.render(cubes, camera, **options)
    with RegionRenderer(cubes, camera, **options) as renderer:
        part = renderer.render_region(Region(64, 64, 40, 30))
    for array, other in zip(part.to_pytorch3d(cubes), whole.to_pytorch3d(cubes), strict=True):
        assert (array == other[:, 64:94, 64:104]).all()
    assert (part.to_nvdiffrast() == whole.to_nvdiffrast()[6:36, 64:104]).all()
