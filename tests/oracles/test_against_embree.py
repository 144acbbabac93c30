"""
Laws of visibility against a ray tracer: Embree's first hit of the ray through a pixel's centre.

The rays are made here from what the camera was asked for, not from RasterJIT's matrices. Embree
computes in float32; RasterJIT rounds vertices to its sub-pixel grid, so it shows the point of a
face that an exact camera sees up to half a grid step beside the pixel's centre. Both tolerances
follow from that, pixel by pixel; there is no other.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from opengl import skip_or_fail

import rasterjit as rj

MODELS = Path(__file__).parents[2] / "models"
SIZE = (400, 300)
SAMPLES = 2000
"""Random pixels for each scene and camera."""
NEAR_EDGE = 1.0 / 128.0
"""Pixels this near to an edge of the face that either side shows are left to chance, pixels."""
FLOAT32_LOSS = 1e-5
"""Relative error of what Embree computes, in distances of about 1 from the eye."""
VERTEX_LOSS = 1e-6
"""Error of the difference of two float32 vertices, in scenes of size 1."""


class View(NamedTuple):
    """A camera by its frame: the ray of a pixel follows without any matrix."""

    eye: NDArray[np.float64]
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    forward: NDArray[np.float64]
    half_height: float  # of the picture: at distance 1 for a perspective, else in scene units
    is_perspective: bool

    def rays(self, xy):
        """Return origins and directions (N, 3) through screen points (N, 2), y down, pixels."""
        width, height = SIZE
        across = (2.0 * xy[:, :1] - width) / height * self.half_height
        upward = (height - 2.0 * xy[:, 1:]) / height * self.half_height
        offset = across * self.right + upward * self.up
        if self.is_perspective:
            return np.broadcast_to(self.eye, offset.shape), self.forward + offset
        return self.eye + offset, np.broadcast_to(self.forward, offset.shape)

    def project(self, points):
        """Return the screen positions (..., 2) of points (..., 3), y down, pixels."""
        width, height = SIZE
        offset = points - self.eye
        scale = self.half_height * np.ones(offset.shape[:-1])
        if self.is_perspective:
            scale = self.half_height * (offset @ self.forward)
        x = (offset @ self.right) / scale * height / 2.0 + width / 2.0
        y = height / 2.0 - (offset @ self.up) / scale * height / 2.0
        return np.stack([x, y], axis=-1)


def make_view(camera) -> View:
    eye, target, up = (np.array(v) for v in (camera.eye, camera.target, camera.up))
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    is_perspective = isinstance(camera, rj.PerspectiveCamera)
    half = np.tan(np.radians(camera.fov_y / 2.0)) if is_perspective else camera.height / 2.0
    return View(eye, right, np.cross(right, forward), forward, float(half), is_perspective)


# The scenes, about 1 in size, and their triangles in world space


def flat(mesh) -> rj.Mesh:
    """Return the mesh shaded by face, without normals, on float32 vertices as Embree has them."""
    vertices = mesh.vertices.astype(np.float32)
    return rj.Mesh(vertices, mesh.faces, material=rj.Material("flat"))


def unit_model(name, scene, transform=None):
    """Add a model to a scene, scaled to a box of size 1 around the origin, then transformed."""
    mesh = flat(rj.load(MODELS / name).nodes[0].mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    fit = rj.transforms.compose(
        rj.transforms.scale(1.0 / (high - low).max()), rj.transforms.translate(-(low + high) / 2.0)
    )
    scene.add(mesh, fit if transform is None else rj.transforms.compose(transform, fit))


@functools.cache
def make_scene(name) -> rj.Scene:
    scene, t = rj.Scene(), rj.transforms
    if name == "teapot":
        unit_model("teapot.obj", scene)
    elif name == "torus knot":
        unit_model("torus_knot.obj", scene)
    else:
        # Two instances of one mesh, one of them mirrored and stretched, and a cube through both.
        unit_model("torus_knot.obj", scene, t.compose(t.translate((-0.4, 0, 0)), t.rotate_y(30.0)))
        knot = scene.nodes[0]
        mirror = t.compose(t.translate((0.3, 0.1, 0)), t.scale((-0.8, 1.2, 0.6)), t.rotate_z(40.0))
        scene.add(knot.mesh, t.compose(mirror, knot.world_from_model))
        turn = t.compose(t.rotate((1, 2, 3), 50.0), t.scale(0.6))
        unit_model("cube.ply", scene, turn)
    return scene


@functools.cache
def world_triangles(name) -> NDArray[np.float64]:
    """Return the corners of all faces of a scene, (F, 3, 3), numbered as in a frame."""
    corners = []
    for node in make_scene(name).nodes:
        matrix = np.array(node.world_from_model)
        points = node.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        corners.append(points[node.mesh.faces])
    return np.concatenate(corners)


CAMERAS = {
    "perspective": rj.PerspectiveCamera((0.7, 0.9, 1.3), (0.0, 0.0, 0.0), fov_y=24.0, near=0.01),
    "wide": rj.PerspectiveCamera((-0.2, 0.4, 0.6), (0.0, 0.0, 0.0), fov_y=75.0, near=0.01),
    "orthographic": rj.OrthographicCamera((0.5, -0.6, 1.5), (0.0, 0.0, 0.0), height=0.9, far=9.0),
}


# What Embree and exact planes say


def trace(name, origins, directions):
    """Return Embree's first hits: its dictionary of primID, tfar, u, v and Ng."""
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh
    except ImportError as error:
        skip_or_fail(f"embreex is not available: {error}")
    scene = rtcore_scene.EmbreeScene()
    corners = world_triangles(name).astype(np.float32)
    indices = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    # Keep the geometry referred to until the rays are done.
    mesh = TriangleMesh(scene=scene, vertices=corners.reshape(-1, 3), indices=indices)
    hits = scene.run(origins.astype(np.float32), directions.astype(np.float32), output=True)
    del mesh
    return hits


