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

from rasterjit.io.resources import Resources
from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.io.text.lines import (
    CORNER_BYTES,
    ROW_BYTES,
    Damage,
    Lines,
    columns,
    number_rows,
    parse,
    word_starts,
)
from rasterjit.io.text.mtl import MtlLibrary
from rasterjit.io.text.parts import (
    COLORS_BESIDE,
    Names,
    Part,
    joined,
    linear_rgba,
    srgb_bytes,
    triangles,
)
from rasterjit.scene.material import Material

_KINDS = ("v", "vt", "vn")
"""What the numbers between the slashes of a face count."""

_LEAST = {"v": 3, "vt": 1, "vn": 3}
_MOST = {"v": 6, "vt": 2, "vn": 3}

_SHAPELESS = frozenset(
    (
        "vp", "mg", "usemtl", "mtllib", "usemap", "maplib", "lod", "bevel", "c_interp", "d_interp",
        "shadow_obj", "trace_obj", "cstype", "deg", "bmat", "step", "parm", "trim", "hole", "scrv",
        "sp", "end", "con", "ctech", "stech", "csh",
    )
)  # fmt: skip
"""Statements of a whole word that are read, or have nothing to show without another one."""

_ELEMENTS = {"p": "points", "l": "lines"}
_NOT_SHOWN = {
    "curv": "curve", "curv2": "curve", "surf": "surface", "call": "call of another file",
}  # fmt: skip
"""Statements that show something, which is left out."""

_A_FACE = "a face of 3 corners or more, counted from 1, such as 'f 1/1 2/2 3/3'"


def read_obj(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Part]:
    """Return the meshes of an OBJ file, or raise `MeshFileError`."""
    # A backslash joins lines; blanks in its place keep every byte where it was.
    data = original = resources.read_itself(path)
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
    lines = Lines(data, resources.budget, 0, original)
    return list(_ObjFile(path, lines, resources, damage, left_out).parts())


class _ObjFile:
    """The statements of an OBJ file, by kind."""

    def __init__(
        self, path: Path, lines: Lines, resources: Resources, damage: Damage, left_out: LeftOut
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
        """Return lines of no kind that is read, and note those of points and lines."""
        lines = self._lines
        rest = (lines.starts < lines.ends) & (first != ord("#"))
        for which in (*self._which.values(), self._starters, self._named_lines):
            rest[which] = False
        for letter, what in _ELEMENTS.items():
            found = rest & blank & (first == ord(letter))
            if found.any():
                self._left_out.note(what, int(found.sum()))
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
        if unknown:
            first = min(unknown)
            shown = f"{self._lines.where(first)}: {self._lines.shown(first)}"
            self._left_out.note(f"lines of no known kind, first {shown}", len(unknown))

    def _read_numbers(self) -> None:
        """Read positions with their colours, texture coordinates and normals."""
        self._tables: dict[str, NDArray[np.float64]] = {}
        self._there: dict[str, NDArray[np.bool_]] = {}
        what = {"v": "a vertex", "vt": "a texture coordinate", "vn": "a normal"}
        for kind, which in self._which.items():
            self._budget.take(f"{len(which)} rows of {kind}", len(which) * ROW_BYTES)
            values, counts = number_rows(
                self._lines, which, len(kind), _LEAST[kind], what[kind], self._damage
            )
            self._tables[kind], self._there[kind] = columns(values, counts, _MOST[kind])
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
        refs, counts, good = [np.zeros((0, 3), np.int64)], [], []
        for batch in self._lines.batches(self._face_lines):
            found = self._face_batch(batch)
            if found is None:
                found = self._careful_faces(batch)
            self._budget.take(
                "the corners of its faces",
                len(batch) * ROW_BYTES + len(found[0]) * CORNER_BYTES,
            )
            refs.append(found[0])
            counts.append(found[1])
            good.append(found[2])
        self._refs = np.concatenate(refs)
        self._counts = np.concatenate([np.zeros(0, np.int64), *counts])
        self._lines_of_faces = np.concatenate([np.zeros(0, np.int64), *good])
        self._drop_damaged_faces()
        self._material_of_faces = np.searchsorted(materials_at, self._lines_of_faces)

    def _face_batch(
        self, which: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
        """Return references, corners of each face, and their lines; None if a line is damaged."""
        content, offsets = self._lines.content(which, 1)
        corner_starts = word_starts(content)
        counts = np.add.reduceat(corner_starts, offsets, dtype=np.int64)
        if (counts < 3).any():
            return None
        slashes = content == ord("/")
        plain = np.where(slashes, ord(" "), content).astype(np.uint8)
        number_starts = word_starts(plain)
        numbers = parse(plain, int(number_starts.sum()), np.int64)
        if numbers is None:
            return None
        seen = np.cumsum(slashes)
        corner = np.cumsum(corner_starts)[number_starts] - 1
        # A corner begins with its number of a vertex, so no slash is before that.
        place = seen[number_starts] - (seen - slashes)[corner_starts][corner]
        refs = np.zeros((int(counts.sum()), 3), np.int64)
        if (place > 2).any():
            return None
        refs[corner, place] = numbers
        if (refs[:, 0] == 0).any() or (numbers == 0).any():
            return None
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

    def _careful_faces(
        self, which: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Read what `_face_batch` cannot read at once, line by line."""
        rows: list[list[int]] = []
        counts, good = [], []
        for line in which.tolist():
            words = self._lines.text(line)[1:].split("#", 1)[0].split()
            try:
                corners = [_corner(word) for word in words]
            except ValueError:
                corners = []
            if len(corners) < 3:
                self._damage.line(self._lines, line, _A_FACE)
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

    def parts(self) -> Iterator[Part]:
        """Yield a mesh for each material, the last one first, or raise `MeshFileError`."""
        if not len(self._counts):
            points = int(self._there["v"].sum())
            held = f"a point cloud of {points} points, no faces" if points else "no faces"
            raise MeshFileError(f"{self._path} holds {held}")
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
        object_name, names = self._object_name(), Names()
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
        normals = None
        if has_normals:
            normals = self._tables["vn"][picked[:, 2]]
            normals[picked[:, 2] < 0] = 0.0
        table = self._tables["v"][picked[:, 0]]
        material = self._library.material(material_name)
        if material is None and uv is not None:
            material = Material(name="material_0")
        colors = None
        if table.shape[1] == 6 and material is not None:
            self._left_out.note(COLORS_BESIDE)
        elif table.shape[1] == 6:
            colors = linear_rgba(srgb_bytes(table[:, 3:]), False)
        is_even = bool((counts == counts[0]).all())
        corners, _ = triangles(counts, by_size=is_even)
        return Part(name, table[:, :3], which[corners], normals, uv, colors, material)


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
