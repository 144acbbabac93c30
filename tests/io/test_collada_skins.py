"""COLLADA files with controllers: geometry is shown where it was bound."""

import logging
import warnings

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.trimesh.resolver import note_trimesh_warnings

pytest.importorskip("collada")

SPACE = "http://www.collada.org/2005/11/COLLADASchema"
CORNERS = np.array([(0, 0, 0), (2, 0, 0), (0, 1, 0)], float)
BIND = np.array([(0, -1, 0, 3), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)], float)
JOINT = np.array([(1, 0, 0, 1), (0, 1, 0, 2), (0, 0, 1, 3), (0, 0, 0, 1)], float)
ARMATURE = np.array([(2, 0, 0, 5), (0, 2, 0, 0), (0, 0, 2, 0), (0, 0, 0, 1)], float)


def text(numbers):
    return " ".join(f"{number:g}" for number in np.ravel(numbers))


def source(number, content, kind="float", count=1, stride=1):
    return (
        f'<source id="{number}"><{kind}_array id="{number}-a" count="{count * stride}">{content}'
        f'</{kind}_array><technique_common><accessor source="#{number}-a" count="{count}" '
        f'stride="{stride}"><param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source>'
    )


def collada(controllers, nodes):
    return (
        f'<COLLADA xmlns="{SPACE}" version="1.4.1"><asset><up_axis>Y_UP</up_axis></asset>'
        '<library_geometries><geometry id="g"><mesh>'
        + source("p", text(CORNERS), count=3, stride=3)
        + '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="1"'
        '><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh>'
        f"</geometry></library_geometries><library_controllers>{controllers}"
        '</library_controllers><library_visual_scenes><visual_scene id="s">'
        f'{nodes}</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/>'
        "</scene></COLLADA>"
    )


def skin(of="g", number="c"):
    return (
        f'<controller id="{number}"><skin source="#{of}"><bind_shape_matrix>{text(BIND)}'
        "</bind_shape_matrix>"
        + source("j", "hip knee", "Name", 2)
        + source("i", text([np.linalg.inv(JOINT)] * 2), count=2, stride=16)
        + '<joints><input semantic="JOINT" source="#j"/><input semantic="INV_BIND_MATRIX" '
        'source="#i"/></joints></skin></controller>'
    )


MORPH = '<controller id="m"><morph source="#g" method="NORMALIZED"/></controller>'


def node(content, matrix=None, more=""):
    said = "" if matrix is None else f"<matrix>{text(matrix)}</matrix>"
    return f"<node {more}>{said}{content}</node>"


def skeleton(content):
    joints = node(node("", None, 'sid="knee"'), JOINT, 'sid="hip"')
    return node(joints + content, ARMATURE, 'id="armature"')


def loaded(folder, content):
    (folder / "a.dae").write_text(content)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = rj.load(folder / "a.dae")
    corners = []
    for one in scene.nodes:
        points = one.mesh.vertices[one.mesh.faces].reshape(-1, 3)
        corners.append(rj.transforms.apply(one.world_matrix, points))
    return np.concatenate(corners), said[0].message.left_out


def test_skin_stands_where_its_joints_and_its_bind_shape_put_it(tmp_path):
    content = skeleton(node('<instance_controller url="#c"/>', 7 * np.eye(4)))
    corners, left_out = loaded(tmp_path, collada(skin(), content))
    assert corners == pytest.approx(rj.transforms.apply(ARMATURE @ BIND, CORNERS))
    assert left_out == {"movement of a skin, which is shown as it was bound": 1}


def test_skin_without_joints_in_the_file_stands_at_its_node(tmp_path):
    content = node('<instance_controller url="#c"/>', JOINT)
    corners, _ = loaded(tmp_path, collada(skin(), content))
    assert corners == pytest.approx(rj.transforms.apply(JOINT @ BIND, CORNERS))


def test_morph_shows_the_shape_that_it_begins_with(tmp_path):
    content = node('<instance_controller url="#m"/>', JOINT)
    corners, left_out = loaded(tmp_path, collada(MORPH, content))
    assert corners == pytest.approx(rj.transforms.apply(JOINT, CORNERS))
    assert left_out == {"movement of a morph, which is shown as it was bound": 1}


def test_skin_of_a_morph_is_that_of_its_shape(tmp_path):
    content = skeleton(node('<instance_controller url="#c"/>'))
    corners, _ = loaded(tmp_path, collada(MORPH + skin("m"), content))
    assert corners == pytest.approx(rj.transforms.apply(ARMATURE @ BIND, CORNERS))


def test_controllers_in_a_circle_are_named_and_the_rest_is_there(tmp_path):
    circle = skin("d", "c") + skin("c", "d").replace('"j', '"k').replace('"i', '"l')
    content = node('<instance_controller url="#c"/><instance_geometry url="#g"/>')
    corners, left_out = loaded(tmp_path, collada(circle, content))
    assert corners == pytest.approx(CORNERS)
    assert left_out == {"skinned or morphed geometry": 1}


def test_what_trimesh_logs_with_a_traceback_is_a_note_of_a_line(capfd):
    left_out = LeftOut()
    with note_trimesh_warnings(left_out):
        try:
            raise ValueError("no such\npicture")
        except ValueError:
            logging.getLogger("trimesh").warning("unable to load bumpmap", exc_info=True)
    assert capfd.readouterr() == ("", "")
    assert (
        str(left_out) == "part of which trimesh says: unable to load bumpmap: no such picture (1)"
    )
