"""Labels are drawn over the finished picture where they stand, and nowhere else."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import io
import math
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.distributed import render_partitions
from rasterjit.effects.label import LABELS, find_box
from rasterjit.io import fonts, text_layout
from rasterjit.rendering.regions import RegionRenderer
from rasterjit.scene.color import linear_to_srgb, srgb_to_linear
from rasterjit.scene.label import ANCHORS

SIZE = (96, 64)
FRONT = rj.PerspectiveCamera(eye=(0, 0, 10), target=(0, 0, 0), near=0.5, far=50.0)
"""The middle of its picture is the origin, between four pixels."""

FONT = fonts.load_shipped_font()
GLYPHS = FONT.characters
FONT_HASH = "69853909b940023570964e29cffe30da95aea8de3627736b5cd15ab30143169f"


def scene_of(cube, *labels):
    scene = rj.Scene()
    scene.add(cube)
    for label in labels:
        scene.add(label)
    return scene


def shown(scene, camera=FRONT, **options):
    return rj.render(scene, camera, **{"size": SIZE, "threads": 1, **options})


def touched(scene, camera=FRONT, **options):
    """Which pixels labels change, (H, W) bool."""
    without = shown(LABELS.without(scene), camera, **options).color
    return (shown(scene, camera, **options).color != without).any(axis=2)


def columns_and_rows(mask):
    """First and last column and row that is set."""
    rows, columns = np.nonzero(mask)
    return columns.min(), columns.max(), rows.min(), rows.max()


# The font, and what its outlines cover.


def test_the_font_is_the_one_that_pixels_are_promised_for():
    found = FONT
    assert (found.em, found.ascent, found.descent, found.line_gap) == (1000, 970, 230, 0)
    from PIL import ImageFont

    assert hashlib.sha256(ImageFont.load_default(20).font_bytes).hexdigest() == FONT_HASH
    printable = "".join(map(chr, range(33, 127)))
    assert len({GLYPHS[ord(one)] for one in printable}) == len(printable)
    assert ord("\N{SNOWMAN}") not in GLYPHS
    assert found.outline(GLYPHS[ord(" ")]) == []


def test_outlines_are_those_of_freetype():
    """Beside FreeType's own, whose hints move edges by a part of a pixel."""
    from PIL import ImageFont

    size = 200
    # The font has no accented letters, which come from another.
    for character in "ABgQ8@&}":
        mask = ImageFont.load_default(size).getmask(character)
        theirs = np.array(mask).reshape(mask.size[::-1])
        theirs = theirs[:, theirs.any(axis=0)]
        own = text_layout.rasterize_glyph(FONT, GLYPHS[ord(character)], float(size), 0).coverage
        assert np.abs(np.subtract(own.shape, theirs.shape)).max() <= 2
        assert own.sum() == pytest.approx(theirs.sum(), rel=0.02)


def write_font(place, glyphs, *, postscript=False, kern=None, names=("Made", "Regular")):
    """Write a font whose glyphs are squares of some sizes, by character."""
    from fontTools.fontBuilder import FontBuilder
    from fontTools.pens.t2CharStringPen import T2CharStringPen
    from fontTools.pens.ttGlyphPen import TTGlyphPen

    order = [".notdef", *(f"g{ord(one):X}" for one in glyphs)]
    builder = FontBuilder(1000, isTTF=not postscript)
    builder.setupGlyphOrder(order)
    builder.setupCharacterMap({ord(one): f"g{ord(one):X}" for one in glyphs})
    drawn = {}
    for name, side in zip(order, (500, *glyphs.values()), strict=True):
        pen = T2CharStringPen(side, None) if postscript else TTGlyphPen(None)
        pen.moveTo((0, 0))
        for corner in ((0, side), (side, side), (side, 0)):
            pen.lineTo(corner)
        pen.closePath()
        drawn[name] = pen.getCharString() if postscript else pen.glyph()
    builder.setupCFF("Made", {}, drawn, {}) if postscript else builder.setupGlyf(drawn)
    builder.setupHorizontalMetrics({name: (1000, 0) for name in order})
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": names[0], "styleName": names[1]})
    builder.setupOS2()
    builder.setupPost()
    if kern:
        builder.addOpenTypeFeatures("feature kern {" + kern + "} kern;")
    builder.save(str(place))
    return place


