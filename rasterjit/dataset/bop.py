"""
Write and read data sets for 6D object pose in the BOP format.

``models/`` holds PLY files and ``models_info.json``; each folder of a scene, such as
``train/000000``, holds pictures, 16-bit depth, masks, and three JSON files with cameras, poses, and
what is seen of each object. Lengths are millimetres.

>>> import rasterjit as rj
>>> from rasterjit.dataset import bop, render_objects
>>> scene = rj.load("models/teapot.obj")
>>> cameras = [rj.fit_camera(scene, rj.orbit_direction(angle, 20.0)) for angle in (0, 90)]
>>> bop.write_models("teapots/models", {1: scene.nodes[0].mesh})
>>> bop.write_scene("teapots/train/000000", render_objects(scene, cameras, size=(64, 48)))
2
>>> [view.objects[0].visible_share for view in bop.read_scene("teapots/train/000000")]
[1.0, 1.0]

References
----------
BOP toolkit, ``docs/bop_datasets_format.md``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from rasterjit.dataset.object_views import Box, LabelledView, ObjectView
from rasterjit.io.atomic_write import atomic_folder
from rasterjit.io.images import decode_picture, encode_png, quantize
from rasterjit.io.load_warnings import LoadWarning, SaveWarning, reason_of
from rasterjit.io.meshes import load
from rasterjit.outputs.save import MAX_CODE
from rasterjit.scene import validation as check
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.warning import warn_caller

__all__ = [
    "ObjectModel", "SceneViews", "read_models", "read_scene", "write_models", "write_scene",
]  # fmt: skip

MODELS_INFO = "models_info.json"
SCENE_FILES = "scene_camera.json", "scene_gt.json", "scene_gt_info.json"
"""Cameras, poses, and what is seen of the objects."""

PICTURES = {
    "color": (("rgb", "gray"), (".png", ".jpg", ".tif")),
    "depth": (("depth",), (".png", ".tif")),
}
"""Folders of colour and depth, and the extensions of their files."""

MASKS = "mask", "mask_visib"
"""Folders of masks."""

KNOWN_NAMES = frozenset({*SCENE_FILES, *MASKS, *PICTURES["color"][0], *PICTURES["depth"][0]})
"""Names in a scene's folder."""

CAMERA_KEYS = frozenset({"cam_K", "depth_scale", "cam_R_w2c", "cam_t_w2c"})
POSE_KEYS = frozenset({"obj_id", "cam_R_m2c", "cam_t_m2c"})
INFO_KEYS = frozenset({
    "bbox_obj", "bbox_visib", "px_count_all", "px_count_valid", "px_count_visib", "visib_fract",
})  # fmt: skip
"""Keys of an image, and of an object in it."""

MAX_NUMBER = 999_999
"""Largest number of a view: names of files have six digits."""

NO_BOX = [-1, -1, -1, -1]
"""Boxes of objects of which nothing is seen."""

NOTHING: Box = (0, 0, 0, 0)

MAX_WHOLE = (1 << 31) - 1
"""Largest id, count, and side of a box."""

MAX_PAIRS = 1 << 24
"""Most distances between vertices that are computed at once."""

TEXTURE_COORDINATES = {"s": "texture_u", "t": "texture_v"}
"""Names of texture coordinates in PLY files: what trimesh writes, and what BOP has."""


class ObjectModel(NamedTuple):
    """An object model of a data set."""

    mesh: Mesh
    """In millimetres."""
    info: dict[str, Any]
    """What ``models_info.json`` says: diameter, ``min_x``, ``size_x`` ... and symmetries."""


