"""Lines: segments between points, drawn with a width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float32, Float64, Int32, Int64
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.colormap import ColormapLike
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh, OnInvalid, Primitive, index_rows
from rasterjit.scene.norm import NormLike, RangeLike
from rasterjit.scene.points import UNITS, Unit, expand_color, size_array

DEFAULT_COLOR = 0.0, 0.0, 0.0
"""Colour of lines if none is given."""

AXIS_COLORS = (0.8, 0.02, 0.02), (0.02, 0.5, 0.02), (0.02, 0.1, 0.9)
"""Colours of x, y and z, linear light."""

Cap: TypeAlias = Literal["round", "butt"]
CAPS: tuple[Cap, ...] = get_args(Cap)
"""Shapes of the ends of strips."""


class Lines(Mesh):
    """
    Segments between points, drawn with a width: trajectories, frames, drawings, wireframes.

    They stand in a scene as a `Mesh` does: nodes, transforms, names and materials are the same, and
    so are all outputs. ``face_id`` counts segments where it counts faces of a mesh; ``barycentric``
    and ``uv`` hold nothing, and normals turn toward the viewer. Like a mesh they own their arrays,
    which are read-only.

    A pixel, or a sample, belongs to a segment if its centre lies within half the width of it in the
    picture; ends are rounded to the sub-pixel grid, and widths up to it, so that a line of a pixel
    or more has no gap. A segment that has no length in the picture, as one seen end-on, is a round
    cap around its point, or, a pixel wide or more, the pixel that holds it if that misses all
    centres; nothing with ``caps="butt"`` or dashes. It has the depth, and values between those of
    its ends, of the nearest point of the segment in the picture. Joints are round. What is round is
    a polygon, at most 1/16 of a pixel, or 0.3 in lines up to two pixels wide, inside the circle.
    Where a line bends, the two segments overlap on the inner side: see-through lines show twice
    there.

    Widths in scene units are cut to 7680 pixels. Those in pixels cast no shadows.

    Parameters
    ----------
    points : (V, 3) array_like
        Model-space positions, in scene units.
    segments : (S, 2) array_like of int, optional
        Numbers of the points at the ends of each segment. One that begins at the point where the
        one before it ended is joined to it: they are of one strip. Default: one strip through all
        points.
    strips : sequence of (N,) array_like of int, optional
        In place of ``segments``: the numbers of the points that each strip of segments passes,
        two or more; the same number first and last closes it.
    colors : (V, 3|4) or (S, 3|4) array_like, or colour, optional
        Colour of each point, which changes along the segments, or, with S rows, of each segment (V
        rows win where V equals S). ``uint8`` is sRGB; floats in 0..1 are linear light. Or of all: a
        name, ``'#rrggbb'``, three or four floats, or a ``uint8`` array of three or four.
    width : float or (S,) array_like
        Of all segments or of each, above 0.
    unit : {"pixel", "world"}
        What widths are in: pixels of the picture (at most 4096), or scene units, which shrink with
        distance and which the node's transform scales.
    caps : {"round", "butt"}
        Ends of strips: rounded, half the width beyond the last point, or cut off there. Dashes are
        always cut off.
    dashes : sequence of float, optional
        Lengths of dash, gap, dash, gap ... in the unit of the width, an even number of them; they
        begin anew with each strip. Those in pixels are measured from where it comes into reach of
        the picture; a segment on which a period takes less than a pixel is solid. Default: solid.
    attributes : mapping of str to (V, D) or (S, D) array_like, optional
        Values of one's own by name, as `Mesh` takes them.
    scalars, colormap, range, norm, nan_color
        A number for each point or segment, shown by a colour map in the place of ``colors``; see
        `Mesh`.
    material : Material, optional
        Default: unlit, and black where there are neither colours nor scalars. Lines have no
        normals, so it has to be unlit.
    on_invalid : {"raise", "drop"}
        What to do about points that are NaN or infinite: refuse them, or keep the arrays as they
        are and leave out the segments that touch one.

    Raises
    ------
    ValueError
        If an array has the wrong shape or type or is empty, a segment points outside the points,
        both ``segments`` and ``strips`` are given, or a width or a dash is not above 0.

    Examples
    --------
    >>> import rasterjit as rj
    >>> rj.Lines([[0, 0, 0], [1, 0, 0], [1, 1, 0]], width=2.5)
    Lines(2 segments)
    """

    primitive: ClassVar[Primitive] = "lines"
    _depth_offset: tuple[float, float] = (0.0, 0.0)
    _ADVICE = "make other Lines"
    _VERTEX_WORDS = "points", "point"
    _DEFAULT_MATERIAL = Material("unlit", base_color=DEFAULT_COLOR)

    def __init__(
        self,
        points: ArrayLike,
        segments: ArrayLike | None = None,
        *,
        strips: Sequence[ArrayLike] | None = None,
        colors: ColorLike | None = None,
        width: ArrayLike = 1.5,
        unit: Unit = "pixel",
        caps: Cap = "round",
        dashes: Sequence[float] | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
        scalars: ArrayLike | None = None,
        colormap: ColormapLike = "viridis",
        range: RangeLike | None = None,
        norm: NormLike | None = None,
        nan_color: ColorLike | None = None,
        material: Material | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> None:
        if segments is not None and strips is not None:
            raise ValueError("strips must be None where segments are given")
        if material is None and colors is None and scalars is None:
            material = self._DEFAULT_MATERIAL
        self._unit: Unit = check.one_of("unit", unit, UNITS)
        self._caps: Cap = check.one_of("caps", caps, CAPS)
        _check_single_array(points)
        self._pairs = segments if strips is None else _Strips(strips)
        super().__init__(
            points, (), colors=colors, attributes=attributes, scalars=scalars,
            colormap=colormap, range=range, norm=norm,
            nan_color=nan_color, on_invalid=on_invalid,
            material=Material("unlit") if material is None else material,
        )  # fmt: skip
        self._widths = check.read_only(size_array("width", width, len(self), unit))
        self._dashes = check.read_only(_check_dashes(dashes, unit))
        self._links: Int32 | None = None

    @staticmethod
    def from_poses(
        poses: ArrayLike,
        *,
        axes: float | None = None,
        color: ColorLike = DEFAULT_COLOR,
        width: float = 2.0,
        unit: Unit = "pixel",
    ) -> Lines:
        """
        Return the path through poses, and the axes of each.

        Parameters
        ----------
        poses : (N, 4, 4) array_like
            ``world_from_body``, or ``world_from_camera``: transforms that take the origin to where
            it was; two or more.
        axes : float, optional
            Length of the axes, scene units: red, green and blue as those of `Axes`. 0: none.
            Default: a twentieth of the largest side of the box around the way.
        color : colour
            Of the way.
        width, unit
            As `Lines` takes them.

        Raises
        ------
        ValueError
            If poses have the wrong shape, are fewer than two or are not finite.

        Examples
        --------
        >>> import numpy as np
        >>> import rasterjit as rj
        >>> poses = [rj.transforms.translate((n, 0, 0)) for n in range(3)]
        >>> rj.Lines.from_poses(poses)
        Lines(11 segments)
        """
        matrices = check.finite_array("poses", poses, (None, 4, 4))
        count = len(matrices)
        if count < 2:
            raise ValueError(f"poses must be two or more, got {count}")
        path = matrices[:, :3, 3]
        if axes is None:
            size = 0.05 * float((path.max(axis=0) - path.min(axis=0)).max())
        else:
            size = check.bounded_number("axes", axes, 0.0, np.inf)
        indices = np.arange(count)
        points, segments = [path], [np.stack([indices[:-1], indices[1:]], axis=1)]
        colors = [np.tile(linear_color("color", color), (count - 1, 1))]
        if size > 0.0:
            tips = path[:, np.newaxis] + size * matrices[:, :3, :3].transpose(0, 2, 1)
            points.append(tips.reshape(-1, 3))
            segments.append(np.stack([np.repeat(indices, 3), count + np.arange(3 * count)], axis=1))
            colors.append(np.tile(np.hstack([AXIS_COLORS, np.ones((3, 1))]), (count, 1)))
        # There is one point more than there are segments, so these are colours of segments.
        return Lines(
            np.concatenate(points), np.concatenate(segments),
            colors=np.concatenate(colors), width=width, unit=unit,
        )  # fmt: skip

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        Mesh._check_material(name, value)
        if value.shading != "unlit":
            raise ValueError(
                f"{name} must be unlit, for lines have no normals; got {value.shading!r}"
            )

    @property
    def points(self) -> Float64:
        """(V, 3) float64, read-only: model-space positions, which are the ``vertices``."""
        return self._vertices

    @property
    def colors(self) -> Float32 | None:
        """
        (V, 4) or (S, 4) float32, linear RGBA, read-only: as they were given, or ``None``.

        Those of points are ``vertex_colors``, those of segments ``face_colors``.
        """
        return self._face_colors if self._vertex_colors is None else self._vertex_colors

    @property
    def attributes(self) -> Mapping[str, Float32]:
        """Values of one's own by name, (V, D) of points or (S, D) of segments; read-only."""
        return MappingProxyType({**self._vertex_attributes, **self._face_attributes})

    @property
    def segments(self) -> Int32:
        """(S, 2) int32, read-only: numbers of the points at the ends of each segment."""
        return self.faces[:, :2]

    @property
    def unit(self) -> Unit:
        """Unit of widths and dashes."""
        return self._unit

    @property
    def widths(self) -> Float64:
        """(S,) float64, or (1,) where all are the same; read-only."""
        return self._widths

    @property
    def dashes(self) -> Float64:
        """(D,) float64, read-only: lengths of dash, gap, dash, gap ...; (0,) where solid."""
        return self._dashes

    @property
    def caps(self) -> Cap:
        """Shape of the ends of strips."""
        return self._caps

    @property
    def depth_offset(self) -> tuple[float, float]:
        """Offset (right, down), pixels, from a sample to where depth and attributes are read."""
        return self._depth_offset

    @property
    def links(self) -> Int32:
        """
        (S, 2) int32: the segments that each is joined to, the one before and the one behind it.

        -1 where there is none. The first and the last segment of a closed strip are joined, too.
        """
        if self._links is None:
            self._links = _neighbour_segments(self.faces)
        return self._links

    def __len__(self) -> int:
        return len(self.faces)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} segments)"

    def _face_array(self, faces: Any) -> Int32:
        """Return a face for each segment, with its second point twice."""
        count, pairs = len(self._vertices), self.__dict__.pop("_pairs")
        if isinstance(pairs, _Strips):
            segments = _split_strips(pairs.strips, count)
        elif pairs is None:
            if count < 2:
                raise ValueError(f"points must be two or more without segments, got {count}")
            segments, _ = split_into_segments(np.arange(count, dtype=np.int32), np.array([count]))
        else:
            segments = index_rows(("segments", "points"), pairs, count, 2)
        return np.ascontiguousarray(segments[:, [0, 1, 1]])

    def _store_colors(self, colors: ColorLike) -> None:
        """Store colours by point or by segment; one of all as that of each segment."""
        rows = expand_color(colors, len(self))
        if rows is colors:
            super()._store_colors(colors)
        else:
            self._face_colors = check.read_only(np.asarray(rows, np.float32))

    def split_creases(self, angle: float = 40.0) -> Lines:
        """Return the lines themselves, which have no faces that meet."""
        return self


