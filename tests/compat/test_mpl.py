"""Scenes in matplotlib's axes: their size, their projection, before and behind their lines."""

from __future__ import annotations

import io
import itertools
import os
import re
import struct
import zlib

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image

import rasterjit as rj
from rasterjit.outputs.frame import PICK_OUTPUTS

if not os.environ.get("CI"):
    pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

ONE = rj.Quality.standard()
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def figure(dpi=50, **axes):
    drawn = Figure(figsize=(2.0, 1.6), dpi=dpi)
    FigureCanvasAgg(drawn)
    return drawn, drawn.add_axes([0.1, 0.1, 0.8, 0.8], **axes)


def pixels(drawn):
    drawn.canvas.draw()
    return np.asarray(drawn.canvas.buffer_rgba())[:, :, :3].astype(int)


def around_edges(own):
    """Tell of pixels at the edge: there matplotlib fills them by rules of its own."""
    edge = own & ~(
        np.roll(own, 1, 0) & np.roll(own, -1, 0) & np.roll(own, 1, 1) & np.roll(own, -1, 1)
    )
    around = edge | np.roll(edge, 1, 0) | np.roll(edge, -1, 0) | np.roll(edge, 1, 1)
    return around | np.roll(edge, -1, 1)


@pytest.fixture
def unlit():
    """A cube that is blue from everywhere."""
    material = rj.Material(shading="unlit", base_color=(*BLUE, 1.0))
    return rj.Mesh(CUBE_VERTICES, CUBE_FACES, material=material)


def spatial(unlit, proj_type="persp", dpi=50):
    drawn, axes = figure(dpi, projection="3d", proj_type=proj_type)
    axes.set(xlim=(-3, 3), ylim=(-3, 3), zlim=(-3, 3))
    axes.set_axis_off()
    return drawn, axes, rj.mpl.SceneArtist(axes, unlit, quality=ONE)


@pytest.mark.parametrize("dpi", [50, 100])
def test_flat_axes_hold_the_rendered_pixels(unlit, dpi):
    drawn, axes = figure(dpi)
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, unlit, quality=ONE)
    seen = pixels(drawn)
    box = axes.get_window_extent()
    width, height = round(box.width), round(box.height)
    frame = rj.render(unlit, size=(width, height), quality=ONE, background="white")
    left, top = round(box.x0), seen.shape[0] - round(box.y1)
    np.testing.assert_array_equal(
        seen[top : top + height, left : left + width], frame.color[:, :, :3]
    )


def test_saving_renders_at_its_own_resolution(unlit):
    drawn, axes = figure(50)
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, unlit, quality=ONE)
    data = io.BytesIO()
    drawn.savefig(data, dpi=100)
    seen = np.asarray(Image.open(data).convert("RGB")).astype(int)
    frame = rj.render(unlit, size=(160, 128), quality=ONE, background="white")
    np.testing.assert_array_equal(seen[16:144, 20:180], frame.color[:, :, :3])


def test_resizing_renders_anew(unlit):
    drawn, axes = figure()
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, unlit, quality=ONE)
    pixels(drawn)
    drawn.set_size_inches(3.0, 2.0)
    frame = rj.render(unlit, size=(120, 80), quality=ONE, background="white")
    np.testing.assert_array_equal(pixels(drawn)[10:90, 15:135], frame.color[:, :, :3])


@pytest.mark.parametrize("proj_type", ["persp", "ortho"])
def test_spatial_axes_put_corners_where_their_own_points_are(unlit, proj_type):
    drawn, axes, artist = spatial(unlit, proj_type)
    axes.view_init(elev=20, azim=35)
    blue = (pixels(drawn) == (0, 0, 255)).all(axis=2)
    artist.set_visible(False)
    axes.plot_trisurf(
        *CUBE_VERTICES.T, triangles=CUBE_FACES, color=BLUE, shade=False, antialiased=False
    )
    own = (pixels(drawn) == (0, 0, 255)).all(axis=2)
    assert blue.sum() > 200
    assert not ((blue != own) & ~around_edges(own)).any()


