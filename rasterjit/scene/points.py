"""Points: positions without faces, each drawn as a square, a disc or a sphere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.colormap import ColormapLike
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh, OnInvalid, Primitive
from rasterjit.scene.norm import NormLike, RangeLike
from rasterjit.scene.validation import brief, one_of, read_only, unmasked_array

Unit: TypeAlias = Literal["pixel", "world"]
UNITS: tuple[Unit, ...] = get_args(Unit)
"""Units of sizes and widths."""

PointShape: TypeAlias = Literal["square", "disc", "sphere"]
POINT_SHAPES: tuple[PointShape, ...] = get_args(PointShape)

POINT_SHADINGS = ("unlit", "phong", "pbr")
"""Ways of shading that points may have."""

MAX_PIXELS = 4096.0
"""Largest size of a point, and width of a line, in pixels."""


POINT_GRAY = 0.2, 0.2, 0.2
"""Linear colour of points if none is given: visible on white, and on black."""


class Points(Mesh):
    """
    Points, drawn as squares, discs or spheres: a scan, particles, keypoints.

    They stand in a scene as a `Mesh` does: nodes, transforms, names and materials are the same, and
    so are all outputs but those of `render_layers`, which refuses discs and spheres. ``face_id``
    counts points where it counts faces of a mesh. Like a mesh they own their arrays, which are
    read-only.

    Parameters
    ----------
    positions : (N, 3) array_like
        Model-space positions of the centres, in scene units.
    colors : (N, 3|4) array_like or colour, optional
        Colour of each point: ``uint8`` is sRGB, floats in 0..1 are linear light. Or of all: a name,
        ``'#rrggbb'``, three or four floats, or a ``uint8`` array of three or four. As for meshes,
        alpha counts with the material's ``alpha_mode="blend"`` alone, and for squares alone.
    size : float or (N,) array_like
        Side of squares, diameter of discs and spheres, of all or of each, above 0.
    unit : {"pixel", "world"}
        What sizes are in: pixels of the picture (at most 4096), or scene units, which shrink with
        distance and which the node's transform scales. Spheres take ``"world"`` alone.
    shape : {"square", "disc", "sphere"}
        Squares, upright in the picture, and discs face the viewer and have the depth of their
        centre all over. Spheres have the depth and the normals of a sphere.
    normals : (N, 3) array_like, optional
        Model-space normals of any length, by which squares and discs are lit; spheres have their
        own.
    attributes : mapping of str to (N, D) array_like, optional
        Values of one's own by name, as `Mesh` takes them.
    scalars, colormap, range, norm, nan_color
        A number for each point, (N,), shown by a colour map in the place of ``colors``; see `Mesh`.
    material : Material, optional
        Default: lit as `Material` says where there are normals or spheres, else unlit. It is
        shaded ``"unlit"``, ``"phong"`` or ``"pbr"``, and has no alpha mask; that of discs and
        spheres is opaque. Points that are lit without normals face the viewer.
    on_invalid : {"raise", "drop"}
        What to do about points that are NaN or infinite: refuse them, or keep the arrays as they
        are and leave out those points.

    Raises
    ------
    ValueError
        If an array has the wrong shape or type or is empty, a size is not above 0 or not finite,
        spheres are measured in pixels or given normals, or a value is NaN or infinite where it may
        not be.

    Examples
    --------
    >>> import numpy as np
    >>> import rasterjit as rj
    >>> heights = np.random.default_rng(1).random((500, 3))
    >>> rj.Points(heights, scalars=heights[:, 2], size=0.02, unit="world", shape="disc")
    Points(500 discs)
    """

    primitive: ClassVar[Primitive] = "points"
    _ADVICE = "make other Points"
    _VERTEX_WORDS = "positions", "position"
    _DEFAULT_MATERIAL = Material("unlit", base_color=POINT_GRAY)

    def __init__(
        self,
        positions: ArrayLike,
        *,
        colors: ColorLike | None = None,
        size: ArrayLike = 3.0,
        unit: Unit = "pixel",
        shape: PointShape = "square",
        normals: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
        scalars: ArrayLike | None = None,
        colormap: ColormapLike = "viridis",
        range: RangeLike | None = None,
        norm: NormLike | None = None,
        nan_color: ColorLike | None = None,
        material: Material | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> None:
        self._unit: Unit = one_of("unit", unit, UNITS)
        self._shape: PointShape = one_of("shape", shape, POINT_SHAPES)
        if shape == "sphere":
            if unit == "pixel":
                raise ValueError(
                    "unit must be 'world' where shape is 'sphere', got 'pixel'; discs may have "
                    "sizes in pixels"
                )
            if normals is not None:
                raise ValueError("normals must be None where shape is 'sphere', which has its own")
        if material is None and normals is None and shape != "sphere":
            is_plain = colors is None and scalars is None
            material = self._DEFAULT_MATERIAL if is_plain else Material("unlit")
        super().__init__(
            positions, (), colors=colors, normals=normals, attributes=attributes,
            scalars=scalars, colormap=colormap, range=range, norm=norm,
            nan_color=nan_color,
            material=material, on_invalid=on_invalid,
        )  # fmt: skip
        self._sizes = read_only(size_array("size", size, len(self), unit))

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        Mesh._check_material(name, value)
        if value.shading not in POINT_SHADINGS:
            raise ValueError(
                f"{name} must be shaded {', '.join(map(repr, POINT_SHADINGS))}, for a point has "
                f"one normal; got {value.shading!r}"
            )

    @property
    def positions(self) -> NDArray[np.float64]:
        """(N, 3) float64, read-only: model-space centres, which are the ``vertices``."""
        return self._vertices

    @property
    def colors(self) -> NDArray[np.float32] | None:
        """(N, 4) float32, linear RGBA, read-only: the colour of each point, or ``None``."""
        return self._face_colors

    @property
    def unit(self) -> Unit:
        """Unit of sizes."""
        return self._unit

    @property
    def shape(self) -> PointShape:
        """Shape of each point."""
        return self._shape

    @property
    def attributes(self) -> Mapping[str, NDArray[np.float32]]:
        """Values of one's own of the points, by name: (N, D) float32, read-only."""
        return self.face_attributes

    @property
    def sizes(self) -> NDArray[np.float64]:
        """(N,) float64, or (1,) where all are the same; read-only: sides or diameters."""
        return self._sizes

    def __len__(self) -> int:
        return len(self.vertices)

    def __repr__(self) -> str:
        return f"Points({len(self)} {self.shape}s)"

    def _face_array(self, faces: Any) -> NDArray[np.int32]:
        """Return a face of one vertex, three times, for each point."""
        numbers = np.arange(len(self._vertices), dtype=np.int32)
        return np.ascontiguousarray(np.broadcast_to(numbers[:, np.newaxis], (len(numbers), 3)))

    def _store_colors(self, colors: ColorLike) -> None:
        """Store colours as those of faces."""
        super()._store_colors(expand_color(colors, len(self)))
        self._face_colors, self._vertex_colors = self._vertex_colors, None

    def _store_attributes(self, attributes: Mapping[str, ArrayLike]) -> None:
        """Store attributes as those of faces."""
        super()._store_attributes(attributes)
        self._face_attributes, self._vertex_attributes = self._vertex_attributes, {}

    def _scalar_counts(self) -> tuple[int, int]:
        """Return -1 and the number of points: scalars are never interpolated."""
        return -1, len(self._faces)

    def used_vertices(self) -> NDArray[np.bool_]:
        """Mark the points, (N,) bool, that are finite."""
        if not self.invalid_vertices:
            return np.ones(len(self.vertices), bool)
        return np.all(np.isfinite(self.vertices), axis=1)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the smallest axis-parallel box around the points; around their sizes, in scene units.

        Returns
        -------
        low, high : (3,) float64
            Model-space corners, over the finite points.

        Raises
        ------
        ValueError
            If no point is finite.
        """
        if self._bounds is None and self.unit == "world":
            radii = np.broadcast_to(0.5 * self._sizes, len(self))[:, np.newaxis]
            mask = self.used_vertices()[:, np.newaxis]
            if mask.any():
                low, high = self.vertices - radii, self.vertices + radii
                self._bounds = (
                    low.min(axis=0, where=mask, initial=np.inf),
                    high.max(axis=0, where=mask, initial=-np.inf),
                )
        elif self._bounds is None and not self.invalid_vertices:
            self._bounds = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return super().bounds()

    def split_creases(self, angle: float = 40.0) -> Points:
        """Return the points themselves, which have no edges."""
        return self


def expand_color(colors: ColorLike, count: int) -> ArrayLike:
    """Repeat one colour as (count, 4) float32; return rows of colours as they are."""
    is_short = isinstance(colors, str) or not isinstance(colors, Sequence) or len(colors) in (3, 4)
    try:
        is_color = is_short and (
            isinstance(colors, str) or unmasked_array("colors", colors).shape in ((3,), (4,))
        )
    except ValueError:
        # Rows of unequal length: refused where they are read.
        return colors
    return np.tile(linear_color("colors", colors), (count, 1)) if is_color else colors


def size_array(name: str, value: ArrayLike, count: int, unit: Unit) -> NDArray[np.float64]:
    """Return a copy of sizes, (1,) or (count,) float64, or raise ``ValueError``."""
    try:
        numbers = unmasked_array(name, value)
        array = np.array(numbers, np.float64)
        if numbers.dtype.kind not in "uif":
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{name} must be a number or an array of numbers, got {brief(value)}"
        ) from None
    if array.ndim == 0:
        array = array.reshape(1)
    elif array.shape != (count,):
        raise ValueError(f"{name} must be one number or have shape ({count},), got {array.shape}")
    wrong = ~(np.isfinite(array) & (array > 0.0))
    if wrong.any():
        first = int(np.argmax(wrong))
        if np.ndim(value) == 0:
            raise ValueError(f"{name} must be finite and above 0, got {array[0].item()!r}")
        raise ValueError(
            f"{name} must be finite and above 0, got {int(wrong.sum())} of {len(array)} that are "
            f"not, the first being number {first}: {array[first].item()!r}"
        )
    if unit == "pixel" and array.max() > MAX_PIXELS:
        raise ValueError(
            f"{name} must be at most {MAX_PIXELS:g} pixels, got {array.max().item()!r}"
        )
    return array