def _neighbour_segments(faces: Int32) -> Int32:
    """Return the segments before and after each in its strip, (S, 2) int32; -1 for none."""
    count, indices = len(faces), np.arange(len(faces), dtype=np.int32)
    is_first = np.append(True, faces[1:, 0] != faces[:-1, 1])
    is_last = np.append(is_first[1:], True)
    links = np.stack([np.where(is_first, -1, indices - 1), np.where(is_last, -1, indices + 1)], 1)
    firsts, lasts = np.flatnonzero(is_first), np.flatnonzero(is_last)
    is_closed = (faces[firsts, 0] == faces[lasts, 1]) & (firsts < lasts)
    links[firsts[is_closed], 0], links[lasts[is_closed], 1] = lasts[is_closed], firsts[is_closed]
    return np.ascontiguousarray(links, np.int32).reshape(count, 2)


def _check_single_array(points: Any) -> None:
    """Raise ``ValueError`` if points are a list of arrays of points."""
    if not isinstance(points, (list, tuple)) or not points:
        return
    if all(isinstance(item, np.ndarray) and item.ndim == 2 for item in points):
        raise ValueError(
            f"points must be one array, (V, 3), got {len(points)} arrays; join them with "
            "np.concatenate, and give as strips the numbers of each one's points"
        )


