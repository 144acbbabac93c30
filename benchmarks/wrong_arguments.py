"""
Call all that is public with wrong arguments, and count the errors that do not name the argument.

``python -m benchmarks.wrong_arguments`` prints the counts and every error that names none;
``--only rasterjit.Fog`` tries one callable. It ends with status 1 if an error names none.

Each parameter of each public function, class and method is given each of `WRONG` in its turn, all
others being sound. What is taken without an error is not judged: some of these values are right for
some parameters.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import itertools
import math
import os
import re
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rasterjit import OutputNotRequestedError

HUGE = 10**400


class Claims:
    """A sequence that says that it is long, and has nothing."""

    def __len__(self) -> int:
        return 10**12

    def __getitem__(self, index: int) -> Any:
        raise IndexError(index)


class Deaf:
    """An object that can neither be compared nor written."""

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("no comparison")

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return "Deaf()"


WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "a word": lambda: "wrong",
    "an empty word": lambda: "",
    "bytes": lambda: b"\xff\0",
    "NaN": lambda: math.nan,
    "infinity": lambda: math.inf,
    "minus infinity": lambda: -math.inf,
    "10**400": lambda: HUGE,
    "-10**400": lambda: -HUGE,
    "-1": lambda: -1,
    "0": lambda: 0,
    "2**63": lambda: 2**63,
    "-2.5": lambda: -2.5,
    "True": lambda: True,
    "a complex number": lambda: 1j,
    "an empty list": lambda: [],
    "an empty dict": lambda: {},
    "a dict": lambda: {"wrong": HUGE},
    "a set": lambda: {1, 2, 3},
    "an object": object,
    "a type": lambda: int,
    "a function": lambda: lambda *_: object(),
    "a generator": lambda: (one for one in (1, 2, 3)),
    "words": lambda: ["a", "b", "c"],
    "a number and a word": lambda: [1, "a"],
    "rows of several lengths": lambda: [[1, 2], [1, 2, 3]],
    "huge numbers": lambda: [HUGE, HUGE, HUGE],
    "rows of huge numbers": lambda: [[0.0, 1.0, HUGE]] * 3,
    "two huge numbers": lambda: (HUGE, 4),
    "None in a list": lambda: [None, None, None],
    "no rows": lambda: np.empty((0, 3)),
    "three axes": lambda: np.zeros((2, 3, 4)),
    "NaN in rows": lambda: np.full((3, 3), math.nan),
    "far away": lambda: np.full((3, 3), 1e308),
    "objects": lambda: np.array([object(), object(), object()]),
    "words in an array": lambda: np.array(["a", "b", "c"]),
    "complex numbers": lambda: np.full((3, 3), 1j),
    "records": lambda: np.zeros(3, [("x", float)]),
    "dates": lambda: np.array(["2026-01-01"] * 3, "datetime64[D]"),
    "masked": lambda: np.ma.masked_all((3, 3)),
    "what says that it is long": Claims,
    "what cannot be compared": Deaf,
}
"""Made anew for each call."""

RESULTS = (
    "Batch", "CalibrationWarning", "Diagnostics", "Frame", "FrameProfile", "FrameStats",
    "LayeredFrame", "LoadWarning", "MeshFileError", "OutputNotRequestedError", "PickedPixel",
    "PixelExplanation", "QualityChoice", "RasterizedFaces", "RenderPlan", "SaveWarning",
    "ViewWarning",
)  # fmt: skip
"""Classes that only RasterJIT makes."""

OPENED = (
    "show", "Frame.show", "Scene.show", "Mesh.show", "Node.show", "Points.show", "Lines.show",
    "LayeredFrame.show", "Arrows.show", "Style.show", "LayeredFrame.masks",
)  # fmt: skip
"""What opens a window or a page, and waits; and what only says that it is not there."""

INNER = (
    "product_of", "product_of_each", "normal_rows", "normal_matrices", "transform_instances",
    "unit_numbers", "rounded_up", "lens_matrix", "perspective_depth",
)  # fmt: skip
"""Steps of `rasterjit.transforms` for what has been checked: they check nothing, for speed."""

ONE_OF = {"animation.save": "picture"}
"""What messages call one of many things that an argument holds."""

MODULES = ("animation", "cameras", "dataset", "distributed", "masks", "styles", "transforms")


class Try(NamedTuple):
    """
    A callable, and sound arguments.

    Parameters
    ----------
    name : str
    call : callable
    sound : dict
        What makes each required argument.
    """

    name: str
    call: Callable[..., Any]
    sound: dict[str, Callable[[], Any]]


def sound_values(folder: Path) -> dict[str, Callable[[], Any]]:
    """Return what makes sound arguments: by parameter, or by ``callable.parameter``."""
    import rasterjit as rj
    from rasterjit import animation, dataset

    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])

    def mesh() -> Any:
        heat = np.arange(4.0)
        return rj.Mesh(
            square, [[0, 1, 2], [0, 2, 3]], uv=square[:, :2], scalars=heat,
            attributes={"heat": heat[:, None]},
        )  # fmt: skip

    def scene() -> Any:
        made = rj.Scene()
        node = made.add(mesh(), name="square")
        made.animations = [
            rj.Animation("walk", [rj.Channel(node, "scale", [0, 1], np.ones((2, 3)))])
        ]
        made.joints.add("hinge", rj.Joint(node, "revolute", (0, 0, 1)))
        return made

    scenes = []

    def kept_scene() -> Any:
        scenes[:] = [scene()]
        return scenes[0]

    def camera() -> Any:
        return rj.PerspectiveCamera((0.5, 0.5, 3.0), (0.5, 0.5, 0.0), near=0.1, far=10.0)

    def file(name: str, content: str) -> Callable[[], Path]:
        def write() -> Path:
            (folder / name).write_text(content)
            return folder / name

        return write

    def picture() -> Path:
        from PIL import Image

        Image.new("RGB", (4, 2)).save(folder / "a.png")
        return folder / "a.png"

    def trimesh_camera() -> Any:
        import trimesh

        return trimesh.scene.Camera(resolution=(8, 6), fov=(40.0, 30.0))

    def tracks() -> Any:
        return animation.CameraTrack([0.0, 1.0], [camera(), camera()])

    values: dict[str, Callable[[], Any]] = {
        "what": scene, "scene": scene, "of": mesh, "mesh": mesh, "camera": camera,
        "cameras": lambda: [camera(), camera()], "size": lambda: (8, 6), "k": lambda: 2,
        "x": lambda: 1, "y": lambda: 1, "position": lambda: (0.0, 0.0, 1.0),
        "positions": lambda: square, "points": lambda: square, "vertices": lambda: square,
        "vectors": lambda: square, "faces": lambda: [[0, 1, 2]], "text": lambda: "text",
        "eye": lambda: (0.0, 0.0, 3.0), "target": lambda: (0.0, 0.0, 0.0),
        "start": lambda: (0.0, 0.0, 0.0), "end": lambda: (1.0, 0.0, 0.0),
        "point": lambda: (0.0, 0.0, 0.0), "normal": lambda: (0.0, 0.0, 1.0),
        "times": lambda: [0.0, 1.0], "time": lambda: 0.5, "color": lambda: (1, 2, 3),
        "path": lambda: folder / "out.png", "low": lambda: 0.0, "high": lambda: 1.0,
        "values": lambda: np.array([0.1, 0.9]), "colors": lambda: "viridis",
        "azimuth": lambda: 10.0, "elevation": lambda: 20.0, "width": lambda: 8,
        "height": lambda: 6, "near": lambda: 0.1, "far": lambda: 10.0, "fov_y": lambda: 40.0,
        "view_height": lambda: 2.0, "name": lambda: "square", "fx": lambda: 8.0,
        "fy": lambda: 8.0, "cx": lambda: 4.0, "cy": lambda: 3.0, "filter": lambda: "nearest",
        "uv_set": lambda: 0, "image": lambda: np.zeros((2, 2, 3), np.uint8),
        "places": lambda: np.zeros((2, 2)), "directions": lambda: square + 1.0,
        "stored": lambda: np.array([[0.5]]), "sky": lambda: np.ones((2, 4, 3), np.float32),
        "a": lambda: (0, 0), "b": lambda: (5, 0), "c": lambda: (0, 5), "center": lambda: (3, 3),
        "radius": lambda: 2, "factor": lambda: 2.0, "clip_positions": lambda: np.ones((3, 4)),
        "pictures": lambda: [np.zeros((2, 2, 3), np.uint8)], "poses": lambda: np.eye(4)[None],
        "scalars": lambda: [0.0, 1.0, 2.0, 3.0], "has_colors": lambda: True,
        "frames": lambda: [np.zeros((2, 2, 3), np.uint8)], "recipe": lambda: dataset.Recipe(
            views=1, size=(8, 6)), "folder": lambda: folder / "meshes",
        "output": lambda: folder / "made", "renderer": lambda: rj.Renderer((8, 6)),
        "transforms": lambda: np.stack([np.eye(4), np.eye(4)]), "tile": lambda: 8,
        "node": lambda: rj.Node(mesh()), "joints": lambda: [rj.Node()],
        "view_from_world": lambda: np.eye(4), "clip_from_view": camera_matrix,
        "channels": lambda: [rj.Channel(rj.Node(), "scale", [0, 1], np.ones((2, 3)))],
        "matrix": lambda: np.eye(4), "axis": lambda: (0.0, 0.0, 1.0), "angle": lambda: 30.0,
        "degrees": lambda: 30.0, "direction": lambda: (0.0, 0.0, -1.0), "plane": lambda: "xz",
        "aspect": lambda: 1.0, "left": lambda: -1.0, "right": lambda: 1.0, "bottom": lambda: -1.0,
        "top": lambda: 1.0, "offset": lambda: (0.0, 0.0, 0.0), "factors": lambda: (1.0, 1.0, 1.0),
        "weights": lambda: np.ones((1, 1)), "seconds": lambda: 1.0,
        "cross_section.plane": lambda: rj.SectionPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        "masks.decompress.text": lambda: "4", "rle": lambda: {"size": [2, 2], "counts": "4"},
        "mask": lambda: np.ones((2, 2), bool),
        "partitions": lambda: [mesh()], "rows": lambda: np.array([0, 1]),
        "pixels": lambda: [[1.0, 1.0]], "depth": lambda: [2.0], "pose": lambda: np.eye(4),
        "intrinsics": lambda: np.diag([8.0, 8.0, 1.0]), "view": lambda: np.eye(4),
        "projection": camera_matrix, "R": lambda: np.eye(3), "T": lambda: (0.0, 0.0, 3.0),
        "focal_length": lambda: 1.0, "matrix_world": lambda: np.eye(4), "up": lambda: (0, 1, 0),
        "ids": lambda: np.array([[0, 1]]), "counts": lambda: [4], "categories": lambda: ["a"],
        "images": lambda: [("a.png", np.array([[0, -1]]))], "d": lambda: 1.0,
        "interpolation": lambda: "linear", "names": lambda: [], "kept": lambda: None,
    }  # fmt: skip
    return values | {
        "load_cameras.path": file("1.out", f"# Bundle file v0.3\n1 0\n9 0 0\n{'1 0 0 0 ' * 3}"),
        "load_cameras.size": lambda: (8, 6),
        "save_cameras.path": lambda: folder / "a.json",
        "save_cameras.cameras": lambda: [rj.CalibratedCamera(camera(), (8, 6), name="a.png")],
        "load.path": file("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "Texture.from_file.path": picture, "Environment.from_file.path": picture,
        "Scene.save.path": lambda: folder / "a.glb",
        "Channel.path": lambda: "scale", "Channel.values": lambda: np.ones((2, 3)),
        "Framebuffer.draw_line.start": lambda: (0, 0), "Framebuffer.draw_line.end": lambda: (4, 4),
        "Framebuffer.draw_lines.colors": lambda: [[1, 2, 3]],
        "Framebuffer.draw_bezier.points": lambda: [(0, 0), (3, 0), (3, 3), (0, 3)],
        "ClassicPipeline.explain.vertex": lambda: (0.0, 0.0, -2.0),
        "angle_dimension.first": lambda: (1.0, 0.0, 0.0),
        "angle_dimension.vertex": lambda: (0.0, 0.0, 0.0),
        "angle_dimension.second": lambda: (0.0, 1.0, 0.0),
        "radius_dimension.center": lambda: (3.0, 3.0, 0.0),
        "SectionPlane.box.low": lambda: (-1.0, -1.0, -1.0),
        "SectionPlane.box.high": lambda: (1.0, 1.0, 1.0),
        "Frame.scale_bar.depth": lambda: 1.0,
        "Mesh.warp.displacements": lambda: np.zeros(len(square)),
        "Framebuffer.save.path": lambda: folder / "b.png",
        "Animation.name": lambda: "walk",
        "Joint.kind": lambda: "revolute", "Joint.transforms.values": lambda: [10.0, 20.0],
        "Joints.add.joint": lambda: rj.Joint(scenes[-1].nodes[0], "revolute", (0, 0, 1)),
        "Joints.add.name": lambda: "door", "Joints.add.self": lambda: kept_scene().joints,
        "Joints.move.pose": lambda: [10.0], "Joints.transforms.poses": lambda: [[10.0], [20.0]],
        "Joints.from_radians.poses": lambda: [[0.1], [0.2]],
        "RasterizedFaces.interpolate.values": lambda: np.ones((3, 1)),
        "animation.MorphTrack.vertices": lambda: np.stack([square, square]),
        "animation.save.path": lambda: folder / "a.gif",
        "distributed.render_large.path": lambda: folder / "large.tif",
        "distributed.render_partitions.partitions": lambda: [
            rj.Mesh(square, [[0, 1, 2]], normals=square * 0.0 + (0.0, 0.0, 1.0))
        ],
        "styles.Style.with_quality.quality": rj.Quality, "Scene.remove.self": kept_scene,
        "Scene.remove.node": lambda: scenes[-1].nodes[0], "Scene.at.animation": lambda: "walk",
        "FisheyeLens.distort.points": lambda: np.zeros((2, 2)),
        "PinholeDistortion.distort.points": lambda: np.zeros((2, 2)),
        "Equirectangular.unproject.positions": lambda: np.zeros((2, 2)),
        "FisheyeLens.unproject.positions": lambda: np.zeros((2, 2)),
        "PinholeDistortion.unproject.positions": lambda: np.zeros((2, 2)),
        "animation.frames.camera": tracks, "Fog.density": lambda: 0.1,
        "Lines.from_poses.poses": lambda: np.stack([np.eye(4), np.eye(4)]),
        "Framebuffer.draw_lines.ends": lambda: [[0, 0, 3, 3]],
        "MorphTargets.positions": lambda: np.zeros((1, 4, 3)),
        "MorphTargets.with_weights.weights": lambda: [0.0],
        "MorphTargets.with_weights.names": lambda: ["a"],
        "Frame.attribute.name": lambda: "heat", "Batch.attribute.name": lambda: "heat",
        "LayeredFrame.attribute.name": lambda: "heat",
        "LayeredFrame.save.path": lambda: folder / "a.npz",
        "LineDrawing.save.path": lambda: folder / "a.svg",
        "transforms.unit_vector.value": lambda: (0.0, 0.0, 2.0),
        "transforms.unit_triple.value": lambda: (0.0, 0.0, 2.0),
        "transforms.are_parallel.a": lambda: (0.0, 0.0, 2.0),
        "transforms.are_parallel.b": lambda: (0.0, 0.0, 2.0),
        "cameras.from_trimesh.camera": trimesh_camera,
        "cameras.perspective_from_trimesh.camera": trimesh_camera,
        "cameras.from_trimesh.transform": lambda: np.eye(4),
        "cameras.intrinsic_matrix.value": lambda: np.diag([8.0, 8.0, 1.0]),
        "cameras.from_blender.lens": lambda: 50.0,
        "masks.save_coco.path": lambda: folder / "a.json",
    }  # fmt: skip


def camera_matrix() -> Any:
    """Return a perspective matrix."""
    import rasterjit as rj

    return rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), near=0.1, far=9.0).projection_matrix((8, 6))


def instances(values: Mapping[str, Callable[[], Any]]) -> dict[str, Callable[[], Any]]:
    """Return what makes objects whose methods are called, by the names of their classes."""
    import rasterjit as rj
    from rasterjit import styles

    outputs = ("depth", "object_id", "face_id", "barycentric", "position", "attribute:heat")

    def drawn(**options: Any) -> Any:
        return rj.render(values["scene"](), values["camera"](), size=(8, 6), **options)

    return {
        "Frame": lambda: drawn(outputs=("color", *outputs)),
        "LayeredFrame": lambda: rj.render_layers(
            values["scene"](), values["camera"](), k=1, size=(8, 6), outputs=outputs
        ),
        "LineDrawing": lambda: rj.line_drawing(values["scene"](), values["camera"](), (8, 6)),
        "Batch": lambda: rj.render_batch(
            values["scene"](), values["cameras"](), size=(8, 6), outputs=outputs[-1:]
        ),
        "RasterizedFaces": lambda: rj.rasterize(np.ones((3, 4)), [[0, 1, 2]], (8, 6)),
        "ClassicPipeline": lambda: rj.ClassicPipeline().perspective(40.0, 8, 6, 0.1, 10.0),
        "Style": lambda: styles.clay(values["scene"](), values["camera"]()),
        "Mesh": values["mesh"], "Scene": values["scene"],
    }  # fmt: skip


def all_tries(folder: Path) -> Iterator[Try]:
    """Yield all that is public and can be called."""
    import rasterjit as rj

    (folder / "meshes").mkdir()
    (folder / "meshes" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    values = sound_values(folder)
    made = instances(values)
    homes = {"": rj, **{f"{name}.": getattr(rj, name) for name in MODULES}}
    for prefix, home in homes.items():
        for public in getattr(home, "__all__", None) or _own_of(home):
            thing, name = getattr(home, public), prefix + public
            if inspect.isclass(thing):
                yield from _of_class(name, public, thing, values, made)
            elif callable(thing) and public not in (*OPENED, *INNER):
                yield _try_of(name, thing, values)


def _own_of(module: Any) -> list[str]:
    """Return the public functions of a module that lists none."""
    return [
        name for name, one in vars(module).items()
        if inspect.isfunction(one) and one.__module__ == module.__name__ and name[0] != "_"
    ]  # fmt: skip


def _of_class(
    name: str, public: str, thing: Any, values: dict[str, Callable[[], Any]],
    made: dict[str, Callable[[], Any]],
) -> Iterator[Try]:  # fmt: skip
    """Yield a class and its methods."""
    import rasterjit as rj

    is_made = public not in RESULTS and not issubclass(thing, (Exception, tuple))
    whole = _try_of(name, thing, values) if is_made else None
    if whole is not None:
        yield whole
    for method, raw in inspect.getmembers(thing):
        owner = next(one for one in thing.__mro__ if method in vars(one))
        # What is inherited from a public class is tried there.
        is_other = owner is not thing and getattr(rj, owner.__name__, None) is owner
        is_ours = owner.__module__.startswith("rasterjit")
        if method.startswith("_") or is_other or not is_ours or not callable(raw):
            continue
        if f"{public}.{method}" in OPENED or method == "follow":
            continue
        if inspect.ismethod(raw) or isinstance(inspect.getattr_static(thing, method), staticmethod):
            yield _try_of(f"{name}.{method}", raw, values)
            continue
        maker = made.get(public)
        if maker is None and whole is not None:
            maker = _maker(whole)
        if maker is not None:
            yield _try_of(f"{name}.{method}", raw, {**values, "self": maker})


def _maker(whole: Try) -> Callable[[], Any]:
    return lambda: whole.call(**{key: make() for key, make in whole.sound.items()})


def _try_of(name: str, call: Any, values: dict[str, Callable[[], Any]]) -> Try:
    """Return a callable with what makes its required arguments."""
    sound = {}
    for key, parameter in inspect.signature(call).parameters.items():
        is_free = parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        if f"{name}.{key}" in values or (parameter.default is parameter.empty and not is_free):
            sound[key] = values.get(f"{name}.{key}", values.get(key, lambda: None))
    return Try(name, call, sound)


def parameters(one: Try) -> list[str]:
    """Return the names of the parameters that are tried."""
    found = inspect.signature(one.call).parameters.values()
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return [each.name for each in found if each.name != "self" and each.kind not in kinds]


def outcome(one: Try, changed: Mapping[str, Any]) -> tuple[str, str]:
    """Call; return ``"taken"``, ``"named"`` or ``"other"``, and what was said."""
    given: dict[str, Any] = {}
    try:
        given |= {key: make() for key, make in one.sound.items() if key not in changed}
        with (
            warnings.catch_warnings(),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            result = one.call(**{**given, **changed})
            if inspect.isgenerator(result):
                next(result, None)
                result.close()
    except Exception as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split())}"
        # Where two do not fit each other, either may be named.
        is_named = any(re.search(rf"\b{key}\b", str(error)) for key in parameters(one))
        is_named = is_named or isinstance(error, OutputNotRequestedError)
        # Or what is made is named, as a colormap, or one of many.
        last = one.name.rpartition(".")[2].lower()
        is_named = is_named or any(
            isinstance(alias, str) and alias and alias in str(error)
            for alias in (last, changed.get("name", given.get("name")), ONE_OF.get(one.name))
        )
        right = isinstance(error, (ValueError, TypeError)) and is_named
        return ("named" if right else "other"), said
    return "taken", ""


def count(tries: list[Try], shown: Callable[[str], None], step: int = 1) -> Counter[str]:
    """
    Return how many calls had each outcome, showing the errors that name nothing.

    Of all pairs of a parameter and a wrong value every ``step``-th is tried.
    """
    counts: Counter[str] = Counter()
    turns = itertools.count()
    for one in tries:
        sound, said = outcome(one, {})
        if sound != "taken":
            counts["unsound"] += 1
            shown(f"{one.name} cannot be called: {said[:200]}")
            continue
        for key, wrong in itertools.product(parameters(one), WRONG):
            if next(turns) % step:
                continue
            result, said = outcome(one, {key: WRONG[wrong]()})
            counts[result] += 1
            if result == "other":
                shown(f"{one.name}({key}={wrong}): {said[:200]}")
    return counts


def main() -> int:
    """Print how many wrong arguments are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="callables whose name begins so")
    only = parser.parse_args().only.removeprefix("rasterjit.")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chdir(folder)
        tries = [one for one in all_tries(folder) if one.name.startswith(only)]
        counts = count(tries, print)
        os.chdir("/")
    tried = counts["taken"] + counts["named"] + counts["other"]
    print(
        f"{len(tries)} callables, {tried:,} calls: {counts['taken']:,} taken, {counts['named']:,} "
        f"errors that name the argument, {counts['other']:,} that do not"
    )
    return int(counts["other"] > 0 or counts["unsound"] > 0)


if __name__ == "__main__":
    sys.exit(main())
