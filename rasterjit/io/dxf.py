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
from rasterjit.io.primitives import Cloud, LineSet
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import Geometry, MeshData, srgb_to_rgba, triangulate
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.validation import brief

_MEMORY_PER_FILE_BYTE, _MEMORY_PER_ENTITY, _MEMORY_PER_POINT = 40, 4096, 64
"""Memory for a byte of the file, an entity wherever it is inserted, and a point of a curve."""

_CURVES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
_QUADS = ("3DFACE", "SOLID", "TRACE")
_TEXTS = ("TEXT", "MTEXT", "ATTRIB", "ATTDEF")

_MAX_DEPTH = 16
"""How deep blocks may nest."""

_MAX_SAGITTA_SHARE = 1e-3
"""Share of a curve's extent by which its segments may lie beside it."""

_BATCH_SIZE = 4096
"""Points of a curve that are sampled before their memory is counted."""

_MIN_SEGMENTS = 8
"""Segments of each piece of a curve at least; a circle has four pieces."""

_FOREGROUND_COLOR = 7
"""The colour index that is black on white paper, and white on black."""

_BY_BLOCK, _BY_LAYER = 0, 256
"""Colour indices that refer to the colour of the block, or of the layer."""


def read_dxf(path: Path, resources: Resources, left_out: LeftOut) -> list[Geometry]:
    """Return the faces, lines and points of a DXF file, or raise `MeshFileError`."""
    from ezdxf import recover

    resources.budget.take("the file", path.stat().st_size * _MEMORY_PER_FILE_BYTE)
    try:
        document, auditor = recover.readfile(path)
    except Exception as error:
        # It raises errors of several kinds about a damaged file.
        raise MeshFileError(f"{path} could not be read as .dxf: {reason_of(error)}") from error
    for entry in auditor.errors + auditor.fixes:
        left_out.note(f"damage that ezdxf names {_get_error_name(entry.code)}")
    collector = _EntityCollector(document, resources, left_out)
    for layout in document.layouts:
        if layout.name != document.modelspace().name:
            # A viewport shows the model.
            count = sum(entity.dxftype() != "VIEWPORT" for entity in layout)
            left_out.note("entity of a page, beside the model", count)
    count = _EntityCounter(document.blocks).count(document.modelspace())
    resources.budget.take(
        "all that its blocks hold, wherever they stand,", count * _MEMORY_PER_ENTITY
    )
    for entity in _flatten(document.modelspace(), 0, left_out, _Layers(document)):
        collector.add(entity)
    geometries = collector.make_geometries(path.name)
    if not geometries:
        notes = f" ({left_out})" if str(left_out) else ""
        raise MeshFileError(f"{path} holds a drawing without faces, lines and points{notes}")
    return geometries


def _get_error_name(code: int) -> str:
    """Return the name of an error code of ezdxf."""
    from ezdxf.audit import AuditError

    names = (name for name, number in vars(AuditError).items() if number == code)
    return next(names, str(code)).lower().replace("_", " ")


class _Layers:
    """Tells which entities of a document are shown, by their layers."""

    def __init__(self, document: Any) -> None:
        self._layers = document.layers

    def explain_hidden(self, entity: Any, layer: str) -> str:
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


def _flatten(
    entities: Iterable[Any], depth: int, left_out: LeftOut, layers: _Layers, owner: str = "0"
) -> Iterator[Any]:
    """
    Yield the entities that are shown, with those of inserted blocks in place.

    What a block holds on the layer 0 is on that of the block, ``owner``.
    """
    for entity in entities:
        layer = str(entity.dxf.get("layer", "0"))
        layer = owner if layer == "0" else layer
        if hidden := layers.explain_hidden(entity, layer):
            left_out.note(f"entity {hidden}")
        elif entity.dxftype() != "INSERT":
            yield entity
        elif entity.block() is None:
            left_out.note(f"block {brief(entity.dxf.get('name', ''))} that the file does not have")
        elif depth == _MAX_DEPTH:
            left_out.note("block inside too many others")
        else:
            try:
                inserts = list(entity.multi_insert()) if entity.mcount > 1 else [entity]
                entities_inside = [one for insert in inserts for one in insert.virtual_entities()]
            except Exception as error:
                left_out.note("block that cannot be inserted", reason=f": {reason_of(error)}")
                continue
            left_out.note("text of a drawing", len(getattr(entity, "attribs", ())))
            yield from _flatten(entities_inside, depth + 1, left_out, layers, layer)