def write_models(
    folder: str | os.PathLike[str], models: Mapping[int, Mesh],
    info: Mapping[int, Mapping[str, Any]] | None = None,
) -> None:  # fmt: skip
    """
    Write object models as text PLY files, and ``models_info.json``.

    Each has normals and the texture, or else the colours, that it is drawn with without light.
    BOP wants z up and the centre of the bounding box at the origin; nothing is moved or scaled.

    Parameters
    ----------
    folder : path
        Such as ``set/models``; folders above it are made. One with such models is replaced.
    models : mapping of int to Mesh
        By their ids, in millimetres.
    info : mapping of int to mapping, optional
        More entries of ``models_info.json``, such as ``symmetries_discrete``, by id: what JSON can
        hold, and arrays.

    Raises
    ------
    ValueError
        If ``models`` is empty or holds something else, ``info`` names others or holds what JSON
        cannot, or the folder holds other things.
    OSError
        If a file cannot be written; what was there stays.

    Warns
    -----
    SaveWarning
        Naming what a PLY file of BOP has no place for: colours of vertices beside a texture, and
        how that is repeated; colours of faces, which become their mean at each vertex; skins, morph
        targets and attributes.

    Notes
    -----
    The diameter is the largest distance between two vertices, as in the toolkit's
    ``calc_model_info.py``.
    """
    entries = _check_models(models)
    more = {} if info is None else _check_info(info, entries)
    target = _check_target(folder, MODELS_INFO)
    document = {}
    with atomic_folder(target) as temporary:
        for name, mesh in entries.items():
            _write_ply(temporary / f"obj_{name:06d}.ply", name, mesh)
            low, high = mesh.bounds()
            document[str(name)] = {"diameter": _find_diameter(mesh)}
            for axis, least, most in zip("xyz", low.tolist(), high.tolist(), strict=True):
                document[str(name)] |= {f"min_{axis}": least, f"size_{axis}": most - least}
            document[str(name)] |= more.get(name, {})
        _write_json(temporary / MODELS_INFO, document)


def read_models(folder: str | os.PathLike[str]) -> dict[int, ObjectModel]:
    """
    Read the object models of a data set by their ids.

    Parameters
    ----------
    folder : path
        Such as ``models``, with ``models_info.json``.

    Raises
    ------
    ValueError
        If the folder or a file is missing or damaged.
    """
    place = check.existing_folder("folder", folder)
    models = {}
    for name, info in _read_json(place / MODELS_INFO).items():
        if not isinstance(info, dict):
            raise ValueError(
                f"{place / MODELS_INFO}: model {name} must have a JSON object, "
                f"got {check.brief(info)}"
            )
        path = place / f"obj_{name:06d}.ply"
        loaded = load(path)
        if len(loaded.nodes) != 1 or not isinstance(loaded.nodes[0].mesh, Mesh):
            raise ValueError(f"{path}: it must hold one mesh of triangles")
        models[name] = ObjectModel(loaded.nodes[0].mesh, info)
    return models


def write_scene(folder: str | os.PathLike[str], views: Iterable[LabelledView]) -> int:
    """
    Write the views of a scene: pictures, depth, masks, cameras, poses and what is seen.

    Parameters
    ----------
    folder : path
        Such as ``set/train/000000``; folders above it are made. One with such a scene is replaced.
    views : iterable of LabelledView
        Such as `rasterjit.dataset.render_objects` yields; they are taken one by one.

    Returns
    -------
    int
        Number of views.

    Raises
    ------
    ValueError
        If ``views`` holds something else, two of one number, none at all, a camera or an object
        that `read_scene` would refuse, such as one that is scaled, which a pose of BOP cannot say;
        if the folder holds other things.
    OSError
        If a file cannot be written; what was there stays.

    Notes
    -----
    BOP's boxes go from the first to the last pixel: their width and height are one less than those
    of `rasterjit.dataset.ObjectView`. Of objects of which nothing is seen, both are
    ``[-1, -1, -1, -1]``.
    """
    target = _check_target(folder, SCENE_FILES[0])
    documents: tuple[dict[str, Any], ...] = {}, {}, {}
    with atomic_folder(target) as temporary:
        for view in views:
            if not isinstance(view, LabelledView):
                raise ValueError(f"views must be LabelledView, got {check.brief(view)}")
            key = str(check.whole_number("views: the number", view.number, 0, MAX_NUMBER))
            if key in documents[0]:
                raise ValueError(f"views must have different numbers, got {key} twice")
            poses, seen = (
                [f(one) for one in view.objects] for f in (_describe_pose, _describe_seen)
            )
            rows = _describe_camera(view), poses, seen
            # What is written can be read.
            _read_camera("views", f"view {key}", rows[0])
            for k, entries in enumerate(zip(poses, seen, strict=True)):
                _read_object(("views",) * 2, f"view {key}, object {k}", *entries, (None, None))
            _write_pictures(temporary, view)
            for document, row in zip(documents, rows, strict=True):
                document[key] = row
        if not documents[0]:
            raise ValueError("views must hold at least one view, got none")
        for name, document in zip(SCENE_FILES, documents, strict=True):
            _write_json(temporary / name, dict(sorted(document.items(), key=_number_of)))
    return len(documents[0])


