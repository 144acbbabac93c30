"""BOP data sets against formulas of the toolkit, in NumPy, and through files and back."""

from __future__ import annotations

import json
import threading
import warnings
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.dataset import bop, object_views, render_objects

MODELS = Path(__file__).parents[2] / "models"
WIDTH, HEIGHT = SIZE = 80, 60
K = np.array([[100.0, 0.0, 41.2], [0.0, 104.0, 27.7], [0.0, 0.0, 1.0]])
CAMERA = rj.cameras.from_opencv(K, SIZE)
DELTA = 15.0


def make_models(folder):
    """Write three models, and return them as they are read."""
    meshes = {}
    for number, name in enumerate(("teapot.obj", "torus_knot.obj", "cube.ply"), 1):
        mesh = rj.load(MODELS / name).nodes[0].mesh
        low, high = mesh.bounds()
        scale = 120.0 / np.linalg.norm(high - low)
        meshes[number] = rj.Mesh((mesh.vertices - (low + high) / 2) * scale, mesh.faces)
    bop.write_models(folder, meshes)
    return bop.read_models(folder)


def make_scene(models):
    scene = rj.Scene()
    for model in models.values():
        scene.add(model.mesh)
    return scene


def make_poses(count, objects=3, seed=5):
    """Return random poses, some beside the picture, behind the camera or hidden."""
    random = np.random.default_rng(seed)
    quaternions = random.normal(size=(count * objects, 4))
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1)[:, None]).T
    poses = np.tile(np.eye(4), (count, objects, 1, 1))
    poses[..., :3, :3] = np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]), 2, 0).reshape(count, objects, 3, 3)  # fmt: skip
    poses[..., :3, 3] = random.uniform((-160, -120, 250), (160, 120, 600), (count, objects, 3))
    poses[::40, 0, 2, 3] = -300.0
    # OpenCV's camera stands at the origin of a world with its axes.
    return poses


