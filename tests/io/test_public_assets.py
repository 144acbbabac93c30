"""
Public glTF files that packages bring: all triangles are drawn, what is left out is named.

Debian's ``assimp-testmodels`` has Khronos' BoxTextured, 2CylinderEngine, ClearCoatTest,
TextureTransformTest and others, some damaged on purpose; ``gradio`` has Duck and Fox. Neither has
reference pictures beside them, so how the pictures look is not compared with any. Without the
packages the tests are skipped.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj

PACKAGES = {"assimp-testmodels": Path("/usr/share/assimp/models/glTF2")}
_GRADIO = importlib.util.find_spec("gradio")
if _GRADIO is not None and _GRADIO.origin is not None:
    PACKAGES["gradio"] = Path(_GRADIO.origin).parent / "media_assets/models3d"
FILES = [
    path
    for folder in PACKAGES.values()
    for path in sorted(folder.rglob("*"))
    if path.suffix in (".gltf", ".glb")
]
LEFT_OUT = {
    "BoxBadNormals": "normals of length 0",
    "BoxTextured-glTF-pbrSpecularGlossiness/BoxTextured": "specular colour",
    "Cameras": "further camera",
    "texcoord_crash": "textures of mesh 'TopRightMesh', which has no coordinates for them",
    "badExtension": "KHR_texture_transform must be an object",
    "badNumber": "index is missing",
    "badObject": "pbrMetallicRoughness must be an object",
    "badUint": "the file has no texture -1",
}
"""Of files that are drawn with a warning: what it says."""
REFUSED = {
    "BoxTextured-glTF-techniqueWebGL/BoxTextured": "KHR_technique_webgl",
    "BoxWithInfinites": "vertices must be finite",
    "AllIndicesOutOfRange": "12 of 12 faces past the end",
    "IndexOutOfRange/IndexOutOfRange": "1 of 12 faces past the end",
    "MissingBin": "BoxTextured0.bin' beside it is missing",
    "RecursiveNodes": "holds no faces", "sceneWrongType": "scene must be a whole number",
    "NoScene": "holds no faces", "SceneWithoutNodes": "holds no faces",
    "badArray": "primitives must be a list",
}  # fmt: skip
"""Of files that cannot be drawn: why."""


def look_up(table, path):
    """Return the words of a table for a file."""
    return next((words for part, words in table.items() if part in path.as_posix()), None)


@functools.cache
def read_json(path):
    """Return the JSON of a file."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data)
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size])


def count_triangles(path):
    """Return how many triangles the nodes of a file's scene show."""
    content = read_json(path)
    accessors, nodes = content["accessors"], content["nodes"]

    def count_primitive(primitive):
        index = primitive.get("indices", primitive["attributes"]["POSITION"])
        corners, mode = accessors[index]["count"], primitive.get("mode", 4)
        return {4: corners // 3, 5: corners - 2, 6: corners - 2}.get(mode, 0)

    def count_node(number):
        node, total = nodes[number], 0
        if "mesh" in node:
            total = sum(map(count_primitive, content["meshes"][node["mesh"]]["primitives"]))
        return total + sum(map(count_node, node.get("children", ())))

    roots = content["scenes"][content.get("scene", 0)]["nodes"]
    return sum(map(count_node, roots))


@pytest.mark.skipif(not FILES, reason="needs Debian's package assimp-testmodels, or gradio")
@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_public_files_are_drawn_whole_or_say_what_lacks(path):
    reason = look_up(REFUSED, path)
    if reason is not None:
        with pytest.raises(rj.MeshFileError, match=re.escape(reason)):
            rj.load(path)
        return
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        scene = rj.load(path)
    words = look_up(LEFT_OUT, path)
    if words is None:
        assert not told
        triangles = [n.mesh for n in scene.nodes if n.mesh.primitive == "triangles"]
        assert sum(len(mesh.faces) for mesh in triangles) == count_triangles(path)
    else:
        assert any(words in str(one.message) for one in told)
    camera = rj.fit_camera(scene, direction=(0.4, 0.3, 1.0))
    frame = rj.render(scene, camera, size=(64, 48), outputs=("color", "face_id"))
    is_drawn = frame.face_id >= 0
    assert np.mean(is_drawn) > 0.01
    if words is None and read_json(path).get("images"):
        assert len(np.unique(frame.color[is_drawn], axis=0)) > 16
