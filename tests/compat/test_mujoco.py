"""
Pictures of MuJoCo's models against formulas: boxes, spheres, planes and numbers that are known.

``benchmarks/mujoco_beside`` compares with MuJoCo's own renderer, which needs OpenGL.
"""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

REASON = "mujoco is not installed: pip install 'rasterjit[mujoco]'"
mujoco = pytest.importorskip("mujoco", reason=REASON)

import rasterjit as rj  # noqa: E402
from rasterjit.compat import mujoco as drawn  # noqa: E402
from rasterjit.compat.mujoco import model_scene  # noqa: E402
from rasterjit.compat.unit_shapes import make_unit_shape  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs/coming_from/mujoco.md"
HEIGHT, WIDTH = 60, 80
CAMERA = '<camera name="front" pos="0 -4 2" xyaxes="1 0 0 0 0.5 1" fovy="50"/>'


def model_of(body, assets="", camera=CAMERA, flags=""):
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><visual><headlight ambient='.5 .5 .5' diffuse='.5 .5 .5' specular='0 0 0'/>"
        f"{flags}</visual><asset>{assets}</asset><worldbody>{camera}{body}</worldbody></mujoco>"
    )


def data_of(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def pictures(model, camera="front", data=None, **options):
    """Return colour, depth and numbers of a model."""
    with drawn.Renderer(model, HEIGHT, WIDTH, **options) as renderer:
        renderer.update_scene(data_of(model) if data is None else data, camera)
        color = renderer.render()
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.enable_segmentation_rendering()
        return color, depth, renderer.render()


def rays(model, data, camera="front"):
    """Return eye and the ray through the centre of each pixel, (H, W, 3), of depth 1."""
    number = model.camera(camera).id
    tangent = np.tan(0.5 * np.radians(model.cam_fovy[number]))
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2.0 - 1.0) * tangent * WIDTH / HEIGHT
    y = (1.0 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2.0) * tangent
    across, up = np.meshgrid(x, y)
    own = np.stack([across, up, -np.ones_like(across)], axis=-1)
    return data.cam_xpos[number], own @ data.cam_xmat[number].reshape(3, 3).T


@pytest.mark.parametrize("size", ["3 2 1", "0 0 1"])
def test_depth_of_a_plane(size):
    model = model_of(f'<geom name="floor" type="plane" size="{size}"/>')
    data = data_of(model)
    _, depth, numbers = pictures(model, data=data)
    eye, ways = rays(model, data)
    exact = -eye[2] / ways[..., 2]
    hit = eye + exact[..., None] * ways
    far = model.vis.map.zfar * model.stat.extent
    on_it = (exact > 0.0) & (exact < 0.9 * far)
    if size[0] != "0":
        on_it &= (np.abs(hit[..., :2]) < np.array([3.0, 2.0]) - 0.1).all(-1)
    assert on_it.sum() > 400
    np.testing.assert_allclose(depth[on_it], exact[on_it], rtol=2e-5)
    assert (numbers[on_it] == (0, mujoco.mjtObj.mjOBJ_GEOM)).all()
    sky = exact < 0.0
    assert (numbers[sky] == -1).all()
    np.testing.assert_array_equal(depth[sky], np.float32(far))


