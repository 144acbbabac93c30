"""Hold the results of a study: trials, their errors, and the Pareto front."""

from __future__ import annotations

import importlib.util
import math
import statistics
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame
from rasterjit.rendering.quality_selection import MAX_CODE, light_of, root_mean_square
from rasterjit.scene.quality import LEVELS, Quality
from rasterjit.scene.scene import Scene

STANDARD = "standard"
"""Name of the standard quality, from which single settings are changed."""

COMBINATIONS = "combinations"
"""Name of the setting of qualities that change several settings."""

WALL, CPU = "wall", "processor"
"""Clocks: elapsed time, and processor time of all threads."""

REFERENCE_SAMPLES = 256
"""Most samples of the reference."""

FROM_SCENE = "as the scene says"
"""Level of a setting that the standard leaves to the scene."""


class Errors(NamedTuple):
    """Errors of a picture against the reference; ``None`` where one has no meaning."""

    rmse: float
    """Root of the mean squared difference of linear red, green and blue."""
    largest: float
    """Largest of these differences."""
    psnr: float
    """Peak signal-to-noise ratio of that rmse for a peak of 1, decibels; ``inf`` without error."""
    flip: float | None
    """Mean FLIP error, 0..1; ``None`` without NVIDIA's ``flip-evaluator``."""
    wrong_faces: int
    """Pixels whose nearest face is another than the reference's."""
    depth_ulp: float | None
    """Largest difference of depth where the face is the same, float32 units in the last place."""
    depth_units: float | None
    """The same in scene units."""
    uv_texels: float | None
    """Largest difference of texture coordinates there, texels of the base colour texture."""


@dataclass(frozen=True)
class Trial:
    """
    One quality, measured.

    Attributes
    ----------
    setting : str
        The setting that was changed, ``"combinations"`` for several, ``"standard"`` for none.
    level : str
        Its level; or all changes, like ``"samples=4 shading=vertex"``.
    quality : Quality
    seconds : tuple of float
        Times of its frames by the study's clock, without compiling. Wall-clock times are raw and in
        the order they were taken; of processor times these are the least half, sorted.
    ratios : tuple of float
        The same over the standard's: over its time in the same round, or over the median of the
        least half of its processor times.
    stages : dict of float
        Median seconds of each stage.
    errors : Errors
    color : (H, W, 3) uint8, sRGB
        The picture.
    error_map : (H, W) float32
        Largest difference of the linear channels at each pixel.
    dominated_by : str or None
        Label of a level of the same setting that is neither slower nor less accurate.
    """

    setting: str
    level: str
    quality: Quality
    seconds: tuple[float, ...]
    ratios: tuple[float, ...]
    stages: dict[str, float]
    errors: Errors
    color: NDArray[np.uint8] = field(repr=False)
    error_map: NDArray[np.float32] = field(repr=False)
    dominated_by: str | None = None

    @property
    def label(self) -> str:
        """Name of the trial."""
        is_single = self.setting not in (COMBINATIONS, STANDARD)
        return f"{self.setting}={self.level}" if is_single else self.level

    @property
    def median(self) -> float:
        """Median seconds of a frame."""
        return statistics.median(self.seconds)

    @property
    def ratio(self) -> float:
        """Median time over that of the standard, round by round."""
        return statistics.median(self.ratios)

    @property
    def spread(self) -> tuple[float, float]:
        """Lower and upper quartile of the ratios."""
        if len(self.ratios) < 2:
            return self.ratio, self.ratio
        low, _, high = statistics.quantiles(self.ratios, n=4, method="inclusive")
        return low, high


@dataclass(frozen=True)
class EffectCost:
    """
    Cost of an effect of the scene, and its error against its own reference.

    Attributes
    ----------
    effect : str
        Its name, as `rasterjit.explain` has it.
    levels : tuple of Trial
        The scene without it, and with what can be changed of it, each in the standard quality but
        for that. Times are over the standard's. Errors are against the effect's reference, or
        against the standard where it has none.
    rmse : float or None
        Error of the effect as the scene has it, at the standard quality; None without reference.
    reference : str
        What that is, in words; or why there is none.
    """

    effect: str
    levels: tuple[Trial, ...]
    rmse: float | None
    reference: str