def test_a_font_may_be_given_by_its_file(tmp_path, cube):
    for postscript, suffix in ((False, "ttf"), (True, "otf")):
        place = write_font(
            tmp_path / f"made.{suffix}", {"A": 500, "\u6f22": 750}, postscript=postscript
        )
        for text, side in (("A", 10), ("\u6f22", 15)):
            mask = touched(scene_of(cube, rj.Label((0, 0, 0), text, size=20, font=place)))
            left, right, top, bottom = columns_and_rows(mask)
            assert (right - left + 1, bottom - top + 1) == (side, side)


@pytest.mark.parametrize(
    "kern", ["pos A B -250; pos B A 100;", "@a = [A]; @b = [B C]; pos @a @b -250; pos B A 100;"]
)
def test_neighbours_are_kerned(tmp_path, kern):
    kern = kern.replace("A", "g41").replace("B", "g42").replace("C", "g43")
    place = write_font(tmp_path / "made.ttf", dict.fromkeys("ABC", 500), kern=kern)
    found = fonts.find_font(place)
    numbers = [found.characters[ord(one)] for one in "ABC"]
    assert [found.kerning(numbers[0], one) for one in numbers[:2]] == [0, -250]
    assert found.kerning(numbers[1], numbers[0]) == 100
    assert text_layout.lay_out("AB", 100.0, font=place).width == 175
    assert text_layout.lay_out("BA", 100.0, font=place).width == 210


def test_kerning_is_that_of_freetype():
    """Beside FreeType's by Raqm, of the font that Pillow ships, where this Pillow has Raqm."""
    from PIL import ImageFont, features

    if not features.check("raqm"):
        pytest.skip("this Pillow has no Raqm")
    own = ImageFont.load_default(1000)
    theirs = ImageFont.truetype(
        io.BytesIO(own.font_bytes), 1000, layout_engine=ImageFont.Layout.RAQM
    )
    for pair in ("AV", "To", "nn", "P,", "LT"):
        units = FONT.kerning(*(GLYPHS[ord(one)] for one in pair))
        found = theirs.getlength(pair) - sum(map(theirs.getlength, pair))
        assert units == pytest.approx(found, abs=1.0), pair


@pytest.mark.parametrize("text", ["שלום", "10 مرحبا"])
def test_texts_that_run_from_right_to_left_are_warned_of(text):
    scene = rj.Scene()
    scene.add(rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]))
    scene.add(rj.Label((0.2, 0.2, 0.0), text))
    with pytest.warns(UserWarning, match="is of a script that runs from right to left"):
        rj.render(scene, size=(64, 48))


def test_every_kind_of_space_is_as_wide_as_a_space():
    usual = text_layout.lay_out("a b", 20.0)
    assert text_layout.lay_out("a\u00a0b", 20.0) == text_layout.lay_out("a\u202fb", 20.0) == usual


def test_what_a_font_lacks_comes_from_another(tmp_path, monkeypatch):
    snow = write_font(tmp_path / "snow.ttf", {"\N{SNOWMAN}": 700}, names=("Snow", "Book"))
    monkeypatch.setattr(fonts, "list_font_files", lambda: (str(snow),))
    fonts.find_font_with.cache_clear()
    text_layout._lay_out.cache_clear()
    try:
        layout = text_layout.lay_out("a\N{SNOWMAN}\N{COMET}\t\x00\u202e", 20.0)
        assert [one.font is FONT for one in layout.glyphs[:3]] == [True, False, True]
        assert layout.missing == "\N{COMET}"
        assert len(layout.glyphs) == 7
        pixels = np.full((40, 90, 3), 255, np.uint8)
        with pytest.warns(UserWarning, match=r"no font has '.' \(U\+2604\).*font="):
            text_layout.draw_text(pixels, "\N{COMET}", (0, 0), 20.0, (0, 0, 0))
        assert fonts.find_font("snow").characters == {0x2603: 1}
        with pytest.raises(ValueError, match=r"font must be .* got 'Rain'"):
            fonts.find_font("Rain")
    finally:
        fonts.find_font_with.cache_clear()
        text_layout._lay_out.cache_clear()


def test_whatever_is_no_control_is_shown_as_a_box_at_least():
    # One of each kind of characters that say nothing, of private ones and of ones without meaning.
    for shown in "\ue000\U000f0001\U0010fffd\ufffe\U0003fffd\udc80\u0378":
        layout = text_layout.lay_out(f"a{shown}b", 20.0)
        assert len(layout.glyphs) == 3
        assert layout.missing == shown * (fonts.find_font_with(shown, FONT) is None)
    assert text_layout.lay_out("\U000f0001", 20.0).missing
    for silent in "\x00\x1b\x85\u00ad\u200d\u202e\ufeff\U000e0041":
        assert (
            text_layout.lay_out(f"a{silent}b", 20.0).width == text_layout.lay_out("ab", 20.0).width
        )


