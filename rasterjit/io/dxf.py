"""
Read DXF files by ezdxf: curves as lines, faces, solids and meshes as faces, points.

Blocks are drawn wherever they are inserted. Colours are those of entities, or of their layers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Cloud, LineDrawing
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import Part, Thing, linear_rgba, triangles
from rasterjit.scene.validation import in_short

_BYTES, _ENTITY_BYTES, _POINT_BYTES = 40, 4096, 64
"""What a byte of a file takes, an entity at each of its places, and a point of a curve."""

_CURVES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
_QUADS = ("3DFACE", "SOLID", "TRACE")
_TEXTS = ("TEXT", "MTEXT", "ATTRIB", "ATTDEF")

_DEEPEST = 16
"""Blocks within blocks."""

_SAGITTA = 1e-3
"""Share of a curve's extent by which its segments may lie beside it."""

_AT_ONCE = 4096
"""Points of a curve that are found before memory for them is asked for."""

_MIN_SEGMENTS = 8
"""Of each piece of a curve, of which a circle has four."""

_BLACK_OR_WHITE = 7
"""The colour that is that of ink."""

_BY_BLOCK, _BY_LAYER = 0, 256
"""Numbers of colours that say where the colour is found."""


def read_dxf(path: Path, resources: Resources, left_out: LeftOut) -> list[Thing]:
    """Return the faces, lines and points of a DXF file, or raise `MeshFileError`."""
    from ezdxf import recover

    resources.budget.take("the file", path.stat().st_size * _BYTES)
    try:
        document, auditor = recover.readfile(path)
    except Exception as error:
        # It raises errors of several kinds about a damaged file.
        raise MeshFileError(f"{path} could not be read as .dxf: {reason_of(error)}") from error
    for entry in auditor.errors + auditor.fixes:
        left_out.note(f"damage that ezdxf names {_named(entry.code)}")
    found = _Found(document, resources, left_out)
    for layout in document.layouts:
        if layout.name != document.modelspace().name:
            # A viewport shows the model.
            count = sum(entity.dxftype() != "VIEWPORT" for entity in layout)
            left_out.note("entity of a page, beside the model", count)
    count = _Count(document.blocks).places(document.modelspace())
    resources.budget.take("all that its blocks hold, wherever they stand,", count * _ENTITY_BYTES)
    for entity in _flat(document.modelspace(), 0, left_out, _Layers(document)):
        found.add(entity)
    things = found.things(path.name)
    if not things:
        named = f" ({left_out})" if str(left_out) else ""
        raise MeshFileError(f"{path} holds a drawing without faces, lines and points{named}")
    return things


def _named(code: int) -> str:
    """Return the name of a damage, as ezdxf numbers them."""
    from ezdxf.audit import AuditError

    names = (name for name, number in vars(AuditError).items() if number == code)
    return next(names, str(code)).lower().replace("_", " ")


class _Layers:
    """Which layers of a document are shown."""

    def __init__(self, document: Any) -> None:
        self._layers = document.layers

    def hides(self, entity: Any, layer: str) -> str:
        """Return why an entity on a layer is not shown; nothing if it is."""
        is_block = entity.dxftype() == "INSERT"
        if entity.dxf.get("invisible", 0):
            return "invisible"
        entry = self._layers.get(layer) if self._layers.has_entry(layer) else None
        if entry is not None and entry.is_frozen():
            return "on a frozen layer"
        # What a block holds on layers of its own is seen even if the block's is off.
        return (
            "on a layer that is off"
            if entry is not None and entry.is_off() and not is_block
            else ""
        )


def _flat(
    entities: Iterable[Any], depth: int, left_out: LeftOut, layers: _Layers, above: str = "0"
) -> Iterator[Any]:
    """
    Yield entities that are shown, those of blocks where these are inserted.

    What a block holds on the layer 0 is on that of the block, ``above``.
    """
    for entity in entities:
        layer = str(entity.dxf.get("layer", "0"))
        layer = above if layer == "0" else layer
        if hidden := layers.hides(entity, layer):
            left_out.note(f"entity {hidden}")
        elif entity.dxftype() != "INSERT":
            yield entity
        elif entity.block() is None:
            left_out.note(
                f"block {in_short(entity.dxf.get('name', ''))} that the file does not have"
            )
        elif depth == _DEEPEST:
            left_out.note("block inside too many others")
        else:
            try:
                places = list(entity.multi_insert()) if entity.mcount > 1 else [entity]
                inner = [one for place in places for one in place.virtual_entities()]
            except Exception as error:
                left_out.note("block that cannot be inserted", reason=f": {reason_of(error)}")
                continue
            left_out.note("text of a drawing", len(getattr(entity, "attribs", ())))
            yield from _flat(inner, depth + 1, left_out, layers, layer)


