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
from rasterjit.io.primitives import Cloud, LineDrawing
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import (
    COLORS_BESIDE,
    Names,
    Part,
    Thing,
    joined,
    linear_rgba,
    srgb_bytes,
    triangles,
)
from rasterjit.io.text.mtl import MtlLibrary
from rasterjit.io.text.number_parser import (
    CORNER_BYTES,
    ROW_BYTES,
    Damage,
    TextLines,
    columns,
    number_rows,
    parse,
    word_starts,
)
from rasterjit.scene.material import Material

_KINDS = ("v", "vt", "vn")
"""What the numbers between the slashes of a face count."""

_MIN = {"v": 3, "vt": 1, "vn": 3}
_MAX = {"v": 6, "vt": 2, "vn": 3}

_SHAPELESS = frozenset(
    (
        "vp", "mg", "usemtl", "mtllib", "usemap", "maplib", "lod", "bevel", "c_interp", "d_interp",
        "shadow_obj", "trace_obj", "cstype", "deg", "bmat", "step", "parm", "trim", "hole", "scrv",
        "sp", "end", "con", "ctech", "stech", "csh",
    )
)  # fmt: skip
"""Statements of a whole word that are read, or have nothing to show without another one."""

_ELEMENTS = {"p": 1, "l": 2}
"""Statements of points and lines, and how many vertices they have at least."""

_NOT_SHOWN = {
    "curv": "curve", "curv2": "curve", "surf": "surface", "call": "call of another file",
}  # fmt: skip
"""Statements that show something, which is left out."""

_EXPECTED = {
    "f": "a face of 3 corners or more, counted from 1, such as 'f 1/1 2/2 3/3'",
    "l": "a line of 2 vertices or more, counted from 1, such as 'l 1 2 3'",
    "p": "points counted from 1, such as 'p 1 2 3'",
}


def read_obj(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Thing]:
    """Return the meshes, lines and points of an OBJ file, or raise `MeshFileError`."""
    # A backslash joins lines; blanks in its place keep every byte where it was.
    data = original = resources.read_itself(path)
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ").replace(b"\\\r", b"  ")
    lines = TextLines(data, resources.budget, 0, original)
    return list(_ObjFile(path, lines, resources, damage, left_out).parts())


