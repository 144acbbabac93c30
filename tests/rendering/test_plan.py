"""Only what the scene calls for is planned; errors name the argument."""

from __future__ import annotations

import html

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.output_table import MOTION_OUTPUTS, OUTPUTS, check_outputs
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.scene.material import SHADINGS
from rasterjit.survey.object_transforms import transform_nodes_to_view


def scene_of(*materials, cube):
    scene = rj.Scene()
    for material in materials:
        scene.add(rj.Mesh(cube.vertices, cube.faces, material=material))
    return scene


def effects(plan):
    return {effect.name: effect.used for effect in plan.effects}


@pytest.mark.parametrize(
    ("material", "lit", "smooth", "gouraud", "highlights"),
    [
        (rj.Material("unlit"), False, False, False, None),
        (rj.Material("flat", specular=0.0), True, False, False, None),
        (rj.Material("flat", specular=0.5), True, False, False, 1),
        (rj.Material("gouraud", specular=0.0), True, True, True, None),
        (rj.Material("phong", specular=0.0), True, True, False, None),
        (rj.Material("phong"), True, True, False, 1),
    ],
)
def test_plan_holds_what_the_material_needs(
    cube, camera, material, lit, smooth, gouraud, highlights
):
    plan = rj.explain(scene_of(material, cube=cube), camera, size=(8, 8))
    assert (plan.lighting is not None) == lit
    assert plan.facts.needs_normals == smooth
    assert plan.facts.needs_gouraud == gouraud
    assert (plan.lighting.highlights if lit else None) == highlights
    assert effects(plan)["shading"]
    assert effects(plan)["lights"] == lit
    assert effects(plan)["smooth normals"] == smooth
    assert not effects(plan)["wireframe"]


def test_unlit_highlight_asks_for_nothing(cube, camera):
    scene = scene_of(
        rj.Material("unlit", specular=1.0), rj.Material("flat", specular=0.0), cube=cube
    )
    assert rj.explain(scene, camera).lighting.highlights is None


def test_ground_truth_alone_asks_for_no_shading(cube, camera):
    plan = rj.explain(cube, camera, outputs=("depth", "face_id"))
    assert not plan.facts.is_colored
    assert plan.lighting is None
    assert not plan.facts.needs_normals
    assert not any(effects(plan).values())


def test_normal_output_asks_for_normals_and_no_light(cube, camera):
    plan = rj.explain(cube, camera, outputs="normal")
    assert plan.facts.needs_normals
    assert plan.lighting is None


@pytest.mark.parametrize("shading", SHADINGS)
def test_vertex_normals_are_read_for_the_output_alone_or_for_smooth_shading(
    cube, camera, shading, monkeypatch
):
    scene = scene_of(rj.Material(shading), cube=cube)
    plan = rj.explain(scene, camera, outputs=("color", "normal"))
    assert plan.facts.needs_normals
    (reason,) = (effect.reason for effect in plan.effects if effect.name == "smooth normals")
    shown = "output normal, of every object"
    smooth = shading in ("gouraud", "phong", "pbr")
    assert reason == (f"shading {shading}; {shown}" if smooth else shown)
    turned = str(rj.explain(scene, camera, outputs="normal_camera"))
    assert "output normal_camera, of every object" in turned
    if smooth:
        return
    monkeypatch.setattr(rj.Mesh, "vertex_normals", None)
    normals = "normal", "normal_camera"
    outputs = [name for name in OUTPUTS if name not in (*normals, "uv", "scalar", *MOTION_OUTPUTS)]
    frame = rj.render(scene, camera, size=(8, 8), outputs=outputs)
    assert not frame.plan.facts.needs_normals
    for name in normals:
        with pytest.raises(TypeError):
            rj.render(scene, camera, size=(8, 8), outputs=name)


def test_normals_of_an_object_out_of_view_are_not_asked_for(cube, camera):
    away = rj.PerspectiveCamera(camera.eye, 2.0 * np.array(camera.eye) - camera.target)
    assert not rj.explain(cube, away, outputs="normal").facts.needs_normals


