"""Scenes in matplotlib's axes: their size, their projection, before and behind their lines."""

from __future__ import annotations

import io
import os

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image

import rasterjit as rj

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
    # Matplotlib fills pixels by rules of its own: along the edge they differ.
    edge = own & ~(
        np.roll(own, 1, 0) & np.roll(own, -1, 0) & np.roll(own, 1, 1) & np.roll(own, -1, 1)
    )
    around = edge | np.roll(edge, 1, 0) | np.roll(edge, -1, 0) | np.roll(edge, 1, 1)
    around |= np.roll(edge, -1, 1)
    assert not ((blue != own) & ~around).any()


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
        artist._own_draws.clear()


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
