"""What would take more memory than a machine has, or overflow, is refused in words."""

from __future__ import annotations

import struct
import warnings
import zlib

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.io.images import decode_picture
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.scene.fog import MIN_RAMP
from rasterjit.scene.texture import MAX_TEXELS


def png_of(width, height):
    """Return a PNG file that claims a size, with hardly any pixels."""
    chunks = [b"\x89PNG\r\n\x1a\n"]
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    for kind, content in ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * 64)), (b"IEND", b"")):
        crc = struct.pack(">I", zlib.crc32(kind + content))
        chunks.append(struct.pack(">I", len(content)) + kind + content + crc)
    return b"".join(chunks)


SIZES = [(16384, 8193), (20000, 20000), (60000, 60000)]
"""Above our limit and below Pillow's; above that."""


@pytest.mark.parametrize("size", SIZES)
def test_picture_with_too_many_texels_is_refused_by_the_name_of_its_file(tmp_path, size):
    file = tmp_path / "wall.png"
    file.write_bytes(png_of(*size))
    for read in (rj.Texture.from_file, rj.Environment.from_file):
        with pytest.raises(
            ValueError, match=r"^the picture '.*wall\.png' must have at most 134,217,728 texels"
        ):
            read(file)
    with pytest.raises(ValueError, match="at most 134,217,728 texels"):
        decode_picture(png_of(*size))


@pytest.mark.parametrize("size", SIZES)
def test_material_with_too_large_a_picture_is_shown_without_it(tmp_path, size):
    (tmp_path / "wall.png").write_bytes(png_of(*size))
    (tmp_path / "wall.mtl").write_text("newmtl brick\nKd 1 1 1\nmap_Kd wall.png\n")
    file = tmp_path / "wall.obj"
    file.write_text("mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl brick\n"
                    "f 1/1 2/1 3/1\n")  # fmt: skip
    with pytest.warns(LoadWarning, match=r"wall\.obj.*'wall\.png'.*at most 134,217,728") as told:
        scene = rj.load(file)
    assert len(told) == 1
    assert scene.nodes[0].mesh.material.base_color_texture is None


def test_picture_that_pillow_would_warn_of_is_read_without_a_word(tmp_path):
    """Between Pillow's first limit, 89 million pixels, and ours it is only damaged here."""
    file = tmp_path / "wide.png"
    file.write_bytes(png_of(10000, 10000))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=r"wide\.png' is not: (?!.*texels)"):
            rj.Texture.from_file(file)


def test_texture_has_a_largest_area():
    dot = np.zeros((1, 1), np.uint8)
    for shape in ((65536, 65536), (8192, 16385)):
        with pytest.raises(ValueError, match=r"image must have at most 134,217,728 texels, got "):
            rj.Texture(np.broadcast_to(dot, shape))
    sky = np.broadcast_to(np.float32(0.0), (65536, 65536, 3))
    with pytest.raises(ValueError, match="sky must have at most 134,217,728 texels"):
        rj.Environment(sky)
    assert MAX_TEXELS == 134_217_728


def test_fog_has_a_shortest_ramp():
    for start, end in ((0.0, 1e-320), (0.0, 1e-39), (0.0, 0.999 * MIN_RAMP)):
        with pytest.raises(ValueError, match=r"end must be at least 1e-18 above start, 0\.0; got"):
            rj.Fog(mode="linear", start=start, end=end)
    mesh = rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
    scene = rj.Scene()
    scene.add(mesh)
    scene.fog = rj.Fog("red", "linear", start=0.0, end=MIN_RAMP)
    frame = rj.render(scene, size=(8, 8), outputs=("linear", "face_id"), threads=1)
    assert (frame.linear[frame.face_id >= 0] == [1.0, 0.0, 0.0, 1.0]).all()
