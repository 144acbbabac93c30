"""Robots of URDF files: the tree, joints, meshes and where they are found, and what is wrong."""

from __future__ import annotations

import copy
import logging
import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning, MeshFileError

yourdfpy = pytest.importorskip("yourdfpy")

ARM = Path(__file__).parents[2] / "docs" / "examples" / "arm.urdf"

BOX = '<visual><geometry><box size="1 2 3"/></geometry></visual>'
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def mesh_of(name, more=""):
    return f'<visual><geometry><mesh filename="{name}" {more}/></geometry></visual>'


def link(name, content=BOX):
    return f'<link name="{name}">{content}</link>'


def joint(name, parent, child, kind="revolute", content=""):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{content}</joint>'


def write(folder, *elements, name="a.urdf"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f'<robot name="r">{"".join(elements)}</robot>')
    return folder / name


def load(folder, *elements, **options):
    return rj.load(write(folder, *elements), **options)


GRIPPER = (
    link("palm"), link("left"), link("right"), link("screw"),
    joint("open", "palm", "left", "prismatic",
          '<axis xyz="0 3 0"/><limit lower="0.01" upper="0.05"/><origin xyz="0 0 1"/>'),
    joint("other", "palm", "right", "prismatic",
          '<axis xyz="0 1 0"/><limit lower="-1" upper="1"/>'
          '<mimic joint="turn" multiplier="-0.5" offset="0.1"/>'),
    joint("turn", "palm", "screw", "revolute",
          '<axis xyz="0 0 1"/><limit lower="-3" upper="3"/><mimic joint="open" multiplier="20"/>'),
)  # fmt: skip
"""A chain of mimics, written in an order in which nothing that is followed comes first."""


def test_links_stand_where_yourdfpy_has_them():
    scene, theirs = rj.load(ARM), yourdfpy.URDF.load(str(ARM), load_meshes=False)
    rng, joints = np.random.default_rng(7), scene.joints
    assert list(joints.free) == theirs.actuated_joint_names
    low, high = np.clip([joints[name].limits for name in joints.free], -400.0, 400.0).T
    poses = rng.uniform(low, high, (100, len(low)))
    shifts = [joints[name].kind == "prismatic" for name in joints.free]
    radians = np.where(shifts, poses, np.radians(poses))
    np.testing.assert_allclose(joints.from_radians(radians), poses, rtol=1e-12)
    for pose, their_pose in zip(poses, radians, strict=True):
        joints.move(pose)
        theirs.update_cfg(their_pose)
        for name in theirs.link_map:
            expected = theirs.get_transform(name)
            np.testing.assert_allclose(scene.find(name).world_matrix, expected, atol=1e-12)


def test_a_batch_of_poses_is_the_pictures_of_moved_joints_bit_for_bit(tmp_path):
    scene = load(tmp_path, *GRIPPER)
    poses = np.array([[0.01], [0.03], [0.05]])
    camera = rj.fit_camera(scene, (1, 1, 1), up=(0, 0, 1), zoom=0.5)
    transforms = scene.joints.transforms(poses)
    batch = rj.render_batch(scene, [camera] * 3, size=(32, 24), transforms=transforms)
    assert scene.joints["open"].position == 0.01
    for number, pose in enumerate(poses):
        scene.joints.move(pose)
        world = [node.world_matrix for node in scene.nodes]
        np.testing.assert_array_equal(transforms[number], world)
        frame = rj.render(scene, camera, size=(32, 24))
        np.testing.assert_array_equal(batch.color[number], frame.color)
    named = scene.joints.transforms({"open": poses[:, 0]})
    np.testing.assert_array_equal(named, transforms)
    still = load(tmp_path, link("a")).joints
    assert still.transforms(np.empty((5, 0))).shape == (5, 1, 4, 4)


def test_mimic_joints_follow_in_their_own_unit_and_cannot_be_moved(tmp_path):
    joints = load(tmp_path, *GRIPPER).joints
    assert joints.free == ("open",)
    assert list(joints) == ["open", "other", "turn"]
    assert joints["open"].position == 0.01, "0 is outside the limits: the nearest is taken"
    joints["open"].position = 0.04
    assert joints["turn"].angle == pytest.approx(np.degrees(20 * 0.04))
    assert joints["other"].position == pytest.approx(0.1 - 0.5 * 20 * 0.04)
    np.testing.assert_allclose(joints["open"].node.transform[:3, 3], (0, 0.04, 1), atol=1e-15)
    with pytest.raises(ValueError, match="joint 'turn' follows joint 'open'"):
        joints["turn"].angle = 3


