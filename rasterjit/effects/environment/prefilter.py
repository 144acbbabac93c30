"""
Prefilter environment maps for image-based lighting; results are cached with the map.

A map is first resized to a width that is a power of two. Irradiance: it is projected onto the nine
lowest spherical harmonics, and two more that depend on the height alone [1]_. Small bright spots,
such as the sun, would be off by up to 24 %: they are removed and treated as directional lights.

Reflections: the map is filtered for eight roughnesses. The mean over a lobe is taken in rings, each
from a mip level whose texels are at most a quarter as wide as their distance from the centre.

References
----------
.. [1] R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
   SIGGRAPH 2001.
"""

from __future__ import annotations

import math
import weakref
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.environment import prefilter_stage, stage
from rasterjit.effects.environment.stage import EnvironmentRecord, Irradiance, Reflections
from rasterjit.runtime.threads import Workers, split_range
from rasterjit.scene.environment import Environment, Panorama, SkyGradient
from rasterjit.scene.transforms import sine_cosine
from rasterjit.survey.packed_scene import writable

MIN_COPY_WIDTH, MAX_COPY_WIDTH = 64, 1024
"""Columns of the coarsest and the finest copy of a picture: 5.6 and 0.35 degrees a texel."""

MAX_LEVEL_WIDTH = 512
"""Most columns of a filtered picture; the sharpest lobe is 1.2 degrees across."""

RING_TEXELS = 4.0
"""Texels from the middle of a lobe to the ring that the next coarser copy serves."""

ROWS_PER_TASK = 8
"""Rows of a filtered picture made by one task."""

COLUMNS_TIMES_ALPHA = 8.0
"""Columns of the finest copy that a lobe is read from, times alpha: the middle of the lobe, 150
alpha degrees wide, is three texels across."""

MAX_VERSINE = 3.0
"""Above one minus any cosine."""

GRADIENT_SIZE = 256
"""Columns of the picture drawn of a gradient."""

PI = 3.141592653589793

LEGENDRE_4 = 7.0 / 8.0, -10.0 / 8.0, 3.0 / 8.0
LEGENDRE_6 = 33.0 / 16.0, -63.0 / 16.0, 35.0 / 16.0, -5.0 / 16.0
"""Factors of the integrals of the Legendre polynomials of degree 4 and 6, by falling powers."""

SPOTS_WIDTH = 128
"""Columns of the copy of a picture that is searched for bright spots: 2.8 degrees a texel."""

MAX_SPOTS, SPOT_COSINE = 32, 0.99026807
"""Most spots of a picture, and the cosine of one's radius, 8 degrees."""

MIN_SPOT_BRIGHTNESS, MIN_SPOT_FLUX = 4.0, 0.004
"""Least brightness of a spot, in means of the map, and least share of all light that it sends.

Smaller spots stay in the harmonics, which are off by a sixteenth of their light.
"""

NO_LIGHT = Irradiance(
    np.zeros((stage.IRRADIANCE_TERMS, 3), np.float32), np.zeros((0, 3), np.float32),
    np.zeros((0, 6), np.float32),
)  # fmt: skip
"""The irradiance of an environment that is only a background."""

NO_REFLECTIONS = Reflections(np.zeros((1, 3), np.float32), np.zeros((0, 3), np.int64))
"""The reflections of an environment that nothing reflects, or of one colour."""


class FilteredPanorama(NamedTuple):
    """The prefiltered data of a sky, independent of intensity and rotation."""

    irradiance: Irradiance
    reflections: Reflections | None
    """``None`` until an object reflects the sky."""


_filtered_skies: weakref.WeakKeyDictionary[Panorama | SkyGradient, FilteredPanorama] = (
    weakref.WeakKeyDictionary()
)
"""The filtered data of all skies in use."""


def make_light_record(
    environment: Environment, has_reflections: bool, workers: Workers
) -> EnvironmentRecord:
    """
    Return the record of an environment that lights a scene.

    Parameters
    ----------
    environment : rasterjit.Environment
    has_reflections : bool
        Whether any object reflects the environment: only then is it filtered for reflections.
    workers : Workers
    """
    sky = environment.sky
    filtered = _filtered_skies.get(sky)
    if filtered is None:
        filtered = FilteredPanorama(_compute_irradiance(sky), None)
    if has_reflections and filtered.reflections is None:
        filtered = filtered._replace(reflections=_filter_reflections(sky, workers))
    _filtered_skies[sky] = filtered
    record = make_background_record(environment)
    reflections = filtered.reflections if has_reflections else NO_REFLECTIONS
    return record._replace(irradiance=filtered.irradiance, reflections=reflections)


