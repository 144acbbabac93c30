"""That a scene is lit, and shown, as another program's shader does it."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.color import ROOT_BITS, decoding_table, integer_root

Curve: TypeAlias = Literal["gamma 2.2", "as is"]


@functools.cache
def decode_codes(encoding: Literal["srgb"] | Curve) -> NDArray[np.float32]:
    """Return the linear value of each code, (256,) float32: ``srgb_encoding.Encoding`` inverted."""
    if encoding == "srgb":
        return decoding_table()
    if encoding == "as is":
        return np.arange(256, dtype=np.float32) / np.float32(255.0)
    roots = [integer_root((code**11 << 5 * ROOT_BITS) // 255**11, 5) for code in range(256)]
    return np.array([root / (1 << ROOT_BITS) for root in roots], np.float32)


class DepthMap(NamedTuple):
    """Depth map of a light, for shadows."""

    light: int
    """Number of the light in the scene."""
    clip_from_world: NDArray[np.float64]
    """(4, 4): the camera that the light sees by."""
    clip_from_view: NDArray[np.float64]
    """(4, 4): its projection."""
    depths: NDArray[np.float32]
    """(S, S): depth along its axis, scene units, the lowest row first; infinite where nothing is. S
    is a power of two."""


@dataclass(frozen=True, eq=False)
class ReferenceShading:
    """
    Shading of metallic-roughness objects as the fragment shader of pyrender 0.1.45 computes it.

    ``compat.pyrender`` asks for it; see ``pipeline.lighting.pyrender`` for the formulas. Lights of
    the scene say where they are, which way they shine and whether they cast shadows; how bright
    they are stands here, for it may be negative, and is not held to a range.
    """

    encoding: Curve
    """How colours become codes: by the power 1 / 2.2, or as they are, where nothing is lit."""
    radiance: NDArray[np.float32]
    """(L, 3): colour times intensity of each of the scene's lights."""
    ambient: NDArray[np.float32]
    """(3,): ambient light, which multiplies base colours."""
    light_mask: NDArray[np.uint8]
    """(O, L): 1 for each light that lights an object, 0 for others."""
    faces_viewer: NDArray[np.uint8]
    """(O,): 1 for objects whose normals point to the viewer, for their meshes have none."""
    are_squares: NDArray[np.uint8]
    """(O,): 1 for objects of two triangles for each of the points that they stand for: light falls
    on these alone."""
    gains: NDArray[np.float32]
    """(O, 6): what base colours of objects are multiplied by, red, green and blue, and what colours
    of vertices are; 1 but for colours that were above 1."""
    maps: tuple[DepthMap, ...] = ()
    """Depth maps of the lights that cast shadows."""

    def of(self, numbers: list[int]) -> ReferenceShading:
        """Return the same for some of the objects."""
        return replace(
            self, light_mask=self.light_mask[numbers], faces_viewer=self.faces_viewer[numbers],
            are_squares=self.are_squares[numbers], gains=self.gains[numbers],
        )  # fmt: skip

    def check_counts(self, objects: int, lights: int) -> None:
        """Raise ``ValueError`` if a scene has another number of objects or lights than this."""
        counts = self.light_mask.shape
        if counts != (objects, lights):
            raise ValueError(
                f"scene must keep its {counts[0]} objects and {counts[1]} lights, for each is told "
                f"how it is lit as in pyrender; got {objects} and {lights}"
            )

    def equals(self, other: ReferenceShading | None) -> bool:
        """Tell whether another one has the same values."""
        return (
            other is not None
            and self.encoding == other.encoding
            and len(self.maps) == len(other.maps) == 0
            and all(
                a.shape == b.shape and a.tobytes() == b.tobytes()
                for a, b in zip(self._arrays, other._arrays, strict=True)
            )
        )

    @property
    def _arrays(self) -> tuple[NDArray[np.float32] | NDArray[np.uint8], ...]:
        of_objects = self.light_mask, self.faces_viewer, self.are_squares, self.gains
        return self.radiance, self.ambient, *of_objects
