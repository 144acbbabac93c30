"""Normals between vertices are scaled to length one, or lit as interpolation leaves them."""

from __future__ import annotations

import blocks
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.lighting import light_stages
from rasterjit.pipeline.surface import sample_block as block
from rasterjit.scene import transforms as tf
from rasterjit.survey.object_transforms import (
    have_uniform_scales,
    normalize_normal_matrices,
    transform_objects,
)

AS_IT_IS = rj.Quality(renormalize=False)
SIZE = (33, 33)
ABOVE = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=33.0, near=0.5, far=10.0)
"""Shows one unit as a pixel; (0, 0) is the middle of pixel (16, 16)."""
SUMMED = 2.0**-20
"""Relative error of a colour added up in another order: sixteen float32 roundings."""

CORNERS = np.array([(-12, -12, 0), (12, -12, 0), (0, 12, 0)], float)
"""In the middles of pixels."""
BENT = np.array([(-0.8, 0, 0.6), (0.8, 0, 0.6), (0, 0.96, 0.28)])
"""Far apart: between them they are short."""


def triangle(normals=BENT, **options):
    material = rj.Material(**{"specular": 0.0, "base_color": "white", **options})
    return rj.Mesh(CORNERS, [(0, 1, 2)], normals=normals, material=material)


def scene_of(mesh, place=None, lights=None):
    scene = rj.Scene()
    scene.add(mesh, place)
    scene.lights = lights or [rj.DirectionalLight((0.2, -0.1, -1), intensity=0.7)]
    return scene


def shown(scene, camera=ABOVE, quality=AS_IT_IS, outputs=("linear",)):
    return rj.render(scene, camera, size=SIZE, quality=quality, outputs=outputs, threads=1)


def interpolated(frame, normals, rotation=None):
    """Normals at the pixels of the triangle, (N, 3) float64, as interpolation leaves them."""
    weights = frame.barycentric[frame.face_id >= 0].astype(np.float64)
    mixed = weights @ normals
    return mixed if rotation is None else mixed @ rotation[:3, :3].T


def test_normals_as_they_are_give_lambert_of_short_normals():
    frame = shown(scene_of(triangle()), outputs=("linear", "barycentric", "face_id"))
    toward = np.array([-0.2, 0.1, 1.0]) / np.linalg.norm([-0.2, 0.1, 1.0])
    normals = interpolated(frame, BENT)
    wanted = 0.7 * np.maximum(normals @ toward, 0.0)
    found = frame.linear[frame.face_id >= 0][:, :3].astype(np.float64)
    assert found == pytest.approx(np.repeat(wanted[:, np.newaxis], 3, axis=1), rel=SUMMED, abs=1e-6)
    assert np.linalg.norm(normals, axis=1).min() < 0.6


@pytest.mark.parametrize("shading", ["phong", "pbr"])
def test_short_normals_are_lit_less_and_those_of_vertices_alike(shading):
    # Three faces around a vertex in the middle of the middle pixel.
    fan = rj.Mesh(
        [*CORNERS, (0, 0, 0)], [(0, 1, 3), (1, 2, 3), (2, 0, 3)], normals=[*BENT, (0.6, 0, 0.8)],
        material=rj.Material(shading, "white", specular=0.0, roughness=1.0),
    )  # fmt: skip
    scene = scene_of(fan)
    standard = shown(scene, quality=None, outputs=("linear", "face_id"))
    inside, standard = standard.face_id >= 0, standard.linear[..., :3]
    found = shown(scene).linear[..., :3]
    assert found[16, 16] == pytest.approx(standard[16, 16], rel=1e-6)
    inside[16, 16] = False
    lit = inside & (standard[..., 0] > 0.0)
    assert (found[lit] < standard[lit]).all()
    assert (found[lit] / standard[lit]).min() < 0.8


@pytest.mark.parametrize("shading", ["phong", "pbr", "gouraud", "flat", "unlit"])
def test_normals_of_length_one_look_the_same(shading):
    straight = np.tile((0.0, 0.0, 1.0), (3, 1))
    scene = scene_of(triangle(straight, shading=shading, specular=0.5))
    assert shown(scene).linear.tobytes() == shown(scene, quality=None).linear.tobytes()


@pytest.mark.parametrize("shading", ["gouraud", "flat", "unlit"])
def test_what_interpolates_no_normals_looks_the_same(sphere, camera, shading):
    ball = rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material(shading))
    place = tf.compose(tf.rotate_x(20.0), tf.scale((1.0, 2.0, 1.5)))
    found, standard = (
        shown(scene_of(ball, place), camera, quality).linear for quality in (AS_IT_IS, None)
    )
    assert found == pytest.approx(standard, rel=SUMMED)


def test_the_buffer_of_normals_has_length_one_and_is_the_same(sphere, camera):
    scene = scene_of(sphere, tf.compose(tf.rotate_x(20.0), tf.scale((0.3, 0.3, 0.3))))
    found, standard = (
        shown(scene, camera, quality, ("normal", "face_id")) for quality in (AS_IT_IS, None)
    )
    assert found.normal.tobytes() == standard.normal.tobytes()


