"""What a frame costs is measured, not guessed; what it runs and holds is what is told."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import rasterjit as rj
from rasterjit import kernels, measurement, plan_resources

SIZE = (64, 48)


def looking():
    return rj.PerspectiveCamera(eye=(2.5, 3.0, 4.0), target=(0, 0, 0), near=0.5, far=20.0)


def rich_scene(cube):
    """A scene of several effects."""
    scene = rj.Scene()
    scene.add(cube, name="cube")
    glass = rj.Material(base_color=(0.2, 0.4, 0.8, 0.5), alpha_mode="blend")
    square = [(-2, -1, -2), (2, -1, -2), (2, -1, 2), (-2, -1, 2)]
    scene.add(rj.Mesh(square, [(0, 2, 1), (0, 3, 2)], material=glass), name="pane")
    scene.lights = [rj.AmbientLight(intensity=0.5), rj.DirectionalLight((-1, -2, -1))]
    scene.ambient_occlusion = rj.AmbientOcclusion(radius=0.7)
    scene.outline = rj.Outline()
    scene.fog = rj.Fog(density=0.1)
    scene.tone_map = rj.ToneMap("reinhard")
    scene.wireframe = rj.Wireframe("red")
    return scene


def test_every_effect_that_is_in_is_measured_without(cube):
    scene = rich_scene(cube)
    measured = rj.measure(scene, looking(), size=SIZE, rounds=2, threads=1)
    used = {effect.name for effect in measured.plan.effects if effect.used}
    wanted = {"ambient occlusion", "outline", "fog", "tone mapping", "wireframe", "transparency"}
    assert wanted <= used
    assert wanted <= {change.name for change in measured.changes if change.what == "off"}
    assert {change.name for change in measured.changes} <= used | {"anti-aliasing"}
    for change in measured.changes:
        assert change.seconds > 0.0
        assert change.difference == change.seconds - measured.total
    assert measured.rounds == 2
    assert measured.threads == 1
    assert "compile" not in measured.stages
    assert measured.stages["outline"] > 0.0
    # The scene itself is as it was.
    assert scene.fog is not None
    assert [node.name for node in scene.nodes] == ["cube", "pane"]
    assert scene.nodes[1].mesh.material.alpha_mode == "blend"


def test_variations_switch_off_what_they_name(cube):
    scene, camera, quality = rich_scene(cube), looking(), rj.Quality()
    plan = rj.explain(scene, camera, size=SIZE)
    for name, what, changed, other in measurement.variations(plan, scene, quality):
        again = rj.explain(changed, camera, other, size=SIZE)
        before = {effect.name: effect.used for effect in plan.effects}
        after = {effect.name: effect.used for effect in again.effects}
        assert before[name] == (what == "off"), name
        assert after[name] != before[name], name


def test_every_effect_has_a_switch_or_is_part_of_another(cube):
    scene = rj.Scene()
    scene.add(cube)
    names = {effect.name for effect in rj.explain(scene, looking()).effects}
    assert names == {*measurement.SWITCHES, *measurement.PARTS_OF_OTHERS}


def test_samples_are_tried_where_edges_are_not_smoothed(cube):
    scene = rj.Scene()
    scene.add(cube)
    plan = rj.explain(scene, looking())
    (found,) = measurement.variations(plan, scene, rj.Quality())
    assert found[:2] == ("anti-aliasing", "4 samples")
    assert found[3].samples == 4
    smooth = rj.Quality(samples=8)
    plan = rj.explain(scene, looking(), smooth)
    (found,) = measurement.variations(plan, scene, smooth)
    assert (found[1], found[3].samples) == ("off", 1)
    whole = rj.Quality(subpixel_bits=0)
    assert measurement.variations(rj.explain(scene, looking(), whole), scene, whole) == []


def test_measurement_prints_plan_kernels_buffers_and_times(cube):
    scene = rj.Scene()
    scene.add(cube)
    scene.outline = rj.Outline()
    text = str(rj.measure(scene, looking(), size=SIZE, rounds=1))
    for words in (
        "outline", "kernels", "shading.shade_rows", "light, ", "outlines.find_edges", "buffers",
        "marks of outlines", "median of 1 frames", "outline: off", "visibility",
    ):  # fmt: skip
        assert words in text, words


@pytest.mark.parametrize("rounds", [0, -1, 1.5, True])
def test_rounds_must_be_a_number_of_frames(cube, rounds):
    with pytest.raises(ValueError, match="rounds must be a whole number above 0"):
        rj.measure(cube, looking(), size=SIZE, rounds=rounds)


def test_arguments_are_those_of_render(cube):
    with pytest.raises(ValueError, match="size"):
        rj.measure(cube, looking(), size=(0, 5))
    with pytest.raises(ValueError, match="quality"):
        rj.measure(cube, looking(), quality="best", size=SIZE)
    with pytest.raises(ValueError, match="outputs has 'beauty'"):
        rj.measure(cube, looking(), size=SIZE, outputs=("beauty",))


@pytest.fixture
def called(monkeypatch):
    """The names of the kernels that were called, as ``module.function``."""
    names = []

    def watched(kernel, name):
        def call(*arguments):
            names.append(name)
            return kernel(*arguments)

        return call

    for found in pkgutil.iter_modules(kernels.__path__):
        module = importlib.import_module(f"rasterjit.kernels.{found.name}")
        for name, thing in list(vars(module).items()):
            if any(thing is kernel for kernel in kernels.jit.KERNELS):
                monkeypatch.setattr(module, name, watched(thing, f"{found.name}.{name}"))
    return names


@pytest.mark.parametrize(
    "case", ["plain", "rich", "gouraud", "buffers", "edges", "shadows", "area"]
)
def test_kernels_told_are_those_called(cube, called, case):
    scene, camera, outputs, diagnose = rj.Scene(), looking(), ("color",), False
    scene.add(cube)
    if case == "rich":
        scene = rich_scene(cube)
    elif case == "gouraud":
        cube.material = dataclasses.replace(cube.material, shading="gouraud")
    elif case == "buffers":
        outputs, diagnose = ("depth", "barycentric", "position", "normal", "object_id"), True
    elif case == "edges":
        scene.wireframe = rj.Wireframe("red", "only")
    elif case == "shadows":
        scene.lights = [rj.PointLight((0.5, 3.0, 1.0), intensity=9.0, shadow=rj.Shadow(size=64))]
        scene.add(cube, rj.transforms.translate((0, -2.5, 0)))
        scene.environment = rj.Environment.gradient()
    options = {"size": SIZE, "outputs": outputs, "diagnose": diagnose}
    options["quality"] = rj.Quality(samples="area" if case == "area" else 1)
    plan = rj.explain(scene, camera, **options)
    rj.render(scene, camera, **options)
    told = plan_resources.list_kernels(plan)
    assert set(called) <= {kernel.name for kernel in told}
    assert {kernel.name for kernel in told if not kernel.condition} <= set(called)


def test_buffers_have_the_bytes_of_arrays(cube):
    scene, outputs = rich_scene(cube), ("color", "linear", "depth", "normal", "object_id")
    plan = rj.explain(scene, looking(), size=SIZE, outputs=outputs)
    frame = rj.render(scene, looking(), size=SIZE, outputs=outputs)
    told = {buffer.name: buffer.bytes for buffer in plan_resources.list_buffers(plan)}
    for name, array in frame.arrays().items():
        assert told[f"output {name}"] == array.nbytes
    assert told["faces seen"] == np.zeros(SIZE, np.int32).nbytes
    plain = rj.explain(cube, looking(), size=SIZE)
    assert [buffer.name for buffer in plan_resources.list_buffers(plain)] == [
        "faces seen",
        "output color",
    ]
