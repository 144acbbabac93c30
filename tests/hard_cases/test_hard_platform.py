"""The same bits compiled or not, for any number of threads, any memory layout and any image."""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import subprocess
import sys
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime import threads as sharing

ALL_OUTPUTS = ("color", "linear", "depth", "face_id", "object_id", "barycentric", "normal",
               "position")  # fmt: skip


def digest(*arrays):
    """Return one hash over the bytes of arrays."""
    total = hashlib.sha256()
    for array in arrays:
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


# --- compiled or not ------------------------------------------------------------------------------

SCRIPT = """
import hashlib
import numba
import numpy as np
import rasterjit as rj

# Faces through the near plane, beyond the guard band, smaller than a pixel, and without area.
vertices = np.array([
    [-1, -1, 0], [1, -1, 0.5], [0, 1, 0.25], [0.2, 0.3, 5], [-9e3, -9e3, -3], [9e3, -9e3, -3],
    [0, 2e4, -3], [0.31, 0.3, 1], [0.312, 0.3, 1], [0.31, 0.303, 1]])
faces = [[0, 1, 2], [0, 3, 1], [4, 5, 6], [7, 8, 9], [0, 0, 2]]
colors = np.linspace(0, 1, 30).reshape(10, 3)
mesh = rj.Mesh(vertices, faces, colors=colors, material=rj.Material("phong", "white"))
camera = rj.PerspectiveCamera((0.1, 0.2, 3), (0, 0, 0), near=0.5)
outputs = ("color", "linear", "depth", "face_id")
frame = rj.render(mesh, camera, size=(20, 15), outputs=outputs, threads=1)
canvas = rj.Framebuffer(20, 15)
canvas.draw_line((-3, 2), (25, 11), (9, 200, 31), end_color=(255, 0, 77))
canvas.draw_line((2**31 - 1, 14), (-(2**31), 0), (1, 2, 3))
canvas.fill_triangle((-5, 1), (30, 4), (7, 29), ((255, 0, 0), (0, 255, 0), (0, 0, 255)),
                     depth=(0.1, 0.7, 0.3))
total = hashlib.sha256()
for array in (*frame.arrays().values(), canvas.color, canvas.depth):
    total.update(array.tobytes())
print(bool(numba.config.DISABLE_JIT))
print(frame.stats.clipped, len(np.unique(frame.face_id)), total.hexdigest())
"""


