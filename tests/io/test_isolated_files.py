"""What packages of others read is read in a process with limits, and comes back as it is."""

from __future__ import annotations

import base64
import dataclasses
import importlib.util
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from planted_files import PLANTED

import rasterjit as rj
from rasterjit.io.foreign import isolation, sandbox, serialization
from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.resources import Resources
from rasterjit.scene.memory_limits import MemoryBudget

ROOT = Path(__file__).parents[2]
HDF5 = "h5py"
"""What meshio asks for; the tests do without."""
LONGEST = 120.0
"""Seconds of the processor and by the clock in which what never ends is given up."""

linux = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def outcome(path, **options):
    """Return what a file holds, all of it, and what is said about that."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            scene = rj.load(path, **options)
        except ValueError as error:
            return type(error), str(error)
    nodes = [(node.name, node.world_matrix.tobytes(), *contents(node.mesh)) for node in scene.nodes]
    return nodes, scene.lights, scene.camera, scene.up, [str(one.message) for one in told]


def contents(mesh):
    """Yield the arrays of a mesh as bytes, and how it looks."""
    arrays = {
        name: values for name, values in vars(mesh).items() if isinstance(values, np.ndarray)
    } | {**mesh.vertex_attributes, **mesh.face_attributes}
    yield from sorted((name, values.tobytes()) for name, values in arrays.items())
    yield None if mesh.field is None else mesh.field.values.tobytes()
    for one in dataclasses.fields(mesh.material):
        value = getattr(mesh.material, one.name)
        yield value.image.tobytes() if isinstance(value, rj.Texture) else value


def tables(path, cells, points=SQUARE, **values):
    """Write a file of meshio's."""
    meshio = pytest.importorskip("meshio")
    meshio.Mesh(points, cells, **values).write(path)
    return path


def cloud(path, count=50):
    """Write a LAS or LAZ file."""
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=3, file_version="1.2")
    las.x, las.y, las.z = np.random.default_rng(1).random((3, count))
    las.red = las.green = las.blue = np.arange(count) * 256
    las.intensity = np.arange(count)
    las.write(path)
    return path


# What is found


FOREIGN = [name for name in PLANTED if not name.startswith("object")]


@pytest.mark.parametrize("name", FOREIGN)
def test_files_are_the_same_by_either_way(tmp_path, name):
    make, *_ = PLANTED[name]
    path = make(tmp_path)
    assert outcome(path) == outcome(path, isolate=False)


@pytest.mark.parametrize("kind", ["vtk", "vtu", "inp", "msh", "mesh", "bdf", "tec", "avs"])
def test_cells_are_the_same_by_either_way(tmp_path, kind):
    path = tables(tmp_path / f"a.{kind}", [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))])
    one = outcome(path)
    assert one == outcome(path, isolate=False)
    assert isinstance(one[0], list), one


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_clouds_are_the_same_by_either_way(tmp_path, kind):
    path = cloud(tmp_path / f"a.{kind}")
    one = outcome(path)
    assert one == outcome(path, isolate=False)
    assert isinstance(one[0], list), one


def test_what_was_found_comes_back_as_it_was():
    shared = rj.Material(base_color=(0.1, 0.2, 0.3, 1.0), base_color_texture=rj.Texture(SQUARE))
    found = {
        "numbers": [1, -2.5, float("inf"), True, None, "\udcff"],
        "tuple": (np.arange(6, dtype=">i2").reshape(2, 3), np.zeros((0, 3)), np.float32(2.0)),
        "odd": np.array(["a", None], object),
        "same": [shared, shared],
    }
    with open(os.memfd_create("found"), "w+b", buffering=0) as file:
        serialization.write_value(found, file.fileno())
        read = serialization.read_value(file.fileno())
    assert read["numbers"] == found["numbers"]
    assert isinstance(read["tuple"], tuple)
    for one, other in zip(read["tuple"], found["tuple"], strict=True):
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype
    assert read["odd"].shape == (2,)
    assert read["odd"].dtype.kind == "S"
    assert read["same"][0] is read["same"][1]
    assert np.array_equal(read["same"][0].base_color_texture.image, shared.base_color_texture.image)