def test_limits_and_kinds_are_checked_naming_joint_value_and_limits():
    scene = rj.load(ARM)
    elbow, reach = scene.joints["elbow"], scene.joints["reach"]
    with pytest.raises(ValueError, match=r"'elbow'.* -137\.51\.\.137\.51 degrees, got 140"):
        elbow.angle = 140
    with pytest.raises(ValueError, match=r"'reach'.* 0\.\.0\.15 scene units, got -0\.1"):
        scene.joints.transforms({"reach": [0.1, -0.1]})
    with pytest.raises(ValueError, match="joint 'elbow' is revolute: it has no position"):
        elbow.position = 1
    with pytest.raises(ValueError, match="joint 'reach' is prismatic: it has no angle"):
        reach.angle = 1
    with pytest.raises(ValueError, match=r"joint must be one of .*did you mean 'elbow'"):
        scene.joints["elbw"]
    with pytest.raises(ValueError, match="joint 'turn' must"):
        scene.joints.move({"elbow": 10, "turn": np.nan})
    assert elbow.angle == 0.0, "nothing moves where one value is wrong"
    scene.joints["turn"].angle = 1000.0
    assert scene.find("shoulder").transform[0, 0] == pytest.approx(np.cos(np.radians(1000)))


def test_limits_that_are_missing_or_swapped_do_not_hold(tmp_path):
    limits = ["", '<limit effort="1"/>', '<limit lower="1" upper="-1"/>', '<limit upper="1"/>',
              '<limit lower="1e308" upper="inf"/>']  # fmt: skip
    names = [f"j{number}" for number in range(5)]
    elements = [
        joint(name, "base", name, content=one) for name, one in zip(names, limits, strict=True)
    ]
    with pytest.warns(
        LoadWarning, match=r"limits 1\.\.-1 of the joint 'j2' .*inf of the joint 'j4'"
    ):
        joints = load(tmp_path, link("base"), *map(link, names), *elements).joints
    none = (-np.inf, np.inf)
    assert [joints[name].limits for name in names] == [none, none, none, (0, np.degrees(1.0)), none]


def test_copies_of_a_robot_move_by_themselves(tmp_path):
    scene = load(tmp_path, *GRIPPER)
    stage = rj.Scene()
    stage.add(scene, rj.transforms.translate((5, 0, 0)), "one")
    stage.add(scene, name="two")
    assert stage.joints.free == ("one/open", "two/open")
    others = [copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))]
    for other, name in [(stage, "two/open"), *((one, "open") for one in others)]:
        other.joints[name].position = 0.05
        follower = other.joints[name.replace("open", "turn")]
        assert follower.angle == pytest.approx(np.degrees(1.0))
        assert follower.node in other.every_node()
        assert scene.joints["open"].position == 0.01
    assert stage.joints["one/open"].position == 0.01
    with pytest.raises(ValueError, match="'two/open' is there"):
        stage.add(scene, name="two")


def test_a_robot_read_in_this_process_is_the_same(tmp_path):
    file = write(tmp_path, *GRIPPER)
    one, other = rj.load(file), rj.load(file, isolate=False)
    assert repr(one.joints) == repr(other.joints)
    for node, same in zip(one.nodes, other.nodes, strict=True):
        np.testing.assert_array_equal(node.world_matrix, same.world_matrix)


def test_origins_scales_colors_and_names_are_read(tmp_path):
    (tmp_path / "tri.obj").write_text(TRIANGLE)
    visual = (
        '<visual><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><geometry><mesh filename="tri.obj" '
        'scale="2 3 -4"/></geometry><material name="m"/></visual>'
    )
    scene = load(
        tmp_path,
        link("a", visual + BOX),
        '<material name="m"><color rgba="1 0.5 0 0.5"/></material>',
    )
    node, box = scene.nodes
    expected = np.eye(4)
    expected[:3, :3] = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix() * (2, 3, -4)
    expected[:3, 3] = 1, 2, 3
    np.testing.assert_allclose(node.world_matrix, expected, atol=1e-15)
    material = node.mesh.material
    assert material.base_color == pytest.approx((1.0, 0.216, 0.0, 0.5), abs=3e-3)
    assert material.alpha_mode == "blend"
    assert scene.up == (0, 0, 1)
    assert [node.name, box.name, node.parent.name] == ["a/1", "a/2", "a"]
    np.testing.assert_allclose(np.ptp(box.mesh.vertices, axis=0), (1, 2, 3))