def run_script(**settings):
    """Return (which mode, what was drawn), as a process of its own prints it."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT],
        env={**environment, **settings}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.case("P01")
def test_plain_python_gives_the_bits_of_the_compiled_kernels():
    mode, compiled = run_script(NUMBA_DISABLE_JIT="0")
    assert mode == "False"
    clipped, seen, _ = compiled.split()
    assert int(clipped) == 2
    assert int(seen) >= 3
    assert run_script(NUMBA_DISABLE_JIT="1") == ["True", compiled]


@pytest.mark.case("P01")
def test_products_beyond_32_bits_do_not_wrap():
    with np.errstate(over="ignore"):
        assert np.int32(65536) * np.int32(65536) == 0  # what plain NumPy does
    # Edge functions of 32768 x 16384 pixels at 1/4096 pixel: 2**53 and more.
    quality = rj.Quality(subpixel_bits=12)
    positions = [[-2, -3, 0, 1], [2, -3, 0, 1], [2, 3, 0, 1]]
    seen = rj.rasterize(positions, [[0, 1, 2]], (16384, 8), quality=quality, threads=1)
    corners = [oracle.screen_position(p, (16384, 8)) for p in positions]
    for left in (0, 8190, 16382):
        window = (left, 0, left + 2, 8)
        want = oracle.covered_pixels(corners, (16384, 8), subpixel_bits=12, window=window)
        rows, columns = np.nonzero(seen.face_id[:, left : left + 2] == 0)
        assert {(c + left, r) for c, r in zip(columns, rows, strict=True)} == want
    assert 0 < (seen.face_id == 0).sum() < seen.face_id.size


# --- not a number ---------------------------------------------------------------------------------


@pytest.mark.case("P02")
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", range(4))
def test_a_vertex_that_is_no_number_draws_nothing(value, axis):
    size = (16, 16)
    good = naive.clip_from_screen([(1, 1), (2, 15), (15, 7)], size, 0.25, [1, 2, 4])
    alone = rj.rasterize(good, [[0, 1, 2]], size, threads=1)
    for vertex in range(3):
        # In front of the good face, and before it in the list.
        bad = naive.clip_from_screen([(0, 0), (0, 32), (32, 0)], size, -0.5)
        bad[vertex, axis] = value
        positions = np.concatenate([bad, good])
        seen = rj.rasterize(positions, [[0, 1, 2], [3, 4, 5]], size, threads=1)
        assert seen.totals.invalid == 1
        assert (seen.face_id - (seen.face_id >= 0)).tobytes() == alone.face_id.tobytes()
        assert seen.depth.tobytes() == alone.depth.tobytes()
        assert seen.barycentric.tobytes() == alone.barycentric.tobytes()


@pytest.mark.case("P02")
def test_no_nan_reaches_an_output(sphere, camera):
    vertices = np.array(sphere.vertices)
    vertices[[3, 11, 20], [0, 1, 2]] = math.nan, math.inf, -math.inf
    normals = np.array(sphere.vertices)
    normals[5] = 0
    for shading in ("flat", "gouraud", "phong"):
        with pytest.warns(UserWarning, match="1 normal of length 0"):
            mesh = rj.Mesh(
                vertices, sphere.faces, normals=normals, on_invalid="drop",
                material=rj.Material(shading, specular=1.0),
            )  # fmt: skip
        frame = rj.render(mesh, camera, size=(32, 24), outputs=ALL_OUTPUTS, threads=1)
        assert frame.stats.invalid > 0
        covered = frame.face_id >= 0
        touched = np.isin(sphere.faces, [3, 11, 20]).any(axis=1)
        assert not touched[frame.face_id[covered]].any()
        for name, array in frame.arrays().items():
            assert np.isfinite(array[covered]).all(), name
        assert np.isfinite(frame.linear).all()
        assert np.isfinite(frame.normal).all()
        assert (frame.depth[~covered] == math.inf).all()


# --- one rounding ---------------------------------------------------------------------------------

RESOLVED = 2.0**-20
"""Weights differ by more than 2**-13 if a vertex moves by one step, and float32 keeps 2**-24."""


def weights_at(positions, size, pixel):
    """Return (what the engine says, what the oracle says) of the weights at a pixel's centre."""
    seen = rj.rasterize(positions, [[0, 1, 2]], size, threads=1)
    assert seen.face_id[pixel[1], pixel[0]] == 0
    corners = [oracle.screen_position(p, size) for p in positions]
    snapped = oracle.snap_triangle(corners)
    point = (pixel[0] * 256 + 128, pixel[1] * 256 + 128)
    want = oracle.affine_weights(snapped, point)
    return seen.barycentric[pixel[1], pixel[0]], [float(w) for w in want]


@pytest.mark.case("P08", "P03")
@pytest.mark.parametrize("ulps", [-1, 0, 1])
@pytest.mark.parametrize("steps", [0, 1, 2, 127, 128, 129, 254, 255])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_tie_and_its_neighbours_snap_half_to_even(axis, steps, ulps):
    size = (16, 16)
    tie = 8 + (steps + 0.5) / 256
    value = tie + ulps * np.spacing(tie)
    assert Fraction(value) - Fraction(tie) == ulps * Fraction(1, 2**49)
    # Right and down of the middle an NDC coordinate and its sum with 1 are exact.
    point = (value, 8.25) if axis == "x" else (8.25, value)
    positions = [(px / 8 - 1, 1 - py / 8, 0.0, 1.0) for px, py in (point, (14, 9), (9, 14))]
    assert oracle.screen_position(positions[0], size) == tuple(map(Fraction, point))
    even = steps + steps % 2
    want = 8 * 256 + {-1: steps, 0: even, 1: steps + 1}[ulps]
    assert oracle.snap(value) == want == round(Fraction(value) * 256)
    have, exact = weights_at(positions, size, (10, 10))
    assert np.abs(have - exact).max() <= RESOLVED
    # One step to either side would be seen.
    for off in (-1, 1):
        moved = [oracle.snap(p) for p in point]
        moved[axis == "y"] += off
        others = [(14 * 256, 9 * 256), (9 * 256, 14 * 256)]
        other = oracle.affine_weights((tuple(moved), *others), (10 * 256 + 128, 10 * 256 + 128))
        assert max(abs(a - float(b)) for a, b in zip(have, other, strict=True)) > 64 * RESOLVED


