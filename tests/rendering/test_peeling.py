"""The layers of a pixel are all surfaces at its centre, sorted, and the first is what is seen."""

from __future__ import annotations

import naive_layers
import numpy as np
import pytest
from opengl import optional_module

import rasterjit as rj

SIZE = (32, 32)
T = rj.transforms


def soup(rng, count, size=SIZE):
    """Return triangles that cross each other."""
    return [
        (
            np.round(rng.uniform(-5, np.array(size) + 5.0, (3, 2)) * 64.0) / 64.0,
            np.round(rng.uniform(-0.95, 0.95, 3) * 64.0) / 64.0,
        )
        for _ in range(count)
    ]


def meshes_of(triangles, alphas):
    return [
        naive_layers.mesh_of(points, depths, SIZE, base_color=(1, 1, 1, a), alpha_mode="blend")
        for (points, depths), a in zip(triangles, alphas, strict=True)
    ]


@pytest.mark.parametrize("k", [1, 3, 40])
def test_layers_are_all_surfaces_sorted_whatever_their_alpha(k):
    rng = np.random.default_rng(71)
    triangles = soup(rng, 24)
    # Exact ties: the lower face is nearer.
    triangles[20:] = triangles[:4]
    scene = naive_layers.scene_of(meshes_of(triangles, rng.choice([0.0, 0.4, 1.0], 24)))
    frame = rj.render_layers(
        scene, naive_layers.CAMERA, k=k, size=SIZE, outputs=("face_id", "depth")
    )
    surfaces = naive_layers.rounded_surfaces(triangles, SIZE)
    assert max(map(len, surfaces.values())) > 5
    for row, column in np.ndindex(SIZE[1], SIZE[0]):
        want = [face for _, face in surfaces.get((column, row), [])][:k]
        want += [-1] * (k - len(want))
        assert frame.face_id[:, row, column].tolist() == want
    assert (np.isfinite(frame.depth) == (frame.face_id >= 0)).all()
    # In NumPy inf - inf is not a number, and such are in no order.
    with np.errstate(invalid="ignore"):
        assert not (np.diff(frame.depth, axis=0) < 0.0).any()


@pytest.fixture
def scene(cube, sphere):
    """Opaque, see-through and cut-out objects, one inside another."""
    found = rj.Scene()
    found.add(cube)
    glass = rj.Material(base_color=(0, 1, 0, 0.3), alpha_mode="blend")
    found.add(rj.Mesh(sphere.vertices, sphere.faces, material=glass), T.scale((1.5, 1.5, 1.5)))
    stripes = np.ones((1, 8, 4))
    stripes[:, ::2, 3] = 0.0
    holes = rj.Material(base_color_texture=rj.Texture(stripes, filter="nearest"), alpha_mode="mask")
    fence = rj.Mesh([[-2, -2, 2], [2, -2, 2], [2, 2, 2], [-2, 2, 2]], [[0, 1, 2], [0, 2, 3]],
                    uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=holes)  # fmt: skip
    found.add(fence)
    return found


BUFFERS = (
    "depth", "face_id", "object_id", "barycentric", "normal", "position", "distance", "nocs",
    "object_position", "geometric_normal", "material_id", "instance_id",
)  # fmt: skip


@pytest.mark.parametrize("quality", [
    rj.Quality(), rj.Quality(depth_format="unorm24"), rj.Quality(depth_format="float64"),
    rj.Quality(interpolation="affine"), rj.Quality(samples=4),
], ids=str)  # fmt: skip
def test_first_layer_is_what_render_shows(scene, camera, quality):
    layers = rj.render_layers(scene, camera, k=3, size=SIZE, quality=quality, outputs=BUFFERS)
    frame = rj.render(scene, camera, size=SIZE, quality=quality, outputs=BUFFERS)
    for name in BUFFERS:
        array = getattr(layers, name)
        assert array.shape == (3, *getattr(frame, name).shape)
        assert array[0].tobytes() == getattr(frame, name).tobytes(), name


