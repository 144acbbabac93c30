"""What a frame costs is measured, not guessed; what it runs and holds is what is told."""

from __future__ import annotations

import dataclasses
import importlib
import sys

import numpy as np
import pytest
import switched_off
from kernel_files import kernel_modules

import rasterjit as rj
from rasterjit.inspect import profile
from rasterjit.pipeline.passes import shorten_module_name
from rasterjit.rendering import planning
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.runtime import jit
from rasterjit.runtime.stage_runner import StageList
from rasterjit.scene.material import CORE_TEXTURES

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


def test_shadows_are_tried_where_their_maps_are_of_a_bounded_size(cube):
    for count, is_tried in ((2, True), (200, False)):
        scene = rj.Scene()
        scene.add(cube)
        scene.add(cube, rj.transforms.translate((0.0, 2.5, 0.0)))
        scene.lights = [rj.PointLight((0.0, 5.0, float(n)), intensity=9.0) for n in range(count)]
        found = profile.list_variations(rj.explain(scene, looking()), scene, rj.Quality())
        assert any(name == "shadows" for name, *_ in found) == is_tried


def test_every_effect_that_is_in_is_measured_without(cube, monkeypatch):
    # Another test draws what could be added; here its kernels would be compiled for nothing.
    monkeypatch.setattr(profile, "EFFECTS", ())
    scene = rich_scene(cube)
    measured = rj.profile(scene, looking(), size=SIZE, rounds=2, threads=1)
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


def rows_of(plan):
    """Whether each effect is in, and why."""
    return {effect.name: (effect.used, effect.reason) for effect in plan.effects}


def test_variations_switch_what_they_name(cube):
    scene, camera, quality = rich_scene(cube), looking(), rj.Quality()
    plan = rj.explain(scene, camera, size=SIZE)
    found = profile.list_variations(plan, scene, quality)
    assert {what for _, what, _, _ in found} >= {
        "off", "of 1 light, maps of 1024 x 1024", "4 samples", "on",
    }  # fmt: skip
    before = rows_of(plan)
    for name, what, changed, other in found:
        after = rows_of(rj.explain(changed, camera, other, size=SIZE))
        assert before[name][0] == (what == "off"), name
        assert after[name][0] != before[name][0], name


def whites(side, **options):
    return rj.Texture(np.ones((side, side, 4), np.float32), **options)


def textured(cube, shading, **textures):
    """A scene of one cube under textures."""
    scene, material = rj.Scene(), rj.Material(shading, **textures)
    scene.add(rj.Mesh(cube.vertices, cube.faces, uv=np.zeros((8, 2)), material=material))
    return scene


def test_textures_switched_off_are_those_of_all_maps(cube):
    scene = textured(
        cube, "pbr", base_color_texture=whites(2), normal_texture=whites(4),
        metallic_roughness_texture=whites(4), occlusion_texture=whites(4),
        emissive_texture=whites(4),
    )  # fmt: skip
    found = profile.list_variations(rj.explain(scene, looking()), scene, rj.Quality())
    (bare,) = [changed for name, what, changed, _ in found if name == "textures"]
    assert not any(bare.nodes[0].mesh.material.textures_read())
    rows = rows_of(rj.explain(bare, looking()))
    assert [name for name, row in rows.items() if row[0] and ("map" in name or "tex" in name)] == []
    assert rows["emission"][0]
    assert all(scene.nodes[0].mesh.material.textures_read()[: len(CORE_TEXTURES)])


def test_textures_are_tried_with_mip_levels(cube):
    shared, normals = whites(2, filter="nearest", wrap="clamp"), whites(2)
    scene = textured(
        cube, "unlit", base_color_texture=shared, emissive_texture=shared, normal_texture=normals
    )
    found = profile.list_variations(rj.explain(scene, looking()), scene, rj.Quality())
    ((what, changed),) = [row[1:3] for row in found if row[0] == "textures" and row[1] != "off"]
    material = changed.nodes[0].mesh.material
    assert what == "mip levels for 1 of them"
    assert material.base_color_texture is material.emissive_texture
    assert (material.base_color_texture.filter, shared.filter) == ("trilinear", "nearest")
    assert material.base_color_texture.wrap == ("clamp", "clamp")
    assert material.normal_texture is normals