def test_a_sphere_covers_the_pixels_whose_rays_meet_it():
    model = model_of(
        '<geom type="box" size=".1 .1 .1" pos="5 5 5"/>'
        '<geom type="sphere" size=".7" pos=".3 0 .4"/>',
        flags='<quality numslices="200" numstacks="200"/>',
    )
    data = data_of(model)
    _, depth, numbers = pictures(model, data=data)
    eye, ways = rays(model, data)
    toward = np.array([0.3, 0.0, 0.4]) - eye
    unit = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
    along = unit @ toward
    off = toward @ toward - along**2
    expected = off < 0.49
    assert np.abs((numbers[..., 0] == 1).astype(int) - expected).sum() <= 3
    inside = off < 0.4
    nearest = (along - np.sqrt(np.maximum(0.49 - off, 0.0))) / np.linalg.norm(ways, axis=-1)
    np.testing.assert_allclose(depth[inside], nearest[inside], rtol=1e-3)


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("sphere", "1", 4.0 / 3.0 * np.pi),
        ("ellipsoid", "1 .5 .25", 4.0 / 3.0 * np.pi * 0.125),
        ("capsule", ".5 1", np.pi * 0.25 * 2.0 + 4.0 / 3.0 * np.pi * 0.125),
        ("cylinder", ".5 1", np.pi * 0.25 * 2.0),
        ("box", "1 .5 .25", 1.0),
    ],
)
def test_shapes_are_closed_and_face_outward(kind, size, volume):
    model = model_of(
        f'<geom type="{kind}" size="{size}" pos="1 2 3" euler="20 30 40"/>',
        flags='<quality numslices="128" numstacks="128"/>',
    )
    scene = drawn.from_model(model)
    total, facing = 0.0, True
    for node in scene.nodes:
        points = rj.transforms.apply(node.world_matrix, node.mesh.vertices) - (1, 2, 3)
        a, b, c = np.moveaxis(points[node.mesh.faces], 1, 0)
        sides = np.cross(b - a, c - a)
        total += np.einsum("ij,ij->i", a, sides).sum() / 6.0
        normals = node.mesh.normals[node.mesh.faces].mean(axis=1) @ np.linalg.inv(
            node.world_matrix[:3, :3]
        )
        facing &= bool((np.einsum("ij,ij->i", normals, sides) > 0.0).all())
    assert total == pytest.approx(volume, rel=2e-3)
    assert facing


