"""``d`` and ``Tr`` of MTL files, as those who write them mean them."""

from __future__ import annotations

import warnings

import pytest

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning

MESHLAB = "#\n# Wavefront material file\n# Converted by Meshlab Group\n#\n"


def write(folder, *statements, comment=""):
    """Write a triangle for each material."""
    lines, library = ["mtllib a.mtl"], [comment]
    for n, said in enumerate(statements):
        library.append(f"newmtl m{n}\nKd 1 0 0\n{said}\n")
        lines += [f"v {n} 0 0", f"v {n + 1} 0 0", f"v {n} 1 0", f"usemtl m{n}"]
        lines.append(f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}")
    (folder / "a.mtl").write_text("".join(library))
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    return folder / "a.obj"


def opacities(file):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = rj.load(file)
    found = {node.mesh.material.name: node.mesh.material.base_color[3] for node in scene.nodes}
    return [found[name] for name in sorted(found)]


@pytest.mark.parametrize(
    ("statements", "expected"),
    [
        (["d 0.25", ""], [0.25, 1.0]),
        (["Tr 0.25", "Tr 0"], [0.75, 1.0]),
        (["Tr 1", "Tr 0.5"], [0.0, 0.5]),
        (["d 1\nTr 1", "Tr 1"], [1.0, 0.0]),
        (["Tr 1.000000"], [1.0]),
        (["Tr 1", "Tr 1.0"], [1.0, 1.0]),
    ],
)
def test_tr_is_the_inverse_of_d_unless_all_would_be_invisible(tmp_path, statements, expected):
    assert opacities(write(tmp_path, *statements)) == expected


@pytest.mark.parametrize(
    ("said", "named"),
    [
        ("Tr nonsense", "Tr 'nonsense' of material 'm0'"),
        ("Tr", "Tr without a value of material 'm0'"),
        ("d nan", "d 'nan' of material 'm0'"),
        ("d -halo 0.5", "-halo of d of material 'm0'"),
        ("Kd spectral foo.rfl 1", "Kd 'spectral foo.rfl 1' of material 'm0'"),
        ("Ks xyz .1 .2 .3", "Ks 'xyz .1 .2 .3' of material 'm0'"),
        ("Kd 1 0", "Kd '1 0' of material 'm0'"),
        ("Kd inf 0 0", "Kd 'inf 0 0' of material 'm0'"),
        ("Ns abc", "Ns 'abc' of material 'm0'"),
        ("Ns 1 2 # two", "Ns '1 2' of material 'm0'"),
    ],
)
def test_numbers_that_are_none_are_named_and_others_count(tmp_path, said, named):
    with pytest.warns(LoadWarning) as caught:
        scene = rj.load(write(tmp_path, said))
    assert caught[0].message.left_out == {named: 1}
    (red, *_, alpha) = scene.nodes[0].mesh.material.base_color
    assert (red, alpha) == (1.0, 0.5 if "halo" in said else 1.0)


def test_meshlab_writes_opacity(tmp_path):
    file = write(tmp_path, "Tr 1.000000", "Tr 0.25", comment=MESHLAB)
    assert opacities(file) == [1.0, 0.25]


def test_a_file_of_which_nothing_is_seen_says_so(tmp_path):
    with pytest.warns(LoadWarning, match=r"a\.obj: every material is fully transparent"):
        rj.load(write(tmp_path, "d 0", "d 0.0"))
