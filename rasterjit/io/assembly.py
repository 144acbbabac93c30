"""What a file holds in places that hang below one another, and the scene that it becomes."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.io.text.parts import Thing, thing_mesh
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import Light
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.node import Node, tops_of
from rasterjit.scene.scene import Scene


@dataclass(frozen=True)
class Place:
    """
    A node.

    Parameters
    ----------
    name : str
    transform : (4, 4) float64
        Relative to the parent or, without one, to the world.
    parent, thing : int, optional
        Numbers of a place before it, and of what stands there.
    """

    name: str
    transform: NDArray[np.float64]
    parent: int | None = None
    thing: int | None = None


@dataclass(frozen=True)
class Assembly:
    """
    Things, and where each stands.

    Parameters
    ----------
    things : list of Part, Cloud or Drawing
    places : list of Place
    drawn : list of int
        Numbers of the places with a thing, in the order of the scene's objects.
    camera : PerspectiveCamera, optional
    lights : list of Light
    """

    things: list[Thing]
    places: list[Place]
    drawn: list[int]
    camera: PerspectiveCamera | None = None
    lights: list[Light] = field(default_factory=list)


def scene_of_assembly(
    found: Assembly,
    source: str,
    on_invalid: OnInvalid,
    crease_angle: float,
    left_out: LeftOut,
    budget: MemoryBudget | None = None,
) -> Scene:
    """Return a scene of what a file or an object holds, or raise `MeshFileError`."""
    # What is in memory already has been paid for.
    budget = MemoryBudget(source, sys.maxsize) if budget is None else budget
    meshes = [
        thing_mesh(one, source, on_invalid, crease_angle, left_out, budget) for one in found.things
    ]
    nodes: list[Node] = []
    for place in found.places:
        parent: Any = None if place.parent is None else nodes[place.parent]
        try:
            nodes.append(Node(None, place.transform, place.name, parent=parent))
        except ValueError as error:
            raise MeshFileError(f"{source}: node {place.name!r}: {error}") from error
    drawn = [nodes[number] for number in found.drawn]
    for number, node in zip(found.drawn, drawn, strict=True):
        thing = found.places[number].thing
        node.mesh = None if thing is None else meshes[thing]
    scene = Scene()
    for top in tops_of(drawn):
        scene._take(top, is_new=True)
    # Objects are numbered as the file has them, whatever they hang below.
    scene.nodes[:] = drawn
    scene.camera = found.camera
    scene.lights += found.lights
    return scene
