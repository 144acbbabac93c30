"""Data sets: what is in them, what is left out, and that they are whole."""

import errno
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from made_meshes import BROKEN, GOOD, codes_of, contents, make_meshes
from own_threads import own_threads
from PIL import Image
from ways import in_groups

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.dataset import dataset_builder
from rasterjit.dataset import recipe as recipes
from rasterjit.dataset.recipe import Recipe, view_cameras
from rasterjit.io import meshes as mesh_loading
from rasterjit.io.meshes import mesh_files
from rasterjit.outputs import masks
from rasterjit.rendering import batch, batch_scheduler, renderer_pool
from rasterjit.rendering.view_warnings import ViewWarning
from rasterjit.scene.warning import warn_caller

MODELS = Path(__file__).parents[2] / "models"
W, H = SIZE = (24, 16)
RECIPE = Recipe(
    views=3, size=SIZE, outputs=("color", "depth", "normal", "mask", "coco", "position")
)


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    return make_meshes(tmp_path_factory.mktemp("meshes"))


@pytest.fixture(scope="module")
def made(meshes, tmp_path_factory):
    """The data set, made without interruption."""
    place = tmp_path_factory.mktemp("made") / "set"
    reports = []
    summary = dataset_builder.make(meshes, place, RECIPE, report=lambda *what: reports.append(what))
    return place, summary, reports


def transforms_of(place, name):
    return json.loads((place / name / "transforms.json").read_text())


def test_mesh_files_are_found_in_order(meshes):
    found = [file.relative_to(meshes).as_posix() for file in mesh_files(meshes)]
    assert found == sorted((*GOOD, *BROKEN))


def test_files_that_are_mostly_no_meshes_are_not_looked_for_in_folders(tmp_path):
    for name in ("package.xml", "values.dat", "a.node", "a.ele", "a.stl"):
        (tmp_path / name).touch()
    suffixes = {file.suffix for file in mesh_files(tmp_path)}
    assert suffixes in ({".stl"}, {".stl", ".ele"})


def test_every_mesh_is_done_or_listed_with_the_reason(made, meshes):
    place, summary, reports = made
    assert (summary.made, summary.present) == (len(GOOD), 0)
    assert list(summary.failures) == sorted(BROKEN)
    listed = json.loads((place / "failures.json").read_text())
    assert {one["file"]: one["reason"] for one in listed} == summary.failures
    assert all(one["reason"] and str(meshes) not in one["reason"] for one in listed)
    assert "is empty" in summary.failures["empty.obj"]
    assert "ends too early" in summary.failures["cut.glb"]
    assert "no faces" in summary.failures["parts/text.stl"]
    assert [(done, total) for _, done, total in reports] == [(n, 8) for n in range(1, 9)]
    assert {outcome.name for outcome, _, _ in reports if outcome.failure} == set(BROKEN)


def test_a_folder_holds_what_was_asked_for_and_nothing_else(made):
    place, _, _ = made
    expected = {"dataset.json", "failures.json"}
    for name in GOOD:
        expected |= {f"{name}/transforms.json", f"{name}/coco.json"}
        for number in range(3):
            expected |= {f"{name}/{kind}/000{number}.png" for kind in ("images", "depth")}
            expected |= {f"{name}/{kind}/000{number}.png" for kind in ("normal", "mask")}
            expected.add(f"{name}/position/000{number}.npz")
    assert set(contents(place)) == expected


@pytest.mark.parametrize("name", GOOD)
def test_a_frame_says_where_its_files_are(made, name):
    place, _, _ = made
    frames = transforms_of(place, name)["frames"]
    assert len(frames) == 3
    for number, frame in enumerate(frames):
        assert frame["file_path"] == f"images/000{number}.png"
        assert frame["depth_path"] == frame["depth_file_path"]
        for key, path in frame.items():
            assert key == "transform_matrix" or (place / name / path).is_file()


