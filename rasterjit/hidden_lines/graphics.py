"""Strokes and texts of a drawing, and the files that hold them: SVG and PDF."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from rasterjit.scene.arrays import Float64

FORMATS = (".svg", ".pdf")
"""Extensions of drawings."""

Codes = tuple[int, int, int, int]
"""sRGB codes and alpha, 0..255."""

ANCHORS = {"left": "start", "center": "middle", "right": "end"}
"""SVG's words for which point of a line is at its position."""

FAMILY = "Helvetica, Arial, sans-serif"

TEXT_SHIFTS = {"left": 0.0, "center": 0.5, "right": 1.0}
"""Share of a line's width that lies left of its position."""


class Stroke(NamedTuple):
    """Lines of one kind, colour and width."""

    name: str
    paths: Sequence[Float64]
    """(K, 2) each, points: x right, y down."""
    color: Codes
    width: float
    """Points."""
    dash: tuple[float, float] | None = None
    """Lengths of a dash and of a gap, points."""


class Text(NamedTuple):
    """A text of one or several lines."""

    lines: Sequence[tuple[str, float]]
    """Each line, and its width, points."""
    x: float
    """Of the point that lines are aligned at, points."""
    baselines: Sequence[float]
    """Of each line, points, y down."""
    size: float
    """Points."""
    align: str
    """"left", "center" or "right"."""
    color: Codes
    box: tuple[float, float, float, float] | None = None
    """Left, top, width and height of a background."""
    box_color: Codes = (0, 0, 0, 0)
    font: str | None = None
    """A font's name or file; in PDF, for outlines alone."""
    outlines: Sequence[Float64] | None = None
    """Contours that PDF has in place of the text: see `trace_text`."""


class Page(NamedTuple):
    """All of a drawing, from behind to front."""

    width: float
    """Points."""
    height: float
    background: Codes | None
    strokes: Sequence[Stroke]
    texts: Sequence[Text]


def format_number(value: float) -> str:
    """Return a number of points with at most three places."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def write_svg(page: Page) -> str:
    """Return a page as SVG, with a group for the lines of each kind, and text as text."""
    number = format_number
    size = number(page.width), number(page.height)
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" '
        f'width="{size[0]}pt" height="{size[1]}pt" viewBox="0 0 {size[0]} {size[1]}">'
    ]
    if page.background is not None:
        paint = _svg_paint("fill", page.background)
        parts.append(f'<rect width="{size[0]}" height="{size[1]}" {paint}/>')
    for stroke in page.strokes:
        dash = "" if stroke.dash is None else f' stroke-dasharray="{_join(stroke.dash)}"'
        parts.append(
            f'<g class="{stroke.name}" fill="none" {_svg_paint("stroke", stroke.color)} '
            f'stroke-width="{number(stroke.width)}" stroke-linecap="{_cap(stroke)}" '
            f'stroke-linejoin="round"{dash}>'
        )
        for path in stroke.paths:
            points = [f"{number(x)} {number(y)}" for x, y in path.tolist()]
            is_closed = len(points) > 2 and points[0] == points[-1]
            end = "Z" if is_closed else ""
            parts.append(f'<path d="M{"L".join(points[:-1] if is_closed else points)}{end}"/>')
        parts.append("</g>")
    for text in page.texts:
        parts += _svg_text(text)
    return "\n".join([*parts, "</svg>\n"])


def _svg_text(text: Text) -> Iterator[str]:
    """Yield the elements of a text."""
    if text.box is not None:
        x, y, width, height = map(format_number, text.box)
        paint = _svg_paint("fill", text.box_color)
        yield f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {paint}/>'
    family = FAMILY if text.font is None else f"{Path(text.font).stem}, {FAMILY}"
    for (line, _), baseline in zip(text.lines, text.baselines, strict=True):
        yield (
            f'<text x="{format_number(text.x)}" y="{format_number(baseline)}" '
            f'font-family={quoteattr(family)} font-size="{format_number(text.size)}" '
            f'text-anchor="{ANCHORS[text.align]}" {_svg_paint("fill", text.color)} '
            f'xml:space="preserve">{escape(line)}</text>'
        )


def _svg_paint(name: str, color: Codes) -> str:
    """Return the attributes of a colour."""
    red, green, blue, alpha = color
    opacity = "" if alpha == 255 else f' {name}-opacity="{format_number(alpha / 255.0)}"'
    return f'{name}="#{red:02x}{green:02x}{blue:02x}"{opacity}'


def _cap(stroke: Stroke) -> str:
    """Return the shape of a line's ends: dashes end where they end."""
    return "round" if stroke.dash is None else "butt"


