"""Bumpy grounds in the light of a scene, drawn in float32 and in float64."""

from __future__ import annotations

import numpy as np

import rasterjit as rj

SIZE = 160, 120
SIXTEENTH = 1.0 / 16.0
SUN = rj.DirectionalLight((-0.3, -1.0, -0.5))
EYES = {
    "above": rj.PerspectiveCamera((0.4, 1.6, 2.2), (0.0, 0.0, 0.0)),
    "inside": rj.PerspectiveCamera((0.1, 0.35, 0.3), (-1.0, 0.2, -2.0), near=0.02),
    "flat": rj.OrthographicCamera((0.4, 1.6, 2.2), (0.0, 0.0, 0.0)),
}
OUTPUTS = "color", "linear", "face_id"


def hills(squares=9, seed=1, lights=(SUN,), bent=0.4, colored=True, **material):
    """Return a bumpy ground; ``bent`` is how far normals lean at random."""
    random = np.random.default_rng(seed)
    x, z = (
        values.ravel() for values in np.meshgrid(*[np.linspace(-2.0, 2.0, squares + 1)] * 2)
    )  # fmt: skip
    points = np.stack([x, random.uniform(-0.2, 0.2, len(x)), z], axis=-1)
    first = (np.arange(squares)[:, None] * (squares + 1) + np.arange(squares)).ravel()
    a, b, c, d = first, first + 1, first + squares + 1, first + squares + 2
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    normals = random.normal(0.0, bent, points.shape) + (0.0, 1.0, 0.0)
    colors = random.uniform(0.0, 1.0, points.shape) if colored else None
    kind = {"shading": "phong", "specular": 0.5, "shininess": 40.0, **material}
    mesh = rj.Mesh(points, faces, normals=normals, colors=colors, material=rj.Material(**kind))
    scene = rj.Scene()
    scene.add(mesh)
    scene.lights = list(lights)
    return scene


def codes(linear):
    """Return sRGB codes before they are rounded."""
    light = np.clip(np.float64(linear[..., :3]), 0.0, 1.0)
    dark = light <= 0.0031308
    return 255.0 * np.where(
        dark, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )


def pair(scene, camera, **settings):
    """Return a frame in float32 and one in float64."""
    assert rj.explain(scene, camera, size=SIZE).facts.limits is not None
    qualities = (
        rj.Quality(**settings, interpolation_precision=level) for level in ("adaptive", "float64")
    )
    return [
        rj.render(scene, camera, quality=quality, size=SIZE, outputs=OUTPUTS)
        for quality in qualities
    ]