@pytest.mark.parametrize(
    "said",
    [
        b'["object", "Popen", ["args", "true"]]', b'["array", "|O", 0, 1]',
        b'["array", "<f8", 8, 1000000]', b'["list"' + b', ["bytes", 0, 100]' * 20 + b"]",
        b'["array", "<f8", 8, -1]', b'["same", 7]', b"[]",
        b"[" * 9,
    ],
)  # fmt: skip
def test_what_no_reader_writes_is_refused(said):
    with open(os.memfd_create("found"), "w+b", buffering=0) as file:
        head = serialization._HEADER.pack(serialization._MAGIC, 24, len(said))
        file.write(head + said)
        with pytest.raises(ValueError, match=r"found|Expecting"):
            serialization.read_value(file.fileno())


def test_what_a_reader_says_is_said_once_and_here(tmp_path):
    make, left_out = PLANTED["svg"]
    path = make(tmp_path)
    with pytest.warns(rj.LoadWarning) as told:
        rj.load(path)
    assert len(told) == 1
    assert told[0].filename == __file__
    assert told[0].message.left_out == left_out


# What is not ours is not reached


SHEET = "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n*ELEMENT, TYPE=S3\n1, 1, 2, 3\n"


def xdmf(place, form="Binary"):
    return (
        '<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ">'
        f'<DataItem DataType="Float" Dimensions="3 3" Format="{form}" Precision="8">{place}'
        '</DataItem></Geometry><Topology TopologyType="Triangle" NumberOfElements="1">'
        '<DataItem DataType="Int" Dimensions="1 3" Format="XML" Precision="8">0 1 2</DataItem>'
        "</Topology></Grid></Domain></Xdmf>"
    )


def make_include(folder, place):
    (folder / "a.inp").write_text(f"{SHEET}*INCLUDE, INPUT={place}\n")
    return folder / "a.inp"


def make_xdmf(folder, place):
    (folder / "a.xdmf").write_text(xdmf(place))
    return folder / "a.xdmf"


NAMING = {"inp": (make_include, SHEET.encode()), "xdmf": (make_xdmf, SQUARE[:3].tobytes())}
"""What names another file, and what that holds that makes it a sound mesh."""


@pytest.fixture
def all_of_meshio(tmp_path, monkeypatch):
    """Let meshio read all kinds of XDMF, of which it reads none without h5py."""
    pytest.importorskip("meshio")
    is_there = importlib.util.find_spec(HDF5) is not None
    if not is_there:
        (tmp_path / "beside").mkdir()
        (tmp_path / "beside" / f"{HDF5}.py").write_text("")
        monkeypatch.syspath_prepend(tmp_path / "beside")
    yield
    isolation._kill_all()
    if not is_there:
        sys.modules.pop(HDF5, None)


@pytest.mark.usefixtures("all_of_meshio")
@pytest.mark.parametrize("isolate", [True, False])
def test_binary_numbers_of_an_xdmf_file_are_looked_for_beside_it(tmp_path, monkeypatch, isolate):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "points.bin").write_bytes(SQUARE[:3].tobytes())
    make_xdmf(folder, "points.bin")
    monkeypatch.chdir(tmp_path)
    assert len(rj.load("folder/a.xdmf", isolate=isolate).nodes[0].mesh.faces) == 1


@pytest.mark.usefixtures("all_of_meshio")
@pytest.mark.parametrize("name", NAMING)
@pytest.mark.parametrize("way", ["absolute", "above", "link"])
def test_a_file_outside_the_folder_is_not_read(tmp_path, monkeypatch, name, way):
    make, content = NAMING[name]
    folder, secret = tmp_path / "model", tmp_path / "secret"
    folder.mkdir()
    secret.write_bytes(content)
    # Some readers take names for relative to where the program is.
    monkeypatch.chdir(folder)
    place = {"absolute": secret, "above": "../secret", "link": "link"}[way]
    (folder / "link").symlink_to(secret)
    path = make(folder, place)
    assert rj.load(path, isolate=False).nodes
    with pytest.raises(rj.MeshFileError, match=r"lies outside|Permission denied") as refused:
        rj.load(path)
    assert str(path) in str(refused.value)
    assert rj.load(path, resource_root=tmp_path).nodes


