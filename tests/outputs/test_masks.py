"""Masks are coded as COCO codes them: by an obvious twin, and by pycocotools."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from opengl import optional_module

import rasterjit as rj
from rasterjit.outputs import masks

reads_with_pycocotools = pytest.mark.filterwarnings("ignore:__array__ impl:DeprecationWarning")
"""pycocotools 2.0.11 itself asks NumPy 2 for an array in the way of NumPy 1."""

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 9))


def naive_counts(mask):
    """Walk down each column, counting."""
    counts, inside, run = [], False, 0
    for column in range(mask.shape[1]):
        for row in range(mask.shape[0]):
            if mask[row, column] != inside:
                counts.append(run)
                inside, run = not inside, 0
            run += 1
    return [*counts, run]


def naive_text(counts):
    """Write each number bit by bit, lowest first, until only its sign is left."""
    text = ""
    for i, count in enumerate(counts):
        number = count - counts[i - 2] if i > 2 else count
        while True:
            group = number % 32
            number = (number - group) // 32
            is_last = number == (-1 if group >= 16 else 0)
            text += chr(48 + group + (0 if is_last else 32))
            if is_last:
                break
    return text


def naive_mask(rle):
    """Fill the pixels one after the other."""
    height, width = rle["size"]
    flat = [inside % 2 for inside, run in enumerate(rle["counts"]) for _ in range(run)]
    assert len(flat) == height * width
    return np.array(
        [[flat[column * height + row] for column in range(width)] for row in range(height)], bool
    )


@settings(max_examples=150)
@given(arrays.arrays(bool, SHAPES))
def test_codes_are_those_of_the_obvious_twin(mask):
    found = masks.encode(mask)
    assert found.rle() == {"size": list(mask.shape), "counts": naive_counts(mask)}
    assert found.compressed_rle()["counts"] == naive_text(naive_counts(mask))
    assert np.array_equal(naive_mask(found.rle()), mask)
    assert np.array_equal(masks.decode(found.compressed_rle()), mask)
    assert np.array_equal(found.array(), mask)
    rows, columns = np.nonzero(mask)
    assert found.area == len(rows)
    if found.area:
        left, top = columns.min(), rows.min()
        assert found.box == (left, top, columns.max() - left + 1, rows.max() - top + 1)
    else:
        assert found.box == (0, 0, 0, 0)


@settings(max_examples=150)
@given(arrays.arrays(np.int32, SHAPES, elements=st.integers(-1, 4)))
def test_masks_of_an_image_share_out_its_pixels(ids):
    found = masks.find(ids)
    assert [mask.id for mask in found] == sorted(set(ids[ids >= 0].tolist()))
    for mask in found:
        assert np.array_equal(mask.array(), ids == mask.id)
        assert mask.rle()["counts"] == naive_counts(ids == mask.id)
        assert mask.area == (ids == mask.id).sum()


@settings(max_examples=100)
@given(st.lists(st.one_of(st.integers(0, 40), st.integers(0, 2**40)), max_size=12))
def test_compressed_counts_come_back(counts):
    text = masks.compress(np.array(counts, np.int64))
    assert text == naive_text(counts)
    assert masks.decompress(text).tolist() == masks.decompress(text.encode()).tolist() == counts


@reads_with_pycocotools
@pytest.mark.parametrize("seed", range(4))
def test_pycocotools_reads_and_writes_the_same(seed):
    optional_module("pycocotools")
    from pycocotools import mask as reference

    rng = np.random.default_rng(seed)
    blobs = rng.random((90, 140)) < 0.02
    for _ in range(3 * seed):
        blobs |= np.roll(blobs, 1, axis=seed % 2) | np.roll(blobs, -1, axis=0)
    found = masks.encode(blobs)
    expected = reference.encode(np.asfortranarray(blobs.astype(np.uint8)))
    assert found.compressed_rle()["counts"].encode() == expected["counts"]
    assert list(expected["size"]) == list(found.size)
    assert np.array_equal(reference.decode(found.compressed_rle()).astype(bool), blobs)
    packed = reference.frPyObjects(found.rle(), *found.size)
    assert packed["counts"] == expected["counts"]
    assert reference.area(expected) == found.area
    assert reference.toBbox(expected).tolist() == list(found.box)


def scene_of_three(cube):
    scene = rj.Scene()
    for place in (-3.0, 0.0, 3.0):
        scene.add(cube, rj.transforms.translate((place, 0.0, 0.0)))
    return scene


@pytest.fixture
def frame(cube):
    view = rj.PerspectiveCamera((0.5, 2.0, 9.0), (0.0, 0.0, 0.0))
    return rj.render(scene_of_three(cube), view, size=(48, 32), outputs="object_id", threads=1)


def test_a_frame_has_the_masks_of_its_objects(frame):
    found = frame.masks()
    assert [mask.id for mask in found] == [0, 1, 2]
    for mask in found:
        assert np.array_equal(mask.array(), frame.object_id == mask.id)
    with pytest.raises(rj.OutputNotRequestedError, match="face_id"):
        frame.masks("face_id")


def test_an_annotation_file_is_what_coco_reads(frame, tmp_path):
    path = tmp_path / "instances.json"
    pictures = [("a.png", frame.object_id), ("b.png", np.full((8, 9), -1))]
    rj.masks.save_coco(path, pictures, {0: "cup", 1: None, 2: "plate"}, info={"version": "1"})
    assert [place.name for place in tmp_path.iterdir()] == ["instances.json"]
    document = json.loads(path.read_text())
    assert document["info"] == {"version": "1"}
    assert document["categories"] == [{"id": 1, "name": "cup"}, {"id": 2, "name": "plate"}]
    assert document["images"] == [
        {"id": 1, "file_name": "a.png", "width": 48, "height": 32},
        {"id": 2, "file_name": "b.png", "width": 9, "height": 8},
    ]
    assert [a["id"] for a in document["annotations"]] == [1, 2]
    for annotation, number, category in zip(document["annotations"], (0, 2), (1, 2), strict=True):
        mask = frame.object_id == number
        assert annotation["image_id"] == 1
        assert annotation["iscrowd"] == 0
        assert (annotation["object_id"], annotation["category_id"]) == (number, category)
        assert np.array_equal(masks.decode(annotation["segmentation"]), mask)
        assert annotation["area"] == mask.sum()
        left, top, width, height = annotation["bbox"]
        inner = mask[top : top + height, left : left + width]
        assert inner.sum() == mask.sum()
        assert inner.any(axis=0).all()


@pytest.mark.parametrize(
    ("categories", "unsaid"),
    [(["cup", "plate"], "2"), ({0: "cup", 1: None}, "2"), ({}, "0, 1, 2")],
)
def test_an_object_that_no_category_is_said_of_is_refused(frame, tmp_path, categories, unsaid):
    with pytest.raises(ValueError, match=rf"'a.png' shows.* None to leave.* none for {unsaid}$"):
        rj.masks.save_coco(tmp_path / "a.json", [("a.png", frame.object_id)], categories)
    assert not list(tmp_path.iterdir())


@reads_with_pycocotools
def test_pycocotools_opens_the_annotation_file(frame, tmp_path):
    optional_module("pycocotools")
    from pycocotools.coco import COCO

    rj.masks.save_coco(tmp_path / "a.json", [("a.png", frame.object_id)], ["x", "y", "x"])
    opened = COCO(str(tmp_path / "a.json"))
    assert opened.getCatIds(catNms=["x"]) == [1]
    for annotation in opened.loadAnns(opened.getAnnIds(imgIds=[1])):
        expected = frame.object_id == annotation["object_id"]
        assert np.array_equal(opened.annToMask(annotation).astype(bool), expected)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: masks.find(np.ones((2, 2))), "ids"), (lambda: masks.find([1, 2]), "ids"),
        (lambda: masks.find(np.zeros((0, 2), int)), "ids"), (lambda: masks.encode([[1]]), "mask"),
        (lambda: masks.decode({"size": [2, 2]}), "rle"), (lambda: masks.decode(7), "rle"),
        (lambda: masks.decode({"size": [2, 2], "counts": [3]}), "rle"),
        (lambda: masks.decode({"size": [1, 1], "counts": [-1, 2]}), "rle"),
        (lambda: masks.decode({"size": [1, 1], "counts": "~~"}), "rle"),
        (lambda: masks.decompress("P"), "text"), (lambda: masks.compress([-1]), "counts"),
        (lambda: masks.coco([("a", [[0]])], "cup"), "categories"),
        (lambda: masks.coco([("a", [[0]])], {"0": "cup"}), "categories"),
        (lambda: masks.coco([("a", [[0]])], {0: ""}), "categories"),
        (lambda: masks.coco([7], ["cup"]), "images"),
        (lambda: masks.coco([(7, [[0]])], ["cup"]), "images"),
        (lambda: masks.coco([("a", [0])], ["cup"]), "^images: the numbers of 'a' must be "),
        (
            lambda: masks.coco([("a", [[0]]), ("b.png", np.ones((2, 3), bool))], ["cup"]),
            r"^images: the numbers of 'b.png' must be .*; got an array of bool with shape \(2, 3\)",
        ),
        (lambda: masks.save_coco("a.txt", [], []), "path"),
    ],
)  # fmt: skip
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_an_output_of_no_numbers_of_things_is_refused_by_the_argument(cube):
    frame = rj.render(cube, size=(8, 6), outputs=("color", "depth", "face_id"))
    for name in ("color", "depth"):
        with pytest.raises(ValueError, match=f"^output must be one of 'face_id', .*got '{name}'$"):
            frame.masks(name)
    assert frame.masks("face_id")


def test_paths_are_names_of_images(tmp_path):
    image = Path("left") / "a.png"
    masks.save_coco(tmp_path / "a.json", [(image, [[0, 1]])], ["cup", None])
    assert json.loads((tmp_path / "a.json").read_text())["images"][0]["file_name"] == "left/a.png"


def test_a_mask_is_shown_in_short():
    speckled = np.random.default_rng(4).random((400, 300)) < 0.5
    mask = rj.masks.encode(speckled)
    assert repr(mask) == (
        f"ObjectMask(1: {speckled.sum()} of 300 x 400 pixels, box (0, 0, 300, 400))"
    )


@pytest.mark.parametrize(
    "text",
    [5, None, 3.5, [48], "o" * 40 + "0", "ooooooooooooo0", b"\xff", "0\u20ac", "oooooooooooo?"],
)
def test_what_is_no_compressed_mask_is_refused(text):
    with pytest.raises(ValueError, match="text must be a"):
        rj.masks.decompress(text)


@pytest.mark.parametrize(
    "rle",
    [
        {"size": [2, 2], "counts": "o" * 40 + "0"}, {"size": [2, 2], "counts": [2**70]},
        {"size": [2, 2], "counts": [2.5, 1.5]}, {"size": [2, 2], "counts": None},
        {"size": [np.inf, 2], "counts": [4]}, {"size": [-2, -2], "counts": [4]},
        {"size": [2, 2], "counts": [2**62] * 4 + [4]}, {"size": 4, "counts": [4]},
        [1], 5, None, "a",
    ],
    ids=repr,
)  # fmt: skip
def test_what_is_no_code_of_a_mask_is_refused(rle):
    with pytest.raises(ValueError, match="rle must h"):
        rj.masks.decode(rle)