def test_accents_that_stand_alone_are_joined_with_their_letters():
    assert text_layout.lay_out("e\u0301", 20.0) == text_layout.lay_out("\u00e9", 20.0)


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 40, b"ttcf" + b"\xff" * 60, b"OTTO\0\1" + b"x" * 50]
)
def test_what_is_no_font_is_named(tmp_path, content):
    place = tmp_path / "bad.ttf"
    place.write_bytes(content)
    with pytest.raises(ValueError, match=r"font must be a font, got .*bad\.ttf"):
        fonts.find_font(place)
    with pytest.raises(ValueError, match=r"font must be a file that is there, got .*none\.ttf"):
        fonts.find_font(tmp_path / "none.ttf")
    with pytest.raises(ValueError, match="font must be"):
        rj.Label((0, 0, 0), "x", font=3)


def test_a_font_with_a_damaged_table_is_named(tmp_path):
    place = write_font(tmp_path / "bad.ttf", {"A": 500})
    data = bytearray(place.read_bytes())
    # The record of a table: its tag, a sum, where it begins, and its length.
    at = data.index(b"cmap") + 12
    data[at : at + 4] = (3).to_bytes(4, "big")
    place.write_bytes(data)
    with pytest.raises(ValueError, match=r"font must be a font, got .*bad\.ttf"):
        fonts.find_font(place)


def area_in_pixel(polygon, column, row):
    """Signed area of a polygon within a pixel, cut at its sides one by one: the slow twin."""
    for axis, bound, sign in ((0, column, 1), (0, column + 1, -1), (1, row, 1), (1, row + 1, -1)):
        kept = []
        for n, here in enumerate(polygon):
            before = polygon[n - 1]
            inside, was = sign * (here[axis] - bound) >= 0, sign * (before[axis] - bound) >= 0
            if inside != was:
                t = (bound - before[axis]) / (here[axis] - before[axis])
                kept.append([p + t * (q - p) for p, q in zip(before, here, strict=True)])
            if inside:
                kept.append(here)
        polygon = kept
    return (
        sum(
            polygon[n - 1][0] * here[1] - here[0] * polygon[n - 1][1]
            for n, here in enumerate(polygon)
        )
        / 2.0
    )


def lines_of(polygons):
    ends = [np.concatenate([np.roll(one, 1, axis=0), one], axis=1) for one in polygons]
    return np.concatenate(ends).astype(float)


POLYGONS = [
    [[(0, 0), (4, 0), (4, 3), (0, 3)]],
    [[(0.5, 0.25), (3.5, 0.25), (3.5, 2.75), (0.5, 2.75)]],
    [[(0.1, 0.2), (3.9, 1.7), (1.3, 2.9)]],
    [[(1, 0), (4, 3), (0, 1)]],
    # A hole, which turns the other way.
    [[(0, 0), (4, 0), (4, 3), (0, 3)], [(1.2, 0.4), (0.7, 2.6), (3.1, 2.2)]],
    # Less than a pixel, and a line without area.
    [[(2.2, 1.3), (2.4, 1.3), (2.3, 1.7)]],
    [[(0.5, 0.5), (3.5, 2.5), (0.5, 0.5)]],
]


@pytest.mark.parametrize("polygons", POLYGONS)
@pytest.mark.parametrize("turned", [1, -1])
def test_areas_are_those_of_the_slow_twin(polygons, turned):
    polygons = [np.array(one, float)[::turned] for one in polygons]
    found = text_layout.rasterize_area(lines_of(polygons), (3, 4))
    for row in range(3):
        for column in range(4):
            area = sum(area_in_pixel(one.tolist(), column, row) for one in polygons)
            assert found[row, column] == pytest.approx(abs(area), abs=1e-12)


