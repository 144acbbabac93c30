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
from rasterjit.outputs.colorbar import append_bar, draw_colorbar, read_bar_title
from rasterjit.outputs.contact_sheet import join_scales
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import Outputs
from rasterjit.rendering.planning import Cull, find_scene_plane_needs, has_open_plane
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, move_planes
from rasterjit.scene.camera_fitting import default_camera
from rasterjit.scene.decomposed_transform import TRS
from rasterjit.scene.keyframes import Animation, Channel
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import boolean, brief, finite_number, instance_of
from rasterjit.survey.clip_planes import NO_PLANE_NEEDS, PlaneNeeds

CameraAt = Callable[[float], Camera]
TransformAt = Callable[[float], ArrayLike]
MeshAt = Callable[[float], Mesh]
AnimationsLike: TypeAlias = str | int | Animation | Sequence[str | int | Animation]


MAX_SURVEYED_TIMES = 10_000
"""Most times that are surveyed for automatic near and far planes before the first frame."""


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
    Render one frame for each time, as frames are taken.

    The nodes are restored when the last frame has been taken, or the iterator is closed.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    times : iterable of float, seconds
    camera : Camera or callable, optional
        What shows the scene, or a function that returns it for a time, such as a `CameraTrack`.
        Default: the scene's, else one that fits the scene's bounding sphere at each time, so that
        what turns keeps its size. An automatic near plane is the same for all frames of a camera
        or a `CameraTrack` at a sequence of up to 10,000 times. For other functions and times it
        may only move nearer from frame to frame.
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
        At once, if a node or an animation is not one of the scene's or another argument is
        invalid; with the first frame, what `rasterjit.render` refuses.
    """
    instance_of("renderer", renderer, Renderer)
    instance_of("scene", scene, Scene)
    if not isinstance(times, Iterable):
        raise ValueError(f"times must be numbers, got {brief(times)}")
    repeats = boolean("loop", loop)
    transform_tracks = {} if transforms is None else transforms
    mesh_tracks = {} if meshes is None else meshes
    for name, tracks in (("transforms", transform_tracks), ("meshes", mesh_tracks)):
        if not isinstance(tracks, Mapping):
            raise ValueError(f"{name} must be functions by node, got {brief(tracks)}")
        scene_nodes = set(map(id, scene.every_node()))
        for node, track in tracks.items():
            if id(node) not in scene_nodes:
                raise ValueError(f"{name} must have nodes of the scene as keys, got {node!r}")
            if not callable(track):
                raise ValueError(f"{name} must hold functions of time, got {brief(track)}")
    clips = () if animation is None else scene._choose_animations(animation)
    loop_duration = max((clip.duration for clip in clips), default=0.0) if repeats else math.inf
    channels = [channel for clip in clips for channel in clip.channels]
    options = {"outputs": outputs, "background": background, "cull": cull}
    motion = _Motion(channels, loop_duration, dict(transform_tracks), dict(mesh_tracks))
    return _play(renderer, scene, times, camera, motion, options)


class _Motion(NamedTuple):
    """Channels and tracks that move nodes."""

    channels: list[Channel]
    loop_duration: float
    """Seconds after which the channels begin again."""
    transforms: Mapping[Node, TransformAt]
    meshes: Mapping[Node, MeshAt]

    def move(self, time: float) -> None:
        """Set the nodes to their states at a time, seconds."""
        clip_time = time % self.loop_duration if 0.0 < self.loop_duration < math.inf else time
        values_by_node: dict[Node, dict[str, Any]] = {}
        for channel in self.channels:
            values_by_node.setdefault(channel.node, {})[channel.path] = channel.at(clip_time)
        for node, values in values_by_node.items():
            if "weights" in values:
                node.weights = values.pop("weights")
            if values:
                node.set_trs(**values)
        for node, track in self.transforms.items():
            node.transform = track(time)
        for node, mesh in self.meshes.items():
            node.mesh = mesh(time)

    def save_states(self) -> list[tuple[Node, _NodeState]]:
        """Return all nodes that move, each with its state."""
        animated = dict.fromkeys(channel.node for channel in self.channels)
        return [
            (node, _NodeState(node.transform, node.trs if node in animated else None, node.mesh,
                          node.weights))
            for node in {**animated, **self.transforms, **self.meshes}
        ]  # fmt: skip


class _NodeState(NamedTuple):
    """State of a node that an animation changes."""

    transform: NDArray[np.float64]
    trs: TRS | None
    """None if no channel changes translation, rotation or scale."""
    mesh: Mesh | None
    weights: NDArray[np.float64] | None

    def restore(self, node: Node) -> None:
        """Restore the state of a node."""
        if node.mesh is not self.mesh:
            node.mesh = self.mesh  # type: ignore[assignment]
        node.weights = self.weights
        if self.trs is not None:
            node.set_trs(*self.trs)
        if self.trs is None or not np.array_equal(node.transform, self.transform):
            # The transform was no product of translation, rotation and scale.
            node.transform = self.transform


def _play(
    renderer: Renderer,
    scene: Scene,
    times: Iterable[float],
    camera: Camera | CameraAt | None,
    motion: _Motion,
    options: dict[str, Any],
) -> Iterator[Frame]:
    """Move the nodes and render each time; restore the nodes at the end."""
    states = motion.save_states()

    def camera_at(time: float) -> Camera | None:
        """Return the camera at a time; None if one fits the scene."""
        view_camera = camera(time) if callable(camera) else camera
        return scene.camera if view_camera is None else view_camera

    def find_plane_needs(view_camera: Camera) -> PlaneNeeds:
        """Return what the nodes in their current states need of automatic planes."""
        return find_scene_plane_needs(scene, view_camera, renderer.size, renderer.quality)

    try:
        plane_needs = NO_PLANE_NEEDS
        is_known = isinstance(camera, CameraTrack) or not callable(camera)
        is_short = isinstance(times, (Sequence, np.ndarray)) and len(times) <= MAX_SURVEYED_TIMES
        is_surveyed = is_known and is_short
        if is_surveyed:
            # Automatic planes are the same for all frames.
            for raw_time in times:
                time = finite_number("times", raw_time)
                if has_open_plane(view_camera := camera_at(time)):
                    motion.move(time)
                    plane_needs = plane_needs.merge(find_plane_needs(view_camera))
        for raw_time in times:
            time = finite_number("times", raw_time)
            motion.move(time)
            view_camera = camera_at(time)
            if has_open_plane(view_camera):
                if not is_surveyed:
                    # Without a survey, planes only move nearer from frame to frame.
                    plane_needs = plane_needs.merge(find_plane_needs(view_camera))
                view_camera = move_planes(view_camera, *plane_needs.steps)
            if view_camera is None:
                # Fit the bounding sphere, so that a turning scene keeps its size.
                view_camera = default_camera(scene, renderer.size, steady=True)
            yield renderer.render(scene, view_camera, **options)
    finally:
        for node, state in states:
            state.restore(node)


def save(
    frames: Iterable[Frame | NDArray[np.uint8]],
    path: str | Path,
    *,
    fps: float = 24.0,
    colorbar: bool | str = False,
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
    colorbar : bool or str
        Whether frames have a colour bar to the right, or its title: that of the first for all, so
        they have one height, and their scalars one colormap, norm and range. It has arrows and the
        colour of NaN only if the first frame has values beyond the range, and NaN.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is unknown, ``fps`` is out of range, there is
        no frame, or one does not fit the format or the first, or the scale of its colour bar.
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
        raise ValueError(f"frames must be an iterable of frames, got {brief(frames)}")
    title = read_bar_title(colorbar)
    pictures = _take_pictures(frames) if colorbar is False else _append_bars(frames, title)
    try:
        save_animation(path, pictures, fps)
    finally:
        # `frames` restores the nodes when it is closed.
        if isinstance(frames, Iterator) and hasattr(frames, "close"):
            frames.close()


def _take_pictures(
    frames: Iterable[Frame | NDArray[np.uint8]],
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures as they are."""
    for frame in frames:
        yield frame.color if isinstance(frame, Frame) else frame


def _append_bars(
    frames: Iterable[Frame | NDArray[np.uint8]], title: str
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures with the colour bar of the first frame, of an even width for MP4."""
    first: ColorScale | None = None
    for n, frame in enumerate(frames):
        scale = join_scales([frame], n)
        picture = frame.color if isinstance(frame, Frame) else frame
        if first is None:
            first, bar = scale, draw_colorbar(scale, len(picture), title)
            if (bar.shape[1] + picture.shape[1]) % 2:
                bar = append_bar(bar, bar[:, -1:])
        elif not scale.equals(first):
            raise ValueError(
                "colorbar must be False where frames differ in colormap, norm or range: give them "
                "one range=(low, high)"
            )
        if len(picture) != len(bar):
            raise ValueError(
                f"frames must all be {len(bar)} pixels high as the first is, got {len(picture)} as "
                f"number {n}"
            )
        yield append_bar(picture, bar)
