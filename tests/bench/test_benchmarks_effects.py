"""What effects cost: the scenes, the arithmetic, and that both sides draw the same."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from opengl import skip_or_fail

import rasterjit as rj

sys.path.append(str(Path(__file__).parents[2]))
absent = importlib.import_module("benchmarks.effects_absent")
contestants = importlib.import_module("benchmarks.contestants")
effects = importlib.import_module("benchmarks.effects")
fx = importlib.import_module("benchmarks.effects_scenes")
pairing = importlib.import_module("benchmarks.pairing")
pictures = importlib.import_module("benchmarks.pictures")
report = importlib.import_module("benchmarks.report")
scenes = importlib.import_module("benchmarks.scenes")

own = importlib.import_module("benchmarks.contestants.rasterjit_effects")

TWINS = [effect for effect in fx.EFFECTS if effect.twins]


def small(variant):
    return fx.find_variant(variant + fx.SMALL)


def picture_of(key, variant):
    prepared = contestants.contestant(key).prepare(small(variant), 1)
    prepared.draw()
    prepared.draw()
    prepared.read()
    return prepared.picture()


@pytest.fixture(scope="module")
def drawn_by():
    """Return what draws in a process of its own: what OpenGL draws with keeps 20 MB each time."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:

        def draw(key, variant):
            reason = contestants.contestant(key).available()
            if reason is not None:
                skip_or_fail(reason)
            return pool.submit(picture_of, key, variant).result()

        yield draw


@pytest.mark.parametrize("variant", fx.VARIANTS)
def test_variants_have_the_documented_arrays(variant):
    for scene in (fx.find_variant(variant), scenes.find_scene(f"effect:{variant}{fx.SMALL}")):
        for part in scene.parts:
            assert part.positions.dtype == part.normals.dtype == part.uv.dtype == np.float32
            assert part.faces.dtype == np.int32
            assert part.faces.min() == 0
            assert part.faces.max() == len(part.positions) - 1
            np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-6)


def test_the_torus_has_seventy_thousand_faces():
    assert 70_000 <= len(fx.find_variant("unlit").parts[0].faces) < 71_000


@pytest.mark.parametrize("effect", fx.EFFECTS, ids=lambda effect: effect.on)
def test_off_and_on_differ_by_one_effect(effect):
    off, on = small(effect.off), small(effect.on)
    fields = [field.name for field in dataclasses.fields(off) if field.name not in ("parts", "eye")]
    differing = [
        name for name in fields if not np.array_equal(getattr(off, name), getattr(on, name))
    ]
    assert len(differing) == 1


def effects_in(variant):
    """Name and reason of each effect that a variant is planned with."""
    scene = small(variant)
    plan = rj.explain(
        own.make_scene(scene), own.make_camera(scene), own.make_quality(scene), size=scene.size,
        outputs=("color",), background=own.background_of(scene),
    )  # fmt: skip
    return {effect.name: effect.reason for effect in plan.effects if effect.used}


CALLED_FOR = {
    "nearest": "textures", "bilinear": "textures", "trilinear": "textures",
    "anisotropic": "textures", "mask": "alpha masks", "flat": "lights", "gouraud": "lights",
    "phong": "lights", "pbr": "microfacets", "environment": "environment light",
    "backdrop": "environment background", "fog": "fog", "height_fog": "fog",
    "tone_map": "tone mapping", "aces": "tone mapping", "neutral": "tone mapping",
    "maps": "normal maps", "occlusion": "ambient occlusion", "outline": "outline",
    "eye_dome": "eye-dome lighting", "creases": "outline", "wireframe": "wireframe",
    "unlit_msaa": "anti-aliasing",
    "phong_msaa_2": "anti-aliasing", "phong_msaa": "anti-aliasing",
    "phong_msaa_8": "anti-aliasing", "phong_msaa_16": "anti-aliasing",
    "phong_area": "anti-aliasing", "shadow": "shadows", "soft_shadow": "shadows",
    "spot_shadow": "shadows", "point_shadow": "shadows", "layers": "transparency",
}  # fmt: skip
"""What each variant has that the one without the effect has not."""


@pytest.mark.parametrize("effect", fx.EFFECTS, ids=lambda effect: effect.on)
def test_rasterjit_draws_the_effect_and_else_the_same(effect, monkeypatch):
    # Four maps of full size take 200 MB while they are made.
    monkeypatch.setattr(fx, "TEXTURE_SIDE", 64)
    off, on = effects_in(effect.off), effects_in(effect.on)
    assert CALLED_FOR[effect.on] in on.keys() - off.keys()
    assert off.keys() <= on.keys()
    if effect.on == "maps":
        kinds = {"normal maps", "metallic-roughness maps", "occlusion maps", "emission"}
        assert kinds <= on.keys() - off.keys()


@pytest.mark.parametrize("effect", fx.EFFECTS, ids=lambda effect: effect.on)
def test_twins_are_named_where_there_are_any(effect):
    theirs = contestants.contestant(fx.TWIN)
    has_twin = all(theirs.draws(small(name)) is None for name in (effect.off, effect.on))
    assert has_twin == bool(effect.twins)


