"""Measure what a plane cuts: outlines and areas, in world space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from rasterjit.io.meshes import as_scene
from rasterjit.scene.arrays import Float64, Int64
from rasterjit.scene.normals import dot_rows
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.scene.section import SectionPlane, check_section, planes_in, replace_planes
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import read_only, short_repr
from rasterjit.survey.cross_sections import CutNodes, cut_scene
from rasterjit.survey.deformation import pose_scene


@dataclass(frozen=True, eq=False)
class CrossSection:
    """
    What a plane cuts of a scene, as `cross_section` returns it.

    Parameters
    ----------
    plane : SectionPlane
    areas : (O,) float64, scene units squared, read-only
        Of each object, as ``object_id`` numbers them: of the cap that closes it. 0 where the plane
        misses it; NaN where it is not closed.
    outlines : tuple of tuples of (N, 3) float64
        Of each object the lines along which the plane cuts its faces, world space. A closed one
        ends with its first point.
    """

    plane: SectionPlane
    areas: Float64
    outlines: tuple[tuple[Float64, ...], ...]

    @property
    def area(self) -> float:
        """The sum of all areas: where solids overlap, that counts for each; NaN if one is NaN."""
        return math.fsum(self.areas)

    @property
    def length(self) -> float:
        """The length of all outlines, scene units."""
        lines = (line for lines in self.outlines for line in lines)
        return math.fsum(size for line in lines for size in _lengths(np.diff(line, axis=0)))


@overload
def cross_section(scene: Any, plane: SectionPlane) -> CrossSection: ...
@overload
def cross_section(scene: Any, plane: Sequence[SectionPlane]) -> tuple[CrossSection, ...]: ...
def cross_section(
    scene: Any, plane: SectionPlane | Sequence[SectionPlane]
) -> CrossSection | tuple[CrossSection, ...]:
    """
    Measure what a plane cuts of a scene, in float64; nothing is drawn.

    Planes of the scene's own section count as if there were none, and ``node.section`` as in
    pictures: what is left whole has no outline. Of several planes, such as `SectionPlane.box`
    returns, each one's cut ends where the others cut, as in pictures.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    plane : SectionPlane, or several

    Returns
    -------
    CrossSection, or a tuple of one for each plane

    Raises
    ------
    ValueError
        If ``plane`` is no `SectionPlane` and no sequence of 1 to 16, or ``scene`` holds no mesh.

    Warns
    -----
    UserWarning
        Once for each mesh whose cut has no area, as it is not closed.

    Examples
    --------
    >>> import rasterjit as rj, trimesh
    >>> ball = trimesh.creation.icosphere(4)
    >>> cut = rj.cross_section(ball, rj.SectionPlane((0, 0, 0), (0, 0, 1)))
    >>> round(cut.area, 1), round(cut.length, 1), len(cut.outlines[0])
    (3.1, 6.3, 1)
    """
    planes = planes_in(check_section("plane", plane))
    if not planes:
        raise ValueError(f"plane must be a SectionPlane or several, got {short_repr(plane)}")
    whole = with_labels(pose_scene(as_scene(scene, "scene")), [])
    if not whole.nodes:
        raise ValueError("scene must hold at least one mesh, got an empty scene")
    whole.section = replace_planes(planes, cap=True, lines=True)
    cut = cut_scene(whole)
    found = [_measure(cut, len(whole.nodes), n, one) for n, one in enumerate(planes)]
    return found[0] if isinstance(plane, SectionPlane) else tuple(found)


def _measure(cut: Scene, count: int, number: int, plane: SectionPlane) -> CrossSection:
    """Return what a plane of a cut scene cuts of each of the original's objects."""
    nodes, areas = cut.nodes, np.zeros(count)
    outlines: list[tuple[Float64, ...]] = [()] * count
    assert isinstance(nodes, CutNodes)
    areas[:] = nodes.cut.areas[:, number]
    edges, sides = nodes.cut.edges[number].astype(np.int64), nodes.cut.sides[number]
    first_vertex = first_face = 0
    for new, (node, owner) in enumerate(zip(nodes, nodes.cut.owners.tolist(), strict=False)):
        points = transform_points(node.world_matrix, node.mesh.vertices)[:, :3]
        is_cap = nodes.cut.face_numbers[first_face] >= nodes.cut.face_starts[-1]
        if not is_cap and len(sides):
            own = edges[sides[:, 1] == new] - first_vertex
            outlines[owner] = tuple(read_only(points[line]) for line in join_edges(own))
            if len(own) and not areas[owner]:
                areas[owner] = np.nan
        first_vertex += len(points)
        first_face += len(node.mesh.faces)
    return CrossSection(plane, read_only(areas), tuple(outlines))


def _lengths(vectors: Float64) -> list[float]:
    """Return the lengths of vectors, (N, 3)."""
    return np.sqrt(dot_rows(vectors, vectors)).tolist()


def join_edges(edges: Int64) -> list[list[int]]:
    """Return chains of edges, (E, 2), as vertices; a closed one ends with its first."""
    neighbours: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    chains = []
    # Open chains begin at ends; what is left are closed ones.
    ends = [vertex for vertex, beside in neighbours.items() if len(beside) % 2]
    for start in [*ends, *neighbours]:
        while neighbours[start]:
            chain = [start]
            while neighbours[chain[-1]] and (len(chain) == 1 or chain[-1] != start):
                there = neighbours[chain[-1]].pop()
                neighbours[there].remove(chain[-1])
                chain.append(there)
            chains.append(chain)
    return chains