def meet_planes(corners, origins, directions):
    """Return where rays meet the planes of triangles (N, 3, 3): points and weights (N, 3)."""
    along = np.stack(
        [corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -directions], axis=-1
    )
    u, v, t = np.linalg.solve(along, (origins - corners[:, 0])[..., None])[..., 0].T
    return origins + t[:, None] * directions, np.stack([1.0 - u - v, u, v], axis=-1)


def distance_to_edges(view, corners, xy):
    """Return how far screen points are from the nearest projected edge of their triangle."""
    start = view.project(corners)
    along = np.roll(start, -1, axis=1) - start
    offset = xy[:, None] - start
    squares = np.maximum((along**2).sum(axis=2), np.finfo(float).tiny)
    share = np.clip((offset * along).sum(axis=2) / squares, 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)


class Comparison(NamedTuple):
    """One frame and the rays through some of its pixels."""

    name: str
    view: View
    frame: rj.Frame
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    hits: dict[str, NDArray]
    is_clear: NDArray[np.bool_]  # (N,), away from the edges of both faces
    bits: int

    @property
    def xy(self):
        return np.stack([self.columns + 0.5, self.rows + 0.5], axis=-1)

    def hit_pixels(self):
        """Return the indices of clear pixels that both show the same face at."""
        ours = self.frame.face_id[self.rows, self.columns]
        return np.nonzero(self.is_clear & (ours >= 0) & (ours == self.hits["primID"]))[0]


@functools.cache
def compare(name, camera_name, bits) -> Comparison:
    camera = CAMERAS[camera_name]
    view = make_view(camera)
    frame = rj.render(
        make_scene(name),
        camera,
        size=SIZE,
        quality=rj.Quality(subpixel_bits=bits),
        outputs=("depth", "face_id", "object_id", "position", "barycentric", "geometric_normal"),
        threads=2,
    )
    chosen = np.random.default_rng(1).choice(SIZE[0] * SIZE[1], SAMPLES, replace=False)
    rows, columns = chosen // SIZE[0], chosen % SIZE[0]
    xy = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    hits = trace(name, *view.rays(xy))
    is_clear = np.ones(SAMPLES, bool)
    for faces in (hits["primID"], frame.face_id[rows, columns]):
        there = np.nonzero(faces >= 0)[0]
        corners = world_triangles(name)[faces[there]]
        is_clear[there] &= distance_to_edges(view, corners, xy[there]) > NEAR_EDGE
    return Comparison(name, view, frame, rows, columns, hits, is_clear, bits)


def shown_range(comparison: Comparison, measure):
    """
    Return how much a measure of the point shown may be off, for each pixel that both hit.

    Moving the corners of a triangle on the screen by up to half a grid step moves the point shown
    at a pixel to one seen within that of its centre. So the measure is taken at the four corners
    of that square; what it is of, points and weights, bends one way only in between.
    """
    chosen = comparison.hit_pixels()
    corners = world_triangles(comparison.name)[comparison.hits["primID"][chosen]]
    step = 0.5 / 2.0**comparison.bits
    middle = measure(*meet_planes(corners, *comparison.view.rays(comparison.xy[chosen])))
    largest = np.zeros(middle.shape)
    for corner in ((-step, -step), (-step, step), (step, -step), (step, step)):
        beside = comparison.view.rays(comparison.xy[chosen] + corner)
        largest = np.maximum(largest, np.abs(measure(*meet_planes(corners, *beside)) - middle))
    return largest


every_case = pytest.mark.parametrize(
    ("name", "camera_name", "bits"),
    [
        (name, camera_name, bits)
        for name in ("teapot", "torus knot", "instances")
        for camera_name in CAMERAS
        for bits in (8, 12)
    ],
)