@pytest.mark.parametrize("name", ["arrow", "arrow1", "arrow2"])
def test_arrows_are_closed_where_they_are_in_mujoco(name):
    surface = make_unit_shape(name, 28, 16, 4)
    a, b, c = np.moveaxis(surface.positions[surface.faces], 1, 0)
    normals = surface.normals[surface.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", normals, np.cross(b - a, c - a)) > 0.0).all()
    wide = 1.0 if name == "arrow1" else 1.75
    low = -0.5 if name == "arrow2" else 0.0
    np.testing.assert_allclose(surface.positions.max(axis=0), (wide, wide, 0.5), atol=1e-12)
    np.testing.assert_allclose(surface.positions.min(axis=0)[2], low, atol=1e-12)


SIDES = [(250, 0, 0), (0, 250, 0), (0, 0, 250), (250, 250, 0), (0, 250, 250), (250, 0, 250)]
"""Colours of a cube's sides: +x, -x, +y, -y, +z, -z."""


@pytest.mark.parametrize(("axis", "sign"), [(a, s) for a in range(3) for s in (1, -1)])
def test_a_cube_map_has_its_sides_where_opengl_has_them(axis, sign):
    up = (0, 0, 1) if axis != 2 else (0, 1, 0)
    eye = [0.0, 0.0, 0.0]
    eye[axis] = 3.0 * sign
    right = np.cross(up, eye) / 3.0
    axes = " ".join(str(part) for part in (*right, *up))
    model = model_of(
        '<geom type="box" size="1 1 1" material="own"/>',
        '<texture name="own" type="cube" builtin="flat" width="16" height="16" rgb1="1 0 0"/>'
        '<material name="own" texture="own" specular="0"/>',
        camera=f'<camera name="front" pos="{eye[0]} {eye[1]} {eye[2]}" xyaxes="{axes}"/>',
    )
    first = model.tex_adr[0]
    model.tex_data[first : first + 6 * 16 * 16 * 3] = np.repeat(SIDES, 256, axis=0).ravel()
    color, *_ = pictures(model)
    expected = SIDES[2 * axis + (sign < 0)]
    np.testing.assert_allclose(color[HEIGHT // 2, WIDTH // 2], expected, atol=8)


def test_a_texture_lies_on_a_plane_as_in_mujoco():
    model = model_of(
        '<geom type="plane" size="1 1 1" material="own"/>',
        '<texture name="own" type="2d" builtin="flat" width="2" height="2" rgb1="1 0 0"/>'
        '<material name="own" texture="own" specular="0"/>',
        camera='<camera name="front" pos="0 0 3" xyaxes="1 0 0 0 1 0"/>',
    )
    first = model.tex_adr[0]
    # The first row lies where y is greatest.
    quarters = np.array([(250, 0, 0), (0, 250, 0), (0, 0, 250), (250, 250, 0)])
    model.tex_data[first : first + 12] = quarters.ravel()
    color, *_ = pictures(model)
    found = color[[17, 17, 42, 42], [27, 52, 27, 52]]
    np.testing.assert_allclose(found, quarters, atol=20)


def test_light_of_a_wall_that_faces_the_eye():
    model = model_of(
        '<geom type="box" size="1 .1 1" rgba=".8 .4 .2 1"/>',
        camera='<camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>',
        flags="<map/>",
    )
    color, *_ = pictures(model)
    middle = color[HEIGHT // 2, WIDTH // 2]
    # The headlight: ambient and diffuse light are 0.5 each, codes as they are.
    np.testing.assert_allclose(middle, np.array([0.8, 0.4, 0.2]) * 255.0, atol=3)
    assert (color[0] == 0).all()


def test_what_is_seen_through_is_mixed_twice():
    model = model_of(
        '<geom type="box" size="1 .1 1" rgba="1 1 1 .5"/>',
        camera='<camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>',
    )
    color, *_ = pictures(model)
    np.testing.assert_allclose(color[HEIGHT // 2, WIDTH // 2], 0.75 * 255.0, atol=3)


def test_a_floor_mirrors_what_stands_on_it():
    body = (
        '<geom type="plane" size="3 3 1" material="own"/>'
        '<geom type="box" size=".5 .1 .5" pos="0 1 .5" rgba="1 0 0 1"/>'
    )
    found = []
    for share in (0.0, 0.5):
        assets = f'<material name="own" rgba="0 0 1 1" specular="0" reflectance="{share}"/>'
        found.append(pictures(model_of(body, assets))[0])
    # Below the box its picture is seen, upside down.
    model = model_of(body, '<material name="own"/>')
    numbers = pictures(model)[2][..., 0]
    rows = np.nonzero(numbers[:, WIDTH // 2] == 1)[0]
    below = rows[-1] + 4
    plain, mirrored = (color[below, WIDTH // 2].astype(int) for color in found)
    assert plain[0] == 0
    assert 90 < mirrored[0] < 140
    assert abs(mirrored[2] - plain[2]) <= 1
    np.testing.assert_array_equal(found[0][: rows[-1] - 2], found[1][: rows[-1] - 2])


FALLING = '<body pos="0 0 1"><freejoint/><geom type="sphere" size=".4" rgba="0 1 0 1"/></body>'


def test_pictures_follow_the_state():
    model = model_of(FALLING)
    data = data_of(model)
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.enable_segmentation_rendering()
        middles = []
        for z in (1.0, 0.5):
            data.qpos[2] = z
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "front")
            middles.append(np.nonzero(renderer.render()[..., 0] == 0)[0].mean())
    assert middles[1] > middles[0] + 4.0


def batch_as_single_pictures(renderer, states, mode):
    """Return the pictures of a batch, which have to be those that are drawn one by one."""
    if mode != "color":
        getattr(renderer, f"enable_{mode}_rendering")()
    batch = renderer.render_batch(states, "front")
    for data, found in zip(states, batch, strict=True):
        renderer.update_scene(data, "front")
        np.testing.assert_array_equal(found, renderer.render())
    return batch


@pytest.mark.parametrize("mode", ["color", "depth", "segmentation"])
@pytest.mark.parametrize("extra", ["", '<light pos="1 -1 3" dir="-.2 .2 -1"/>'])
def test_a_batch_has_the_pictures_of_its_states(mode, extra):
    model = model_of(extra + FALLING + '<geom type="plane" size="2 2 1"/>')
    states = []
    for z in (1.0, 0.7, 0.4):
        data = data_of(model)
        data.qpos[2] = z
        mujoco.mj_forward(model, data)
        states.append(data)
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        batch = batch_as_single_pictures(renderer, states, mode)
    assert len({picture.tobytes() for picture in batch}) == 3


def test_a_batch_refuses_states_that_show_other_geoms():
    model = model_of(FALLING + '<geom type="plane" size="2 2 1"/>')
    option, states = mujoco.MjvOption(), [data_of(model), data_of(model)]
    option.flags[mujoco.mjtVisFlag.mjVIS_CONTACTPOINT] = True
    states[1].qpos[2] = 0.3
    mujoco.mj_forward(model, states[1])
    assert states[1].ncon == 1
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        assert renderer.render_batch([]).shape == (0, HEIGHT, WIDTH, 3)
        assert renderer.render_batch(states, "front").shape == (2, HEIGHT, WIDTH, 3)
        with pytest.raises(ValueError, match=r"states must have the same geoms.*states\[1\]"):
            renderer.render_batch(states, "front", option)


def test_a_scene_of_a_model_is_one_for_rasterjit():
    model = model_of(FALLING + '<geom type="plane" size="2 2 1"/>')
    scene = drawn.from_model(model)
    data = data_of(model)
    scene.follow(data, "front")
    camera = scene.make_camera((WIDTH, HEIGHT))
    frame = rj.render(scene, camera, size=(WIDTH, HEIGHT), outputs=("color", "object_id", "depth"))
    _, depth, numbers = pictures(model, data=data)
    for node, (number, _) in enumerate(scene.list_objects()):
        there = numbers[..., 0] == number
        assert there.sum() > 40
        assert (frame.object_id == node)[there].mean() > 0.98
    seen = np.isfinite(frame.depth) & (numbers[..., 0] >= 0)
    assert (np.abs(frame.depth - depth)[seen] < 1e-3).mean() > 0.98
    before = scene.matrices.copy()
    data.qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    scene.follow(data, "front")
    assert np.abs(scene.matrices - before).max() == pytest.approx(0.5, abs=1e-6)


def test_geoms_that_a_program_adds_are_drawn():
    model = model_of('<geom type="box" size=".1 .1 .1" pos="0 9 0"/>')
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data_of(model), "front")
        scene = renderer.scene
        for kind in (mujoco.mjtGeom.mjGEOM_ARROW, mujoco.mjtGeom.mjGEOM_LINEBOX):
            mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom], kind, np.array([0.2, 0.2, 0.8]), np.zeros(3),
                np.eye(3).ravel(), np.array([1, 0, 0, 1], np.float32),
            )  # fmt: skip
            scene.ngeom += 1
        color = renderer.render()
    assert (color[..., 0] > 60).sum() > 60


@pytest.fixture
def cloth(tmp_path, monkeypatch):
    # MuJoCo warns of it in a file where the program runs.
    monkeypatch.chdir(tmp_path)
    return model_of(
        '<flexcomp type="grid" count="5 5 1" spacing=".3 .3 .3" dim="2" name="cloth" pos="0 0 1" '
        'radius=".02" rgba="0 1 0 1"><contact selfcollide="none"/></flexcomp>'
    )


def test_a_cloth_is_drawn(cloth):
    _, _, numbers = pictures(cloth)
    assert (numbers[..., 1] == mujoco.mjtObj.mjOBJ_FLEX).sum() > 50


@pytest.mark.parametrize("mode", ["color", "depth", "segmentation"])
def test_a_batch_has_the_cloth_of_each_state(cloth, mode):
    states = [data_of(cloth), data_of(cloth)]
    states[1].qpos[2::3] -= 0.4
    mujoco.mj_forward(cloth, states[1])
    with drawn.Renderer(cloth, HEIGHT, WIDTH) as renderer:
        batch = batch_as_single_pictures(renderer, states, mode)
    assert (batch[0] != batch[1]).any()


def test_a_batch_uses_the_threads_of_its_renderer_and_is_as_silent(monkeypatch):
    module = sys.modules["rasterjit.compat.mujoco.renderer"]
    asked, known = [], module.render_batch
    monkeypatch.setattr(
        module, "render_batch", lambda *a, **k: asked.append(k["threads"]) or known(*a, **k)
    )
    camera = '<camera name="front" pos="0 -4 0" xyaxes="-1 0 0 0 0 1"/>'
    model = model_of('<geom type="sphere" size="1"/>', camera=camera)
    with drawn.Renderer(model, HEIGHT, WIDTH, threads=1) as renderer, warnings.catch_warnings():
        warnings.simplefilter("error")
        # The sphere is behind the camera.
        assert not renderer.render_batch([data_of(model)] * 2, "front").any()
    assert asked == [1]


def test_changed_flags_and_textures_are_followed():
    model = model_of(
        '<geom type="plane" size="1 2 1" material="own"/>'
        '<geom name="ball" type="sphere" size=".5" pos="0 0 2.9"/>',
        '<texture name="own" type="2d" builtin="checker" width="64" height="64" rgb1="1 0 0"/>'
        '<material name="own" texture="own" specular="0"/>',
        camera='<camera name="front" pos="0 0 3" xyaxes="1 0 0 0 1 0"/>',
    )
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:

        def picture():
            renderer.update_scene(data_of(model), "front")
            return renderer.render()

        found = [picture()]
        for values in (model.mat_texuniform, model.mat_texrepeat):
            values[0] = 3
            found.append(picture())
        # The camera is in the ball, whose inside is seen now.
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 0
        found.append(renderer.render())
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        np.testing.assert_array_equal(renderer.render(), found[2])
    assert len({one.tobytes() for one in found}) == 4


def test_what_is_kept_is_bounded():
    model = model_of(
        '<geom type="box" size="1 .1 1" material="own"/>',
        '<texture name="own" type="cube" builtin="checker" width="8" height="8" rgb1="1 0 0"/>'
        '<material name="own" texture="own" texuniform="true"/>',
    )
    data = data_of(model)
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        scene = renderer._scene
        for number in range(100):
            model.mat_rgba[0, 0] = model.geom_size[0, 0] = 0.5 + number / 300.0
            scene.follow(data, "front")
            first = scene.nodes[0].mesh
        scene.follow(data, "front")
        assert scene.nodes[0].mesh is first
        for kept in (scene._meshes, scene._surfaces, scene._textures):
            assert 1 <= len(kept) <= 1 + model_scene.MIN_SPARE_ITEMS


@pytest.mark.parametrize("kind", ["LABEL", "NONE"])
def test_geoms_without_a_shape_are_not_drawn(kind):
    model = model_of('<geom type="box" size=".1 .1 .1" pos="0 9 0"/>')
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data_of(model), "front")
        expected, scene = renderer.render(), renderer.scene
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom], getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"), np.ones(3),
            np.zeros(3), np.eye(3).ravel(), np.array([1, 0, 0, 1], np.float32),
        )  # fmt: skip
        scene.ngeom += 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            np.testing.assert_array_equal(renderer.render(), expected)
        scene.geoms[scene.ngeom - 1].type = 77
        with pytest.warns(UserWarning, match="not drawn: geoms of the unknown type 77"):
            np.testing.assert_array_equal(renderer.render(), expected)


def test_point_lights_are_drawn_and_those_of_images_named():
    wall = '<geom type="box" size="2 .1 2"/>'
    camera = '<camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>'
    plain = pictures(model_of(wall, camera=camera, flags="<rgba/>"))[0]
    light = (
        '<light type="point" pos="0 -2 0" diffuse=".5 0 0" specular="0 0 0" castshadow="false"/>'
    )
    model = model_of(light + wall, camera=camera)
    lit = pictures(model)[0].astype(int)
    middle = HEIGHT // 2, WIDTH // 2
    assert lit[middle][0] > plain[middle][0] + 40
    assert abs(lit[middle][1] - int(plain[middle][1])) <= 2
    model.light_type[0] = mujoco.mjtLightType.mjLIGHT_IMAGE
    with pytest.warns(UserWarning, match="not drawn: lights of type image"):
        np.testing.assert_array_equal(pictures(model)[0], plain)


def test_what_is_not_drawn_is_named_once():
    model = model_of('<geom type="sphere" size="1"/>')
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data_of(model), "front")
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_WIREFRAME] = 1
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
        with pytest.warns(UserWarning, match="not drawn: wireframes, segments as colours"):
            renderer.render()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            renderer.render()


def test_an_array_of_ones_own_is_filled():
    model = model_of('<geom type="sphere" size="1"/>')
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data_of(model), "front")
        out = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        assert renderer.render(out=out) is out
        np.testing.assert_array_equal(out, renderer.render())
        with pytest.raises(
            ValueError, match=r"out must be .* uint8 with shape \(60, 80, 3\), got .* \(2, 2\)"
        ):
            renderer.render(out=np.zeros((2, 2), np.uint8))
        with pytest.raises(ValueError, match=r"out must be an array of uint8.*, got .*float64"):
            renderer.render(out=np.zeros((HEIGHT, WIDTH, 3)))
        with pytest.raises(ValueError, match=r"out must be an array of uint8.*, got list"):
            renderer.render(out=[1, 2])
        out.flags.writeable = False
        with pytest.raises(ValueError, match="out must be writable"):
            renderer.render(out=out)
        assert (renderer.height, renderer.width, renderer.model) == (HEIGHT, WIDTH, model)
    data = data_of(model)
    for method, arguments in (
        ("render", ()),
        ("update_scene", (data,)),
        ("render_batch", ([data],)),
    ):
        with pytest.raises(RuntimeError, match=f"{method} cannot be called after close"):
            getattr(renderer, method)(*arguments)