def read_scene(folder: str | os.PathLike[str]) -> SceneViews:
    """
    Read the views of a scene.

    Parameters
    ----------
    folder : path
        Such as ``train/000000``, with ``scene_camera.json`` and ``scene_gt.json``.

    Returns
    -------
    SceneViews
        A sequence of `rasterjit.dataset.LabelledView`, in the order of their numbers; a view's
        pictures are read when it is taken.

    Raises
    ------
    ValueError
        Naming the file that is missing, damaged, or without a key that it needs.

    Warns
    -----
    LoadWarning
        Naming files and keys that are left out.
    """
    return SceneViews(check.existing_folder("folder", folder))


class SceneViews(Sequence[LabelledView]):
    """The views of a scene's folder, a sequence, which `read_scene` returns."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        cameras, poses = (_read_json(folder / name) for name in SCENE_FILES[:2])
        seen = _read_json(folder / SCENE_FILES[2]) if (folder / SCENE_FILES[2]).exists() else {}
        self.numbers = tuple(sorted(cameras))
        """Of the views."""
        left_out = {
            f"{one} of {name}"
            for name, rows in zip(SCENE_FILES[1:], (poses, seen), strict=True)
            for one in rows.keys() - cameras.keys()
        }
        self._rows: dict[int, tuple[Any, Any, Any]] = {}
        for number in self.numbers:
            row = cameras[number], poses.get(number, []), seen.get(number)
            parts = [row[0]], row[1], row[1] if row[2] is None else row[2]
            keys = CAMERA_KEYS, POSE_KEYS, POSE_KEYS if row[2] is None else INFO_KEYS
            for name, part, known in zip(SCENE_FILES, parts, keys, strict=True):
                if not isinstance(part, list) or not all(isinstance(one, dict) for one in part):
                    raise ValueError(
                        f"{folder / name}: view {number} must have JSON objects, "
                        f"got {check.brief(part)}"
                    )
                left_out |= {key for one in part for key in one} - known
            if len(parts[2]) != len(parts[1]):
                raise ValueError(
                    f"{folder / SCENE_FILES[2]}: view {number} must have the {len(parts[1])} "
                    f"objects of {SCENE_FILES[1]}, got {len(parts[2])}"
                )
            self._rows[number] = row
        left_out |= {one.name for one in folder.iterdir()} - KNOWN_NAMES
        if left_out:
            warn_caller(f"{folder}: left out {', '.join(sorted(left_out))}", LoadWarning)

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, place: int) -> LabelledView: ...
    @overload
    def __getitem__(self, place: slice) -> list[LabelledView]: ...

    def __getitem__(self, place: int | slice) -> LabelledView | list[LabelledView]:
        """
        Read a view, or several of them.

        Raises
        ------
        ValueError
            Naming the file that is damaged, or without a key that it needs.
        """
        if isinstance(place, slice):
            return [self._read(number) for number in self.numbers[place]]
        return self._read(self.numbers[place])

    def __repr__(self) -> str:
        return f"SceneViews({str(self.folder)!r}: {len(self)} views)"

    def _read(self, number: int) -> LabelledView:
        """Read the view of a number."""
        camera, poses, seen = self._rows[number]
        files, where = [self.folder / name for name in SCENE_FILES], f"view {number}"
        intrinsics, world, scale = _read_camera(files[0], where, camera)
        color, codes = (self._read_picture(kind, number) for kind in ("color", "depth"))
        depth = None
        if codes is not None:
            steps = codes.astype(np.float32)
            depth = np.where(steps == 0.0, np.float32(np.inf), steps * np.float32(scale))
        objects = []
        for k, pose in enumerate(poses):
            masks = [self._read_mask(name, number, k) for name in MASKS]
            entries = pose, seen and seen[k]
            objects.append(_read_object(files[1:], f"{where}, object {k}", *entries, masks))
        masks = [mask for one in objects for mask in (one.mask, one.visible)]
        sizes = {one.shape[:2] for one in (color, depth, *masks) if one is not None}
        if len(sizes) > 1:
            raise ValueError(
                f"{self.folder}: pictures and masks of {where} must have one size, got "
                f"{' and '.join(f'{width} x {height}' for height, width in sorted(sizes))}"
            )
        return LabelledView(
            number, intrinsics, world,
            color if color is None or color.ndim == 2 else color[..., :3], depth, scale,
            tuple(objects),
        )  # fmt: skip

    def _read_picture(self, kind: str, number: int) -> NDArray[Any] | None:
        """Return colour or codes of depth of a view; ``None`` if there is no such file."""
        folders, extensions = PICTURES[kind]
        for name in folders:
            for extension in extensions:
                path = self.folder / name / f"{number:06d}{extension}"
                if path.exists():
                    return _read_image(path, kind == "depth")
        return None

    def _read_mask(self, name: str, number: int, place: int) -> NDArray[np.bool_] | None:
        """Return a mask; ``None`` if there is no such file."""
        path = self.folder / name / f"{number:06d}_{place:06d}.png"
        return _read_image(path, True) > 0 if path.exists() else None


# Writing.


def _check_models(models: Any) -> dict[int, Mesh]:
    """Return meshes by their ids in order, or raise ``ValueError``."""
    if not isinstance(models, Mapping) or not models:
        raise ValueError(
            f"models must be meshes by their ids, at least one, got {check.brief(models)}"
        )
    for name, mesh in models.items():
        if not isinstance(name, (int, np.integer)) or name < 0 or not isinstance(mesh, Mesh):
            raise ValueError(
                f"models must be meshes by ids of at least 0, got {name!r}: {check.brief(mesh)}"
            )
    return {int(name): models[name] for name in sorted(models)}


def _check_info(info: Any, models: Mapping[int, Mesh]) -> dict[int, Mapping[str, Any]]:
    """Return entries of models by their ids, or raise ``ValueError``."""
    if not isinstance(info, Mapping):
        raise ValueError(f"info must be mappings by the ids of models, got {check.brief(info)}")
    for name, row in info.items():
        if name not in models:
            raise ValueError(f"info must be about models by their ids, got {check.brief(name)}")
        try:
            if not isinstance(row, Mapping):
                raise TypeError(f"it is {check.brief(row)}")
            _format_json(row)
        except (TypeError, ValueError, RecursionError) as error:
            raise ValueError(
                f"info[{name}] must be a mapping of what JSON can hold, and arrays: {error}"
            ) from None
    return dict(info)


def _check_target(folder: Any, mark: str) -> Path:
    """Return the folder to write, or raise ``ValueError`` if it holds something else."""
    if not isinstance(folder, (str, os.PathLike)):
        raise ValueError(f"folder must be the name of a folder, got {check.brief(folder)}")
    target = Path(os.fsdecode(folder))
    if target.exists() and not target.is_dir():
        raise ValueError(f"folder {str(target)!r} is a file")
    if target.is_dir() and any(target.iterdir()) and not (target / mark).exists():
        raise ValueError(f"folder {str(target)!r} holds other things, and no {mark}")
    target.parent.mkdir(parents=True, exist_ok=True)
    return target


def _number_of(entry: tuple[str, Any]) -> int:
    """Return the number of an entry of a JSON file."""
    return int(entry[0])


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a JSON object, each of its entries on a line."""
    rows = (f"  {json.dumps(key)}: {_format_json(row)}" for key, row in document.items())
    path.write_text("{\n" + ",\n".join(rows) + "\n}\n", "utf-8")


