"""What the colour of one pixel is mixed from: the faces that it shows, and what is behind all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rasterjit import layered, passes
from rasterjit.explanation import ColorPart
from rasterjit.kernels.records import Lighting, Surface
from rasterjit.kernels.setup import TILE_SIZE
from rasterjit.pixel_light import Drawn, owner_of, shade
from rasterjit.scene.quality import SUPERSAMPLED
from rasterjit.workers import Workers

CODES = ", and what mixing 8-bit codes differs by"
"""Codes do not add up as light does."""

Shares = dict[int, float]
"""How much of a pixel each face makes up, from 0 to 1; the visible one comes first."""


def parts_of(
    drawn: Drawn,
    surface: Surface,
    lighting: Lighting | None,
    own: NDArray[np.float32],
    linear: NDArray[np.float32],
    x: int,
    y: int,
) -> tuple[ColorPart, ...]:
    """
    Return the parts of a pixel's colour, the visible face first; none if nothing else is seen.

    Parameters
    ----------
    drawn : Drawn
    surface, lighting : records
    own : (4,) float32, linear
        The colour of the visible face, or what is behind all, where its centre shows none.
    linear : (4,) float32, linear
        The pixel's, which the parts add up to.
    x, y : int
    """
    winner, quality = int(drawn.coverage.face_id[y, x]), drawn.plan.quality
    if quality.samples in SUPERSAMPLED and winner >= 0:
        mean = f"what the mean of {quality.samples} samples, each shaded by itself, differs by"
        return (
            ColorPart(_name_of(drawn, winner), winner, 1.0, 1.0, own[:3]),
            ColorPart(mean, None, 1.0, 1.0, linear[:3] - own[:3]),
        )
    if drawn.plan.layers is None or quality.samples in SUPERSAMPLED:
        return ()
    drawn = _at_samples(drawn)
    colors = {winner: own} if winner >= 0 else {}
    shares: Shares = dict.fromkeys(colors, 0.0)
    behind = 0.0
    for faces, weight in _find_samples(drawn, surface, lighting, x, y):
        through = weight
        for face in faces:
            if face not in colors:
                colors[face] = shade(drawn, surface, lighting, x, y, face)
            alpha = _alpha_of(drawn, face, colors[face])
            shares[face] = shares.get(face, 0.0) + through * alpha
            through *= 1.0 - alpha
        behind += through
    shares = {face: share for face, share in shares.items() if share > 0.0 or face == winner}
    if shares in ({winner: 1.0}, {}):
        return ()
    opacity = float(linear[3]) or 1.0
    parts = [
        ColorPart(
            _name_of(drawn, face), face, _alpha_of(drawn, face, colors[face]), share / opacity,
            _scaled(share / opacity, colors[face][:3]),
        )
        for face, share in shares.items()
    ]  # fmt: skip
    rest = linear[:3] - sum(part.color for part in parts)
    has_sky = drawn.plan.backdrop is not None
    alpha = 1.0 if has_sky else float(drawn.plan.background[3])
    if behind * alpha > 0.0:
        name = "environment" if has_sky else "background"
        name += CODES if quality.blending == "srgb8" else ""
        parts.append(ColorPart(name, None, alpha, behind * alpha / opacity, rest))
    elif quality.blending == "srgb8":
        parts.append(ColorPart(CODES.removeprefix(", and "), None, 1.0, 1.0, rest))
    return tuple(parts)


def _at_samples(drawn: Drawn) -> Drawn:
    """Return what was drawn, for samples that may lie anywhere in their pixels."""
    viewport = layered.sampled_viewport(drawn.geometry.viewport, drawn.plan.layers.samples)
    return drawn._replace(geometry=drawn.geometry._replace(viewport=viewport))


def _find_samples(
    drawn: Drawn, surface: Surface, lighting: Lighting | None, x: int, y: int
) -> Iterator[tuple[list[int], float]]:
    """Yield the faces that are seen through each other, nearest first, and their share."""
    plan, geometry, workers = drawn.plan, drawn.geometry, Workers(1)
    cutouts = passes.find_cutouts(plan, drawn.prepared)
    shader = layered.Shader(
        geometry, drawn.placement, surface, lighting, plan.background, plan.encoding, None,
        None if cutouts is None else cutouts._replace(geometry=geometry),
    )  # fmt: skip
    lists = layered.part_lists(drawn.coverage, geometry.viewport, plan.layers.is_blended, workers)
    first = y - y % TILE_SIZE
    rows = first, min(first + TILE_SIZE, geometry.viewport.height)
    if plan.layers.samples == "area":
        shown, shares, rest = layered.find_areas(rows, lists, shader, workers.memory)
        for face, share in zip(shown[:, y - first, x], shares[:, y - first, x], strict=False):
            if face >= 0:
                yield [int(face)], float(share)
        yield [], float(rest[y - first, x])
        return
    samples = int(plan.layers.samples)
    most = plan.layers.most
    for band in layered.find_layers(rows, lists, samples, shader, workers.memory, most):
        row = y - band.first_row
        if not 0 <= row < band.opaque.shape[1]:
            continue
        for transparent, opaque in zip(
            band.transparent[:, :, row, x].tolist(), band.opaque[:, row, x].tolist(), strict=True
        ):
            yield [face for face in (*transparent, opaque) if face >= 0], 1.0 / samples


def _alpha_of(drawn: Drawn, face: int, color: NDArray[np.float32]) -> float:
    """Return how much of what lies behind a face it covers."""
    if not drawn.plan.layers.is_blended[owner_of(drawn, face)]:
        return 1.0
    return float(min(max(color[3], 0.0), 1.0))


def _name_of(drawn: Drawn, face: int) -> str:
    """Name a face by its number and its object."""
    owner = owner_of(drawn, face)
    name, place = drawn.scene.nodes[owner].name, f"object {owner}"
    return f"face {face} of {place if name == place else f'{place} {name}'}"


def _scaled(share: float, color: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a share of a colour, which may be infinite if the share is 0."""
    if share == 0.0:
        return np.zeros(3, np.float32)
    return np.float32(share) * color