@pytest.mark.usefixtures("all_of_meshio")
@pytest.mark.parametrize("name", NAMING)
@pytest.mark.parametrize(
    ("kind", "inside"),
    [("pipe", False), ("pipe", True), ("/dev/zero", True), ("/proc/self/environ", False)],
)
def test_pipes_and_devices_are_not_waited_for(tmp_path, monkeypatch, name, kind, inside):
    make, _ = NAMING[name]
    folder = tmp_path / "model"
    folder.mkdir()
    monkeypatch.chdir(folder)
    place = Path(kind)
    if kind == "pipe":
        place = (folder if inside else tmp_path) / "pipe"
        os.mkfifo(place)
    elif inside:
        (folder / "link").symlink_to(place)
        place = "link"
    begin = time.monotonic()
    with pytest.raises(rj.MeshFileError, match=r"lies outside|no regular file"):
        rj.load(make(folder, place))
    assert time.monotonic() - begin < LONGEST


def in_child(code):
    """Run code in a process that holds itself to limits, and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@linux
def test_the_kernel_itself_opens_nothing_else(tmp_path):
    """Readers in C ask no hook of Python's."""
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a").write_text("a")
    (tmp_path / "b").write_text("b")
    code = f"""
import ctypes, os, socket
from rasterjit.io.foreign.sandbox import restrict_files, list_library_paths, isolate_network
libc = ctypes.CDLL(None, use_errno=True)
isolate_network()
kept = restrict_files([{str(tmp_path / "in")!r}, *list_library_paths()])
opened = [libc.open(place.encode(), flags) for place, flags in [
    ({str(tmp_path / "in" / "a")!r}, 0), ({str(tmp_path / "b")!r}, 0), ("/etc/passwd", 0),
    ({str(tmp_path / "in" / "a")!r}, 1), ({str(tmp_path / "in" / "c")!r}, 0o101)]]
try:
    socket.create_connection(("127.0.0.1", 9), timeout=1)
except OSError as error:
    print(kept, [one >= 0 for one in opened], type(error).__name__)
"""
    said = in_child(code)
    if said.startswith("False"):
        pytest.skip("this kernel has no Landlock")
    assert said.split(" ", 1)[1].startswith("[True, False, False, False, False]"), said


# The process


def small(folder, name="a.vtk"):
    """Write a triangle that a package of others reads."""
    return tables(folder / name, [("triangle", np.array([[0, 1, 2]]))])


def idle():
    """Return the number of the process that waits for the next file."""
    return isolation._IDLE_READERS[-1]._process.pid


def test_a_process_is_kept_for_the_next_file_and_replaced_when_it_is_gone(tmp_path):
    path = small(tmp_path)
    rj.load(path)
    first = idle()
    rj.load(path)
    assert idle() == first
    os.kill(first, signal.SIGKILL)
    isolation._IDLE_READERS[-1]._process.wait()
    assert rj.load(path).nodes
    assert idle() != first


def test_where_the_program_is_does_not_matter(tmp_path, monkeypatch):
    path, gone = small(tmp_path), tmp_path / "gone"
    monkeypatch.chdir(tmp_path)
    assert rj.load("a.vtk").nodes
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert rj.load(path).nodes
    monkeypatch.chdir(tmp_path)