def _format_json(value: Any) -> str:
    """Return JSON, with arrays as lists; raise ``TypeError`` or ``ValueError`` of other things."""
    return json.dumps(value, default=_to_plain, allow_nan=False)


def _to_plain(value: Any) -> Any:
    """Return an array as lists, or raise ``TypeError``."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} is neither")


def _write_ply(path: Path, name: int, mesh: Mesh) -> None:
    """Write a model as text PLY, and its texture beside it."""
    import trimesh

    texture = mesh.material.base_color_texture
    uv = None if texture is None else mesh.uv_sets[texture.uv_set]
    rest = {
        "skins": mesh.joints is not None, "morph targets": mesh.morph_targets is not None,
        "colours of faces": mesh.face_colors is not None,
        "attributes": bool(mesh.vertex_attributes or mesh.face_attributes),
    }  # fmt: skip
    visual: dict[str, Any] = {}
    if texture is None or uv is None:
        visual["vertex_colors"] = quantize(_color_rows(mesh), "srgb")[0]
    else:
        rest["colours of vertices"] = mesh.shown_vertex_colors() is not None
        rest["how the texture is repeated"] = texture.wrap != ("repeat", "repeat")
        if texture.transform is not None:
            (a, b, x, c, d, y), (u, v) = texture.transform, uv.T
            uv = np.column_stack([a * u + b * v + x, c * u + d * v + y])
        visual["visual"] = trimesh.visual.TextureVisuals(uv=uv)
    if any(rest.values()):
        listed = ", ".join(kind for kind, is_there in rest.items() if is_there)
        warn_caller(f"models[{name}]: a PLY file of BOP has no place for {listed}", SaveWarning)
    written = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals(), process=False, **visual
    )
    text = trimesh.exchange.ply.export_ply(written, encoding="ascii", vertex_normal=True).decode()
    if texture is not None and uv is not None:
        header, end, rows = text.partition("end_header\n")
        for old, new in TEXTURE_COORDINATES.items():
            header = re.sub(rf"property \w+ {old}\n", f"property float {new}\n", header)
        picture = path.with_suffix(".png")
        tint = np.array(mesh.material.base_color_over(True), np.float32)
        header = header.replace("1.0\n", f"1.0\ncomment TextureFile {picture.name}\n", 1)
        picture.write_bytes(encode_png(quantize(texture.image * tint, "srgb")[0]))
        text = header + end + rows
    path.write_text(text, "ascii")


def _color_rows(mesh: Mesh) -> NDArray[np.float32]:
    """Return a colour of each vertex, (V, 4), linear, by which the mesh is drawn."""
    colors = mesh.shown_vertex_colors()
    if colors is None and mesh.face_colors is not None:
        sums, counts = np.zeros((len(mesh.vertices), 4)), np.zeros((len(mesh.vertices), 1))
        np.add.at(sums, mesh.faces, mesh.face_colors[:, None])
        np.add.at(counts, mesh.faces, 1.0)
        colors = (sums / np.maximum(counts, 1.0)).astype(np.float32)
    tint = np.array(mesh.material.base_color_over(colors is not None), np.float32)
    return np.tile(tint, (len(mesh.vertices), 1)) if colors is None else colors * tint


def _find_diameter(mesh: Mesh) -> float:
    """
    Return the largest distance between two vertices.

    Only vertices far from the middle can be its ends: those whose distance from there, and that of
    the farthest, are together at least the longest distance that is known.
    """
    points = np.unique(mesh.vertices[np.isfinite(mesh.vertices).all(axis=1)], axis=0)
    radii = _find_distances(points, 0.5 * (points.min(axis=0) + points.max(axis=0)))
    longest, last = 0.0, points[radii.argmax()]
    for _ in range(8):
        distances = _find_distances(points, last)
        longest, last = max(longest, float(distances.max())), points[distances.argmax()]
    points = points[radii + radii.max() >= longest * (1.0 - 1e-9)]
    for rows in np.array_split(points, 1 + len(points) ** 2 // MAX_PAIRS):
        distances = _find_distances(points, rows[:, None])
        longest = max(longest, float(np.max(distances, initial=0.0)))
    return longest


def _find_distances(points: NDArray[np.float64], origin: NDArray[np.float64]) -> Any:
    """Return the distances of points, (..., 3), from an origin, or from several: (...)."""
    x, y, z = np.moveaxis(points - origin, -1, 0)
    return np.sqrt((x * x + y * y) + z * z)


def _write_pictures(folder: Path, view: LabelledView) -> None:
    """Write colour, depth and masks of a view."""
    pictures: dict[str, Any] = {}
    if view.color is not None:
        pictures["rgb" if view.color.ndim == 3 else "gray"] = view.color
    if view.depth is not None:
        codes = np.rint(np.where(np.isfinite(view.depth), view.depth, 0.0) / view.depth_scale)
        if codes.max() > MAX_CODE:
            raise ValueError(
                f"views must have depths of at most {MAX_CODE} times depth_scale, "
                f"{view.depth_scale!r}, got {float(codes.max() * view.depth_scale)!r} in view "
                f"{view.number}"
            )
        pictures["depth"] = codes.astype(np.uint16)
    for name, pixels in pictures.items():
        (folder / name).mkdir(exist_ok=True)
        (folder / name / f"{view.number:06d}.png").write_bytes(encode_png(pixels))
    for k, one in enumerate(view.objects):
        for name, mask in zip(MASKS, (one.mask, one.visible), strict=True):
            if mask is not None:
                (folder / name).mkdir(exist_ok=True)
                (folder / name / f"{view.number:06d}_{k:06d}.png").write_bytes(
                    encode_png(np.where(mask, np.uint8(255), np.uint8(0)))
                )


def _describe_camera(view: LabelledView) -> dict[str, Any]:
    """Return the entry of a view in ``scene_camera.json``."""
    row = {"cam_K": view.intrinsics.ravel().tolist(), "depth_scale": view.depth_scale}
    if view.camera_from_world is not None:
        row["cam_R_w2c"] = view.camera_from_world[:3, :3].ravel().tolist()
        row["cam_t_w2c"] = view.camera_from_world[:3, 3].tolist()
    return row


def _describe_pose(one: ObjectView) -> dict[str, Any]:
    """Return the entry of an object in ``scene_gt.json``."""
    return {
        "cam_R_m2c": one.camera_from_model[:3, :3].ravel().tolist(),
        "cam_t_m2c": one.camera_from_model[:3, 3].tolist(), "obj_id": one.id,
    }  # fmt: skip


def _describe_seen(one: ObjectView) -> dict[str, Any]:
    """Return the entry of an object in ``scene_gt_info.json``."""
    boxes = {
        key: [*box[:2], box[2] - 1, box[3] - 1] if one.visible_area else NO_BOX
        for key, box in (("bbox_obj", one.box), ("bbox_visib", one.visible_box))
    }
    return boxes | {
        "px_count_all": one.area, "px_count_valid": one.measured_area,
        "px_count_visib": one.visible_area, "visib_fract": one.visible_share,
    }  # fmt: skip


# Reading.


def _read_json(path: Path) -> dict[int, Any]:
    """Return the entries of a JSON object by their whole numbers, or raise ``ValueError``."""
    try:
        document = json.loads(path.read_text("utf-8"), object_pairs_hook=_refuse_doubles)
        rows = {int(key): row for key, row in document.items() if key.isdecimal()}
        if len(rows) < len(document):
            raise ValueError
        return rows
    except OSError as error:
        raise ValueError(f"{path}: it cannot be read: {error.strerror}") from None
    except (ValueError, AttributeError, RecursionError):
        raise ValueError(
            f"{path}: it must be a JSON object with different whole numbers for keys"
        ) from None


def _refuse_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object, or raise ``ValueError`` if it has a key twice."""
    entries = dict(pairs)
    if len(entries) < len(pairs):
        raise ValueError
    return entries