def test_what_is_clear_casts_shadows_and_decorations_do_not():
    floor = '<light pos="0 0 3" dir="0 0 -1" directional="true"/><geom type="plane" size="3 3 1"/>'
    clear = '<geom type="box" size=".4 .4 .1" pos="0 0 1" rgba="1 1 1 .3"/>'
    light, darker = {}, {}
    for name, body in (("nothing", ""), ("clear", clear), ("decoration", "")):
        model = model_of(floor + body)
        with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
            renderer.update_scene(data_of(model), "front")
            if name == "decoration":
                geom = renderer.scene.geoms[renderer.scene.ngeom]
                mujoco.mjv_initGeom(
                    geom, mujoco.mjtGeom.mjGEOM_BOX, (0.4, 0.4, 0.1), (0, 0, 1), np.eye(3).ravel(),
                    np.ones(4, np.float32),
                )  # fmt: skip
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR
                renderer.scene.ngeom += 1
            light[name] = renderer.render()[..., 0].astype(int)
            renderer.enable_segmentation_rendering()
            on_floor = renderer.render()[..., 0] == 0
        darker[name] = light[name] < light["nothing"] - 30
        if name == "clear":
            shadow = darker[name] & on_floor
    assert shadow.sum() > 50
    assert not darker["decoration"][shadow].any()