def make_matrix(pose):
    """Return the matrix of a pose of ``scene_gt.json``, in the world of an OpenCV camera."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(pose["cam_R_m2c"], (3, 3))
    matrix[:3, 3] = pose["cam_t_m2c"]
    return matrix


def distances(depth):
    """``misc.depth_im_to_dist_im_fast`` of the toolkit: from depth to the way along the ray."""
    x = (np.arange(WIDTH) - K[0, 2]) / K[0, 0]
    y = ((np.arange(HEIGHT) - K[1, 2]) / K[1, 1])[:, None]
    return np.sqrt((x * depth) ** 2 + (y * depth) ** 2 + depth.astype(np.float64) ** 2)


def box_of(mask, shift=(0, 0)):
    """``misc.calc_2d_bbox`` of the toolkit."""
    ys, xs = mask.nonzero()
    return [int(v) for v in (xs.min() - shift[0], ys.min() - shift[1], np.ptp(xs), np.ptp(ys))]


def test_masks_boxes_and_counts_of_500_views_are_the_toolkits(tmp_path):
    # scripts/calc_gt_info.py, calc_gt_masks.py and visibility.py (mode "bop19"), from the files.
    models = make_models(tmp_path / "models")
    views = render_objects(
        make_scene(models), [CAMERA] * 500, size=SIZE, transforms=make_poses(500), delta=DELTA
    )
    folder = tmp_path / "train/000000"
    assert bop.write_scene(folder, views) == 500
    cameras, truths, infos = (
        json.loads((folder / f"scene_{name}.json").read_text())
        for name in ("camera", "gt", "gt_info")
    )
    # Each object alone on the whole canvas of the toolkit.
    wide = 3 * WIDTH, 3 * HEIGHT
    moved = rj.cameras.from_opencv(K + [[0, 0, WIDTH], [0, 0, HEIGHT], [0, 0, 0]], wide)
    alone = {
        number: rj.render_batch(
            model.mesh, [moved] * 500, size=wide, outputs="depth",
            transforms=np.array([
                make_matrix(one) for poses in truths.values() for one in poses
                if one["obj_id"] == number
            ])[:, None],
        ).depth
        for number, model in models.items()
    }  # fmt: skip
    seen = {"hidden": 0, "partly": 0, "cut off": 0, "nothing": 0}
    for key, poses in truths.items():
        assert np.array_equal(np.reshape(cameras[key]["cam_K"], (3, 3)), K)
        picture = iio.imread(folder / f"depth/{int(key):06d}.png").astype(np.float32)
        picture *= cameras[key]["depth_scale"]
        for k, (pose, info) in enumerate(zip(poses, infos[key], strict=True)):
            large = alone[pose["obj_id"]][int(key)]
            large = np.where(np.isinf(large), np.float32(0.0), large)
            own = distances(large[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH])
            scene = distances(picture)
            behind = own.astype(np.float32) - scene.astype(np.float32)
            visible = ((behind <= DELTA) | (scene == 0)) & (own > 0)
            count, total = int(visible.sum()), int((large > 0).sum())
            assert info == {
                "bbox_obj": box_of(large > 0, SIZE) if count else [-1] * 4,
                "bbox_visib": box_of(visible) if count else [-1] * 4,
                "px_count_all": total, "px_count_valid": int((scene[own > 0] > 0).sum()),
                "px_count_visib": count, "visib_fract": count / total if total else 0.0,
            }  # fmt: skip
            for name, mask in (("mask", own > 0), ("mask_visib", visible)):
                codes = iio.imread(folder / f"{name}/{int(key):06d}_{k:06d}.png")
                assert np.array_equal(codes, 255 * mask.astype(np.uint8)), (key, k, name)
            inside = int((own > 0).sum())
            seen["nothing"] += total == 0
            seen["hidden"] += count == 0 < inside
            seen["partly"] += 0 < count < inside
            seen["cut off"] += 0 < inside < total
    assert min(seen.values()) > 5, seen


def test_without_delta_masks_are_what_the_picture_shows(tmp_path):
    scene = make_scene(make_models(tmp_path / "models"))
    floor = rj.Mesh([(-900, 90, 0), (900, 90, 0), (0, 90, 3000)], [(0, 1, 2)])
    scene.nodes.insert(0, rj.Node(floor))
    poses = make_poses(12, 4)
    poses[:, 0] = np.eye(4)
    samples = rj.Quality(samples=4)
    views = render_objects(
        scene, [CAMERA] * 12, size=SIZE, transforms=poses, delta=None, quality=samples,
        ids={1: 30, 2: 10, 3: 30}, depth_scale=0.5,
    )  # fmt: skip
    for view, places in zip(views, poses, strict=True):
        for node, place in zip(scene.nodes, places, strict=True):
            node.world_from_model = place
        frame = rj.render(
            scene, CAMERA, size=SIZE, quality=samples, outputs=("color", "depth", "object_id")
        )
        assert [one.id for one in view.objects] == [30, 10, 30]
        assert np.array_equal(view.color, frame.color[..., :3])
        is_seen = np.isfinite(frame.depth)
        assert np.array_equal(np.isfinite(view.depth), is_seen)
        assert np.abs(view.depth[is_seen] - frame.depth[is_seen]).max() <= 0.2501
        for place, one in enumerate(view.objects, 1):
            assert np.array_equal(one.visible, frame.object_id == place)
            assert one.visible_area == one.visible.sum()
            found = [mask for mask in frame.masks() if mask.id == place]
            assert one.visible_box == (found[0].box if found else (0, 0, 0, 0))
            # The floor hides, and has a depth.
            assert one.measured_area == one.mask.sum()
            assert np.array_equal(one.camera_from_model, places[place])


def test_views_of_moved_cameras_and_objects_close_by_fit_the_whole_canvas(tmp_path):
    # A camera inside of the torus knot's box: its window is the canvas.
    model = make_models(tmp_path / "models")[2]
    scene = rj.Scene()
    scene.add(model.mesh, rj.transforms.translate((10.0, 20.0, 30.0)))
    cameras = [
        rj.PerspectiveCamera(eye=eye, target=(10, 20, 30), up=(0, 0, 1), fov_y=50.0)
        for eye in ((10, 40, 45), (60, 20, 30), (300, 100, 200))
    ]
    for camera, view in zip(
        cameras, render_objects(scene, cameras, size=SIZE, delta=None), strict=True
    ):
        focal = view.intrinsics + [[0, 0, WIDTH], [0, 0, HEIGHT], [0, 0, 0]]
        wide = rj.cameras.from_opencv(
            focal, (3 * WIDTH, 3 * HEIGHT), camera_from_world=view.camera_from_world
        )
        whole = rj.render(scene, wide, size=(3 * WIDTH, 3 * HEIGHT), outputs="object_id")
        covered = whole.object_id == 0
        (one,) = view.objects
        assert one.area == covered.sum() > one.mask.sum() or one.area == one.mask.sum()
        assert np.array_equal(one.mask, covered[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH])
        x, y, width, height = one.box
        assert [x, y, width - 1, height - 1] == box_of(covered, SIZE)
        given = rj.cameras.to_opencv(camera, SIZE)
        assert np.allclose(view.camera(SIZE).view_matrix(), camera.view_matrix(), atol=1e-9)
        assert np.array_equal(view.intrinsics, given.intrinsics)


def same(one, other):
    """Tell whether two values, with arrays in them, are equal in type and value."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