def test_scene_without_lights_gets_a_headlight(cube, camera):
    plan = rj.explain(cube, camera)
    assert plan.lighting.lights.shape == (1, 13)
    assert plan.lighting.lights[0, 3] == 0.0
    assert np.linalg.norm(plan.lighting.ambient) > 0.0
    # It shines away from the viewer.
    forward = np.array(camera.target) - camera.eye
    assert plan.lighting.lights[0, :3] @ forward < 0.0


def test_lights_of_the_scene_are_planned_in_order(cube, camera):
    scene = scene_of(rj.Material(), cube=cube)
    scene.lights = [
        rj.PointLight((1, 2, 3), intensity=2.0), rj.AmbientLight(intensity=0.25),
        rj.DirectionalLight((0, -2, 0), color=(1.0, 0.5, 0.0)), rj.AmbientLight(intensity=0.5),
    ]  # fmt: skip
    lighting = rj.explain(scene, camera).lighting
    relative = np.array([1, 2, 3]) - camera.eye
    np.testing.assert_allclose(lighting.lights[0, :7], [*relative, 1, 2, 2, 2], rtol=1e-6)
    np.testing.assert_allclose(lighting.lights[1, :7], [0, 1, 0, 0, 1, 0.5, 0], rtol=1e-6)
    # Neither cone nor range.
    assert (lighting.lights[:, 7:] == [0, 0, 0, 0, 1, 0]).all()
    assert lighting.ambient.tolist() == [0.75, 0.75, 0.75]
    assert lighting.lights.dtype == lighting.ambient.dtype == np.float32


def test_wireframe_only_shades_no_face(cube, camera):
    scene = scene_of(rj.Material(), cube=cube)
    scene.wireframe = rj.Wireframe(mode="only")
    plan = rj.explain(scene, camera)
    assert not plan.facts.draws_faces
    assert plan.lighting is None
    assert effects(plan)["wireframe"]
    scene.wireframe = rj.Wireframe(mode="overlay")
    assert rj.explain(scene, camera).facts.draws_faces
    assert not rj.explain(scene, camera, outputs="depth").has("wireframe")


def test_plan_prints_as_a_table(cube, camera):
    text = str(rj.explain(cube, camera, size=(320, 200), outputs=("color", "depth"), cull="back"))
    rows = dict(line.split("  ", 1) for line in text.splitlines())
    assert rows["size"].strip() == "320 x 200 pixels"
    assert rows["outputs"].strip() == "color, depth"
    assert rows["culling"].strip() == "back"
    assert rows["lights"].strip().startswith("in ")
    assert "headlight" in rows["lights"]
    assert rows["wireframe"].strip().startswith("out")
    # The second column is aligned.
    names = [line.split("  ", 1)[0] for line in text.splitlines()]
    starts = {
        len(line) - len(line[len(name) :].lstrip())
        for line, name in zip(text.splitlines(), names, strict=True)
    }
    assert len(starts) == 1