@pytest.mark.parametrize("name", GOOD)
def test_the_cameras_and_the_depth_give_back_the_surface(made, meshes, name):
    """As a reader of NeRF's convention would do it, from the files alone."""
    place, _, _ = made
    document = transforms_of(place, name)
    scene = rj.load(meshes / name)
    triangles = trimesh.util.concatenate(
        [
            trimesh.Trimesh(rj.transforms.apply(n.world_from_model, n.mesh.vertices), n.mesh.faces)
            for n in scene.nodes
        ]
    )
    _, radius = scene.bounding_sphere()
    columns, rows = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
    for frame in document["frames"]:
        codes = np.array(Image.open(place / name / frame["depth_path"])).astype(float)
        depth = codes * document["integer_depth_scale"]
        seen = codes > 0
        assert np.array_equal(seen, np.array(Image.open(place / name / frame["mask_path"])) == 255)
        assert seen.any()
        view = np.stack(
            [
                (columns - document["cx"]) / document["fl_x"] * depth,
                -(rows - document["cy"]) / document["fl_y"] * depth,
                -depth,
                np.ones_like(depth),
            ],
            axis=-1,
        )[seen]
        world = view @ np.array(frame["transform_matrix"]).T
        distance = _distances(triangles, world[:, :3])
        # A code is 7e-5 of the radius; vertices snap to 1/256 of a pixel, which is 3e-4.
        assert distance.max() < 1e-3 * radius


def _distances(mesh, points):
    """How far points are from a mesh: from the nearest of all its triangles."""
    found = np.full(len(points), np.inf)
    for triangle in mesh.triangles:
        nearest = trimesh.triangles.closest_point(np.repeat(triangle[None], len(points), 0), points)
        found = np.minimum(found, np.linalg.norm(nearest - points, axis=1))
    return found


def test_the_angle_fits_the_focal_length(made):
    document = transforms_of(made[0], "box.stl")
    assert (document["w"], document["h"]) == SIZE
    assert document["camera_angle_y"] == pytest.approx(np.radians(45.0))
    assert np.tan(document["camera_angle_x"] / 2) == pytest.approx(W / 2 / document["fl_x"])
    assert document["fl_x"] == document["fl_y"]


def test_the_scale_takes_a_mesh_of_any_unit_into_the_unit_cube(made, meshes):
    for name in GOOD:
        document = transforms_of(made[0], name)
        low, high = rj.load(meshes / name).bounds()
        corners = document["scale"] * np.array([low, high]) + document["offset"]
        assert corners.min() >= -1e-9
        assert corners.max() <= 1 + 1e-9


def test_pictures_are_what_render_gives(made, meshes):
    place, _, _ = made
    scene = rj.load(meshes / "box.stl")
    camera = view_cameras(scene, RECIPE, "box.stl")[1]
    frame = rj.render(
        scene, camera, size=SIZE, outputs=("color", "normal"), background="transparent"
    )
    assert np.array_equal(np.array(Image.open(place / "box.stl/images/0001.png")), frame.color)
    codes = codes_of(place / "box.stl/normal/0001.png").astype(float)
    seen = codes.any(axis=2)
    assert np.array_equal(seen, frame.normal.any(axis=2))
    assert np.abs((codes[seen] - 32768) / 32767 - frame.normal[seen]).max() < 1e-4


def test_characters_are_posed_in_all_views(tmp_path):
    scene = rj.load(MODELS / "face.glb")
    next(node for node in scene.nodes if node.name == "face").weights = [0.0, 1.0]
    recipe = Recipe(views=4, size=(96, 96), outputs=("color", "object_position"))
    recipes.render_views(scene, tmp_path, recipe, threads=2)
    for number, camera in enumerate(view_cameras(scene, recipe)):
        frame = rj.render(
            scene, camera, size=recipe.size, outputs=recipe.outputs, background="transparent"
        )
        picture = Image.open(tmp_path / f"images/{number:04d}.png")
        assert np.array_equal(np.array(picture), frame.color)
        with np.load(tmp_path / f"object_position/{number:04d}.npz") as stored:
            places = stored["object_position"]
        assert np.array_equal(places, frame.object_position, equal_nan=True)