@pytest.mark.parametrize("proj_type", ["persp", "ortho"])
def test_line_behind_the_mesh_is_hidden_and_one_before_it_is_seen(unlit, proj_type):
    drawn, axes, artist = spatial(unlit, proj_type)
    axes.view_init(elev=0, azim=0)
    without = pixels(drawn)
    for x, is_seen in ((2.0, True), (-2.0, False), (0.0, False)):
        (line,) = axes.plot([x, x], [-0.5, 0.5], [0.0, 0.0], color=RED, lw=1.0, aa=False)
        artist.hide(line)
        differs = (pixels(drawn) != without).any(axis=2)
        assert differs.any() == is_seen
        line.remove()
        artist._original_draws.clear()


def test_line_through_the_mesh_is_cut_where_it_enters(unlit):
    drawn, axes, artist = spatial(unlit, "ortho")
    axes.view_init(elev=0, azim=0)
    (line,) = axes.plot([0.0, 0.0], [-2.0, 2.0], [0.0, 0.0], color=RED, lw=1.0, aa=False)
    uncut = (pixels(drawn)[:, :, 0] > 200) & (pixels(drawn)[:, :, 1] < 60)
    artist.hide(line)
    cut = (pixels(drawn)[:, :, 0] > 200) & (pixels(drawn)[:, :, 1] < 60)
    # Half of it is inside the cube, whose side is 2.
    assert cut.sum() == pytest.approx(0.5 * uncut.sum(), abs=3)
    columns = np.flatnonzero(cut.any(axis=0))
    assert np.diff(columns).max() == pytest.approx(
        0.5 * len(np.flatnonzero(uncut.any(axis=0))), abs=3
    )


def test_points_behind_are_hidden_and_keep_their_colours(unlit):
    drawn, axes, artist = spatial(unlit)
    axes.view_init(elev=0, azim=0)
    points = axes.scatter(
        [2.0, -2.0, 2.0], [-0.5, 0.0, 0.5], [0.0, 0.0, 0.0], c=[RED, (0, 1, 0), (1, 1, 0)],
        s=30, depthshade=False,
    )  # fmt: skip
    artist.hide(points)
    seen = pixels(drawn)
    for color, is_seen in (((255, 0, 0), True), ((0, 255, 0), False), ((255, 255, 0), True)):
        assert (seen == color).all(axis=2).any() == is_seen
    assert np.isfinite(points._offsets3d[1]).all()


def test_lines_on_the_surface_are_seen(unlit):
    drawn, axes, artist = spatial(unlit)
    axes.view_init(elev=30, azim=40)
    (line,) = axes.plot([1, 1], [-1, 1], [1, 1], color=RED, lw=1.0, aa=False)
    whole = (pixels(drawn)[:, :, 0] > 200).sum()
    artist.hide(line)
    assert (pixels(drawn)[:, :, 0] > 200).sum() >= 0.9 * whole


def points_and_scene(axes, order, unlit):
    """Add things to axes in an order: points on both sides of the scene's x, y and z, or it."""
    for name in order:
        if name == "scene":
            rj.mpl.SceneArtist(axes, unlit, quality=ONE)
        elif name == "points":
            axes.scatter([4.0, 5.0], [0.0, -6.0], [0.5, 0.0])
        else:
            axes.plot([0.0, 0.1], [0.0, 0.0], [-7.0, 0.0])


ORDERS = [
    one
    for count in (1, 2, 3)
    for one in itertools.permutations(("scene", "points", "line"), count)
    if "scene" in one
]


@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_limits_are_widened_to_everything_in_any_order(unlit, order):
    _, axes = figure(projection="3d")
    points_and_scene(axes, order, unlit)
    assert axes.has_data()
    low, high = np.full(3, -1.0), np.full(3, 1.0)
    if "points" in order:
        low[1], high[0] = -6.0, 5.0
    if "line" in order:
        low[2] = -7.0
    for axis, limits in enumerate((axes.get_xlim(), axes.get_ylim(), axes.get_zlim())):
        # The axes add a margin of their own.
        length = high[axis] - low[axis]
        assert low[axis] - 0.1 * length < limits[0] < low[axis]
        assert high[axis] < limits[1] < high[axis] + 0.1 * length