def _read_camera(path: Any, where: str, row: Any) -> tuple[NDArray[Any], Matrix | None, float]:
    """Return K, the pose and the depth scale of a view's entry, or raise ``ValueError``."""
    world = None
    if "cam_R_w2c" in row or "cam_t_w2c" in row:
        world = _read_pose(path, where, row, "cam_R_w2c", "cam_t_w2c")
    scale = check.positive_number(f"{path}: {where}: depth_scale", row.get("depth_scale"))
    return _read_numbers(path, where, row, "cam_K", 9).reshape(3, 3), world, scale


def _read_object(
    paths: Sequence[Any], where: str, pose: Any, seen: Any, masks: Sequence[Any]
) -> ObjectView:
    """Return an object, given its entries of two files, the latter of which may miss, or raise."""
    (name,) = _read_wholes(paths[0], where, pose, "obj_id", 1)
    matrix = _read_pose(paths[0], where, pose, "cam_R_m2c", "cam_t_m2c")
    boxes, counts = [NOTHING, NOTHING], [0, 0, 0]
    if seen is not None:
        boxes = [_read_box(paths[1], where, seen, key) for key in ("bbox_obj", "bbox_visib")]
        keys = "px_count_all", "px_count_valid", "px_count_visib"
        counts = [one for key in keys for one in _read_wholes(paths[1], where, seen, key, 1)]
    return ObjectView(name, matrix, masks[0], masks[1], boxes[0], boxes[1], *counts)