def test_annotations_cover_the_masks(made):
    place, _, _ = made
    annotation = json.loads((place / "box.stl/coco.json").read_text())
    assert [image["file_name"] for image in annotation["images"]] == [
        f"images/000{number}.png" for number in range(3)
    ]
    for number, one in enumerate(annotation["annotations"]):
        mask = np.array(Image.open(place / f"box.stl/mask/000{number}.png")) == 255
        assert one["area"] == mask.sum()


def two_boxes(names):
    """Return a scene of two boxes beside each other."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    scene, drawn = rj.Scene(), rj.Mesh(box.vertices, box.faces)
    for place, name in zip((-2.0, 2.0), names, strict=True):
        scene.add(drawn, rj.transforms.translate((place, 0.0, 0.0)), name)
    return scene


def test_objects_without_a_name_are_called_by_their_number(tmp_path):
    """As glTF allows; the annotation of a mesh is no reason to end the data set."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((1.0, 1.0, 1.0)), node_name="box")
    scene.export(folder / "a.gltf", merge_buffers=True)
    document = json.loads((folder / "a.gltf").read_text())
    for node in document["nodes"]:
        node["name"] = ""
    (folder / "a.gltf").write_text(json.dumps(document))
    assert rj.load(folder / "a.gltf").nodes[0].name == ""
    recipe = Recipe(views=1, size=(8, 6), outputs=("color", "coco"))
    assert dataset_builder.make(folder, tmp_path / "set", recipe).failures == {}
    annotation = json.loads((tmp_path / "set/a.gltf/coco.json").read_text())
    assert [one["name"] for one in annotation["categories"]] == ["object 0"]


def test_an_annotation_that_fails_is_the_failure_of_its_mesh(meshes, tmp_path, monkeypatch):
    real = masks.coco

    def coco(images, categories):
        if np.count_nonzero(images[0][1] >= 0) < 40:
            raise MemoryError
        return real(images, categories)

    monkeypatch.setattr(masks, "coco", coco)
    summary = dataset_builder.make(meshes, tmp_path / "set", RECIPE)
    assert summary.made > 0
    assert "not enough memory" in summary.failures.values()


def test_the_annotation_of_all_views_is_that_of_their_images(tmp_path):
    scene = two_boxes(("left", ""))
    recipe = Recipe(views=5, size=SIZE, outputs=("color", "coco"))
    recipes.render_views(scene, tmp_path, recipe)
    images = [
        (
            f"images/{number:04d}.png",
            rj.render(scene, camera, size=SIZE, outputs=("object_id",)).object_id,
        )
        for number, camera in enumerate(view_cameras(scene, recipe))
    ]
    expected = masks.coco(images, ["left", "object 1"])
    assert json.loads((tmp_path / "coco.json").read_text()) == expected
    assert len({one["id"] for one in expected["annotations"]}) == len(expected["annotations"]) > 5


def test_each_view_is_annotated_before_the_next_is_rendered(tmp_path, monkeypatch):
    """So none is kept: the memory that a data set takes does not grow with its views."""
    steps = []
    render, coco = rj.Renderer._plan_and_draw, masks.coco
    monkeypatch.setattr(
        rj.Renderer, "_plan_and_draw", lambda *a, **k: steps.append("render") or render(*a, **k)
    )
    monkeypatch.setattr(masks, "coco", lambda *a: steps.append("annotate") or coco(*a))
    monkeypatch.setattr(batch, "MAX_WORK", 0)
    recipe = Recipe(views=4, size=SIZE, outputs=("color", "coco"))
    recipes.render_views(two_boxes("ab"), tmp_path, recipe)
    assert steps == ["render", "annotate"] * 4


