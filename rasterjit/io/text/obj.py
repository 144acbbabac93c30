"""
Read OBJ files [1]_: a mesh for each material, as trimesh makes them.

References
----------
.. [1] Wavefront Technologies, "Object Files (.obj)" and "MTL material format", version 4.2, 1995.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.primitives import Cloud, LineSet
from rasterjit.io.resources import Resources
from rasterjit.io.text import mesh_builder, number_parser
from rasterjit.io.text.mesh_builder import Geometry, MeshData, Names
from rasterjit.io.text.mtl import MtlLibrary
from rasterjit.io.text.number_parser import Damage, TextLines
from rasterjit.scene.lines import split_into_segments
from rasterjit.scene.material import Material

_REFERENCE_KINDS = ("v", "vt", "vn")
"""Statements that the numbers between the slashes of a face refer to."""

_MIN_NUMBERS = {"v": 3, "vt": 1, "vn": 3}
_MAX_NUMBERS = {"v": 6, "vt": 2, "vn": 3}

_IGNORED_STATEMENTS = frozenset(
    (
        "vp", "mg", "usemtl", "mtllib", "usemap", "maplib", "lod", "bevel", "c_interp", "d_interp",
        "shadow_obj", "trace_obj", "cstype", "deg", "bmat", "step", "parm", "trim", "hole", "scrv",
        "sp", "end", "con", "ctech", "stech", "csh",
    )
)  # fmt: skip
"""Statements that are read elsewhere, or show nothing by themselves."""

_MIN_VERTICES = {"p": 1, "l": 2}
"""Statements of points and lines, with their least number of vertices."""

_UNREAD_STATEMENTS = {
    "curv": "curve", "curv2": "curve", "surf": "surface", "call": "call of another file",
}  # fmt: skip
"""Statements of geometry that is not read."""

_EXPECTED_STATEMENTS = {
    "f": "a face of 3 corners or more, counted from 1, such as 'f 1/1 2/2 3/3'",
    "l": "a line of 2 vertices or more, counted from 1, such as 'l 1 2 3'",
    "p": "points counted from 1, such as 'p 1 2 3'",
}


def read_obj(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Geometry]:
    """Return the meshes, lines and points of an OBJ file, or raise `MeshFileError`."""
    # A backslash joins lines; blanks in its place keep every byte where it was.
    data = original = resources.read_mesh_file(path)
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ").replace(b"\\\r", b"  ")
    lines = TextLines(data, resources.budget, 0, original)
    return list(_ObjFile(path, lines, resources, damage, left_out).parts())


class _ObjFile:
    """Reads the statements of an OBJ file by kind."""

    def __init__(
        self, path: Path, lines: TextLines, resources: Resources, damage: Damage, left_out: LeftOut
    ) -> None:
        self._path = path
        self._lines = lines
        self._damage = damage
        self._left_out = left_out
        self._budget = resources.budget
        self._sort_lines()
        self._read_numbers()
        names, materials, material_lines = self._read_materials()
        self._note_unread()
        self._material_names = [None, *materials]
        self._library = MtlLibrary(names, materials, resources, left_out)
        self._read_faces(material_lines)
        self._material_lines = material_lines

    def _sort_lines(self) -> None:
        """Sort the lines by kind of statement, by their first letters."""
        lines = self._lines
        first, second, third = (lines.byte_at(offset) for offset in range(3))
        blank = second <= ord(" ")
        is_v = first == ord("v")
        self._kind_lines = {
            "v": np.flatnonzero(is_v & blank),
            "vt": np.flatnonzero(is_v & (second == ord("t")) & (third <= ord(" "))),
            "vn": np.flatnonzero(is_v & (second == ord("n")) & (third <= ord(" "))),
        }
        self._face_lines = np.flatnonzero((first == ord("f")) & blank)
        is_material_statement = ((first == ord("u")) & (second == ord("s"))) | (
            (first == ord("m")) & (second == ord("t"))
        )
        self._usemtl_lines = np.flatnonzero(is_material_statement)
        starts = np.isin(first, np.frombuffer(b"ofgs", np.uint8)) & blank
        self._group_lines = np.flatnonzero(starts)
        self._unread_lines = self._sort_other_lines(first, blank)

    def _sort_other_lines(self, first: NDArray[np.uint8], blank: NDArray[np.bool_]) -> list[int]:
        """Return the lines of other statements; keep those of points and lines."""
        lines = self._lines
        rest = (lines.starts < lines.ends) & (first != ord("#"))
        for which in (*self._kind_lines.values(), self._group_lines, self._usemtl_lines):
            rest[which] = False
        self._element_lines = {}
        for letter in _MIN_VERTICES:
            is_element = rest & blank & (first == ord(letter))
            self._element_lines[letter] = np.flatnonzero(is_element)
            rest &= ~is_element
        return np.flatnonzero(rest).tolist()

    def _note_unread(self) -> None:
        """Note geometry that is not read, and lines of unknown statements."""
        unknown = []
        for line in self._unread_lines:
            word = self._lines.text(line).split(None, 1)[:1]
            if word and word[0] in _UNREAD_STATEMENTS:
                self._left_out.note(_UNREAD_STATEMENTS[word[0]])
            elif word and word[0] not in _IGNORED_STATEMENTS:
                unknown.append(line)
        self._lines.note_unknown(np.array(sorted(unknown), np.int64), self._left_out)

    def _read_numbers(self) -> None:
        """Parse positions with their colours, texture coordinates and normals."""
        self._tables: dict[str, NDArray[np.float64]] = {}
        self._is_valid: dict[str, NDArray[np.bool_]] = {}
        what = {"v": "a vertex", "vt": "a texture coordinate", "vn": "a normal"}
        for kind, which in self._kind_lines.items():
            self._budget.take(
                f"{len(which)} rows of {kind}", len(which) * number_parser.MEMORY_PER_ROW
            )
            values, counts = number_parser.parse_rows(
                self._lines, which, len(kind), _MIN_NUMBERS[kind], what[kind], self._damage
            )
            self._tables[kind], self._is_valid[kind] = number_parser.make_row_table(
                values, counts, _MAX_NUMBERS[kind]
            )
        if self._tables["vt"].shape[1] == 1:
            table = self._tables["vt"]
            self._tables["vt"] = np.hstack([table, np.zeros_like(table)])

    def _read_materials(self) -> tuple[list[str], list[str], NDArray[np.int64]]:
        """Return the MTL files, the names of the used materials, and the lines that select them."""
        names, used, at = [], [], []
        for line in self._usemtl_lines.tolist():
            words = self._lines.text(line).split(None, 1)
            if words[0] not in ("mtllib", "usemtl"):
                self._unread_lines.append(line)
            elif len(words) < 2:
                continue
            elif words[0] == "mtllib":
                names.append(words[1])
            else:
                used.append(words[1])
                at.append(line)
        return names, used, np.array(at, np.int64)

    def _read_faces(self, material_lines: NDArray[np.int64]) -> None:
        """Parse the references of all faces' corners, from 0; -1 where a corner has none."""
        self._refs, self._counts, self._lines_of_faces = self._read_references(
            "f", self._face_lines, 3
        )
        self._drop_damaged_faces()
        self._material_of_faces = np.searchsorted(material_lines, self._lines_of_faces)

    def _read_references(
        self, letter: str, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return references, number of corners and line of each statement."""
        refs, counts, lines = [np.zeros((0, 3), np.int64)], [], []
        for batch in self._lines.split_batches(which):
            batch_result = self._read_batch(batch, least)
            if batch_result is None:
                batch_result = self._read_batch_by_line(letter, batch, least)
            self._budget.take(
                "the corners of its faces",
                len(batch) * number_parser.MEMORY_PER_ROW
                + len(batch_result[0]) * number_parser.MEMORY_PER_CORNER,
            )
            refs.append(batch_result[0])
            counts.append(batch_result[1])
            lines.append(batch_result[2])
        none = np.zeros(0, np.int64)
        return np.concatenate(refs), np.concatenate([none, *counts]), np.concatenate([none, *lines])

    def _read_batch(
        self, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
        """Parse faces at once: references, corners of each face, lines; None for a damaged line."""
        content, offsets = self._lines.gather_bytes(which, 1)
        slashes = content == ord("/")
        without_slashes = np.where(slashes, np.uint8(ord(" ")), content)
        # A number begins a corner, or is behind a slash or two.
        starts = np.flatnonzero(number_parser.mark_word_starts(without_slashes))
        slashed = [slashes[np.maximum(starts - back, 0)] for back in (1, 2, 3)]
        begins = np.flatnonzero(~slashed[0])
        counts = np.diff(np.searchsorted(starts[begins], offsets), append=len(begins))
        if (counts < least).any() or (slashed[0] & slashed[1] & slashed[2]).any():
            return None
        if (slashes[1:] & (content[:-1] <= ord(" "))).any() or slashes[:1].any():
            return None
        numbers = number_parser.parse_numbers(without_slashes, len(starts), np.int64)
        if numbers is None or (numbers == 0).any():
            return None
        sizes = np.diff(begins, append=len(starts))
        slash_counts = np.cumsum(slashed[0].astype(np.int64) + (slashed[0] & slashed[1]))
        slot = slash_counts - np.repeat(slash_counts[begins], sizes)
        if (slot > 2).any():
            return None
        refs = np.zeros((len(begins), 3), np.int64)
        refs.reshape(-1)[np.repeat(np.arange(0, refs.size, 3), sizes) + slot] = numbers
        return self._resolve_references(refs, np.repeat(which, counts)), counts, which

    def _resolve_references(
        self, refs: NDArray[np.int64], lines: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Convert references to count from 0; negative ones count back from their line."""
        negative = refs < 0
        refs = refs - 1
        if negative.any():
            for slot, kind in enumerate(_REFERENCE_KINDS):
                where = negative[:, slot]
                before = np.searchsorted(self._kind_lines[kind], lines[where])
                # What counts back beyond the first is out of range, not absent.
                back = before + refs[where, slot] + 1
                refs[where, slot] = np.where(back < 0, np.iinfo(np.int64).max, back)
        return refs

    def _read_batch_by_line(
        self, letter: str, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Parse faces line by line, where `_read_batch` fails."""
        rows: list[list[int]] = []
        counts, good = [], []
        for line in which.tolist():
            words = self._lines.text(line)[1:].split("#", 1)[0].split()
            try:
                corners = [_parse_corner(word) for word in words]
            except ValueError:
                corners = []
            if len(corners) < least:
                self._damage.report_line(self._lines, line, _EXPECTED_STATEMENTS[letter])
                continue
            rows += corners
            counts.append(len(corners))
            good.append(line)
        lines = np.array(good, np.int64)
        number = np.array(counts, np.int64)
        refs = np.array(rows, np.int64).reshape(-1, 3)
        return self._resolve_references(refs, np.repeat(lines, number)), number, lines

    def _drop_damaged_faces(self) -> None:
        """Report and drop faces with references to missing vertices."""
        bad = np.zeros(len(self._refs), bool)
        for slot, kind in enumerate(_REFERENCE_KINDS):
            valid = self._is_valid[kind]
            column = self._refs[:, slot]
            if kind != "v" and not len(valid):
                continue
            outside = column >= len(valid)
            bad |= outside
            if not valid.all():
                inside = ~outside & (column >= 0)
                bad[inside] |= ~valid[column[inside]]
        if not bad.any():
            return
        faces = np.repeat(np.arange(len(self._counts)), self._counts)
        bad_faces = np.zeros(len(self._counts), bool)
        bad_faces[faces[bad]] = True
        sizes = ", ".join(f"{len(self._is_valid[kind])} {kind}" for kind in _REFERENCE_KINDS)
        for face in np.flatnonzero(bad_faces).tolist():
            expected = f"a face among {sizes}"
            self._damage.report_line(self._lines, int(self._lines_of_faces[face]), expected)
        self._refs = self._refs[~bad_faces[faces]]
        self._counts = self._counts[~bad_faces]
        self._lines_of_faces = self._lines_of_faces[~bad_faces]

    def parts(self) -> Iterator[Geometry]:
        """
        Yield all geometries, or raise `MeshFileError`.

        There is a mesh for each material, the last one first, then lines for each, then points. A
        file of vertices alone is a cloud of them.
        """
        names, count = Names(), 0
        for part in self._make_meshes(names) if len(self._counts) else ():
            count += 1
            yield part
        elements: list[Geometry] = [*self._make_lines(names), *self._make_points(names)]
        for element in elements:
            count += 1
            yield element
        if count:
            return
        valid = self._is_valid["v"]
        if len(self._face_lines) or not valid.any():
            points = int(valid.sum())
            content = f"{points} vertices, no faces" if points else "no faces"
            raise MeshFileError(f"{self._path} holds {content}")
        table = self._tables["v"][valid]
        normals = self._tables["vn"] if len(self._tables["vn"]) == len(valid) else None
        normals = None if normals is None else normals[valid]
        name = self._find_object_name() or self._path.name
        yield Cloud(name, table[:, :3], _convert_colors(table), normals)

    def _group_elements(
        self, letter: str
    ) -> Iterator[tuple[str | None, NDArray[np.int64], NDArray[np.int64]]]:
        """Yield name, vertex numbers and their count per statement, for each material."""
        refs, counts, lines = self._read_references(
            letter, self._element_lines[letter], _MIN_VERTICES[letter]
        )
        numbers, valid = refs[:, 0], self._is_valid["v"]
        is_reference_valid = numbers < len(valid)
        is_reference_valid[is_reference_valid] = valid[numbers[is_reference_valid]]
        statements = np.repeat(np.arange(len(counts)), counts)
        is_whole = np.ones(len(counts), bool)
        is_whole[statements[~is_reference_valid]] = False
        for row in np.flatnonzero(~is_whole).tolist():
            expected = f"vertices among {len(valid)} v"
            self._damage.report_line(self._lines, int(lines[row]), expected)
        used = np.searchsorted(self._material_lines, lines)
        for number in np.unique(used[is_whole]).tolist():
            rows = is_whole & (used == number)
            yield self._material_names[number], numbers[rows[statements]], counts[rows]

    def _make_lines(self, names: Names) -> Iterator[LineSet]:
        """Yield the lines of each material."""
        for name, numbers, counts in self._group_elements("l"):
            used, picked = np.unique(numbers, return_inverse=True)
            segments, _ = split_into_segments(picked.reshape(-1), counts)
            table = self._tables["v"][used]
            yield LineSet(
                names.unique("lines"), table[:, :3], segments, _convert_colors(table),
                material=self._make_unlit(name),
            )  # fmt: skip

    def _make_points(self, names: Names) -> Iterator[Cloud]:
        """Yield the points of each material."""
        for name, numbers, _ in self._group_elements("p"):
            table = self._tables["v"][numbers]
            yield Cloud(
                names.unique("points"),
                table[:, :3],
                _convert_colors(table),
                material=self._make_unlit(name),
            )

    def _make_unlit(self, name: str | None) -> Material | None:
        """Return the base colour of a material as an unlit material."""
        material = self._library.material(name)
        if material is None or material.base_color is None:
            return None
        return Material(shading="unlit", base_color=material.base_color, name=material.name)

    def _make_meshes(self, names: Names) -> Iterator[MeshData]:
        """Yield a mesh for each material, the last one first."""
        numbers: dict[str | None, int] = {}
        same = [numbers.setdefault(name, len(numbers)) for name in self._material_names]
        of_faces = np.array(same, np.int64)[self._material_of_faces]
        order = np.argsort(of_faces, kind="stable")
        ends = np.flatnonzero(np.diff(of_faces[order])) + 1
        groups = np.split(order, ends) if len(ends) else [order]
        # In the order in which each is first used, turned round.
        groups.sort(key=lambda group: int(group[0]), reverse=True)
        begins = np.cumsum(self._counts) - self._counts
        by_number = list(numbers)
        object_name = self._find_object_name()
        several = len(self._library.materials) > 1
        for group in groups:
            material = by_number[int(of_faces[group[0]])]
            if several and material is not None:
                name = material
            else:
                name = object_name or self._path.name
            counts = self._counts[group]
            total = int(counts.sum())
            shift = begins[group] - (np.cumsum(counts) - counts)
            refs = self._refs[np.arange(total) + np.repeat(shift, counts)]
            yield self._make_mesh(names.unique(name), material, refs, counts)

    def _find_object_name(self) -> str | None:
        """Return the name of an ``o`` statement, if it comes before all groups and materials."""
        first = int(self._group_lines[0]) if len(self._group_lines) else -1
        if first < 0 or self._lines.byte_at(0)[first] != ord("o"):
            return None
        for line in self._usemtl_lines[self._usemtl_lines < first].tolist():
            if self._lines.text(line).startswith("usemtl"):
                return None
        return self._lines.text(first)[1:].strip() or None

    def _make_mesh(
        self, name: str, material_name: str | None, refs: NDArray[np.int64],
        counts: NDArray[np.int64],
    ) -> MeshData:  # fmt: skip
        """Return a mesh in which corners with equal references share a vertex."""
        has_uv = bool((refs[:, 1] >= 0).all())
        has_normals = bool((refs[:, 2] >= 0).any()) and len(self._tables["vn"]) > 0
        used = [0, *([1] if has_uv else []), *([2] if has_normals else [])]
        numbers = refs[:, used]
        if has_normals:
            # Corners without a normal, -1, have one of their own: none is below zero.
            numbers[:, -1] += 1
        rows, which = mesh_builder.number_rows(numbers)
        references = refs[rows]
        uv = self._tables["vt"][references[:, 1]] if has_uv and len(self._tables["vt"]) else None
        normals, lacks_normal = None, references[:, 2] < 0
        if has_normals:
            normals = self._tables["vn"][references[:, 2]]
            # Any will do: these belong to bare faces alone.
            normals[lacks_normal] = (0.0, 0.0, 1.0)
        table = self._tables["v"][references[:, 0]]
        material = self._library.material(material_name)
        if material is None and uv is not None:
            material = Material(name="material_0")
        colors = None
        if table.shape[1] == 6 and material is not None:
            self._left_out.note(mesh_builder.COLORS_NOTE)
        else:
            colors = _convert_colors(table)
        is_even = bool((counts == counts[0]).all())
        corners, _ = mesh_builder.triangulate(counts, by_size=is_even)
        faces = which[corners]
        bare = np.any(lacks_normal[faces], axis=1) if has_normals else None
        return MeshData(name, table[:, :3], faces, normals, uv, colors, material, bare=bare)


def _convert_colors(table: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Return the colours after positions, linear RGBA, or None."""
    return mesh_builder.srgb_to_rgba(table[:, 3:]) if table.shape[1] == 6 else None


def _parse_corner(word: str) -> list[int]:
    """Parse the three numbers of a corner, 0 for a missing one, or raise ``ValueError``."""
    parts = word.split("/")
    numbers = [int(part) if part else 0 for part in parts]
    wrong = any(
        part and not 0 < abs(number) < 1 << 62 for part, number in zip(parts, numbers, strict=True)
    )
    if len(numbers) > 3 or not parts[0] or wrong:
        raise ValueError(word)
    return numbers + [0] * (3 - len(numbers))
