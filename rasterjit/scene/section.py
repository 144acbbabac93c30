"""Sections: planes that cut a scene open, as in cutaway drawings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGBA, ColorLike, rgba
from rasterjit.scene.validation import VectorLike
from rasterjit.scene.vectors import unit

MAX_PLANES = 16
"""Most planes of a section."""

MAX_HATCH_WIDTH = 64
"""Largest width of the lines of a hatching, pixels."""

MAX_HATCH_SPACING = 1024
"""Largest distance between the lines of a hatching, pixels."""

CapColoring: TypeAlias = Literal["parts", "scalars"]
CAP_COLORINGS: tuple[CapColoring, ...] = get_args(CapColoring)
"""Ways to colour caps other than by one colour."""


@suggests_replace
@dataclass(frozen=True)
class SectionPlane:
    """
    A plane that cuts a scene open: it removes everything in front of it.

    ``scene.section = SectionPlane(point, normal)``, or a list of planes, cuts all meshes, points
    and lines of a scene; what lies in front of *any* of the planes is cut away. `SectionPlane.box`
    makes those of a clipping box. Faces are cut
    exactly where the plane crosses them. The cut of a closed mesh, whose faces are all wound one
    way, is filled by a cap in a colour of its own; that of any other is not, which is warned of
    once. What lies in the plane itself stays if the solid is behind it.

    All outputs tell what is seen through the cut. A cap belongs to its object: ``object_id``,
    ``instance_id`` and ``material_id`` are those of the object, ``face_id`` is the number of all
    faces of the scene, plus ``planes * object_id + plane``; normals are the plane's, and it has no
    ``barycentric``, ``uv`` or attributes, and scalars only if ``cap_color`` is ``"scalars"``. Where
    solids of several objects overlap in a plane, the cap of the smaller area is seen from
    everywhere, of equal ones that of the later object; a face that lies in the plane hides all
    caps. What is cut away casts no shadow and hides no label; labels that stand in front of a plane
    are left out. Points are cut by their centres. A node with ``section=False`` is left whole, with
    all below it and their labels. Where lines are cut, strips end, with caps and dashes as strips
    have them. What is lit at vertices (``"gouraud"``) is lit at those of the cut as well.

    Cameras that fit the scene, `Scene.bounds` and ``nocs`` are those of the whole scene, so that
    the view holds while a plane moves. Where a plane moves, all vertices and faces of the meshes
    that it meets are gone through anew, for each frame, which may cost more than to draw them;
    an unchanged section is cut once. ``motion`` follows the points of the surface: an earlier
    scene is cut where this one is.

    Parameters
    ----------
    point : (3,) array_like, scene units
        Any point of the plane, world space.
    normal : (3,) array_like
        Points to the side that is cut away; of any length but 0.
    cap : bool
        Whether the cut of closed meshes is filled.
    cap_color : colour, "parts" or "scalars", optional
        Of the caps, opaque, or see-through where its alpha is below 1. Default: half the light of
        the object's own colour, which is one for the whole cap: the material's, times the mean of
        the colours of vertices or faces, or of those that the colour map gives to scalars.
        Textures do not count. ``"parts"`` gives each object one of nine light colours in turn,
        by its number, whatever its material. ``"scalars"`` continues the scalars of a mesh's
        vertices over its caps, with their colour map and contours: a mesh says nothing of its
        inside, so they are spread from the outline of the cut, by mean value coordinates; what is
        linear in space stays so. Where a mesh has none, or has those of faces, its caps have the
        default colour.
    lines : bool
        Whether the outline of the cut is drawn over 8-bit colour, open meshes' too; smooth with
        ``Quality(lines="coverage")``, at any number of samples.
    line_color : colour
        Of these lines; they are opaque.
    line_width : float
        Pixels, 0.1..64; rounded to whole pixels where lines are not smooth.
    hatch : float, optional
        Distance between the lines of a hatching of the caps, pixels of the finished picture, above
        ``hatch_width`` and at most 1024: over 8-bit colour, anti-aliased, where the cap is the
        nearest face, transparent or not: behind glass there is none. Default: none. A point of
        print is dpi / 72 pixels.
    hatch_angle : float
        Of these lines from the horizontal, degrees counter-clockwise, -360..360. Objects whose
        boxes meet in the scene have lines turned by 90, 30, 120, 60 ... degrees against this
        angle, the lower object number first: an object keeps its lines in all planes.
    hatch_color : colour
        Of these lines; they are opaque.
    hatch_width : float
        Pixels, above 0 and at most 64.

    Raises
    ------
    ValueError
        Naming the field: the point or the normal is not three finite numbers, the normal is zero,
        a colour is not one, or a width or a hatching is out of its range.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/torus_knot.obj")
    >>> scene.section = rj.SectionPlane((0, 0, 0), (0, 0, 1), lines=True)
    """

    point: VectorLike
    normal: VectorLike
    cap: bool = True
    cap_color: Converted[ColorLike | CapColoring | None, RGBA | CapColoring | None] = Converted(
        None
    )
    lines: bool = False
    line_color: Converted[ColorLike, RGBA] = Converted("black")
    line_width: float = 2.0
    hatch: float | None = None
    hatch_angle: float = 45.0
    hatch_color: Converted[ColorLike, RGBA] = Converted("black")
    hatch_width: float = 1.0

    def __post_init__(self) -> None:
        store(self, point=check.triple("point", self.point))
        direction = check.triple("normal", self.normal)
        if not any(direction):
            raise ValueError(f"normal must not be zero, got {direction}")
        store(self, normal=unit(direction))
        for name in ("cap", "lines"):
            store(self, **{name: check.boolean(name, getattr(self, name))})
        is_colored = isinstance(self.cap_color, str) and self.cap_color in CAP_COLORINGS
        if self.cap_color is not None and not is_colored:
            store(self, cap_color=rgba("cap_color", self.cap_color))
        store(self, line_color=rgba("line_color", self.line_color))
        store(self, line_width=check.line_width("line_width", self.line_width))
        self._check_hatch()

    @staticmethod
    def box(low: VectorLike, high: VectorLike, **fields: Any) -> tuple[SectionPlane, ...]:
        """
        Return the six planes that cut away everything outside of a box, a clipping box.

        Parameters
        ----------
        low, high : (3,) array_like, scene units
            Corners of the box, world space.
        **fields
            Those of each plane, such as ``cap_color``.

        Returns
        -------
        tuple of SectionPlane
            Those of ``low``, x, y and z, then those of ``high``; for ``scene.section``.

        Raises
        ------
        ValueError
            If a corner is not three finite numbers, or ``low`` is not below ``high`` in each; or
            as `SectionPlane` says.
        TypeError
            If a field is unknown.
        """
        ends = check.triple("low", low), check.triple("high", high)
        if not all(a < b for a, b in zip(*ends, strict=True)):
            raise ValueError(f"low must be below high in x, y and z, got {ends[0]} and {ends[1]}")
        return tuple(
            SectionPlane(end, [sign * (axis == k) for k in range(3)], **fields)
            for end, sign in zip(ends, (-1.0, 1.0), strict=True)
            for axis in range(3)
        )

    def _check_hatch(self) -> None:
        """Check the fields of the hatching."""
        angle = check.bounded_number("hatch_angle", self.hatch_angle, -360.0, 360.0)
        width = check.positive_number("hatch_width", self.hatch_width)
        if width > MAX_HATCH_WIDTH:
            raise ValueError(
                f"hatch_width must be at most {MAX_HATCH_WIDTH} pixels, got {self.hatch_width!r}"
            )
        color = rgba("hatch_color", self.hatch_color)
        store(self, hatch_angle=angle, hatch_width=width, hatch_color=color)
        if self.hatch is None:
            return
        spacing = check.positive_number("hatch", self.hatch)
        if not width < spacing <= MAX_HATCH_SPACING:
            raise ValueError(
                f"hatch must be above hatch_width ({width:g}) and at most {MAX_HATCH_SPACING} "
                f"pixels, got {self.hatch!r}"
            )
        store(self, hatch=spacing)


Section: TypeAlias = SectionPlane | Sequence[SectionPlane]
"""One or several section planes."""


def check_section(name: str, value: Any) -> SectionPlane | tuple[SectionPlane, ...] | None:
    """Return a plane, planes as a tuple, or ``None`` for none; raise ``ValueError`` otherwise."""
    if value is None or isinstance(value, SectionPlane):
        return value
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ValueError(
            f"{name} must be a SectionPlane, several or None, got {check.brief(value)}"
        )
    for number, plane in enumerate(value):
        check.instance_of(f"{name}[{number}]", plane, SectionPlane)
    if len(value) > MAX_PLANES:
        raise ValueError(f"{name} must have at most {MAX_PLANES} planes, got {len(value)}")
    return tuple(value) or None


def replace_planes(section: Any, **changes: Any) -> tuple[SectionPlane, ...]:
    """Return the planes of a section, each with other values of some fields."""
    return tuple(replace(plane, **changes) for plane in planes_in(section))


def planes_in(section: SectionPlane | Sequence[SectionPlane] | None) -> tuple[SectionPlane, ...]:
    """Return the planes of a section."""
    if section is None:
        return ()
    return (section,) if isinstance(section, SectionPlane) else tuple(section)
