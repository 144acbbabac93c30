"""What a glTF file says beyond trimesh's reading of it: lights, cameras, unlit materials."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.left_out import LeftOut
from rasterjit.io.trimesh_textures import gltf_samplers
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.scene.light import DirectionalLight, Light, PointLight
from rasterjit.transforms import compose

_LIGHTS = "KHR_lights_punctual"
_UNLIT = "KHR_materials_unlit"
_GLB_MAGIC = b"glTF"
_JSON_CHUNK = 0x4E4F534A


class GltfExtras:
    """
    Lights, camera and unlit materials of a glTF file.

    Parameters
    ----------
    header : dict
        The file's JSON.
    left_out : LeftOut
        Notes what cannot be shown.

    Attributes
    ----------
    camera : PerspectiveCamera, OrthographicCamera or None
        The first camera of the scene.
    lights : list of DirectionalLight or PointLight
        Intensities are taken as they are: candela and lux are the engine's units of 1.
    unlit : set of str or None
        Names of the materials to show without light.
    parent_from_node : dict of str to (4, 4) float64
        Every node's own transform, by the name that trimesh gives it.
    samplers : dict of str or None to dict
        How materials sample their base colour, by name.
    """

    def __init__(self, header: dict[str, Any], left_out: LeftOut) -> None:
        self.camera: PerspectiveCamera | OrthographicCamera | None = None
        self.lights: list[Light] = []
        self.unlit: set[str | None] = _unlit_names(header.get("materials", []))
        self.parent_from_node = _named_transforms(header.get("nodes", []))
        self.samplers = gltf_samplers(header, left_out)
        cameras = header.get("cameras", [])
        lights = header.get("extensions", {}).get(_LIGHTS, {}).get("lights", [])
        for node, world_from_node in _walk(header):
            if "camera" in node:
                self._add_camera(cameras[node["camera"]], world_from_node, left_out)
            light = node.get("extensions", {}).get(_LIGHTS, {}).get("light")
            if light is not None:
                self._add_light(lights[light], world_from_node, left_out)

    def _add_camera(
        self, camera: dict[str, Any], world_from_node: NDArray[np.float64], left_out: LeftOut
    ) -> None:
        """Keep the first camera, which looks along its node's -z."""
        if self.camera is not None:
            left_out.note("further camera")
            return
        kind = camera.get("type")
        values = camera.get(kind, {})
        eye, ahead, up = world_from_node[:3, 3], -world_from_node[:3, 2], world_from_node[:3, 1]
        try:
            clip = {"near": values["znear"], "far": values.get("zfar", math.inf)}
            if kind == "orthographic":
                self.camera = OrthographicCamera(
                    eye, eye + ahead, up, height=2.0 * values["ymag"], **clip
                )
            else:
                fov_y = math.degrees(values["yfov"])
                self.camera = PerspectiveCamera(eye, eye + ahead, up, fov_y=fov_y, **clip)
        except (KeyError, TypeError, ValueError):
            left_out.note("incomplete camera")

    def _add_light(
        self, light: dict[str, Any], world_from_node: NDArray[np.float64], left_out: LeftOut
    ) -> None:
        """
        Add a light, which shines along its node's -z or from its origin.

        glTF's diffuse surface sends back 1/pi of the light that falls on it (lux, or candela over
        distance squared); ours, all of it. So intensities are divided by pi.
        """
        kind, color = light.get("type"), light.get("color", (1.0, 1.0, 1.0))
        try:
            intensity = light.get("intensity", 1.0) / math.pi
            if kind == "directional":
                self.lights.append(DirectionalLight(-world_from_node[:3, 2], color, intensity))
            elif kind == "point":
                self.lights.append(PointLight(world_from_node[:3, 3], color, intensity))
            else:
                left_out.note(f"{kind} light")
                return
        except (TypeError, ValueError):
            left_out.note("incomplete light")
            return
        if "range" in light:
            left_out.note("range of a light")


def read_gltf_header(path: Path) -> dict[str, Any]:
    """
    Return the JSON of a ``.gltf`` or ``.glb`` file.

    Raises
    ------
    ValueError
        If it holds none.
    """
    data = path.read_bytes()
    if data[:4] == _GLB_MAGIC:
        length, kind = struct.unpack_from("<II", data, 12)
        if kind != _JSON_CHUNK:
            raise ValueError("the first chunk is not JSON")
        data = data[20 : 20 + length]
    header = json.loads(data)
    if not isinstance(header, dict):
        raise ValueError("the JSON is not an object")
    return header


def _unlit_names(materials: list[dict[str, Any]]) -> set[str | None]:
    """Return the names that stand for unlit materials only."""
    unlit = {m.get("name") for m in materials if _UNLIT in m.get("extensions", {})}
    return unlit - {m.get("name") for m in materials if _UNLIT not in m.get("extensions", {})}


def _named_transforms(nodes: list[dict[str, Any]]) -> dict[str, NDArray[np.float64]]:
    """Return the nodes' own transforms by the names that trimesh makes unique, in its order."""
    from trimesh.util import unique_name

    named: dict[str, NDArray[np.float64]] = {}
    counts: dict[str | None, int] = {}
    for number, node in enumerate(nodes):
        name = unique_name(node.get("name", str(number)), named, counts=counts)
        named[name] = _parent_from_node(node)
    return named


def _walk(header: dict[str, Any]) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
    """Yield every node of the file's scene with its ``world_from_node``."""
    nodes, scenes = header.get("nodes", []), header.get("scenes", [])
    if not scenes:
        return
    waiting = [(i, np.eye(4)) for i in reversed(scenes[header.get("scene", 0)].get("nodes", []))]
    seen: set[int] = set()
    while waiting:
        index, world_from_parent = waiting.pop()
        if index in seen:
            continue
        seen.add(index)
        node = nodes[index]
        world_from_node = compose(world_from_parent, _parent_from_node(node))
        yield node, world_from_node
        waiting += [(child, world_from_node) for child in reversed(node.get("children", []))]


def _parent_from_node(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's own transform: its matrix, or translation, rotation and scale."""
    if "matrix" in node:
        # glTF writes matrices column by column.
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    # A quaternion in float32 is a unit one to seven digits only.
    squared = ((x * x + y * y) + z * z) + w * w
    double = 2.0 / squared if squared > 0.0 else 0.0
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1.0 - double * (y * y + z * z), double * (x * y - z * w), double * (x * z + y * w)],
        [double * (x * y + z * w), 1.0 - double * (x * x + z * z), double * (y * z - x * w)],
        [double * (x * z - y * w), double * (y * z + x * w), 1.0 - double * (x * x + y * y)],
    ]
    matrix[:3, :3] *= node.get("scale", (1.0, 1.0, 1.0))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