def test_flat_axes_have_data_and_limits_of_what_else_is_in_them(unlit):
    _, axes = figure()
    artist = rj.mpl.SceneArtist(axes, unlit, quality=ONE)
    assert axes.has_data()
    axes.plot([2.0, 3.0], [5.0, 9.0])
    axes.relim()
    axes.autoscale_view()
    assert axes.get_xlim() == pytest.approx((1.95, 3.05))
    axes.lines[0].remove()
    artist.remove()
    assert not axes.has_data()


UPS = {
    "x": ((1.0, 0.0, 0.0), lambda x, y, z: (-z, y, x)),
    "y": ((0.0, 2.0, 0.0), lambda x, y, z: (x, -z, y)),
    "z": ((0.0, 0.0, 1.0), lambda x, y, z: (x, y, z)),
    "-z": ((0.0, 0.0, -1.0), lambda x, y, z: (x, -y, -z)),
}


@pytest.fixture
def lopsided():
    """A long blue box that is elsewhere on each axis."""
    material = rj.Material(shading="unlit", base_color=(*BLUE, 1.0))
    vertices = CUBE_VERTICES * (0.5, 1.0, 1.5) + (0.2, 0.5, -0.7)
    return rj.Mesh(vertices, CUBE_FACES, material=material)


@pytest.mark.parametrize("up", UPS)
@pytest.mark.parametrize(("proj_type", "zoom"), [("persp", 1.0), ("ortho", 1.0), ("persp", 1.6)])
def test_scene_stands_up_where_its_turned_points_are(lopsided, up, proj_type, zoom):
    drawn, axes = figure(projection="3d", proj_type=proj_type)
    direction, turned = UPS[up]
    artist = rj.mpl.SceneArtist(axes, lopsided, quality=ONE, up=direction)
    places = turned(*lopsided.vertices.T)
    for limits, one in zip(
        (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()), places, strict=True
    ):
        assert limits[0] < one.min() < one.max() < limits[1]
        assert limits[1] - limits[0] < 1.3 * (one.max() - one.min())
    axes.set(xlim=(-3 / zoom, 3 / zoom), ylim=(-3 / zoom, 3 / zoom), zlim=(-3 / zoom, 3 / zoom))
    axes.set_axis_off()
    axes.view_init(elev=25, azim=50, roll=10)
    blue = (pixels(drawn) == (0, 0, 255)).all(axis=2)
    artist.set_visible(False)
    axes.plot_trisurf(*places, triangles=CUBE_FACES, color=BLUE, shade=False, antialiased=False)
    axes.set(xlim=(-3 / zoom, 3 / zoom), ylim=(-3 / zoom, 3 / zoom), zlim=(-3 / zoom, 3 / zoom))
    own = (pixels(drawn) == (0, 0, 255)).all(axis=2)
    assert blue.sum() > 200
    assert not ((blue != own) & ~around_edges(own)).any()


def test_lines_behind_a_turned_scene_are_hidden(lopsided):
    drawn, axes = figure(projection="3d")
    axes.view_init(elev=0, azim=-90)
    artist = rj.mpl.SceneArtist(axes, lopsided, quality=ONE, up=(0.0, 1.0, 0.0))
    axes.set(xlim=(-3, 3), ylim=(-3, 3), zlim=(-3, 3))
    axes.set_axis_off()
    without = pixels(drawn)
    # The view is along the axes' y, which is the scene's -z: the box reaches from -0.8 to 2.2.
    for y, is_seen in ((-2.0, True), (2.8, False), (0.0, False)):
        (line,) = axes.plot([0.2, 0.2], [y, y], [0.0, 1.0], color=RED, lw=1.0, aa=False)
        artist.hide(line)
        assert (pixels(drawn) != without).any() == is_seen
        line.remove()


