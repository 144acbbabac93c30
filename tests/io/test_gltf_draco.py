"""KHR_draco_mesh_compression: what DracoPy's encoder packs, against what was packed."""

import importlib
import random
import re
import sys
import warnings

import numpy as np
import pytest
from gltf_drafts import Draft, quad

import rasterjit as rj
from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.gltf.compression import decode_draco, read_draco_counts
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget

DracoPy = pytest.importorskip("DracoPy")

DRACO = "KHR_draco_mesh_compression"
SIDE = 12
DECODER = Decoder(MemoryBudget("a"))


def sheet():
    """Return points of a wavy sheet, its triangles and further attributes."""
    u, v = np.meshgrid(*[np.arange(SIDE, dtype=np.float32)] * 2)
    points = np.column_stack([u.ravel(), v.ravel(), np.sin(u.ravel())]).astype(np.float32)
    grid = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (grid[i : SIDE - 1 + i, j : SIDE - 1 + j].ravel() for i in (0, 1) for j in (0, 1))
    faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    return points, faces.astype(np.uint32)


def packed(**options):
    """Return a stream of the sheet, and its arrays by their numbers in the stream."""
    points, faces = sheet()
    count = len(points)
    numbers = np.arange(count)
    further = {
        4: np.column_stack([numbers % 7] * 4).astype(np.uint8),
        5: np.column_stack([numbers / count] * 4).astype(np.float32),
        7: np.column_stack([numbers * 300, numbers]).astype(np.uint16),
    }
    stream = DracoPy.encode(
        points, faces, generic_attributes=further, colors=further[4][:, :3].copy(), **options
    )
    found = {one["attribute_type"]: one["unique_id"] for one in DracoPy.decode(stream).attributes}
    places = {"POSITION": found[0], "COLOR_0": found[2], "JOINTS_0": 4, "WEIGHTS_0": 5, "_OWN": 7}
    arrays = {"POSITION": points, "COLOR_0": further[4][:, :3], "JOINTS_0": further[4],
              "WEIGHTS_0": further[5], "_OWN": further[7]}  # fmt: skip
    return stream, places, arrays, faces


def draft(*, required=True, plain=False, change=None, mode=4, **options):
    """Return a file with the sheet, and a square beside it that is not packed."""
    stream, places, arrays, faces = packed(**options)
    file = Draft()
    add = file.accessor if plain else file.say
    attributes = {
        name: add(rows, **({"normalized": True} if name == "COLOR_0" else {}))
        for name, rows in arrays.items()
        if name not in ("JOINTS_0", "WEIGHTS_0")
    }
    extension = {
        "bufferView": file.view(stream if change is None else change(stream)),
        "attributes": {name: places[name] for name in attributes},
    }
    primitive = {"attributes": attributes, "indices": add(faces.ravel()), "mode": mode,
                 "extensions": {DRACO: extension}}  # fmt: skip
    file.show(file.add("meshes", primitives=[primitive]))
    file.show(file.mesh(quad()))
    return file.use(DRACO, required=required)


@pytest.mark.parametrize("order", [False, True])
def test_every_attribute_comes_by_its_number(order):
    stream, places, arrays, faces = packed(preserve_order=order)
    mesh = decode_draco(stream, faces.size, DECODER)
    assert mesh.corners.shape == (faces.size,)
    assert {name: len(mesh.attributes[place]) for name, place in places.items()} == dict.fromkeys(
        arrays, SIDE * SIDE
    )
    # Where each vertex went: this attribute is packed without loss.
    came_from = mesh.attributes[7][:, 1].astype(np.int64)
    assert sorted(came_from) == list(range(SIDE * SIDE))
    for name, place in places.items():
        step = np.ptp(arrays["POSITION"], axis=0).max() / (2**14 - 1)
        worst = step if name == "POSITION" else 0.0
        got = mesh.attributes[place].astype(np.float64)
        np.testing.assert_allclose(got, arrays[name][came_from], rtol=0, atol=worst)
    packed_faces = came_from[mesh.corners].reshape(-1, 3)

    def turned(rows):
        """Return triangles in a canonical order, none of them turned over."""
        return sorted(tuple(np.roll(row, -int(row.argmin()))) for row in rows.astype(np.int64))

    assert turned(packed_faces) == turned(faces)
    if order:
        np.testing.assert_array_equal(packed_faces, faces)


@pytest.mark.parametrize("mode", [4, 5])
@pytest.mark.parametrize("required", [False, True])
def test_a_packed_mesh_is_drawn_with_its_neighbour(tmp_path, required, mode):
    scene = rj.load(
        draft(required=required, mode=mode, preserve_order=True).save(tmp_path / "a.glb")
    )
    mesh, beside = (node.mesh for node in scene.nodes)
    points, faces = sheet()
    assert len(mesh.faces) == len(faces)
    assert len(beside.faces) == 2
    lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose([lower, upper], [points.min(axis=0), points.max(axis=0)], atol=1e-3)
    # Colours are bytes that the accessor calls normalized.
    assert mesh.vertex_colors[:, :3].max() == pytest.approx(6 / 255)
    assert mesh.vertex_attributes["OWN"].max() == (SIDE * SIDE - 1) * 300


