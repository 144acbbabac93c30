"""What packages of others unpack for our own readers is unpacked in a process with limits."""

from __future__ import annotations

import io
import sys
import time
import warnings
import zipfile
from pathlib import Path

import ktx2_samples
import numpy as np
import pytest
from click.testing import CliRunner
from gltf_drafts import Draft
from PIL import Image, features

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.io.foreign import codecs, isolation

PACKED = Path(__file__).parent / "packed"
PIXELS = np.random.default_rng(1).integers(0, 256, (6, 5, 3), np.uint8)
LONGEST = 120.0
"""Seconds in which what never ends is given up."""

linux = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")


def picture(form, mode="RGB", pixels=PIXELS):
    """Return a picture's file."""
    file = io.BytesIO()
    Image.fromarray(pixels).convert(mode).save(file, form)
    return file.getvalue()


PICTURES = {
    "png": lambda: picture("PNG"), "jpeg": lambda: picture("JPEG"),
    "webp": lambda: picture("WEBP", "RGBA"), "grey": lambda: picture("PNG", "L"),
    "gif": lambda: picture("GIF", "P"), "tga": lambda: picture("TGA"),
    "cut": lambda: picture("PNG")[:60], "empty": lambda: b"", "text": lambda: b"no picture",
    "gray16": lambda: picture("PNG", "I;16", np.arange(30, dtype=np.uint16).reshape(5, 6) * 999),
}  # fmt: skip


def textured(path, content=None, count=1, **more):
    """Write a glTF file of squares, each with a picture of its own."""
    file = Draft()
    for number in range(count):
        one = picture("PNG") if content is None else content
        file.textured(source=file.picture(one), name=f"t{number}", **more)
    return file.save(path)


def with_ktx2(path, content=ktx2_samples.UASTC_ALPHA):
    pytest.importorskip("opengl_basisu")
    file, name = Draft(), "KHR_texture_basisu"
    source = file.picture(content, "image/ktx2")
    return file.textured(extensions={name: {"source": source}}).use(name).save(path)


def with_avif(path):
    if not features.check("avif"):
        pytest.skip("Pillow has no AVIF here")
    file, name = Draft(), "EXT_texture_avif"
    source = file.picture(picture("AVIF"), "image/avif")
    return file.textured(extensions={name: {"source": source}}).use(name).save(path)


def with_draco(path, count=1, change=lambda stream: stream):
    """Write a glTF file of packed triangles."""
    library = pytest.importorskip("DracoPy")
    points, faces = np.eye(3, dtype=np.float32), np.uint32([[0, 1, 2]])
    stream, file = library.encode(points, faces), Draft()
    place = library.decode(stream).attributes[0]["unique_id"]
    name = "KHR_draco_mesh_compression"
    for _ in range(count):
        primitive = {
            "attributes": {"POSITION": file.say(points)}, "indices": file.say(faces.ravel()),
            "extensions": {name: {"bufferView": file.view(change(stream)),
                                  "attributes": {"POSITION": place}}},
        }  # fmt: skip
        file.show(file.add("meshes", primitives=[primitive]))
    return file.use(name, required=True).save(path)


def copied(name, path):
    path.write_bytes((PACKED / name).read_bytes())
    return path


def obj(path):
    (path.parent / "a.png").write_bytes(picture("PNG"))
    (path.parent / "b.jpg").write_bytes(picture("JPEG")[:300])
    lines = "newmtl m\nmap_Kd a.png\nmap_d a.png\nnewmtl n\nmap_Kd b.jpg\n"
    (path.parent / "a.mtl").write_text(lines)
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    face = "f 1/1 2/2 3/3\n"
    path.write_text(f"mtllib a.mtl\n{corners}usemtl m\n{face}usemtl n\n{face}")
    return path