class _Count:
    """
    Counts entities at all places of their blocks, without placing one of them.

    Parameters
    ----------
    blocks : ezdxf.sections.blocks.BlocksSection
    """

    def __init__(self, blocks: Any) -> None:
        self._blocks = blocks
        self._known: dict[tuple[str, int], int] = {}

    def places(self, entities: Iterable[Any], depth: int = 0) -> int:
        """Return how many entities `_flat` meets, those that insert others as well."""
        total = 0
        for entity in entities:
            total += 1
            if entity.dxftype() == "INSERT" and depth < _DEEPEST:
                name = str(entity.dxf.get("name", ""))
                if (name, depth) not in self._known:
                    self._known[name, depth] = self.places(self._blocks.get(name) or (), depth + 1)
                # One of a damaged number of places is noted where it is inserted.
                with suppress(Exception):
                    total += max(int(entity.mcount), 1) * (1 + self._known[name, depth])
        return total


class _Found:
    """Gathers what entities are drawn as."""

    def __init__(self, document: Any, resources: Resources, left_out: LeftOut) -> None:
        self._document = document
        self._budget = resources.budget
        self._left_out = left_out
        self._polygons: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []
        self._strips: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []
        self._points: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []

    def add(self, entity: Any) -> None:
        """Add an entity, or note it."""
        kind = entity.dxftype()
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                color = self._color(entity)
                if kind in _QUADS:
                    corners = _corners(entity.wcs_vertices())
                    self._polygons.append((corners, color))
                elif kind == "MESH" or (kind == "POLYLINE" and entity.get_mode() in _MESHES):
                    self._add_mesh(entity, kind, color)
                elif kind in _CURVES:
                    self._add_curve(entity, color)
                elif kind == "POINT":
                    self._points.append((np.array([tuple(entity.dxf.location)]), color))
                else:
                    self._left_out.note("text of a drawing" if kind in _TEXTS else f"{kind} entity")
        except Exception as error:
            # A damaged entity can put anything in the place of anything.
            self._left_out.note(
                f"{kind} entity that cannot be followed", reason=f": {reason_of(error)}"
            )

    def _add_mesh(self, entity: Any, kind: str, color: tuple[int, ...]) -> None:
        """Add the polygons of a mesh."""
        from ezdxf.render import MeshBuilder

        mesh = MeshBuilder.from_mesh(entity) if kind == "MESH" else None
        mesh = MeshBuilder.from_polyface(entity) if mesh is None else mesh
        self._budget.take("the faces of a mesh", _POINT_BYTES * sum(map(len, mesh.faces)))
        places = _places(mesh.vertices)
        for face in mesh.faces:
            try:
                self._polygons.append((_corners(places[list(face)]), color))
            except ValueError:
                self._left_out.note("face of fewer than 3 corners")

    def _add_curve(self, entity: Any, color: tuple[int, ...]) -> None:
        """Add a curve in short segments."""
        from ezdxf.path import make_path

        path = make_path(entity)
        ends = _places(path.control_vertices())
        size = float(np.ptp(ends, axis=0).max()) if len(ends) else 0.0
        if not np.isfinite([size, *_numbers(entity)]).all():
            raise ValueError("its numbers must be finite, and its points not too far apart")
        distance = _SAGITTA * size or 1.0
        if entity.dxftype() in ("CIRCLE", "ARC"):
            # Those of a path lie beside the circle.
            strip = self._cut(entity.flattening(distance))
        elif path.has_curves:
            strip = self._cut(path.flattening(distance, _MIN_SEGMENTS))
        else:
            strip = self._cut(ends)
        if len(strip) < 2:
            raise ValueError("it has fewer than 2 points")
        self._strips.append((strip, color))

    def _cut(self, points: Iterable[Any]) -> NDArray[np.float64]:
        """Return the points of a curve, (N, 3); memory is asked for as they are found."""
        rest, pieces = iter(points), [np.empty((0, 3))]
        while piece := list(islice(rest, _AT_ONCE)):
            self._budget.take("the points of a curve", _POINT_BYTES * len(piece))
            pieces.append(_places(piece))
        return np.concatenate(pieces)

    def _color(self, entity: Any) -> tuple[int, ...]:
        """Return the colour of an entity, in bytes; nothing for that of ink."""
        from ezdxf import colors

        dxf = entity.dxf
        if dxf.hasattr("true_color"):
            return tuple(colors.int2rgb(dxf.true_color))
        number = abs(int(dxf.get("color", _BY_LAYER)))
        if number == _BY_LAYER and self._document.layers.has_entry(dxf.get("layer", "0")):
            layer = self._document.layers.get(dxf.get("layer", "0"))
            if layer.dxf.hasattr("true_color"):
                return tuple(colors.int2rgb(layer.dxf.true_color))
            number = abs(int(layer.dxf.get("color", _BLACK_OR_WHITE)))
        if number in (_BY_BLOCK, _BY_LAYER, _BLACK_OR_WHITE):
            return ()
        return tuple(colors.aci2rgb(number))

    def things(self, name: str) -> list[Thing]:
        """Return meshes, lines and points."""
        found: list[Thing] = []
        if self._polygons:
            counts = np.array([len(corners) for corners, _ in self._polygons])
            places = np.concatenate([corners for corners, _ in self._polygons])
            vertices, which = np.unique(places, axis=0, return_inverse=True)
            cut, of_polygons = triangles(counts, by_size=False)
            colors = _rgba([color for _, color in self._polygons], (204, 204, 204))
            found.append(
                Part(
                    name, vertices, which.reshape(-1)[cut],
                    colors=None if colors is None else colors[of_polygons],
                )
            )  # fmt: skip
        if self._strips:
            found.append(self._drawing(name))
        if self._points:
            places = np.concatenate([place for place, _ in self._points])
            colors = _rgba([color for _, color in self._points], (0, 0, 0))
            found.append(Cloud(name, places, colors))
        return found

    def _drawing(self, name: str) -> LineDrawing:
        """Return all curves; one that ends where it began is closed."""
        points, segments, at = [], [], 0
        for strip, _ in self._strips:
            is_ring = len(strip) > 3 and bool(np.allclose(strip[0], strip[-1], rtol=1e-12, atol=0))
            numbers = np.arange(at, at + len(strip))
            if is_ring:
                numbers[-1] = at
            points.append(strip[:-1] if is_ring else strip)
            at += len(points[-1])
            segments.append(np.column_stack([numbers[:-1], numbers[1:]]))
        colors = _rgba([color for _, color in self._strips], (0, 0, 0))
        if colors is not None:
            colors = np.repeat(colors, [len(one) for one in segments], axis=0)
        return LineDrawing(
            name, np.concatenate(points), np.concatenate(segments), colors, colors is not None
        )


