"""Codes of pictures are those of their files: 16 bits stay, a colour key makes holes."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.io.images import decode_picture

KINDS = {1: 0, 2: 4, 3: 2, 4: 6}
"""How PNG calls pictures of so many channels."""


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(codes, key=None, bits=16):
    """Return a PNG file of codes, (H, W, C), of so many bits, with a colour key."""
    height, width, channels = codes.shape
    head = struct.pack(">IIBBBBB", width, height, bits, KINDS[channels], 0, 0, 0)
    if bits < 8:
        bitwise = np.unpackbits(codes.astype(np.uint8), axis=2)[:, :, 8 - bits :]
        rows = np.packbits(bitwise.reshape(height, -1), axis=1)
    else:
        rows = codes.astype(f">u{bits // 8}")
    content = b"".join(b"\0" + row.tobytes() for row in rows)
    said = b"" if key is None else chunk(b"tRNS", np.array(key, ">u2").tobytes())
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + said
        + chunk(b"IDAT", zlib.compress(content)) + chunk(b"IEND", b"")
    )  # fmt: skip


def both_ways(tmp_path, content):
    """Return the linear texels of a file as a texture and as part of a mesh file."""
    (tmp_path / "a.png").write_bytes(content)
    alone = rj.Texture.from_file(tmp_path / "a.png", color_space="linear").image
    inside = rj.Texture(decode_picture(content), color_space="linear").image
    assert np.array_equal(alone, inside)
    return alone


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_sixteen_bits_are_kept(tmp_path, channels):
    codes = np.random.default_rng(channels).integers(0, 65536, (5, 7, channels), np.uint16)
    texels = both_ways(tmp_path, png(codes))
    shares = (codes / np.float32(65535.0)).astype(np.float32)
    colors = shares[..., : channels - 1 if channels in (2, 4) else channels]
    assert np.array_equal(texels[..., :3], np.broadcast_to(colors, (5, 7, 3)))
    alpha = shares[..., -1] if channels in (2, 4) else np.ones((5, 7))
    assert np.array_equal(texels[..., 3], alpha)


@pytest.mark.parametrize("order", ["II", "MM"])
@pytest.mark.parametrize("channels", [3, 4])
def test_sixteen_bits_of_a_tiff_file_are_kept(channels, order):
    codes = np.random.default_rng(channels).integers(0, 65536, (3, 5, channels), np.uint16)
    mark, kind = ("<", "<u2") if order == "II" else (">", ">u2")
    data = codes.astype(kind).tobytes()
    entries = [(256, 3, 1, 5), (257, 3, 1, 3), (259, 3, 1, 1), (262, 3, 1, 2)]
    entries += [(277, 3, 1, channels), (278, 3, 1, 3), (279, 4, 1, len(data))]
    entries += [(338, 3, 1, 2)] if channels == 4 else []
    size = 8 + 2 + 12 * (len(entries) + 2) + 4
    entries += [(258, 3, channels, size), (273, 4, 1, size + 2 * channels)]
    head = order.encode() + struct.pack(f"{mark}HI", 42, 8)
    head += struct.pack(f"{mark}H", len(entries))
    for tag, of, count, value in sorted(entries):
        short = of == 3 and count == 1
        head += struct.pack(f"{mark}HHI", tag, of, count)
        head += struct.pack(f"{mark}HH", value, 0) if short else struct.pack(f"{mark}I", value)
    head += struct.pack(f"{mark}I", 0) + struct.pack(f"{mark}{channels}H", *[16] * channels)
    assert np.array_equal(decode_picture(head + data), codes)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
@pytest.mark.parametrize("channels", [1, 3])
def test_texels_of_a_colour_key_are_holes(tmp_path, bits, channels):
    if channels == 3 and bits < 8:
        pytest.skip("PNG has no colours of fewer bits")
    codes = np.random.default_rng(bits).integers(0, 2, (4, 6, channels)) * ((1 << bits) - 1)
    if bits == 16:
        # Codes that differ in their lower bytes alone are different.
        codes = np.where(codes > 0, 60000, 60001)
    key = codes[1, 1]
    texels = both_ways(tmp_path, png(codes.astype(np.uint16), key, bits))
    holes = (codes == key).all(axis=2)
    assert np.array_equal(texels[..., 3], np.where(holes, 0.0, 1.0))
    shares = codes / ((1 << bits) - 1)
    assert texels[..., :3] == pytest.approx(np.broadcast_to(shares, (4, 6, 3)), abs=1e-6)


def test_a_background_of_grey_with_holes_is_taken(tmp_path):
    codes = np.array([[[230], [10]]], np.uint16)
    (tmp_path / "a.png").write_bytes(png(codes, [230], 8))
    frame = rj.render(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
                      rj.OrthographicCamera((9, 9, 1), (9, 9, 0), height=1.0),
                      size=(2, 1), background=tmp_path / "a.png")  # fmt: skip
    assert frame.color[0, :, 3].tolist() == [0, 255]


def test_a_picture_that_is_decoded_already_keeps_what_it_has():
    image = Image.open(io.BytesIO(png(np.full((2, 2, 3), 770, np.uint16))))
    image.load()
    from rasterjit.scene.picture_codes import read_codes

    assert (read_codes(image) == 3).all()