def test_what_is_plain_as_well_is_read_in_plain(tmp_path):
    damaged = draft(required=False, plain=True, change=lambda stream: b"DRACO").save(
        tmp_path / "a.glb"
    )
    points = rj.load(damaged).nodes[0].mesh.vertices
    np.testing.assert_array_equal(points.max(axis=0), sheet()[0].max(axis=0))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda stream: b"", "it is no Draco stream of version 2.2"),
        (lambda stream: stream[:11], "its stream ends too early"),
        (lambda stream: stream[:40], "its stream is damaged"),
        (lambda stream: stream[:6] + b"\1" + stream[7:], "it is no Draco stream of version 2.2"),
        (lambda stream: stream[:7] + b"\0" + stream[8:], "its stream is of kind 0, 1, which is no"),
        (lambda stream: stream[:12] + b"\xff\xff\xff\x7f", "its stream ends too early"),
        (lambda stream: stream[:12] + b"\xff\xff\xff\x7f" + stream[14:], "and 268435455 vertices"),
        (lambda stream: stream[:12] + b"\xff" * 9, "a number of its stream is too long"),
    ],
)  # fmt: skip
def test_a_damaged_stream_is_left_out_by_name(tmp_path, change, said):
    path = draft(change=change).save(tmp_path / "a.glb")
    with pytest.warns(rj.LoadWarning, match=f"mesh 0, which cannot be read: {DRACO}: .*{said}"):
        assert len(rj.load(path).nodes) == 1


def test_a_file_that_says_something_else_than_its_stream_is_left_out_by_name(tmp_path):
    def said(change):
        file = draft()
        change(file.header, file.header["meshes"][0]["primitives"][0])
        with pytest.warns(rj.LoadWarning, match="mesh 0|_OWN") as warned:
            rj.load(file.save(tmp_path / "a.glb"))
        return str(warned[0].message)

    def lower(header, primitive):
        header["accessors"][primitive["indices"]]["count"] = 30

    def wider(header, primitive):
        header["accessors"][primitive["attributes"]["POSITION"]]["type"] = "VEC4"

    def smaller(header, primitive):
        header["accessors"][primitive["attributes"]["_OWN"]]["componentType"] = 5121

    def missing(header, primitive):
        primitive["extensions"][DRACO]["attributes"]["POSITION"] = 99

    assert f"has {2 * (SIDE - 1) ** 2} faces and 144 vertices, but its accessor" in said(lower)
    assert "type must have 4 numbers, got (3,) in its stream" in said(wider)
    assert "_OWN of mesh 0, which cannot be read: " in said(smaller)
    assert "componentType must hold 42900, which is in its stream" in said(smaller)
    assert "its stream has no attribute 99, POSITION" in said(missing)
    assert "mode must be 4 or 5, got 1" in said(lambda h, p: p.update(mode=1))
    assert "indices is missing" in said(lambda h, p: p.pop("indices"))
    assert "no buffer view 77" in said(lambda h, p: p["extensions"][DRACO].update(bufferView=77))


def test_damage_ends_in_an_error_or_a_mesh():
    rng = random.Random(3)
    streams = [packed(preserve_order=order)[0] for order in (False, True)]
    outcomes = set()
    for number in range(300):
        stream = bytearray(streams[number % 2])
        for _ in range(rng.choice((1, 2, 5))):
            stream[rng.randrange(11, len(stream))] = rng.randrange(256)
        try:
            cut = bytes(stream[: rng.randrange(11, 2 * len(stream))])
            decode_draco(cut, 6 * SIDE * SIDE, DECODER)
            outcomes.add("a mesh")
        except ValueError as error:
            outcomes.add(re.sub(r"\d+", "N", str(error)))
    assert "a mesh" in outcomes
    assert f"{DRACO}: its stream ends too early" in outcomes
    pointing = f"{DRACO}: its stream is damaged: its faces must point at its N vertices, but one "
    assert f"{pointing}points at N" in outcomes


def test_a_stream_whose_faces_point_past_its_vertices_is_left_out_by_name(tmp_path):
    """Of a file whose other meshes are drawn."""
    rng = random.Random(4)
    said = f"mesh 0, which cannot be read: {DRACO}: its stream is damaged: its faces must point at"
    found = 0
    for _ in range(40):
        place, byte = rng.randrange(40, 600), rng.randrange(256)
        path = draft(
            preserve_order=True, change=lambda s, n=place, b=byte: s[:n] + bytes([b]) + s[n + 1 :]
        ).save(tmp_path / "a.glb")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = rj.load(path)
        if any(said in str(one.message) for one in caught):
            found += 1
            assert len(scene.nodes) == 1
    assert found


def test_names_in_a_stream_are_passed():
    points, faces = sheet()
    for order in (False, True):
        stream = DracoPy.encode(
            points, faces, create_metadata=True, preserve_order=order,
            generic_attributes={"one": points, "two": points},
        )  # fmt: skip
        assert read_draco_counts(stream) == (len(faces), len(points))


def test_a_stream_counts_in_the_memory_that_a_file_may_take(tmp_path):
    path = draft().save(tmp_path / "a.glb")
    with pytest.raises(FileSizeError, match="a Draco stream"):
        rj.load(path, max_bytes=60_000)


@pytest.fixture
def without(monkeypatch):
    """Let DracoPy be missing."""
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    importlib.invalidate_caches()


@pytest.mark.usefixtures("without")
def test_without_the_library_a_file_says_how_to_get_it(tmp_path):
    path = draft().save(tmp_path / "a.glb")
    with pytest.raises(
        rj.MeshFileError, match=rf'a\.glb: {DRACO} needs DracoPy; pip install "raster'
    ):
        rj.load(path)
    with pytest.warns(rj.LoadWarning, match="mesh 0, which cannot be read: .*needs DracoPy; pip"):
        assert len(rj.load(draft(required=False).save(path)).nodes) == 1
    assert len(rj.load(draft(required=False, plain=True).save(path)).nodes) == 2
