"""A program of twenty lines: masks of objects as a COCO annotation, their error in pixels."""

import json

import numpy as np
import pytest
from opengl import optional_module

import rasterjit as rj

SIZE = (320, 240)
K = np.array([[300.0, 0.0, 155.3], [0.0, 305.0, 121.8], [0.0, 0.0, 1.0]])
CARDS = {"near": (0.3, 0.1, 0.6), "left": (-1.1, 0.4, 0.0), "right": (0.9, -0.5, -0.4)}
"""Centres of squares of side 1.6 that face +z."""
HALF = 0.8


def pose():
    """OpenCV's camera from world: y down, z forward, turned about all axes."""
    back = rj.transforms.look_at((0.7, 1.0, 5.0), (0.1, 0.0, 0.0), (0.1, 1.0, 0.0))
    return np.diag([1.0, -1.0, -1.0, 1.0]) @ back


def annotate(folder):
    """Draw the cards before a wall, and write the picture and where each card is seen."""
    # The program.
    square = HALF * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    scene = rj.Scene()
    scene.add(rj.Mesh(10.0 * square - (0.0, 0.0, 2.0), [(0, 1, 2), (0, 2, 3)]), name="wall")
    for name, centre in CARDS.items():
        colors = np.random.default_rng(len(name)).integers(0, 256, (4, 3), np.uint8)
        card = rj.Mesh(square, [(0, 1, 2), (0, 2, 3)], colors=colors)
        scene.add(card, rj.transforms.translate(centre), name=name)
    camera = rj.cameras.from_opencv(K, SIZE, camera_from_world=pose())
    frame = rj.render(scene, camera, size=SIZE, outputs=("color", "object_id"))
    frame.save(folder / "picture.jpg")
    categories = [None, *CARDS]  # the wall is no object to be found
    pictures = [("picture.jpg", frame.object_id)]
    rj.masks.save_coco(folder / "instances.json", pictures, categories)


def seen_cards():
    """Return which card the ray through each pixel's centre meets first, (H, W); -1 for none."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    rotation, place = pose()[:3, :3], pose()[:3, 3]
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    along = pixels @ np.linalg.inv(K).T @ rotation
    eye = -rotation.T @ place
    nearest, found = np.full(rows.shape, np.inf), np.full(rows.shape, -1)
    for number, (x, y, z) in enumerate(CARDS.values()):
        distance = (z - eye[2]) / along[..., 2]
        hit = eye + distance[..., None] * along
        is_met = (np.abs(hit[..., :2] - (x, y)) <= HALF).all(axis=-1) & (distance < nearest)
        nearest[is_met], found[is_met] = distance[is_met], number
    return found


def decoded(rle):
    """Return the mask of compressed run lengths by the formula of COCO's ``maskApi``."""
    lengths, text = [], [ord(letter) - 48 for letter in rle["counts"]]
    while text:
        value = shift = 0
        while True:
            group = text.pop(0)
            value |= (group & 31) << shift
            shift += 5
            if not group & 32:
                break
        value -= (1 << shift) if group & 16 else 0
        lengths.append(value + (lengths[-2] if len(lengths) > 2 else 0))
    runs = np.repeat(np.arange(len(lengths)) % 2, lengths)
    return runs.reshape(rle["size"][::-1]).T.astype(bool)


def check(masks, annotations):
    """Compare decoded masks with where the cards are seen, and their boxes and areas."""
    seen = seen_cards()
    assert len(annotations) == len(CARDS)
    for annotation, mask in zip(annotations, masks, strict=True):
        want = seen == annotation["object_id"] - 1
        assert annotation["category_id"] == annotation["object_id"]
        assert want.sum() > 3000
        assert np.count_nonzero(mask != want) == 0  # the error, in pixels
        rows, columns = want.nonzero()
        low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
        assert annotation["bbox"] == [*low, *(high - low + 1)]
        assert annotation["area"] == want.sum()


def test_the_masks_of_an_annotation_are_where_the_objects_are_seen(tmp_path):
    annotate(tmp_path)
    document = json.loads((tmp_path / "instances.json").read_text())
    assert [kind["name"] for kind in document["categories"]] == list(CARDS)
    annotations = document["annotations"]
    check([decoded(one["segmentation"]) for one in annotations], annotations)


@pytest.mark.filterwarnings("ignore:__array__ impl:DeprecationWarning")
def test_pycocotools_reads_the_same_masks(tmp_path):
    optional_module("pycocotools")
    from pycocotools.coco import COCO

    annotate(tmp_path)
    opened = COCO(str(tmp_path / "instances.json"))
    annotations = opened.loadAnns(opened.getAnnIds())
    check([opened.annToMask(one).astype(bool) for one in annotations], annotations)
