"""Measure what a plane cuts: outlines and areas, in world space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rasterjit.io.meshes import as_scene
from rasterjit.scene.arrays import Float64, Int64
from rasterjit.scene.normals import dot_rows
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.scene.section import SectionPlane
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import instance_of, read_only
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


def cross_section(scene: Any, plane: SectionPlane) -> CrossSection:
    """
    Measure what a plane cuts of a scene, in float64; nothing is drawn.

    Planes of the scene's own section count as if there were none, and ``node.section`` as in
    pictures: what is left whole has no outline.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    plane : SectionPlane

    Raises
    ------
    ValueError
        If ``plane`` is not a `SectionPlane`, or ``scene`` holds no mesh.

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
    instance_of("plane", plane, SectionPlane)
    whole = with_labels(pose_scene(as_scene(scene, "scene")), [])
    if not whole.nodes:
        raise ValueError("scene must hold at least one mesh, got an empty scene")
    whole.section = replace(plane, cap=True, lines=True)
    cut = cut_scene(whole)
    areas = np.zeros(len(whole.nodes))
    outlines: list[tuple[Float64, ...]] = [()] * len(whole.nodes)
    if isinstance(cut.nodes, CutNodes):
        _measure(cut, areas, outlines)
    return CrossSection(plane, read_only(areas), tuple(outlines))


def _measure(cut: Scene, areas: Float64, outlines: list[tuple[Float64, ...]]) -> None:
    """Write the areas and outlines of all objects of a cut scene."""
    nodes = cut.nodes
    assert isinstance(nodes, CutNodes)
    areas[:] = nodes.cut.areas[:, 0]
    edges, owners = nodes.cut.edges[0].astype(np.int64), nodes.cut.owners.tolist()
    first_vertex = first_face = 0
    for number, (node, owner) in enumerate(zip(nodes, owners, strict=False)):
        points = transform_points(node.world_matrix, node.mesh.vertices)[:, :3]
        is_cap = nodes.cut.face_numbers[first_face] >= nodes.cut.face_starts[-1]
        if not is_cap and len(nodes.cut.sides[0]):
            own = edges[nodes.cut.sides[0][:, 1] == number] - first_vertex
            outlines[owner] = tuple(read_only(points[line]) for line in join_edges(own))
            if len(own) and not areas[owner]:
                areas[owner] = np.nan
        first_vertex += len(points)
        first_face += len(node.mesh.faces)


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
