"""Trials and studies of made-up numbers."""

import numpy as np

import rasterjit as rj
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Errors, Study, Trial


def errors(rmse=0.1, wrong_faces=0, depth_units=0.0, **others):
    values = {"largest": 4.0 * rmse, "psnr": 20.0, "flip": None, "depth_ulp": 0.0}
    values |= {"uv_texels": None} | others
    return Errors(rmse=rmse, wrong_faces=wrong_faces, depth_units=depth_units, **values)


def trial(label="standard", ratios=(1.0,) * 5, quality=None, dominated_by=None, **found):
    setting, _, level = label.partition("=")
    if label == STANDARD:
        level = STANDARD
    elif " " in label or not level:
        setting, level = COMBINATIONS, label
    picture = np.zeros((4, 6, 3), np.uint8)
    return Trial(
        setting, level, quality or rj.Quality(), tuple(0.01 * ratio for ratio in ratios),
        tuple(ratios), {"plan": 0.001, "shade, resolve": 0.009}, errors(**found), picture,
        np.zeros((4, 6), np.float32), dominated_by,
    )  # fmt: skip


def study(trials=(), front=("standard",), **others):
    values = {
        "without_effect": {"shadow_size": "no light casts them"}, "left_out": ("samples=256",),
        "machine": {"cpu": "a fast one"}, "versions": {"rasterjit": "0.1.0"},
    } | others  # fmt: skip
    return Study(
        "made up", (6, 4), 2, 5, standard=values.pop("standard", trial()), trials=tuple(trials),
        front=tuple(front), reference_color=np.zeros((4, 6, 3), np.uint8), reference_seconds=2.0,
        **values,
    )  # fmt: skip