def test_what_is_not_there_yet_is_drawn_as_nothing():
    model = model_of(
        '<geom type="sphere" size="1"/><body><camera name="own"/></body>', camera=""
    )  # fmt: skip
    far = np.float32(model.vis.map.zfar * model.stat.extent)
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        # Before update_scene, and of states that mj_forward has not seen.
        for update in (None, {"camera": -1}, {"camera": "own"}):
            if update is not None:
                renderer.update_scene(mujoco.MjData(model), **update)
            assert not renderer.render().any()
            renderer.enable_depth_rendering()
            assert (renderer.render() == far).all()
            renderer.enable_segmentation_rendering()
            assert (renderer.render() == -1).all()
            renderer.disable_segmentation_rendering()


def test_wrong_states_and_options_are_named():
    model = model_of('<geom type="sphere" size="1"/>')
    other = data_of(model_of('<geom type="sphere" size="1"/>' * 2))
    twin = data_of(model_of('<geom type="sphere" size="1"/>'))
    with drawn.Renderer(model, HEIGHT, WIDTH) as renderer:
        with pytest.raises(ValueError, match=r"data must be a mujoco\.MjData, got None"):
            renderer.update_scene(None)
        with pytest.raises(ValueError, match=r"data must be of the renderer's model, .*ngeom = 1"):
            renderer.update_scene(other)
        with pytest.raises(ValueError, match=r"states\[1\] must be of the renderer's model"):
            renderer.render_batch([twin, other])
        with pytest.raises(ValueError, match="states must be a sequence, got MjData"):
            renderer.render_batch(twin)
        with pytest.raises(ValueError, match=r"scene_option must be a mujoco\.MjvOption, got 3"):
            renderer.update_scene(twin, scene_option=3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"model": 3}, "model must be a mujoco.MjModel, got 3"),
        ({"height": 0}, "height must be"),
        ({"width": 9999}, "width must be at most 640"),
        ({"max_geom": -1}, "max_geom must be"),
    ],
)
def test_wrong_arguments_are_named(arguments, said):
    model = model_of('<geom type="sphere" size="1"/>')
    with pytest.raises(ValueError, match=said):
        drawn.Renderer(**{"model": model, **arguments})


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ("back", r"camera must be one of \['front'\], got 'back'"),
        (7, r"camera must be in -1..0, got 7"),
        (1.5, "camera must be a number, a name or an MjvCamera, got 1.5"),
    ],
)
def test_wrong_cameras_are_named(camera, said):
    model = model_of('<geom type="sphere" size="1"/>')
    with drawn.Renderer(model) as renderer, pytest.raises(ValueError, match=said):
        renderer.update_scene(data_of(model), camera)