def test_flat_axes_take_up_for_the_camera_that_fits(lopsided):
    drawn, axes = figure()
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, lopsided, quality=ONE, up=(0.0, 0.0, 1.0))
    camera = rj.fit_camera(lopsided, up=(0.0, 0.0, 1.0), aspect=80 / 64)
    frame = rj.render(lopsided, camera, size=(80, 64), quality=ONE, background="white")
    np.testing.assert_array_equal(pixels(drawn)[8:72, 10:90], frame.color[:, :, :3])


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def coverage_in_pdf(text):
    """Return where the picture of a PDF file is, 1/72 inch, and its opacity, (H, W)."""
    matrix = opacity = None
    for before, part in itertools.pairwise(text.split(b"stream\n")):
        data = part.split(b"\nendstream")[0]
        about = before.rpartition(b" obj")[2]
        if b"/DeviceGray" in about:
            # Its rows are those of a PNG file.
            size = [
                int(re.search(rb"/%s (\d+)" % name, about)[1]) for name in (b"Width", b"Height")
            ]
            head = struct.pack(">IIBBBBB", *size, 8, 0, 0, 0, 0)
            chunks = ((b"IHDR", head), (b"IDAT", data), (b"IEND", b""))
            png = b"\x89PNG\r\n\x1a\n" + b"".join(itertools.starmap(chunk, chunks))
            opacity = np.asarray(Image.open(io.BytesIO(png)))
        elif b"/Image" not in about and data[:1] == b"x":
            found = re.search(rb"(\S+) 0 0 (\S+) (\S+) (\S+) cm /I1 Do", zlib.decompress(data))
            matrix = [float(one) for one in found.groups()] if found else matrix
    return matrix, opacity


@pytest.mark.parametrize(("elevation", "zoom"), [(15.0, 1.0), (70.0, 1.5)])
def test_pdf_shows_the_scene_where_its_corners_are(unlit, elevation, zoom):
    drawn, axes, _ = spatial(unlit, dpi=72)
    axes.view_init(elev=elevation, azim=30)
    axes.set(xlim=(-3 / zoom, 3 / zoom), ylim=(-3 / zoom, 3 / zoom), zlim=(-3 / zoom, 3 / zoom))
    data = io.BytesIO()
    drawn.savefig(data, format="pdf", dpi=288)
    (width, height, left, bottom), opacity = coverage_in_pdf(data.getvalue())
    rows, columns = np.nonzero(opacity)
    pixels(drawn)
    corners = np.column_stack([CUBE_VERTICES, np.ones(8)]) @ axes.get_proj().T
    places = axes.transData.transform(corners[:, :2] / corners[:, 3:])
    seen = [
        left + width * np.array([columns.min(), columns.max() + 1]) / opacity.shape[1],
        bottom + height * (1 - np.array([rows.max() + 1, rows.min()]) / opacity.shape[0]),
    ]
    # A pixel is a quarter of a point.
    np.testing.assert_allclose(
        seen, np.transpose([places.min(axis=0), places.max(axis=0)]), atol=0.3
    )


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_vector_formats_hold_a_picture(unlit, kind):
    drawn, axes = figure()
    rj.mpl.SceneArtist(axes, unlit, quality=ONE)
    data = io.BytesIO()
    drawn.savefig(data, format=kind)
    text = data.getvalue()
    assert b"/Subtype /Image" in text if kind == "pdf" else b"<image" in text


