"""3MF files: places, colours, textures, mixtures, lattices, and what is named."""

import io
import warnings
import zipfile

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.io.threemf import parts
from rasterjit.scene.color import srgb_to_linear

SPACES = " ".join(
    f'xmlns{prefix}="http://schemas.microsoft.com/3dmanufacturing/{name}"'
    for prefix, name in (
        ("", "core/2015/02"), (":m", "material/2015/02"), (":p", "production/2015/06"),
        (":b", "beamlattice/2017/02"), (":s", "slice/2015/07"),
    )
)  # fmt: skip
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
MATERIALS = (
    '<basematerials id="1"><base name="Red" displaycolor="#FF0000"/>'
    '<base name="Blue" displaycolor="#0000FF"/></basematerials>'
)
COLORS = (
    '<m:colorgroup id="2"><m:color color="#FF0000"/><m:color color="#00FF00"/>'
    '<m:color color="#8040C0"/><m:color color="#FFFFFF80"/></m:colorgroup>'
)
COORDINATES = "".join(
    f'<m:tex2coord u="{u}" v="{v}"/>' for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))
)
TEXTURE = (
    '<m:texture2d id="3" path="/3D/a.png" contenttype="image/png" tilestyleu="mirror" '
    f'filter="nearest"/><m:texture2dgroup id="4" texid="3">{COORDINATES}</m:texture2dgroup>'
)


def square(first="", second="", more="", vertices=CORNERS):
    rows = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
    return (
        f'<mesh><vertices>{rows}</vertices><triangles><triangle v1="0" v2="1" v3="2" {first}/>'
        f'<triangle v1="0" v2="2" v3="3" {second}/></triangles>{more}</mesh>'
    )


def model(resources, items='<item objectid="9"/>'):
    return (
        f'<model unit="millimeter" {SPACES}><resources>{resources}</resources>'
        f"<build>{items}</build></model>"
    )


def obj(content, said="", number=9):
    return f'<object id="{number}" {said}>{content}</object>'


def picture(texels):
    stream = io.BytesIO()
    Image.fromarray(np.array(texels, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def write(folder, text, **parts):
    path = folder / "a.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", text)
        for name, content in parts.items():
            archive.writestr(f"3D/{name.replace('_', '.')}", content)
    return path


def only(folder, text, **parts):
    (node,) = rj.load(write(folder, text, **parts)).nodes
    return node.mesh


def linear(*codes):
    return srgb_to_linear(np.array(codes, np.uint8))


def left_out(path):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = rj.load(path)
    found = {}
    for one in said:
        found |= one.message.left_out
    return scene, found


def test_object_has_the_material_that_it_names(tmp_path):
    mesh = only(tmp_path, model(MATERIALS + obj(square(), 'pid="1" pindex="1"')))
    assert mesh.material.base_color == (0.0, 0.0, 1.0, 1.0)
    assert mesh.material.name == "Blue"


def test_triangles_with_materials_have_colours_of_faces(tmp_path):
    text = model(MATERIALS + obj(square('p1="1"'), 'pid="1" pindex="0"'))
    mesh = only(tmp_path, text)
    corners = mesh.vertex_colors[mesh.faces] if mesh.face_colors is None else mesh.face_colors
    assert corners.reshape(2, -1, 4)[:, 0].tolist() == [[0, 0, 1, 1], [1, 0, 0, 1]]


def test_corners_have_their_colours_and_are_split_where_these_differ(tmp_path):
    first, second = 'pid="2" p1="0" p2="1" p3="2"', 'pid="2" p1="1" p2="2" p3="0"'
    mesh = only(tmp_path, model(COLORS + obj(square(first, second))))
    shown = mesh.vertex_colors[mesh.faces][..., :3]
    table = linear((255, 0, 0), (0, 255, 0), (128, 64, 192))
    assert shown == pytest.approx(table[[[0, 1, 2], [1, 2, 0]]])
    assert len(mesh.vertices) == 5
    assert mesh.vertices[mesh.faces].tolist() == [
        [list(map(float, CORNERS[one])) for one in face] for face in ((0, 1, 2), (0, 2, 3))
    ]


def test_further_corners_have_the_colour_of_the_first(tmp_path):
    mesh = only(tmp_path, model(COLORS + obj(square('pid="2" p1="1"', 'pid="2" p1="1"'))))
    assert mesh.material.base_color == (0.0, 1.0, 0.0, 1.0)


def test_colours_of_a_group_are_opaque(tmp_path):
    mesh = only(tmp_path, model(COLORS + obj(square(), 'pid="2" pindex="3"')))
    assert mesh.material.base_color == (1.0, 1.0, 1.0, 1.0)


def test_composite_has_the_mean_colour_of_its_materials(tmp_path):
    mixture = (
        '<m:compositematerials id="5" matid="1" matindices="0 1"><m:composite values="3 1"/>'
        '<m:composite values="0 0"/></m:compositematerials>'
    )
    for number, expected in ((0, (0.75, 0, 0.25, 1)), (1, (0.5, 0, 0.5, 1))):
        said = f'pid="5" pindex="{number}"'
        mesh = only(tmp_path, model(MATERIALS + mixture + obj(square(), said)))
        assert mesh.material.base_color == expected


def test_texture_lies_where_its_coordinates_say(tmp_path):
    first, second = 'pid="4" p1="0" p2="1" p3="2"', 'pid="4" p1="0" p2="2" p3="3"'
    texels = [[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]]
    mesh = only(tmp_path, model(TEXTURE + obj(square(first, second))), a_png=picture(texels))
    assert mesh.uv.tolist() == [list(one[:2]) for one in mesh.vertices.tolist()]
    texture = mesh.material.base_color_texture
    assert texture.wrap == ("mirror", "repeat")
    assert texture.filter == "nearest"
    assert texture.image[1, 0].tolist() == [0, 0, 1, 1]
    lit = rj.Scene()
    unlit = rj.Material("unlit", base_color_texture=texture)
    lit.add(rj.Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, material=unlit))
    camera = rj.OrthographicCamera((0.5, 0.5, 1), (0.5, 0.5, 0), (0, 1, 0), height=1.0)
    color = rj.render(lit, camera, size=(2, 2)).color[..., :3]
    assert color.tolist() == [[list(one) for one in row] for row in texels]


