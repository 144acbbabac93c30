"""
A process that draws random scenes with the package ``rasterjit`` of another folder.

``python -m benchmarks.same_bits_worker FOLDER SEED COUNT`` prints a line of JSON for each scene:
the hash of every output by the way in which the frame was drawn, the plan's stages of shading, and
the one change. The last line has the names of the kernels and stages that ran, and of all.
"""

from __future__ import annotations

import copy
import json
import sys
import warnings
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.compare_worker import digest, use_package

GENERATOR = Path(__file__).parents[1] / "tests" / "support"
"""Folder of ``random_scenes``: the same for all packages."""


RENAMED = {"SectionPlane": "Plane", "PreviousView": "View"}
"""What random scenes say, by what it was called before."""


def use_new_names() -> None:
    """Let a package from before the first release be asked by the names of now."""
    import rasterjit as rj

    for name, before in RENAMED.items():
        if not hasattr(rj, name):
            setattr(rj, name, getattr(rj, before))


class Drawn:
    """One random scene, and the ways in which it is drawn."""

    def __init__(self, random: np.random.Generator) -> None:
        use_new_names()
        import random_scenes

        self.quality = random_scenes.random_quality(random)
        self.scene = random_scenes.random_scene(
            random,
            random_scenes.chance(random, 0.2),
            sees_through=self.quality.samples != "area",
        )
        self.cameras = [random_scenes.random_camera(random) for _ in range(2)]
        self.outputs = random_scenes.random_outputs(random)
        self.size = random_scenes.SIZE
        self.changed, self.change = changed(self.scene, random)

    def ways(self) -> dict[str, Any]:
        """Return a function for each way, which returns arrays by output."""
        import rasterjit as rj

        asked = {"size": self.size, "quality": self.quality, "outputs": self.outputs}
        (other, camera), scene = self.cameras, self.scene

        def kept(*frames: tuple[Any, Any]) -> dict[str, Any]:
            """Return the last frame of a renderer, whose third of a kind has bound calls."""
            with rj.Renderer(self.size, quality=self.quality) as renderer:
                for frame in frames:
                    drawn = renderer.render(*frame, outputs=self.outputs)
                return drawn.arrays()

        def batch(threads: int) -> dict[str, Any]:
            drawn = rj.render_batch(scene, [other, camera], threads=threads, **asked)
            return {name: array[1] for name, array in drawn.arrays().items()}

        return {
            "lone, 1 thread": lambda: rj.render(scene, camera, threads=1, **asked).arrays(),
            "lone, 2 threads": lambda: rj.render(scene, camera, threads=2, **asked).arrays(),
            "kept": lambda: kept((scene, other), (scene, camera)),
            "bound": lambda: kept(*2 * ((scene, other), (scene, camera))),
            "batch, 1 thread": lambda: batch(1),
            "batch, 2 threads": lambda: batch(2),
            "changed": lambda: rj.render(self.changed, camera, **asked).arrays(),
            "bound, changed": lambda: kept(*3 * ((scene, camera),), (self.changed, camera)),
            "kept, changed": lambda: kept((scene, camera), (self.changed, camera)),
        }

    def stages(self) -> list[str]:
        """Return the names of the stages of shading that the plan lists."""
        import rasterjit as rj

        for name in ("rendering.planning", "rendering.plan"):
            # Older commits have it elsewhere.
            with suppress(ImportError):
                planning = import_module(f"rasterjit.{name}")
                break
        list_passes = getattr(planning, "list_passes", None) or planning.list_stages

        plan = rj.explain(
            self.scene, self.cameras[1], size=self.size, quality=self.quality, outputs=self.outputs
        )
        return [stage.name for stage in list_passes(plan)]


def changed(scene: Any, random: np.random.Generator) -> tuple[Any, str]:
    """Return a scene with one change, and which."""
    import random_scenes

    twin = copy.copy(scene)
    twin.nodes, twin.lights = list(scene.nodes), list(scene.lights)
    twin._labelled = dict(scene._labelled)
    change = str(random.choice(["light", "lights", "node", "place", "material", "effect"]))
    node = twin.nodes[0]
    if change == "light":
        twin.lights[0] = replace(twin.lights[0], color=(0.9, 0.6, 0.3))
    elif change == "lights":
        twin.lights.append(random_scenes.random_light(random))
    elif change == "node":
        twin.add(random_scenes.random_mesh(random, sees_through=False))
    elif change == "place":
        twin.nodes.pop(0)
        twin.add(node.mesh, random_scenes.random_pose(random))
    elif change == "material":
        mesh = copy.copy(node.mesh)
        mesh.material = replace(mesh.material, base_color=(0.2, 0.7, 0.4))
        twin.nodes[0] = copy.copy(node)
        twin.nodes[0].mesh = mesh
    else:
        name = str(random.choice([*random_scenes.EFFECTS]))
        has_it = getattr(twin, name) is not None
        setattr(twin, name, None if has_it else random_scenes.EFFECTS[name](random))
    return twin, change


def hashes(draw: Any) -> dict[str, str]:
    """Return the hash of each output, or the kind of error that drawing ended with."""
    try:
        return {name: digest([array])[:16] for name, array in sorted(draw().items())}
    except Exception as error:
        return {"error": type(error).__name__}


def ran() -> dict[str, list[str]]:
    """Return the names of the kernels and stages that ran in this process, and of all."""
    from rasterjit.runtime import jit

    used = [one.__name__ for one in jit.KERNELS if one.forms]
    used += [one.__name__ for one in jit.STAGES if one.is_in_use]
    return {"ran": used, "known": [one.__name__ for one in (*jit.KERNELS, *jit.STAGES)]}


def main(folder: str, seed: str, count: str) -> None:
    """Draw the scenes."""
    use_package(folder)
    sys.path.insert(0, str(GENERATOR))
    warnings.simplefilter("ignore")
    for number in range(int(count)):
        drawn = Drawn(np.random.default_rng([int(seed), number]))
        found = {way: hashes(draw) for way, draw in drawn.ways().items()}
        row = {"hashes": found, "stages": drawn.stages(), "change": drawn.change}
        print(json.dumps(row), flush=True)
    print(json.dumps(ran()), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