def test_reports_show_themselves_as_their_text(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    frame = rj.render(scene, camera, size=(8, 8), max_error=0.5, diagnose=True)
    reports = [
        frame.plan, frame.diagnostics, frame.choice,
        rj.profile(scene, camera, size=(8, 8), rounds=1),
        rj.explain_pixel(scene, camera, (8, 8), 4, 4),
    ]  # fmt: skip
    for report in reports:
        assert repr(report) == str(report)
        assert html.unescape(report._repr_html_()) == f"<pre>{report}</pre>"
    assert len(repr(frame.choice)) < 200
    for part in (*frame.plan.effects, *frame.plan.planned, frame.plan.facts):
        assert len(repr(part)) < 200
    assert repr(scene) == "Scene(1 objects, 12 faces, 0 lights)"


def test_plan_tells_what_the_frame_did(cube, camera):
    frame = rj.render(cube, camera, size=(16, 12), outputs=("depth", "color", "depth"), threads=1)
    assert frame.plan.outputs == ("depth", "color")
    assert frame.plan.size == (16, 12)
    told = rj.explain(cube, camera, size=(16, 12), outputs=("depth", "color"))
    assert str(frame.plan) == str(told.for_picture(view=None))


def test_outputs_are_listed_once_in_order():
    assert check_outputs("depth") == ("depth",)
    assert check_outputs(["uv", "color", "uv"]) == ("uv", "color")
    for output in OUTPUTS:
        assert check_outputs([output]) == (output,)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"outputs": ("color", "colour")}, ["outputs", "'colour'", "face_id"]),
        ({"outputs": ()}, ["outputs"]),
        ({"outputs": "uv"}, ["outputs", "uv", "texture"]),
        ({"outputs": "scalar"}, ["outputs", "scalar", "no mesh"]),
        ({"cull": "both"}, ["cull", "both"]),
        ({"size": (0, 4)}, ["size"]),
        ({"size": (4, 16385)}, ["size"]),
        ({"quality": 8}, ["quality"]),
        ({"background": "nocolour"}, ["background"]),
        ({"background": (2.0, 0, 0)}, ["background"]),
    ],
)
def test_wrong_argument_is_named(cube, camera, options, words):
    for call in (rj.explain, rj.render):
        with pytest.raises(ValueError, match=words[0]) as error:
            call(cube, camera, **options)
        for word in words:
            assert word in str(error.value)


def test_wrong_scene_or_camera_is_named(cube, camera):
    with pytest.raises(ValueError, match="scene"):
        rj.explain(rj.Scene(), camera)
    with pytest.raises(ValueError, match="camera"):
        rj.explain(cube, "here")
    with pytest.raises(ValueError, match="camera"):
        rj.render(cube, camera=np.eye(4))
    with pytest.raises((ValueError, TypeError)):
        rj.render(3, camera)


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_viewport_reaches_the_guard_band(bits):
    for size in ((1, 1), (640, 480), (16384, 16384)):
        viewport = make_viewport(size, bits)
        assert viewport.grid_bits == max(bits, 1)
        # The guard band ends 8192 pixels beyond each side: |x| = guard w lands there.
        assert abs((viewport.guard_x + 1.0) * size[0] / 2 - (size[0] + 8192)) < 1e-6
        assert abs((viewport.guard_y + 1.0) * size[1] / 2 - (size[1] + 8192)) < 1e-6


