"""The command ``info``: what a mesh file holds (counts, nodes, materials, lights, camera)."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rasterjit.cli.program import spell_options
from rasterjit.cli.report import collect_warnings, say
from rasterjit.interrupts import raise_if_interrupted
from rasterjit.scene.mesh import ATTRIBUTE

if TYPE_CHECKING:
    from rasterjit.scene.material import Material
    from rasterjit.scene.mesh import Mesh
    from rasterjit.scene.scene import Scene

MAX_PRINTED = 20
"""Most nodes, materials and lights that are printed; JSON has all."""


def print_info(file: Path, as_json: bool, **reading: Any) -> None:
    """Read a file and print what it holds; ``reading`` as `rasterjit.load` takes it."""
    from rasterjit.io.meshes import load

    with collect_warnings() as caught:
        scene = load(file, **reading)
    raise_if_interrupted()
    said = [spell_options(str(warning.message)).removeprefix(f"{file}: ") for warning in caught]
    left_out: Counter[str] = Counter()
    for warning in caught:
        left_out.update(getattr(warning.message, "left_out", {}))
    held = {
        "file": str(file), "bytes": file.stat().st_size, **describe_scene(scene),
        "left_out": [{"what": what, "count": count} for what, count in left_out.items()],
        "warnings": said,
    }  # fmt: skip
    if as_json:
        say(*json.dumps(held, indent=2, allow_nan=False).split("\n"))
        return
    rows = list(_format_rows(held))
    widest = max(len(name) for name, _ in rows)
    for name, text in rows:
        say(f"{name:<{widest}}  {text}".rstrip())


PRIMITIVE_NAMES = {"triangles": "faces", "lines": "segments", "points": "points"}
"""Words for the primitives of each kind of mesh."""


def describe_scene(scene: Scene) -> dict[str, Any]:
    """
    Return the contents of a scene as values for JSON.

    Returns
    -------
    dict
        Counts of objects (meshes at their places), meshes (each once), vertices, and faces,
        segments of lines and points of both kinds; the nodes, tree by tree, with their names, the
        numbers of their parents in this list and of their objects, as ``object_id`` has them;
        outputs of attributes, with their columns and the number of meshes; bounds and bounding
        sphere, scene units; materials with the number of their objects, colours linear RGBA;
        names of the variants; distinct textures; lights; the camera or None; animations with their
        lengths, seconds; joints with their limits, degrees or scene units, or None.
    """
    meshes = list({id(node.mesh): node.mesh for node in scene.nodes}.values())
    low, high = (corner.tolist() for corner in scene.bounds())
    center, radius = scene.bounding_sphere()
    materials = Counter({id(one): 0 for one in (mesh.material for mesh in meshes)})
    materials.update(id(node.mesh.material) for node in scene.nodes)
    by_id = {id(mesh.material): mesh.material for mesh in meshes}
    return {
        "objects": len(scene.nodes),
        "meshes": len(meshes),
        "vertices": sum(len(mesh.vertices) for mesh in meshes),
        **_count_primitives(meshes, [node.mesh for node in scene.nodes]),
        "invalid_vertices": sum(mesh.invalid_vertices for mesh in meshes),
        "attributes": _count_attributes(meshes),
        "attribute_outputs": _list_outputs(meshes),
        "nodes": _list_nodes(scene),
        "closed": sum(mesh.is_closed() for mesh in meshes if mesh.primitive == "triangles"),
        "bounds": {"min": low, "max": high},
        "center": [float(part) for part in center],
        "radius": float(radius),
        "materials": [
            {**_describe_material(by_id[key]), "objects": count} for key, count in materials.items()
        ],
        "variants": list(scene.variants),
        "textures": _describe_textures(by_id.values()),
        "lights": [_describe_fields(light) for light in scene.lights],
        "camera": None if scene.camera is None else _describe_fields(scene.camera),
        "animations": [
            {"name": one.name, "seconds": one.duration, "channels": len(one.channels)}
            for one in scene.animations
        ],
        "joints": _list_joints(scene),
    }


def _list_joints(scene: Scene) -> list[dict[str, Any]]:
    """Return the joints of robots as values for JSON."""
    return [
        {
            "name": name,
            "kind": one.kind,
            "node": one.node.name,
            "value": one.value,
            "limits": [limit if math.isfinite(limit) else None for limit in one.limits],
            "follows": None if one.follows is None else one.follows.joint.name,
        }
        for name, one in scene.joints.items()
    ]


def _count_primitives(meshes: list[Mesh], drawn: list[Mesh]) -> dict[str, int]:
    """Return the numbers of faces, segments and points: stored once, and drawn in all objects."""
    found = {}
    for primitive, name in PRIMITIVE_NAMES.items():
        for of, key in ((meshes, name), (drawn, f"{name}_drawn")):
            found[key] = sum(len(mesh.faces) for mesh in of if mesh.primitive == primitive)
    return found


def _count_attributes(meshes: list[Mesh]) -> dict[str, int]:
    """Return the number of meshes with each attribute."""
    names = ("normals", "uv", "uv1", "tangents", "vertex_colors", "face_colors", "field",
             "joints", "morph_targets")  # fmt: skip
    counts = {name: sum(getattr(mesh, name) is not None for mesh in meshes) for name in names}
    return {name: count for name, count in counts.items() if count}


def _list_outputs(meshes: list[Mesh]) -> list[dict[str, Any]]:
    """Return the outputs of custom attributes, by name."""
    counts = Counter(
        (f"{ATTRIBUTE}{name}", values.shape[1], of)
        for mesh in meshes
        for of, held in (("vertices", mesh.vertex_attributes), ("faces", mesh.face_attributes))
        for name, values in held.items()
    )
    return [
        {"output": output, "columns": columns, "of": of, "meshes": count}
        for (output, columns, of), count in sorted(counts.items())
    ]


def _list_nodes(scene: Scene) -> list[dict[str, Any]]:
    """Return all nodes, parents before their children."""
    every = scene.every_node()
    numbers = {id(node): number for number, node in enumerate(every)}
    objects = {id(node): number for number, node in enumerate(scene.nodes)}
    return [
        {
            "name": str(node.name),
            "parent": None if node.parent is None else numbers[id(node.parent)],
            "object": objects.get(id(node)),
            **{
                name: 0
                if node.mesh is None or node.mesh.primitive != primitive
                else len(node.mesh.faces)
                for primitive, name in PRIMITIVE_NAMES.items()
            },
        }
        for node in every
    ]


def _describe_material(material: Material) -> dict[str, Any]:
    """Return the fields of a material, and the size of each texture."""
    from rasterjit.scene.material import TEXTURE_FIELDS

    color = material.base_color
    said: dict[str, Any] = {
        "shading": material.shading,
        "base_color": None if color is None else [float(part) for part in color],
        "alpha_mode": material.alpha_mode,
        "double_sided": material.double_sided,
    }
    if material.shading == "pbr":
        said |= {"metallic": material.metallic, "roughness": material.roughness}
        if material.has_clearcoat:
            said |= {"clearcoat": material.clearcoat}
        if material.has_sheen:
            said |= {"sheen_color": list(material.sheen_color)}
        if material.transmits:
            said |= {"transmission": material.transmission, "thickness": material.thickness}
        if material.has_custom_specular:
            said |= {
                "ior": material.ior, "specular_factor": material.specular_factor,
                "specular_color": list(material.specular_color),
            }  # fmt: skip
    textures = {name: getattr(material, name) for name in TEXTURE_FIELDS}
    said["textures"] = {
        name: list(texture.size) for name, texture in textures.items() if texture is not None
    }
    return said


def _describe_textures(materials: Any) -> dict[str, Any]:
    """Return the number of different textures, and the memory of their texels."""
    from rasterjit.scene.material import TEXTURE_FIELDS

    found = {
        id(texture): texture
        for material in materials
        for texture in (getattr(material, name) for name in TEXTURE_FIELDS)
        if texture is not None
    }
    texels = sum(texture.size[0] * texture.size[1] for texture in found.values())
    return {"count": len(found), "texels": texels}


def _describe_fields(thing: Any) -> dict[str, Any]:
    """Return the kind and fields of a light or camera; infinity as a word."""
    import dataclasses

    said: dict[str, Any] = {"kind": type(thing).__name__}
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if field.name == "shadow":
            value = value is not None
        elif hasattr(value, "tolist"):
            value = value.tolist()
        elif isinstance(value, tuple):
            value = [float(part) for part in value]
        elif isinstance(value, float) and value in (float("inf"), float("-inf")):
            value = str(value)
        said[field.name] = value
    return said


def _format_rows(held: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the printed rows: name and text."""
    # Counts.
    yield "file", f"{held['file']} ({held['bytes']:,} bytes)"
    yield "objects", f"{held['objects']:,} of {_format_count(held['meshes'], 'mesh', 'meshes')}"
    yield "vertices", f"{held['vertices']:,}"
    for name in PRIMITIVE_NAMES.values():
        count, in_all = held[name], held[f"{name}_drawn"]
        if count or (name == "faces" and not held["segments"] and not held["points"]):
            drawn = f", {in_all:,} in all objects" if in_all != count else ""
            yield name, f"{count:,}{drawn}"
    if held["invalid_vertices"]:
        yield "invalid vertices", f"{held['invalid_vertices']:,}, NaN or infinite"
    # Attributes of the meshes.
    of_all = f"of {held['meshes']:,}" if held["meshes"] > 1 else ""
    said = (f"{name} {f'{count:,} ' if of_all else ''}{of_all}".strip().replace("_", " ")
            for name, count in held["attributes"].items())  # fmt: skip
    yield "attributes", ", ".join(said) or "none"
    own = held["attribute_outputs"]
    if own:
        told = (_format_attribute(one, of_all) for one in own)
        yield from _format_list("own attribute", told, len(own))
    if held["faces"]:
        yield "closed", f"{held['closed']:,} of {_format_count(held['meshes'], 'mesh', 'meshes')}"
    # Where objects stand, and how far they reach.
    yield from _format_list("node", _format_nodes(held["nodes"]), len(held["nodes"]))
    low, high = held["bounds"]["min"], held["bounds"]["max"]
    yield "bounds", f"{_format_numbers(low)} to {_format_numbers(high)}"
    sides = [b - a for a, b in zip(low, high, strict=True)]
    yield "size", f"{' x '.join(f'{side:.6g}' for side in sides)} units"
    yield (
        "bounding sphere",
        f"centre {_format_numbers(held['center'])}, radius {held['radius']:.6g}",
    )
    # Materials, lights, cameras and animations.
    yield from _format_list(
        "material", map(_format_material, held["materials"]), len(held["materials"])
    )
    if held["variants"]:
        yield "variants", ", ".join(map(repr, held["variants"]))
    textures = held["textures"]
    if textures["count"]:
        yield "textures", f"{textures['count']:,}, {textures['texels']:,} texels"
    else:
        yield "textures", "none"
    yield from _format_list("light", map(_format_fields, held["lights"]), len(held["lights"]))
    camera = held["camera"]
    yield "camera", "none" if camera is None else _format_fields(camera)
    if held["animations"]:
        told = map(_format_animation, held["animations"])
        yield from _format_list("animation", told, len(held["animations"]))
    if held["joints"]:
        yield from _format_list("joint", map(_format_joint, held["joints"]), len(held["joints"]))
    # What the file holds and the scene has not.
    left_out = [f"{one['what']} ({one['count']:,})" for one in held["left_out"]]
    yield "left out", ", ".join(left_out) or "nothing"
    for text in held["warnings"]:
        if not text.startswith("left out "):
            yield "warning", text