class _ObjFile:
    """The statements of an OBJ file, by kind."""

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
        names, used, at = self._statements()
        self._note_others()
        self._used = [None, *used]
        self._library = MtlLibrary(names, used, resources, left_out)
        self._read_faces(at)
        self._materials_at = at

    def _sort_lines(self) -> None:
        """Find the lines of each kind of statement by their first letters."""
        lines = self._lines
        first, second, third = (lines.char(offset) for offset in range(3))
        blank = second <= ord(" ")
        is_v = first == ord("v")
        self._which = {
            "v": np.flatnonzero(is_v & blank),
            "vt": np.flatnonzero(is_v & (second == ord("t")) & (third <= ord(" "))),
            "vn": np.flatnonzero(is_v & (second == ord("n")) & (third <= ord(" "))),
        }
        self._face_lines = np.flatnonzero((first == ord("f")) & blank)
        named = ((first == ord("u")) & (second == ord("s"))) | (
            (first == ord("m")) & (second == ord("t"))
        )
        self._named_lines = np.flatnonzero(named)
        starts = np.isin(first, np.frombuffer(b"ofgs", np.uint8)) & blank
        self._starters = np.flatnonzero(starts)
        self._others = self._unread_lines(first, blank)

    def _unread_lines(self, first: NDArray[np.uint8], blank: NDArray[np.bool_]) -> list[int]:
        """Return lines of no kind that is read, and keep those of points and lines."""
        lines = self._lines
        rest = (lines.starts < lines.ends) & (first != ord("#"))
        for which in (*self._which.values(), self._starters, self._named_lines):
            rest[which] = False
        self._element_lines = {}
        for letter in _ELEMENTS:
            found = rest & blank & (first == ord(letter))
            self._element_lines[letter] = np.flatnonzero(found)
            rest &= ~found
        return np.flatnonzero(rest).tolist()

    def _note_others(self) -> None:
        """Note lines that show something else, and those of no known kind: one may be a face."""
        unknown = []
        for line in self._others:
            word = self._lines.text(line).split(None, 1)[:1]
            if word and word[0] in _NOT_SHOWN:
                self._left_out.note(_NOT_SHOWN[word[0]])
            elif word and word[0] not in _SHAPELESS:
                unknown.append(line)
        self._lines.note_unknown(np.array(sorted(unknown), np.int64), self._left_out)

    def _read_numbers(self) -> None:
        """Read positions with their colours, texture coordinates and normals."""
        self._tables: dict[str, NDArray[np.float64]] = {}
        self._there: dict[str, NDArray[np.bool_]] = {}
        what = {"v": "a vertex", "vt": "a texture coordinate", "vn": "a normal"}
        for kind, which in self._which.items():
            self._budget.take(f"{len(which)} rows of {kind}", len(which) * ROW_BYTES)
            values, counts = number_rows(
                self._lines, which, len(kind), _MIN[kind], what[kind], self._damage
            )
            self._tables[kind], self._there[kind] = columns(values, counts, _MAX[kind])
        if self._tables["vt"].shape[1] == 1:
            table = self._tables["vt"]
            self._tables["vt"] = np.hstack([table, np.zeros_like(table)])

    def _statements(self) -> tuple[list[str], list[str], NDArray[np.int64]]:
        """Return the MTL files, the materials in use, and the lines from which each one is."""
        names, used, at = [], [], []
        for line in self._named_lines.tolist():
            words = self._lines.text(line).split(None, 1)
            if words[0] not in ("mtllib", "usemtl"):
                self._others.append(line)
            elif len(words) < 2:
                continue
            elif words[0] == "mtllib":
                names.append(words[1])
            else:
                used.append(words[1])
                at.append(line)
        return names, used, np.array(at, np.int64)

    def _read_faces(self, materials_at: NDArray[np.int64]) -> None:
        """Read what the corners of all faces refer to, from 0; -1 where a corner refers to none."""
        self._refs, self._counts, self._lines_of_faces = self._rows_of("f", self._face_lines, 3)
        self._drop_damaged_faces()
        self._material_of_faces = np.searchsorted(materials_at, self._lines_of_faces)

    def _rows_of(
        self, letter: str, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return references, corners of each statement, and their lines."""
        refs, counts, good = [np.zeros((0, 3), np.int64)], [], []
        for batch in self._lines.batches(which):
            found = self._batch(batch, least)
            if found is None:
                found = self._careful_batch(letter, batch, least)
            self._budget.take(
                "the corners of its faces",
                len(batch) * ROW_BYTES + len(found[0]) * CORNER_BYTES,
            )
            refs.append(found[0])
            counts.append(found[1])
            good.append(found[2])
        none = np.zeros(0, np.int64)
        return np.concatenate(refs), np.concatenate([none, *counts]), np.concatenate([none, *good])

    def _batch(
        self, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
        """Return references, corners of each face, and their lines; None if a line is damaged."""
        content, offsets = self._lines.content(which, 1)
        slashes = content == ord("/")
        plain = np.where(slashes, np.uint8(ord(" ")), content)
        # A number begins a corner, or is behind a slash or two.
        starts = np.flatnonzero(word_starts(plain))
        behind = [slashes[np.maximum(starts - back, 0)] for back in (1, 2, 3)]
        begins = np.flatnonzero(~behind[0])
        counts = np.diff(np.searchsorted(starts[begins], offsets), append=len(begins))
        if (counts < least).any() or (behind[0] & behind[1] & behind[2]).any():
            return None
        if (slashes[1:] & (content[:-1] <= ord(" "))).any() or slashes[:1].any():
            return None
        numbers = parse(plain, len(starts), np.int64)
        if numbers is None or (numbers == 0).any():
            return None
        sizes = np.diff(begins, append=len(starts))
        seen = np.cumsum(behind[0].astype(np.int64) + (behind[0] & behind[1]))
        place = seen - np.repeat(seen[begins], sizes)
        if (place > 2).any():
            return None
        refs = np.zeros((len(begins), 3), np.int64)
        refs.reshape(-1)[np.repeat(np.arange(0, refs.size, 3), sizes) + place] = numbers
        return self._resolved(refs, np.repeat(which, counts)), counts, which

    def _resolved(self, refs: NDArray[np.int64], lines: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count references from 0; negative ones count back from their line."""
        negative = refs < 0
        refs = refs - 1
        if negative.any():
            for place, kind in enumerate(_KINDS):
                where = negative[:, place]
                before = np.searchsorted(self._which[kind], lines[where])
                # What counts back beyond the first is out of range, not absent.
                back = before + refs[where, place] + 1
                refs[where, place] = np.where(back < 0, np.iinfo(np.int64).max, back)
        return refs

    def _careful_batch(
        self, letter: str, which: NDArray[np.int64], least: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Read what `_batch` cannot read at once, line by line."""
        rows: list[list[int]] = []
        counts, good = [], []
        for line in which.tolist():
            words = self._lines.text(line)[1:].split("#", 1)[0].split()
            try:
                corners = [_corner(word) for word in words]
            except ValueError:
                corners = []
            if len(corners) < least:
                self._damage.line(self._lines, line, _EXPECTED[letter])
                continue
            rows += corners
            counts.append(len(corners))
            good.append(line)
        lines = np.array(good, np.int64)
        number = np.array(counts, np.int64)
        refs = np.array(rows, np.int64).reshape(-1, 3)
        return self._resolved(refs, np.repeat(lines, number)), number, lines

    def _drop_damaged_faces(self) -> None:
        """Report faces that refer to what is not there, and leave them out."""
        bad = np.zeros(len(self._refs), bool)
        for place, kind in enumerate(_KINDS):
            there = self._there[kind]
            column = self._refs[:, place]
            if kind != "v" and not len(there):
                continue
            outside = column >= len(there)
            bad |= outside
            if not there.all():
                inside = ~outside & (column >= 0)
                bad[inside] |= ~there[column[inside]]
        if not bad.any():
            return
        faces = np.repeat(np.arange(len(self._counts)), self._counts)
        bad_faces = np.zeros(len(self._counts), bool)
        bad_faces[faces[bad]] = True
        sizes = ", ".join(f"{len(self._there[kind])} {kind}" for kind in _KINDS)
        for face in np.flatnonzero(bad_faces).tolist():
            expected = f"a face among {sizes}"
            self._damage.line(self._lines, int(self._lines_of_faces[face]), expected)
        self._refs = self._refs[~bad_faces[faces]]
        self._counts = self._counts[~bad_faces]
        self._lines_of_faces = self._lines_of_faces[~bad_faces]

    def parts(self) -> Iterator[Thing]:
        """
        Yield meshes, lines and points, or raise `MeshFileError`.

        There is a mesh for each material, the last one first, then lines for each, then points. A
        file of vertices alone is a cloud of them.
        """
        names, count = Names(), 0
        for part in self._meshes(names) if len(self._counts) else ():
            count += 1
            yield part
        others: list[Thing] = [*self._drawings(names), *self._clouds(names)]
        for element in others:
            count += 1
            yield element
        if count:
            return
        there = self._there["v"]
        if len(self._face_lines) or not there.any():
            points = int(there.sum())
            held = f"{points} vertices, no faces" if points else "no faces"
            raise MeshFileError(f"{self._path} holds {held}")
        table = self._tables["v"][there]
        normals = self._tables["vn"] if len(self._tables["vn"]) == len(there) else None
        normals = None if normals is None else normals[there]
        yield Cloud(self._object_name() or self._path.name, table[:, :3], _colors(table), normals)

    def _elements(
        self, letter: str
    ) -> Iterator[tuple[str | None, NDArray[np.int64], NDArray[np.int64]]]:
        """Yield, for each material, its name, numbers of vertices, and how many a statement has."""
        refs, counts, lines = self._rows_of(letter, self._element_lines[letter], _ELEMENTS[letter])
        numbers, there = refs[:, 0], self._there["v"]
        sound = numbers < len(there)
        sound[sound] = there[numbers[sound]]
        statements = np.repeat(np.arange(len(counts)), counts)
        kept = np.ones(len(counts), bool)
        kept[statements[~sound]] = False
        for row in np.flatnonzero(~kept).tolist():
            expected = f"vertices among {len(there)} v"
            self._damage.line(self._lines, int(lines[row]), expected)
        used = np.searchsorted(self._materials_at, lines)
        for number in np.unique(used[kept]).tolist():
            rows = kept & (used == number)
            yield self._used[number], numbers[rows[statements]], counts[rows]

    def _drawings(self, names: Names) -> Iterator[LineDrawing]:
        """Yield the lines of each material."""
        for name, numbers, counts in self._elements("l"):
            used, places = np.unique(numbers, return_inverse=True)
            inner = np.ones(len(numbers), bool)
            inner[np.cumsum(counts) - 1] = False
            begins = np.flatnonzero(inner)
            places = places.reshape(-1)
            table = self._tables["v"][used]
            yield LineDrawing(
                names.unique("lines"), table[:, :3],
                np.column_stack([places[begins], places[begins + 1]]), _colors(table),
                material=self._plain(name),
            )  # fmt: skip

    def _clouds(self, names: Names) -> Iterator[Cloud]:
        """Yield the points of each material."""
        for name, numbers, _ in self._elements("p"):
            table = self._tables["v"][numbers]
            yield Cloud(
                names.unique("points"), table[:, :3], _colors(table), material=self._plain(name)
            )

    def _plain(self, name: str | None) -> Material | None:
        """Return a material's base colour alone, unlit."""
        material = self._library.material(name)
        if material is None or material.base_color is None:
            return None
        return Material(shading="unlit", base_color=material.base_color, name=material.name)

    def _meshes(self, names: Names) -> Iterator[Part]:
        """Yield a mesh for each material, the last one first."""
        numbers: dict[str | None, int] = {}
        same = [numbers.setdefault(name, len(numbers)) for name in self._used]
        of_faces = np.array(same, np.int64)[self._material_of_faces]
        order = np.argsort(of_faces, kind="stable")
        ends = np.flatnonzero(np.diff(of_faces[order])) + 1
        groups = np.split(order, ends) if len(ends) else [order]
        # In the order in which each is first used, turned round.
        groups.sort(key=lambda group: int(group[0]), reverse=True)
        begins = np.cumsum(self._counts) - self._counts
        by_number = list(numbers)
        object_name = self._object_name()
        several = len(self._library.said) > 1
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
            yield self._part(names.unique(name), material, refs, counts)

    def _object_name(self) -> str | None:
        """Return the name in an ``o`` statement if none that begins faces is before it."""
        first = int(self._starters[0]) if len(self._starters) else -1
        if first < 0 or self._lines.char(0)[first] != ord("o"):
            return None
        for line in self._named_lines[self._named_lines < first].tolist():
            if self._lines.text(line).startswith("usemtl"):
                return None
        return self._lines.text(first)[1:].strip() or None

    def _part(
        self, name: str, material_name: str | None, refs: NDArray[np.int64],
        counts: NDArray[np.int64],
    ) -> Part:  # fmt: skip
        """Return a mesh in which corners that are alike share a vertex."""
        has_uv = bool((refs[:, 1] >= 0).all())
        has_normals = bool((refs[:, 2] >= 0).any()) and len(self._tables["vn"]) > 0
        used = [0, *([1] if has_uv else []), *([2] if has_normals else [])]
        numbers = refs[:, used]
        if has_normals:
            # Corners without a normal, -1, have one of their own: none is below zero.
            numbers[:, -1] += 1
        rows, which = joined(numbers)
        picked = refs[rows]
        uv = self._tables["vt"][picked[:, 1]] if has_uv and len(self._tables["vt"]) else None
        normals, has_none = None, picked[:, 2] < 0
        if has_normals:
            normals = self._tables["vn"][picked[:, 2]]
            # Any will do: these belong to bare faces alone.
            normals[has_none] = (0.0, 0.0, 1.0)
        table = self._tables["v"][picked[:, 0]]
        material = self._library.material(material_name)
        if material is None and uv is not None:
            material = Material(name="material_0")
        colors = None
        if table.shape[1] == 6 and material is not None:
            self._left_out.note(COLORS_BESIDE)
        else:
            colors = _colors(table)
        is_even = bool((counts == counts[0]).all())
        corners, _ = triangles(counts, by_size=is_even)
        faces = which[corners]
        bare = np.any(has_none[faces], axis=1) if has_normals else None
        return Part(name, table[:, :3], faces, normals, uv, colors, material, bare=bare)


def _colors(table: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Return the colours behind positions, linear RGBA, or None."""
    return linear_rgba(srgb_bytes(table[:, 3:]), False) if table.shape[1] == 6 else None


def _corner(word: str) -> list[int]:
    """Return the three numbers of a corner, 0 for one that is not there, or raise."""
    parts = word.split("/")
    numbers = [int(part) if part else 0 for part in parts]
    wrong = any(
        part and not 0 < abs(number) < 1 << 62 for part, number in zip(parts, numbers, strict=True)
    )
    if len(numbers) > 3 or not parts[0] or wrong:
        raise ValueError(word)
    return numbers + [0] * (3 - len(numbers))