@dataclass(frozen=True, repr=False)
class Study:
    """
    Results of a study of one scene.

    Attributes
    ----------
    scene : str
        Name of the file or of the scene.
    size : (int, int)
        Pixels.
    threads, rounds : int
    machine, versions : dict of str
    standard : Trial
        The quality that single settings are changed from; its ratios are 1.
    trials : tuple of Trial
        All others, setting by setting, from the least accurate level on; combinations last.
    front : tuple of str
        Labels of what is worth choosing, fastest first, at most seven: each is more accurate than
        all faster ones, and their times can be told apart.
    without_effect : dict of str
        Settings that change nothing here, with the reason in words.
    left_out : tuple of str
        Labels that the budget left no time for, or that were interrupted.
    reference_color : (H, W, 3) uint8, sRGB
    reference_seconds : float
    impossible : dict of str
        Labels of what cannot be rendered here, with the reason in words.
    interrupted : bool
        Whether Ctrl-C ended it early.
    clock : {"wall", "processor"}
        What times are: how long a frame took, or, where the machine is busy with something else,
        the processor time of all threads together.
    reference_samples : int
        Samples of the reference: 256, or fewer where there was no time for them.
    reference_error : float
        How far the reference is from one of all samples, about: errors below it are not told apart.
    asked_size : (int, int) or None
        Pixels that were asked for, where there was time for a smaller picture only.
    max_error : float or None
        The largest error that was asked for.
    effects : tuple of EffectCost
        What each effect of the scene costs, and how far it is from its own reference.
    """

    scene: str
    size: tuple[int, int]
    threads: int
    rounds: int
    machine: dict[str, str]
    versions: dict[str, str]
    standard: Trial
    trials: tuple[Trial, ...]
    front: tuple[str, ...]
    without_effect: dict[str, str]
    left_out: tuple[str, ...]
    reference_color: NDArray[np.uint8]
    reference_seconds: float = 0.0
    impossible: dict[str, str] = field(default_factory=dict)
    interrupted: bool = False
    clock: str = WALL
    reference_samples: int = REFERENCE_SAMPLES
    reference_error: float = 0.0
    asked_size: tuple[int, int] | None = None
    max_error: float | None = None
    effects: tuple[EffectCost, ...] = ()

    def __repr__(self) -> str:
        """Name the scene and count what was tried; `sentences` says what was found."""
        width, height = self.size
        return (
            f"Study({self.scene!r}, {width} x {height}, {self.threads} threads, "
            f"{len(self.trials)} trials, {self.rounds} rounds)"
        )

    def of(self, setting: str) -> list[Trial]:
        """Return the trials of one setting, from its least accurate level on."""
        return [trial for trial in self.trials if trial.setting == setting]


def list_settings(study: Study) -> list[str]:
    """Return the settings that were changed alone, in the order of their first trials."""
    names = dict.fromkeys(trial.setting for trial in study.trials)
    return [setting for setting in names if setting not in (STANDARD, COMBINATIONS)]


def find_standard_level(study: Study, setting: str) -> str:
    """Return the level of a setting in the standard quality."""
    level = getattr(study.standard.quality, setting, None)
    return FROM_SCENE if level is None else str(level)


def insert_standard(study: Study, setting: str) -> list[Trial]:
    """Return the trials of a setting with the standard among them, in the order of levels."""
    trials = study.of(setting)
    levels = [str(level).lower() for level in LEVELS.get(setting, ())]
    standard = find_standard_level(study, setting).lower()
    if standard not in levels:
        return [study.standard, *trials]
    lower_levels = levels[: levels.index(standard)]
    before = [trial for trial in trials if trial.level.lower() in lower_levels]
    after = [trial for trial in trials if trial.level.lower() not in lower_levels]
    return [*before, study.standard, *after]


def list_front_trials(study: Study) -> list[Trial]:
    """Return the trials on the Pareto front, from the fastest on."""
    front = [trial for trial in (study.standard, *study.trials) if trial.label in study.front]
    return sorted(front, key=lambda trial: (trial.ratio, trial.label))


PICTURE_OUTPUTS = ("color", "linear")
"""Outputs by which the colours of two frames are compared."""


class ReferenceFrame(NamedTuple):
    """The reference that frames are compared with."""

    picture: Frame
    """Its colour and linear light."""
    buffers: Frame
    """Its depth and faces, and texture coordinates where the scene has some."""
    texels: NDArray[np.float64]
    """Texels of each object, from `count_texels`."""
    face_starts: NDArray[np.int64]
    """First face of each object, (O+1,)."""
    samples: int = REFERENCE_SAMPLES
    seconds: float = 0.0
    """Time to draw its pictures, seconds."""
    error: float = 0.0
    """Estimated error against a reference of all samples."""


def make_reference(scene: Scene, picture: Frame, buffers: Frame) -> ReferenceFrame:
    """Return the reference of a scene, given the frames of its picture and of its buffers."""
    face_counts = [len(node.mesh.faces) for node in scene.nodes]
    return ReferenceFrame(picture, buffers, count_texels(scene), np.cumsum([0, *face_counts]))


