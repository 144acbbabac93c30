"""EXT_meshopt_compression and KHR_meshopt_compression: what meshoptimizer packs, unpacked."""

import random
import re
import sys

import numpy as np
import pytest
from gltf_drafts import CORNERS, NORMAL, POSITION, Draft, quad
from sample_models import encode_png

import rasterjit as rj
from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.gltf.compression import decode_meshopt
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget

meshopt = pytest.importorskip("meshopt", reason="meshopt needs Python 3.11")

EXT, KHR = "EXT_meshopt_compression", "KHR_meshopt_compression"
DECODER = Decoder(MemoryBudget("a"))


class Packed(Draft):
    """A file whose arrays are packed; the plain ones are said to be in a buffer without bytes."""

    def __init__(self, extension=EXT, *, required=True, fallback=None):
        super().__init__()
        self.extension = extension
        self.use(extension, required=required)
        self.header["buffers"] = [{}, {"byteLength": 0}]
        if fallback is None:
            self.header["buffers"][1]["extensions"] = {extension: {"fallback": True}}
        else:
            self.header["buffers"][1]["uri"] = fallback

    def pack(self, rows, mode="ATTRIBUTES", change=None, **more):
        """Append a buffer view of rows of bytes, or of indices; return its number."""
        count, size = len(rows), rows[0].nbytes
        version = 1 if self.extension == KHR else 0
        if mode == "ATTRIBUTES":
            stored = meshopt.encode_gltf_buffer(rows, mode, version)
        else:
            stored = meshopt.encode_gltf_buffer(rows, mode)
        place = self.store(stored if change is None else change(stored))
        packed = {**place, "count": count, "byteStride": size, "mode": mode, **more}
        start = self.header["buffers"][1]["byteLength"]
        self.header["buffers"][1]["byteLength"] += count * size
        strided = {"byteStride": size} if mode == "ATTRIBUTES" else {}
        return self.add(
            "bufferViews", buffer=1, byteOffset=start, byteLength=count * size, **strided,
            extensions={self.extension: packed},
        )  # fmt: skip


def square(file, corners=CORNERS, mode="TRIANGLES", change=None, packed_normals=None):
    """Show a packed square; return the file."""
    points = file.say(POSITION, bufferView=file.pack(padded(POSITION), change=change))
    normals = file.say(NORMAL, bufferView=file.pack(padded(NORMAL)))
    if packed_normals is not None:
        normals = packed_normals
    mesh = file.mesh({"POSITION": points, "NORMAL": normals}, None)
    indices = file.say(corners, bufferView=file.pack(corners, mode))
    file.header["meshes"][mesh]["primitives"][0]["indices"] = indices
    file.show(mesh)
    return file


def padded(rows):
    """Return rows of float32 as the bytes that meshoptimizer takes, a multiple of four each."""
    return np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)


@pytest.mark.parametrize("extension", [EXT, KHR])
@pytest.mark.parametrize("kind", [np.uint16, np.uint32])
@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
def test_a_packed_mesh_is_what_was_packed(tmp_path, extension, kind, mode):
    corners = CORNERS.astype(kind)
    mesh = rj.load(square(Packed(extension), corners, mode).save(tmp_path / "a.glb")).nodes[0].mesh
    np.testing.assert_array_equal(mesh.vertices, POSITION)
    np.testing.assert_array_equal(mesh.normals, NORMAL)
    np.testing.assert_array_equal(np.sort(mesh.faces, axis=1), CORNERS.reshape(2, 3))


def test_vertices_of_many_blocks(tmp_path):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3000, 3)).astype(np.float32)
    corners = rng.permutation(3000).astype(np.uint32)
    for extension in (EXT, KHR):
        file = Packed(extension)
        place = file.say(points, bufferView=file.pack(padded(points)))
        mesh = file.mesh({"POSITION": place}, corners)
        file.show(mesh)
        found = rj.load(file.save(tmp_path / "a.glb")).nodes[0].mesh
        triangles = found.vertices[found.faces]
        np.testing.assert_array_equal(triangles.reshape(-1, 3), points[corners])


