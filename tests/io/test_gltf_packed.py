"""
``models/scene.glb`` as other programs pack it, drawn beside the original.

In ``packed/``, all of npm packages, gltfpack 1.3.0 and @gltf-transform/cli 4.5.1::

    gltfpack -i scene.glb -o gltfpack.glb -cc -mi
    gltfpack -i scene.glb -o gltfpack_khr.glb -cc -ce khr -vpf -vtf
    gltf-transform webp scene.glb w.glb
    gltf-transform draco w.glb gltf_transform.glb
    gltf-transform meshopt w.glb gltf_transform_meshopt.glb
"""

import json
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj

PACKED = Path(__file__).parent / "packed"
ORIGINAL = Path(__file__).parents[2] / "models/scene.glb"
SIZE = (192, 192)

EXTENSIONS = {
    "gltfpack": {"EXT_meshopt_compression", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing"},
    "gltfpack_khr": {"KHR_meshopt_compression", "KHR_mesh_quantization"},
    "gltf_transform": {"KHR_draco_mesh_compression", "EXT_texture_webp"},
    "gltf_transform_meshopt": {"EXT_meshopt_compression", "EXT_texture_webp"},
}


@pytest.fixture(scope="module")
def original():
    """Return the camera of the original, and its picture and depths."""
    scene = rj.load(ORIGINAL)
    return scene.camera, rj.render(scene, scene.camera, size=SIZE, outputs=("color", "depth"))


@pytest.mark.parametrize("name", EXTENSIONS)
def test_a_packed_scene_looks_like_the_original(name, original):
    pytest.importorskip("DracoPy" if name == "gltf_transform" else "meshopt")
    content = (PACKED / f"{name}.glb").read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    required = json.loads(content[20 : 20 + length])["extensionsRequired"]
    assert EXTENSIONS[name] <= set(required)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = rj.load(PACKED / f"{name}.glb")
    assert len(scene.nodes) == 6
    camera, wanted = original
    frame = rj.render(scene, camera, size=SIZE, outputs=("color", "depth"))
    apart = np.abs(frame.color.astype(int) - wanted.color).max(axis=2)
    # Rounded positions move edges by a fraction of a pixel; WebP's colours lose a little.
    assert apart.mean() < 0.8
    assert (apart > 24).mean() < 2e-3
    both = np.isfinite(frame.depth) & np.isfinite(wanted.depth)
    assert (np.isfinite(frame.depth) != np.isfinite(wanted.depth)).mean() < 1e-3
    assert np.median(np.abs(frame.depth[both] - wanted.depth[both])) < 2e-3
