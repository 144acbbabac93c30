"""
Animated glTF files are posed as the specification says: ours, and those that packages bring.

What is expected is worked out by `naive_animation` from the files' own bytes. The files of others
are not kept here: Debian's ``assimp-testmodels`` brings two, and ``assimp-utils`` makes glTF of its
animated characters in other formats. Without these packages their tests are skipped.
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from naive_animation import NaiveGltf

import rasterjit as rj

OURS = Path(__file__).parents[2] / "models"
PACKAGE = Path("/usr/share/assimp/models")
READY = {
    "simple_skin": "glTF2/simple_skin/simple_skin.gltf",
    "AnimatedMorphCube": "glTF2/glTF-Sample-Models/AnimatedMorphCube-glTF/AnimatedMorphCube.gltf",
}
"""glTF files of assimp-testmodels."""
CONVERTED = {
    "Testwuson": "X/Testwuson.X",
    "BCN_Epileptic": "X/BCN_Epileptic.X",
    "animation_with_skeleton": "FBX/animation_with_skeleton.fbx",
    "Boxing_Toes": "BVH/Boxing_Toes.bvh",
    "full_rotations": "Collada/anims_with_full_rotations_between_keys.DAE",
}
"""Files of assimp-testmodels that ``assimp export`` makes glTF of."""
FILES = ("tentacle", "figure", "face", *READY, *CONVERTED)

FLOAT64_ROUNDING = 1e-11
"""Greatest error of positions, in sizes of the file: the roundings of a chain of 30 joints."""
FLOAT32_ROUNDING = 3e-7
"""Greatest error of unit normals, which are stored in float32."""
SAVED = 3e-6
"""The same of a file that was read and written again, in largest coordinates."""
SNAPPED = 2e-3
"""Pixels that a motion may be off: those of barycentric weights in float32."""
SIZE = (96, 72)


@pytest.fixture(scope="module")
def file(request, tmp_path_factory):
    """Return the path of a file."""
    name = request.param
    if name in READY or name in CONVERTED:
        if not PACKAGE.is_dir():
            pytest.skip("needs Debian's package assimp-testmodels")
        if name in READY:
            return PACKAGE / READY[name]
        if shutil.which("assimp") is None:
            pytest.skip("needs Debian's package assimp-utils")
        made = tmp_path_factory.mktemp("converted") / f"{name}.glb"
        command = ["assimp", "export", str(PACKAGE / CONVERTED[name]), str(made)]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        return made
    return OURS / f"{name}.glb"


every_file = pytest.mark.parametrize("file", FILES, indirect=True)


@functools.cache
def opened(path):
    """Return a file as the oracle reads it, and as `rasterjit.load` does."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return NaiveGltf(path), rj.load(path)