def directions(count, width):
    """Return unit vectors."""
    rows = np.random.default_rng(2).normal(size=(count, width)).astype(np.float32)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@pytest.mark.parametrize(("kind", "bits"), [(np.int8, 8), (np.int16, 12), (np.int16, 16)])
def test_the_octahedral_filter(tmp_path, kind, bits):
    size = 4 * np.dtype(kind).itemsize
    wanted = directions(50, 3)
    packed = meshopt.encode_filter_oct(np.column_stack([wanted, np.ones(50)]), size, bits)
    file = Packed()
    view = file.pack(packed, filter="OCTAHEDRAL")
    normals = file.say(np.zeros((50, 3), kind), bufferView=view, normalized=True)
    points = np.arange(150, dtype=np.float32).reshape(50, 3)
    file.show(file.mesh({"POSITION": points, "NORMAL": normals}, np.arange(48, dtype=np.uint16)))
    found = rj.load(file.save(tmp_path / "a.glb")).nodes[0].mesh.normals
    worst = np.linalg.norm(found[:48] - wanted[:48], axis=1).max()
    assert worst < 4.0 / 2 ** (bits - 1)


def test_the_quaternion_filter(tmp_path):
    wanted = directions(20, 4)
    view = Packed()
    number = view.pack(meshopt.encode_filter_quat(wanted, 8, 12), filter="QUATERNION")
    rotation = view.say(np.zeros((20, 4), np.int16), bufferView=number, normalized=True)
    mesh = view.mesh(quad())
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": rotation}}}
    view.show(mesh, extensions=extension)
    view.use("EXT_mesh_gpu_instancing")
    _, *nodes = rj.load(view.save(tmp_path / "a.glb")).every_node()
    for node, (x, y, z, w) in zip(nodes, wanted.astype(np.float64), strict=True):
        turned = node.transform[:3, 0]
        first = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
        np.testing.assert_allclose(turned, first, atol=4e-3)


@pytest.mark.parametrize("mode", ["Separate", "SharedVector", "SharedComponent", "Clamped"])
def test_the_exponential_filter(tmp_path, mode):
    wanted = np.random.default_rng(3).normal(size=(60, 3)).astype(np.float32)
    packed = meshopt.encode_filter_exp(wanted, 15, mode)
    file = Packed()
    points = file.say(wanted, bufferView=file.pack(packed, filter="EXPONENTIAL"))
    file.show(file.mesh({"POSITION": points}, np.arange(60, dtype=np.uint16)))
    mesh = rj.load(file.save(tmp_path / "a.glb")).nodes[0].mesh
    np.testing.assert_allclose(mesh.vertices[mesh.faces.ravel()], wanted, atol=1e-3)


def test_the_colour_filter(tmp_path):
    wanted = np.random.default_rng(4).uniform(size=(4, 4)).astype(np.float32)
    file = Packed(KHR)
    view = file.pack(meshopt.encode_filter_color(wanted, 4, 8), filter="COLOR")
    colors = file.say(np.zeros((4, 4), np.uint8), bufferView=view, normalized=True)
    file.show(file.mesh({**quad(), "COLOR_0": colors}))
    found = rj.load(file.save(tmp_path / "a.glb")).nodes[0].mesh.vertex_colors
    np.testing.assert_allclose(found, wanted, atol=2.5 / 255)


def test_pictures_may_be_packed(tmp_path):
    file = Packed()
    pixels = np.full((8, 8, 3), (200, 100, 50), np.uint8)
    png = encode_png(pixels)
    rows = np.frombuffer(png + b"\0" * (-len(png) % 4), np.uint8).reshape(-1, 4)
    image = file.add("images", bufferView=file.pack(rows), mimeType="image/png")
    material = rj.load(file.textured(source=image).save(tmp_path / "a.glb")).nodes[0].mesh.material
    assert material.base_color_texture.size == (8, 8)