def test_what_is_written_is_read_again(tmp_path):
    scene = make_scene(make_models(tmp_path / "models"))
    poses = make_poses(6)
    views = [*render_objects(scene, [CAMERA] * 6, size=SIZE, transforms=poses)]
    # Some data sets have grey pictures, no poses of cameras, no depth, no masks.
    bare = [one._replace(mask=None, visible=None) for one in views[1].objects]
    views[1] = views[1]._replace(color=None, depth=None, objects=tuple(bare), number=77)
    views[2] = views[2]._replace(color=views[2].color[..., 0], camera_from_world=None, objects=())
    bop.write_scene(tmp_path / "a/b/000003", iter(views))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = bop.read_scene(tmp_path / "a/b/000003")
    assert again.numbers == (0, 2, 3, 4, 5, 77)
    hidden = 0
    for view in views:
        read = again[again.numbers.index(view.number)]
        for k, one in enumerate(view.objects):
            if not one.visible_area:  # BOP has no boxes then.
                hidden += 1
                view = view._replace(objects=(
                    *view.objects[:k], one._replace(box=(0, 0, 0, 0)), *view.objects[k + 1 :]
                ))  # fmt: skip
        assert same(view, read)
    assert hidden
    assert isinstance(again[1:3], list)
    # The second time the bytes are the same, in the place of the first.
    before = {p: p.read_bytes() for p in (tmp_path / "a").rglob("*") if p.is_file()}
    bop.write_scene(tmp_path / "a/b/000003", again[:])
    assert {p: p.read_bytes() for p in before} == before
    # A mask may have one bit a pixel.
    first = again[0]
    for path in (tmp_path / "a").rglob("mask*/000000_*.png"):
        iio.imwrite(path, iio.imread(path) > 0)
    assert same(again[0], first)


def quad(**kwargs):
    corners = [(-1, -2, 0), (3, -2, 0), (3, 1, 0), (-1, 1, 0)]
    return rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], **kwargs)