def moments(oracle, animation):
    """Return times before the first key, on keys, between them and after the last."""
    keys = oracle.key_times(animation)
    few = [keys[k] for k in sorted({0, len(keys) // 3, len(keys) // 2, len(keys) - 1})]
    span = keys[-1] - keys[0]
    between = [keys[0] + span * share for share in (0.013, 0.37, 0.5001, 0.96)]
    return [keys[0] - 0.5, *few, *between, keys[-1] + 0.5]


def compare(expected, scene):
    """Check that a scene's nodes are where the oracle has them."""
    nodes = scene.posed().nodes
    assert len(nodes) == len(expected)
    everything = np.concatenate([one.positions for one in expected])
    size = np.linalg.norm(np.ptp(everything, axis=0)) + np.abs(everything).max()
    for one, node in zip(expected, nodes, strict=True):
        places = rj.transforms.apply(node.world_from_model, node.mesh.vertices)
        corners = places[node.mesh.faces]
        np.testing.assert_allclose(
            corners, one.positions[one.faces], atol=FLOAT64_ROUNDING * size, rtol=0.0
        )
        if one.normals is None:
            continue
        axes = rj.transforms.inverse(node.world_from_model)[:3, :3]
        normals = node.mesh.normals.astype(float) @ axes
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        there = one.normals[one.faces]
        # Where a normal of the file has no length, there is nothing to be seen.
        has_length = np.isclose(np.linalg.norm(there, axis=2), 1.0)
        assert has_length.mean() > 0.9
        apart = np.abs(normals[node.mesh.faces] - there).max(axis=2)
        assert apart[has_length].max() < FLOAT32_ROUNDING


@every_file
def test_poses_at_all_times_are_those_of_the_equations(file):
    oracle, scene = opened(file)
    assert len(oracle.animations) == len(scene.animations) > 0
    for number, (name, duration) in enumerate(oracle.animations):
        animation = scene.animations[number]
        assert name is None or animation.name == name
        assert animation.duration == pytest.approx(duration, abs=1e-12)
        for time in moments(oracle, number):
            compare(oracle.pose(time, number), scene.at(time, number))


@every_file
def test_a_plain_load_has_the_pose_of_the_file(file):
    oracle, scene = opened(file)
    compare(oracle.pose(), scene)


@every_file
def test_a_saved_file_has_the_same_poses(file, tmp_path):
    """What is written, read by the oracle, is where the file was, to the float32 of glTF."""
    oracle, scene = opened(file)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene.save(tmp_path / "saved.glb")
    saved = NaiveGltf(tmp_path / "saved.glb")
    assert len(saved.animations) == len(oracle.animations)
    for number, (_, duration) in enumerate(oracle.animations):
        for time in (0.0, 0.37 * duration, duration):
            expected, found = (one.pose(time, number) for one in (oracle, saved))
            places = np.concatenate([one.positions[one.faces] for one in expected])
            again = np.concatenate([one.positions[one.faces] for one in found])
            np.testing.assert_allclose(again, places, atol=SAVED * np.abs(places).max(), rtol=0.0)


@every_file
def test_before_the_first_key_and_after_the_last_the_keys_hold(file):
    _, scene = opened(file)
    for number, animation in enumerate(scene.animations):
        first = min(channel.times[0] for channel in animation.channels)
        last = animation.duration
        for outside, key in ((first - 10.0, first), (last + 10.0, last)):
            there, here = (scene.at(time, number).posed().nodes for time in (outside, key))
            for one, other in zip(there, here, strict=True):
                places, at_key = (
                    rj.transforms.apply(node.world_from_model, node.mesh.vertices)
                    for node in (one, other)
                )
                rounding = 1e-13 * np.abs(at_key).max()
                np.testing.assert_allclose(places, at_key, rtol=0.0, atol=rounding)


def project(points, camera):
    """Return the places of world points on the screen, pixels."""
    clip = rj.transforms.apply(camera.view_matrix(), points)
    clip = np.c_[clip, np.ones(len(clip))] @ np.array(camera.projection_matrix(SIZE)).T
    return (clip[:, :2] / clip[:, 3:] * (1, -1) + 1.0) / 2.0 * SIZE


def seen_points(frame, posed):
    """Return where the points that are seen lie by the oracle, (N, 3)."""
    corners = np.concatenate([one.positions[one.faces] for one in posed])
    hit = frame.face_id >= 0
    weights = frame.barycentric[hit].astype(float)
    return (corners[frame.face_id[hit]] * weights[:, :, np.newaxis]).sum(axis=1)


@every_file
def test_motion_is_the_difference_of_the_projected_positions(file):
    oracle, scene = opened(file)
    moved = 0.0
    for number, (_, duration) in enumerate(oracle.animations):
        for now, before in ((0.31, 0.27), (0.7, 0.55), (0.5, 0.5)):
            here, there = now * duration, before * duration
            shown = scene.at(here, number)
            camera = rj.fit_camera(shown, rj.orbit_direction(25.0, 15.0), aspect=4 / 3)
            frame = rj.render(
                shown, camera, size=SIZE, outputs=("motion", "face_id", "barycentric"),
                previous=rj.PreviousView(scene.at(there, number), camera), threads=1,
            )  # fmt: skip
            hit = frame.face_id >= 0
            assert hit.any()
            found = project(seen_points(frame, oracle.pose(here, number)), camera)
            was = project(seen_points(frame, oracle.pose(there, number)), camera)
            np.testing.assert_allclose(frame.motion[hit], found - was, atol=SNAPPED)
            row, column = np.nonzero(hit)
            np.testing.assert_allclose(found, np.c_[column, row] + 0.5, atol=0.02)
            if now == before:
                assert (frame.motion[hit] == 0.0).all()
            moved = max(moved, np.abs(frame.motion[hit]).max())
    assert moved > 0.25