def test_triangles_of_two_textures_are_two_meshes_of_one_place(tmp_path):
    other = TEXTURE.replace('id="3"', 'id="13"').replace('id="4"', 'id="14"')
    faces = square('pid="4" p1="0" p2="1" p3="2"', 'pid="14" p1="0" p2="2" p3="3"')
    text = model(TEXTURE + other + obj(faces), '<item objectid="9" transform="2 0 0 0 1 0 0 0 1 '
                 '5 6 7"/>')  # fmt: skip
    nodes = rj.load(write(tmp_path, text, a_png=picture([[(9, 9, 9)]]))).nodes
    assert [len(node.mesh.faces) for node in nodes] == [1, 1]
    assert nodes[1].parent is nodes[0]
    assert nodes[1].world_matrix.tolist() == nodes[0].world_matrix.tolist()


@pytest.mark.parametrize(
    ("below", "method", "expected"),
    [
        ('pids="1 4"', "mix", (0.5, 0.5, 0.0)),
        ('pids="1 4"', "multiply", (0.0, 1.0, 0.0)),
        ('pids="2 4"', "mix", (0.5, 0.5, 0.0)),
        ('pids="2 4"', "multiply", (0.0, 0.0, 0.0)),
    ],
)
def test_multi_property_lays_a_texture_over_what_is_below(tmp_path, below, method, expected):
    mixed = (
        f'<m:multiproperties id="6" {below} blendmethods="{method}"><m:multi pindices="0 0"/>'
        '<m:multi pindices="0 1"/><m:multi pindices="0 2"/></m:multiproperties>'
    )
    faces = square('pid="6" p1="0" p2="1" p3="2"', 'pid="6" p1="0" p2="1" p3="2"')
    half = picture([[(0, 255, 0, 128)]])
    mesh = only(tmp_path, model(MATERIALS + COLORS + TEXTURE + mixed + obj(faces)), a_png=half)
    texel = mesh.material.base_color_texture.image[0, 0]
    assert texel == pytest.approx((*expected, 1.0), abs=0.003)


def test_multi_property_of_colours_is_mixed_at_each_corner(tmp_path):
    mixed = '<m:multiproperties id="6" pids="1 2"><m:multi pindices="0 3"/></m:multiproperties>'
    mesh = only(tmp_path, model(MATERIALS + COLORS + mixed + obj(square(), 'pid="6" pindex="0"')))
    share = 128 / 255
    assert mesh.material.base_color == pytest.approx((1.0, share, share, 1.0))


def test_nested_components_stand_where_all_transforms_put_them(tmp_path):
    rng = np.random.default_rng(4)
    steps = [np.vstack([rng.integers(-3, 4, (3, 4)), [0, 0, 0, 1]]) for _ in range(4)]
    said = [" ".join(map(str, step[:3].T.ravel())) for step in steps]

    def component(number, step):
        return f'<component objectid="{number}" transform="{said[step]}"/>'

    text = model(
        obj(square(), number=1)
        + obj(f"<components>{component(1, 0)}{component(1, 1)}</components>", number=2)
        + obj(f"<components>{component(2, 2)}{component(2, 3)}</components>", number=3),
        f'<item objectid="3" transform="{said[1]}"/><item objectid="1"/>',
    )
    nodes = rj.load(write(tmp_path, text)).nodes
    expected = [steps[1] @ steps[outer] @ steps[inner] for outer in (2, 3) for inner in (0, 1)]
    assert [node.world_matrix.tolist() for node in nodes] == [
        one.tolist() for one in (*expected, np.eye(4))
    ]
    assert len({id(node.mesh) for node in nodes}) == 1


def test_component_of_another_part_has_the_properties_of_its_model(tmp_path):
    other = model(MATERIALS + obj(square(), 'pid="1" pindex="1"', 7), "")
    part = '<components><component p:path="/3D/Other.model" objectid="7"/></components>'
    mesh = only(tmp_path, model(MATERIALS + obj(part)), other_model=other)
    assert mesh.material.name == "Blue"


