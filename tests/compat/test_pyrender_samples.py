"""The adapter's pictures of samples are drawn without a pass at the centres of pixels."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rasterjit.compat import pyrender
from rasterjit.pipeline.fragments.constant_colors import average_codes
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.survey.plan import RenderPlan

SIZE = 90, 70


def scene_of(alpha: float) -> pyrender.Scene:
    """Return balls before each other, the nearest one of an alpha, and a camera inside a light."""
    scene = pyrender.Scene(bg_color=(0.2, 0.4, 0.6, 1.0), ambient_light=(0.1, 0.1, 0.1))
    for n, color in enumerate([(0.9, 0.2, 0.1, alpha), (0.1, 0.8, 0.3, 1.0)]):
        material = pyrender.MetallicRoughnessMaterial(
            baseColorFactor=color, alphaMode="BLEND" if alpha < 1.0 else "OPAQUE"
        )
        mesh = pyrender.Mesh.from_trimesh(trimesh.creation.icosphere(2), material=material)
        pose = np.eye(4)
        pose[:3, 3] = 0.6 * n, 0.3 * n, -0.8 * n
        scene.add(mesh, pose=pose)
    pose = np.eye(4)
    pose[2, 3] = 3.0
    scene.add(pyrender.PerspectiveCamera(yfov=0.9), pose=pose)
    scene.add(pyrender.DirectionalLight(intensity=3.0), pose=pose)
    return scene


def drawn(alpha: float, flags: int) -> tuple[np.ndarray, np.ndarray]:
    """Return color and depth of a scene, drawn by a renderer of its own."""
    renderer = pyrender.OffscreenRenderer(*SIZE)
    try:
        return renderer.render(scene_of(alpha), flags)
    finally:
        renderer.delete()


@pytest.mark.parametrize("flags", ["NONE", "ALL_WIREFRAME", "FLAT", "RGBA", "SHADOWS_POINT"])
@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_pictures_have_the_bits_of_those_with_centers(monkeypatch, alpha, flags):
    flags = pyrender.RenderFlags[flags]
    color, depth = drawn(alpha, flags)
    monkeypatch.setattr(RenderPlan, "needs_centers", True)
    again, depth_again = drawn(alpha, flags)

    assert (depth > 0.0).mean() > 0.1
    np.testing.assert_array_equal(color, again)
    np.testing.assert_array_equal(depth, depth_again)


def test_nothing_is_drawn_at_centers(monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("the tiles were drawn at the centres of pixels")

    monkeypatch.setattr(visibility_pass, "draw_tiles", refuse)
    _, depth = drawn(1.0, pyrender.RenderFlags.NONE)

    assert (depth > 0.0).any()


@pytest.mark.parametrize("flags", ["FLAT", "FLAT|ALL_WIREFRAME"])
def test_objects_of_one_colour_are_mixed_as_shaded_ones_are(monkeypatch, flags):
    bits = pyrender.RenderFlags.NONE
    for name in flags.split("|"):
        bits |= pyrender.RenderFlags[name]
    color, _ = drawn(1.0, bits)
    monkeypatch.setattr(RenderPlan, "mixes_plain_codes", False)
    shaded, _ = drawn(1.0, bits)

    # Both objects, what is behind them, and means of these.
    assert len(np.unique(color.reshape(-1, 3), axis=0)) > 3
    np.testing.assert_array_equal(color, shaded)


@pytest.mark.parametrize("samples", [2, 4, 16])
def test_plain_codes_are_means_rounded_half_up(samples):
    rng = np.random.default_rng(samples)
    starts = np.array([0, 3, 3, 40, 41], np.int64)
    # Mostly runs of one face, as in pictures; some rows of faces at random.
    opaque = np.repeat(rng.integers(-1, 41, (samples, 12, 10)), 10, axis=2).astype(np.int32)
    opaque[:, 6:] = opaque[0, 6:]
    opaque[:, :3] = rng.integers(-1, 41, (samples, 3, 100))
    codes, behind = rng.integers(0, 1 << 24, 4).astype(np.uint32), 0x123456
    color = np.empty((12, 100), np.uint32)
    opaque_codes = codes | np.uint32(0xFF000000)
    average_codes(opaque, opaque_codes, behind | 0xFF000000, starts, color)

    owners = np.searchsorted(starts, opaque, side="right") - 1
    shown = np.where(opaque < 0, behind | 0xFF000000, opaque_codes[owners]).astype(np.uint32)
    channels = shown.view(np.uint8).reshape(*shown.shape, 4).astype(np.float64)
    expected = np.floor(channels.mean(axis=0) + 0.5).astype(np.uint8)
    np.testing.assert_array_equal(color.view(np.uint8).reshape(12, 100, 4), expected)


def test_edges_follow_the_eye_there_and_back():
    scene, renderer = scene_of(1.0), pyrender.OffscreenRenderer(*SIZE)
    wires = pyrender.RenderFlags.ALL_WIREFRAME
    turned, straight = np.diag([-1.0, 1.0, -1.0, 1.0]), np.eye(4)
    turned[2, 3], straight[2, 3] = -3.0, 3.0
    seen = []
    for pose in (straight, turned, straight):
        scene.set_pose(scene.main_camera_node, pose)
        seen.append(renderer.render(scene, wires))
        # A scene of its own has no edges of an eye before.
        fresh = scene_of(1.0)
        fresh.set_pose(fresh.main_camera_node, pose)
        for ours, expected in zip(seen[-1], renderer.render(fresh, wires), strict=True):
            np.testing.assert_array_equal(ours, expected)
    renderer.delete()

    assert not np.array_equal(seen[0][1], seen[1][1])
    np.testing.assert_array_equal(seen[0][0], seen[2][0])