@pytest.mark.parametrize("character", ["8", "W", "%", "g"])
def test_a_glyph_covers_what_its_outlines_enclose(character):
    size, quarter = 13.0, 3
    number = GLYPHS[ord(character)]
    glyph = text_layout.rasterize_glyph(FONT, number, size, quarter)
    pieces = math.ceil(math.sqrt(size))
    polygons = []
    for curves in FONT.outline(number):
        points = []
        for a, b, c in curves:
            for n in range(pieces):
                t = n / pieces
                x, y = (1 - t) * (1 - t) * a + 2 * t * (1 - t) * b + t * t * c
                points.append([0.013 * x + 0.75 - glyph.left, -0.013 * y - glyph.top])
        polygons.append(points)
    for (row, column), code in np.ndenumerate(glyph.coverage):
        area = abs(sum(area_in_pixel(one, column, row) for one in polygons))
        assert abs(code - 255.0 * area) <= 0.5 + 1e-6


# Where texts lie.


@pytest.mark.parametrize("anchor", ANCHORS)
def test_the_anchor_lies_at_the_place(cube, anchor):
    label = rj.Label((0, 0, 0), "Hx", anchor=anchor, background="red", size=12)
    left, right, top, bottom = columns_and_rows(touched(scene_of(cube, label)))
    width, height = right - left + 1, bottom - top + 1
    assert (width, height) == find_box(label, (0, 0))[2:4]
    x = 48 if "left" in anchor else 48 - width if "right" in anchor else 48 - width / 2
    y = 32 if "top" in anchor else 32 - height if "bottom" in anchor else 32 - height / 2
    assert (left, top) == (math.floor(x + 0.5), math.floor(y + 0.5))


def test_places_are_rounded_to_whole_pixels_half_up_and_moved_by_the_offset(cube):
    label = rj.Label((0, 0, 0), "I", anchor="top-left", background="red", size=8)
    for offset, column, row in (
        ((0.49, 0.0), 48, 32), ((0.5, -0.5), 49, 32), ((-0.51, -20.6), 47, 11), ((7, 9), 55, 41),
    ):  # fmt: skip
        found = columns_and_rows(touched(scene_of(cube, dataclasses.replace(label, offset=offset))))
        assert (found[0], found[2]) == (column, row)


def test_lines_lie_below_each_other_and_begin_or_end_together():
    layouts = {
        align: text_layout.lay_out("wide one\nI", 20.0, align) for align in ("left", "right")
    }
    for layout in layouts.values():
        assert layout.height == 2 * 24 + 1
        assert [one.row for one in layout.glyphs] == [20] * 8 + [44]
    first, last = layouts["left"].glyphs[0], layouts["left"].glyphs[-1]
    assert (first.column, first.subpixel) == (last.column, last.subpixel) == (0, 0)
    advance = FONT.advance(GLYPHS[ord("I")]) * 20 / 1000
    last = layouts["right"].glyphs[-1]
    assert abs(last.column + last.subpixel / 4 + advance - layouts["right"].width) <= 0.125


def test_the_slow_twin_of_a_label_has_the_same_pixels(cube, camera):
    """Every pixel of the box on its own, in Python's numbers."""
    label = rj.Label((0.3, 0.5, 1.0), "Ag%\nq", 17, "left", (0.7, 0.1, 0.02, 0.75), "#20c0ff90")
    background = (0.9, 0.4, 0.1, 0.5)
    for blending in ("linear", "srgb8"):
        options = {"quality": rj.Quality(blending=blending), "background": background}
        scene = scene_of(cube, label)
        plain = shown(LABELS.without(scene), camera, **options).color
        found = shown(scene, camera, **options).color
        box = find_box(label, camera.project(label.position, SIZE).pixels.tolist())
        layout = text_layout.lay_out(label.text, label.size, "left")
        window = (-box.padding, -box.padding, box.width, box.height)
        cover = text_layout.rasterize_text(layout, label.size, window)
        assert box.padding == 4
        wanted = plain.copy()
        for row in range(box.height):
            for column in range(box.width):
                at = row + box.top, column + box.left
                if 0 <= at[0] < SIZE[1] and 0 <= at[1] < SIZE[0]:
                    layers = (1.0, label.background), (cover[row, column], label.color)
                    wanted[at] = laid_over(plain[at], layers, blending == "srgb8")
        assert not np.array_equal(wanted, plain)
        assert np.array_equal(found, wanted)


