"""Pictures written tile by tile are those of one frame."""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from pieces import blob
from PIL import Image

import rasterjit as rj

SIZE = (150, 100)
PATIENCE = 60.0

if os.environ.get("CI") != "true" or sys.version_info < (3, 11):
    # Zarr 3 needs Python 3.11.
    pytest.importorskip("tifffile", reason="needs tifffile: rasterjit[large]")
    pytest.importorskip("zarr", reason="needs Zarr: rasterjit[large]")


@pytest.fixture
def scene():
    made = rj.Scene()
    made.add(rj.Mesh(*blob(3), material=rj.Material(shading="flat")))
    made.lights = [
        rj.AmbientLight(intensity=0.3),
        rj.DirectionalLight((-1.0, -2.0, -1.0), shadow=rj.Shadow(size=256)),
    ]
    return made


def read(path):
    if path.suffix == ".zarr":
        import zarr

        return zarr.open_array(path, mode="r")[:]
    import tifffile

    return tifffile.imread(path)


@pytest.mark.needs_jit
@pytest.mark.parametrize("suffix", [".tif", ".tiff", ".zarr"])
@pytest.mark.parametrize("is_far", [False, True], ids=["here", "on a cluster"])
def test_file_holds_the_picture(scene, view, tmp_path, request, suffix, is_far):
    client = request.getfixturevalue("client") if is_far else None
    place = tmp_path / f"large{suffix}"
    rj.distributed.render_large(scene, view, SIZE, place, tile=64, client=client)
    wanted = rj.render(scene, view, size=SIZE).color
    assert read(place).tobytes() == wanted.tobytes()
    assert os.listdir(tmp_path) == [place.name]


@pytest.mark.needs_jit
@pytest.mark.needs_jit
def test_workers_are_sent_the_picture_behind_not_its_name(
    scene, view, tmp_path, client, monkeypatch
):
    picture = np.random.default_rng(1).integers(0, 256, (*SIZE[::-1], 3)).astype(np.uint8)
    (tmp_path / "here").mkdir()
    Image.fromarray(picture).save(tmp_path / "here" / "photo.png")
    # Processes of the cluster stand elsewhere.
    monkeypatch.chdir(tmp_path / "here")
    place = tmp_path / "large.tif"
    rj.distributed.render_large(
        scene, view, SIZE, place, tile=64, client=client, background="photo.png"
    )
    assert (
        read(place).tobytes()
        == rj.render(scene, view, size=SIZE, background=picture).color.tobytes()
    )


def test_tiff_is_tiled_and_says_what_its_channels_are(scene, view, tmp_path):
    import tifffile

    place = tmp_path / "large.tif"
    rj.distributed.render_large(scene, view, SIZE, place, tile=128, background="transparent")
    with tifffile.TiffFile(place) as file:
        page = file.pages[0]
        assert file.is_bigtiff
        assert page.is_tiled
        assert (page.tilewidth, page.tilelength) == (128, 128)
        assert page.photometric.name == "RGB"
        assert [one.name for one in page.extrasamples] == ["UNASSALPHA"]


@pytest.mark.needs_jit
@pytest.mark.parametrize("suffix", [".tif", ".zarr"])
def test_file_is_replaced_whole_or_kept(scene, view, tmp_path, monkeypatch, suffix):
    place = tmp_path / f"large{suffix}"
    rj.distributed.render_large(scene, view, SIZE, place, tile=64)
    before = read(place)
    from rasterjit.rendering.regions import RegionRenderer

    drawn, render_region = [], RegionRenderer.render_region

    def failing(self, region):
        if len(drawn) == 2:
            raise KeyboardInterrupt
        drawn.append(region)
        return render_region(self, region)

    with monkeypatch.context() as patched:
        patched.setattr(RegionRenderer, "render_region", failing)
        with pytest.raises(KeyboardInterrupt):
            rj.distributed.render_large(scene, view, (90, 70), place, tile=64)
    assert read(place).tobytes() == before.tobytes()
    assert os.listdir(tmp_path) == [place.name]
    rj.distributed.render_large(scene, view, (90, 70), place, tile=64)
    assert read(place).shape == (70, 90, 4)