def test_each_layer_is_what_is_seen_without_those_before_it(scene, camera):
    layers = rj.render_layers(scene, camera, k=6, size=SIZE, outputs=BUFFERS)
    assert (layers.face_id[3] >= 0).any()
    # Holes at the fence, which is object 2: there the layer before the others is another one.
    is_fence = layers.object_id[0] == 2
    assert is_fence.any()
    unfenced = rj.Scene()
    for node in scene.nodes[:2]:
        unfenced.add(node.mesh, node.world_from_model)
    without = rj.render_layers(unfenced, camera, k=5, size=SIZE, outputs=BUFFERS)
    for name in BUFFERS:
        have, want = getattr(layers, name), getattr(without, name)
        assert have[1:6][:, is_fence].tobytes() == want[:5][:, is_fence].tobytes(), name
        assert have[:5][:, ~is_fence].tobytes() == want[:5][:, ~is_fence].tobytes(), name


def test_empty_slots_hold_what_is_held_where_nothing_is(scene, camera):
    layers = rj.render_layers(scene, camera, k=12, size=SIZE, outputs=BUFFERS)
    empty = layers.face_id < 0
    assert empty[-1].all()
    # No surface lies behind an empty slot.
    assert not (empty[:-1] & ~empty[1:]).any()
    for name in ("depth", "distance"):
        assert (getattr(layers, name)[empty] == np.inf).all()
    for name in ("object_id", "material_id", "instance_id"):
        assert (getattr(layers, name)[empty] == -1).all()
    for name in ("barycentric", "normal", "geometric_normal"):
        assert (getattr(layers, name)[empty] == 0).all()
    for name in ("position", "object_position", "nocs"):
        assert np.isnan(getattr(layers, name)[empty]).all()


def test_culled_faces_are_no_layers(cube, camera):
    all_ = rj.render_layers(cube, camera, k=4, size=SIZE, outputs="face_id")
    front = rj.render_layers(cube, camera, k=4, size=SIZE, outputs="face_id", cull="back")
    back = rj.render_layers(cube, camera, k=4, size=SIZE, outputs="face_id", cull="front")
    assert (all_.face_id[0] == front.face_id[0]).all()
    assert (all_.face_id[1] == back.face_id[0]).all()
    assert (front.face_id[1:] == -1).all()


def test_faces_cut_by_the_near_plane_are_layers(cube):
    camera = rj.PerspectiveCamera((0.2, 0.1, 1.5), (0, 0, 0), near=1.0, far=9.0)
    layers = rj.render_layers(cube, camera, k=3, size=SIZE, outputs=("face_id", "depth"))
    frame = rj.render(cube, camera, size=SIZE, outputs=("face_id", "depth"))
    assert frame.stats.clipped > 0
    assert layers.face_id[0].tobytes() == frame.face_id.tobytes()
    assert layers.depth[0].tobytes() == frame.depth.tobytes()


def test_motion_is_that_of_each_layer(cube, camera):
    moved = rj.PerspectiveCamera((2.3, 3.1, 4.0), (0, 0, 0), near=0.5, far=20.0)
    options = {"size": SIZE, "previous": rj.PreviousView(camera=moved)}
    options["outputs"] = ("motion", "motion_visible", "face_id")
    layers = rj.render_layers(cube, camera, k=2, **options)
    frame = rj.render(cube, camera, **options)
    back = rj.render(cube, camera, cull="front", **options)
    assert layers.motion[0].tobytes() == frame.motion.tobytes()
    assert layers.motion[1].tobytes() == back.motion.tobytes()
    # The far side of a closed body was not seen before either.
    assert layers.motion_visible[0].mean() > 0.2
    hidden = layers.motion_visible[1][layers.face_id[1] >= 0]
    assert hidden.mean() < 0.1


def test_any_number_of_threads_gives_the_same_bits(scene, camera):
    found = [
        rj.render_layers(
            scene, camera, k=4, size=(150, 130), outputs=BUFFERS, threads=threads
        ).arrays()
        for threads in (1, 3)
    ]
    for name in BUFFERS:
        assert found[0][name].tobytes() == found[1][name].tobytes()