def test_threads_read_at_the_same_time(tmp_path):
    path, found = small(tmp_path), []
    threads = [threading.Thread(target=lambda: found.append(rj.load(path))) for _ in range(3)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(found) == 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_forked_child_reads_by_a_process_of_its_own(tmp_path):
    path = small(tmp_path)
    rj.load(path)
    before = idle()
    child = os.fork()
    if not child:
        status = 1
        try:
            rj.load(path)
            status = int(idle() == before)
            isolation._kill_all()
        finally:
            os._exit(status)
    assert os.waitpid(child, 0)[1] == 0
    rj.load(path)
    assert idle() == before


ENDS = """
import os, signal, sys
import rasterjit as rj
from rasterjit.io.foreign import isolation
rj.load(sys.argv[1])
print(isolation._IDLE_READERS[-1]._process.pid, flush=True)
if sys.argv[2] == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
"""


@linux
@pytest.mark.parametrize("how", ["ends", "killed"])
def test_the_process_ends_with_the_program(tmp_path, how):
    done = subprocess.run(
        [sys.executable, "-c", ENDS, small(tmp_path), how], cwd=ROOT, capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip
    number, until = int(done.stdout), time.monotonic() + LONGEST
    while Path(f"/proc/{number}").exists() and time.monotonic() < until:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
        if state == "Z":
            # Whoever takes orphans in has not looked yet.
            break
        time.sleep(0.05)
    else:
        assert not Path(f"/proc/{number}").exists()


def test_nothing_of_it_is_loaded_for_formats_of_our_own(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    said = in_child(
        f"import sys, rasterjit as rj; rj.load({str(tmp_path / 'a.obj')!r});"
        "print([name for name in sys.modules if name.startswith('rasterjit.io.foreign.')])"
    )
    assert not {"isolation", "serialization", "limits", "readers"} & set(
        said.replace("'", ".").split(".")
    )


@pytest.mark.parametrize("isolate", [None, 1, "yes"])
def test_whether_to_isolate_is_checked(tmp_path, isolate):
    with pytest.raises(ValueError, match="isolate must be True, False or 'all', got"):
        rj.load(small(tmp_path), isolate=isolate)


# Memory


def triangles(path, side):
    rows, columns = np.indices((side, side)).reshape(2, -1)
    points = np.stack([columns, rows, np.sin(rows)], axis=1).astype(float)
    first = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).reshape(-1, 1)
    faces = (first + np.array([0, 1, side + 1, 0, side + 1, side])).reshape(-1, 3)
    if path.suffix == ".dae":
        trimesh = pytest.importorskip("trimesh")
        trimesh.Trimesh(points, faces, process=False).export(path)
        return path
    return tables(path, [("triangle", faces)], points)


def curves(path, side):
    shapes = "".join(f'<path d="M{n} 0C1 2 {n} 3 4 0"/>' for n in range(side * side // 8))
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{shapes}</svg>')
    return path


LARGE = {
    "a.vtk": triangles, "a.dae": triangles, "a.svg": curves,
    "a.las": lambda path, side: cloud(path, side * side),
    "a.laz": lambda path, side: cloud(path, side * side),
}  # fmt: skip


@linux
@pytest.mark.parametrize("name", LARGE)
def test_what_is_counted_is_half_of_what_the_process_takes_at_least(tmp_path, monkeypatch, name):
    peaks, ask = [], isolation._ReaderProcess.ask

    def watched(reader, *request):
        answer, found = ask(reader, *request)
        peaks.append(answer["peak"])
        return answer, found

    monkeypatch.setattr(isolation._ReaderProcess, "ask", watched)
    for side in (3, 3, 200):
        # The first imports what reads it.
        path = LARGE[name](tmp_path / name, side)
        budget = MemoryBudget(str(path))
        isolation.read_isolated(path, Resources(path, None, budget), "raise", "error", LeftOut())
    assert 0 < peaks[-1] - peaks[-2] < 2 * (budget.max_bytes - budget.left)


# What harms


def harmful_laz(folder):
    """Return a LAZ file whose table says that it has 2³²-1 chunks."""
    path = cloud(folder / "a.laz", 3)
    content = bytearray(path.read_bytes())
    at = struct.unpack_from("<I", content, 96)[0]
    table = struct.unpack_from("<q", content, at)[0]
    struct.pack_into("<I", content, table + 4, 0xFFFFFFFF)
    path.write_bytes(content)
    return path


def counted(kind, at):
    """Return what writes a cloud whose head says at a place that there are 2³²-1 of something."""

    def make(folder):
        path = cloud(folder / f"a.{kind}", 3)
        content = bytearray(path.read_bytes())
        struct.pack_into("<I", content, at, 0xFFFFFFFF)
        path.write_bytes(content)
        return path

    return make


def cut_mdpa(folder):
    path = tables(folder / "a.mdpa", [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))])
    path.write_bytes(path.read_bytes().partition(b"End Nodes")[0])
    return path


def cut_tec(folder):
    path = tables(folder / "a.tec", [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))])
    path.write_bytes(path.read_bytes()[:90])
    return path