@pytest.mark.needs_jit
def test_workers_keep_renderers_no_longer_than_the_picture_is_drawn(
    scene, view, tmp_path, client, wait_for_no_renderers
):
    rj.distributed.render_large(scene, view, SIZE, tmp_path / "large.tif", tile=64, client=client)
    assert wait_for_no_renderers(client) == 0


@pytest.mark.takes_long
@pytest.mark.needs_jit
def test_worker_killed_in_the_middle_changes_no_bit(scene, view, tmp_path, doomed):
    place, size = tmp_path / "large.zarr", (640, 640)
    task = threading.Thread(
        target=rj.distributed.render_large, args=(scene, view, size, place),
        kwargs={"tile": 64, "client": doomed}, daemon=True,
    )  # fmt: skip
    victim = next(iter(doomed.run(os.getpid).values()))
    task.start()
    deadline = time.monotonic() + PATIENCE
    # A chunk that is there means that drawing has begun.
    while not list(tmp_path.glob(".*/c/*/*/0")) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert task.is_alive()
    os.kill(victim, signal.SIGKILL)
    task.join(PATIENCE)
    assert not task.is_alive()
    assert read(place).tobytes() == rj.render(scene, view, size=size).color.tobytes()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"path": "picture.png"}, "must end in one of .tif, .tiff, .zarr"),
        ({"path": "nowhere/picture.tif"}, "does not exist"),
        ({"path": "nowhere/picture.zarr"}, "does not exist"),
        ({"path": 3}, "path must be a file name"),
        ({"size": (200000, 3)}, r"size must be two whole numbers in 1\.\.131072"),
        ({"tile": 100}, "tile must be a multiple of 64"),
        ({"client": 3}, "client must be a distributed.Client"),
        ({"threads": 0}, "threads must be in"),
        ({"cull": "all"}, "cull must be one of"),
    ],
)
def test_wrong_arguments_are_refused(scene, view, tmp_path, monkeypatch, wrong, message):
    monkeypatch.chdir(tmp_path)
    given = {"what": scene, "camera": view, "size": SIZE, "path": "picture.tif", **wrong}
    with pytest.raises(ValueError, match=message):
        rj.distributed.render_large(**given)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("about", [None, '{"node_type": "group"}', "[]", '"array"', "{", ""])
def test_folder_that_is_no_array_is_kept(scene, view, tmp_path, about):
    place = tmp_path / "large.zarr"
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    if about is not None:
        (place / "zarr.json").write_text(about)
    with pytest.raises(ValueError, match="is no Zarr array to be replaced"):
        rj.distributed.render_large(scene, view, SIZE, place)
    assert (place / "notes.txt").read_text() == "mine"


def test_group_of_arrays_is_kept(scene, view, tmp_path):
    import zarr

    place = tmp_path / "large.zarr"
    zarr.open_group(str(place), mode="w").create_array("mine", shape=(2,), dtype="uint8")[:] = 7
    with pytest.raises(ValueError, match="is no Zarr array to be replaced"):
        rj.distributed.render_large(scene, view, SIZE, place)
    assert zarr.open_group(str(place), mode="r")["mine"][:].tolist() == [7, 7]


@pytest.mark.needs_jit
@pytest.mark.parametrize("when", ["before", "after"])
def test_interrupt_while_the_array_is_replaced_loses_none(scene, view, tmp_path, monkeypatch, when):
    place = tmp_path / "large.zarr"
    rj.distributed.render_large(scene, view, SIZE, place, tile=64)
    before, replace = read(place), os.replace

    def interrupted(source, target):
        if when == "after" or Path(target) != place:
            replace(source, target)
        if Path(target) == place:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            rj.distributed.render_large(scene, view, (90, 70), place, tile=64)
    assert os.listdir(tmp_path) == [place.name]
    if when == "before":
        assert read(place).tobytes() == before.tobytes()
    else:
        assert read(place).shape == (70, 90, 4)


