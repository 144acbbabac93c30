"""
Load a robot from a URDF file, move its joints, and write what they do as a GIF.

``python robot.py arm.urdf -o robot.gif --strip robot.png``. Links have boxes, cylinders, spheres
and meshes; joints are fixed, revolute, continuous or prismatic.
"""

from __future__ import annotations

import argparse
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

import rasterjit as rj
from rasterjit import animation
from rasterjit.io.images import save_image

Matrix = NDArray[np.float64]


@dataclass
class Joint:
    """One joint: the node of the link that it moves, and how."""

    node: rj.Node
    kind: str
    origin: Matrix
    axis: tuple[float, ...]
    lower: float
    upper: float

    def move(self, value: float) -> None:
        """Turn the link by radians, or push it by metres."""
        if not self.lower <= value <= self.upper:
            raise ValueError(f"joint must lie in {self.lower}..{self.upper}, got {value}")
        if self.kind == "prismatic":
            moved = rj.transforms.translate(value * np.array(self.axis))
        else:
            moved = rj.transforms.rotate(self.axis, float(np.degrees(value)))
        self.node.transform = self.origin @ moved


@dataclass
class Robot:
    """A scene with one node for each link, and the joints that move them, by name."""

    scene: rj.Scene = field(default_factory=rj.Scene)
    links: dict[str, rj.Node] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)

    def move(self, **values: float) -> None:
        """Move joints: radians, or metres for prismatic ones; the others stay."""
        for name, value in values.items():
            self.joints[name].move(value)


def numbers(element: ET.Element | None, name: str, default: str) -> tuple[float, ...]:
    """Return the numbers of an attribute, or of its default."""
    return tuple(map(float, (default if element is None else element.get(name, default)).split()))


def origin_of(element: ET.Element) -> Matrix:
    """Return the matrix of an origin: roll, pitch and yaw about fixed axes, then the offset."""
    origin = element.find("origin")
    roll, pitch, yaw = np.degrees(numbers(origin, "rpy", "0 0 0"))
    place = rj.transforms
    return place.compose(
        place.translate(numbers(origin, "xyz", "0 0 0")),
        place.rotate_z(yaw), place.rotate_y(pitch), place.rotate_x(roll),
    )  # fmt: skip


def shape_of(visual: ET.Element, folder: Path) -> rj.Mesh:
    """Return the mesh of a visual: a primitive, or a file beside the URDF."""
    shape = next(visual.iterfind("geometry/*"))
    if shape.tag == "mesh":
        mesh = trimesh.load_mesh(folder / shape.attrib["filename"])
        mesh.apply_scale(numbers(shape, "scale", "1 1 1"))
    elif shape.tag == "box":
        mesh = trimesh.creation.box(numbers(shape, "size", ""))
    elif shape.tag == "cylinder":
        size = float(shape.attrib["radius"]), float(shape.attrib["length"])
        mesh = trimesh.creation.cylinder(*size, sections=48)
    elif shape.tag == "sphere":
        mesh = trimesh.creation.icosphere(3, float(shape.attrib["radius"]))
    else:
        raise ValueError(f"geometry must be a mesh, box, cylinder or sphere, got {shape.tag}")
    return rj.Mesh(mesh.vertices, mesh.faces).split_creases()


def load_urdf(path: Path) -> Robot:
    """Read a URDF file; all joints stand at 0, or at the limit nearest to it."""
    root, robot = ET.parse(path).getroot(), Robot()
    # URDF's colours are meant as sRGB, which 8-bit colours are; floats are linear light.
    colors = {
        one.get("name"): np.uint8(np.multiply(255, numbers(one.find("color"), "rgba", "1 1 1 1")))
        for one in root.iter("material")
        if one.find("color") is not None
    }
    for link in root.iterfind("link"):
        name = link.attrib["name"]
        robot.links[name] = rj.Node(name=name)
        for visual in link.iterfind("visual"):
            mesh = shape_of(visual, path.parent)
            material = visual.find("material")
            color = None if material is None else colors.get(material.get("name"))
            mesh.material = rj.Material("pbr", color, roughness=0.4)
            rj.Node(mesh, origin_of(visual), name, parent=robot.links[name])
    for one in root.iterfind("joint"):
        ends = [next(one.iterfind(end)).attrib["link"] for end in ("child", "parent")]
        child = robot.links[ends[0]]
        child.parent = robot.links[ends[1]]
        kind, limit = one.attrib["type"], one.find("limit")
        far = math.inf if kind == "continuous" else 0.0
        (lower,), (upper,) = numbers(limit, "lower", f"{-far}"), numbers(limit, "upper", f"{far}")
        axis = numbers(one.find("axis"), "xyz", "1 0 0")
        joint = Joint(child, kind, origin_of(one), axis, lower, upper)
        joint.move(min(max(0.0, lower), upper))
        robot.joints[one.attrib["name"]] = joint
    for link_node in robot.links.values():
        if link_node.parent is None:
            robot.scene.add(link_node)
    return robot


def set_stage(robot: Robot) -> None:
    """Add a floor and lights."""
    floor = rj.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    floor.material = rj.Material("pbr", "#cfd4d9", roughness=0.9)
    robot.scene.add(floor)
    key = rj.DirectionalLight(
        (-0.5, 0.7, -1.2), intensity=0.85, shadow=rj.Shadow(1024, "soft", 5.0)
    )
    robot.scene.lights += [rj.AmbientLight(intensity=0.3), key]


def swing(robot: Robot, share: float) -> None:
    """Move every joint to and fro within its limits; one loop from share 0 to 1."""
    for k, joint in enumerate(robot.joints.values()):
        low, high = max(joint.lower, -0.7), min(joint.upper, 0.9)
        joint.move(low + (high - low) * (0.5 - 0.5 * math.cos(2.0 * math.pi * (share - 0.11 * k))))


def main(arguments: list[str] | None = None) -> None:
    """Write the GIF, and a strip of four poses."""
    parser = argparse.ArgumentParser(description=__doc__)
    beside = Path(__file__).with_name("arm.urdf")
    parser.add_argument("urdf", type=Path, nargs="?", default=beside, help="z up, metres")
    parser.add_argument("-o", "--output", type=Path, default=Path("robot.gif"))
    parser.add_argument("--strip", type=Path, default=Path("robot.png"))
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--size", type=int, nargs=2, default=(240, 240), metavar=("W", "H"))
    chosen = parser.parse_args(arguments)
    robot = load_urdf(chosen.urdf)
    set_stage(robot)
    camera = rj.PerspectiveCamera((1.9, -2.0, 1.1), (0.0, 0.0, 0.58), (0, 0, 1), fov_y=44.0)
    pictures = []
    with rj.Renderer(tuple(chosen.size), quality=rj.Quality(samples=8)) as renderer:
        for k in range(chosen.frames):
            swing(robot, k / chosen.frames)
            pictures.append(renderer.render(robot.scene, camera, background="#dfe5ea").color)
    animation.save(pictures, chosen.output, fps=12)
    save_image(chosen.strip, np.hstack(pictures[:: max(1, chosen.frames // 4)][:4]))
    print(f"{len(robot.links)} links, {len(robot.joints)} joints, {len(pictures)} frames")


if __name__ == "__main__":
    main()