@pytest.mark.case("P08")
def test_negative_zero_is_zero():
    faces, size = [[0, 1, 2]], (16, 16)
    plus = np.array([[0.0, 0.0, 0.0, 1], [0.75, 0.0, 0.0, 1], [0.0, 0.75, 0.0, 1]])
    minus = np.where(plus == 0, -0.0, plus)
    assert np.signbit(minus[0, :3]).all()
    frames = [rj.rasterize(p, faces, size, threads=1) for p in (plus, minus)]
    hashes = [digest(f.face_id, f.depth + 0, f.barycentric) for f in frames]
    assert hashes[0] == hashes[1]
    assert (frames[0].face_id == 0).any()


@pytest.mark.case("P08")
def test_sums_that_are_not_what_they_seem_snap_by_their_exact_value():
    for x in (0.1 + 0.2, 0.3, 0.7 + 0.1, 0.8, 1 / 3):
        positions = [(x, -x, 0.0, 1.0), (0.95, 0.9, 0.0, 1.0), (-0.9, -0.9, 0.0, 1.0)]
        have, exact = weights_at(positions, (16, 16), (9, 8))
        assert np.abs(have - exact).max() <= RESOLVED
    assert 0.1 + 0.2 != 0.3


# --- threads --------------------------------------------------------------------------------------


@pytest.fixture
def busy(sphere):
    """Overlapping balls in every shading, some of them cut by the near plane."""
    scene = rj.Scene()
    for n, shading in enumerate(("flat", "gouraud", "phong", "unlit") * 2):
        mesh = rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material(shading))
        place = rj.transforms.translate((0.6 * n - 2, 0.3 * (n % 3), 0.5 * n))
        scene.add(mesh, place)
    return scene


def hash_of(scene, threads):
    camera = rj.PerspectiveCamera((0.3, 0.5, 3.9), (0, 0, 0), near=0.4)
    frame = rj.render(scene, camera, size=(150, 90), outputs=ALL_OUTPUTS, threads=threads)
    assert frame.stats.clipped > 0
    return digest(*frame.arrays().values())


@pytest.mark.case("P04")
@pytest.mark.parametrize("threads", [1, 2, 3, 7, 16])
def test_twenty_renders_by_any_number_of_threads_have_one_hash(busy, threads):
    alone = hash_of(busy, 1)
    assert {hash_of(busy, threads) for _ in range(20)} == {alone}


@pytest.mark.case("P04")
@pytest.mark.parametrize("size", [1, 3, 1000])
@pytest.mark.parametrize("order", ["forward", "backward"])
def test_size_and_order_of_tasks_change_no_hash(busy, monkeypatch, size, order):
    want = hash_of(busy, 1)
    # One worker, so that the order is the one that is set.
    monkeypatch.setattr(visibility_pass, "TILES_PER_TASK", size)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", size)
    monkeypatch.setattr(visibility_pass, "FACES_PER_TASK", 97 * size)
    monkeypatch.setattr(visibility_pass, "VERTICES_PER_TASK", 5 * size)
    tasks = []

    def run(self, task, arguments):
        calls = list(arguments)
        tasks.append(len(calls))
        if order == "forward":
            return [task(*call) for call in calls]
        return [task(*call) for call in calls[::-1]][::-1]

    monkeypatch.setattr(sharing.Workers, "run", run)
    assert hash_of(busy, 2) == want
    assert max(tasks) > 1


@pytest.mark.case("P06")
def test_a_hundred_thousand_layers_show_the_nearest():
    count, size = 100_000, (96, 96)
    rng = np.random.default_rng(6)
    depths = rng.permutation(count) / count
    corners = naive.clip_from_screen([(-64, -64), (-64, 512), (512, -64)], (64, 64))
    positions = np.tile(corners, (count, 1))
    positions[:, 2] = np.repeat(depths, 3)
    faces = np.arange(3 * count).reshape(-1, 3)
    for threads in (8, 2, 8):
        seen = rj.rasterize(positions, faces, size, threads=threads)
        assert (seen.face_id == depths.argmin()).all()
        assert (seen.depth == 0).all()
        assert seen.totals.drawn == count