def laid_over(pixel, layers, in_codes):
    """One pixel under two layers."""
    light = pixel[:3] / 255.0 if in_codes else srgb_to_linear(pixel[:3]).astype(float)
    alpha = pixel[3] / 255.0
    for cover, (*own, opacity) in layers:
        values = np.array(own)
        if in_codes:
            values = np.floor(255.0 * linear_to_srgb(values) + 0.5) / 255.0
        share = cover * opacity
        if share > 0.0:
            through = (1.0 - share) * alpha
            light = (share * values + through * light) / (share + through)
            alpha = share + through
    encoded = light if in_codes else linear_to_srgb(light)
    return np.floor(255.0 * np.append(encoded, alpha) + 0.5)


def test_what_is_opaque_and_covers_a_pixel_is_its_colour(cube):
    label = rj.Label((0, 0, 0), "M", 300, color="#123456")
    color = shown(scene_of(cube, label), background="transparent").color
    assert [0x12, 0x34, 0x56, 255] in color.reshape(-1, 4).tolist()


# What it acts on.


OTHERS = ("linear", "depth", "face_id", "object_id", "coverage", "normal")


def test_all_but_colour_stays_as_it_is(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 0), "seen", background="red"))
    outputs = ("color", *OTHERS)
    without = shown(LABELS.without(scene), camera, outputs=outputs)
    frame = shown(scene, camera, outputs=outputs)
    assert not np.array_equal(frame.color, without.color)
    for name in OTHERS:
        assert np.array_equal(getattr(frame, name), getattr(without, name), equal_nan=True)
    assert rj.fit_camera(scene) == rj.fit_camera(LABELS.without(scene))


@pytest.mark.parametrize("samples", [4, "area", 64])
def test_it_is_drawn_once_over_pictures_of_any_samples(cube, camera, samples):
    quality = rj.Quality(samples=samples)
    label = rj.Label((0, 0, 1), "opaque", background="white", hidden=True)
    scene = scene_of(cube, label)
    found = touched(scene, camera, quality=quality)
    plain = shown(scene_of(cube, label), camera)
    box = np.s_[slice(*np.flatnonzero(found.any(axis=1))[[0, -1]])]
    rows, columns = np.nonzero(found)
    box = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    # The background is opaque: what is in the box is the same over any picture.
    assert np.array_equal(shown(scene, camera, quality=quality).color[box], plain.color[box])


def test_pictures_drawn_for_other_effects_are_no_more_with_labels(cube, camera, monkeypatch):
    from rasterjit.rendering import renderer

    calls = []
    find = renderer.find_visible
    monkeypatch.setattr(
        renderer, "find_visible", lambda *a, **k: (calls.append(1), find(*a, **k))[1]
    )
    scene = scene_of(cube, rj.Label((0, 0, 3), "x", hidden=True))
    for one in (scene, LABELS.without(scene)):
        shown(one, camera, quality=rj.Quality(samples=64))
    assert len(calls) % 2 == 0
    assert sum(calls[: len(calls) // 2]) == 65


def test_it_is_shown_in_8_bits_alone_and_the_plan_says_so(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 0), "seen"))
    plans = [rj.explain(scene, camera, size=SIZE, outputs=one) for one in ("color", "linear")]
    assert [plan.has("labels") for plan in plans] == [True, False]
    plans.append(rj.explain(cube, camera, size=SIZE))
    plans.append(rj.explain(scene, camera, rj.Quality(blending="srgb8"), size=SIZE))
    told = [next(one.reason for one in plan.effects if one.name == "labels") for plan in plans]
    assert told == [
        "over the finished picture", "no output shows colour in 8 bits", "no node has a label",
        "over the finished picture, mixed in 8-bit sRGB codes",
    ]  # fmt: skip


def test_later_labels_are_drawn_over_earlier_ones(cube):
    one = rj.Label((0, 0, 0), "I", background="red")
    other = rj.Label((0, 0, -3), "I", color="blue", background="blue")
    color = shown(scene_of(cube, one, other)).color
    assert color[32, 48].tolist() == [0, 0, 255, 255]
    color = shown(scene_of(cube, other, dataclasses.replace(one, color="red"))).color
    assert color[32, 48].tolist() == [255, 0, 0, 255]


# What hides it.


def is_shown(scene, camera=FRONT, **options):
    return bool(touched(scene, camera, **options).any())


@pytest.mark.parametrize("parallel", [False, True])
def test_a_face_in_front_hides_it_and_one_behind_does_not(cube, parallel):
    camera = FRONT
    if parallel:
        camera = rj.OrthographicCamera((0, 0, 10), (0, 0, 0), height=6, near=0.5, far=50.0)
    for z, wanted in ((-2, False), (0, False), (0.8, False), (1, True), (1.1, True), (3, True)):
        label = rj.Label((0.2, 0.1, z), "text", background="red", hidden=True)
        assert is_shown(scene_of(cube, label), camera) is wanted
        assert is_shown(scene_of(cube, dataclasses.replace(label, hidden=False)), camera)