@pytest.fixture
def goes(monkeypatch):
    """Return how many views were drawn in each go, and None for each that was annotated."""
    steps, draw, coco = [], batch_scheduler.GroupRenderer.draw, masks.coco

    def noted(self, numbers, *arguments):
        steps.append(len(numbers))
        return draw(self, numbers, *arguments)

    monkeypatch.setattr(batch_scheduler.GroupRenderer, "draw", noted)
    monkeypatch.setattr(masks, "coco", lambda *a: steps.append(None) or coco(*a))
    return steps


@in_groups
def test_small_views_are_drawn_a_few_in_one_go_and_then_annotated(tmp_path, monkeypatch, goes):
    """So few are kept: the memory that a data set takes does not grow with its views."""
    monkeypatch.setattr(renderer_pool, "MAX_GROUP_BYTES", 3 * 8 * W * H)
    recipe = Recipe(views=9, size=SIZE, outputs=("color", "coco"))
    recipes.render_views(two_boxes("ab"), tmp_path, recipe, threads=1)
    # The first is drawn alone.
    assert goes == [None, 3, *[None] * 3, 3, *[None] * 3, 2, *[None] * 2]


@in_groups
@pytest.mark.parametrize(
    ("size", "views", "outputs", "threads", "expected"),
    [
        (SIZE, 1, ("color",), 2, []),
        (SIZE, 2, ("color",), 1, []),
        (SIZE, 3, ("color",), 1, [2]),
        (SIZE, 40, ("color", "depth", "normal", "mask", "coco"), 1, [7, 32]),
        (SIZE, 40, ("position", "face_id", "barycentric"), 2, [19, 20]),
        ((97, 50), 12, ("color", "linear", "distance"), 3, [3, 4, 4]),
        ((300, 301), 12, ("depth", "object_position"), 2, [5, 5]),
        ((512, 512), 3, ("depth",), 1, []),
        # Not drawn in groups.
        (SIZE, 9, ("color", "coverage", "nocs"), 2, []),
    ],
)
def test_files_are_the_same_whether_views_are_drawn_alone(
    tmp_path, monkeypatch, goes, size, views, outputs, threads, expected
):
    recipe = Recipe(views=views, size=size, outputs=outputs)
    for name in ("one", "few"):
        (tmp_path / name).mkdir()
    recipes.render_views(two_boxes("ab"), tmp_path / "few", recipe, threads=threads)
    assert sorted(one for one in goes if one is not None) == expected
    goes.clear()
    monkeypatch.setattr(batch, "MAX_WORK", 0)
    recipes.render_views(two_boxes("ab"), tmp_path / "one", recipe, threads=threads)
    assert not any(goes)
    files = contents(tmp_path / "few")
    assert files == contents(tmp_path / "one")
    assert len(files) >= views + 1


@in_groups
@pytest.mark.parametrize("threads", [1, 2])
def test_a_view_that_fails_ends_its_mesh_after_those_before_it(
    tmp_path, monkeypatch, threads, goes
):
    """What is wrong with one view of a group is told as it is of one that is drawn alone."""
    scene, recipe = two_boxes("ab"), Recipe(views=9, size=SIZE, outputs=("color",))
    wrong = view_cameras(scene, recipe)[5]
    render = rj.Renderer._plan_and_draw

    def refuse(self, request, scene, camera):
        if camera == wrong:
            raise ValueError("camera is\nrefused")
        return render(self, request, scene, camera)

    monkeypatch.setattr(rj.Renderer, "_plan_and_draw", refuse)

    def fail(self, prepared, chosen):
        assert len(chosen) > 1
        raise ValueError("a group is refused")

    monkeypatch.setattr(batch_scheduler.CommandBuffer, "draw", fail)
    with pytest.raises(recipes.MeshError, match=r"^camera is refused$"):
        recipes.render_views(scene, tmp_path, recipe, threads=threads)
    assert any(goes)
    assert set(contents(tmp_path)) == {f"images/000{number}.png" for number in range(5)}