@pytest.mark.case("P06")
def test_a_hundred_thousand_overlapping_triangles_have_one_picture():
    count, size = 100_000, (130, 100)
    rng = np.random.default_rng(7)
    positions = np.ones((count, 3, 4))
    positions[..., :3] = rng.uniform(-0.9, 0.9, (count, 1, 3)) + rng.uniform(
        -0.1, 0.1, (count, 3, 3)
    )
    positions, faces = positions.reshape(-1, 4), np.arange(3 * count).reshape(-1, 3)
    frames = [rj.rasterize(positions, faces, size, threads=n) for n in (1, 8, 8, 8)]
    assert len({digest(f.face_id, f.depth) for f in frames}) == 1
    # Nothing hides a nearer face: at each pixel the depth is the least of all that cover it.
    seen = frames[0]
    sample = rng.choice(count, 200, replace=False)
    for face in sample:
        one = rj.rasterize(positions[3 * face : 3 * face + 3], [[0, 1, 2]], size, threads=1)
        assert (seen.depth[one.face_id == 0] <= one.depth[one.face_id == 0]).all()


# --- memory ---------------------------------------------------------------------------------------


def layouts(array):
    """Yield the same numbers in other memory."""
    array = np.asarray(array)
    yield "Fortran order", np.asfortranarray(array)
    spread = np.zeros((2 * len(array), 3 * array.shape[1]), array.dtype)
    spread[::2, ::3] = array
    yield "strided", spread[::2, ::3]
    yield "negative strides", np.ascontiguousarray(array[::-1, ::-1])[::-1, ::-1]
    frozen = array.copy()
    frozen.flags.writeable = False
    yield "read-only", frozen
    yield "big-endian", array.astype(array.dtype.newbyteorder(">"))
    shifted = np.frombuffer(b"\0" + np.ascontiguousarray(array).tobytes(), np.uint8)[1:]
    yield "unaligned", shifted.view(array.dtype).reshape(array.shape)
    yield "list", array.tolist()


def number_kinds(array):
    """Yield the same whole numbers as other types, and in other memory."""
    array = np.asarray(array)
    for dtype in ("f4", "f8", "i1", "i2", "i4", "i8", ">i4", ">f8", "f2"):
        yield dtype, array.astype(dtype)
    if array.min() >= 0:
        for dtype in ("u1", "u2", "u4", "u8", ">u8"):
            yield dtype, array.astype(dtype)
    yield from layouts(array)


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 1]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
COLORS = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [1, 1, 1]], float)
VIEW = rj.transforms.translate((0, 0, -4))
CLIP = rj.transforms.perspective(90, 1, 1, math.inf)


def picture(vertices=CORNERS, faces=FACES, colors=COLORS, normals=CORNERS, view=VIEW, clip=CLIP):
    mesh = rj.Mesh(vertices, faces, colors=colors, normals=normals)
    frame = rj.render(
        mesh, rj.MatrixCamera(view, clip), size=(20, 20), outputs=ALL_OUTPUTS, threads=1
    )
    return digest(*frame.arrays().values())


@pytest.mark.case("P05")
@pytest.mark.parametrize(
    ("name", "array"),
    [("vertices", CORNERS), ("faces", FACES), ("normals", CORNERS), ("view", VIEW),
     ("clip", CLIP)],
)  # fmt: skip
def test_memory_of_meshes_and_matrices_changes_no_bit(name, array):
    want = picture()
    for kind, same in number_kinds(array):
        assert picture(**{name: same}) == want, kind


@pytest.mark.case("P05")
def test_memory_of_colours_changes_no_bit():
    # uint8 colours are sRGB codes, so 1 is written as 255 there.
    want = picture()
    for kind, same in layouts(COLORS):
        assert picture(colors=same) == want, kind
    assert picture(colors=COLORS.astype("f4")) == want
    assert picture(colors=COLORS.astype("i8")) == want
    for kind, same in layouts((255 * COLORS).astype(np.uint8)):
        if kind != "list":
            assert picture(colors=same) == want, kind


@pytest.mark.case("P05")
@pytest.mark.parametrize("name", ["positions", "faces"])
def test_memory_of_rasterized_arrays_changes_no_bit(name):
    positions = np.array([[-3, -3, 0, 4], [3, -3, 1, 4], [0, 3, 2, 5], [0, 0, -1, 1]], float)
    faces = np.array([[0, 1, 2], [3, 1, 2]])

    def bits(positions, faces):
        seen = rj.rasterize(positions, faces, (20, 12), threads=1)
        assert len(np.unique(seen.face_id)) == 3
        return digest(seen.face_id, seen.depth, seen.barycentric)

    want = bits(positions, faces)
    for kind, same in number_kinds(positions if name == "positions" else faces):
        have = bits(same, faces) if name == "positions" else bits(positions, same)
        assert have == want, kind


