"""Weights in float32 stay within their bound, on slivers and wherever w differs; codes, too."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import float32_weights
from rasterjit.pipeline.surface.float32_colors import find_float32_colors
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import (
    COUNT_ELEMENTS,
    INTERVAL_COLUMN,
    INTERVAL_COUNT,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    Block,
)
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK
from rasterjit.rendering.planning import list_passes
from rasterjit.rendering.regions import Region, RegionRenderer
from rasterjit.runtime import threads
from rasterjit.runtime.jit import stage
from rasterjit.runtime.stage_runner import StageList, Step
from rasterjit.runtime.state_block import float32
from rasterjit.survey.facts import UNKNOWN_REASON, explain_float64

BOUND = Fraction(float32_weights.WEIGHT_ERROR)
FLOAT64 = rj.Quality(interpolation_precision="float64")
MILLIONTH = 1e-6


@stage
def take_colors(block: Block, count, taken: float32[:, :, ::1]):
    """Write the colours of a block to the pixels of its samples."""
    for k in range(block.counts[INTERVAL_COUNT]):
        interval = block.intervals[k]
        row, column = interval[INTERVAL_ROW], interval[INTERVAL_COLUMN]
        start = interval[INTERVAL_START]
        for n in range(interval[INTERVAL_STOP] - start):
            for j in range(3):
                taken[row, column + n, j] = block.samples[j, start + n]


def weigh(points, w, size=(64, 64), bits=8, face_id=None, positions=None):
    """
    Return where one triangle is seen, its weights in float32, and its snapped corners.

    The weights are also the colours of a face whose vertices are red, green and blue.
    """
    if positions is None:
        positions = naive.clip_from_screen(points, size, 0.0, w)
    faces = np.array([(0, 1, 2)], np.int32)
    viewport, workers = make_viewport(size, bits), threads.Workers(1)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    if face_id is None:
        quality = rj.Quality(subpixel_bits=bits)
        face_id = rj.rasterize(positions, faces, size, quality=quality, threads=1).face_id
    geometry = Geometry(faces, screen.xy, screen.codes, screen.w, positions, viewport)
    taken = np.full((*face_id.shape, 3), np.nan, np.float32)
    listed = (
        np.ascontiguousarray(face_id), 0, size[1], faces, np.array([0, 1]),
        np.zeros(4, np.float32), 0, np.empty((size[1], 0, 4), np.float32),
        np.empty((size[1], 0), np.uint32),
    )  # fmt: skip
    THREAD_BLOCK.block[:COUNT_ELEMENTS] = 0
    # Of vertices that are red, green and blue.
    shown = geometry, np.ones((1, 7), np.float32), np.eye(3, 4, dtype=np.float32)
    found = [Step(find_float32_colors, (*shown, np.ones(1, np.uint8)))]
    steps = [Step(list_samples, listed), *found, Step(take_colors, (taken,))]
    StageList(steps).run(THREAD_BLOCK.block, BLOCK)
    return face_id, taken, screen.xy[:3].tolist()


def random_faces(count=60):
    """Yield the corners of faces, pixels, of all shapes, and w: slivers, tiny, large ones."""
    rng = np.random.default_rng(7)
    for n in range(count):
        if n % 3 == 0:
            points = rng.uniform(-30, 94, (3, 2))
        elif n % 3 == 1:
            start, way = rng.uniform(0, 64, 2), rng.normal(size=2) * rng.choice([30, 3000])
            aside = np.array([-way[1], way[0]]) / np.hypot(*way)
            points = np.array([start - way, start + way, start + aside * rng.uniform(0.3, 2)])
        else:
            points = rng.uniform(20, 40, 2) + rng.uniform(-3, 3, (3, 2))
        w = 2.0 ** rng.integers(*((-3, 4), (-40, 41), (-90, 91))[n // 3 % 3], 3)
        yield np.round(points * 256) / 256, w


def test_weights_stay_within_their_bound():
    checked, spans = 0, 0
    for points, w in random_faces():
        face_id, taken, corners = weigh(points, w)
        for row, column in np.argwhere(face_id == 0)[::23]:
            exact = oracle.perspective_weights(corners, w.tolist(), naive.centre(column, row))
            for have, want in zip(taken[row, column], exact, strict=True):
                # Float32 has no weights below its normal range.
                slack = BOUND * want + Fraction(2) ** -149
                assert abs(Fraction(float(have)) - want) <= slack, (points, w, row, column)
            checked += 1
        spans += int(((face_id == 0).sum(axis=1) >= 48).sum())
    assert checked > 300
    assert spans > 50


def test_weights_are_those_of_the_slow_twin():
    checked = 0
    for points, w in random_faces():
        if w.max() > 2.0**16 * w.min():
            continue
        face_id, taken, corners = weigh(points, w)
        for row, column in np.argwhere(face_id == 0)[::13]:
            want = naive.float32_weights(corners, w, naive.centre(int(column), int(row)))
            assert taken[row, column].tolist() == want, (points, w, row, column)
            checked += 1
    assert checked > 200


def test_where_a_run_is_cut_changes_no_bit():
    # In a span, beside it, and alone.
    points, w = [(-7.5, -3.25), (71.0, 20.5), (10.25, 90.0)], 2.0 ** np.array([0, 5, -2])
    face_id, whole, _ = weigh(points, w)
    for step in (2, 3, 17, 40):
        some = np.where(np.arange(64) % step < step - 1, face_id, np.int32(-1))
        _, taken, _ = weigh(points, w, face_id=some)
        shown = some >= 0
        assert shown.sum() > 500
        assert taken[shown].tobytes() == whole[shown].tobytes()


def cut_in_runs(face_id):
    """Yield a face seen whole, and in runs of 1 to 39 samples."""
    for step in (65, 2, 3, 6, 11, 17, 40):
        yield np.where(np.arange(64) % step < step - 1, face_id, np.int32(-1))


def test_clipped_faces_have_the_same_bits_in_runs_of_any_length():
    # It passes the eye: its sides are those of no triangle on the screen.
    positions = np.array([(-9.0, -4.0, 0.0, 1.0), (9.0, -5.0, 0.0, 1.0), (0.3, 2.0, -1.0, -0.5)])
    face_id = np.zeros((64, 64), np.int32)
    _, whole, _ = weigh(None, None, face_id=face_id, positions=positions)
    assert len(np.unique(whole[:, :, 2])) > 1000
    for some in cut_in_runs(face_id):
        _, colors, _ = weigh(None, None, face_id=some, positions=positions)
        assert colors[some >= 0].tobytes() == whole[some >= 0].tobytes()


@pytest.mark.parametrize("thickness", [4, 40])
def test_faces_too_wide_for_exact_products_are_weighed_in_float64(thickness):
    # 16,440 pixels on a grid of 4,096: products of its sides take more than 53 bits.
    points = [(-8180.0, 31.25), (8240.0, 32.0 + 2.0**-12), (8240.0, 32.0 + thickness)]
    w = np.array([1.0, 0.25, 512.0])
    assert float32_weights.WIDE_EXTENT <= (8180 + 8240) << 12
    face_id, taken, corners = weigh(points, w, bits=12)
    places = np.argwhere(face_id == 0)
    assert len(places)
    for row, column in places[::7]:
        exact = oracle.perspective_weights(corners, w.tolist(), naive.centre(column, row, 12))
        for have, want in zip(taken[row, column], exact, strict=True):
            assert abs(Fraction(float(have)) - want) <= 2 * want * Fraction(2) ** -24


def hills(shading="unlit", squares=24, **options):
    """Return a scene of a bumpy mesh with colours of its vertices, some of them dark."""
    rng = np.random.default_rng(3)
    z, x = np.mgrid[0 : squares + 1, 0 : squares + 1] / squares * 4.0 - 2.0
    y = 0.2 * np.sin(5 * x) * np.cos(4 * z)
    first = (np.arange(squares)[:, np.newaxis] * (squares + 1) + np.arange(squares)).ravel()
    above = first + squares + 1
    faces = np.concatenate(
        [np.stack([first, above + 1, first + 1], 1), np.stack([first, above, above + 1], 1)]
    )
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    colors = rng.uniform(0, 1, (len(points), 3)) ** rng.uniform(1, 6, (len(points), 1))
    colors[::7] = 0.0
    scene = rj.Scene()
    material = rj.Material(shading=shading, base_color="white", **options)
    scene.add(rj.Mesh(points, faces, colors=colors, material=material))
    return scene


# From inside, so that some faces cross the near plane; along the ground, so that w differs much.
CAMERAS = [
    rj.PerspectiveCamera((0.1, 0.35, 1.9), (0.0, 0.0, 0.0), near=0.3),
    rj.PerspectiveCamera((0.3, 3.0, 2.0), (0.0, 0.0, 0.0)),
    rj.OrthographicCamera((1.0, 2.0, 2.0), (0.0, 0.0, 0.0), height=3.0),
]


@pytest.mark.needs_jit
@pytest.mark.parametrize("interpolation", ["perspective", "affine"])
@pytest.mark.parametrize("squares", [4, 60])
@pytest.mark.parametrize("camera", CAMERAS, ids=["low", "high", "parallel"])
def test_colours_are_off_by_a_millionth_and_codes_by_one_in_few_pixels(
    camera, squares, interpolation
):
    scene, outputs = hills(squares=squares), ("color", "linear")
    quick, exact = (
        rj.render(
            scene, camera, size=(160, 120), outputs=outputs, background="black",
            quality=dataclasses.replace(quality, interpolation=interpolation),
        )
        for quality in (rj.Quality(), FLOAT64)
    )  # fmt: skip
    assert quick.linear.tobytes() != exact.linear.tobytes()
    off = np.abs(np.float64(quick.linear) - exact.linear)
    assert (off <= MILLIONTH * exact.linear).all()
    codes = np.abs(quick.color.astype(int) - exact.color)
    assert codes.max() <= 1
    # A ten-thousandth of a step moves about as many codes.
    assert (codes > 0).sum() <= 1e-3 * codes.size


def test_faces_of_one_colour_show_it_exactly():
    scene = rj.Scene()
    for n, color in enumerate([(0.3, 0.7, 0.001), (1.0, 0.2, 0.6)]):
        points = np.array([(-1, -1, 0), (1, -1, -3), (0.2, 1.3, 0)]) + (n * 0.4, 0, -n)
        mesh = rj.Mesh(
            points, [(0, 1, 2)], colors=[color] * 3,
            material=rj.Material(shading="unlit", base_color="white"),
        )  # fmt: skip
        scene.add(mesh)
    frame = rj.render(
        scene, rj.PerspectiveCamera((0, 0, 3), (0, 0, 0)), size=(96, 64),
        outputs=("linear", "object_id"),
    )  # fmt: skip
    for n, color in enumerate([(0.3, 0.7, 0.001), (1.0, 0.2, 0.6)]):
        shown = frame.linear[frame.object_id == n][:, :3]
        assert len(shown) > 50
        assert (shown == np.float32(color)).all()


@pytest.mark.needs_jit
def test_other_outputs_are_untouched_and_change_no_colour():
    scene, camera, outputs = hills(), CAMERAS[0], ("depth", "barycentric", "position", "normal")
    quick, exact = (
        rj.render(scene, camera, size=(160, 120), outputs=("color", *outputs), quality=quality)
        for quality in (rj.Quality(), FLOAT64)
    )
    for name in outputs:
        assert getattr(quick, name).tobytes() == getattr(exact, name).tobytes()
    alone = rj.render(scene, camera, size=(160, 120))
    assert alone.color.tobytes() == quick.color.tobytes()


def test_regions_rotated_faces_and_threads_change_no_bit():
    scene, camera, size = hills(squares=5), CAMERAS[0], (200, 150)
    whole = rj.render(scene, camera, size=size, outputs=("linear",), threads=1).linear
    three = rj.render(scene, camera, size=size, outputs=("linear",), threads=3).linear
    assert three.tobytes() == whole.tobytes()
    with RegionRenderer(scene, camera, size=size, outputs=("linear",)) as renderer:
        region = Region(64, 64, 101, 83)
        part = renderer.render_region(region).linear
    assert part.tobytes() == np.ascontiguousarray(whole[64:147, 64:165]).tobytes()
    mesh = scene.nodes[0].mesh
    turned = np.stack([np.roll(face, n % 3) for n, face in enumerate(mesh.faces)])
    other = rj.Scene()
    other.add(
        rj.Mesh(mesh.vertices, turned, colors=mesh.vertex_colors[:, :3], material=mesh.material)
    )
    again = rj.render(other, camera, size=size, outputs=("linear",)).linear
    assert again.tobytes() == whole.tobytes()


def is_quick(scene, quality=None, camera=CAMERAS[1]):
    return rj.explain(scene, camera, quality, size=(64, 48)).facts.float32_objects is not None


def test_who_takes_float32():
    assert is_quick(hills())
    assert not is_quick(hills(), FLOAT64)
    assert not is_quick(hills(), rj.Quality.reference())
    assert is_quick(hills(), rj.Quality(samples=64))
    assert not is_quick(hills(), rj.Quality(samples=4))
    assert not is_quick(hills("phong"))
    glass = hills(alpha_mode="blend")
    assert not is_quick(glass)
    plain = rj.Scene()
    mesh = hills().nodes[0].mesh
    plain.add(rj.Mesh(mesh.vertices, mesh.faces, material=rj.Material(shading="unlit")))
    assert not is_quick(plain)


@pytest.mark.parametrize("fog", [
    rj.Fog(mode="exp", density=0.0), rj.Fog(mode="linear", start=1e6, end=2e6),
])  # fmt: skip
def test_fog_that_covers_nothing_changes_no_bit(fog):
    scene, clear = hills(), hills()
    scene.fog = fog
    assert is_quick(scene)
    camera, outputs = rj.fit_camera(clear), ("color", "linear")
    foggy, bare = (
        rj.render(some, camera, size=(64, 48), outputs=outputs) for some in (scene, clear)
    )
    assert foggy.linear.tobytes() == bare.linear.tobytes()
    assert foggy.color.tobytes() == bare.color.tobytes()


def test_fog_lies_over_unlit_colours_of_vertices():
    # It asks for the points of samples, and these for weights in float64.
    scene, clear = hills(), hills()
    scene.fog = rj.Fog(mode="exp", density=0.3, color="white")
    near = rj.PerspectiveCamera((0.3, 3.0, 2.0), (0.0, 0.0, 0.0))
    outputs = ("linear", "position", "face_id")
    foggy, bare = (rj.render(some, near, size=(64, 48), outputs=outputs) for some in (scene, clear))
    shown = foggy.face_id >= 0
    way = np.linalg.norm(foggy.position[shown] - near.eye, axis=-1)[:, np.newaxis]
    share = np.exp(-0.3 * way)
    want = bare.linear[shown][:, :3] * share + (1.0 - share)
    np.testing.assert_allclose(foggy.linear[shown][:, :3], want, atol=1e-5)


@pytest.mark.parametrize("place", [(0.0, 50.0, 0.0), (0.0, -1.0, 0.0)])
@pytest.mark.parametrize("alpha_mode", ["opaque", "blend"])
def test_what_stands_beside_changes_no_bit(place, alpha_mode):
    # Out of view, and in view below.
    options = {"size": (160, 120), "outputs": ("linear", "object_id")}
    alone = rj.render(hills(), CAMERAS[1], **options)
    scene = hills()
    scene.add(hills("phong", alpha_mode=alpha_mode).nodes[0].mesh, rj.transforms.translate(place))
    assert is_quick(scene)
    both = rj.render(scene, CAMERAS[1], **options)
    own = (both.object_id == 0) & (alone.object_id == 0)
    assert own.mean() > 0.2
    assert both.linear[own].tobytes() == alone.linear[own].tobytes()


def plain():
    scene, mesh = rj.Scene(), hills().nodes[0].mesh
    scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=rj.Material(shading="unlit")))
    return scene


@pytest.mark.parametrize(
    ("scene", "quality", "words"),
    [
        (hills(), FLOAT64, "quality.interpolation_precision is 'float64'"),
        (hills(), rj.Quality(samples=4), "quality.samples is 4"),
        (hills(), rj.Quality(samples="area"), "quality.samples is 'area'"),
        (hills(alpha_mode="blend"), None, "an object is blended"),
        (plain(), None, "no mesh in view has colours of its vertices"),
    ],
)
def test_explain_says_in_its_line_why_colours_stay_float64(scene, quality, words):
    plan = rj.explain(scene, CAMERAS[1], quality, size=(64, 48))
    (shading,) = (effect for effect in plan.effects if effect.name == "shading")
    assert shading.reason.endswith(f"; colours in float64: {words}")
    assert explain_float64(plan.facts) == words


@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong", "pbr"])
@pytest.mark.parametrize("alpha_mode", ["opaque", "blend"])
@pytest.mark.parametrize("picture", [None, rj.Texture(np.zeros((2, 2, 3), np.uint8))])
def test_there_is_a_reason_where_colours_stay_float64_and_nowhere_else(
    shading, alpha_mode, picture
):
    scene, mesh = rj.Scene(), hills().nodes[0].mesh
    material = rj.Material(shading, alpha_mode=alpha_mode, base_color_texture=picture)
    uv = mesh.vertices[:, :2]
    colors = mesh.vertex_colors[:, :3]
    scene.add(rj.Mesh(mesh.vertices, mesh.faces, colors=colors, uv=uv, material=material))
    for quality in (None, FLOAT64, rj.Quality(samples=4), rj.Quality(samples=64)):
        facts = rj.explain(scene, CAMERAS[1], quality, size=(64, 48)).facts
        is_quick = facts.float32_objects is not None
        assert (explain_float64(facts) is None) == is_quick, quality
        assert explain_float64(facts) != UNKNOWN_REASON, quality


def test_nothing_is_weighed_without_something_to_interpolate():
    mesh = hills().nodes[0].mesh
    tinted = rj.Mesh(
        mesh.vertices, mesh.faces, material=rj.Material(shading="unlit"),
        colors=np.random.default_rng(2).uniform(0, 1, (len(mesh.faces), 3)),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(tinted)
    names = {told.name for told in list_passes(rj.explain(scene, CAMERAS[1], size=(64, 48)))}
    assert "attributes.multiply_face_colors" in names
    assert "barycentric_weights.find_weights" not in names


def test_explain_names_it_and_the_stages():
    plan = rj.explain(hills(), CAMERAS[1], size=(64, 48))
    assert "colours in float32" in str(plan)
    names = [told.name for told in list_passes(plan)]
    assert f"float32_colors.{find_float32_colors.__name__}" in names
    assert not {"barycentric_weights.find_weights", "attributes.interpolate_vertex_colors"} & {
        *names
    }
    plan = rj.explain(hills(), CAMERAS[1], FLOAT64, size=(64, 48))
    assert "colours in float64: quality.interpolation_precision is 'float64'" in str(plan)
    assert {"barycentric_weights.find_weights", "attributes.interpolate_vertex_colors"} <= {
        told.name for told in list_passes(plan)
    }
