"""Render a world as ``pybullet.getCameraImage`` does."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pybullet
from numpy.typing import NDArray

from rasterjit.compat.opengl_camera import make_matrix_camera
from rasterjit.compat.pybullet.world_scene import LINK_SHIFT, LightSettings, WorldScene
from rasterjit.rendering.renderer import Renderer
from rasterjit.scene.light import unit_vector
from rasterjit.scene.validation import (
    bounded_number,
    brief,
    finite_array,
    one_of,
    read_only,
    whole_number,
)

Image: TypeAlias = tuple[
    int, int, NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]
]  # fmt: skip

RENDERERS = pybullet.ER_BULLET_HARDWARE_OPENGL, pybullet.ER_TINY_RENDERER

MAX_SINGLE_THREAD_PIXELS = 1 << 17
"""Pixels of a picture up to which several threads are not faster."""

_scenes: dict[int, WorldScene] = {}
"""Scene of each client."""


def getCameraImage(  # noqa: N802
    width: int, height: int, viewMatrix: Sequence[float] | None = None,
    projectionMatrix: Sequence[float] | None = None,
    lightDirection: Sequence[float] | None = None, lightColor: Sequence[float] | None = None,
    lightDistance: float = 2.0, shadow: int = 0, lightAmbientCoeff: float = 0.6,
    lightDiffuseCoeff: float = 0.35, lightSpecularCoeff: float = 0.05,
    renderer: int = pybullet.ER_BULLET_HARDWARE_OPENGL, flags: int = 0,
    projectiveTextureView: Sequence[float] | None = None,
    projectiveTextureProj: Sequence[float] | None = None, physicsClientId: int = 0,
) -> Image:  # fmt: skip
    """
    Return a picture of a client's world, with PyBullet's arguments and its tuple.

    Parameters
    ----------
    width, height : int, pixels
    viewMatrix, projectionMatrix : (16,) floats, optional
        By columns, as PyBullet's functions return them. Default: those of the window, if the
        client has one, else PyBullet's own for clients without.
    lightDirection : (3,) floats, optional
        World-space direction towards the light. Default: (-50, 30, 100).
    lightColor : (3,) floats, optional
        RGB in 0..1. Default: white.
    lightDistance : float
        Taken, and changes nothing: shadow maps are fitted to what is seen.
    shadow : int
        Whether the light casts shadows, which take a fifth of it, as TinyRenderer's do.
    lightAmbientCoeff, lightDiffuseCoeff, lightSpecularCoeff : float
        Shares of the colour of what is drawn, in 0..1e3.
    renderer : int
        ``ER_TINY_RENDERER``: pixels are sampled where TinyRenderer does it, at their lower left
        corners, and nothing is seen through. ``ER_BULLET_HARDWARE_OPENGL``: at their centres, and
        colours with an alpha below 1 are blended.
    flags : int
        ``ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX`` and ``ER_NO_SEGMENTATION_MASK``.
    projectiveTextureView, projectiveTextureProj : optional
        Named in a warning if ``flags`` ask for them: projective textures are not drawn.
    physicsClientId : int

    Returns
    -------
    width, height : int
    rgba : (H, W, 4) uint8
        White where nothing is; alpha is 255.
    depth : (H, W) float32
        OpenGL's depth buffer, 0 at the near plane, 1 at the far one and where nothing is.
    segmentation : (H, W) int32
        ``objectUniqueId``, plus ``(linkIndex + 1) << 24`` if ``flags`` ask for links; -1 where
        nothing is.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.

    Warns
    -----
    UserWarning
        Once of each, naming what of the world is not drawn.
    """
    size = whole_number("width", width, 1, 16384), whole_number("height", height, 1, 16384)
    one_of("renderer", renderer, RENDERERS)
    flags = whole_number("flags", flags, 0, (1 << 31) - 1)
    client = whole_number("physicsClientId", physicsClientId, 0, (1 << 31) - 1)
    bounded_number("lightDistance", lightDistance, 0.0, 1e30)
    is_tiny = renderer == pybullet.ER_TINY_RENDERER
    light = _read_cached(
        _read_light, lightDirection, lightColor, shadow, lightAmbientCoeff, lightDiffuseCoeff,
        lightSpecularCoeff,
    )  # fmt: skip
    if not pybullet.getConnectionInfo(client)["isConnected"]:
        raise ValueError(f"physicsClientId must be of a connected client, got {client}")
    view, clip = _get_matrices(viewMatrix, projectionMatrix, client)
    scene = _scenes.get(client)
    if scene is None or not scene.is_current:
        scene = _scenes[client] = WorldScene(client)
    scene.follow(light, is_opaque=is_tiny)
    if flags & pybullet.ER_USE_PROJECTIVE_TEXTURE:
        scene.warn(["projective textures"])
    return *size, *_draw(scene, view, clip, size, is_tiny, flags)


def _draw(
    scene: WorldScene, view: NDArray[np.float64], clip: NDArray[np.float64],
    size: tuple[int, int], is_tiny: bool, flags: int,
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:  # fmt: skip
    """Return colours, depth and segmentation."""
    width, height = size
    segmentation = np.full((height, width), -1, np.int32)
    if not scene.nodes:
        white = np.full((height, width, 4), 255, np.uint8)
        return white, np.ones((height, width), np.float32), segmentation
    shifted = clip.copy()
    if is_tiny:
        # Its samples lie at the lower left corners of pixels: move these to our centres.
        shifted[:2] += np.array([[1.0 / width], [1.0 / height]]) * clip[3]
    frame = _get_renderer(size).render(
        scene,
        make_matrix_camera(view, shifted),
        outputs=("linear", "depth", "object_id"),
        background="white",
    )
    codes = frame.linear * np.float32(255.0)
    codes += np.float32(0.5)
    rgba = np.minimum(codes, np.float32(255.0), out=codes).astype(np.uint8)
    rgba[..., 3] = 255
    if not flags & pybullet.ER_NO_SEGMENTATION_MASK:
        numbers = scene.numbers
        if not flags & pybullet.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX:
            numbers = np.where(numbers < 0, numbers, numbers & ((1 << LINK_SHIFT) - 1))
        # Empty pixels have index -1: the last row.
        numbers.take(frame.object_id, mode="wrap", out=segmentation)
    return rgba, _to_depth_buffer(frame.depth, clip), segmentation


def _to_depth_buffer(depth: NDArray[np.float32], clip: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return depth along the viewing axis as the number in 0..1 that a depth buffer holds."""
    scale, offset = 0.5 * clip[2, 2], 0.5 * clip[2, 3]
    if clip[3, 2]:
        buffer = np.float32(offset) / depth
        buffer += np.float32(0.5 - scale)
    else:
        buffer = np.float32(-scale) * depth
        buffer += np.float32(0.5 + offset)
    return np.clip(buffer, np.float32(0.0), np.float32(1.0), out=buffer)