def test_corners_in_sight_are_seen_and_the_one_behind_is_not(cube, camera):
    for size in ((96, 64), (500, 333), (31, 17)):
        for corner in cube.vertices:
            label = rj.Label(corner, "o", background="red", hidden=True)
            seen = is_shown(scene_of(cube, label), camera, size=size)
            assert seen is bool(corner.max() == 1.0)


def test_vertices_of_a_ball_are_seen_on_the_side_of_the_viewer(sphere):
    eye = np.array([0.0, 0.0, 10.0])
    for vertex in sphere.vertices:
        label = rj.Label(vertex, "o", background="red", hidden=True)
        # Where the ball's surface, a polyhedron, turns away, either may be.
        facing = (eye - vertex) @ vertex
        if abs(facing) > 3.5:
            assert is_shown(scene_of(sphere, label)) is bool(facing > 0.0)


def test_what_is_seen_edge_on_hides_nothing_that_it_does_not_reach():
    strip = rj.Mesh([[0, -1, 3], [0.02, -1, -3], [0.02, 1, -3], [0, 1, 3]], [[0, 1, 2], [0, 2, 3]])
    for z, wanted in ((4.0, True), (-8.0, False)):
        label = rj.Label((0.02, 0.0, z), "o", background="red", hidden=True)
        scene = scene_of(strip, label)
        camera = rj.PerspectiveCamera((0.0, 0, 10), (0.0, 0, 0), near=0.5, far=50.0)
        frame = shown(scene, camera, outputs=("color", "face_id"))
        x, y = camera.project(label.position, SIZE).pixels
        if frame.face_id[int(y), int(x)] >= 0:
            assert is_shown(scene, camera) is wanted


def test_out_of_the_picture_it_is_drawn_only_if_nothing_may_hide_it(cube):
    label = rj.Label((-6.5, 0, 0), "beyond the edge", background="red", size=20)
    x, _ = FRONT.project(label.position, SIZE).pixels
    assert -20 < x < 0
    assert is_shown(scene_of(cube, label))
    assert not is_shown(scene_of(cube, dataclasses.replace(label, hidden=True)))


@pytest.mark.parametrize("hidden", [False, True])
def test_behind_the_camera_it_is_not_drawn(cube, hidden):
    for z in (10.0, 10.5, 30.0):
        assert not is_shown(scene_of(cube, rj.Label((0, 0, z), "behind", hidden=hidden)))


@pytest.mark.parametrize("kind", [rj.OrthographicCamera, rj.PerspectiveCamera])
def test_it_is_seen_where_a_face_would_be(cube, kind):
    options = {"height": 4.0} if kind is rj.OrthographicCamera else {"fov_y": 40.0}
    given = kind((0, 0, 5), (0, 0, 0), near=2.0, far=7.0, **options)
    open_planes = kind((0, 0, 5), (0, 0, 0), **options)
    for camera, seen in ((given, (2.9, 0, -1.9)), (open_planes, (4.99, 0, -500.0))):
        for z in (50.0, 5.5, 4.99, 2.9, 0.0, -1.9, -2.1, -500.0):
            mask = touched(scene_of(cube, rj.Label((0.0, 0.0, z), "A", size=40)), camera)
            is_seen = z in seen or (camera is open_planes and z <= 4.99)
            assert mask.any() == is_seen, (z, camera)


def test_holes_and_lone_edges_hide_nothing(cube):
    label = rj.Label((0, 0, -2), "text", background="red", hidden=True)
    scene = scene_of(cube, label)
    scene.wireframe = rj.Wireframe("black", mode="only")
    assert is_shown(scene)
    clear = rj.Mesh(
        cube.vertices, cube.faces, colors=np.zeros((8, 4)),
        material=rj.Material("unlit", alpha_mode="mask"),
    )  # fmt: skip
    assert is_shown(scene_of(clear, label))


