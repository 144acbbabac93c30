"""Values of glTF's JSON that are not what they must be: named with the file, in our own words."""

from __future__ import annotations

import base64
import copy
import io
import json
import math
import re
import warnings

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning, MeshFileError

RAW = re.compile(
    r"object has no|not iterable|not subscriptable|not reversible|unhashable|unsupported operand"
    r"|ufunc|broadcast|reshape|convert|indices must be int|out of range|out of bounds|unpack"
    r"|must be real|setting an array|index-sized|inhomogeneous|has no len|strides|too small|too big"
    r"|Maximum allowed|argument|instance|NoneType|could not be read as \.gltf: .{0,2}$"
    r"|which cannot be read: ('|[0-9-]|[a-zA-Z]+ \()"
)
"""What Python and NumPy say about values that they cannot use."""

BAD = (None, "a", {}, [1], -1, 3.5, True, 7, 10**30, math.inf, math.nan, [1] * 16)
MISSING = object()


def document():
    """Return a file that uses most of glTF, as JSON: a textured square, two cameras, a light."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    stream = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(stream, "PNG")
    parts = [
        corners, np.array([0, 1, 2, 0, 2, 3], np.uint16), np.float32([[0, 0, 1]] * 4),
        corners[:, :2].copy(), np.full((4, 4), 128, np.uint8), np.array([1], np.uint16),
        np.float32([[1, 0, 0]]), np.float32([[1, 0, 0, 1]] * 4), stream.getvalue(),
    ]  # fmt: skip
    views, content = [], b""
    for part in parts:
        content += bytes(-len(content) % 4)
        part = part if isinstance(part, bytes) else part.tobytes()
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": len(part)})
        content += part
    views[4]["byteStride"] = 4
    uri = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    kinds = [
        (5126, 4, "VEC3"), (5123, 6, "SCALAR"), (5126, 4, "VEC3"), (5126, 4, "VEC2"),
        (5121, 4, "VEC3"), (5126, 4, "VEC4"),
    ]  # fmt: skip
    accessors = [
        {"bufferView": view, "byteOffset": 0, "componentType": kind, "count": count, "type": shape}
        for view, (kind, count, shape) in zip((0, 1, 2, 3, 4, 7), kinds, strict=True)
    ]
    accessors[0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 5, "byteOffset": 0, "componentType": 5123},
        "values": {"bufferView": 6, "byteOffset": 0},
    }
    accessors[4]["normalized"] = True
    moved = {"offset": [0.0, 0.5], "rotation": 0.1, "scale": [1.0, 2.0]}
    use = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": moved}}
    material = {
        "name": "paint", "alphaMode": "MASK", "alphaCutoff": 0.5, "emissiveFactor": [0, 0, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}},
        "normalTexture": {**use, "scale": 1.0}, "occlusionTexture": {**use, "strength": 1.0},
        "pbrMetallicRoughness": {
            "baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0.5, "roughnessFactor": 0.5,
            "baseColorTexture": use,
        },
    }  # fmt: skip
    attributes = {
        "POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3, "COLOR_0": 4, "TANGENT": 5, "_HEAT": 3,
    }  # fmt: skip
    primitive = {"attributes": attributes, "indices": 1, "material": 0, "mode": 4}
    light = {
        "type": "spot", "color": [1, 1, 1], "intensity": 9.0, "range": 5.0,
        "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5},
    }  # fmt: skip
    return {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"mesh": 0, "rotation": [0, 0, 0, 1], "scale": [1, 1, 1], "translation": [0, 0, 0],
             "children": [2, 3]},
            {"camera": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"camera": 1},
        ],
        "meshes": [{"name": "square", "primitives": [primitive]}],
        "materials": [material],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 10497, "wrapT": 33071, "magFilter": 9729, "minFilter": 9987}],
        "images": [{"bufferView": 8, "name": "picture"}],
        "cameras": [
            {"type": "orthographic", "orthographic": {"ymag": 1, "znear": 0.1, "zfar": 100}},
            {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1, "zfar": 100.0}},
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content), "uri": uri}],
    }  # fmt: skip


def places(value, place=()):
    """Yield the keys that lead to every value of a document."""
    if place:
        yield place
    if not isinstance(value, (dict, list)):
        return
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield from places(part, (*place, key))


def put(found, place, value):
    """Replace a value of a document, or take it away."""
    *path, last = place
    for key in path:
        found = found[key]
    if value is MISSING:
        del found[last]
    else:
        found[last] = value


def load(path, content):
    """Return the scene, or None, and all that was said."""
    path.write_text(json.dumps(content))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            return rj.load(path), [str(one.message) for one in caught]
        except MeshFileError as error:
            return None, [str(error), *(str(one.message) for one in caught)]


def test_the_file_itself_is_whole(tmp_path):
    scene, said = load(tmp_path / "a.gltf", document())
    assert said == [f"{tmp_path / 'a.gltf'}: left out further camera (1); the rest is there"]
    assert scene.nodes[0].mesh.vertices[1].tolist() == [1.0, 0.0, 0.0]
    assert scene.nodes[0].mesh.material.occlusion_texture is not None
    assert (len(scene.lights), type(scene.camera)) == (1, rj.PerspectiveCamera)


@pytest.mark.parametrize("section", [key for key in document() if key != "asset"] + ["asset"])
def test_whatever_stands_in_the_place_of_whatever_is_named_in_our_words(tmp_path, section):
    whole, path = document(), tmp_path / "a.gltf"
    named = [place for place in places(whole[section], (section,)) if place[-1] != "uri"]
    for number, place in enumerate(named):
        # Every other value at each place, the others at the next.
        for bad in (*BAD, MISSING)[number % 2 :: 2]:
            changed = copy.deepcopy(whole)
            put(changed, place, bad)
            for text in load(path, changed)[1]:
                assert text.startswith(str(path)), (place, bad)
                assert not RAW.search(text.removeprefix(str(path))), (place, bad, text)


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ("nodes.0.rotation", [1, 2], "node 0: rotation must be 4 numbers, got [1, 2]"),
        ("nodes.0.translation.1", "x", 'node 0: translation must be 3 finite numbers, got "x"'),
        ("nodes.0.scale", 2, "node 0: scale must be 3 numbers, got 2"),
        ("nodes.0.rotation.0", 1e308, "node 0: rotation must be a unit quaternion, got [1e+308, "),
        ("nodes.1.matrix", [1] * 15, "node 1: matrix must be 16 numbers, got [1, 1, "),
        ("nodes.1.matrix.3", math.nan, "node 1: matrix must be 16 finite numbers, got NaN"),
        ("nodes.0.children.0", 9, "node 0: children must be below 4, got 9"),
        ("scenes.0.nodes.0", -1, "scene: nodes must be a whole number at least 0, got -1"),
        ("scene", 5, "scene must be below 1, got 5"),
        ("nodes", {"a": 1}, 'nodes must be a list, got {"a": 1}'),
        ("nodes.2", 7, "node 2 must be an object, got 7"),
        ("accessors.0.count", 5, "accessor 0: 5 rows, the first at byte 0, 12 bytes each, must end "
         "within the 48 bytes of buffer view 0, but end at 60"),
        ("accessors.0.count", 10**30, "must end within the 48 bytes of buffer view 0"),
        ("accessors.0.count", 3.5, "accessor 0: count must be a whole number at least 0, got 3.5"),
        ("accessors.0.componentType", 7, "componentType must be one of 5120, 5121, 5122, 5123, 5125"
         ", 5126, got 7"),
        ("accessors.0.type", "VEC9", 'type must be one of SCALAR, VEC2, VEC3, VEC4, MAT4, got "V'),
        ("accessors.0.sparse.count", 5, "accessor 0: sparse: count must be at most 4, got 5"),
        ("accessors.0.sparse.indices.bufferView", 8, "sparse indices must be below 4, got "),
        ("meshes.0.primitives.0.attributes.POSITION", MISSING, "POSITION is missing"),
    ],
)  # fmt: skip
def test_a_value_that_stops_the_file_is_named_with_what_it_must_be(tmp_path, place, value, said):
    changed = document()
    keys = [int(key) if key.isdigit() else key for key in place.split(".")]
    put(changed, keys, value)
    scene, (text, *_) = load(tmp_path / "a.gltf", changed)
    assert scene is None
    assert text.startswith(str(tmp_path / "a.gltf"))
    assert said in text


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ("materials.0.pbrMetallicRoughness.roughnessFactor", "x",
         "material 'paint', which is damaged: roughnessFactor must be a number, got \"x\""),
        ("materials.0.emissiveFactor", [1], "emissiveFactor must be 3 numbers, got [1]"),
        ("materials.0.normalTexture.extensions.KHR_texture_transform.offset", ["a", 1],
         'normal_texture of material \'paint\' that cannot be read: offset must be 2 finite numbers'
         ', got "a"'),
        ("cameras.1.perspective.yfov", "x", 'yfov must be a finite number, got "x"'),
        ("cameras.1.type", 3, "type must be orthographic or perspective, got 3"),
        ("extensions.KHR_lights_punctual.lights.0.color", [1, 2], "color must be 3 numbers, got "),
        ("extensions.KHR_lights_punctual.lights.0.range", "x", "range must be a finite number"),
    ],
)  # fmt: skip
def test_a_value_that_is_left_out_is_named_with_what_it_must_be(tmp_path, place, value, said):
    changed = document()
    keys = [int(key) if key.isdigit() else key for key in place.split(".")]
    put(changed, keys, value)
    (tmp_path / "a.gltf").write_text(json.dumps(changed))
    with pytest.warns(LoadWarning, match=re.escape(said)):
        assert rj.load(tmp_path / "a.gltf").nodes
