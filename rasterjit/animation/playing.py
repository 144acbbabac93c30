"""Render what moves, one frame for each time, and write the frames as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.animation.video import save_animation
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.table import Outputs
from rasterjit.rendering.plan import Cull
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import finite_number, in_short

CameraAt = Callable[[float], Camera]
TransformAt = Callable[[float], ArrayLike]
MeshAt = Callable[[float], Mesh]


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
        Default: as in `rasterjit.render`.
    transforms : dict, optional
        By node of the scene, with or without a mesh, a function that returns its ``transform``,
        (4, 4), for a time, such as a `TransformTrack`.
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
    try:
        for given in times:
            time = finite_number("times", given)
            for node, track in moved.items():
                node.transform = track(time)
            for node, track in morphed.items():
                node.mesh = track(time)
            seen_by = camera(time) if callable(camera) else camera
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