def note_entities(path: Path, left_out: LeftOut) -> None:
    """Note by kind the entities that trimesh, which reads drawings without ezdxf, passes over."""
    _, _, behind = path.read_bytes().partition(b"ENTITIES")
    section = behind.partition(b"ENDSEC")[0]
    lines = [line.strip() for line in section.split(b"\n")[1:]]
    for code, kind in zip(lines[::2], lines[1::2], strict=False):
        name = kind.decode("ascii", "replace")
        if code == b"0" and _ENTITY.fullmatch(name) and name not in _BY_TRIMESH:
            left_out.note(f"{name} entity, which ezdxf would read")


_ENTITY = re.compile("[A-Z0-9_]+")

_BY_TRIMESH = (
    "LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "SPLINE", "INSERT", "VERTEX", "SEQEND",
    "TEXT", "MTEXT",
)  # fmt: skip
"""Entities that trimesh reads, and their parts."""

_MESHES = ("AcDbPolyFaceMesh", "AcDbPolygonMesh")
"""Polylines that are meshes."""


def _numbers(entity: Any) -> Iterator[float]:
    """Yield the numbers of an entity and of its places."""
    for value in entity.dxfattribs().values():
        if hasattr(value, "xyz"):
            yield from value.xyz
        elif isinstance(value, float):
            yield value


def _places(found: Any) -> NDArray[np.float64]:
    """Return places, (N, 3)."""
    return np.array([tuple(place) for place in found], np.float64).reshape(-1, 3)


def _corners(places: Any) -> NDArray[np.float64]:
    """Return the corners of a polygon, (N, 3), each once, or raise ``ValueError``."""
    corners = _places(places)
    kept = (corners != np.roll(corners, 1, axis=0)).any(axis=1)
    if kept.sum() < 3 or not np.isfinite(corners).all():
        raise ValueError("it must have 3 different corners")
    return corners[kept]


def _rgba(
    colors: list[tuple[int, ...]], others: tuple[int, int, int]
) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, and one for those without any; None if none has one."""
    if not any(colors):
        return None
    return linear_rgba(np.array([color or others for color in colors], np.uint8), False)