def test_an_environment_renders_without_opengl(monkeypatch):
    gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")
    pytest.importorskip("glfw", reason="gymnasium's MuJoCo environments import it")
    monkeypatch.setenv("MUJOCO_GL", "no such thing")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = gymnasium.make("Reacher-v5", render_mode="rgb_array", width=WIDTH, height=HEIGHT)
        old, closed = made.unwrapped.mujoco_renderer, []
        monkeypatch.setattr(old, "close", lambda: closed.append(True))
        environment = drawn.draw_environment(made)
        ours = made.unwrapped.mujoco_renderer
        assert drawn.draw_environment(made) is made
        assert made.unwrapped.mujoco_renderer is ours
        assert closed == [True]
        environment.reset(seed=0)
        first = environment.render()
        for _ in range(5):
            environment.step(environment.action_space.sample())
        second = environment.render()
    environment.close()
    assert first.shape == (HEIGHT, WIDTH, 3)
    assert first.std() > 10.0
    assert (first != second).any()
    with pytest.raises(ValueError, match="environment must be one of gymnasium's for MuJoCo"):
        drawn.draw_environment(object())
    made.unwrapped.mujoco_renderer = old
    del old._vopt
    with pytest.raises(ValueError, match=r"gymnasium 1\.0 or later, got .* has no _vopt"):
        drawn.draw_environment(made)


def test_the_extra_is_named_where_mujoco_is_missing():
    code = "import sys; sys.modules['mujoco'] = None; import rasterjit.compat.mujoco"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert 'pip install "rasterjit[mujoco]"' in done.stderr


def test_an_older_mujoco_is_refused():
    code = (
        "import sys, types; old = types.ModuleType('mujoco'); old.__version__ = '3.3.0'\n"
        "sys.modules['mujoco'] = old; import rasterjit.compat.mujoco"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "need MuJoCo 3.17 or later" in done.stderr
    assert "(found 3.3.0)" in done.stderr


def test_the_programs_of_the_page_run(monkeypatch, capsys, tmp_path):
    pytest.importorskip("gymnasium", reason="gymnasium is not installed")
    monkeypatch.chdir(tmp_path)
    environments, worlds = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    for program in (environments.replace("1000", "20"), worlds.replace("(100)", "(3)")):
        exec(program, {})
    told = capsys.readouterr().out
    assert "Humanoid-v5 20 pictures (128, 128, 3)" in told
    assert "(64, 84, 84, 3) uint8" in told
    assert {path.stem for path in tmp_path.glob("*.gif")} == {"Humanoid-v5", "HalfCheetah-v5"}