def count_texels(scene: Scene) -> NDArray[np.float64]:
    """Return the texels per unit of u and of v on each object, (O, 2); NaN without a texture."""
    texels = np.full((len(scene.nodes), 2), np.nan)
    for row, node in zip(texels, scene.nodes, strict=True):
        texture = node.mesh.material.base_color_texture
        # The output uv is the first set of coordinates.
        if texture is not None and texture.uv_set == 0 and node.mesh.uv is not None:
            row[:] = np.abs(texture.scale) * texture.size
    return texels


def list_compared_buffers(scene: Scene) -> tuple[str, ...]:
    """Return the outputs besides colour that frames of a scene are compared by."""
    has_uv = any(node.mesh.uv is not None for node in scene.nodes)
    return ("depth", "face_id", "uv") if has_uv else ("depth", "face_id")


def measure_errors(frame: Frame, reference: ReferenceFrame) -> tuple[Errors, NDArray[np.float32]]:
    """
    Return the errors of a frame.

    Parameters
    ----------
    frame : Frame
        With the outputs ``PICTURE_OUTPUTS`` and those of `list_compared_buffers`.
    reference : ReferenceFrame

    Returns
    -------
    Errors
        Without FLIP, which takes longer than all others: `add_flip` adds it.
    (H, W) float32
        Largest difference of the linear channels at each pixel.
    """
    difference = np.abs(light_of(frame).astype(np.float64) - light_of(reference.picture))
    rmse = root_mean_square(difference)
    faces, true_faces = frame.face_id, reference.buffers.face_id
    is_same = (faces == true_faces) & (faces >= 0)
    ulp, units = None, None
    if "depth" in frame.plan.outputs:
        ulp, units = _measure_depth_errors(frame.depth[is_same], reference.buffers.depth[is_same])
    errors = Errors(
        rmse=rmse,
        largest=float(difference.max()),
        psnr=-20.0 * math.log10(rmse) if rmse > 0.0 else math.inf,
        flip=None,
        wrong_faces=int(np.count_nonzero(faces != true_faces)),
        depth_ulp=ulp,
        depth_units=units,
        uv_texels=_uv_error(frame, reference, is_same),
    )
    largest = np.maximum(difference[:, :, 0], difference[:, :, 1])
    return errors, np.maximum(largest, difference[:, :, 2]).astype(np.float32)


def add_flip(errors: Errors, color: NDArray[np.uint8], reference: ReferenceFrame) -> Errors:
    """Return errors with the FLIP of a picture, where ``flip-evaluator`` is installed."""
    return errors._replace(flip=measure_flip(reference.picture.color, color))


def _measure_depth_errors(
    depth: NDArray[np.float32], true: NDArray[np.float32]
) -> tuple[float | None, float | None]:
    """Return the largest difference of depths, (n,) each: float32 ulp, and scene units."""
    if len(depth) == 0:
        return None, None
    units = np.abs(depth.astype(np.float64) - true)
    return float((units / np.spacing(np.abs(true))).max()), float(units.max())


def _uv_error(frame: Frame, reference: ReferenceFrame, is_same: NDArray[np.bool_]) -> float | None:
    """Return the largest difference of texture coordinates, texels; None without textures."""
    if "uv" not in frame.plan.outputs:
        return None
    owners = np.searchsorted(reference.face_starts, frame.face_id[is_same], side="right") - 1
    # Caps of sections, which have no texture coordinates, come behind all faces.
    owners = np.minimum(owners, len(reference.texels) - 1)
    uv = frame.uv[is_same].astype(np.float64)
    texels = np.abs(uv - reference.buffers.uv[is_same]) * reference.texels[owners]
    finite = texels[np.isfinite(texels)]
    return float(finite.max()) if len(finite) else None


def has_flip() -> bool:
    """Tell whether NVIDIA's ``flip-evaluator`` is installed."""
    return importlib.util.find_spec("flip_evaluator") is not None


def measure_flip(true: NDArray[np.uint8], color: NDArray[np.uint8]) -> float | None:
    """
    Return the mean LDR-FLIP error, 0..1, of sRGB pictures, (H, W, 3 or 4); None if not installed.

    References
    ----------
    .. [1] P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proceedings
       of the ACM on Computer Graphics and Interactive Techniques 3 (2), 2020.
    """
    if not has_flip():
        return None
    import flip_evaluator

    pictures = [
        np.ascontiguousarray(picture[:, :, :3], np.float32) / np.float32(MAX_CODE)
        for picture in (true, color)
    ]
    # FLIP's own mean is summed by several threads, in any order.
    errors, _, _ = flip_evaluator.evaluate(
        *pictures, "LDR", applyMagma=False, computeMeanError=False, parameters={}
    )
    return float(np.mean(errors, dtype=np.float64))