@pytest.mark.parametrize("scale", [(1, 1, 1), (40, 40, 40), (1e-3, 1e-3, -1e-3)])
def test_the_scale_of_an_object_does_not_change_its_light(scale):
    turn = tf.compose(tf.rotate((1, 2, 3), 50.0), tf.scale(scale))
    mesh = triangle()
    points = rj.transforms.transform_points(np.linalg.inv(turn), CORNERS)[:, :3]
    normals = BENT @ turn[:3, :3] / abs(scale[0])
    faces = mesh.faces if scale[2] > 0 else mesh.faces[:, ::-1]
    placed = rj.Mesh(points, faces, normals=normals, material=mesh.material)
    found = shown(scene_of(placed, turn)).linear
    assert found == pytest.approx(shown(scene_of(mesh)).linear, rel=1e-5, abs=1e-6)


def test_an_object_scaled_unevenly_is_lit_as_ever():
    for place, is_scaled in (
        (tf.scale((1, 1, 1.1)), True), (tf.shear(xy=0.1), True), (tf.scale((2, 2, 2)), False),
        (tf.compose(tf.rotate_y(33.0), tf.scale((-1, 1, 1))), False),
    ):  # fmt: skip
        scene = scene_of(triangle(), place)
        plan = rj.explain(scene, ABOVE, AS_IT_IS, size=SIZE)
        assert bool(plan.lighting.renormalizes) == is_scaled
        reason = {effect.name: effect.reason for effect in plan.effects}["smooth normals"]
        assert reason.startswith("shading phong; quality.renormalize is False")
        assert ("scaled unevenly" in reason) == is_scaled
        if is_scaled:
            found, standard = shown(scene).linear, shown(scene, quality=None).linear
            assert found.tobytes() == standard.tobytes()


def test_normals_under_maps_are_scaled(sphere, camera):
    bumps = rj.Texture([[(0.6, 0.4, 0.9), (0.4, 0.6, 0.9)]], color_space="linear")
    bumpy = rj.Mesh(
        sphere.vertices, sphere.faces, uv=sphere.vertices[:, :2],
        material=rj.Material(normal_texture=bumps, normal_scale=3.0),
    )  # fmt: skip
    scene = scene_of(bumpy)
    plan = rj.explain(scene, camera, AS_IT_IS, size=SIZE)
    assert plan.lighting.renormalizes
    reason = {effect.name: effect.reason for effect in plan.effects}["smooth normals"]
    assert reason == "shading phong; quality.renormalize is False, but not under normal maps"
    found, standard = shown(scene, camera).linear, shown(scene, camera, None).linear
    assert found.tobytes() == standard.tobytes()


def test_what_is_out_of_view_decides_nothing(sphere, camera):
    scene = scene_of(sphere)
    scene.add(sphere, tf.compose(tf.translate((500.0, 0.0, 0.0)), tf.scale((1, 2, 3))))
    assert not rj.explain(scene, camera, AS_IT_IS, size=SIZE).lighting.renormalizes


def test_a_standard_plan_scales_and_says_nothing_of_it(sphere, camera):
    plan = rj.explain(sphere, camera, size=SIZE)
    assert plan.lighting.renormalizes == 1
    assert "renormalize" not in str(plan)


def test_the_pixel_told_is_that_of_the_frame(sphere, camera):
    scene = scene_of(sphere, tf.compose(tf.rotate_x(20.0), tf.scale((1.3, 1.3, 1.3))))
    frame = shown(scene, camera, outputs=("linear", "face_id"))
    y, x = np.argwhere(frame.face_id >= 0)[100]
    told = rj.explain_pixel(scene, camera, SIZE, int(x), int(y), quality=AS_IT_IS)
    assert told.linear.tobytes() == frame.linear[y, x].tobytes()


def test_even_scales_are_told_from_others():
    matrices = [
        np.eye(4), tf.rotate((3, 1, 2), 77.0), tf.scale((1e150,) * 3), tf.scale((1e-150,) * 3),
        tf.scale((1, -1, 1)), tf.translate((9, 9, 9)), tf.scale((1.0, 1.0, 1.0 + 1e-6)),
    ]  # fmt: skip
    assert have_uniform_scales(np.array(matrices)).all()
    uneven = [
        tf.scale((1, 1, 1.01)), tf.shear(xy=0.01), np.diag((1.0, 1.0, 0.0, 1.0)), np.zeros((4, 4)),
        tf.scale((1e150, 1, 1)),
    ]  # fmt: skip
    assert not have_uniform_scales(np.array(uneven)).any()
    assert have_uniform_scales(np.zeros((0, 4, 4))).all()


def test_matrices_of_normals_keep_lengths_where_objects_are_scaled_evenly():
    rng = np.random.default_rng(3)
    matrices = [
        tf.compose(tf.rotate(rng.normal(size=3), angle), tf.scale((scale,) * 3))
        for angle, scale in zip(rng.uniform(0, 360, 20), rng.uniform(1e-3, 1e3, 20), strict=True)
    ]
    kept = normalize_normal_matrices(
        transform_objects([*matrices, np.diag((0.0, 0.0, 0.0, 1.0))]).normal_matrices
    )
    assert np.linalg.norm(kept[:-1] @ (0.6, 0.0, 0.8), axis=1) == pytest.approx(1.0, abs=1e-12)
    assert not kept[-1].any()


def test_vertices_are_lit_with_normals_of_length_one():
    samples = np.zeros((block.SAMPLE_ROWS, 4), np.float32)
    samples[block.NORMAL_Z] = 0.5
    blocks.run(samples, (light_stages.normalize_normals,))
    assert (samples[block.NORMAL_Z] == 1.0).all()
