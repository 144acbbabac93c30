"""Render what moves, one frame for each time, and write the frames as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.animation.tracks import CameraTrack
from rasterjit.animation.video import save_animation
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.table import Outputs
from rasterjit.rendering.plan import Cull
from rasterjit.rendering.renderer import Renderer
from rasterjit.rendering.views import look_from, needs_settling
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, settled
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import finite_number, in_short
from rasterjit.survey.clip_planes import NO_LOOK, Look

CameraAt = Callable[[float], Camera]
TransformAt = Callable[[float], ArrayLike]
MeshAt = Callable[[float], Mesh]


MOST_AHEAD = 10_000
"""Times that are looked at before the first frame is drawn, if a camera leaves a plane open."""


def frames(
    renderer: Renderer,
    scene: Scene,
    times: Iterable[float],
    *,
    camera: Camera | CameraAt | None = None,
    transforms: Mapping[Node, TransformAt] | None = None,
    meshes: Mapping[Node, MeshAt] | None = None,
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
        Default: as in `rasterjit.render`. If it leaves its near plane open, that is in one place
        for all frames: a camera or a `CameraTrack` is looked at ahead, at all of a sequence of up
        to 10,000 times. For other functions and times the plane never goes back.
    transforms : dict, optional
        By node of the scene, with or without a mesh, a function that returns its ``transform``,
        (4, 4), for a time, such as a `TransformTrack`. That is relative to the node's parent, which
        nodes of glTF files may have; a pose in the world is
        ``inverse(node.parent.world_matrix) @ pose`` there (`transforms.inverse`).
    meshes : dict, optional
        By node of the scene a function that returns a mesh for a time, such as a `MorphTrack`.
    outputs, background, cull
        As in `rasterjit.render`.

    Yields
    ------
    Frame

    Raises
    ------
    ValueError
        At once, if a node is not one of the scene's or another argument is not such; with the
        first frame, what `rasterjit.render` refuses.
    """
    if not isinstance(renderer, Renderer):
        raise ValueError(f"renderer must be a Renderer, got {in_short(renderer)}")
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene, got {in_short(scene)}")
    if not isinstance(times, Iterable):
        raise ValueError(f"times must be numbers, got {in_short(times)}")
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
    options = {"outputs": outputs, "background": background, "cull": cull}
    return _play(renderer, scene, times, camera, dict(moved), dict(morphed), options)


def _play(
    renderer: Renderer,
    scene: Scene,
    times: Iterable[float],
    camera: Camera | CameraAt | None,
    moved: Mapping[Node, TransformAt],
    morphed: Mapping[Node, MeshAt],
    options: dict[str, Any],
) -> Iterator[Frame]:
    """Move the nodes and render, time after time; put everything back at the end."""
    before = [(node, node.transform, node.mesh) for node in {**moved, **morphed}]

    def camera_at(time: float) -> Camera | None:
        """Return the camera at a time; None if one fits the scene."""
        seen_by = camera(time) if callable(camera) else camera
        return scene.camera if seen_by is None else seen_by

    def move(time: float) -> None:
        """Put the nodes where they are at a time."""
        for node, track in moved.items():
            node.transform = track(time)
        for node, track in morphed.items():
            node.mesh = track(time)

    def look_at(seen_by: Camera) -> Look:
        """Return what a camera sees beside its planes, of the nodes as they are."""
        return look_from(scene, seen_by, renderer.size, renderer.quality)

    try:
        look, is_known = NO_LOOK, isinstance(camera, CameraTrack) or not callable(camera)
        ahead = is_known and isinstance(times, (Sequence, np.ndarray)) and len(times) <= MOST_AHEAD
        if ahead:
            # Planes that cameras leave open are in one place for all frames.
            for given in times:
                time = finite_number("times", given)
                if needs_settling(seen_by := camera_at(time)):
                    move(time)
                    look = look.beside(look_at(seen_by))
        for given in times:
            time = finite_number("times", given)
            move(time)
            seen_by = camera_at(time)
            if needs_settling(seen_by):
                # Those that nobody has looked at ahead come no farther away again.
                look = look if ahead else look.beside(look_at(seen_by))
                seen_by = settled(seen_by, *look.steps)
            yield renderer.render(scene, seen_by, **options)
    finally:
        for node, place, mesh in before:
            node.transform, node.mesh = place, mesh


def save(
    frames: Iterable[Frame | NDArray[np.uint8]], path: str | Path, *, fps: float = 24.0
) -> None:
    """
    Write an animation that repeats for ever; the format follows the extension.

    Frames are encoded as they come and not kept: the memory needed does not grow with their number.
    ``rich.progress.track(frames, total=...)`` in place of the frames shows how far it has come.

    Parameters
    ----------
    frames : iterable of Frame, or of (H, W, 4) uint8
        At least one, all of one size; sRGB and alpha.
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