def test_what_is_plain_as_well_is_read_in_plain_unless_required(tmp_path):
    def load(required, fallback):
        file = square(Packed(required=required, fallback=fallback), change=lambda stored: b"")
        return rj.load(file.save(tmp_path / "a.glb"))

    plain = padded(POSITION).tobytes() + padded(NORMAL).tobytes() + CORNERS.tobytes()
    (tmp_path / "plain.bin").write_bytes(plain)
    np.testing.assert_array_equal(load(False, "plain.bin").nodes[0].mesh.vertices, POSITION)
    with pytest.raises(rj.MeshFileError, match=f"accessor 0: {EXT}: it cannot be unpacked"):
        load(True, "plain.bin")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda packed: packed.update(byteLength=3), "it cannot be unpacked: Malformed"),
        (lambda packed: packed.update(mode="LINES"), "mode must be one of ATTRIBUTES, TRIANGLES"),
        (lambda packed: packed.update(mode=[]), "mode must be one of ATTRIBUTES, TRIANGLES"),
        (lambda packed: packed.update(filter="BLUR"), "filter must be one of NONE, OCTAHEDRAL"),
        (lambda packed: packed.pop("mode"), "mode is missing"),
        (lambda packed: packed.update(count=9), "9 rows of 12 bytes must be no more than the 48 b"),
        (lambda packed: packed.update(count=0), "must end within the 0 bytes of buffer view 0"),
        (lambda packed: packed.update(count=-1), "count must be a whole number at least 0"),
        (lambda packed: packed.update(byteStride=7), "a row must be 4 to 256 bytes, in fours"),
        (lambda packed: packed.update(buffer=9), "no buffer 9"),
        (lambda packed: packed.update(byteOffset=10**6), "buffer 0 is cut short"),
    ],
)  # fmt: skip
def test_a_damaged_buffer_view_is_left_out_by_name(tmp_path, change, said):
    file = square(Packed())
    file.show(file.mesh(quad()))
    change(file.header["bufferViews"][0]["extensions"][EXT])
    with pytest.warns(rj.LoadWarning, match=f"mesh 0, which cannot be read: accessor 0: .*{said}"):
        assert len(rj.load(file.save(tmp_path / "a.glb")).nodes) == 1


def test_damage_ends_in_an_error_or_in_numbers():
    rng = random.Random(3)
    rows = np.cumsum(np.arange(300 * 16, dtype=np.uint8).reshape(300, 16) % 5, axis=0, dtype="u1")
    corners = np.arange(600, dtype=np.uint32) % 200
    wholes = [
        (mode, meshopt.encode_gltf_buffer(what, mode, version), len(what), what[0].nbytes)
        for mode, what, version in (
            ("ATTRIBUTES", rows, 0), ("ATTRIBUTES", rows, 1), ("TRIANGLES", corners, 0),
            ("INDICES", corners, 0),
        )
    ]  # fmt: skip
    outcomes = set()
    for number in range(400):
        mode, whole, count, size = wholes[number % 4]
        stored = bytearray(whole)
        for _ in range(rng.choice((1, 2, 5))):
            stored[rng.randrange(len(stored))] = rng.randrange(256)
        stored = bytes(stored[: rng.randrange(2 * len(stored))])
        packed = {"mode": mode, "count": count, "byteStride": size}
        try:
            assert len(decode_meshopt(EXT, packed, stored, DECODER)) == count * size
            outcomes.add("numbers")
        except ValueError as error:
            outcomes.add(re.sub(r"-\d+", "N", str(error)))
    assert outcomes == {"numbers", f"{EXT}: it cannot be unpacked: Malformed buffer data: N"}


def test_a_count_counts_in_the_memory_that_a_file_may_take(tmp_path):
    file = square(Packed())
    view = file.header["bufferViews"][0]
    view["byteLength"] = 12 * 10**9
    view["extensions"][EXT]["count"] = 10**9
    path = file.save(tmp_path / "a.glb")
    with pytest.raises(FileSizeError, match="buffer view 0"):
        rj.load(path)


def test_without_the_library_a_file_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshopt", None)
    path = square(Packed()).save(tmp_path / "a.glb")
    with pytest.raises(rj.MeshFileError, match=rf'a\.glb: {EXT} needs meshopt; pip install "raste'):
        rj.load(path)
    monkeypatch.setattr("rasterjit.io.gltf.extensions._MIN_PYTHON", {"meshopt": (99, 1)})
    with pytest.raises(rj.MeshFileError, match=f"{EXT} needs meshopt on Python 99.1 or newer"):
        rj.load(path)