class _Strips:
    """Wrapper that marks faces as strips, not segments."""

    def __init__(self, strips: Sequence[ArrayLike]) -> None:
        self.strips = strips


def _split_strips(strips: Sequence[ArrayLike], count: int) -> Int32:
    """Split strips into segments, (S, 2) int32, or raise ``ValueError``."""
    arrays = [
        _check_strip(f"strips[{number}]", strip, strips, count)
        for number, strip in enumerate(_check_strip_list(strips))
    ]
    if not arrays:
        raise ValueError("strips must hold one strip or more, got none")
    return split_into_segments(np.concatenate(arrays), np.array([len(rows) for rows in arrays]))[0]


def _check_strip_list(strips: Sequence[ArrayLike]) -> list[ArrayLike]:
    """Return the strips as a list, or raise ``ValueError``."""
    try:
        if isinstance(strips, (str, bytes, Mapping)):
            raise TypeError
        return list(check.sequence("strips", strips))
    except (TypeError, ValueError):
        raise ValueError(
            f"strips must be a sequence of sequences of point numbers, got {check.brief(strips)}"
        ) from None


def _check_strip(name: str, strip: ArrayLike, strips: Any, count: int) -> Int32:
    """Return the numbers of the points of a strip, (N,) int32, or raise ``ValueError``."""
    try:
        shape = check.unmasked_array(name, strip).shape
    except ValueError:
        raise ValueError(f"{name} must be point numbers, (N,), got {check.brief(strip)}") from None
    if shape == ():
        raise ValueError(
            "strips must be a sequence of sequences of point numbers, as [[0, 1, 2]], got "
            f"{check.brief(strips)}"
        )
    if len(shape) == 2 and shape[1] == 3:
        raise ValueError(
            f"{name} must be point numbers, (N,), got shape {shape}; of arrays of points, join "
            "these with np.concatenate, and give as strips the numbers of each one's points"
        )
    if len(shape) != 1 and not (len(shape) == 2 and shape[1] == 1):
        raise ValueError(f"{name} must be point numbers, (N,), got shape {shape}")
    if shape[0] < 2:
        raise ValueError(f"{name} must have two or more points, got {shape[0]}")
    return index_rows((name, "points"), np.reshape(strip, (-1, 1)), count, 1)[:, 0]


