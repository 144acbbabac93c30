"""Split the mesh of a 3MF object by texture, and its corners by colour; make its lattice."""

from __future__ import annotations

from collections import Counter
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.skipped import LeftOut
from rasterjit.io.text.parts import Part, joined
from rasterjit.io.threemf.lattice import beam_faces, beam_surfaces, lengths
from rasterjit.io.threemf.package import children, local_name
from rasterjit.io.threemf.properties import Properties
from rasterjit.scene.material import Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.texture import Texture

_READ_OF_TRIANGLES = {"v1", "v2", "v3", "p1", "p2", "p3", "pid"}

_BEAM_FACE_BYTES = 200
"""What a face of a beam takes, with its vertices and their normals."""

_CAPS = ("sphere", "hemisphere", "butt")


class _Corners:
    """
    What the corners of N triangles or beams show.

    Parameters
    ----------
    elements : list of Element
        Each with numbers of properties, one for each of its ``width`` corners.
    keys : tuple of str
        What they call these numbers.
    defaults : (str or None, str or None)
        ``pid`` and ``pindex`` of those that have none.
    """

    def __init__(
        self,
        elements: list[ElementTree.Element],
        keys: tuple[str, ...],
        defaults: tuple[str | None, str | None],
        properties: Properties,
        left_out: LeftOut,
    ) -> None:
        group, entry = defaults
        count, width = len(elements), len(keys)
        self.entries = np.zeros((count, width), np.int64)
        self.groups = np.zeros(count, np.int64)
        self.textures: list[Texture | None] = [None]
        self.which = np.zeros(count, np.int64)
        self.colors = np.empty((count, width, 4), np.float32)
        self.colors[:] = Material().base_color_over(False)
        self.uv = np.zeros((count, width, 2))
        self.names: set[str | None] = set()
        of_pid: dict[str, list[int]] = {}
        for row, one in enumerate(elements):
            said = one.get("pid", group)
            first = one.get(keys[0])
            if said is None:
                continue
            of_pid.setdefault(said, []).append(row)
            if first is None:
                # A group without a number of its own: the object's is one of another group.
                first = entry if said == group else "0"
            self.entries[row] = [int(one.get(key, first or "0")) for key in keys]
        self.is_plain = not of_pid
        if sum(map(len, of_pid.values())) < count:
            self.names.add(None)
        for number, (said, found) in enumerate(of_pid.items(), 1):
            rows = np.array(found)
            self._take(said, number, rows, properties, left_out)

    def _take(
        self, said: str, number: int, rows: NDArray[np.int64], properties: Properties,
        left_out: LeftOut,
    ) -> None:  # fmt: skip
        """Take what a group gives to some rows."""
        look, entries = properties.look(said), self.entries[rows]
        if entries.min() < 0 or entries.max() >= len(look.colors):
            raise ValueError(
                f"properties of group {said[:80]!r} must be below {len(look.colors)}, got "
                f"{int(entries.max())}"
            )
        self.groups[rows] = number
        self.colors[rows] = look.colors[entries]
        self.names |= {look.names[entry] for entry in np.unique(entries).tolist()}
        if look.uv is not None:
            self.uv[rows] = look.uv[entries]
        which = look.which[entries]
        differs = (which != which[:, :1]).any(axis=1)
        left_out.note("change of colour below a texture", int(np.count_nonzero(differs)))
        places = np.array([self._place(texture) for texture in look.textures])
        self.which[rows] = places[which[:, 0]]

    def _place(self, texture: Texture | None) -> int:
        """Return the number of a texture, a new one if it has none."""
        for place, one in enumerate(self.textures):
            if one is texture:
                return place
        self.textures.append(texture)
        return len(self.textures) - 1


def surface_parts(
    name: str, element: ElementTree.Element, mesh: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut,
) -> list[Part]:  # fmt: skip
    """Return the triangles of a mesh, those of each texture as one part."""
    triangles = [
        one for group in children(mesh, "triangles") for one in children(group, "triangle")
    ]
    if not triangles:
        return []
    others = Counter(
        local_name(key)
        for one in triangles
        if len(one.attrib) > 3
        for key in one.attrib
        if key not in _READ_OF_TRIANGLES
    )
    for key, count in others.items():
        left_out.note(f"{key} of a triangle", count)
    faces = np.array(
        [(int(one.attrib["v1"]), int(one.attrib["v2"]), int(one.attrib["v3"])) for one in triangles]
    )
    _check_vertices(name, faces, len(vertices))
    defaults = element.get("pid"), element.get("pindex")
    corners = _Corners(triangles, ("p1", "p2", "p3"), defaults, properties, left_out)
    if corners.is_plain:
        return [Part(name, vertices, faces)]
    return [
        _colored(name, vertices, faces, corners, np.flatnonzero(corners.which == place))
        for place in np.unique(corners.which).tolist()
    ]


def _colored(
    name: str, vertices: NDArray[np.float64], faces: NDArray[np.int64], corners: _Corners,
    rows: NDArray[np.int64],
) -> Part:  # fmt: skip
    """Return some triangles, with one texture, as a part: vertices split where corners differ."""
    faces, colors = faces[rows], corners.colors[rows]
    texture = corners.textures[int(corners.which[rows[0]])]
    material, is_one = _material(colors, corners, texture)
    is_flat = is_one or bool((colors == colors[:, :1]).all())
    if texture is None and is_flat and (is_one or len(faces) != len(vertices)):
        return Part(name, vertices, faces, None, None, None if is_one else colors[:, 0], material)
    groups = np.broadcast_to(corners.groups[rows, None], faces.shape)
    keys = np.column_stack([faces.ravel(), groups.ravel(), corners.entries[rows].ravel()])
    kept, which = joined(keys)
    uv = None if texture is None else corners.uv[rows].reshape(-1, 2)[kept]
    shown = None if is_one else colors.reshape(-1, 4)[kept]
    return Part(
        name, vertices[keys[kept, 0]], which.reshape(-1, 3), None, uv, shown, material
    )  # fmt: skip