def _read_numbers(path: Any, where: str, row: Any, key: str, count: int) -> NDArray[np.float64]:
    """Return ``count`` numbers of an entry, or raise ``ValueError``."""
    value = row.get(key)
    try:
        numbers = check.number_array(key, value, "iuf").ravel()
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(
            f"{path}: {where} must have {count} finite numbers as {key}, "
            f"got {check.short_repr(value)}"
        )
    return numbers


def _read_wholes(path: Any, where: str, row: Any, key: str, count: int, low: int = 0) -> list[int]:
    """Return ``count`` whole numbers of an entry, or raise ``ValueError``."""
    numbers = _read_numbers(path, where, row, key, count)
    if (numbers != np.floor(numbers)).any() or numbers.min() < low or numbers.max() > MAX_WHOLE:
        raise ValueError(
            f"{path}: {where} must have whole numbers in {low}..{MAX_WHOLE} as {key}, got "
            f"{check.short_repr(row[key])}"
        )
    return numbers.astype(int).tolist()


def _read_pose(path: Any, where: str, row: Any, rotation: str, translation: str) -> Matrix:
    """Return a pose, (4, 4), or raise ``ValueError``: it has no scale."""
    matrix = np.eye(4)
    matrix[:3, :3] = _read_numbers(path, where, row, rotation, 9).reshape(3, 3)
    matrix[:3, 3] = _read_numbers(path, where, row, translation, 3)
    check.check_rotation(f"{path}: {where}: {rotation}", matrix[:3, :3])
    return matrix


def _read_box(path: Any, where: str, row: Any, key: str) -> Box:
    """Return a box with its pixels counted, or raise ``ValueError``."""
    left, top, width, height = box = _read_wholes(path, where, row, key, 4, -MAX_WHOLE)
    if box == NO_BOX:
        return NOTHING
    if min(width, height) < 0:
        raise ValueError(f"{path}: {where} must have sides of at least 0 as {key}, got {box}")
    return left, top, width + 1, height + 1


def _read_image(path: Path, is_grey: bool) -> NDArray[Any]:
    """Return the pixels of a file, (H, W) if it must be grey, or raise ``ValueError``."""
    try:
        pixels = decode_picture(path.read_bytes())
    except Exception as error:
        raise ValueError(f"{path}: it cannot be read: {reason_of(error)}") from error
    if is_grey and pixels.ndim != 2:
        raise ValueError(f"{path}: it must be grey, got {pixels.shape[2]} channels")
    return pixels