class _EntityCounter:
    """
    Counts entities wherever their blocks are inserted, without inserting one.

    Parameters
    ----------
    blocks : ezdxf.sections.blocks.BlocksSection
    """

    def __init__(self, blocks: Any) -> None:
        self._blocks = blocks
        self._counts: dict[tuple[str, int], int] = {}

    def count(self, entities: Iterable[Any], depth: int = 0) -> int:
        """Return how many entities `_flatten` meets, those that insert blocks as well."""
        total = 0
        for entity in entities:
            total += 1
            if entity.dxftype() == "INSERT" and depth < _MAX_DEPTH:
                name = str(entity.dxf.get("name", ""))
                if (name, depth) not in self._counts:
                    self._counts[name, depth] = self.count(self._blocks.get(name) or (), depth + 1)
                # One of a damaged number of places is noted where it is inserted.
                with suppress(Exception):
                    total += max(int(entity.mcount), 1) * (1 + self._counts[name, depth])
        return total


class _EntityCollector:
    """Collects the polygons, curves and points that entities are drawn as."""

    def __init__(self, document: Any, resources: Resources, left_out: LeftOut) -> None:
        self._document = document
        self._budget = resources.budget
        self._left_out = left_out
        self._polygons: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []
        self._strips: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []
        self._points: list[tuple[NDArray[np.float64], tuple[int, ...]]] = []

    def add(self, entity: Any) -> None:
        """Add the geometry of an entity, or note that it is not shown."""
        kind = entity.dxftype()
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                color = self._get_color(entity)
                if kind in _QUADS:
                    corners = _drop_repeated_corners(entity.wcs_vertices())
                    self._polygons.append((corners, color))
                elif kind == "MESH" or (kind == "POLYLINE" and entity.get_mode() in _MESH_MODES):
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
        self._budget.take("the faces of a mesh", _MEMORY_PER_POINT * sum(map(len, mesh.faces)))
        vertices = _stack_points(mesh.vertices)
        for face in mesh.faces:
            try:
                self._polygons.append((_drop_repeated_corners(vertices[list(face)]), color))
            except ValueError:
                self._left_out.note("face of fewer than 3 corners")

    def _add_curve(self, entity: Any, color: tuple[int, ...]) -> None:
        """Add a curve in short segments."""
        from ezdxf.path import make_path

        path = make_path(entity)
        ends = _stack_points(path.control_vertices())
        size = float(np.ptp(ends, axis=0).max()) if len(ends) else 0.0
        if not np.isfinite([size, *_iterate_numbers(entity)]).all():
            raise ValueError("its numbers must be finite, and its points not too far apart")
        distance = _MAX_SAGITTA_SHARE * size or 1.0
        if entity.dxftype() in ("CIRCLE", "ARC"):
            # Those of a path lie beside the circle.
            strip = self._sample_curve(entity.flattening(distance))
        elif path.has_curves:
            strip = self._sample_curve(path.flattening(distance, _MIN_SEGMENTS))
        else:
            strip = self._sample_curve(ends)
        if len(strip) < 2:
            raise ValueError("it has fewer than 2 points")
        self._strips.append((strip, color))

    def _sample_curve(self, points: Iterable[Any]) -> NDArray[np.float64]:
        """Return the points of a curve, (N, 3), counting their memory batch by batch."""
        rest, pieces = iter(points), [np.empty((0, 3))]
        while piece := list(islice(rest, _BATCH_SIZE)):
            self._budget.take("the points of a curve", _MEMORY_PER_POINT * len(piece))
            pieces.append(_stack_points(piece))
        return np.concatenate(pieces)

    def _get_color(self, entity: Any) -> tuple[int, ...]:
        """Return the colour of an entity in bytes; () for the foreground colour."""
        from ezdxf import colors

        dxf = entity.dxf
        if dxf.hasattr("true_color"):
            return tuple(colors.int2rgb(dxf.true_color))
        number = abs(int(dxf.get("color", _BY_LAYER)))
        if number == _BY_LAYER and self._document.layers.has_entry(dxf.get("layer", "0")):
            layer = self._document.layers.get(dxf.get("layer", "0"))
            if layer.dxf.hasattr("true_color"):
                return tuple(colors.int2rgb(layer.dxf.true_color))
            number = abs(int(layer.dxf.get("color", _FOREGROUND_COLOR)))
        if number in (_BY_BLOCK, _BY_LAYER, _FOREGROUND_COLOR):
            return ()
        return tuple(colors.aci2rgb(number))

    def make_geometries(self, name: str) -> list[Geometry]:
        """Return the mesh, lines and points of all entities."""
        geometries: list[Geometry] = []
        if self._polygons:
            counts = np.array([len(corners) for corners, _ in self._polygons])
            positions = np.concatenate([corners for corners, _ in self._polygons])
            indices, vertex_rows = distinct_rows(*positions.T)
            corner_rows, polygon_numbers = triangulate(counts, by_size=False)
            colors = _convert_colors([color for _, color in self._polygons], (204, 204, 204))
            geometries.append(
                MeshData(
                    name, positions[vertex_rows], indices[corner_rows],
                    colors=None if colors is None else colors[polygon_numbers],
                )
            )  # fmt: skip
        if self._strips:
            geometries.append(self._make_lines(name))
        if self._points:
            positions = np.concatenate([position for position, _ in self._points])
            colors = _convert_colors([color for _, color in self._points], (0, 0, 0))
            geometries.append(Cloud(name, positions, colors))
        return geometries

    def _make_lines(self, name: str) -> LineSet:
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
        colors = _convert_colors([color for _, color in self._strips], (0, 0, 0))
        if colors is not None:
            colors = np.repeat(colors, [len(one) for one in segments], axis=0)
        return LineSet(
            name, np.concatenate(points), np.concatenate(segments), colors, colors is not None
        )


