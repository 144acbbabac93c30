"""Change files: bytes, words, and what is known of their structure."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import re
import struct
import zipfile
import zlib
from typing import Any

import numpy as np

from benchmarks.fuzz_files.samples import Files, glb_of, opened, zipped

NUMBERS = (
    "0", "-1", "1", "2", "3", "255", "256", "65536", "2147483647", "4294967295", "-2147483648",
    "99999999999999999999", "1e38", "1e308", "1e999", "-1e-320", "nan", "inf", "-inf", "0x10",
    "1_0", "1.5", "", "x", ".", "-", "+", "1e", "1/2", "٣",
)  # fmt: skip
"""What stands in the place of a number."""

WORDS = ("", " ", "\t", "\n", "\r", "\0", "#", "\\", "/", '"', "'", "é", "\ufeff", "..", "%00")
"""What is put between words."""

VALUES = (
    None, True, -1, 0, 1, 2, 3, 255, 1 << 31, 1 << 40, 1 << 63, 0.5, -1.5, 1e38, 1e308, "", "x",
    "0", "../a.bin", "data:,", "data:;base64,!!", [], {}, [0], [0, 0, 0], [1, 2, 3, 4], [None],
    [[]], {"index": 0}, "a" * 300, float("nan"), float("inf"),
)  # fmt: skip
"""What stands in the place of a value of JSON."""

WHOLE = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 65536, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)
"""What stands in the place of a binary number."""

_NUMBER = re.compile(rb"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*|[-+.0-9eE]+")

_HEAD = 320
"""Bytes of a file among which its header is looked for."""


def mutated(files: Files, rng: np.random.Generator) -> tuple[Files, str]:
    """Return files of which one is changed, once to three times, and how."""
    main = opened(files)
    # A sample of a picture begins with the picture.
    chosen = str(rng.choice(list(files))) if rng.random() < 0.3 else next(iter(files))
    content, said = files[chosen], []
    # Mostly one change: what is damaged in many ways is refused soon.
    for _ in range(int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))):
        kind = str(rng.choice(["bytes", "words", "structure"], p=[0.35, 0.3, 0.35]))
        said.append(kind)
        content = KINDS[kind](content, chosen, rng)
    changed = dict(files)
    changed[chosen] = content
    return {main: changed[main]} | changed, f"{chosen}: {', '.join(said)}"


def change_bytes(content: bytes, _name: str, rng: np.random.Generator) -> bytes:
    """Change, insert, remove, move or repeat bytes anywhere."""
    data = bytearray(content)
    size = len(data)
    if size == 0:
        return bytes(rng.integers(0, 256, 8, np.uint8))
    at = int(rng.integers(0, size))
    # Mostly a little: what is cut to pieces is refused at once.
    length = min(size - at, int(2 ** rng.uniform(0.0, 6.0)))
    match int(rng.integers(0, 9)):
        case 0:
            for where in rng.integers(0, size, int(rng.integers(1, 9))).tolist():
                data[where] ^= 1 << int(rng.integers(0, 8))
        case 1:
            data[at : at + length] = rng.integers(0, 256, length, np.uint8).tobytes()
        case 2:
            data[at:at] = rng.integers(0, 256, length, np.uint8).tobytes()
        case 3:
            del data[at : at + length]
        case 4:
            del data[at:]
        case 5:
            data[at : at + length] = bytes(length)
        case 6:
            data[at:at] = data[at : at + length] * int(rng.integers(1, 4))
        case 7:
            number = int(rng.choice(WHOLE))
            size = int(rng.choice([1, 2, 4, 8]))
            order = "little" if rng.random() < 0.5 else "big"
            whole = (number & ((1 << 8 * size) - 1)).to_bytes(size, order)
            data[at : at + size] = whole
        case _:
            other = int(rng.integers(0, size))
            data[at : at + length] = data[other : other + length]
    return bytes(data)


def change_words(content: bytes, _name: str, rng: np.random.Generator) -> bytes:
    """Change numbers, words, or the order of lines of a text."""
    kind = int(rng.integers(0, 7))
    if kind < 4:
        found = list((_NUMBER if kind < 2 else _WORD).finditer(content))
        if not found:
            return change_bytes(content, _name, rng)
        one = found[int(rng.integers(0, len(found)))]
        if kind == 3:
            other = found[int(rng.integers(0, len(found)))]
            new = (b"", other[0], one[0] + b" " + one[0], one[0] + other[0])[int(rng.integers(4))]
        elif kind == 2:
            new = one[0] + str(rng.choice(WORDS)).encode() + one[0][-1:]
        else:
            new = str(rng.choice(NUMBERS)).encode()
        return content[: one.start()] + new + content[one.end() :]
    lines = content.split(b"\n")
    at, other = rng.integers(0, len(lines), 2).tolist()
    if kind == 4:
        del lines[at]
    elif kind == 5:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines.insert(at, lines[other])
    return b"\n".join(lines)


def change_structure(content: bytes, name: str, rng: np.random.Generator) -> bytes:
    """Change what is known of a format's structure; elsewhere words."""
    suffix = name.rpartition(".")[2]
    change = STRUCTURES.get(suffix)
    if suffix == "bz2" and name.endswith(".tar.bz2"):
        change = _change_bz2
    try:
        return (change or _change_head)(content, rng)
    except (ValueError, KeyError, IndexError, struct.error, zlib.error, OSError, EOFError,
            zipfile.BadZipFile, NotImplementedError, RuntimeError):  # fmt: skip
        # An earlier change left nothing of the structure.
        return change_bytes(content, name, rng)