def test_a_material_paints_only_meshes_that_have_none(tmp_path):
    (tmp_path / "own.mtl").write_text("newmtl m\nKd 0 0 1\n")
    (tmp_path / "own.obj").write_text("mtllib own.mtl\nusemtl m\n" + TRIANGLE)
    (tmp_path / "bare.obj").write_text(TRIANGLE)
    paint = '<material name="{0}"><color rgba="{0} 0 0 1"/></material></visual>'
    visuals = [
        mesh_of(name).replace("</visual>", paint.format(red))
        for name, red in (("own.obj", 1), ("bare.obj", 1), ("bare.obj", 0))
    ]
    own, red, black = (one.mesh for one in load(tmp_path, link("a", "".join(visuals))).nodes)
    assert own.material.base_color[2] == 1.0
    assert [red.material.base_color[0], black.material.base_color[0]] == [1.0, 0.0]
    assert red.vertices is black.vertices, "a file is read once"


def test_the_unit_of_a_collada_file_holds_and_its_upward_axis_does_not(tmp_path):
    pytest.importorskip("collada")
    import trimesh

    text = trimesh.creation.box((1, 2, 3)).export(file_type="dae").decode()
    head, tail = text.split("<up_axis>")
    (tmp_path / "a.dae").write_text(f'{head}<unit name="mm" meter="0.001"/><up_axis>{tail}')
    low, high = load(tmp_path, link("a", mesh_of("a.dae", 'scale="2 2 2"'))).bounds()
    np.testing.assert_allclose(high - low, (0.002, 0.004, 0.006))
    for unit in ("1e", "0", "-1", "one"):
        (tmp_path / "a.dae").write_text(f'{head}<unit meter="{unit}"/><up_axis>{tail}')
        file = write(tmp_path, link("a", mesh_of("a.dae") + BOX))
        with pytest.raises(MeshFileError, match=r"a\.urdf names meshes .*'a\.dae': .*(unit|float)"):
            rj.load(file)
        with pytest.warns(LoadWarning, match=r"mesh 'a\.dae'"):
            assert len(rj.load(file, on_damage="warn").nodes) == 1


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("r/urdf/tri.obj", "tri.obj"), ("r/meshes/tri.obj", "../meshes/tri.obj"),
        ("r/meshes/tri.obj", "meshes/tri.obj"), ("r/m/tri.obj", "package://r/m/tri.obj"),
        ("r/m/tri.obj", "package:///r/m/tri.obj"), ("r/m/tri.obj", "model://r/m/tri.obj"),
        ("other/m/tri.obj", "package://other/m/tri.obj"),
        ("r/m/tri.obj", "package://renamed/m/tri.obj"),
        ("far/ws/pkg/m/tri.obj", "package://pkg/m/tri.obj"),
        ("far/install/share/ros2/m/tri.obj", "package://ros2/m/tri.obj"),
        ("r/urdf/tri.obj", "file://{folder}/r/urdf/tri.obj"),
    ],
)  # fmt: skip
def test_meshes_are_found_beside_the_file_above_it_and_in_packages(
    tmp_path, monkeypatch, place, name
):
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}/none{os.pathsep}{tmp_path}/far/ws")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/far/install")
    (tmp_path / place).parent.mkdir(parents=True)
    (tmp_path / place).write_text(TRIANGLE)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = load(tmp_path / "r" / "urdf", link("a", mesh_of(name.format(folder=tmp_path))))
    assert len(scene.nodes) == 1
    assert ["left out package 'renamed'" in str(one.message) for one in caught] == (
        [True] if "renamed" in name else []
    )


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("tri.obj", "'tri.obj': it is missing"), ("package://none/tri.obj", "no package 'none'"),
        ("package://r/../../secret.obj", "outside"), ("/etc/passwd", "outside"),
        ("package://other/bad.obj", "missing in the package 'other'"),
        ("http://x.org/a.obj", "not a file on this machine"), ("a.urdf", "a robot is no mesh"),
        ("bad.obj", "bad.obj"),
    ],
)  # fmt: skip
def test_meshes_that_cannot_be_read_are_refused_or_left_out_by_name(tmp_path, name, reason):
    folder = tmp_path / "r" / "urdf"
    file = write(folder, link("a"), link("b", mesh_of(name)), joint("j", "a", "b"))
    (tmp_path / "secret.obj").write_text(TRIANGLE)
    (folder / "bad.obj").write_text("f 1 2 3\n")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "package.xml").write_text("<package/>")
    with pytest.raises(MeshFileError, match=f"a.urdf names meshes .*{reason}"):
        rj.load(file)
    with pytest.warns(LoadWarning, match=reason):
        assert len(rj.load(file, on_damage="warn").nodes) == 1