def test_models_have_colours_textures_diameters_and_symmetries(tmp_path):
    random = np.random.default_rng(3)
    codes = random.integers(0, 256, (4, 3), dtype=np.uint8)
    texture = rj.Texture(random.integers(0, 256, (4, 8, 3), dtype=np.uint8))
    moved = texture.with_uv_set(1).with_transform(offset=(0.5, 0.25), rotation=30.0, scale=(2, 3))
    points = random.normal(size=(300, 3)) * (5.0, 4.0, 4.5)
    models = {
        1: quad(colors=codes),
        4: quad(uv=random.random((4, 2)), material=rj.Material(base_color_texture=texture)),
        2: rj.Mesh(points, random.integers(0, 300, (200, 3))),
        3: quad(material=rj.Material(base_color="#336699")),
        5: quad(uv1=random.random((4, 2)), material=rj.Material(
            base_color=(1.0, 0.5, 0.0), base_color_texture=moved
        )),
    }  # fmt: skip
    turn = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}
    arrays = {"symmetries_discrete": [np.eye(4)], "weight": np.float32(0.5)}
    bop.write_models(tmp_path / "models", models, {1: turn, 2: arrays})
    read = bop.read_models(tmp_path / "models")
    assert list(read) == [1, 2, 3, 4, 5]
    assert read[1].info.items() >= turn.items()
    assert read[2].info["symmetries_discrete"] == [np.eye(4).tolist()]
    assert read[2].info["weight"] == 0.5
    assert np.array_equal(read[1].mesh.vertex_colors, models[1].vertex_colors)
    assert np.array_equal(read[4].mesh.material.base_color_texture.image, texture.image)
    assert np.allclose(read[4].mesh.uv, models[4].uv, atol=1e-7)
    tinted = read[5].mesh.material.base_color_texture.image
    assert np.allclose(tinted, texture.image * np.float32((1.0, 0.5, 0.0, 1.0)), atol=0.005)
    sine, cosine = 0.5, np.sqrt(0.75)
    expected = models[5].uv1 * (2.0, 3.0) @ [(cosine, sine), (-sine, cosine)] + (0.5, 0.25)
    assert np.allclose(read[5].mesh.uv, expected, atol=1e-6)
    expected = rj.Material(base_color="#336699").base_color
    assert np.allclose(read[3].mesh.vertex_colors, expected, atol=1e-6)
    for number, model in read.items():
        vertices = models[number].vertices
        apart = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1)
        assert model.info["diameter"] == pytest.approx(apart.max(), rel=1e-12)
        assert np.allclose(model.mesh.normals, models[number].vertex_normals(), atol=1e-6)
        low, high = model.mesh.bounds()
        assert np.allclose([model.info[f"min_{a}"] for a in "xyz"], low, atol=1e-6)
        assert np.allclose([model.info[f"size_{a}"] for a in "xyz"], high - low, atol=1e-6)


def test_what_a_model_has_no_place_for_is_named(tmp_path):
    mesh = quad(colors=np.uint8([(255, 0, 0), (0, 0, 255)]), attributes={"heat": np.ones((4, 1))})
    with pytest.warns(rj.SaveWarning, match=r"models\[5\].* colours of faces, attributes"):
        bop.write_models(tmp_path / "models", {5: mesh})
    texture = rj.Texture(np.full((2, 2, 3), 200, np.uint8), wrap="clamp")
    mesh = quad(
        colors=np.zeros((4, 3)),
        uv=np.ones((4, 2)),
        material=rj.Material(base_color_texture=texture),
    )
    with pytest.warns(rj.SaveWarning, match="colours of vertices, how the texture is repeated$"):
        bop.write_models(tmp_path / "models", {5: mesh})


def test_what_a_scene_has_besides_is_named(tmp_path):
    folder = make_small_scene(tmp_path)
    camera = json.loads((folder / "scene_camera.json").read_text())
    camera["0"]["view_level"] = 2
    (folder / "scene_camera.json").write_text(json.dumps(camera))
    (folder / "scene_gt_coco.json").write_text("{}")
    info = (folder / "scene_gt_info.json").read_text()
    (folder / "scene_gt_info.json").write_text(info.replace("{", '{"7": [],', 1))
    said = "left out 7 of scene_gt_info.json, scene_gt_coco.json, view_level"
    with pytest.warns(rj.LoadWarning, match=said):
        bop.read_scene(folder)