def test_points_hide_what_is_behind_their_centre_and_lines_by_their_farther_end(cube):
    from rasterjit.effects.label import hides_point

    planned = shown(scene_of(cube, rj.Label((0, 0, -2), "x", hidden=True)), FRONT).plan
    vertices = np.array([[0, 0, 1.0], [0, 0, -1.0], [5, 5, 5]])

    class Shapes:
        class shapes:  # noqa: N801
            class arrays:  # noqa: N801
                positions = vertices
                faces = np.array([[0, 0, 0], [0, 1, 1]], np.int32)

    class Context:
        plan = planned
        cache = Shapes

        class placement:  # noqa: N801
            face_starts = np.array([0, 2])
            relative_from_model = np.array([np.eye(4)[:3]])
            toward_viewer = np.array([0.0, 0.0, 0.0, 1.0])

    Context.placement.relative_from_model[0, 2, 3] = -10.0
    for face, z, wanted in ((0, 0.0, True), (0, 1.0, False), (1, 0.0, False), (1, -2.0, True)):
        assert hides_point(face, np.array([0.0, 0.0, z]), Context) is wanted


# In parts, through lenses, in batches, again and again.


def busy(cube):
    return scene_of(
        cube,
        rj.Label((0, 0, 1), "across\nthe border", 30, background="#ffffff80", hidden=True),
        rj.Label((1.2, 0.9, 0), "left", 25, "left", "red", hidden=True),
        rj.Label((0, 0, -2), "hidden", 40, "right", hidden=True),
        rj.Label((-1, -1, 0), "cut at the edge of the picture", 22, "right", "blue"),
    )


@pytest.mark.parametrize("samples", [1, 64])
@pytest.mark.parametrize("shadow", [None, rj.Shadow(size=64)], ids=["", "shadows"])
def test_parts_have_the_bits_of_the_whole(cube, camera, samples, shadow):
    scene, size, quality = busy(cube), (200, 150), rj.Quality(samples=samples)
    scene.lights = [rj.DirectionalLight((-1, -2, -1), shadow=shadow)]
    whole = rj.render(scene, camera, size=size, quality=quality, threads=1).color
    found = np.zeros_like(whole)
    with RegionRenderer(scene, camera, size=size, quality=quality, threads=1) as renderer:
        assert renderer.needs_surveys
        pictures = 1 if shadow is None else samples + (samples > 1)
        assert len(renderer.survey((0, 0, 64, 64))) == pictures
        for (left, top, width, height), frame in renderer.render_regions(64):
            found[top : top + height, left : left + width] = frame.color
    assert np.array_equal(found, whole)


def test_parts_need_no_survey_where_nothing_hides_labels(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 1), "across the border", 30))
    whole = rj.render(scene, camera, size=(200, 150), threads=1).color
    with RegionRenderer(scene, camera, size=(200, 150), threads=1) as renderer:
        assert not renderer.needs_surveys
        part = renderer.render_region((64, 64, 136, 86)).color
    assert np.array_equal(part, whole[64:150, 64:200])


@pytest.mark.parametrize(
    "lens", [rj.PinholeDistortion(k1=-0.1), rj.Equirectangular()], ids=["pinhole", "panorama"]
)
def test_a_lens_moves_it_to_where_its_point_is_seen(cube, lens):
    label = rj.Label((2.0, 1.0, 0.0), "T", anchor="top-left", background="red", size=8)
    scene, size = scene_of(cube, label), (400, 200)
    found = columns_and_rows(touched(scene, size=size, lens=lens))
    # The point itself, as a dot in the picture.
    dot = rj.Mesh(
        np.array([[0, 0, 0], [0.3, 0, 0], [0, -0.3, 0]]) + label.position, [[0, 1, 2]],
        material=rj.Material("unlit", "red"),
    )  # fmt: skip
    marked = rj.Scene()
    marked.add(dot)
    spot = shown(marked, FRONT, size=size, lens=lens, outputs=("coverage",)).coverage
    rows, columns = np.nonzero(spot > 0.0)
    assert abs(found[0] - columns.min()) <= 1
    assert abs(found[2] - rows.min()) <= 1


def test_faces_hide_it_behind_a_lens_too(cube):
    lens = rj.PinholeDistortion(k1=-0.2)
    for z, wanted in ((-2, False), (1, True), (3, True)):
        label = rj.Label((0.2, 0.1, z), "text", background="red", hidden=True)
        assert is_shown(scene_of(cube, label), lens=lens) is wanted
    assert not is_shown(scene_of(cube, rj.Label((0, 0, 30), "behind")), lens=lens)