def test_environment_light_goes_and_the_background_stays(cube):
    scene, camera = rj.Scene(), looking()
    scene.add(cube)
    scene.environment = rj.Environment.gradient("blue", "white", "green")
    found = profile.list_variations(rj.explain(scene, camera), scene, rj.Quality())
    changed = {name: scene for name, what, scene, _ in found if what == "off"}
    unlit, unseen = (
        rows_of(rj.explain(changed[name], camera))
        for name in ("environment light", "environment background")
    )
    assert (unlit["environment light"][0], unlit["environment background"][0]) == (False, True)
    assert (unseen["environment light"][0], unseen["environment background"][0]) == (True, False)
    assert "headlight, for the scene has no lights" not in unlit["lights"][1]
    options = {"size": (32, 24), "outputs": ("linear", "face_id")}
    whole = rj.render(scene, camera, **options)
    dark = rj.render(changed["environment light"], camera, **options)
    sky = whole.face_id < 0
    np.testing.assert_array_equal(dark.linear[sky], whole.linear[sky])
    assert whole.linear[sky][:, :3].max() > 0.5
    assert whole.linear[~sky][:, :3].max() > 0.1
    assert dark.linear[~sky][:, :3].max() == 0.0


def test_what_could_be_switched_on_is_what_the_scene_has_data_for(cube):
    def tried(scene, **options):
        plan = rj.explain(scene, looking(), size=SIZE, **options)
        found = profile.list_variations(plan, scene, rj.Quality())
        return {name: what for name, what, _, _ in found if what != "off"}

    scene = rj.Scene()
    scene.add(cube)
    besides = {
        "tone mapping": "curve neutral", "ambient occlusion": "on",
        "outline": "on, one pixel wide", "anti-aliasing": "4 samples", "vignette": "on",
        "eye-dome lighting": "on",
    }  # fmt: skip
    assert tried(scene) == besides
    # Neither an outline nor a tone curve is seen in linear light, and nothing in depths.
    assert {*tried(scene, outputs=("linear",))} == {
        "ambient occlusion", "anti-aliasing", "eye-dome lighting",
    }  # fmt: skip
    assert tried(scene, outputs=("depth",)) == {}
    # What changes nothing could do something; what is there already could not do more.
    scene.tone_map, scene.outline = rj.ToneMap("none"), rj.Outline()
    scene.ambient_occlusion = rj.AmbientOcclusion(strength=0.0)
    assert {*tried(scene)} == {*besides} - {"outline"}
    # Ambient light alone is occluded; lights alone cast shadows, where something can.
    scene.lights = [rj.PointLight((0.0, 9.0, 0.0))]
    assert {*tried(scene)} == {
        "tone mapping", "anti-aliasing", "shadows", "vignette", "eye-dome lighting",
    }  # fmt: skip
    shadow = rj.Shadow(size=64)
    scene.lights += [rj.DirectionalLight((0, -1, 0), shadow=shadow), rj.SpotLight((9.0, 0.0, 0.0))]
    assert tried(scene)["shadows"] == "of 2 more lights, maps of 1024 x 1024"
    plan = rj.explain(scene, looking())
    (changed,) = [
        changed
        for name, what, changed, _ in profile.list_variations(plan, scene, rj.Quality())
        if name == "shadows" and what != "off"
    ]
    assert [light.shadow for light in changed.lights] == [rj.Shadow(), shadow, rj.Shadow()]


PARTS_OF_OTHERS = {
    "shading", "lights", "smooth normals", "microfacets", "single-sided objects", "diagnostics",
    "anti-aliasing", "background image",
}  # fmt: skip
"""Rows that a frame is not itself without, or that `variations` switches in a way of its own."""


def test_every_effect_has_a_switch_or_is_part_of_another(cube):
    scene = rich_scene(cube)
    scene.environment = rj.Environment.gradient()
    rows = [effect.name for effect in rj.explain(scene, looking()).effects]
    assert rows == [effect.name for effect in EFFECTS]
    kept = {effect.name for effect in EFFECTS if effect.without(scene) is None}
    assert kept == PARTS_OF_OTHERS