def test_shadows_are_those_that_the_titles_name():
    lights = {
        variant: own.make_light(fx.find_variant(variant))
        for variant in ("shadow", "soft_shadow", "spot_shadow", "point_shadow")
    }
    assert [type(light) for light in lights.values()] == [
        rj.DirectionalLight, rj.DirectionalLight, rj.SpotLight, rj.PointLight,
    ]  # fmt: skip
    filters = [light.shadow.filter for light in lights.values()]
    assert filters == ["pcf", "soft", "pcf", "pcf"]
    assert effects_in("spot_shadow")["shadows"].startswith("1 map of 2048")
    assert effects_in("point_shadow")["shadows"].startswith("6 maps of 1024")


@pytest.mark.parametrize(
    "variant",
    ["bilinear", "phong", "shadow", "phong_msaa", "height_fog", "tone_map", "aces", "neutral"],
)
def test_opengl_draws_the_picture_of_rasterjit(variant, drawn_by):
    own, theirs = (drawn_by(key, variant) for key in ("rasterjit_effects", fx.TWIN))
    shares = pictures.agreement(own, theirs)
    assert own["covered"].mean() > 0.3
    assert not pictures.differs(shares, pictures.Needed(0.999, 0.97)), shares


def test_layers_are_alike_peeled_and_sorted(drawn_by):
    peeled, sorted_ = (drawn_by(key, "layers") for key in (fx.TWIN, fx.SORTED))
    front = drawn_by(fx.TWIN, "opaque_layers")
    # Eight roundings to 8 bits, each half a step, at different places of the sum.
    apart = np.abs(peeled["color_linear"].astype(int) - sorted_["color_linear"])
    assert apart.max() <= fx.LAYERS
    assert np.abs(front["color_linear"].astype(int) - sorted_["color_linear"]).max() > 30


@pytest.mark.parametrize("effect", TWINS, ids=lambda effect: effect.on)
def test_opengl_draws_every_effect_that_has_a_twin(effect, drawn_by):
    for key in effect.twins:
        for variant in (effect.off, effect.on):
            assert contestants.contestant(key).draws(small(variant)) is None
            assert drawn_by(key, variant)["covered"].mean() > 0.3


def run_of(variant, seconds, key=effects.OWN, pixels=1000):
    run = pairing.Run(pairing.Entry(key, f"effect:{variant}", 1))
    run.seconds, run.draw_seconds, run.processor_seconds = [list(seconds) for _ in range(3)]
    run.picture = {"covered": np.ones((1, pixels), bool)}
    return run


def test_a_row_tells_what_an_effect_adds():
    effect = fx.EFFECTS[0]
    own_off, own_on = run_of("unlit", [0.010] * 3), run_of("nearest", [0.015, 0.016, 0.014])
    off, on = (run_of(name, [time] * 3, fx.TWIN) for name, time in [("unlit", 0.03), ("on", 0.06)])
    own = effects.row_of(effect, own_off, own_on, own_on, "reference")
    assert own.factor == pytest.approx(1.5)
    assert own.nanoseconds == pytest.approx(5000.0)
    assert own.ratio is None
    mesa = effects.row_of(effect, off, on, own_on, "")
    assert mesa.ratio == pytest.approx(4.0)
    assert effects.cells(mesa)[3:7] == ["30.0", "60.0", "2.00", "30000.0"]


def test_a_missing_contestant_has_no_figures():
    run = run_of("nearest", [0.1], fx.TWIN)
    run.missing = "missing: no OpenGL"
    row = effects.row_of(fx.EFFECTS[0], run, run, run_of("nearest", [0.1]), run.missing)
    assert (row.ms, row.factor, row.ratio, row.check) == (None, None, None, "missing: no OpenGL")


def test_without_history_the_table_of_plain_scenes_says_so(monkeypatch):
    monkeypatch.setattr(absent, "BASELINE", "0123456789abcdef0123456789abcdef01234567")
    with pytest.raises(absent.HistoryAbsentError, match="no git history with 0123"):
        absent.measure_absent((1,), True)
    assert "no git history" in effects.show_absent((1,), True)


def test_fresh_processes_tell_seconds_of_compiling_and_memory(monkeypatch, tmp_path):
    class Tree:
        folder = tmp_path

        def __init__(self, number):
            self.number = number

        def environment(self, cache):
            return {"number": str(self.number)}

    def draw(folder, scene, environment):
        return {"seconds": 1.0 + int(environment["number"]), "peak": 3 << 20}

    monkeypatch.setattr(absent, "fresh", draw)
    seconds, peak = absent.compare_fresh([Tree(0), Tree(1)], "mesh_70k")
    assert (seconds.before, seconds.after, seconds.ratio) == (1.0, 2.0, 2.0)
    assert (peak.before, peak.after) == (3.0, 3.0)


def test_the_command_measures_an_effect(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    arguments = ["--smoke", "--no-baseline", "--only", "phong", "--threads", "1"]
    result = CliRunner().invoke(effects.main, arguments)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "effects.json").read_text())
    own = found["effects"][0]
    assert (own["contestant"], own["threads"], found["baseline"]) == ("RasterJIT", 1, "c3e18ef")
    assert min(own["off_ms"], own["ms"], own["factor"]) > 0.0
    if os.environ.get("CI"):
        assert found["effects"][1]["ratio"] > 0.0
    assert "Phong" in (tmp_path / "effects.md").read_text()