def test_layers_are_saved_and_say_what_they_are(cube, camera, tmp_path):
    frame = rj.render_layers(cube, camera, k=2, size=SIZE)
    assert repr(frame) == "LayeredFrame(2 layers, 32 x 32: depth, face_id, object_id)"
    assert "the nearest 2 of each pixel" in str(frame.plan)
    assert frame.stats.pixels_covered == (frame.face_id[0] >= 0).sum()
    frame.save(tmp_path / "layers.npz")
    with np.load(tmp_path / "layers.npz") as saved:
        assert saved["depth"].shape == (2, 32, 32)
    with pytest.raises(rj.OutputNotRequestedError, match="normal"):
        frame.normal  # noqa: B018
    with pytest.raises(ValueError, match=r"\.png holds one layer"):
        frame.save(tmp_path / "layers.png")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"k": 0}, "k must be in 1..4096, got 0"),
        ({"k": -1}, "k must be in"),
        ({"k": 4097}, "k must be in"),
        ({"k": 2.0}, "k must be a whole number"),
        ({"k": True}, "k must be a whole number"),
        ({"k": None}, "k must be a whole number"),
        ({"outputs": "color"}, "outputs has 'color', which a layer does not have"),
        ({"outputs": ("depth", "coverage")}, "outputs has 'coverage'"),
        ({"outputs": ("linear",)}, "outputs has 'linear'"),
        ({"outputs": ()}, "outputs must name at least one"),
        ({"outputs": "motion"}, "previous must be a PreviousView where outputs has 'motion'"),
        ({"previous": 3}, "previous must be a PreviousView or None"),
        ({"cull": "both"}, "cull must be"),
        ({"size": (0, 3)}, "size must be"),
        ({"quality": 7}, "quality must be"),
    ],
)
def test_bad_arguments_are_refused_by_name(cube, camera, options, message):
    with pytest.raises(ValueError, match=message):
        rj.render_layers(cube, camera, **{"k": 2, "size": SIZE, **options})


SAVED = ("depth", "normal", "object_id", "uv")


@pytest.fixture
def narrow(scene, camera):
    """Two columns: as many as channels that an output may have."""
    return rj.render_layers(scene, camera, k=3, size=(2, 5), outputs=SAVED)


@pytest.mark.parametrize("names", [None, "depth", ("normal", "object_id")])
def test_layers_come_back_from_their_file(narrow, tmp_path, names):
    narrow.save(tmp_path / "l.npz", names)
    expected = SAVED if names is None else (names,) if isinstance(names, str) else names
    with np.load(tmp_path / "l.npz") as found:
        assert set(found) == set(expected)
        for name in expected:
            assert found[name].tobytes() == getattr(narrow, name).tobytes()
            assert found[name].shape[:3] == (3, 5, 2)
    narrow.save(str(tmp_path / "l.npy"), "normal")
    assert np.load(tmp_path / "l.npy").tobytes() == narrow.normal.tobytes()


def test_an_exr_has_the_channels_of_each_layer(narrow, tmp_path):
    openexr = optional_module("OpenEXR")
    narrow.save(tmp_path / "l.exr")
    with openexr.File(str(tmp_path / "l.exr"), separate_channels=True) as file:
        found = {name: np.array(one.pixels) for name, one in file.channels().items()}
        header = dict(file.header())
    parts = ("Z", "normal.X", "normal.Y", "normal.Z", "object_id", "uv.U", "uv.V")
    assert set(found) == {f"layer{n}.{part}" for n in range(3) for part in parts}
    for n in range(3):
        assert found[f"layer{n}.Z"].tobytes() == narrow.depth[n].tobytes()
        assert (found[f"layer{n}.object_id"].astype(int) - 1 == narrow.object_id[n]).all()
        for axis, part in enumerate("XYZ"):
            assert (found[f"layer{n}.normal.{part}"] == narrow.normal[n, :, :, axis]).all()
    assert header["rasterjit.object_id"] == "number + 1; 0 where nothing is there"


@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        ("l.png", {"outputs": "depth"}, "choose one of .npz"),
        ("l.jpg", {}, "choose one of .npz"),
        ("l.txt", {}, "must end in one of"),
        ("none/l.npz", {}, "does not exist"),
        ("l.npy", {}, "must name one output for .npy"),
        ("l.npz", {"outputs": ()}, "at least one output"),
        ("l.npz", {"outputs": "position"}, "among what was rendered"),
        ("l.npz", {"scale": 1.0}, "scale must be None for layers, got 1.0"),
    ],
)
def test_what_layers_cannot_be_saved_as_is_refused(narrow, tmp_path, path, options, message):
    with pytest.raises(ValueError, match=message):
        narrow.save(tmp_path / path, **options)
    assert not list(tmp_path.iterdir())


def test_masks_are_of_one_layer(narrow):
    with pytest.raises(ValueError, match=r"rasterjit.masks.find\(frame.object_id\[0\]\)"):
        narrow.masks()
    with pytest.raises(ValueError, match="position was not rendered"):
        narrow.masks("position")
    found = rj.masks.find(narrow.object_id[0])
    assert sum(mask.area for mask in found) == np.count_nonzero(narrow.object_id[0] >= 0)