def _format_list(name: str, texts: Iterable[str], count: int) -> Iterator[tuple[str, str]]:
    """Yield a row for each of the first items of a kind; one row if there is none."""
    if not count:
        yield f"{name}s", "none"
    for number, text in enumerate(islice(texts, MAX_PRINTED)):
        yield f"{name} {number}", text
    if count > MAX_PRINTED:
        yield f"{name}s", f"{count - MAX_PRINTED:,} more: see --json"


def _format_attribute(one: dict[str, Any], of_all: str) -> str:
    """Return a line on an attribute's output."""
    having = f", {one['meshes']:,} {of_all} meshes" if of_all else ""
    columns = _format_count(one["columns"], "column", "columns")
    return f"{one['output']!r}: {columns} of {one['of']}{having}"


def _format_nodes(nodes: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each node, indented by its depth."""
    depths: list[int] = []
    for one in nodes:
        depths.append(0 if one["parent"] is None else depths[one["parent"]] + 1)
        held = "group"
        if one["object"] is not None:
            name = next((n for n in PRIMITIVE_NAMES.values() if one[n]), "faces")
            held = (
                f"object {one['object']}, {_format_count(one[name], name.removesuffix('s'), name)}"
            )
        yield f"{'  ' * depths[-1]}{one['name']!r}: {held}"


def _format_animation(one: dict[str, Any]) -> str:
    """Return a line on an animation."""
    channels = _format_count(one["channels"], "channel", "channels")
    return f"{one['name']!r}: {one['seconds']:.6g} s, {channels}"


def _format_joint(one: dict[str, Any]) -> str:
    """Return a line on a joint."""
    low, high = (f"{limit:.6g}" if limit is not None else "" for limit in one["limits"])
    within = f", {low}..{high}" if low or high else ""
    follows = "" if one["follows"] is None else f", follows {one['follows']!r}"
    return f"{one['name']!r}: {one['kind']} of {one['node']!r}{within}{follows}"


def _format_material(one: dict[str, Any]) -> str:
    """Return a line on a material."""
    parts = [one["shading"]]
    if one["base_color"] is not None:
        parts.append(f"base colour {_format_numbers(one['base_color'])}")
    if one["alpha_mode"] != "opaque":
        parts.append(one["alpha_mode"])
    if not one["double_sided"]:
        parts.append("single-sided")
    for name, (width, height) in one["textures"].items():
        parts.append(f"{name.replace('_', ' ')} {width}x{height}")
    return f"{', '.join(parts)} ({_format_count(one['objects'], 'object', 'objects')})"


def _format_fields(one: dict[str, Any]) -> str:
    """Return a line on a light or a camera."""
    parts = []
    for name, value in one.items():
        if name == "kind" or value is None or value is False:
            continue
        if value is True:
            parts.append(name)
        elif isinstance(value, list):
            flat = [part for row in value for part in row] if isinstance(value[0], list) else value
            parts.append(f"{name} {_format_numbers(flat)}")
        else:
            parts.append(f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}")
    return f"{one['kind']}: {', '.join(parts)}"


def _format_numbers(values: list[float]) -> str:
    """Return numbers in brackets."""
    return f"({', '.join(f'{value:.6g}' for value in values)})"


def _format_count(count: int, one: str, several: str) -> str:
    """Return a count with its noun."""
    return f"{count:,} {one if count == 1 else several}"