@every_case
def test_a_pixel_shows_the_face_that_its_ray_meets_first(name, camera_name, bits):
    comparison = compare(name, camera_name, bits)
    ours = comparison.frame.face_id[comparison.rows, comparison.columns]
    theirs = comparison.hits["primID"]
    clear = comparison.is_clear
    print(
        f"{name}, {camera_name}, {bits} bits: {SAMPLES} rays, {(theirs >= 0).sum()} hit, "
        f"{(~clear).sum()} near an edge, of these {(ours != theirs)[~clear].sum()} differ"
    )
    assert min((theirs >= 0).sum(), (theirs < 0).sum()) > 200
    assert clear.mean() > 0.97
    np.testing.assert_array_equal(ours[clear], theirs[clear])
    owners = comparison.frame.object_id[comparison.rows, comparison.columns]
    counts = [len(node.mesh.faces) for node in make_scene(name).nodes]
    expected = np.searchsorted(np.cumsum(counts), theirs, side="right")
    hit = clear & (theirs >= 0)
    np.testing.assert_array_equal(owners[hit], expected[hit])


@every_case
def test_depth_is_the_distance_of_the_hit_along_the_view(name, camera_name, bits):
    comparison = compare(name, camera_name, bits)
    view, chosen = comparison.view, comparison.hit_pixels()
    origins, directions = view.rays(comparison.xy[chosen])
    points = origins + comparison.hits["tfar"][chosen].astype(np.float64)[:, None] * directions
    expected = (points - view.eye) @ view.forward
    depth = comparison.frame.depth[comparison.rows[chosen], comparison.columns[chosen]]
    allowed = shown_range(comparison, lambda point, weights: (point - view.eye) @ view.forward)
    error = np.abs(depth - expected)
    share = (error <= FLOAT32_LOSS * expected).mean()
    print(f"{len(chosen)} pixels, {share:.3f} within {FLOAT32_LOSS} relative")
    assert len(chosen) > 200
    # On steep faces the grid counts; most are not steep, the more so the finer the grid.
    assert share > (0.75 if bits == 8 else 0.98)
    assert (error <= allowed + FLOAT32_LOSS * expected).all()
    missed = comparison.is_clear & (comparison.hits["primID"] < 0)
    assert np.isinf(
        comparison.frame.depth[comparison.rows[missed], comparison.columns[missed]]
    ).all()


@every_case
def test_position_is_where_the_ray_hits(name, camera_name, bits):
    comparison = compare(name, camera_name, bits)
    chosen = comparison.hit_pixels()
    origins, directions = comparison.view.rays(comparison.xy[chosen])
    points = origins + comparison.hits["tfar"][chosen].astype(np.float64)[:, None] * directions
    position = comparison.frame.position[comparison.rows[chosen], comparison.columns[chosen]]
    allowed = shown_range(comparison, lambda point, weights: point)
    distance = np.linalg.norm(points - origins, axis=1, keepdims=True)
    assert (np.abs(position - points) <= allowed + FLOAT32_LOSS * distance).all()


@every_case
def test_barycentric_weights_are_those_of_the_hit(name, camera_name, bits):
    comparison = compare(name, camera_name, bits)
    chosen = comparison.hit_pixels()
    u, v = (comparison.hits[k][chosen].astype(np.float64) for k in ("u", "v"))
    expected = np.stack([1.0 - u - v, u, v], axis=-1)
    weights = comparison.frame.barycentric[comparison.rows[chosen], comparison.columns[chosen]]
    allowed = shown_range(comparison, lambda point, weights: weights)
    # Embree's error, a share of the distance, counts against the height of the triangle as seen.
    corners = world_triangles(name)[comparison.hits["primID"][chosen]]
    seen = comparison.view.project(corners)
    sides = np.roll(seen, -1, axis=1) - seen
    double_area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    heights = double_area / np.linalg.norm(sides, axis=2).max(axis=1)
    embree_error = FLOAT32_LOSS * SIZE[1] / heights[:, None]
    assert (np.abs(weights - expected) <= allowed + embree_error).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)


@every_case
def test_geometric_normal_is_that_of_the_face_hit_and_turned_to_the_viewer(name, camera_name, bits):
    comparison = compare(name, camera_name, bits)
    chosen = comparison.hit_pixels()
    _, directions = comparison.view.rays(comparison.xy[chosen])
    expected = comparison.hits["Ng"][chosen].astype(np.float64)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    expected *= -np.sign((expected * directions).sum(axis=1, keepdims=True))
    normals = comparison.frame.geometric_normal[comparison.rows[chosen], comparison.columns[chosen]]
    # Embree takes the product of float32 edges: their rounding counts against their length.
    corners = world_triangles(name)[comparison.hits["primID"][chosen]]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.linalg.norm(normal, axis=1) / edges.max(axis=1)
    allowed = VERTEX_LOSS / heights[:, None]
    assert (np.abs(normals - expected) <= allowed).all()
    assert ((normals * directions).sum(axis=1) < 0.0).all()


def test_half_a_pixel_would_be_found():
    comparison = compare("teapot", "perspective", 8)
    origins, directions = comparison.view.rays(comparison.xy + [0.5, 0.0])
    beside = trace("teapot", origins, directions)["primID"]
    ours = comparison.frame.face_id[comparison.rows, comparison.columns]
    assert (ours != beside)[comparison.is_clear].sum() > 50