def note_unread_entities(path: Path, left_out: LeftOut) -> None:
    """Note by kind the entities that trimesh does not read; ezdxf would."""
    _, _, after_header = path.read_bytes().partition(b"ENTITIES")
    section = after_header.partition(b"ENDSEC")[0]
    lines = [line.strip() for line in section.split(b"\n")[1:]]
    for code, kind in zip(lines[::2], lines[1::2], strict=False):
        name = kind.decode("ascii", "replace")
        if code == b"0" and _ENTITY.fullmatch(name) and name not in _TRIMESH_ENTITIES:
            left_out.note(f"{name} entity, which ezdxf would read")


_ENTITY = re.compile("[A-Z0-9_]+")

_TRIMESH_ENTITIES = (
    "LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "SPLINE", "INSERT", "VERTEX", "SEQEND",
    "TEXT", "MTEXT",
)  # fmt: skip
"""Entities that trimesh reads, and their parts."""

_MESH_MODES = ("AcDbPolyFaceMesh", "AcDbPolygonMesh")
"""Polylines that are meshes."""


def _iterate_numbers(entity: Any) -> Iterator[float]:
    """Yield the float attributes of an entity and the coordinates of its points."""
    for value in entity.dxfattribs().values():
        if hasattr(value, "xyz"):
            yield from value.xyz
        elif isinstance(value, float):
            yield value


def _stack_points(points: Any) -> NDArray[np.float64]:
    """Return points of ezdxf as an array, (N, 3)."""
    return np.array([tuple(point) for point in points], np.float64).reshape(-1, 3)


def _drop_repeated_corners(points: Any) -> NDArray[np.float64]:
    """Return the corners of a polygon, (N, 3), each once, or raise ``ValueError``."""
    corners = _stack_points(points)
    differs = (corners != np.roll(corners, 1, axis=0)).any(axis=1)
    if differs.sum() < 3 or not np.isfinite(corners).all():
        raise ValueError("it must have 3 different corners")
    return corners[differs]


def _convert_colors(
    colors: list[tuple[int, ...]], default: tuple[int, int, int]
) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, with a default for (); None if all are ()."""
    if not any(colors):
        return None
    return srgb_to_rgba(np.array([color or default for color in colors], np.uint8))