@in_groups
def test_work_is_called_off_between_views_of_a_group(tmp_path):
    left = iter(range(7))

    def check():
        if next(left, None) is None:
            raise recipes.Cancelled

    recipe = Recipe(views=30, size=SIZE, outputs=("color",))
    with pytest.raises(recipes.Cancelled):
        recipes.render_views(two_boxes("ab"), tmp_path, recipe, check=check)
    assert set(contents(tmp_path)) == {f"images/000{number}.png" for number in range(7)}
    assert not own_threads("rasterjit-turns")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": "a.obj"}, "scene must be a Scene, got 'a.obj'"),
        ({"folder": "nowhere"}, "folder must be a folder, but 'nowhere' does not exist"),
        ({"folder": None}, "folder must be the name of a folder, got None"),
        ({"recipe": {"views": 3}}, "recipe must be a Recipe, got dict"),
        ({"name": 7}, "name must be a string, got 7"),
        ({"threads": 0}, "threads must be in"),
        ({"check": 3}, "check must be a function, got 3"),
    ],
)
def test_wrong_arguments_of_views_are_named(tmp_path, change, message):
    arguments = {"scene": two_boxes("ab"), "folder": tmp_path, "recipe": RECIPE} | change
    with pytest.raises(ValueError, match=message):
        recipes.render_views(**arguments)
    assert not (tmp_path / "transforms.json").exists()


def test_a_scene_that_no_camera_fits_is_a_mesh_error(tmp_path):
    with pytest.raises(recipes.MeshError):
        recipes.render_views(rj.Scene(), tmp_path, RECIPE)


def test_one_more_run_changes_nothing(made, meshes, monkeypatch):
    place, summary, _ = made
    before = contents(place)
    rendered = []
    real = recipes.render_views
    monkeypatch.setattr(
        recipes, "render_views", lambda *a, **k: rendered.append(a) or real(*a, **k)
    )
    again = dataset_builder.make(meshes, place, RECIPE)
    assert again == dataset_builder.Summary(0, len(GOOD), summary.failures)
    assert rendered == []
    assert contents(place) == before