@functools.lru_cache(maxsize=8)
def _get_renderer(size: tuple[int, int]) -> Renderer:
    """Return the renderer of pictures of a size."""
    is_small = size[0] * size[1] <= MAX_SINGLE_THREAD_PIXELS
    renderer = Renderer(size, threads=1 if is_small else None)
    renderer.warned = None
    return renderer


def _read_cached(function: Any, *values: Any) -> Any:
    """Call a cached function, also with lists and arrays."""
    try:
        return function(*(tuple(v) if isinstance(v, list | np.ndarray) else v for v in values))
    except TypeError:  # A list of lists.
        return function.__wrapped__(*values)


@functools.lru_cache(maxsize=64)
def _read_light(
    direction: Any, color: Any, shadow: Any, ambient: Any, diffuse: Any, specular: Any
) -> LightSettings:
    """Return what arguments say of the light."""
    toward = (-50.0, 30.0, 100.0) if direction is None else direction
    light = finite_array("lightColor", (1.0, 1.0, 1.0) if color is None else color, (3,))
    if light.min() < 0.0 or light.max() > 1e3:
        raise ValueError(f"lightColor must be three numbers in 0..1000, got {brief(color)}")
    return LightSettings(
        tuple(unit_vector("lightDirection", toward)),
        tuple(light.tolist()),
        bool(whole_number("shadow", int(shadow) if isinstance(shadow, bool) else shadow, 0, 1)),
        bounded_number("lightAmbientCoeff", ambient, 0.0, 1e3),
        bounded_number("lightDiffuseCoeff", diffuse, 0.0, 1e3),
        bounded_number("lightSpecularCoeff", specular, 0.0, 1e3),
    )


def _get_matrices(
    view: Any, projection: Any, client: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the view and projection matrix, (4, 4), of arguments or of PyBullet's defaults."""
    if view is None or projection is None:
        window = pybullet.getDebugVisualizerCamera(physicsClientId=client)
        own_view, own_projection = window[2:4] if window[0] else _get_default_matrices()
        view = own_view if view is None else view
        projection = own_projection if projection is None else projection
    return _read_cached(_read_view, view), _read_cached(_read_projection, projection)


@functools.lru_cache(maxsize=64)
def _read_view(view: Any) -> NDArray[np.float64]:
    """Return ``viewMatrix`` as a matrix, (4, 4)."""
    own = finite_array("viewMatrix", view, (16,)).reshape(4, 4).T.copy()
    if not np.allclose(own[3], (0.0, 0.0, 0.0, 1.0)):
        raise ValueError(
            "viewMatrix must end in the column (.., .., .., 1) of an affine matrix by columns, got "
            f"{brief(view)}"
        )
    own[3] = 0.0, 0.0, 0.0, 1.0
    return read_only(own)


@functools.lru_cache(maxsize=64)
def _read_projection(projection: Any) -> NDArray[np.float64]:
    """Return ``projectionMatrix`` as a matrix, (4, 4)."""
    clip = finite_array("projectionMatrix", projection, (16,)).reshape(4, 4).T.copy()
    if clip[2, :2].any() or clip[3, :2].any() or clip[3, 2] not in (0.0, -1.0):
        raise ValueError(
            "projectionMatrix must be one of computeProjectionMatrix or "
            f"computeProjectionMatrixFOV, 16 numbers by columns, got {brief(projection)}"
        )
    return read_only(clip)


@functools.cache
def _get_default_matrices() -> tuple[Any, Any]:
    """Return the matrices of PyBullet for clients without a window."""
    return (
        pybullet.computeViewMatrixFromYawPitchRoll((0.0, 0.0, 0.0), 1.5, -80.0, -10.0, 0.0, 2),
        pybullet.computeProjectionMatrixFOV(90.0, 4.0 / 3.0, 0.01, 1000.0),
    )