def test_beams_have_their_radii_ends_and_colours(tmp_path):
    beams = (
        '<b:beamlattice radius="0.25" minlength="0.1" pid="2" pindex="0" cap="butt"><b:beams>'
        '<b:beam v1="0" v2="1" p1="0" p2="1"/></b:beams></b:beamlattice>'
    )
    mesh = only(tmp_path, model(COLORS + obj(square(more=beams).replace("<triangle ", "<x "))))
    low, high = mesh.bounds()
    assert (low[0], high[0]) == (0.0, 1.0)
    across = np.linalg.norm(mesh.vertices[:, 1:], axis=1)
    assert across.max() == pytest.approx(0.25)
    begins = mesh.vertices[:, 0] == 0.0
    assert (mesh.vertex_colors[begins] == (1, 0, 0, 1)).all()
    assert (mesh.vertex_colors[~begins] == (0, 1, 0, 1)).all()


def test_round_beams_and_balls_are_closed_and_face_outwards(tmp_path):
    beams = (
        '<b:beamlattice radius="0.1" minlength="0.1" ballmode="all" ballradius="0.3"><b:beams>'
        '<b:beam v1="0" v2="2" r1="0.2" r2="0.05"/></b:beams></b:beamlattice>'
    )
    mesh = only(tmp_path, model(obj(square(more=beams).replace("<triangle ", "<x "))))
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    own = mesh.normals[mesh.faces].sum(axis=1)
    assert ((normals * own).sum(axis=1) >= -1e-12).all()
    volume = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    ball, cone = 4 / 3 * np.pi * 0.3**3, np.pi * np.sqrt(2) / 3 * (0.04 + 0.01 + 0.0025)
    ends = 2 / 3 * np.pi * (0.2**3 + 0.05**3)
    assert volume == pytest.approx(2 * ball + cone + ends, rel=0.1)


def test_what_is_not_shown_is_named_with_its_number(tmp_path):
    more = '<b:beamlattice radius="1" minlength="9" clippingmode="inside" clippingmesh="8">' \
           '<b:beams><b:beam v1="0" v2="1"/></b:beams></b:beamlattice>'  # fmt: skip
    text = model(
        '<s:slicestack id="3"/><s:slicestack id="4"/>'
        + obj(square(), number=7)
        + obj(square(), number=8)
        + obj(square('paint="4"', 'paint="8"', more))
    )
    _, found = left_out(write(tmp_path, text))
    assert found == {
        "slicestack of a model": 2,
        "paint of a triangle": 2,
        "clipping of a beam lattice": 1,
        "beam that is shorter than its lattice allows": 1,
        "object that the build does not use": 1,
    }


def test_missing_texture_is_named_and_the_mesh_is_there(tmp_path):
    scene, found = left_out(write(tmp_path, model(TEXTURE + obj(square(), 'pid="4" pindex="0"'))))
    assert len(scene.nodes) == 1
    assert found == {"texture '3' that cannot be read: it is missing": 1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (model(obj('<components><component objectid="9"/></components>')), "in a circle"),
        (model(obj(square()), '<item objectid="5"/>'), "no object '5'"),
        (model(obj(square(vertices=CORNERS[:3]))), "from 0 to 2, got 3"),
        (model(COLORS + obj(square('pid="2" p1="4"'))), "must be below 4, got 4"),
        (model(obj(square('pid="2" p1="4"'))), "no group of properties '2'"),
        (model(obj(square()), '<item objectid="9" transform="1 0"/>'), "12 finite numbers"),
        (model(obj(square()), ""), "places none in its build"),
        (f"<!DOCTYPE a [<!ENTITY b 'c'>]>{model(obj(square()))}", "document type"),
        (model(obj(square()))[:-5], "3dmodel.model"),
    ],
)
def test_damaged_model_is_refused_with_the_reason(tmp_path, text, said):
    with pytest.raises(rj.MeshFileError, match=said):
        rj.load(write(tmp_path, text))


def test_components_that_multiply_are_refused_by_the_budget(tmp_path):
    nested = "".join(
        obj(f'<components>{f"""<component objectid="{number}"/>""" * 9}</components>',
            number=number + 1)
        for number in range(1, 9)
    )  # fmt: skip
    path = write(tmp_path, model(obj(square(), number=1) + nested))
    with pytest.raises(ValueError, match="a place of object"):
        rj.load(path, max_bytes=1 << 22)


def test_what_multiplies_keeps_the_alpha_of_what_is_below_it():
    red, half_green = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.5)
    layers = [np.float32([layer]) for layer in (red, half_green, (1.0, 0.5, 1.0, 1.0))]
    mixed = parts._blend(layers, ["mix", "mix", "multiply"], True)
    assert mixed.tolist() == [[0.5, 0.25, 0.0, 1.0]]
    layers[2][0, 3] = 0.5
    mixed = parts._blend(layers, ["mix", "mix", "multiply"], True)
    assert mixed.tolist() == [[0.75, 0.125, 0.0, 1.0]]