def test_samples_are_tried_where_edges_are_not_smoothed(cube):
    scene = rj.Scene()
    scene.add(cube)

    def smoothed(quality):
        plan = rj.explain(scene, looking(), quality)
        found = profile.list_variations(plan, scene, quality)
        return [(what, other.samples) for name, what, _, other in found if name == "anti-aliasing"]

    assert smoothed(rj.Quality()) == [("4 samples", 4)]
    assert smoothed(rj.Quality(samples=8)) == [("off", 1)]
    assert smoothed(rj.Quality(subpixel_bits=0)) == []


def test_measurement_prints_plan_kernels_buffers_and_times(cube):
    scene = rj.Scene()
    scene.add(cube)
    scene.outline = rj.Outline()
    text = str(rj.profile(scene, looking(), size=SIZE, rounds=1))
    for words in (
        "outline", "kernels", "outline.find_edges", "stages", "light_stages.start_with_ambient",
        "buffers", "marks of outlines", "median of 1 frames", "outline: off", "visibility",
        "ambient occlusion: on", "tone mapping: curve neutral", "anti-aliasing: 4 samples",
    ):  # fmt: skip
        assert words in text, words


@pytest.mark.parametrize("rounds", [0, -1, 1.5, True])
def test_rounds_must_be_a_number_of_frames(cube, rounds):
    with pytest.raises(ValueError, match="rounds must be a whole number above 0"):
        rj.profile(cube, looking(), size=SIZE, rounds=rounds)


def test_arguments_are_those_of_render(cube):
    with pytest.raises(ValueError, match="size"):
        rj.profile(cube, looking(), size=(0, 5))
    with pytest.raises(ValueError, match="quality"):
        rj.profile(cube, looking(), quality="best", size=SIZE)
    with pytest.raises(ValueError, match="outputs has 'beauty'"):
        rj.profile(cube, looking(), size=SIZE, outputs=("beauty",))


@pytest.fixture
def called(monkeypatch):
    """The names of the kernels that were called, as ``module.function``."""
    names = []

    class Watched:
        def __init__(self, kernel, name):
            self.kernel, self.name = kernel, name
            self.__name__, self.__module__ = kernel.__name__, kernel.__module__

        def __call__(self, *arguments):
            names.append(self.name)
            return self.kernel(*arguments)

        def bind(self, arguments):
            names.append(self.name)
            return self.kernel.bind(arguments)

    for found in kernel_modules():
        importlib.import_module(found)
    for module in [one for name, one in sys.modules.items() if name.startswith("rasterjit.")]:
        for name, thing in list(vars(module).items()):
            if any(thing is kernel for kernel in jit.KERNELS):
                own = f"{shorten_module_name(thing.__module__)}.{thing.__name__}"
                monkeypatch.setattr(module, name, Watched(thing, own))
    return names


@pytest.fixture
def ran(monkeypatch):
    """The names of the stages of each list that was run, in order."""
    lists, run = [], StageList.run

    def noted(own, *arguments):
        lists.append(tuple(step.stage.__name__ for step in own.steps()))
        run(own, *arguments)

    monkeypatch.setattr(StageList, "run", noted)
    return lists


MIXED = {
    "rich codes": {"blending": "srgb8"},
    "rich codes of samples": {"blending": "srgb8", "samples": 4},
    "codes of samples": {"blending": "srgb8", "samples": 4},
    "codes of areas": {"blending": "srgb8", "samples": "area"},
    "covered edges": {"lines": "coverage"},
    "rich covered edges": {"lines": "coverage", "blending": "srgb8"},
    "area": {"samples": "area"},
    "samples": {"samples": 4},
    "pictures": {"samples": 64},
    "rich pictures": {"samples": 64},
    "pictures of codes": {"samples": 64, "blending": "srgb8"},
    "rich pictures of codes": {"samples": 64, "blending": "srgb8"},
    "everything in samples": {"samples": 4},
}
"""Settings of the quality by the cases that have any."""