def test_linear_colour_alone_calls_for_no_wireframe(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe("red")
    plan = rj.explain(scene, camera, outputs=("linear",))
    assert plan.data("wireframe") is None
    assert "no output shows colour in 8 bits" in str(plan)
    assert rj.explain(scene, camera, outputs=("color",)).data("wireframe") is scene.wireframe


@pytest.mark.parametrize("place", [3.5e38, -1e308])
def test_light_beyond_the_range_of_float32_gives_next_to_no_light(cube, camera, place):
    scene = scene_of(rj.Material("phong", specular=0.5), cube=cube)
    scene.lights = [rj.PointLight((0.0, 0.0, place))]
    frame = rj.render(scene, camera, size=(8, 8), outputs=("linear", "face_id"))
    seen = frame.linear[frame.face_id >= 0][:, :3]
    assert (seen >= 0.0).all()
    assert seen.max() < 1e-30  # the inverse square of the distance at which it is held


def test_textures_are_planned_where_a_material_has_one(cube, camera):
    plain = rj.explain(cube, camera)
    assert not plain.facts.needs_textures
    assert "no material has a texture" in str(plain)
    texture = rj.Texture([[0.5]], filter="nearest")
    mesh = rj.Mesh(cube.vertices, cube.faces, uv=cube.vertices[:, :2],
                   material=rj.Material(base_color_texture=texture))  # fmt: skip
    plan = rj.explain(mesh, camera)
    assert plan.facts.needs_textures
    assert "1 nearest" in str(plan)
    assert not rj.explain(mesh, camera, outputs="depth").facts.needs_textures


def test_light_without_highlights_is_planned_for_textured_gouraud_alone(cube, camera):
    def plan(**options):
        texture = rj.Texture([[0.5]])
        material = rj.Material(**{"base_color_texture": texture, "shading": "gouraud", **options})
        mesh = rj.Mesh(cube.vertices, cube.faces, uv=cube.vertices[:, :2], material=material)
        return rj.explain(mesh, camera)

    assert plan().facts.needs_diffuse_light
    assert not plan(specular=0.0).facts.needs_diffuse_light
    assert not plan(shading="phong").facts.needs_diffuse_light
    assert not plan(base_color_texture=None).facts.needs_diffuse_light


def test_a_texture_without_uv_is_refused_by_the_name_of_its_node(cube, camera):
    scene = rj.Scene()
    cube.material = rj.Material(base_color_texture=rj.Texture([[0.5]]))
    scene.add(cube, name="crate")
    for call in (rj.explain, rj.render):
        with pytest.raises(ValueError, match=r"mesh of 'crate' must have uv, .*base_color_texture"):
            call(scene, camera)
    # Where no colour is asked for, there is nothing to lay.
    assert rj.render(scene, camera, size=(4, 4), outputs="depth", threads=1).depth.shape == (4, 4)


def test_every_reason_is_spelled_out(cube, camera):
    texture = rj.Texture([[0.5]], filter="bilinear")
    painted = rj.Mesh(cube.vertices, cube.faces, uv=cube.vertices[:, :2],
                      material=rj.Material("gouraud", base_color_texture=texture))  # fmt: skip
    scene = scene_of(rj.Material("phong"), rj.Material("unlit"), cube=cube)
    scene.add(painted)
    scene.add(painted)
    scene.lights = [rj.PointLight((1, 2, 3)), rj.AmbientLight(), rj.PointLight((3, 2, 1))]
    scene.wireframe = rj.Wireframe("red")
    plan = rj.explain(scene, camera, size=(8, 6), diagnose=True)
    assert str(plan).splitlines() == [
        "size                     8 x 6 pixels",
        "camera                   perspective, at (2.5, 3, 4), looks along (-0.4472, -0.5367, "
        "-0.7155), 45 degrees from top to bottom",
        "up                       +y of the world",
        "in view                  100 % of the surface, over 4 x 5 of 8 x 6 pixels",
        "outputs                  color",
        "sub-pixel bits           8",
        "culling                  none",
        "near                     0.5 (given)",
        "far                      20 (given)",
        "shading                  in  (gouraud, phong, unlit; colours in float64: "
        "an object is lit)",
        "lights                   in  (2 PointLight, 1 AmbientLight)",
        "shadows                  out (no light casts them)",
        "smooth normals           in  (shading gouraud, phong)",
        "textures                 in  (1 bilinear (base color))",
        "scalar fields            out (no mesh has scalars of its vertices)",
        "alpha masks              out (no material has the alpha_mode 'mask')",
        "microfacets              out (no material is shaded pbr)",
        "normal maps              out (no lit material has a normal_texture)",
        "metallic-roughness maps  out (no lit material has a metallic_roughness_texture)",
        "occlusion maps           out (no lit material has an occlusion_texture)",
        "emission                 out (no material is emissive)",
        "clearcoat                out (no pbr material has a clearcoat)",
        "sheen                    out (no pbr material has a sheen_color)",
        "specular and ior         out (no pbr material has an ior or specular_ field of its own)",
        "single-sided objects     out (every material is double_sided)",
        "environment light        out (scene.environment is None)",
        "environment background   out (scene.environment is None)",
        "background image         out (the render was given no picture)",
        "eye-dome lighting        out (scene.eye_dome is None)",
        "fog                      out (scene.fog is None)",
        "transmission             out (no pbr material has a transmission above 0)",
        "tone mapping             out (scene.tone_map is None)",
        "ambient occlusion        out (scene.ambient_occlusion is None)",
        "vignette                 out (scene.vignette is None)",
        "hidden lines             out (scene.outline is None)",
        "outline                  out (scene.outline is None)",
        "section                  out (scene.section is None)",
        "section hatching         out (scene.section is None)",
        "section lines            out (scene.section is None)",
        "transparency             out (no material is blended)",
        "anti-aliasing            out (quality.samples is 1)",
        "wireframe                in  (mode overlay)",
        "labels                   out (no node has a label)",
        "diagnostics              in  (diagnose=True)",
    ]
    scene.wireframe = rj.Wireframe("red", mode="only")
    rows = str(rj.explain(scene, camera, outputs="linear")).splitlines()
    for row in (
        "shading                  out (only the wireframe is drawn)",
        "lights                   out (nothing is shaded)",
        "shadows                  out (nothing is lit)",
        "smooth normals           out (shading gouraud, phong)",
        "textures                 out (nothing is shaded)",
        "wireframe                out (no output shows colour in 8 bits)",
        "diagnostics              out (diagnose=False)",
    ):
        assert row in rows
    assert not any("  in  (" in row for row in rows)


def test_a_plan_tells_of_the_scene_as_it_was(cube, camera):
    scene = scene_of(rj.Material("phong"), cube=cube)
    scene.lights = [rj.AmbientLight()]
    early, late = (rj.explain(scene, camera, size=(8, 8)) for _ in range(2))
    expected = str(early)
    scene.lights.append(rj.PointLight((1, 2, 3)))
    scene.nodes[0].mesh.material = rj.Material("unlit")
    scene.wireframe = rj.Wireframe()
    assert str(late) == expected
    assert str(rj.explain(scene, camera, size=(8, 8))) != expected


def test_objects_are_placed_together_as_each_is_alone(cube, camera):
    rng = np.random.default_rng(3)
    nodes = []
    for number in range(60):
        matrix = np.eye(4)
        matrix[:3] = np.round(rng.normal(size=(3, 4)) * 2.0) if number % 3 else 0.0
        matrix[:3] *= 10.0 ** rng.integers(-150, 150) if number % 2 else -1.0
        nodes.append(rj.Node(cube, matrix, ""))
    together = transform_nodes_to_view(nodes, camera, (64, 48))
    assert {-1.0, 1.0} == set(together.mirrored.tolist())
    for number, node in enumerate(nodes):
        alone = transform_nodes_to_view([node], camera, (64, 48))
        for name in ("relative_from_model", "normal_matrices", "mirrored"):
            assert getattr(alone, name)[0].tobytes() == getattr(together, name)[number].tobytes()
        linear = node.world_from_model[:3, :3]
        determinant = np.linalg.det(linear / max(np.abs(linear).max(), 1e-300))
        if abs(determinant) > 1e-3:
            assert together.mirrored[number] == np.sign(determinant)


def test_what_is_no_light_or_node_is_refused_in_good_grammar(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    scene.lights = ["sun"]
    with pytest.raises(ValueError, match=r"^scene\.lights\[0\] must be an AmbientLight or Direc"):
        rj.explain(scene, camera)
    scene.lights, scene.nodes = [], [cube]
    with pytest.raises(ValueError, match=r"^scene\.nodes\[0\] must be a Node, got Mesh"):
        rj.explain(scene, camera)


@pytest.mark.parametrize(("name", "label"), [(None, "object 0"), ("pane", r"'pane' \(object 0\)")])
def test_an_object_without_a_name_is_called_by_its_number_once(cube, camera, name, label):
    scene = rj.Scene()
    material = rj.Material(base_color=(1, 0, 0, 0.5), alpha_mode="blend")
    scene.add(rj.Mesh(cube.vertices, cube.faces, material=material), name=name)
    with pytest.raises(ValueError, match=f"got 'area' and {label} with alpha_mode 'blend'$"):
        rj.explain(scene, camera, rj.Quality(samples="area"))


@pytest.mark.parametrize("wrong", [{"outputs": "nonsense"}, {"cull": "sides"}, {"diagnose": 2}])
def test_wrong_arguments_are_told_before_skins_are_posed(cube, monkeypatch, wrong):
    def pose(scene):
        raise AssertionError("it runs kernels")

    monkeypatch.setattr("rasterjit.survey.deformation.pose_scene", pose)
    with pytest.raises(ValueError, match=next(iter(wrong))):
        rj.render(cube, size=(8, 8), **wrong)
