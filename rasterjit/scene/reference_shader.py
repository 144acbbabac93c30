"""Describe shading and depth maps with which a scene reproduces pyrender's shader."""

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
    """(4, 4): the light's camera."""
    clip_from_view: NDArray[np.float64]
    """(4, 4): projection of the light's camera."""
    depths: NDArray[np.float32]
    """(S, S): depth along the light's axis, scene units, the lowest row first; infinite where no
    object is. S is a power of two."""


@dataclass(frozen=True, eq=False)
class ReferenceShading:
    """
    Shading of metallic-roughness objects as the fragment shader of pyrender 0.1.45 computes it.

    ``compat.pyrender`` requests it; see ``pipeline.lighting.pyrender`` for the formulas. Positions,
    directions and shadows are those of the scene's lights; their brightness is here, as it may be
    negative or out of range.
    """

    encoding: Curve
    """Encoding of colours: the power 1 / 2.2, or none, where nothing is lit."""
    radiance: NDArray[np.float32]
    """(L, 3): colour times intensity of each of the scene's lights."""
    ambient: NDArray[np.float32]
    """(3,): ambient light, which multiplies base colours."""
    light_mask: NDArray[np.uint8]
    """(O, L): 1 for each light that lights an object, 0 for others."""
    faces_viewer: NDArray[np.uint8]
    """(O,): 1 for objects without normals, whose normals point to the viewer."""
    are_squares: NDArray[np.uint8]
    """(O,): 1 for objects of two triangles for each point, which alone is lit."""
    gains: NDArray[np.float32]
    """(O, 6): RGB factors on base colours, then on vertex colours; 1 but for colours above 1."""
    maps: tuple[DepthMap, ...] = ()
    """Depth maps of the lights that cast shadows."""

    def select_objects(self, numbers: list[int]) -> ReferenceShading:
        """Return the shading of some of the objects."""
        return replace(
            self, light_mask=self.light_mask[numbers], faces_viewer=self.faces_viewer[numbers],
            are_squares=self.are_squares[numbers], gains=self.gains[numbers],
        )  # fmt: skip

    def check_counts(self, objects: int, lights: int) -> None:
        """Raise ``ValueError`` if a scene has other numbers of objects or lights."""
        counts = self.light_mask.shape
        if counts != (objects, lights):
            raise ValueError(
                f"scene must keep its {counts[0]} objects and {counts[1]} lights, for each is told "
                f"how it is lit as in pyrender; got {objects} and {lights}"
            )

    def equals(self, other: ReferenceShading | None) -> bool:
        """Tell whether another shading has the same values; False with depth maps."""
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