@pytest.mark.case("P05")
def test_memory_of_lines_changes_no_bit():
    ends = np.array([[0, 0, 15, 9], [3, 9, 12, 1], [7, 7, 7, 0]])
    colors = np.array([[255, 0, 9], [1, 200, 0], [90, 80, 70]], np.uint8)

    def bits(ends, colors):
        canvas = rj.Framebuffer(16, 10)
        canvas.draw_lines(ends, colors)
        return digest(canvas.color)

    want = bits(ends, colors)
    for kind, same in number_kinds(ends):
        assert bits(same, colors) == want, kind
    for dtype in ("i2", "i4", "u4", "i8", "u8", "f4", "f8", ">i4"):
        assert bits(ends, colors.astype(dtype)) == want, dtype
    for kind, same in layouts(colors):
        assert bits(ends, same) == want, kind


@pytest.mark.case("P05")
def test_memory_of_curves_and_depths_changes_no_bit():
    points, depth = np.array([[1.0, 1], [12, 2], [3, 8]]), np.array([[1.0, 2, 3]])

    def bits(points, depth):
        canvas = rj.Framebuffer(16, 10)
        canvas.draw_bezier(points, (255, 0, 9))
        canvas.fill_triangle((0, 0), (9, 0), (0, 9), (1, 200, 0), depth=depth[0])
        return digest(canvas.color, canvas.depth)

    want = bits(points, depth)
    for kind, same in layouts(points):
        assert bits(same, depth) == want, kind
    for kind, same in layouts(depth):
        assert bits(points, same) == want, kind


def shifted_copy(thing):
    """Return what a pickle gives back whose arrays lie at odd addresses, as a network brings it."""
    buffers = []
    pickled = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    odd = [memoryview(b"\0" + bytes(one.raw()))[1:] for one in buffers]
    assert odd
    return pickle.loads(pickled, buffers=odd)


@pytest.mark.case("P05")
def test_memory_of_what_was_pickled_changes_no_bit():
    texels = np.linspace(0, 1, 48, dtype=np.float32).reshape(4, 4, 3)
    material = rj.Material("phong", "white", base_color_texture=rj.Texture(texels))
    scene = rj.Scene()
    scene.add(rj.Mesh(CORNERS, FACES, colors=COLORS, uv=CORNERS[:, :2], material=material))
    scene.environment = rj.Environment(np.ones((4, 8, 3), np.float32) * texels[0, 1])
    scene.lights.append(rj.DirectionalLight((0, 0, -1)))
    camera = rj.MatrixCamera(VIEW, CLIP)

    def bits(scene, camera):
        return digest(rj.render(scene, camera, size=(20, 20), threads=1).color)

    assert bits(shifted_copy(scene), shifted_copy(camera)) == bits(scene, camera)


@pytest.mark.case("P05")
def test_memory_of_a_trimesh_changes_no_bit():
    trimesh = pytest.importorskip("trimesh")

    def bits(vertices, faces):
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        camera = rj.MatrixCamera(VIEW, CLIP)
        frame = rj.render(mesh, camera, size=(20, 20), outputs=("color", "depth"), threads=1)
        return digest(frame.color, frame.depth)

    want = bits(CORNERS, FACES)
    for kind, same in layouts(CORNERS):
        assert bits(same, FACES) == want, kind
    for dtype in ("f4", "i8", ">f8"):
        assert bits(CORNERS.astype(dtype), FACES) == want, dtype
    for dtype in ("u1", "u4", "i4", "u8", ">i8"):
        assert bits(CORNERS, FACES.astype(dtype)) == want, dtype


@pytest.mark.case("P05")
@pytest.mark.parametrize("dtype", [complex, object, "U4", bool])
def test_what_holds_no_real_numbers_is_refused_by_name(dtype):
    with pytest.raises(ValueError, match="vertices must"):
        rj.Mesh(CORNERS.astype(dtype), FACES)
    with pytest.raises(ValueError, match="faces must"):
        rj.Mesh(CORNERS, FACES.astype(dtype))
    with pytest.raises(ValueError, match="clip_positions must"):
        rj.rasterize(np.ones((4, 4)).astype(dtype), FACES, (4, 4))


