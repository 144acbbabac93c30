"""Pictures of PyBullet's worlds beside TinyRenderer's, and what programs change on the way."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

REASON = "pybullet is not installed: pip install 'rasterjit[pybullet]'"
pybullet = pytest.importorskip("pybullet", reason=REASON)

from rasterjit.compat.pybullet import getCameraImage  # noqa: E402

TINY, OPENGL = pybullet.ER_TINY_RENDERER, pybullet.ER_BULLET_HARDWARE_OPENGL
LINKS = pybullet.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX
PAGE = Path(__file__).parents[2] / "docs/coming_from/pybullet.md"
THEIRS = pybullet.getCameraImage
WIDTH, HEIGHT = 160, 120
# TinyRenderer keeps what an earlier call gave it.
LIGHT = {
    "lightDirection": [-50, 30, 100], "lightColor": [1, 1, 1], "shadow": 0,
    "lightAmbientCoeff": 0.6, "lightDiffuseCoeff": 0.35, "lightSpecularCoeff": 0.05,
}  # fmt: skip
AMBIENT = {**LIGHT, "lightAmbientCoeff": 1, "lightDiffuseCoeff": 0, "lightSpecularCoeff": 0}
pytestmark = pytest.mark.filterwarnings("ignore::rasterjit.LoadWarning")


@pytest.fixture(autouse=True)
def world():
    import pybullet_data

    client = pybullet.connect(pybullet.DIRECT)
    assert client == 0
    pybullet.setAdditionalSearchPath(pybullet_data.getDataPath())
    yield Path(pybullet_data.getDataPath())
    pybullet.disconnect()


def matrices(eye=(2.0, -2.0, 1.5), target=(0.0, 0.0, 0.4), up=(0, 0, 1), far=50.0):
    view = pybullet.computeViewMatrix(eye, target, up)
    return view, pybullet.computeProjectionMatrixFOV(50, WIDTH / HEIGHT, 0.1, far)


def draw(camera=None, renderer=TINY, function=getCameraImage, **options):
    options = {**LIGHT, **options}
    camera = matrices() if camera is None else camera
    return function(WIDTH, HEIGHT, *camera, renderer=renderer, **options)


def near_edges(numbers):
    """Mark pixels that touch one of another number."""
    padded = np.pad(numbers, 1, mode="edge")
    around = [padded[y : y + HEIGHT, x : x + WIDTH] for y in range(3) for x in range(3)]
    return np.any(np.array(around) != numbers, axis=0)


def add(kind=pybullet.GEOM_BOX, position=(0, 0, 0), color=(1, 1, 1, 1), **shape):
    size = {"halfExtents": [0.5, 0.5, 0.5]} if kind == pybullet.GEOM_BOX else {}
    visual = pybullet.createVisualShape(kind, rgbaColor=color, **{**size, **shape})
    return pybullet.createMultiBody(0, -1, visual, position)


ABOVE = {"eye": (0, 0, 3), "target": (0, 0, 0), "up": (0, 1, 0)}


def middle(picture):
    return picture[2][HEIGHT // 2, WIDTH // 2, :3].astype(int)


@pytest.mark.parametrize(
    ("model", "scale", "round_shapes"),
    [
        ("kuka_iiwa/model.urdf", 1.0, False), ("table/table.urdf", 1.0, False),
        ("duck_vhacd.urdf", 8.0, False), ("racecar/racecar.urdf", 3.0, False),
        ("cube.urdf", 0.7, False), ("r2d2.urdf", 1.0, True), ("humanoid/humanoid.urdf", 0.2, True),
    ],
)  # fmt: skip
def test_models_are_as_in_the_original(model, scale, round_shapes):
    pybullet.loadURDF("plane.urdf")
    body = pybullet.loadURDF(model, [0, 0, 0.6], [0.1, 0.2, 0.3, 0.9], globalScaling=scale)
    for joint in range(pybullet.getNumJoints(body)):
        pybullet.resetJointState(body, joint, 0.3)
    theirs, ours = (draw(function=one, flags=LINKS) for one in (THEIRS, getCameraImage))
    assert [type(part) for part in ours] == [type(part) for part in theirs]
    for a, b in zip(ours[2:], theirs[2:], strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
    numbers, edges = theirs[4], near_edges(theirs[4]) | near_edges(ours[4])
    assert len(np.unique(numbers)) >= 3
    differs = ours[4] != numbers
    assert not (differs & ~edges).any()
    assert differs.sum() <= (100 if round_shapes else 12)
    # Balls and cylinders are rounder here.
    within = np.abs(ours[3] - theirs[3])[~edges]
    assert np.quantile(within, 0.995) < (1e-3 if round_shapes else 1e-5)
    assert np.abs(ours[2].astype(int) - theirs[2])[~edges].mean() < 8.0
    by_body = draw()[4]
    np.testing.assert_array_equal(by_body, np.where(ours[4] < 0, -1, ours[4] & 0xFFFFFF))
    assert (draw(flags=pybullet.ER_NO_SEGMENTATION_MASK)[4] == -1).all()


def test_shapes_of_mjcf_files_and_single_rigid_bodies_stand_where_the_original_has_them():
    pybullet.loadMJCF("mjcf/ant.xml")
    pybullet.loadURDF("cube.urdf", [0, 2, 0.5], useMaximalCoordinates=True)
    theirs, ours = (draw(function=one, flags=LINKS) for one in (THEIRS, getCameraImage))
    edges = near_edges(theirs[4]) | near_edges(ours[4])
    assert len(np.unique(ours[4])) > 10
    assert not ((theirs[4] != ours[4]) & ~edges).any()


def test_depth_is_that_of_a_depth_buffer():
    add()
    near, far = 0.1, 20.0
    depth = draw(matrices(**ABOVE, far=far))[3]
    expected = far / (far - near) * (1.0 - near / 2.5)
    assert depth[HEIGHT // 2, WIDTH // 2] == pytest.approx(expected, rel=1e-6)
    assert depth[0, 0] == 1.0
    parallel = np.diag([0.5, 0.5, -2.0 / (far - near), 1.0])
    parallel[2, 3] = -(far + near) / (far - near)
    depth = draw((matrices(**ABOVE)[0], parallel.T.ravel()))[3]
    assert depth[HEIGHT // 2, WIDTH // 2] == pytest.approx((2.5 - near) / (far - near), rel=1e-6)


def test_pixels_are_sampled_at_their_centres_or_where_tiny_renderer_does():
    add(halfExtents=[0.5, 0.5, 0.0001])
    view, _ = matrices(**ABOVE)
    # The square's sides are 20.25 pixels from the middle.
    clip = pybullet.computeProjectionMatrix(
        *(np.array([-1, 1, -0.75, 0.75]) * 80 * 0.5 / 20.25 * 0.1 / 2.9999), 0.1, 9
    )
    # Columns 59.75 to 100.25, rows 39.75 to 80.25: centres at halves, or lower left corners.
    for renderer, function, bounds in (
        (TINY, THEIRS, (39, 60, 79, 100)), (TINY, getCameraImage, (39, 60, 79, 100)),
        (OPENGL, getCameraImage, (40, 60, 79, 99)),
    ):  # fmt: skip
        pixels = np.argwhere(draw((view, clip), renderer, function)[4] == 0)
        assert (*pixels.min(axis=0), *pixels.max(axis=0)) == bounds


def test_matrices_that_are_not_given_are_the_originals():
    pybullet.loadURDF("r2d2.urdf", [0, 0, 0.1])
    theirs, ours = (one(WIDTH, HEIGHT, renderer=TINY) for one in (THEIRS, getCameraImage))
    differs = theirs[4] != ours[4]
    assert (theirs[4] == 0).sum() > 300
    assert not (differs & ~near_edges(theirs[4]) & ~near_edges(ours[4])).any()


def test_light_is_computed_with_codes_as_in_the_original():
    add(color=(0.9, 0.5, 0.2, 1.0))
    for name, value in (
        ("lightDirection", [1, 2, 2]), ("lightColor", [0.5, 1.0, 0.2]), ("lightAmbientCoeff", 0.2),
        ("lightDiffuseCoeff", 0.9), ("lightDirection", [1, 2, -2]),
    ):  # fmt: skip
        options = {"lightSpecularCoeff": 0.0, name: value}
        theirs, ours = (
            draw(matrices(**ABOVE), function=one, **options) for one in (THEIRS, getCameraImage)
        )
        np.testing.assert_allclose(middle(ours), middle(theirs), atol=2)


def test_a_shadow_takes_a_fifth_of_the_light():
    pybullet.createMultiBody(
        0, -1, pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=[3, 3, 0.01])
    )
    add(position=(0, 0, 1), halfExtents=[0.4, 0.4, 0.1])
    camera = matrices(eye=(0, -3, 1.5), target=(0, 0, 0))
    options = {"lightDirection": [0, 0, 1], "lightSpecularCoeff": 0.0}
    lit, shaded = (middle(draw(camera, shadow=on, **options)) for on in (0, 1))
    np.testing.assert_allclose(lit, 255 * 0.95, atol=1)
    np.testing.assert_allclose(shaded, 255 * (0.6 + 0.8 * 0.35), atol=1)


def test_what_a_program_changes_is_seen_in_the_next_picture():
    camera = matrices(**ABOVE)
    assert (draw(camera)[4] == -1).all()
    body = add()
    assert (middle(draw(camera, **AMBIENT)) == 255).all()
    pybullet.changeVisualShape(body, -1, rgbaColor=[1, 0, 0.2, 1])
    np.testing.assert_array_equal(middle(draw(camera, **AMBIENT)), [255, 0, 51])
    pybullet.resetBasePositionAndOrientation(body, [10, 0, 0], [0, 0, 0, 1])
    assert (draw(camera)[4] == -1).all()
    pybullet.resetBasePositionAndOrientation(body, [0, 0, 0], [0, 0, 0, 1])
    other = add(position=(0, 0, 0.5), halfExtents=[0.1, 0.1, 0.1])
    assert draw(camera)[4][HEIGHT // 2, WIDTH // 2] == other
    pybullet.removeBody(other)
    assert draw(camera)[4][HEIGHT // 2, WIDTH // 2] == body
    pybullet.changeVisualShape(body, -1, rgbaColor=[1, 0, 0.2, 0])
    assert (draw(camera)[4] == -1).all()
    pybullet.resetSimulation()
    add(color=(0, 1, 0, 1))
    np.testing.assert_array_equal(middle(draw(camera, **AMBIENT)), [0, 255, 0])


def test_textures_come_go_and_change(tmp_path):
    camera = matrices(**ABOVE)
    texels = np.zeros((64, 64, 3), np.uint8)
    texels[..., 0], texels[..., 1] = np.arange(64) * 4, np.arange(64)[:, None] * 4
    Image.fromarray(texels).save(tmp_path / "texture.png")
    body = add()
    texture = pybullet.loadTexture(str(tmp_path / "texture.png"))
    pybullet.changeVisualShape(body, -1, textureUniqueId=texture)
    assert (middle(draw(camera, **AMBIENT)) != 255).all()
    pybullet.changeTexture(texture, [10, 20, 30] * 4, 2, 2)
    np.testing.assert_array_equal(middle(draw(camera, **AMBIENT)), [10, 20, 30])
    pybullet.changeVisualShape(body, -1, textureUniqueId=-1)
    assert (middle(draw(camera, **AMBIENT)) == 255).all()
    pybullet.resetSimulation()
    add()
    assert (middle(draw(camera, **AMBIENT)) == 255).all()


@pytest.mark.parametrize(
    ("shape", "apart"),
    [
        ({"kind": pybullet.GEOM_BOX}, 1.0),
        ({"kind": pybullet.GEOM_SPHERE, "radius": 0.5}, 12.0),
        ({"kind": pybullet.GEOM_CYLINDER, "radius": 0.4, "length": 0.8}, 8.0),
        ({"kind": pybullet.GEOM_CAPSULE, "radius": 0.3, "length": 0.5}, 14.0),
        ({"kind": pybullet.GEOM_MESH, "fileName": "sphere_smooth.obj",
          "meshScale": [0.5] * 3}, 4.0),
        ({"kind": pybullet.GEOM_MESH, "fileName": "kuka_iiwa/meshes/link_1.stl",
          "meshScale": [3.0] * 3}, 2.0),
    ],
)  # fmt: skip
def test_textures_lie_where_the_original_has_them(shape, apart, tmp_path):
    texels = np.zeros((256, 256, 3), np.uint8)
    texels[..., 0], texels[..., 1] = np.arange(256), np.arange(256)[:, None]
    Image.fromarray(texels).save(tmp_path / "texture.png")
    body, texture = add(**shape), pybullet.loadTexture(str(tmp_path / "texture.png"))
    pybullet.changeVisualShape(body, -1, textureUniqueId=texture)
    # Not from -z, where a ball's seam lies, which the original's few corners blur.
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        eye = [0.2, 0.3, 0.1]
        eye[axis] = 2.0 * sign
        camera = matrices(eye, (0, 0, 0), (0, 0, 1) if axis < 2 else (0, 1, 0))
        theirs, ours = (draw(camera, function=one, **AMBIENT) for one in (THEIRS, getCameraImage))
        both = (theirs[4] == body) & (ours[4] == body)
        assert both.sum() > 500
        assert np.median(np.abs(theirs[2].astype(int) - ours[2])[both], axis=0).max() < apart, axis


def test_soft_bodies_are_followed_as_in_the_original():
    pybullet.resetSimulation(pybullet.RESET_USE_DEFORMABLE_WORLD)
    pybullet.setGravity(0, 0, -10)
    cloth = pybullet.loadSoftBody(
        "cloth_z_up.obj", basePosition=[0, 0, 1], scale=0.5, mass=1, useMassSpring=1
    )
    pybullet.createSoftBodyAnchor(cloth, 20, -1, -1)
    drawn = []

    def check():
        pybullet.stepSimulation()
        theirs, ours = (draw(function=one) for one in (THEIRS, getCameraImage))
        assert (theirs[4] == cloth).sum() > 200
        assert (theirs[4] != ours[4]).sum() <= 2
        assert np.quantile(np.abs(theirs[3] - ours[3]), 0.999) < 1e-5
        drawn.append(ours[4])

    check()
    for _ in range(40):
        pybullet.stepSimulation()
    check()
    options = {"flags": pybullet.MESH_DATA_SIMULATION_MESH}
    points = np.array(pybullet.getMeshData(cloth, -1, **options)[1])
    pybullet.resetMeshData(cloth, (points * (1.0, 0.5, 1.0)).tolist())
    check()
    assert (drawn[0] != drawn[1]).sum() > 100
    assert (drawn[1] != drawn[2]).sum() > 100
    pybullet.removeBody(cloth)
    assert (draw()[4] == -1).all()


def test_meshes_of_vertices_and_planes_are_drawn_as_in_the_original():
    add(
        pybullet.GEOM_MESH, (0, 0, 0.3), (1, 0.5, 0, 1), meshScale=[2, 1, 1],
        vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], indices=[0, 1, 2],
        normals=[[0, 0, 1]] * 3, uvs=[[0, 0], [1, 0], [0, 1]],
    )  # fmt: skip
    add(pybullet.GEOM_PLANE, (0.1, 0.2, 0))
    theirs, ours = (draw(function=one) for one in (THEIRS, getCameraImage))
    edges = near_edges(theirs[4]) | near_edges(ours[4])
    assert {0, 1} <= set(np.unique(ours[4]))
    assert not ((theirs[4] != ours[4]) & ~edges).any()
    assert np.abs(theirs[2].astype(int) - ours[2])[~edges].mean() < 6.0


def test_height_fields_are_as_in_the_original():
    heights = np.random.default_rng(0).uniform(-0.2, 0.3, 9 * 5)
    options = {"numHeightfieldRows": 5, "numHeightfieldColumns": 9, "meshScale": [0.5, 0.25, 1]}
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD, heightfieldData=heights.tolist(), **options
    )
    pybullet.createMultiBody(0, shape)
    theirs, ours = (draw(function=one) for one in (THEIRS, getCameraImage))
    edges = near_edges(theirs[4]) | near_edges(ours[4])
    assert (ours[4] == 0).sum() > 2000
    assert not ((theirs[4] != ours[4]) & ~edges).any()
    assert np.quantile(np.abs(theirs[3] - ours[3])[~edges], 0.99) < 1e-5
    assert np.abs(theirs[2].astype(int) - ours[2])[~edges].mean() < 6.0
    pybullet.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD, heightfieldData=(2 * heights).tolist(),
        replaceHeightfieldIndex=shape, **options,
    )  # fmt: skip
    assert (draw()[3] != ours[3]).sum() > 1000


def test_glass_is_seen_through_unless_tiny_renderer_is_asked_for():
    add(color=(0, 0, 1, 1))
    add(position=(0, 0, 1), color=(1, 0, 0, 0.5), halfExtents=[0.3, 0.3, 0.1])
    camera = matrices(**ABOVE)
    np.testing.assert_array_equal(middle(draw(camera, **AMBIENT)), [255, 0, 0])
    red, _, blue = middle(draw(camera, OPENGL, **AMBIENT))
    assert red > 100
    assert blue > 50


def test_what_is_not_drawn_is_named_once():
    camera = matrices(**ABOVE)
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD, fileName="heightmaps/ground0.txt", meshScale=[1, 1, 1]
    )
    pybullet.createMultiBody(0, shape)
    body = add()
    pybullet.changeVisualShape(body, -1, textureUniqueId=12345)
    with pytest.warns(UserWarning, match="not drawn: height fields of files.*, texture 12345"):
        draw(camera)
    with pytest.warns(UserWarning, match="projective textures"):
        draw(camera, flags=pybullet.ER_USE_PROJECTIVE_TEXTURE)
    assert draw(camera)[4][HEIGHT // 2, WIDTH // 2] == body


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"width": 0}, r"width must be .* got 0"),
        ({"height": 1.5}, r"height must be .* got 1.5"),
        ({"viewMatrix": [1.0, 2.0]}, r"viewMatrix must .*16"),
        ({"viewMatrix": np.eye(4)}, r"viewMatrix must .*16"),
        ({"viewMatrix": np.arange(16.0)}, r"viewMatrix must end in the column"),
        ({"projectionMatrix": [np.nan] * 16}, r"projectionMatrix must be finite"),
        ({"projectionMatrix": np.ones(16)}, r"projectionMatrix must be one of compute"),
        ({"lightDirection": [0, 0, 0]}, r"lightDirection must not be the zero vector"),
        ({"lightColor": [-1, 0, 0]}, r"lightColor must be three numbers in 0..1000"),
        ({"lightAmbientCoeff": -0.1}, r"lightAmbientCoeff must be .* got -0.1"),
        ({"renderer": 3}, r"renderer must be .* got 3"),
        ({"physicsClientId": 77}, r"physicsClientId must be of a connected client, got 77"),
    ],
)
def test_wrong_arguments_are_named(named, message):
    with pytest.raises(ValueError, match=message):
        getCameraImage(**{"width": 32, "height": 24, **named})


def test_the_program_of_the_page_runs(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pybullet, "getCameraImage", THEIRS)
    pybullet.disconnect()
    (program,) = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    exec(program, {})
    assert "falls" in capsys.readouterr().out
    pybullet.connect(pybullet.DIRECT)
