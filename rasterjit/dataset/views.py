"""From where a mesh is seen."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

from rasterjit import transforms
from rasterjit.animation.turning import FULL_TURN, measured
from rasterjit.dataset.recipe import Recipe
from rasterjit.scene.camera import Bounded, PerspectiveCamera, fit_camera, orbit_direction
from rasterjit.viewpoint import frame_of

Direction = tuple[float, float, float]

GOLDEN_ANGLE = FULL_TURN / 2.0 * (3.0 - math.sqrt(5.0))
"""Degrees from one point of the lattice to the next: no two lie above each other."""


def view_cameras(scene: Bounded, recipe: Recipe, name: str = "") -> list[PerspectiveCamera]:
    """
    Return the cameras of a mesh, all at one distance from the middle of its bounding box.

    The distance fits the bounding sphere into the picture; the units are those of the mesh.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe
    name : str
        Of the mesh: with the recipe's seed it decides about views at random.

    Raises
    ------
    ValueError
        If the scene has no extent that a camera fits.
    """
    frame = frame_of(recipe.up)
    upward = transforms.apply(frame, (0.0, 1.0, 0.0))
    sphere = measured(scene)
    return [
        fit_camera(
            sphere,
            transforms.apply(frame, direction),
            recipe.fov_y,
            up=upward,
            aspect=recipe.size[0] / recipe.size[1],
        )
        for direction in _directions(recipe, name)
    ]


def _directions(recipe: Recipe, name: str) -> Iterator[Direction]:
    """Yield where the cameras are, seen from the mesh, y up, of unit length."""
    count = recipe.views
    if recipe.layout == "ring":
        for number in range(count):
            yield orbit_direction(FULL_TURN * number / count, recipe.elevation)
    elif recipe.layout == "sphere":
        for number in range(count):
            yield _on_sphere(1.0 - (2 * number + 1) / count, GOLDEN_ANGLE * number)
    else:
        # Python promises the same numbers for the same text on every machine.
        source = random.Random(f"{recipe.seed}/{name}")
        for _ in range(count):
            height = 2.0 * source.random() - 1.0
            yield _on_sphere(height, FULL_TURN * source.random())


def _on_sphere(height: float, azimuth: float) -> Direction:
    """Return a point of the unit sphere; equal steps of height have equal areas (Archimedes)."""
    sine, cosine = transforms.sine_cosine(azimuth)
    radius = math.sqrt(1.0 - height * height)
    return radius * sine, height, radius * cosine
