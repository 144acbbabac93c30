"""A study with results that were made up: several settings, and everything that a page may meet."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rasterjit.accuracy.choice import pareto_front
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Errors, Study, Trial
from rasterjit.scene.quality import PRESETS, Quality

WIDTH, HEIGHT = 160, 100

SAMPLES = {
    # level: (ratio, rmse, dominated by)
    "2": (1.12, 0.0231, None), "4": (1.31, 0.0164, None), "8": (1.74, 0.0117, "samples=area"),
    "16": (2.62, 0.0084, "samples=area"), "area": (1.58, 0.0062, None), "64": (61.0, 0.0041, None),
    "256": (243.0, 0.0, None),
}  # fmt: skip
"""One level is the reference's, without error; two are dominated."""

SUBPIXEL = {
    "0": (0.985, 0.0652, None),
    "4": (1.002, 0.0341, "standard"),
    "12": (1.01, 0.0329, None),
}
PRECISION = {"float32": (0.97, 0.0329001, None)}
BLENDING = {"srgb8": (1.0, 0.0329, None)}
MIXED = {
    "samples=4 shading=vertex": (0.83, 0.0301, None),
    "samples=area texture_filter=anisotropic8 lines=coverage shadow_size=2048": (1.9, 0.0021, None),
    "shading=face texture_filter=nearest": (0.41, 0.081, None),
    "samples=16 shading=face": (2.0, 0.07, None),
    "draft": (0.4, 0.09, None),
}
"""Combinations, the draft preset among them."""


def quality_of(setting, level):
    """The quality of a trial: a preset, or the standard with what its label changes."""
    if level in PRESETS:
        return PRESETS[level]()
    changes = dict(pair.split("=") for pair in level.split()) if "=" in level else {setting: level}
    values = {name: int(text) if text.isdigit() else text for name, text in changes.items()}
    return dataclasses.replace(Quality.standard(), **values)


def picture(jaggedness):
    """A disc on a gradient whose edge is off by some pixels; (H, W, 3) uint8."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    radius = 30.0 + jaggedness * 40.0 * ((np.floor(x / 3) + np.floor(y / 3)) % 2)
    inside = (x - 95.0) ** 2 + (y - 40.0) ** 2 < radius**2
    grey = 40.0 + 150.0 * x / WIDTH
    return np.stack(
        [np.where(inside, 225.0, grey), np.where(inside, 120.0, grey), np.where(inside, 40, grey)],
        axis=-1,
    ).astype(np.uint8)


def trial(setting, level, quality, found, rounds):
    """A trial whose times vary by some percent from round to round."""
    ratio, rmse, dominated_by = found
    share = 0.002 * (2 + len(level) % 5)
    wobble = [1.0 + share * ((5 * k) % rounds - rounds // 2) for k in range(rounds)]
    ratios = tuple(1.0 if setting == STANDARD else ratio * w for w in wobble)
    color, exact = picture(rmse), picture(0.0)
    difference = np.abs(color.astype(np.float64) - exact).max(axis=-1) / 255.0
    errors = Errors(
        rmse, min(1.0, 20.0 * rmse), -20.0 * math.log10(rmse) if rmse else math.inf,
        None if setting == "precision" else 0.5 * rmse, int(rmse * 20000),
        None if setting == "samples" else 3.0, None if setting == "samples" else 1.2e-7, None,
    )  # fmt: skip
    return Trial(
        setting, level, quality, tuple(0.0124 * r * w for r, w in zip(ratios, wobble, strict=True)),
        ratios, {"visibility": 0.004 * ratio, "shading": 0.007 * ratio}, errors, color,
        (difference * rmse * 20.0).astype(np.float32), dominated_by,
    )  # fmt: skip


def made_up_study(*, rounds=9, settings=None, scene='bits & <pieces> of "glass".obj'):
    """Return a study of all settings above, or of those named."""
    standard = Quality.standard()
    wanted = {
        "samples": SAMPLES, "subpixel_bits": SUBPIXEL, "precision": PRECISION,
        "blending": BLENDING, COMBINATIONS: MIXED,
    }  # fmt: skip
    if settings is not None:
        wanted = {name: wanted[name] for name in settings}
    trials = tuple(
        trial(setting, level, quality_of(setting, level), found, rounds)
        for setting, levels in wanted.items()
        for level, found in levels.items()
    )
    base = trial(STANDARD, STANDARD, standard, (1.0, 0.0329, None), rounds)
    return Study(
        scene=scene,
        size=(WIDTH, HEIGHT),
        threads=2,
        rounds=rounds,
        machine={"cpu": "Quick & Cheap <2>", "cores": "2"},
        versions={"rasterjit": "0.1.0", "numba": '0.6"1"'},
        standard=base,
        trials=trials,
        front=pareto_front([base, *trials]),
        without_effect={"shadow_taps": "no light casts shadows <here>"},
        left_out=("shading=face", "lines=coverage & more"),
        reference_color=picture(0.0),
        reference_seconds=3.21,
        impossible={"samples=area": "glass <blends> & areas do not"},
    )


def changed(study, setting, level, fields):
    """Return a study in which one trial is changed."""
    trials = tuple(
        dataclasses.replace(one, **fields) if (one.setting, one.level) == (setting, level) else one
        for one in study.trials
    )
    return dataclasses.replace(study, trials=trials)


SENTENCES = {
    "samples": '4 samples instead of 1: +31 % time, error 2.0× lower; "area" <best>',
    "subpixel_bits": "12 bits instead of 8: no time, no error",
    "lines": "nothing & nobody",
}