@pytest.mark.needs_jit
def test_link_to_an_array_is_replaced_and_the_array_kept(scene, view, tmp_path):
    there, place = tmp_path / "there.zarr", tmp_path / "large.zarr"
    rj.distributed.render_large(scene, view, SIZE, there, tile=64)
    try:
        place.symlink_to(there, target_is_directory=True)
    except OSError:
        pytest.skip("this system makes no links")
    rj.distributed.render_large(scene, view, (90, 70), place, tile=64)
    assert read(place).shape == (70, 90, 4)
    assert read(there).shape == (100, 150, 4)
    assert sorted(os.listdir(tmp_path)) == ["large.zarr", "there.zarr"]


@pytest.mark.needs_jit
def test_full_disk_names_the_array(scene, view, tmp_path, monkeypatch):
    import zarr

    def full(array, place, value):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(zarr.Array, "__setitem__", full)
    place = tmp_path / "large.zarr"
    with pytest.raises(OSError, match="No space left on device") as caught:
        rj.distributed.render_large(scene, view, SIZE, place, tile=64)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(place))
    assert not os.listdir(tmp_path)


@pytest.mark.needs_jit
def test_drawing_ends_when_the_writer_fails(scene, view, tmp_path, monkeypatch):
    import zarr

    from rasterjit.rendering.regions import RegionRenderer

    ended, render_regions = [], RegionRenderer.render_regions

    def noted(self, tile):
        try:
            yield from render_regions(self, tile)
        finally:
            ended.append(tile)

    def failing(array, place, value):
        raise RuntimeError("a bad chunk")

    monkeypatch.setattr(RegionRenderer, "render_regions", noted)
    monkeypatch.setattr(zarr.Array, "__setitem__", failing)
    # The error holds the writer's frames, and the tiles with them.
    with pytest.raises(RuntimeError, match="a bad chunk") as caught:
        rj.distributed.render_large(scene, view, SIZE, tmp_path / "large.zarr", tile=64)
    assert caught.value.__traceback__ is not None
    assert ended == [64]


@pytest.mark.needs_jit
@pytest.mark.parametrize("suffix", [".tif", ".zarr"])
def test_no_more_than_two_tiles_are_held(scene, view, tmp_path, monkeypatch, suffix):
    import tifffile

    from rasterjit.rendering.regions import RegionRenderer

    # As on a machine with many processors.
    monkeypatch.setattr(tifffile.TIFF, "MAXWORKERS", 8, raising=False)
    drawn, most, render_region = [], [], RegionRenderer.render_region

    def counted(self, region):
        most.append(sum(one() is not None for one in drawn))
        frame = render_region(self, region)
        drawn.append(weakref.ref(frame.color))
        return frame

    monkeypatch.setattr(RegionRenderer, "render_region", counted)
    place = tmp_path / f"large{suffix}"
    rj.distributed.render_large(scene, view, (1024, 256), place, tile=128)
    assert len(most) == 16
    # One more, and the one that is drawn then.
    assert max(most) <= 1


@pytest.mark.parametrize(("suffix", "module"), [(".tif", "tifffile"), (".zarr", "zarr")])
def test_what_is_missing_is_named(scene, view, tmp_path, monkeypatch, suffix, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=r'pip install "rasterjit\[large\]"'):
        rj.distributed.render_large(scene, view, SIZE, tmp_path / f"large{suffix}")


def test_missing_dask_is_named(cube, view, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for call in (
        lambda: rj.render_many(cube, [view], client=object()),
        lambda: rj.distributed.render_partitions([blob(0)], view),
    ):
        with pytest.raises(ImportError, match=r'pip install "rasterjit\[distributed\]"'):
            call()


def test_large_region_of_a_small_picture(scene, view, tmp_path):
    place = tmp_path / "small.tif"
    rj.distributed.render_large(scene, view, (20, 10), place, tile=64)
    assert np.array_equal(read(place), rj.render(scene, view, size=(20, 10)).color)