def make_small_scene(folder):
    scene = rj.Scene()
    scene.add(quad(), rj.transforms.translate((0, 0, 20)))
    bop.write_scene(folder / "000000", render_objects(scene, [CAMERA], size=SIZE))
    return folder / "000000"


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("scene_camera.json", lambda rows: rows["0"].pop("cam_K"), "9 finite numbers as cam_K"),
        ("scene_gt.json", lambda rows: rows["0"][0].update(obj_id="cup"), "finite numbers as obj"),
        ("scene_gt.json", lambda rows: rows.update({"0": 3}), "view 0 must have JSON objects"),
        ("scene_gt_info.json", lambda rows: rows["0"].pop(), "must have the 1 objects of"),
        ("scene_camera.json", lambda rows: rows.update({"a": {}}), "numbers for keys"),
        ("scene_camera.json", lambda rows: rows.update({"-1": {}}), "whole numbers for keys"),
        ("scene_camera.json", lambda rows: rows.update({"00": {}}), "different whole numbers"),
        ("scene_camera.json", lambda rows: rows["0"].update(depth_scale=-1), "depth_scale must be"),
        ("scene_camera.json", lambda rows: rows["0"].pop("cam_R_w2c"), "9 finite .* cam_R_w2c"),
        ("scene_camera.json", lambda rows: rows["0"].update(cam_R_w2c=[0] * 9), "hold a rotation"),
        ("scene_gt.json", lambda rows: rows["0"][0].update(cam_R_m2c=[0] * 9), "hold a rotation"),
        ("scene_gt.json", lambda rows: rows["0"][0].update(obj_id=1.5), "whole numbers .* got 1.5"),
        ("scene_gt.json", lambda rows: rows["0"][0].update(obj_id="2"), "1 finite .* got '2'"),
        (
            "scene_gt_info.json", lambda rows: rows["0"][0].update(bbox_obj=[1e300] * 4),
            "whole numbers in .* as bbox_obj",
        ),
        ("scene_gt_info.json", lambda rows: rows["0"][0].update(px_count_all=-5), "in 0.* got -5"),
        (
            "scene_gt_info.json", lambda rows: rows["0"][0].update(bbox_obj=[0, 0, -2, 3]),
            "sides of at least 0",
        ),
    ],
)  # fmt: skip
def test_damaged_files_are_named(tmp_path, file, change, said):
    folder = make_small_scene(tmp_path)
    rows = json.loads((folder / file).read_text())
    change(rows)
    (folder / file).write_text(json.dumps(rows))
    with pytest.raises(ValueError, match=said) as found:
        bop.read_scene(folder)[0]
    assert str(folder / file) in str(found.value)


def test_missing_and_unreadable_files_are_named(tmp_path):
    folder = make_small_scene(tmp_path)
    (folder / "mask/000000_000000.png").write_bytes(b"none")
    with pytest.raises(ValueError, match=r"000000_000000.png: it cannot be read"):
        bop.read_scene(folder)[0]
    for mask, said in (
        (np.zeros((8, 9), np.uint8), "must have one size, got 9 x 8 and 80 x 60"),
        (np.zeros((HEIGHT, WIDTH, 3), np.uint8), "000000_000000.png: it must be grey, got 3"),
    ):
        iio.imwrite(folder / "mask/000000_000000.png", mask)
        with pytest.raises(ValueError, match=said):
            bop.read_scene(folder)[0]
    (folder / "scene_gt.json").write_text('{"0": [], "0": []}')
    with pytest.raises(ValueError, match=r"scene_gt.json: it must be .* different whole numbers"):
        bop.read_scene(folder)
    (folder / "scene_gt.json").unlink()
    with pytest.raises(ValueError, match=r"scene_gt.json: it cannot be read"):
        bop.read_scene(folder)
    (tmp_path / "models_info.json").write_text('{"1": 3}')
    with pytest.raises(ValueError, match=r"models_info.json: model 1 must have a JSON object"):
        bop.read_models(tmp_path)
    with pytest.raises(ValueError, match="folder must be a folder"):
        bop.read_models(tmp_path / "none")