# --- large images ---------------------------------------------------------------------------------
# An image of 16384 x 16384 needs gigabytes; one side at its limit at a time reaches the largest
# column and row, and a flat index of 2**20.


@pytest.mark.case("P07")
@pytest.mark.parametrize("size", [(16384, 64), (64, 16384)])
def test_a_frame_as_large_as_can_be_is_drawn_to_its_last_pixel(size):
    width, height = size
    whole = [(0, 0), (0, 2 * height), (2 * width, 0)]
    last = [(width - 1, height - 1), (width - 1, height + 1), (width + 1, height - 1)]
    positions = naive.clip_from_screen(whole + last, size, [0.5] * 3 + [0.25] * 3)
    seen = rj.rasterize(positions, [[0, 1, 2], [3, 4, 5]], size, threads=2)
    want = np.zeros((height, width), np.int32)
    want[-1, -1] = 1
    assert seen.face_id.tobytes() == want.tobytes()
    assert seen.depth[-1, -1] == 0.25
    mesh = rj.Mesh(
        positions[:, :3], [[0, 1, 2], [3, 4, 5]], colors=[[1, 0, 0], [0, 0, 1]],
        material=rj.Material("unlit", "white"),
    )  # fmt: skip
    camera = rj.MatrixCamera(np.eye(4), np.eye(4))
    color = rj.render(mesh, camera, size=size, threads=2).color
    assert color.shape == (height, width, 4)
    assert color[-1, -1].tolist() == [0, 0, 255, 255]
    assert (color.reshape(-1, 4)[:-1] == [255, 0, 0, 255]).all()


def free_bytes():
    """Return the memory that can be had, or 0 if this system does not say."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 0


@pytest.mark.needs_jit
@pytest.mark.case("P07")
@pytest.mark.parametrize(
    ("width", "height"),
    [(16384, 256), (256, 16384), pytest.param(16384, 16384, marks=pytest.mark.takes_long)],
)
def test_the_last_pixel_of_the_largest_frame_is_its_own(width, height):
    # Flat numbers to 2**28 - 1, and to 2**30 - 1 of the bytes of the colour.
    needed = 24 * width * height
    if free_bytes() < needed:
        pytest.skip(f"needs {needed >> 30} GB of free memory")
    right, bottom = width - 1, height - 1
    corner = [(right, bottom), (right, bottom + 2), (right + 2, bottom)]
    positions = naive.clip_from_screen(corner, (width, height), 0.25)
    material = rj.Material("unlit", "blue")
    mesh = rj.Mesh(positions[:, :3], [[0, 1, 2]], material=material)
    camera = rj.MatrixCamera(np.eye(4), np.eye(4))
    frame = rj.render(
        mesh,
        camera,
        size=(width, height),
        outputs=("color", "face_id"),
        threads=2,
        background="red",
    )
    assert frame.face_id[-1, -1] == 0
    assert np.count_nonzero(frame.face_id != -1) == 1
    pixels = frame.color.view(np.uint32)
    red, blue = np.array([[255, 0, 0, 255], [0, 0, 255, 255]], np.uint8).view(np.uint32).ravel()
    assert pixels[-1, -1] == blue
    assert np.count_nonzero(pixels == red) == width * height - 1


@pytest.mark.case("P07")
@pytest.mark.parametrize("size", [(16384, 64), (64, 16384)])
def test_a_framebuffer_as_large_as_can_be_is_drawn_to_its_last_pixel(size):
    width, height = size
    canvas = rj.Framebuffer(width, height)
    canvas.put_pixel(width - 1, height - 1, (1, 2, 3, 4))
    assert np.argwhere((canvas.color != [0, 0, 0, 255]).any(axis=2)).tolist() == [
        [height - 1, width - 1]
    ]
    canvas.clear()
    canvas.draw_line((0, 0), (width - 1, height - 1), (9, 8, 7))
    drawn = np.argwhere(canvas.color[..., 0] == 9)
    assert {(c, r) for r, c in drawn.tolist()} == set(
        oracle.line_pixels((0, 0), (width - 1, height - 1))
    )
    canvas.clear()
    corner = (width - 1, height - 1)
    canvas.fill_triangle(corner, corner[::-1], (0, 0), (5, 5, 5), edges="inclusive")
    assert canvas.color[-1, -1].tolist() == [5, 5, 5, 255]
    with pytest.raises(ValueError, match="width, height"):
        rj.Framebuffer(16385, 64)