def make_background_record(environment: Environment) -> EnvironmentRecord:
    """Return the record of an environment that is only a background."""
    sky = environment.sky
    sine, cosine = sine_cosine(environment.rotation)
    texels, width, height = np.zeros((1, 3), np.float32), 0, 0
    gradient = np.zeros((3, 3), np.float32)
    if isinstance(sky, Panorama):
        height, width = sky.image.shape[:2]
        texels = writable(sky.image.reshape(-1, 3))
    else:
        gradient = np.array([sky.zenith, sky.horizon, sky.ground], np.float32)
    return EnvironmentRecord(
        NO_LIGHT,
        np.array([cosine, sine], np.float32),
        np.float32(environment.intensity),
        texels,
        width,
        height,
        gradient,
        NO_REFLECTIONS,
    )


def _compute_irradiance(sky: Panorama | SkyGradient) -> Irradiance:
    """Return a sky's irradiance over pi."""
    if isinstance(sky, SkyGradient):
        return _compute_gradient_irradiance(sky)
    width = _choose_copy_width(sky.image.shape[1])
    image = _resize(sky.image, width)
    terms, bands = _project_harmonics(_make_planar(image))
    while width > SPOTS_WIDTH:
        width //= 2
        image = _resize(image, width)
    spots = _find_bright_spots(image)
    for x, y, z, *color in spots.tolist():
        spot_terms, spot_bands = _project_cosine(x, y, z)
        terms -= np.outer(spot_terms, color)
        bands -= np.outer(spot_bands, color)
    return Irradiance(*(part.astype(np.float32) for part in (terms, bands, spots)))


def _compute_gradient_irradiance(sky: SkyGradient) -> Irradiance:
    """
    Return the polynomial of a gradient, which is ``h + (a - b)/2 y + (a + b)/2 |y|``.

    A surface keeps 1, 2/3, 1/4, -1/24 and 1/64 of the harmonics of degree 0, 1, 2, 4 and 6, and |y|
    is 1/2 + 5/16 (3y² - 1) - 3/16 P4 + 13/128 P6 + ...
    """
    zenith, horizon, ground = np.array([sky.zenith, sky.horizon, sky.ground])
    up, down = zenith - horizon, ground - horizon
    terms = np.zeros((stage.IRRADIANCE_TERMS, 3))
    terms[0] = horizon + (up + down) / 4.0
    terms[2] = (up - down) / 3.0
    terms[7] = (up + down) * (5.0 / 128.0)
    bands = np.array([(up + down) / 256.0, (up + down) * (13.0 / 16384.0)])
    if not bands.any():
        bands = bands[:0]
    return Irradiance(terms.astype(np.float32), bands.astype(np.float32), NO_LIGHT.spots)


def _project_cosine(x: float, y: float, z: float) -> tuple[list[float], list[float]]:
    """Return the clamped cosine to a direction as nine terms and two bands: see `Irradiance`."""
    s = y * y
    terms = [
        1.0 / 4.0, x / 2.0, y / 2.0, z / 2.0, 15.0 / 16.0 * x * y, 15.0 / 16.0 * y * z,
        15.0 / 16.0 * z * x, 5.0 / 64.0 * (3.0 * s - 1.0), 15.0 / 64.0 * (x * x - z * z),
    ]  # fmt: skip
    four = ((35.0 * s - 30.0) * s + 3.0) / 8.0
    six = (((231.0 * s - 315.0) * s + 105.0) * s - 5.0) / 16.0
    return terms, [-3.0 / 32.0 * four, 13.0 / 256.0 * six]