def _join(values: Sequence[float]) -> str:
    return " ".join(map(format_number, values))


def write_pdf(page: Page) -> bytes:
    """Return a page as PDF 1.4, with text in Helvetica; the same bytes for the same page."""
    alphas = sorted({color[3] for color in _list_colors(page)})
    content = zlib.compress("\n".join(_pdf_content(page)).encode("cp1252"), 9)
    states = "".join(
        f"/A{alpha} << /CA {format_number(alpha / 255.0)} /ca {format_number(alpha / 255.0)} >> "
        for alpha in alphas
    )
    font = "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>"
    resources = f"<< /Font << /F {font} >> /ExtGState << {states}>> >>"
    size = _join((page.width, page.height))
    bodies = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents 4 0 R "
            f"/Resources {resources} >>"
        ).encode("ascii"),
        b"<< /Length %d /Filter /FlateDecode >>\nstream\n%s\nendstream" % (len(content), content),
    ]
    # The four bytes tell programs that move files that this one is not text.
    whole, starts = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
    for index, body in enumerate(bodies, 1):
        starts.append(len(whole))
        whole += b"%d 0 obj\n%s\nendobj\n" % (index, body)
    table = b"".join(b"%010d 00000 n \n" % start for start in starts)
    return whole + (
        b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R >>\n"
        b"startxref\n%d\n%%%%EOF\n" % (len(bodies) + 1, table, len(bodies) + 1, len(whole))
    )


def _list_colors(page: Page) -> Iterator[Codes]:
    """Yield all colours of a page."""
    if page.background is not None:
        yield page.background
    for text in page.texts:
        yield from (text.color, text.box_color)
    for stroke in page.strokes:
        yield stroke.color


def _pdf_content(page: Page) -> Iterator[str]:
    """Yield the lines of a page's content: y runs up there."""
    if page.background is not None:
        yield from (_pdf_paint(page.background, "rg"), f"0 0 {_join(page[:2])} re f")
    yield "1 j"
    for stroke in page.strokes:
        yield _pdf_paint(stroke.color, "RG")
        dash = "" if stroke.dash is None else _join(stroke.dash)
        cap = int(_cap(stroke) == "round")
        yield f"{format_number(stroke.width)} w {cap} J [{dash}] 0 d"
        for path in stroke.paths:
            points = [_join((x, page.height - y)) for x, y in path.tolist()]
            is_closed = len(points) > 2 and points[0] == points[-1]
            rest = points[1:-1] if is_closed else points[1:]
            yield (
                f"{points[0]} m "
                + "".join(f"{one} l " for one in rest)
                + "S" * (not is_closed)
                + "s" * is_closed
            )
    for text in page.texts:
        if text.box is not None:
            x, y, width, height = text.box
            yield _pdf_paint(text.box_color, "rg")
            yield f"{_join((x, page.height - y - height, width, height))} re f"
        if text.outlines is not None:
            yield _pdf_paint(text.color, "rg")
            yield from _pdf_outlines(text.outlines, page.height)
            continue
        yield f"{_pdf_paint(text.color, 'rg')} BT /F {format_number(text.size)} Tf"
        for (line, width), baseline in zip(text.lines, text.baselines, strict=True):
            x = text.x - TEXT_SHIFTS[text.align] * width
            yield f"1 0 0 1 {_join((x, page.height - baseline))} Tm ({_pdf_string(line)}) Tj"
        yield "ET"


def _pdf_outlines(contours: Sequence[Float64], height: float) -> Iterator[str]:
    """Yield the operators that fill contours of quadratic curves, as the cubic ones they are."""
    for curves in contours:
        first, bend, last = (curves[:, k] * (1.0, -1.0) + (0.0, height) for k in range(3))
        yield f"{_join(first[0])} m"
        for row in np.concatenate([(first + 2.0 * bend) / 3.0, (last + 2.0 * bend) / 3.0, last], 1):
            yield f"{_join(row)} c"
    yield "f"


def _pdf_paint(color: Codes, operator: str) -> str:
    """Return the operators that set a colour and its alpha."""
    parts = " ".join(format_number(code / 255.0) for code in color[:3])
    return f"/A{color[3]} gs {parts} {operator}"


def _pdf_string(text: str) -> str:
    """Return a text as PDF's strings have it."""
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
