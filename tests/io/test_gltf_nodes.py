"""EXT_mesh_gpu_instancing, KHR_node_visibility and KHR_mesh_quantization."""

import sys
import warnings

import numpy as np
import pytest
from gltf_drafts import CORNERS, NORMAL, POSITION, TEXCOORD, Draft, quad

import rasterjit as rj
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.resources import Resources
from rasterjit.scene.memory_limits import FileSizeError

INSTANCING = "EXT_mesh_gpu_instancing"
SHIFTS = np.float32([[0, 0, 0], [3, 0, 0], [0, 4, 0]])
HALF = np.sqrt(0.5)
TURNS = np.float32([[0, 0, 0, 1], [0, 0, HALF, HALF], [0, 0, 1, 0]])
SCALES = np.float32([[1, 1, 1], [2, 1, 1], [1, 1, 3]])


def instanced(**attributes):
    """Return a file with instances below a node that is moved itself."""
    file = Draft().use(INSTANCING)
    numbers = {
        name: file.accessor(rows, **({"normalized": True} if rows.dtype.kind == "i" else {}))
        for name, rows in attributes.items()
    }
    file.show(file.mesh(quad()), translation=[0, 0, 5], scale=[2, 2, 2], name="field",
              extensions={INSTANCING: {"attributes": numbers}})  # fmt: skip
    return file