def _change_head(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a number of the header, in words or in four bytes."""
    head, rest = content[:_HEAD], content[_HEAD:]
    if rng.random() < 0.5:
        return change_words(head, "", rng) + rest
    at = int(rng.integers(0, max(1, len(head) - 3)))
    packed = struct.pack("<I" if rng.random() < 0.5 else ">I", int(rng.choice(WHOLE)))
    return head[:at] + packed + head[at + 4 :] + rest


def _change_stl(content: bytes, rng: np.random.Generator) -> bytes:
    """Change the number of triangles."""
    if content[:5] == b"solid":
        return _change_head(content, rng)
    count = int(rng.choice(WHOLE)) if rng.random() < 0.5 else int(rng.integers(0, 40))
    return content[:80] + struct.pack("<I", count) + content[84:]


def change_json(document: Any, rng: np.random.Generator) -> Any:
    """Change, remove or repeat a value somewhere in a document."""
    places: list[tuple[Any, Any]] = []
    waiting = [document]
    while waiting:
        one = waiting.pop()
        keys = list(one) if isinstance(one, dict) else range(len(one))
        for key in keys:
            places.append((one, key))
            if isinstance(one[key], (dict, list)):
                waiting.append(one[key])
    if not places:
        return document
    holder, key = places[int(rng.integers(0, len(places)))]
    kind = int(rng.integers(0, 5))
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, list):
        holder.insert(int(key), holder[key])
    elif kind == 2:
        other, source = places[int(rng.integers(0, len(places)))]
        if not isinstance(other[source], (dict, list)):
            holder[key] = other[source]
    else:
        holder[key] = VALUES[int(rng.integers(0, len(VALUES)))]
    return document


def _change_gltf(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a value of the JSON."""
    document = json.loads(content)
    for _ in range(int(rng.integers(1, 4))):
        document = change_json(document, rng)
    return json.dumps(document).encode()


def _change_glb(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a value of the JSON, a number of the header, or the buffer."""
    if rng.random() < 0.1:
        at = int(rng.choice([0, 4, 8, 12, 16]))
        return content[:at] + struct.pack("<I", int(rng.choice(WHOLE))) + content[at + 4 :]
    (length,) = struct.unpack_from("<I", content, 12)
    header, buffer = content[20 : 20 + length], content[28 + length :]
    if rng.random() < 0.3:
        # What is packed there is reached by any bytes.
        return glb_of(header, change_bytes(buffer, "", rng))
    return glb_of(_change_gltf(header, rng), buffer)


def _change_zip(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a member, its name, or the sizes that the archive states."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = list(members)[int(rng.integers(0, len(members)))]
    kind = int(rng.integers(0, 8))
    if kind == 0:
        members = {(one + "x" if one == name else one): data for one, data in members.items()}
    elif kind == 1:
        del members[name]
    elif kind == 2:
        members[f"../{name}"] = members[name]
    elif kind == 3:
        sizes = [m.start() for m in re.finditer(b"PK\x01\x02", content)]
        at = sizes[int(rng.integers(0, len(sizes)))] + int(rng.choice([10, 16, 20, 24, 42]))
        return content[:at] + struct.pack("<I", int(rng.choice(WHOLE))) + content[at + 4 :]
    else:
        change = change_words if rng.random() < 0.7 else change_bytes
        members[name] = change(members[name], name, rng)
    return zipped(members)


def _change_bz2(content: bytes, rng: np.random.Generator) -> bytes:
    """Change what is packed."""
    change = change_words if rng.random() < 0.5 else change_bytes
    return bz2.compress(change(bz2.decompress(content), "", rng))


def _change_gz(content: bytes, rng: np.random.Generator) -> bytes:
    """Change what is packed; the archive's checksums are not mended."""
    return gzip.compress(change_bytes(gzip.decompress(content), "", rng), mtime=0)


def _change_png(content: bytes, rng: np.random.Generator) -> bytes:
    """Change the header of a picture, or another chunk, and mend its checksum."""
    if content[:4] != b"\x89PNG":
        return _change_head(content, rng)
    chunks, at = [], 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    which = 0 if rng.random() < 0.6 else int(rng.integers(0, len(chunks)))
    kind, data = chunks[which]
    if kind == b"IHDR" and rng.random() < 0.7:
        where = int(rng.choice([0, 4]))
        data = data[:where] + struct.pack(">I", int(rng.choice(WHOLE))) + data[where + 4 :]
    else:
        data = change_bytes(data, "", rng)
    chunks[which] = kind, data
    return content[:8] + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


KINDS = {"bytes": change_bytes, "words": change_words, "structure": change_structure}

STRUCTURES = {
    "gltf": _change_gltf, "glb": _change_glb, "vrm": _change_glb,
    "3mf": _change_zip, "zae": _change_zip, "3dxml": _change_zip, "zip": _change_zip,
    "bz2": _change_bz2, "gz": _change_gz, "png": _change_png,
    "stl": _change_stl, "stl_ascii": _change_stl,
}  # fmt: skip
"""What changes the structure of files with an extension."""