def ply(path):
    (path.parent / "a.png").write_bytes(picture("PNG"))
    head = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\n"
    head += "".join(f"property float {name}\n" for name in "xyzst")
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(f"{head}0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    return path


def three_mf(path):
    space = "http://schemas.microsoft.com/3dmanufacturing"
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="0"/>' for x, y in ((0, 0), (1, 0), (0, 1)))
    places = "".join(f'<m:tex2coord u="{u}" v="{v}"/>' for u, v in ((0, 0), (1, 0), (0, 1)))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/a.png", picture("PNG"))
        archive.writestr(
            "3D/3dmodel.model",
            f'<model unit="meter" xmlns="{space}/core/2015/02" xmlns:m="{space}/material/2015/02">'
            '<resources><m:texture2d id="3" path="/3D/a.png" contenttype="image/png"/>'
            f'<m:texture2dgroup id="4" texid="3">{places}</m:texture2dgroup>'
            f'<object id="1"><mesh><vertices>{vertices}</vertices><triangles>'
            '<triangle v1="0" v2="1" v3="2" pid="4" p1="0" p2="1" p3="2"/></triangles></mesh>'
            '</object></resources><build><item objectid="1"/></build></model>',
        )
    return path


WRITERS = {
    **{f"{name}.glb": lambda path, make=make: textured(path, make())
       for name, make in PICTURES.items()},
    "ktx2.glb": with_ktx2, "avif.glb": with_avif, "draco.glb": with_draco,
    "ktx2 cut.glb": lambda path: with_ktx2(path, ktx2_samples.UASTC[:150]),
    "draco cut.glb": lambda path: with_draco(path, 2, lambda stream: stream[:-4]),
    "meshopt.glb": lambda path: copied("gltfpack.glb", path),
    "all.glb": lambda path: copied("gltf_transform.glb", path),
    "a.obj": obj, "a.ply": ply, "a.3mf": three_mf,
}  # fmt: skip


def outcome(path, isolate):
    """Return the shapes and textures of a file, and all that is said about it."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            scene = rj.load(path, isolate=isolate)
        except ValueError as error:
            return type(error), str(error)
    found = []
    for node in scene.nodes:
        texture = node.mesh.material.base_color_texture
        found.append((node.mesh.vertices.tobytes(), node.mesh.faces.tobytes(),
                      None if texture is None else texture.image.tobytes()))  # fmt: skip
    return found, [str(one.message) for one in told]


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_the_same_wherever_its_parts_are_unpacked(tmp_path, name):
    path = WRITERS[name](tmp_path / name)
    here = outcome(path, False)
    assert here == outcome(path, True)
    assert here == outcome(path, "all")
    if "cut" not in name:
        assert isinstance(here[0], list), here


def test_what_is_too_large_for_the_budget_is_refused_by_the_same_words(tmp_path):
    path = textured(tmp_path / "a.glb", picture("PNG", pixels=np.zeros((300, 300, 3), np.uint8)))
    said = []
    for isolate in (False, "all"):
        with pytest.raises(ValueError, match="are left of max_bytes") as refused:
            rj.load(path, max_bytes=1 << 20, isolate=isolate)
        said.append(str(refused.value))
    assert said[0] == said[1]


def refuse(name, monkeypatch):
    """Let a codec decode nothing in this process."""

    def decode(*_):
        raise RuntimeError("decoded here")

    monkeypatch.setitem(codecs.CODECS, name, codecs.CODECS[name]._replace(decode=decode))


@pytest.mark.parametrize(
    ("name", "write", "isolate"),
    [("draco", with_draco, True), ("ktx2", with_ktx2, True), ("picture", textured, "all")],
)
def test_packages_of_others_see_no_byte_here(tmp_path, monkeypatch, name, write, isolate):
    path = write(tmp_path / "a.glb")
    refuse(name, monkeypatch)
    assert "decoded here" in str(outcome(path, False))
    assert "decoded here" not in str(outcome(path, isolate))


def test_pictures_alone_start_no_process(tmp_path):
    isolation._kill_all()
    path = textured(tmp_path / "a.glb")
    rj.load(path)
    assert not isolation._ALL_READERS
    rj.load(path, isolate="all")
    assert len(isolation._ALL_READERS) == 1


def test_parts_of_a_file_share_a_copy_of_the_process(tmp_path, monkeypatch):
    begun, ask = [], isolation._ReaderProcess.ask
    monkeypatch.setattr(
        isolation._ReaderProcess,
        "ask",
        lambda self, *rest: begun.append(self._is_busy) or ask(self, *rest),
    )
    rj.load(textured(tmp_path / "a.glb", count=5), isolate="all")
    assert begun == [False, True, True, True, True]


def test_systems_without_forks_do_the_same(tmp_path, monkeypatch):
    isolation._kill_all()
    monkeypatch.setattr(isolation, "_IDLE_READERS", [])
    start = "import rasterjit.io.foreign.child as child\nchild._FORKS = False\nserve(file)"
    monkeypatch.setattr(
        isolation, "_START_SCRIPT", isolation._START_SCRIPT.replace("serve(file)", start)
    )
    path, other = with_draco(tmp_path / "a.glb", 3), textured(tmp_path / "b.glb")
    for _ in range(2):
        assert outcome(path, "all") == outcome(path, False)
        assert outcome(other, "all") == outcome(other, False)
    assert len(isolation._ALL_READERS) == 1
    isolation._kill_all()


# What harms

HARMS = {
    "crashes": ("os.abort()", r"crashed \(SIGABRT\)"),
    "ends": ("os._exit(3)", "ended with status 3"),
    "ends as if all were well": ("os._exit(0)", "crashed"),
    "never ends": ("\n while True: pass", "takes more than 1 s"),
    "takes long, all together": (
        "\n end = time.process_time() + 0.4\n while time.process_time() < end: pass\n end / 0",
        "takes more than 1 s",
    ),
    "takes memory": ("[bytearray(1 << 28) for _ in range(99)]", "more memory than max_bytes"),
    "answers too much": ("return Answer(1 << 27)", "more memory than max_bytes"),
}


@pytest.fixture
def harm(tmp_path, monkeypatch):
    """Return what lets DracoPy, where it is not in this process, do something else."""
    pytest.importorskip("DracoPy")

    def ready(code):
        folder = tmp_path / "packages"
        folder.mkdir(exist_ok=True)
        (folder / "DracoPy.py").write_text(
            "import os, time\nimport numpy as np\nclass Answer:\n"
            " def __init__(self, size):\n"
            "  self.faces, self.attributes = np.zeros(size, np.uint32), []\n"
            f"def decode(stream): {code}\n"
        )
        isolation._kill_all()
        monkeypatch.syspath_prepend(folder)

    yield ready
    isolation._kill_all()


@linux
@pytest.mark.parametrize("name", HARMS)
def test_a_codec_that_harms_is_an_error_that_names_file_and_package(
    tmp_path, monkeypatch, harm, name
):
    code, said = HARMS[name]
    path, other = with_draco(tmp_path / "a.glb", 9), textured(tmp_path / "b.glb")
    harm(code)
    monkeypatch.setattr(isolation, "_BASE_CPU_SECONDS", 1)
    begin = time.monotonic()
    with pytest.raises(rj.MeshFileError, match=said) as refused:
        rj.load(path, max_bytes=300 << 20)
    assert str(path) in str(refused.value)
    assert time.monotonic() - begin < LONGEST
    assert rj.load(other, isolate="all").nodes[0].mesh.material.base_color_texture is not None


@linux
def test_a_folder_goes_on_after_a_file_that_harms(tmp_path, harm):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in "ac":
        textured(folder / f"{name}.glb")
    with_draco(folder / "b.glb")
    harm("os.abort()")
    for words, made in (
        (["render", "--size", "16x16"], ["a.glb.png", "c.glb.png"]),
        (["dataset", "--size", "16", "--views", "1", "--outputs", "color"], ["a.glb", "c.glb"]),
    ):
        output = tmp_path / words[0]
        run = CliRunner().invoke(commands.program, [*words, str(folder), "-o", str(output)])
        assert run.exit_code == 1
        assert " ".join(run.output.split()).count("crashed (SIGABRT)") == 1, run.output
        assert sorted(one.name for one in output.iterdir() if "glb" in one.name) == made


@pytest.mark.parametrize("command", ["render", "dataset"])
def test_folders_have_their_pictures_decoded_elsewhere(tmp_path, monkeypatch, command):
    folder = tmp_path / "in"
    folder.mkdir()
    textured(folder / "a.glb")
    refuse("picture", monkeypatch)
    words = {
        "render": ["render", "--size", "16x16"],
        "dataset": ["dataset", "--size", "16", "--views", "1", "--outputs", "color"],
    }[command]
    for more, is_here in (([], False), (["--no-isolate"], True)):
        output = tmp_path / f"out{is_here}"
        run = CliRunner().invoke(commands.program, [*words, *more, str(folder), "-o", str(output)])
        assert run.exit_code == 0, run.output
        assert ("decoded here" in run.output) == is_here
