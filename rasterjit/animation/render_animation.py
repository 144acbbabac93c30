"""Render animations, one frame for each time, and write frames as they are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.animation.tracks import CameraTrack
from rasterjit.animation.video import save_animation
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import Outputs
from rasterjit.rendering.planning import Cull, look_from, needs_settling
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, settled
from rasterjit.scene.camera_fitting import fit_upright
from rasterjit.scene.decomposed_transform import TRS
from rasterjit.scene.keyframes import Animation, Channel
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import (
    finite_number,
    in_short,
    true_or_false,
)
from rasterjit.survey.clip_planes import NO_LOOK, BesidePlanes

CameraAt = Callable[[float], Camera]
TransformAt = Callable[[float], ArrayLike]
MeshAt = Callable[[float], Mesh]
AnimationsLike: TypeAlias = str | int | Animation | Sequence[str | int | Animation]


MAX_AHEAD = 10_000
"""Times that are looked at before the first frame is drawn, if a camera leaves a plane open."""


def frames(
    renderer: Renderer,
    scene: Scene,
    times: Iterable[float],
    *,
    camera: Camera | CameraAt | None = None,
    transforms: Mapping[Node, TransformAt] | None = None,
    meshes: Mapping[Node, MeshAt] | None = None,
    animation: AnimationsLike | None = None,
    loop: bool = False,
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
) -> Iterator[Frame]:
    """
    Render one frame for each time, when it is asked for.

    The nodes are where they were again when the last frame has been taken, or the iterator is
    closed.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    times : iterable of float, seconds
    camera : Camera or callable, optional
        What shows the scene, or a function that returns it for a time, such as a `CameraTrack`.
        Default: the scene's, else one that fits the scene's bounding sphere at each time, so that
        what turns keeps its size. If it leaves its near plane open, that is in one place
        for all frames: a camera or a `CameraTrack` is looked at ahead, at all of a sequence of up
        to 10,000 times. For other functions and times the plane never goes back.
    transforms : dict, optional
        By node of the scene, with or without a mesh, a function that returns its ``transform``,
        (4, 4), for a time, such as a `TransformTrack`. That is relative to the node's parent, which
        nodes of glTF files may have; a pose in the world is
        ``inverse(node.parent.world_matrix) @ pose`` there (`transforms.inverse`).
    meshes : dict, optional
        By node of the scene a function that returns a mesh for a time, such as a `MorphTrack`.
    animation : str, int, Animation or a sequence of them, optional
        Which of the scene's animations play, as in `Scene.at`; 0 is the first. Tracks of the same
        nodes act after them. Default: none.
    loop : bool
        Whether the animation begins again when it has ended; else it stays at its last key.
    outputs, background, cull
        As in `rasterjit.render`.

    Yields
    ------
    Frame

    Raises
    ------
    ValueError
        At once, if a node or an animation is not one of the scene's or another argument is not
        such; with the first frame, what `rasterjit.render` refuses.
    """
    if not isinstance(renderer, Renderer):
        raise ValueError(f"renderer must be a Renderer, got {in_short(renderer)}")
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene, got {in_short(scene)}")
    if not isinstance(times, Iterable):
        raise ValueError(f"times must be numbers, got {in_short(times)}")
    repeats = true_or_false("loop", loop)
    moved = {} if transforms is None else transforms
    morphed = {} if meshes is None else meshes
    for name, tracks in (("transforms", moved), ("meshes", morphed)):
        if not isinstance(tracks, Mapping):
            raise ValueError(f"{name} must be functions by node, got {in_short(tracks)}")
        every = set(map(id, scene.every_node()))
        for node, track in tracks.items():
            if id(node) not in every:
                raise ValueError(f"{name} must have nodes of the scene as keys, got {node!r}")
            if not callable(track):
                raise ValueError(f"{name} must hold functions of time, got {in_short(track)}")
    played = () if animation is None else scene._chosen_animations(animation)
    length = max((one.duration for one in played), default=0.0) if repeats else math.inf
    channels = [channel for one in played for channel in one.channels]
    options = {"outputs": outputs, "background": background, "cull": cull}
    moves = _Moves(channels, length, dict(moved), dict(morphed))
    return _play(renderer, scene, times, camera, moves, options)


class _Moves(NamedTuple):
    """What moves nodes."""

    channels: list[Channel]
    length: float
    """Seconds after which the channels begin again."""
    transforms: Mapping[Node, TransformAt]
    meshes: Mapping[Node, MeshAt]

    def move(self, time: float) -> None:
        """Put the nodes where they are at a time."""
        when = time % self.length if 0.0 < self.length < math.inf else time
        parts: dict[Node, dict[str, Any]] = {}
        for channel in self.channels:
            parts.setdefault(channel.node, {})[channel.path] = channel.at(when)
        for node, values in parts.items():
            if "weights" in values:
                node.weights = values.pop("weights")
            if values:
                node.set_trs(**values)
        for node, track in self.transforms.items():
            node.transform = track(time)
        for node, mesh in self.meshes.items():
            node.mesh = mesh(time)

    def places(self) -> list[tuple[Node, _NodeState]]:
        """Return all nodes that move, and where they are."""
        animated = dict.fromkeys(channel.node for channel in self.channels)
        return [
            (node, _NodeState(node.transform, node.trs if node in animated else None, node.mesh,
                          node.weights))
            for node in {**animated, **self.transforms, **self.meshes}
        ]  # fmt: skip


class _NodeState(NamedTuple):
    """What of a node changes."""

    transform: NDArray[np.float64]
    trs: TRS | None
    """None where nothing changes these parts alone."""
    mesh: Mesh | None
    weights: NDArray[np.float64] | None

    def put_back(self, node: Node) -> None:
        """Let a node be as it was."""
        if node.mesh is not self.mesh:
            node.mesh = self.mesh  # type: ignore[assignment]
        node.weights = self.weights
        if self.trs is not None:
            node.set_trs(*self.trs)
        if self.trs is None or not np.array_equal(node.transform, self.transform):
            # It was no product of these parts.
            node.transform = self.transform


def _play(
    renderer: Renderer,
    scene: Scene,
    times: Iterable[float],
    camera: Camera | CameraAt | None,
    moves: _Moves,
    options: dict[str, Any],
) -> Iterator[Frame]:
    """Move the nodes and render, time after time; put everything back at the end."""
    before = moves.places()

    def camera_at(time: float) -> Camera | None:
        """Return the camera at a time; None if one fits the scene."""
        seen_by = camera(time) if callable(camera) else camera
        return scene.camera if seen_by is None else seen_by

    def look_at(seen_by: Camera) -> BesidePlanes:
        """Return what a camera sees beside its planes, of the nodes as they are."""
        return look_from(scene, seen_by, renderer.size, renderer.quality)

    try:
        look, is_known = NO_LOOK, isinstance(camera, CameraTrack) or not callable(camera)
        ahead = is_known and isinstance(times, (Sequence, np.ndarray)) and len(times) <= MAX_AHEAD
        if ahead:
            # Planes that cameras leave open are in one place for all frames.
            for given in times:
                time = finite_number("times", given)
                if needs_settling(seen_by := camera_at(time)):
                    moves.move(time)
                    look = look.beside(look_at(seen_by))
        for given in times:
            time = finite_number("times", given)
            moves.move(time)
            seen_by = camera_at(time)
            if needs_settling(seen_by):
                # Those that nobody has looked at ahead come no farther away again.
                look = look if ahead else look.beside(look_at(seen_by))
                seen_by = settled(seen_by, *look.steps)
            if seen_by is None:
                # What turns keeps its size.
                seen_by = fit_upright(scene, renderer.size, steady=True)
            yield renderer.render(scene, seen_by, **options)
    finally:
        for node, place in before:
            place.put_back(node)


def save(
    frames: Iterable[Frame | NDArray[np.uint8]], path: str | Path, *, fps: float = 24.0
) -> None:
    """
    Write an animation that repeats for ever; the format follows the extension.

    Frames are encoded as they come and not kept: the memory needed does not grow with their number.
    ``rich.progress.track(frames, total=...)`` in place of the frames shows how far it has come.

    Parameters
    ----------
    frames : iterable of Frame, or of (H, W, 4) or (H, W, 3) uint8
        At least one, all of one size; sRGB and alpha, or sRGB alone.
    path : str or Path
        ``.gif`` (at most 255 colours a frame, alpha below 128 is transparent), or, with the extra
        ``rasterjit[video]``, ``.webp`` and ``.apng`` (every bit is kept) and ``.mp4`` (H.264;
        opaque, even sides).
    fps : float
        Frames a second, in 1..50 for GIF and 1..120 for the others.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is unknown, ``fps`` is out of range, there is
        no frame, or one does not fit the format or the first.
    ImportError
        If the format needs ffmpeg and the extra ``rasterjit[video]`` is not installed.
    OSError
        If the file cannot be written.

    Notes
    -----
    Whatever is raised, Ctrl-C and errors of ``frames`` included, a file that was there before is
    left as it was, and no other remains; an iterator of frames is closed, so that the nodes that
    `frames` moves are where they were.
    """
    if not isinstance(frames, Iterable):
        raise ValueError(f"frames must be an iterable of frames, got {in_short(frames)}")
    pictures = (frame.color if isinstance(frame, Frame) else frame for frame in frames)
    try:
        save_animation(path, pictures, fps)
    finally:
        # What is played puts the nodes back when it is closed, not when the last frame is shown.
        if isinstance(frames, Iterator) and hasattr(frames, "close"):
            frames.close()