def _find_bright_spots(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """
    Return the directions of small bright spots, and their irradiance, (N, 6).

    Texels brighter than `MIN_SPOT_BRIGHTNESS` times the mean make spots: the brightest and those
    around it first.
    """
    height, width = image.shape[:2]
    longitudes = [sine_cosine(360.0 * ((n + 0.5) / width - 0.5)) for n in range(width)]
    sines, cosines = np.array(longitudes).T
    y, s, area = (column[:, np.newaxis] for column in _compute_latitudes(height))
    directions = np.stack(np.broadcast_arrays(s * cosines, y, s * sines), axis=2).reshape(-1, 3)
    colors = image.astype(np.float64).reshape(-1, 3)
    light = colors[:, 0] + colors[:, 1] + colors[:, 2]
    areas = np.repeat(area[:, 0] / width, width)
    min_flux = _sum(light * areas) * MIN_SPOT_FLUX
    excess = np.maximum(light - MIN_SPOT_BRIGHTNESS / (4.0 * PI) * _sum(light * areas), 0.0)
    spots: list[list[float]] = []
    while len(spots) < MAX_SPOTS and excess.any():
        x, y, z = directions[excess.argmax()].tolist()
        cosine = directions[:, 0] * x + directions[:, 1] * y + directions[:, 2] * z
        (near,) = np.nonzero((cosine >= SPOT_COSINE) & (excess > 0.0))
        flux = excess[near] * areas[near]
        if _sum(flux) < min_flux:
            break
        toward = [_sum(flux * directions[near, k]) for k in range(3)]
        length = math.sqrt(toward[0] ** 2 + toward[1] ** 2 + toward[2] ** 2)
        irradiance = [_sum(flux * colors[near, k] / light[near]) / PI for k in range(3)]
        spots.append([*(part / length for part in toward), *irradiance])
        excess[near] = 0.0
    return np.array(spots).reshape(-1, 6)


def _choose_copy_width(width: int) -> int:
    """Return the columns of the finest copy of a picture: a power of two."""
    return min(max(1 << (width.bit_length() - 1), MIN_COPY_WIDTH), MAX_COPY_WIDTH)


def _compute_latitudes(height: int) -> NDArray[np.float64]:
    """Return each row's sine and cosine of latitude, and its solid angle, (3, H)."""
    centers = [sine_cosine(90.0 - 180.0 * (row + 0.5) / height) for row in range(height)]
    areas = np.diff(_compute_row_edges(height)) * (2.0 * PI)
    return np.array([*zip(*centers, strict=True), areas])


def _compute_row_edges(height: int) -> NDArray[np.float64]:
    """Return one minus the sine of latitude at the edges of rows, (H+1,): area from the top."""
    sines = [sine_cosine(90.0 - 180.0 * row / height)[0] for row in range(height + 1)]
    return 1.0 - np.array(sines)


def _resize(image: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """Resize a picture to (width/2, width, 3), averaging light by area."""
    height = width // 2
    rows, columns = image.shape[:2]
    if columns != width:
        resized = np.empty((rows, width, 3), np.float32)
        edges = np.arange(columns + 1) / columns, np.arange(width + 1) / width
        prefilter_stage.average_columns(writable(image), *edges, resized)
        image = resized
    if rows != height:
        transposed = np.ascontiguousarray(image.swapaxes(0, 1))
        transposed_out = np.empty((width, height, 3), np.float32)
        prefilter_stage.average_columns(
            transposed, _compute_row_edges(rows), _compute_row_edges(height), transposed_out
        )
        image = np.ascontiguousarray(transposed_out.swapaxes(0, 1))
    return image


def _make_planar(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture channel by channel, (3, H, W)."""
    return np.ascontiguousarray(np.moveaxis(image, 2, 0))


def _project_harmonics(
    channels: NDArray[np.float32],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the terms, (9, 3), and bands, (2, 3), of a picture's irradiance, channel by channel.

    The harmonics that do not depend on longitude are integrated exactly over each row, so that a
    picture of one colour gives that colour.
    """
    _, height, width = channels.shape
    longitudes = [sine_cosine(360.0 * ((n + 0.5) / width - 0.5)) for n in range(width)]
    sines, cosines = np.array(longitudes).T.copy()
    sums = np.empty((5, height))
    edges = 1.0 - _compute_row_edges(height)
    top, bottom = edges[:-1], edges[1:]
    first = (top * top - bottom * bottom) / 2.0
    second = top * top * top - bottom * bottom * bottom - (top - bottom)
    fourth = _integrate_legendre(top, LEGENDRE_4) - _integrate_legendre(bottom, LEGENDRE_4)
    sixth = _integrate_legendre(top, LEGENDRE_6) - _integrate_legendre(bottom, LEGENDRE_6)
    y, s, area = _compute_latitudes(height)
    terms, bands = np.empty((stage.IRRADIANCE_TERMS, 3)), np.empty((2, 3))
    for k in range(3):
        prefilter_stage.project_rows(writable(channels[k]), cosines, sines, sums)
        # Weight each texel by its share of the row's area, over 4 pi.
        plain, cosine, sine, double_cosine, double_sine = sums / (2.0 * width)
        weight = area / (2.0 * PI)
        terms[:, k] = [
            _sum(plain * (top - bottom)),
            2.0 * _sum(cosine * s * weight),
            2.0 * _sum(plain * first),
            2.0 * _sum(sine * s * weight),
            15.0 / 4.0 * _sum(cosine * y * s * weight),
            15.0 / 4.0 * _sum(sine * y * s * weight),
            15.0 / 4.0 * _sum(double_sine * s * s * weight),
            5.0 / 16.0 * _sum(plain * second),
            15.0 / 16.0 * _sum(double_cosine * s * s * weight),
        ]
        bands[:, k] = -3.0 / 8.0 * _sum(plain * fourth), 13.0 / 64.0 * _sum(plain * sixth)
    return terms, bands


def _integrate_legendre(y: NDArray[np.float64], factors: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the integral of a Legendre polynomial of even degree up to y."""
    s, total = y * y, np.zeros_like(y)
    for factor in factors:
        total = total * s + factor
    return total * y


def _sum(values: NDArray[np.float64]) -> float:
    """Return a sum in order, from the first value to the last."""
    total = 0.0
    for value in values.tolist():
        total += value
    return total


def _filter_reflections(sky: Panorama | SkyGradient, workers: Workers) -> Reflections:
    """Return a sky filtered for each level of roughness."""
    if isinstance(sky, SkyGradient):
        if sky.zenith == sky.horizon == sky.ground:
            return NO_REFLECTIONS
        image = _draw_gradient(sky)
    else:
        image = sky.image
    copies = {}
    width = _choose_copy_width(image.shape[1])
    while width >= MIN_COPY_WIDTH:
        image = copies[width] = _resize(image, width)
        width //= 2
    texels, levels, first = [], [], 0
    for level in range(1, stage.ROUGH_LEVELS + 1):
        filtered = _filter_level(copies, level, workers)
        height, width = filtered.shape[:2]
        texels.append(filtered.reshape(-1, 3))
        levels.append((first, width, height))
        first += height * width
    return Reflections(np.concatenate(texels), np.array(levels, np.int64))


def _draw_gradient(sky: SkyGradient) -> NDArray[np.float32]:
    """Return a picture of a gradient."""
    height = GRADIENT_SIZE // 2
    y = _compute_latitudes(height)[0][:, np.newaxis]
    zenith, horizon, ground = np.array([sky.zenith, sky.horizon, sky.ground])
    rows = horizon + np.abs(y) * (np.where(y > 0.0, zenith, ground) - horizon)
    return np.repeat(rows.astype(np.float32)[:, np.newaxis], GRADIENT_SIZE, axis=1)


def _filter_level(
    copies: dict[int, NDArray[np.float32]], level: int, workers: Workers
) -> NDArray[np.float32]:
    """Return a sky's reflection in a surface of one roughness level, (H, W, 3)."""
    alpha = math.ldexp(1.0, level - stage.ROUGH_LEVELS)
    finest = min(max(round(COLUMNS_TIMES_ALPHA / alpha), MIN_COPY_WIDTH), max(copies))
    width = min(finest, MAX_LEVEL_WIDTH)
    height = width // 2
    sums, totals = np.zeros((3, height, width)), np.zeros((height, width))
    used = [copy for copy in copies if copy <= finest]
    for number, copy in enumerate(used):
        ring = _find_ring_bounds(copy, number == 0, number == len(used) - 1)
        added, total = _sum_ring(copies[copy], ring, alpha * alpha, (height, width), workers)
        sums += added.swapaxes(2, 3).reshape(sums.shape)
        totals += np.tile(total, (1, width // total.shape[1]))
    return np.ascontiguousarray(np.moveaxis(sums / totals, 0, 2), np.float32)


def _find_ring_bounds(width: int, is_first: bool, is_last: bool) -> NDArray[np.float64]:
    """
    Return the bounds of the ring that is read from a copy of a picture, (4,).

    Bounds are one minus a cosine, half the square of a small angle. The ring fades in from
    `RING_TEXELS` to twice that angle, while the finer copy's ring fades out.
    """
    angle = RING_TEXELS * 2.0 * PI / width
    start = angle * angle / 2.0
    ends = [-1.0, -1.0] if is_first else [start, 4.0 * start]
    ends += [MAX_VERSINE, MAX_VERSINE] if is_last else [4.0 * start, 16.0 * start]
    return np.array(ends)


def _sum_ring(
    image: NDArray[np.float32],
    ring: NDArray[np.float64],
    alpha_squared: float,
    shape: tuple[int, int],
    workers: Workers,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return a ring's weighted sums (3, G, Q, B) and weights (G, Q); column ``q k + p`` is p, k."""
    height, width = shape
    source_height, source_width = image.shape[:2]
    base = min(source_width, width)
    planar = _make_planar(image)
    phases = planar.reshape(3, source_height, base, source_width // base).swapaxes(2, 3)
    source = np.ascontiguousarray(np.concatenate([phases, phases], axis=3))
    steps = 2 * max(source_width, width)
    cosines = np.array([sine_cosine(360.0 * n / steps)[1] for n in range(steps)])
    sums = np.zeros((3, height, width // base, base), np.float32)
    total = np.zeros((height, width // base))
    heights = _compute_latitudes(source_height), _compute_latitudes(height)[:2].copy()
    workers.run(
        prefilter_stage.add_ring,
        [
            (rows, alpha_squared, ring, source, *heights, cosines, total, sums)
            for rows in split_range(height, ROWS_PER_TASK)
        ],
    )
    return sums, total
