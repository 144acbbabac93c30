"""A frame's triangles as the rasterizers of PyTorch3D and nvdiffrast return them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.pixel_projection import unproject
from rasterjit.survey.deformation import pose_input

if TYPE_CHECKING:
    from rasterjit.outputs.frame import Frame

NEEDED = ("face_id", "barycentric", "depth")
"""Outputs that the tuples are made of."""

MAX_WHOLE_FLOAT = 1 << 24
"""Up to here float32 holds all whole numbers."""

LARGE_ID_BITS = 0x4A800000
"""What nvdiffrast adds to larger numbers, to have the bits of a float32."""


class PyTorch3DFragments(NamedTuple):
    """
    The fields of PyTorch3D's ``Fragments``, as `Frame.to_pytorch3d` returns them.

    K is 1, or the number of layers of a `LayeredFrame`, nearest first. All are -1 where nothing is.

    Attributes
    ----------
    pix_to_face : (1, H, W, K) int64
        Face number, counted through all objects.
    zbuf : (1, H, W, K) float32
        Depth, scene units along the viewing axis.
    bary_coords : (1, H, W, K, 3) float32
        Perspective-correct weights of the face's vertices.
    dists : (1, H, W, K) float32 or None
        Squared distance from the pixel's centre to the nearest edge of its face, negative as inside
        of it, in NDC units: the shorter side of the picture has 2. ``None`` without the scene.
    """

    pix_to_face: NDArray[np.int64]
    zbuf: NDArray[np.float32]
    bary_coords: NDArray[np.float32]
    dists: NDArray[np.float32] | None


def make_pytorch3d(frame: Frame, what: Any) -> PyTorch3DFragments:
    """Return PyTorch3D's fragments; see `Frame.to_pytorch3d`."""
    face_id, weights, depth = _read_triangles(frame, "to_pytorch3d")
    seen, distances = face_id >= 0, None
    if what is not None:
        distances = np.full(face_id.shape, -1.0)
        distances[seen] = -np.square(_measure_edges(frame, what, face_id[seen], seen))

    def pack(values: NDArray[Any], dtype: str) -> NDArray[Any]:
        """Return values with an axis of one view, and that of layers behind those of pixels."""
        layers = values.reshape(-1, *face_id.shape[-2:], *values.shape[face_id.ndim :])
        return np.moveaxis(layers, 0, 2)[np.newaxis].astype(dtype, order="C")

    return PyTorch3DFragments(
        pack(face_id, "int64"),
        pack(np.where(seen, depth, -1.0), "float32"),
        pack(np.where(seen[..., np.newaxis], weights, -1.0), "float32"),
        None if distances is None else pack(distances, "float32"),
    )


def make_nvdiffrast(frame: Frame) -> NDArray[np.float32]:
    """Return what nvdiffrast's ``rasterize`` returns; see `Frame.to_nvdiffrast`."""
    face_id, weights, depth = _read_triangles(frame, "to_nvdiffrast")
    _refuse_lens(frame, "to_nvdiffrast")
    camera, size, seen = frame.plan.camera, frame.plan.size, face_id >= 0
    points = unproject(camera, _find_centres(frame, seen), depth[seen], size)
    clip_from_world = transforms.compose(camera.projection_matrix(size), camera.view_matrix())
    *_, z, w = transforms.transform_points(clip_from_world, points).T
    numbers = face_id[seen] + np.int64(1)
    large = (numbers + LARGE_ID_BITS).astype(np.int32).view(np.float32)
    result = np.zeros((*face_id.shape, 4), np.float32)
    result[seen, :2] = weights[seen, :2].clip(0.0, 1.0)
    result[seen, 2] = (z / w).clip(-1.0, 1.0)
    result[seen, 3] = np.where(numbers <= MAX_WHOLE_FLOAT, numbers.astype(np.float32), large)
    return np.ascontiguousarray(result[..., ::-1, :, :])


def _read_triangles(frame: Frame, name: str) -> list[NDArray[Any]]:
    """Return the outputs ``NEEDED``, or raise ``ValueError`` if the frame shows no triangles."""
    arrays = frame._require(name, NEEDED)
    facts = frame.plan.facts
    if facts.counts.primitives:
        raise ValueError(f"{name} needs a frame of meshes alone, got one with points or lines")
    if facts.fields["section"] is not None and arrays[0].max() >= frame._find_first_faces()[-1]:
        raise ValueError(f"{name} needs a frame of meshes alone, got one with caps of a section")
    return arrays


def _refuse_lens(frame: Frame, name: str) -> None:
    """Raise ``ValueError`` if a lens drew the frame."""
    if frame.plan.lens:
        raise ValueError(f"{name} needs a frame without a lens, got one with {frame.plan.lens}")


def _find_centres(frame: Frame, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the centres of pixels in the whole picture, (N, 2), x right, y down."""
    *_, rows, columns = seen.nonzero()
    column, row = frame.plan.corner
    return np.column_stack([columns + (column + 0.5), rows + (row + 0.5)])


def _measure_edges(
    frame: Frame, what: Any, faces: NDArray[np.int32], seen: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the distance, (N,), of each pixel to the nearest edge of its face, NDC units."""
    _refuse_lens(frame, "dists")
    nodes, starts = pose_input(what).nodes, frame._find_first_faces()
    counts = [len(node.mesh.faces) for node in nodes]
    if counts != np.diff(starts).tolist():
        raise ValueError(
            f"what must be the scene that was drawn, whose objects have {np.diff(starts).tolist()} "
            f"faces, got one with {counts}"
        )
    # Project the corners of the faces that are seen: x w, y w and w, pixels.
    camera, size = frame.plan.camera, frame.plan.size
    clip_from_world = transforms.compose(camera.projection_matrix(size), camera.view_matrix())
    screen_from_world = transforms.compose(transforms.viewport(*size), clip_from_world)
    numbers, places = np.unique(faces, return_inverse=True)
    corners = np.empty((len(numbers), 3, 3))
    for node, start, end in zip(nodes, starts, starts[1:], strict=False):
        own = (numbers >= start) & (numbers < end)
        points = node.mesh.vertices[node.mesh.faces[numbers[own] - start].reshape(-1)]
        matrix = transforms.compose(screen_from_world, node.world_matrix)
        projected = transforms.transform_points(matrix, points)
        corners[own] = projected[:, [0, 1, 3]].reshape(-1, 3, 3)
    # The lines of their edges: also where a corner is behind the eye, and from inside of a triangle
    # none is nearer than an edge.
    lines = np.cross(corners, np.roll(corners, -1, axis=1))
    lines /= np.sqrt(lines[..., :1] ** 2 + lines[..., 1:2] ** 2)
    x, y = _find_centres(frame, seen).T[..., np.newaxis]
    a, b, c = np.moveaxis(lines[places.reshape(-1)], 2, 0)
    return np.abs(a * x + b * y + c).min(axis=1) * 2.0 / min(size)