def test_a_renderer_draws_labels_as_they_are_now(cube, camera):
    scene = scene_of(cube)
    with rj.Renderer(SIZE, threads=1) as renderer:
        plain = renderer.render(scene, camera).color
        node = scene.add(rj.Label((0, 0, 0), "now"))
        for change in (
            lambda: None,
            lambda: setattr(node, "transform", rj.transforms.translate((1, 0, 0))),
            lambda: setattr(node, "label", rj.Label((0, 0, 0), "then")),
        ):
            change()
            color = renderer.render(scene, camera).color
            assert not np.array_equal(color, plain)
            assert np.array_equal(color, shown(copy.deepcopy(scene), camera).color)
        node.label = None
        assert np.array_equal(renderer.render(scene, camera).color, plain)


def test_animations_move_labels_with_their_nodes(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 1.5), "moves", background="red"))
    (node,) = scene.labelled
    times, places = [0.0, 1.0], [rj.transforms.translate((x, 0, 0)) for x in (-1.0, 1.0)]
    with rj.Renderer(SIZE, threads=1) as renderer:
        played = rj.animation.frames(
            renderer, scene, times, camera=camera, transforms={node: lambda t: places[int(t)]}
        )
        colors = [frame.color for frame in played]
    for color, place in zip(colors, places, strict=True):
        node.transform = place
        assert np.array_equal(color, shown(scene, camera).color)


def test_plans_of_labels_pickle(cube, camera):
    scene = busy(cube)
    for lens in (None, rj.PinholeDistortion(k1=-0.1)):
        plan = rj.render(scene, camera, size=SIZE, lens=lens).plan
        known = pickle.loads(pickle.dumps(plan)).data("labels")
        assert [label.text for label in known.labels][2] == "hidden"


def test_a_plan_looked_at_later_is_that_of_the_labels_then(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 0), "then"))
    frames = list(rj.render_many(scene, [camera, camera], size=SIZE))
    scene.labelled[0].label = None
    assert frames[0].plan.has("labels")


def test_a_pixel_is_explained_by_the_colour_that_a_frame_has(cube, camera):
    scene = scene_of(cube, rj.Label((0, 0, 0), "x", 40, color="lime"))
    color = shown(scene, camera).color
    y, x = np.argwhere((color == [0, 255, 0, 255]).all(axis=2))[0]
    told = rj.explain_pixel(scene, camera, SIZE, int(x), int(y))
    assert told.color.tolist() == [0, 255, 0, 255]


def test_partitions_refuse_labels(cube, camera):
    setting = rj.Scene()
    setting.add(rj.Label((0, 0, 0), "no"))
    with pytest.raises(ValueError, match="setting must have no labels, got 1"):
        render_partitions([cube], camera, size=SIZE, setting=setting)


def test_a_picture_smaller_than_the_text_shows_what_fits(cube, camera):
    label = rj.Label((0, 0, 0), "much too long for it", 60, background="red")
    for size in ((1, 1), (3, 70), (70, 3)):
        assert touched(scene_of(cube, label), camera, size=size).all()


def test_far_away_places_and_offsets_are_out_of_the_picture(cube):
    for label in (
        rj.Label((1e300, 0, 0), "far"), rj.Label((0, 0, 0), "far", offset=(65536, -65536)),
        rj.Label((1e12, 0, 9.9), "far", hidden=True),
    ):  # fmt: skip
        assert not is_shown(scene_of(cube, label))


@pytest.mark.parametrize(
    "lens",
    [rj.PinholeDistortion(k1=0.1), rj.PinholeDistortion(k1=-0.1), rj.FisheyeLens(fov=150.0)],
    ids=["unfolded", "folding", "fisheye"],
)
def test_at_the_eye_and_beside_it_it_is_not_drawn_by_a_lens(cube, lens):
    for position in ((0, 0, 10), (1, 0, 10), (3, 3, 12)):
        label = rj.Label(position, "beside", hidden=True)
        assert not is_shown(scene_of(cube, label), lens=lens)


@pytest.mark.parametrize("lens", [None, rj.PinholeDistortion(k1=-0.1)], ids=["", "lens"])
def test_places_beyond_all_numbers_are_nowhere(cube, lens):
    for position in ((1e300, 0, 0), (-1e300, 1e300, 1), (0, 0, -1e300)):
        scene = scene_of(cube, rj.Label(position, "far", hidden=True), rj.Label(position, "far"))
        for node in scene.labelled:
            node.transform = rj.transforms.scale(1e200)
        assert not is_shown(scene, lens=lens)