@pytest.mark.needs_jit
@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left")])
@pytest.mark.parametrize("after", [1, 7, 20])
def test_what_was_interrupted_is_gone_on_with(made, meshes, tmp_path, monkeypatch, error, after):
    """Between any two files: what is there is whole, and in the end it is all there."""
    saved = []
    real = rj.Frame.save

    def save(self, path, *arguments, **options):
        if len(saved) == after:
            raise error
        saved.append(path)
        real(self, path, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(rj.Frame, "save", save)
        with pytest.raises(type(error) if isinstance(error, OSError) else error):
            dataset_builder.make(meshes, tmp_path / "set", RECIPE)
    whole = contents(made[0])
    assert contents(tmp_path / "set").items() <= whole.items()
    assert not list((tmp_path / "set").glob(".*"))
    dataset_builder.make(meshes, tmp_path / "set", RECIPE)
    assert contents(tmp_path / "set") == whole


def test_a_full_disk_is_told_with_the_mesh_that_did_not_fit(meshes, tmp_path, monkeypatch):
    def save(self, path, *arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(rj.Frame, "save", save)
    with pytest.raises(OSError, match="No space left on device") as caught:
        dataset_builder.make(meshes, tmp_path / "set", RECIPE)
    assert caught.value.filename == str(tmp_path / "set/ball.ply/images/0000.png")


def test_leftovers_of_a_killed_run_are_cleared_away(made, meshes, tmp_path):
    place = tmp_path / "set"
    shutil.copytree(made[0], place)
    (place / "box.stl/transforms.json").unlink()
    (place / "box.stl/images/9999.png").write_bytes(b"half")
    (place / ".partial-0123").mkdir()
    (place / ".partial-0123/x.png").write_bytes(b"half")
    summary = dataset_builder.make(meshes, place, RECIPE)
    assert summary.made == 1
    assert contents(place) == contents(made[0])


def test_a_mesh_that_fails_to_render_is_listed_and_leaves_nothing(meshes, tmp_path, monkeypatch):
    real = rj.Renderer._plan_and_draw

    def render(self, request, scene, camera):
        if len(scene.nodes[0].mesh.faces) == 1:
            raise MemoryError
        return real(self, request, scene, camera)

    monkeypatch.setattr(rj.Renderer, "_plan_and_draw", render)
    summary = dataset_builder.make(meshes, tmp_path / "set", RECIPE)
    assert summary.failures["tri angle.obj"] == "not enough memory"
    assert not (tmp_path / "set/tri angle.obj").exists()


def test_failures_that_are_mended_are_no_longer_listed(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    (folder / "a.obj").write_text("")
    (folder / "b.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    recipe = Recipe(views=1, size=(8, 6), outputs=("mask",))
    assert list(dataset_builder.make(folder, tmp_path / "set", recipe).failures) == ["a.obj"]
    shutil.copy(folder / "b.obj", folder / "a.obj")
    assert dataset_builder.make(folder, tmp_path / "set", recipe) == dataset_builder.Summary(
        1, 1, {}
    )
    assert not (tmp_path / "set/failures.json").exists()


@pytest.fixture
def damaged(tmp_path):
    """A folder of a mesh that is damaged, and of one that is sound."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (folder / "a.obj").write_text(f"{text}f 1 2\n")
    (folder / "b.obj").write_text(text)
    return folder


def test_damage_leaves_out_a_mesh_or_is_passed_over(damaged, tmp_path):
    recipe = Recipe(views=1, size=(8, 6), outputs=("mask",))
    summary = dataset_builder.make(damaged, tmp_path / "set", recipe)
    assert list(summary.failures) == ["a.obj"]
    assert "line 5" in summary.failures["a.obj"]
    recipe = Recipe(views=1, size=(8, 6), outputs=("mask",), on_damage="warn")
    summary = dataset_builder.make(damaged, tmp_path / "other", recipe)
    assert (summary.made, summary.failures, list(summary.warnings)) == (2, {}, ["a.obj"])
    assert summary.warnings["a.obj"][0].startswith("a.obj: left out what is damaged, first line 5")
    assert np.asarray(Image.open(tmp_path / "other/a.obj/mask/0000.png")).any()
    with pytest.raises(ValueError, match="made otherwise: on_damage 'error', not 'warn'"):
        dataset_builder.make(damaged, tmp_path / "set", recipe)


def test_a_mesh_of_too_many_bytes_is_left_out_and_made_with_more(damaged, tmp_path):
    (damaged / "a.obj").unlink()
    few, more = (
        Recipe(views=1, size=(8, 6), outputs=("mask",), max_bytes=most) for most in (1000, 1 << 20)
    )
    summary = dataset_builder.make(damaged, tmp_path / "set", few)
    assert "are left of max_bytes = 1,000" in summary.failures["b.obj"]
    assert dataset_builder.make(damaged, tmp_path / "set", more) == dataset_builder.Summary(
        1, 0, {}
    )


def test_the_command_line_takes_damage_and_a_budget(damaged, tmp_path):
    command = ["dataset", str(damaged), "--views", "1", "--size", "8", "--outputs", "mask"]

    def made(name, *options):
        run = CliRunner().invoke(commands.program, [*command, "-o", str(tmp_path / name), *options])
        return run.exit_code, run.output

    status, said = made("set")
    assert (status, said.count("line 5")) == (1, 1)
    assert said.endswith("error: 1 of 2 mesh files could not be drawn: see failures.json\n")
    status, said = made("other", "--on-damage", "warn")
    assert (status, "2 meshes" in said) == (0, True)
    assert said.count("warning: a.obj: left out what is damaged, first line 5") == 1
    status, said = made("third", "--max-bytes", "1000")
    assert (status, "--max-bytes 1,000" in said) == (1, True)
    status, said = made("fourth", "--max-bytes", "0")
    assert (status, "--max-bytes must be" in said) == (1, True)


def test_what_a_view_warns_of_names_it_once(tmp_path, monkeypatch):
    def draw(*arguments):
        for _ in range(2):
            warn_caller("nothing is in view", ViewWarning)
            yield from draw_in_turns(*arguments)

    draw_in_turns = recipes.draw_in_turns
    monkeypatch.setattr(recipes, "draw_in_turns", draw)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    asked = Recipe(views=2, size=(8, 6), outputs=("mask",))
    summary = dataset_builder.make(tmp_path / "meshes", tmp_path / "set", asked)
    assert summary.warnings == {"a.obj": ("view 0: nothing is in view",)}


def test_another_recipe_is_refused_and_named(made, meshes):
    before = contents(made[0])
    with pytest.raises(ValueError, match="made otherwise: views 3, not 4"):
        dataset_builder.make(meshes, made[0], Recipe(views=4, size=SIZE, outputs=RECIPE.outputs))
    assert contents(made[0]) == before


@pytest.mark.parametrize(
    ("folder", "output", "options", "message"),
    [
        ("nowhere", "set", {}, "folder must be a folder"),
        (7, "set", {}, "folder must be the name of a folder"),
        ("meshes", "meshes", {}, "output must not hold the meshes"),
        ("meshes", ".", {}, "output must not hold the meshes"),
        ("meshes", "full", {}, "output must be empty or a data set"),
        ("meshes", "full/file", {}, "is a file"),
        ("meshes", None, {}, "output must be a folder"),
        ("full", "set", {}, "must hold mesh files"),
        ("meshes", "set", {"workers": 0}, "workers must be a whole number in 1..256"),
        ("meshes", "set", {"workers": 1.5}, "workers must be a whole number in"),
        ("meshes", "set", {"workers": "host"}, "workers must be a number, or an address"),
        ("meshes", "set", {"recipe": {"views": 3}}, "recipe must be a Recipe"),
        ("meshes", "set", {"report": 3}, "report must be a function, got 3"),
    ],
)
def test_what_cannot_be_made_is_refused(tmp_path, monkeypatch, folder, output, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").write_text("mine")
    with pytest.raises(ValueError, match=message):
        dataset_builder.make(folder, output, **options)
    assert (tmp_path / "full/file").read_text() == "mine"
    assert not (tmp_path / "meshes/dataset.json").exists()
    assert not (tmp_path / "set").exists()


def test_a_data_set_inside_the_folder_of_meshes_is_not_taken_for_one(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "set").mkdir()
    recipe = Recipe(views=1, size=(8, 6), outputs=("mask",))
    assert dataset_builder.make(tmp_path, tmp_path / "set", recipe).made == 1
    shutil.copy(tmp_path / "a.obj", tmp_path / "set/b.obj")
    assert dataset_builder.make(tmp_path, tmp_path / "set", recipe) == dataset_builder.Summary(
        0, 1, {}
    )


def test_trimesh_is_asked_only_about_names_that_are_not_known(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(mesh_loading, "_trimesh_formats", lambda: asked.append(1) or {"vtk"})
    for suffix in (".dae", ".3mf", ".OBJ", ".stl", ".glb", ".json", ".zip", ".png", ".mtl", ""):
        (tmp_path / f"a{suffix}").touch()
    found = [file.suffix for file in mesh_files(tmp_path)]
    assert found == [".3mf", ".OBJ", ".dae", ".glb", ".stl"]
    assert not asked
    (tmp_path / "b.vtk").touch()
    assert mesh_files(tmp_path)[-1].name == "b.vtk"
    assert asked