def test_a_folder_that_is_named_allows_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "tri.obj").write_text(TRIANGLE)
    file = write(tmp_path / "r", link("a", mesh_of("package://pkg/tri.obj")))
    assert rj.load(file, resource_root=tmp_path).nodes
    with pytest.raises(MeshFileError, match="no package"):
        rj.load(file, resource_root=tmp_path / "r")


BROKEN = {
    "cut": ("", "Premature end|EndTag|not closed|expected"),
    "circle": (link("a") + link("b") + joint("j", "a", "b") + joint("k", "b", "a"),
               "links hang in a circle"),
    "two parents": (link("a") + link("b") + link("c") + joint("j", "a", "c") + joint("k", "b", "c"),
                    "link 'c' must hang on one joint, got 'j' and 'k'"),
    "kind": (link("a") + link("b") + joint("j", "a", "b", "hinge"),
             "joint 'j': type must be one of revolute.* got 'hinge'"),
    "no link": (link("a") + joint("j", "a", "x"), "joint 'j': its child must be a link, got 'x'"),
    "twice": (link("a") + link("a"), "two links 'a'"),
    "axis": (link("a") + link("b") + joint("j", "a", "b", content='<axis xyz="0 0 0"/>'),
             "joint 'j': axis must be"),
    "mimics": (link("a") + link("b") + joint("j", "a", "b", content='<mimic joint="j"/>'),
               "joints mimic each other in a circle: j"),
    "shape": (link("a", BOX.replace('box size="1 2 3"', "cone")), "cone"),
    "number": (link("a", BOX.replace("1 2 3", "1 two 3")), "two"),
    "negative": (link("a", BOX.replace("1 2 3", "1 -2 3")), "a box of link 'a' must have 3 sizes"),
    "radius": (link("a", BOX.replace('box size="1 2 3"', 'sphere radius="0"')),
               r"a sphere of link 'a' must have .* no radius of 0, got \(0.0,\)"),
    "thin": (link("a", BOX.replace('box size="1 2 3"', 'cylinder radius="0" length="1"')),
             "a cylinder of link 'a' must have"),
    "tiny": (link("a", BOX.replace('box size="1 2 3"', 'cylinder radius="1e-99" length="1"')),
             "a cylinder of link 'a': there are no faces"),
    "mimic": (link("a") + link("b") + link("c") + joint("j", "a", "b")
              + joint("k", "a", "c", content='<mimic joint="j" multiplier="nan"/>'),
              "joint 'k': its mimic must have finite numbers, got .*nan"),
    "overflow": (link("a") + link("b") + link("c") + joint("j", "a", "b", "prismatic",
                 '<axis xyz="1 0 0"/><limit lower="1e9" upper="2e9"/>')
                 + joint("k", "a", "c", content='<mimic joint="j" multiplier="1e300"/>'),
                 "joint 'k': values must be finite"),
    "empty": (link("a", ""), "holds no visual to draw"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_files_are_refused_with_the_file_and_what_is_wrong(tmp_path, kind):
    elements, reason = BROKEN[kind]
    file = write(tmp_path, elements)
    if kind == "cut":
        file.write_text('<robot name="r"><link name="a">')
    with pytest.raises(MeshFileError, match=f"a.urdf .*({reason})"):
        rj.load(file)


def test_what_is_not_drawn_is_passed_over_and_what_is_odd_is_named(tmp_path):
    collision = "<collision><geometry><capsule/></geometry></collision><inertial><odd/></inertial>"
    file = write(
        tmp_path, link("a", BOX + collision), link("b"), "<!-- note --><odd/><gazebo><x/></gazebo>",
        "<drake:loop/>", joint("float", "a", "b", "floating"),
    )  # fmt: skip
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = rj.load(file)
    (message,) = [one.message for one in caught]
    assert message.left_out == {"odd of a robot": 1, "motion of the floating joint 'float'": 1}
    assert not scene.joints
    assert len(scene.nodes) == 2


def test_without_yourdfpy_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "yourdfpy", None)
    with pytest.raises(MeshFileError, match=r"pip install 'rasterjit\[robots\]' brings it"):
        rj.load(ARM)


def test_glTF_has_no_place_for_joints_and_says_so(tmp_path):  # noqa: N802
    with pytest.warns(rj.SaveWarning, match="joints of robots"):
        rj.load(ARM).save(tmp_path / "arm.glb")


def test_other_files_are_read_without_what_reads_robots(tmp_path):
    (tmp_path / "a.obj").write_text(TRIANGLE)
    program = (
        "import sys, rasterjit as rj; rj.load(sys.argv[1]); "
        "print('rasterjit.io.urdf' in sys.modules)"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "a.obj")]
    assert subprocess.run(command, capture_output=True, check=True).stdout.strip() == b"False"