def bomb(folder, size=1 << 30):
    """Return a VTU file of a few megabytes that unpacks to a gigabyte."""
    maker, piece = zlib.compressobj(9), bytes(1 << 20)
    packed = b"".join(maker.compress(piece) for _ in range(size >> 20)) + maker.flush()
    head = base64.b64encode(struct.pack("<4I", 1, 2**31, 0, len(packed))).decode()
    path = folder / "a.vtu"
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="3" '
        'NumberOfCells="1"><Points><DataArray type="Float64" NumberOfComponents="3" '
        f'format="binary">{head}{base64.b64encode(packed).decode()}</DataArray></Points><Cells>'
        '<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>'
        '<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray>'
        '<DataArray type="UInt8" Name="types" format="ascii">5</DataArray>'
        "</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    return path


HARMFUL = {
    "laz of many chunks": harmful_laz, "las of many records": counted("las", 100),
    "laz of many records": counted("laz", 100), "las of many points": counted("las", 107),
    "laz of many points": counted("laz", 107), "mdpa cut short": cut_mdpa,
    "tec cut short": cut_tec, "vtu bomb": bomb,
    "vtu of much": lambda folder: bomb(folder, 384 << 20),
}  # fmt: skip


@linux
@pytest.mark.parametrize("name", HARMFUL)
def test_what_crashes_or_never_ends_is_an_error_that_names_the_file(tmp_path, monkeypatch, name):
    monkeypatch.setattr(isolation, "_BASE_CPU_SECONDS", 3)
    path, begin = HARMFUL[name](tmp_path), time.monotonic()
    with pytest.raises(ValueError, match=r"could not be read|max_bytes|damaged") as refused:
        rj.load(path, max_bytes=300 << 20)
    assert str(path) in str(refused.value)
    assert time.monotonic() - begin < LONGEST
    # The next file is read as if nothing had been.
    sound = tables(tmp_path / "b.vtk", [("triangle", np.array([[0, 1, 2]]))])
    assert rj.load(sound).nodes


@linux
@pytest.mark.parametrize("kind", ["mdpa", "tec", "dat", "msh", "inp", "avs", "mesh", "vol"])
def test_a_file_cut_short_anywhere_is_not_read_for_ever(tmp_path, kind):
    whole = tables(tmp_path / f"a.{kind}", [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))])
    content = whole.read_bytes()
    said = [
        str(outcome(whole))
        for cut in range(1, 20)
        if whole.write_bytes(content[: cut * len(content) // 20])
    ]
    assert not [one for one in said if "takes more than" in one]
    if kind in ("mdpa", "tec", "dat"):
        assert [one for one in said if "it ends where more is expected" in one]


@pytest.mark.parametrize("mode", ["r", "rb"])
def test_a_file_is_read_in_vain_only_so_often(tmp_path, mode):
    path = tmp_path / "a"
    path.write_text("one\ntwo\n")
    with sandbox._open(path, mode) as file:
        for _ in range(3):
            # What comes in between is no vain reading.
            file.seek(0)
            assert len(file.readlines()) == 2
            for _ in range(sandbox._MAX_EMPTY_READS // 2):
                assert not file.readline()
        with pytest.raises(EOFError, match="it ends where more is expected"):
            all(not file.readline() for _ in range(sandbox._MAX_EMPTY_READS))


@pytest.mark.parametrize("options", [
    {}, {"mode": "rb"}, {"encoding": "latin-1"}, {"newline": ""}, {"errors": "replace"},
    {"mode": "rb", "buffering": 0}, {"mode": "rb", "encoding": "utf-8"}, {"mode": "x y"},
    {"mode": 3},
])  # fmt: skip
def test_files_are_opened_as_python_opens_them(tmp_path, options):
    path = tmp_path / "a"
    path.write_bytes(b"one\r\nt\xffo\n")

    def read(opened):
        """Return what a file holds, or what is said about it."""
        try:
            with opened(path, **options) as file:
                return file.read()
        except Exception as error:
            return type(error), str(error)

    assert read(sandbox._open) == read(open)