def _material(
    colors: NDArray[np.float32], corners: _Corners, texture: Texture | None
) -> tuple[Material, bool]:
    """Return the material of faces, with its name, and with their colour, if all have one."""
    color = colors.reshape(-1, 4)[0]
    is_one = bool((colors == color).all())
    material = Material(
        base_color=tuple(color.tolist()) if is_one else None,
        name=next(iter(corners.names)) if len(corners.names) == 1 else None,
        base_color_texture=texture,
        alpha_mode="blend" if colors[..., 3].min() < 1.0 else "opaque",
    )
    return material, is_one


def beam_part(
    name: str, element: ElementTree.Element, lattice: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut, budget: MemoryBudget,
) -> list[Part]:  # fmt: skip
    """Return the beams and balls of a lattice as one part, or none if it has none."""
    # Beams: their ends, radii and caps.
    if lattice.get("clippingmode", "none") != "none":
        left_out.note("clipping of a beam lattice")
    beams = [one for group in children(lattice, "beams") for one in children(group, "beam")]
    radius, shortest = float(lattice.get("radius", "nan")), float(lattice.get("minlength", "0"))
    cap = lattice.get("cap", "sphere")
    ends = np.array([(int(one.attrib["v1"]), int(one.attrib["v2"])) for one in beams], np.int64)
    ends = ends.reshape(-1, 2)
    radii = np.empty((len(beams), 2))
    is_flat = np.zeros((len(beams), 2), bool)
    for row, one in enumerate(beams):
        first = float(one.get("r1", radius))
        radii[row] = first, float(one.get("r2", first))
        is_flat[row] = [_is_flat(one.get(key, cap)) for key in ("cap1", "cap2")]
    # Balls are beams of no length.
    balls = _balls(lattice, ends)
    if not len(beams) and not balls:
        return []
    defaults = lattice.get("pid", element.get("pid")), lattice.get("pindex", element.get("pindex"))
    places = np.array([int(one.attrib["vindex"]) for one in balls], np.int64)
    ends = np.concatenate([ends, np.column_stack([places, places])])
    sizes = [float(one.get("r", "") or lattice.get("ballradius", "nan")) for one in balls]
    radii = np.concatenate([radii, np.column_stack([sizes, sizes]).reshape(-1, 2)])
    is_flat = np.concatenate([is_flat, np.zeros((len(balls), 2), bool)])
    _check_vertices(name, ends, len(vertices))
    if not (np.isfinite(radii).all() and radii.min() >= 0.0):
        raise ValueError(f"radii of the beams of {name[:80]!r} must be finite and at least 0")
    # Colours of both.
    corners = _Corners(beams, ("p1", "p2"), defaults, properties, left_out)
    of_balls = _Corners(balls, ("p",), defaults, properties, left_out)
    if any(one is not None for one in (*corners.textures, *of_balls.textures)):
        left_out.note("texture of a beam lattice")
    colors = np.concatenate([corners.colors, np.repeat(of_balls.colors, 2, axis=1)])
    corners.names |= of_balls.names
    # Those that are long enough, as surfaces.
    stands = vertices[ends]
    length = lengths(stands[:, 1] - stands[:, 0])
    kept = (length >= shortest) & (length > 0.0)
    kept[len(beams) :] = True
    left_out.note("beam that is shorter than its lattice allows", int(np.count_nonzero(~kept)))
    if not kept.any():
        return []
    budget.take(
        f"the beams of {name[:80]!r}", beam_faces(int(np.count_nonzero(kept))) * _BEAM_FACE_BYTES
    )
    points, normals, faces = beam_surfaces(stands[kept], radii[kept], is_flat[kept])
    colors = colors[kept]
    # One material, or a colour for each vertex.
    material, shown = None, None
    if not (corners.is_plain and of_balls.is_plain):
        material, is_one = _material(colors, corners, None)
    if material is not None and not is_one:
        halves = np.repeat(colors, points.shape[1] // 2, axis=1)
        shown = np.repeat(halves, points.shape[2], axis=1).reshape(-1, 4)
    rows = points.reshape(-1, 3), faces, normals.reshape(-1, 3)
    return [Part(f"{name} beams", *rows, colors=shown, material=material)]


def _balls(lattice: ElementTree.Element, ends: NDArray[np.int64]) -> list[ElementTree.Element]:
    """Return the balls of a lattice; where all ends have one, those that it does not name too."""
    mode = lattice.get("ballmode", "none")
    if mode == "none":
        return []
    balls = [one for group in children(lattice, "balls") for one in children(group, "ball")]
    if mode == "all":
        named = {int(one.attrib["vindex"]) for one in balls}
        further = sorted(set(np.unique(ends).tolist()) - named)
        balls += [ElementTree.Element("ball", vindex=str(vertex)) for vertex in further]
    return balls


def _is_flat(cap: str) -> bool:
    """Tell whether a beam is cut off at an end, or raise ``ValueError``."""
    if cap not in _CAPS:
        raise ValueError(f"the cap of a beam must be one of {', '.join(_CAPS)}, got {cap[:80]!r}")
    return cap == "butt"


def _check_vertices(name: str, numbers: NDArray[np.int64], count: int) -> None:
    """Raise ``ValueError`` if a number is that of no vertex."""
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        wrong = numbers.max() if numbers.max() >= count else numbers.min()
        raise ValueError(
            f"mesh {name[:80]!r}: vertices must be numbered from 0 to {count - 1}, got {int(wrong)}"
        )