@pytest.mark.parametrize(
    "case", ["plain", "rich", "gouraud", "buffers", "edges", "shadows", "everything", *MIXED]
)
def test_kernels_and_stages_told_are_those_called(cube, called, ran, case):
    scene, camera, outputs, diagnose = rj.Scene(), looking(), ("color",), False
    scene.add(cube)
    if "codes" in case:
        outputs = ("color", "linear")
    if "rich" in case:
        scene = rich_scene(cube)
    elif "everything" in case:
        scene, camera = switched_off.full_scene(), switched_off.CAMERA
    elif case == "gouraud":
        cube.material = dataclasses.replace(cube.material, shading="gouraud")
    elif case == "buffers":
        outputs, diagnose = ("depth", "barycentric", "position", "normal", "object_id"), True
    elif "edges" in case:
        scene.wireframe = rj.Wireframe("red", "only")
    elif case == "shadows":
        scene.lights = [rj.PointLight((0.5, 3.0, 1.0), intensity=9.0, shadow=rj.Shadow(size=64))]
        scene.add(cube, rj.transforms.translate((0, -2.5, 0)))
        scene.environment = rj.Environment.gradient()
    options = {"size": SIZE, "outputs": outputs, "diagnose": diagnose}
    options["quality"] = rj.Quality(**MIXED.get(case, {}))
    if "pictures" in case:
        options["size"] = (24, 18)
    plan = rj.explain(scene, camera, **options)
    rj.render(scene, camera, **options)
    told = planning.list_kernels(plan)
    assert set(called) <= {kernel.name for kernel in told}
    assert {kernel.name for kernel in told if not kernel.condition} <= set(called)
    stages = [stage.name.partition(".")[2] for stage in planning.list_passes(plan)]
    untouched = {*stages} - {name for names in ran for name in names}
    # Of several samples with glass among them, rows of tiles without glass alone are mixed so.
    has_glass = {"rich", "everything"} & {*case.split()}
    assert untouched <= ({"encode_samples", "accumulate_layers"} if has_glass else set())
    assert {name for names in ran for name in names} <= {*stages}
    # Where a picture is drawn in one go, in this order.
    if len({*ran}) == 1 and not untouched:
        assert [*ran[0]] == stages


def test_kernels_are_told_with_the_form_that_is_called(cube):
    scene, camera = rj.Scene(), looking()
    scene.add(cube)
    fence = dataclasses.replace(cube.material, alpha_mode="mask", base_color=(1, 1, 1, 0.2))
    # In view of the camera of before, beside that of now.
    scene.add(
        rj.Mesh(cube.vertices, cube.faces, material=fence), rj.transforms.translate((9, 0, 0))
    )
    scene.lights = [rj.DirectionalLight(shadow=rj.Shadow(64))]
    fine = rj.Quality(depth_format="float64")

    def told(plan):
        return {(kernel.name, kernel.variant) for kernel in planning.list_kernels(plan)}

    layered = told(rj.render_layers(scene, camera, k=2, size=SIZE, quality=fine).plan)
    assert {("a_buffer.split_lists", ""), ("a_buffer.find_layers", "float64 depth")} <= layered
    assert told(rj.explain(scene, camera, fine, size=SIZE, diagnose=True)) >= {
        ("diagnostics_stage.count_samples", "float64 depth"),
        ("hierarchical_z.find_tile_depths", "float64 depth"),
        ("hierarchical_z.find_tile_depths", ""),
        ("tile_rasterizer.draw_batch", "float64 depth"), ("tile_rasterizer.draw_batch", ""),
    }  # fmt: skip
    scene.lights, beside = [], rj.PerspectiveCamera(eye=(9, 1, 6), target=(9, 0, 0))
    options = {"outputs": ("motion_visible",), "size": SIZE}
    for before, has_holes in ((camera, False), (beside, True)):
        plan = rj.explain(scene, camera, previous=rj.PreviousView(camera=before), **options)
        assert (("alpha_test.queue_triangle", "") in told(plan)) == has_holes


def test_buffers_have_the_bytes_of_arrays(cube):
    scene, outputs = rich_scene(cube), ("color", "linear", "depth", "normal", "object_id")
    plan = rj.explain(scene, looking(), size=SIZE, outputs=outputs)
    frame = rj.render(scene, looking(), size=SIZE, outputs=outputs)
    told = {buffer.name: buffer.bytes for buffer in planning.list_buffers(plan)}
    for name, array in frame.arrays().items():
        assert told[f"output {name}"] == array.nbytes
    assert told["faces seen"] == np.zeros(SIZE, np.int32).nbytes
    plain = rj.explain(cube, looking(), size=SIZE)
    assert [buffer.name for buffer in planning.list_buffers(plain)] == [
        "faces seen",
        "output color",
    ]