def test_nothing_is_written_of_what_is_wrong(tmp_path):
    scene = rj.Scene()
    node = scene.add(quad(), rj.transforms.translate((0, 0, 20)))
    (view,) = render_objects(scene, [CAMERA], size=SIZE)
    node.transform = rj.transforms.translate((0, 0, 20)) @ rj.transforms.scale(2.0)
    (scaled,) = render_objects(scene, [CAMERA], size=SIZE)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/note.txt").write_text("keep")
    far = view._replace(depth=np.full((HEIGHT, WIDTH), 1e5, np.float32))
    for folder, views, said in (
        ("new", [view, view], "different numbers, got 0 twice"), ("new", [], "at least one view"),
        ("new", [view._replace(number=-1)], "views: the number must"),
        ("new", [view, 3], "must be LabelledView"), ("new", [far], "at most 65535 times"),
        ("new", [scaled], r"views: view 0, object 0: cam_R_m2c must hold a rotation"),
        ("new", [view._replace(depth_scale=0.0)], "views: view 0: depth_scale must be above 0"),
        ("new", [view._replace(intrinsics=K * np.nan)], "views: view 0 must have 9 finite numbers"),
        ("mine", [view], "holds other things"), ("mine/note.txt", [view], "is a file"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            bop.write_scene(tmp_path / folder, views)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["mine"]
    for models, info, said in (
        ({}, None, "at least one"), ({-1: quad()}, None, "ids of at least 0"),
        ({1: scene}, None, "meshes by ids"), ({1: quad()}, {2: {}}, "info must be about models"),
        ({1: quad()}, [1], "info must be mappings"), ({1: quad()}, {1: 3}, r"info\[1\] must .* 3"),
        ({1: quad()}, {1: {"a": np.nan}}, r"info\[1\] must be a mapping"),
        ({1: quad()}, {1: {"a": {2}}}, r"info\[1\] must .* arrays: set is neither"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            bop.write_models(tmp_path / "new", models, info)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"ids": [1, 2]}, "ids must have a number or None for each of the 1 objects"),
        ({"ids": {3: 1}}, "ids must map places of objects, 0 to 0"),
        ({"ids": ["cup"]}, "whole numbers or None, got 0: 'cup'"),
        ({"delta": -1.0}, "delta must be at least 0"), ({"depth_scale": 0.0}, "depth_scale must"),
        ({"size": (6000, 60)}, "size must have sides of at most 5461"),
        ({"transforms": np.eye(4)}, "transforms must have shape"),
        ({"cameras": [rj.OrthographicCamera((0, 0, 9), (0, 0, 0))]}, r"cameras\[0\].* perspective"),
    ],
)  # fmt: skip
def test_arguments_are_checked_at_once(options, said):
    scene = rj.Scene()
    scene.add(quad())
    with pytest.raises(ValueError, match=said):
        render_objects(**{"what": scene, "cameras": [CAMERA], "size": SIZE} | options)


def test_warnings_name_the_camera_among_all(monkeypatch):
    monkeypatch.setattr(object_views, "MAX_PIXELS", 2 * WIDTH * HEIGHT)
    scene = rj.Scene()
    scene.add(quad(), rj.transforms.translate((0, 0, 20)))
    away = rj.cameras.from_opencv(K, SIZE, translation=(0, 0, -40))
    cameras = [CAMERA, CAMERA, CAMERA, away, away]

    # Meanwhile another thread warns.
    def draw(*arguments, **options):
        thread = threading.Thread(target=warnings.warn, args=("beside",))
        thread.start()
        thread.join()
        beside.append("beside")
        return rj.render_batch(*arguments, **options)

    beside = []
    monkeypatch.setattr(object_views, "render_batch", draw)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        views = [*render_objects(scene, cameras, size=SIZE)]
    own = [one for one in caught if one.category is rj.ViewWarning]
    assert [str(one.message).partition("(")[2] for one in own] == ["cameras[3])"]
    assert own[0].filename == __file__
    assert [str(one.message) for one in caught if one not in own] == beside
    assert [view.objects[0].area > 0 for view in views] == [True, True, True, False, False]


def test_points_have_no_silhouette():
    scene = rj.Scene()
    scene.add(rj.Points([(0, 0, 9)]))
    with pytest.raises(ValueError, match="ids must name meshes of tri"):
        render_objects(scene, [CAMERA], size=SIZE)
    assert [view.objects for view in render_objects(scene, [CAMERA], size=SIZE, ids=[None])] == [()]
