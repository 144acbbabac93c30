"""
Load a robot from a URDF file, move its joints, and write what they do as a GIF.

``python robot.py arm.urdf -o robot.gif --strip robot.png``. It takes
``pip install "rasterjit[robots]"``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import rasterjit as rj
from rasterjit import animation
from rasterjit.io.images import save_image


def set_stage(robot: rj.Scene) -> None:
    """Add a floor and lights."""
    floor = rj.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    floor.material = rj.Material("pbr", "#cfd4d9", roughness=0.9)
    robot.add(floor)
    key = rj.DirectionalLight(
        (-0.5, 0.7, -1.2), intensity=0.85, shadow=rj.Shadow(1024, "soft", 5.0)
    )
    robot.lights += [rj.AmbientLight(intensity=0.3), key]


def swing(robot: rj.Scene, count: int) -> np.ndarray:
    """Return poses, (N, J), in which every joint goes to and fro within its limits once."""
    joints = [robot.joints[name] for name in robot.joints.free]
    low, high = np.clip([joint.limits for joint in joints], -40.0, 50.0).T
    share = np.arange(count)[:, np.newaxis] / count - 0.11 * np.arange(len(joints))
    return low + (high - low) * (0.5 - 0.5 * np.cos(2.0 * np.pi * share))


def main(arguments: list[str] | None = None) -> None:
    """Write the GIF, and a strip of four poses."""
    parser = argparse.ArgumentParser(description=__doc__)
    beside = Path(__file__).with_name("arm.urdf")
    parser.add_argument("urdf", type=Path, nargs="?", default=beside)
    parser.add_argument("-o", "--output", type=Path, default=Path("robot.gif"))
    parser.add_argument("--strip", type=Path, default=Path("robot.png"))
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--size", type=int, nargs=2, default=(240, 240), metavar=("W", "H"))
    chosen = parser.parse_args(arguments)
    robot = rj.load(chosen.urdf)
    set_stage(robot)
    camera = rj.PerspectiveCamera((1.9, -2.0, 1.1), (0.0, 0.0, 0.55), (0, 0, 1), fov_y=50.0)
    pictures = []
    with rj.Renderer(tuple(chosen.size), quality=rj.Quality(samples=8)) as renderer:
        for pose in swing(robot, chosen.frames):
            robot.joints.move(pose)
            pictures.append(renderer.render(robot, camera, background="#dfe5ea").color)
    animation.save(pictures, chosen.output, fps=12)
    save_image(chosen.strip, np.hstack(pictures[:: max(1, chosen.frames // 4)][:4]))
    print(f"{len(robot.joints)} joints, {len(robot.nodes)} objects, {len(pictures)} frames")


if __name__ == "__main__":
    main()