def split_into_segments(
    corners: NDArray[np.integer[Any]], counts: Int64
) -> tuple[NDArray[Any], Int64]:
    """
    Split concatenated strips into segments.

    Parameters
    ----------
    corners : (N,) int
        Numbers of the points of all strips.
    counts : (C,) int
        How many of them each strip has.

    Returns
    -------
    segments : (S, 2) int
        Of the type of the corners.
    strips : (S,) int64
        The strip of each.
    """
    has_next = np.ones(len(corners), bool)
    has_next[np.cumsum(counts)[counts > 0] - 1] = False
    starts = np.flatnonzero(has_next)
    strips = np.repeat(np.arange(len(counts)), counts)
    return np.column_stack([corners[starts], corners[starts + 1]]), strips[starts]


def _check_dashes(dashes: Sequence[float] | None, unit: Unit) -> Float64:
    """Return dashes and gaps, (D,) float64, (0,) without, or raise ``ValueError``."""
    if dashes is None:
        return np.empty(0)
    if check.unmasked_array("dashes", dashes).ndim != 1 or len(dashes) == 0 or len(dashes) % 2:
        raise ValueError(
            f"dashes must be an even number of lengths, dash, gap ..., got {check.brief(dashes)}"
        )
    return size_array("dashes", dashes, len(dashes), unit)