def test_wrong_arguments_are_refused(unlit, camera):
    _, axes = figure()
    artist = rj.mpl.SceneArtist(axes, unlit)
    with pytest.raises(ValueError, match="3-D axes only"):
        artist.hide(axes.plot([0, 1], [0, 1])[0])
    with pytest.raises(ValueError, match="axes must be matplotlib's Axes, got int"):
        rj.mpl.SceneArtist(3, unlit)
    _, space, artist = spatial(unlit)
    with pytest.raises(ValueError, match="camera must be None"):
        rj.mpl.SceneArtist(space, unlit, camera)
    with pytest.raises(ValueError, match="things must be lines or points"):
        artist.hide(axes.lines[0])
    _, axes = figure()
    with pytest.raises(ValueError, match="background"):
        rj.mpl.SceneArtist(axes, unlit, background="nonsense")
    with pytest.raises(ValueError, match="camera"):
        rj.mpl.SceneArtist(axes, unlit, 0)
    for plane, options, words in (
        ("xx", {}, "plane must be one of 'xy'"), ("xy", {"up": (0, 0, 1)}, "plane must be None"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            rj.mpl.SceneArtist(axes, unlit, plane=plane, **options)
    with pytest.raises(ValueError, match="up must not be the zero vector"):
        rj.mpl.SceneArtist(axes, unlit, up=(0, 0, 0))
    assert not axes.artists


def test_what_is_hidden_is_drawn_plainly_without_the_scene(unlit):
    drawn, axes, artist = spatial(unlit)
    axes.view_init(elev=0, azim=0)
    (line,) = axes.plot([-2.0, -2.0], [-0.5, 0.5], [0.0, 0.0], color=RED, lw=1.0, aa=False)
    points = axes.scatter([-2.0], [0.2], [0.5], c=[(0, 1, 0)], s=30, depthshade=False)
    artist.set_visible(False)
    plain = pixels(drawn)
    assert (plain == (0, 255, 0)).all(axis=2).any()
    artist.set_visible(True)
    artist.hide(line, points)
    assert not (pixels(drawn) == (0, 255, 0)).all(axis=2).any()
    artist.set_visible(False)
    np.testing.assert_array_equal(pixels(drawn), plain)
    artist.remove()
    np.testing.assert_array_equal(pixels(drawn), plain)


def test_hidden_line_that_is_removed_is_gone(unlit):
    drawn, axes, artist = spatial(unlit)
    axes.view_init(elev=0, azim=0)
    without = pixels(drawn)
    (line,) = axes.plot([2.0, 2.0], [-0.5, 0.5], [0.0, 0.0], color=RED, lw=1.0, aa=False)
    artist.hide(line)
    assert (pixels(drawn) != without).any()
    line.remove()
    np.testing.assert_array_equal(pixels(drawn), without)


@pytest.fixture
def heated():
    """A cube whose scalars are powers of ten, and -1 at one corner."""
    values = 10.0 ** np.arange(8.0)
    values[3] = -1.0
    return rj.Mesh(
        CUBE_VERTICES, CUBE_FACES, scalars=values, norm="log", range=(10.0, 1e6), nan_color="pink",
        contours=[1e3], material=rj.Material("unlit"),
        colormap=rj.Colormap("turbo", under="white", over="black"),
    )  # fmt: skip


def test_colour_bars_are_matplotlibs_with_the_colours_of_the_scene(heated):
    artist = rj.mpl.SceneArtist(figure()[1], heated)
    bar = artist.colorbar("heat, K", shrink=0.5)
    assert bar.ax.get_ylabel() == "heat, K"
    assert bar.extend == "both"
    assert (bar.norm.vmin, bar.norm.vmax) == (10.0, 1e6)
    assert bar.lines[0].get_paths()
    values = np.append(10.0 ** np.random.default_rng(3).uniform(-2, 9, 500), [np.nan, -1.0])
    linear = heated.field.table[heated.field.entries(values)]
    wanted = np.column_stack([rj.scene.color.linear_to_srgb(linear[:, :3]), linear[:, 3]])
    assert np.abs(artist.mappable.to_rgba(np.ma.masked_invalid(values)) - wanted).max() < 1e-6


def test_norms_come_back_as_they_were_given(heated):
    colors = pytest.importorskip("matplotlib.colors")
    for given in (colors.TwoSlopeNorm(2.0), colors.BoundaryNorm([0, 1, 5], 256)):
        artist = rj.mpl.SceneArtist(figure()[1], heated.with_scalars(np.arange(8.0), norm=given))
        found = artist.mappable.norm
        assert type(found) is type(given)
        assert (found.vmin, found.vmax) == ((0, 7) if given.vmin is None else (0, 5))
    faces, names = np.arange(len(CUBE_FACES)) % 2, {"iron": "gray", "salt": "white"}
    artist = rj.mpl.SceneArtist(figure()[1], heated.with_scalars(faces, names, range=(0, 10)))
    # As the scene shows them: 1 is in the first half of the range.
    assert artist.mappable.to_rgba([1.0])[0, :3] == pytest.approx([0x80 / 255] * 3)
    assert [one.get_text() for one in artist.colorbar().ax.get_yticklabels()] == [*names]
    artist = rj.mpl.SceneArtist(figure()[1], heated.with_scalars(faces, names))
    names = [text.get_text() for text in artist.colorbar().ax.get_yticklabels()]
    assert names == ["iron", "salt"]
    with pytest.raises(ValueError, match="no mesh of the scene has scalars"):
        rj.mpl.SceneArtist(figure()[1], heated.without_colors()).colorbar()


@pytest.mark.parametrize("plane", ["xy", "xz", "yz", "yx", "zx", "zy"])
def test_planes_have_the_coordinates_of_the_scene(heated, plane):
    moved = rj.Scene()
    moved.add(heated, rj.transforms.translate((5.0, -2.0, 30.0)) @ rj.transforms.scale((3, 2, 1)))
    drawn, axes = figure()
    artist = rj.mpl.SceneArtist(axes, moved, plane=plane, quality=ONE)
    drawn.canvas.draw()
    low, high = moved.bounds()
    right, up = ("xyz".index(letter) for letter in plane)
    assert axes.get_xlim()[0] < low[right] < high[right] < axes.get_xlim()[1]
    assert axes.get_ylim()[0] < low[up] < high[up] < axes.get_ylim()[1]
    rng = np.random.default_rng(6)
    toward = np.cross(np.eye(3)[right], np.eye(3)[up])
    for share in rng.uniform(0.1, 0.9, (5, 2)):
        place = low[[right, up]] + share * (high - low)[[right, up]]
        picked = artist.pick_at(*axes.transData.transform(place))
        pixel = np.abs(np.diff(axes.get_xlim())) / axes.bbox.width
        assert np.abs(picked.position[[right, up]] - place).max() <= pixel
        # The face that looks at the viewer.
        nearest = max(low @ toward, high @ toward)
        assert picked.position @ toward == pytest.approx(nearest, rel=1e-5)
    assert artist.pick_at(*axes.transData.transform((axes.get_xlim()[0], low[up]))) is None
    # Other limits show another part, as sharply.
    axes.set(xlim=low[right] + [0.1, 0.2], ylim=low[up] + [0.3, 0.4])
    drawn.canvas.draw()
    found = artist.pick_at(*axes.transAxes.transform((0.5, 0.5))).position[[right, up]]
    assert found == pytest.approx(low[[right, up]] + [0.15, 0.35], abs=0.003)


def test_the_mouse_finds_places_of_the_scene_and_its_scalars(heated):
    events = pytest.importorskip("matplotlib.backend_bases")
    drawn, axes, artist = spatial(heated)
    drawn.canvas.draw()
    camera, size, area = artist._find_view(1.0)
    frame = rj.render(
        heated, camera, size=size, quality=ONE, outputs=(*PICK_OUTPUTS, "scalar"), threads=1
    )
    seen = 0
    for row, column in itertools.product(range(0, size[1], 9), range(0, size[0], 9)):
        wanted = frame.pick(column, row)
        # Events have whole numbers: the left and the upper edge of a pixel.
        x, y = area.x0 + column, area.y1 - row
        event = events.MouseEvent("motion_notify_event", drawn.canvas, x, y)
        is_on, found = artist.contains(event)
        assert is_on == (wanted is not None)
        if is_on:
            seen += 1
            assert (found["picked"].face, found["picked"].scalar) == (wanted.face, wanted.scalar)
            assert artist.format_cursor_data(artist.get_cursor_data(event)).startswith("(")
            found = []
            link = drawn.canvas.mpl_connect("pick_event", found.append)
            artist.set_picker(True)
            axes.pick(event)
            assert [one.picked.face for one in found] == [wanted.face]
            drawn.canvas.mpl_disconnect(link)
    assert seen > 3
    artist.set_visible(False)
    assert not artist.contains(event)[0]


def test_tight_pictures_end_at_the_axes(unlit):
    drawn, axes = figure()
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, unlit)
    with io.BytesIO() as file:
        drawn.savefig(file, format="png", bbox_inches="tight", pad_inches=0.0)
        assert Image.open(file).size == pytest.approx(axes.bbox.size, abs=1)


def test_inches_and_dots_give_the_very_pixels_of_a_frame(unlit):
    drawn = Figure(figsize=(1.5, 1.25))
    axes = drawn.add_axes([0.0, 0.0, 1.0, 1.0])
    axes.set_axis_off()
    rj.mpl.SceneArtist(axes, unlit, quality=ONE, background="white")
    with io.BytesIO() as file:
        drawn.savefig(file, format="png", dpi=160)
        found = np.array(Image.open(file).convert("RGB"))
    wanted = rj.render(unlit, size=(240, 200), quality=ONE, background="white", threads=1)
    assert np.array_equal(found, wanted.color[..., :3])