def load(file, tmp_path):
    """Load a file that warns of nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return rj.load(file.save(tmp_path / "a.glb"))


@pytest.mark.parametrize("kind", [np.float32, np.int8, np.int16])
def test_instances_are_nodes_below_theirs(tmp_path, kind):
    turns = TURNS if kind is np.float32 else np.round(TURNS * np.iinfo(kind).max).astype(kind)
    scene = load(instanced(TRANSLATION=SHIFTS, ROTATION=turns, SCALE=SCALES), tmp_path)
    group, *nodes = scene.every_node()
    assert (group.mesh, group.name) == (None, "field")
    assert [node.name for node in nodes] == [f"field instance {n}" for n in (1, 2, 3)]
    assert len({id(node.mesh) for node in nodes}) == 1
    t = rj.transforms
    below = t.compose(t.translate((0, 0, 5)), t.scale(2))
    for node, shift, degrees, scale in zip(nodes, SHIFTS, (0, 90, 180), SCALES, strict=True):
        own = t.compose(t.translate(shift), t.rotate_z(degrees), t.scale(scale))
        atol = {np.float32: 1e-6, np.int8: 0.05, np.int16: 2e-4}[kind]
        np.testing.assert_allclose(node.world_matrix, t.compose(below, own), atol=atol)


def test_each_property_of_an_instance_may_be_missing(tmp_path):
    for rows in ({"TRANSLATION": SHIFTS}, {"ROTATION": TURNS}, {"SCALE": SCALES, "_ID": SHIFTS}):
        assert len(load(instanced(**rows), tmp_path).nodes) == 3


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"TRANSLATION": SHIFTS, "SCALE": SCALES[:2]}, "must be of one length"),
        ({"ROTATION": SHIFTS}, "ROTATION must be 4 numbers, got 3"),
        ({"_ID": SHIFTS}, "must be of one length, got none"),
        ({"TRANSLATION": SHIFTS * np.nan}, "translation must be 3 finite numbers"),
    ],
)
def test_damaged_instances_are_left_out_by_name(tmp_path, attributes, said):
    path = instanced(**attributes).save(tmp_path / "a.glb")
    with pytest.warns(rj.LoadWarning, match=f"left out {INSTANCING} of node 0: .*{said}"):
        assert len(rj.load(path).nodes) == 1


def test_instances_count_in_the_memory_that_a_file_may_take(tmp_path):
    file = instanced(TRANSLATION=SHIFTS)
    del file.header["accessors"][0]["bufferView"]
    file.header["accessors"][0]["count"] = 1 << 22
    with pytest.raises(FileSizeError, match="instances"):
        rj.load(file.save(tmp_path / "a.glb"))


def test_invisible_nodes_and_those_below_are_not_shown(tmp_path):
    file = Draft().use("KHR_node_visibility", "KHR_lights_punctual")
    mesh = file.mesh(quad())
    file.header["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    camera = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    file.add("cameras", **camera)

    def said(is_visible):
        return {"KHR_node_visibility": {"visible": is_visible}}

    file.show(mesh, name="seen", extensions=said(True))
    file.show(mesh, name="hidden", extensions=said(False), children=[2, 3, 4])
    file.show(mesh, name="below", extensions=said(True))
    file.add("nodes", extensions={"KHR_lights_punctual": {"light": 0}})
    file.add("nodes", camera=0)
    scene = load(file, tmp_path)
    assert [node.name for node in scene.every_node()] == ["seen"]
    assert scene.lights == []
    # Visibility affects no cameras.
    assert scene.camera is not None


def quantised(rows, kind, normalized):
    """Return rows of -1..1 or 0..1 as whole numbers, and what they stand for."""
    most = np.iinfo(kind).max
    whole = np.round(rows * (most if normalized else 40)).astype(kind)
    return whole, np.maximum(whole / most, -1.0) if normalized else whole.astype(np.float64)


@pytest.mark.parametrize("normalized", [False, True])
@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint16])
def test_quantised_positions_and_coordinates(tmp_path, kind, normalized):
    file = Draft().use("KHR_mesh_quantization", required=True)
    points = POSITION if kind in (np.int8, np.int16) else np.abs(POSITION) * TEXCOORD[:, [0, 1, 0]]
    points, wanted = quantised(points, kind, normalized)
    uv, wanted_uv = quantised(TEXCOORD, kind, normalized)
    normals, _ = quantised(NORMAL, np.int8, True)
    attributes = {
        "POSITION": file.accessor(points, normalized=normalized),
        "TEXCOORD_0": file.accessor(uv, normalized=normalized),
        "NORMAL": file.accessor(normals, normalized=True),
        "TANGENT": file.accessor(np.int16([[32767, 0, 0, 32767]] * 4), normalized=True),
    }
    file.show(file.mesh(attributes, CORNERS))
    mesh = load(file, tmp_path).nodes[0].mesh
    np.testing.assert_array_equal(mesh.vertices, wanted.astype(np.float32))
    np.testing.assert_allclose(mesh.uv, np.column_stack([wanted_uv[:, 0], 1 - wanted_uv[:, 1]]),
                               rtol=1e-6)  # fmt: skip
    np.testing.assert_array_equal(mesh.normals, NORMAL)


@pytest.mark.parametrize("kind", [np.int8, np.int16])
def test_the_lowest_normalized_number_is_minus_one(tmp_path, kind):
    file = Draft().use("KHR_mesh_quantization")
    low, high = np.iinfo(kind).min, np.iinfo(kind).max
    points = kind([[low, low, 0], [high, low, 0], [high, high, 0], [low + 1, high, 0]])
    file.show(file.mesh({"POSITION": file.accessor(points, normalized=True)}))
    mesh = load(file, tmp_path).nodes[0].mesh
    np.testing.assert_array_equal(mesh.vertices[:, 0].min(), -1.0)
    assert np.abs(mesh.vertices).max() == 1.0


@pytest.mark.parametrize("normalized", [False, True])
@pytest.mark.parametrize("width", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint16, np.uint32])
def test_accessors_of_every_type(tmp_path, kind, width, normalized):
    """As joints, weights and the targets of morphs have them, and what is sparse."""
    held = np.iinfo(kind)
    rows = np.linspace(held.min, held.max, 6 * width).round().astype(kind).reshape(6, width)
    file = Draft()
    file.accessor(rows, normalized=normalized)
    changed = rows[::-1].copy()
    places = np.uint8([0, 2, 5])
    sparse = {
        "count": 3, "indices": {"bufferView": file.view(places.tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(changed[places].tobytes())},
    }  # fmt: skip
    base = file.header["accessors"][0]["bufferView"]
    file.say(rows, normalized=normalized, bufferView=base, sparse=sparse)
    path = file.save(tmp_path / "a.glb")
    found = GltfFile(path, Resources(path))
    mixed = rows.copy()
    mixed[places] = changed[places]
    for number, whole in enumerate((rows, mixed)):
        wanted = np.maximum(whole / held.max, -1.0) if normalized else whole
        np.testing.assert_array_equal(found.read_array(number), wanted)


def lines_run(action):
    """Return how many lines of the package an action runs."""
    counts = [0]

    def trace(frame, event, _):
        if "rasterjit" not in frame.f_code.co_filename:
            return None
        counts[0] += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        action()
    finally:
        sys.settrace(before)
    return counts[0]


def read_chain(tmp_path, count, **each):
    file = Draft().use("KHR_lights_punctual")
    mesh = file.mesh(quad())
    file.header["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    for number in range(count):
        below = {"children": [number + 1]} if number + 1 < count else {"mesh": mesh}
        file.add("nodes", translation=[1, 0, 0], **{**each, **below})
    file.header["scenes"] = [{"nodes": [0]}]
    return load(file, tmp_path)


@pytest.mark.parametrize("each", [
    {}, {"mesh": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}},
])  # fmt: skip
def test_reading_a_chain_of_nodes_takes_work_by_its_length(tmp_path, each):
    few = lines_run(lambda: read_chain(tmp_path, 100, **each))
    many = lines_run(lambda: read_chain(tmp_path, 400, **each))
    assert many < 5 * few
    scene = read_chain(tmp_path, 50, **each)
    assert scene.nodes[-1].world_matrix[0, 3] == 50.0
    for number, light in enumerate(scene.lights):
        assert light.position == (number + 1.0, 0.0, 0.0)
