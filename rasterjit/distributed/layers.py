"""
Draw a part of a mesh, and merge what two parts show: the nearest face at every pixel.

Depths are compared as they are stored while a mesh is drawn, and what is equal goes to the lower
face number; of two parts that is the first one's. So merging neighbours in any order gives what
drawing all faces together gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.rendering import planning
from rasterjit.rendering.planning import FrameRequest, plan_views
from rasterjit.rendering.renderer import draw_frame
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import Workers
from rasterjit.scene.camera import Camera, settled
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.validation import in_short
from rasterjit.survey.clip_planes import BesidePlanes
from rasterjit.survey.effect import SeesThrough
from rasterjit.survey.facts import NORMAL_OUTPUTS
from rasterjit.survey.object_counts import SMOOTH
from rasterjit.survey.plan import RenderPlan

LARGEST_FACE = 2**31 - 1
"""Most faces of all parts: their numbers are int32."""

COUNTS = (
    "triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn", "clipped",
)  # fmt: skip
"""Statistics that add up."""


@dataclass
class PartialImage:
    """What some neighbouring parts of a mesh show."""

    faces: int
    """How many they have."""
    depth: NDArray[Any]
    """(H, W), as stored: greater is nearer."""
    outputs: dict[str, NDArray[Any]]
    """(H, W, ...) each; ``face_id`` counts from the first of these faces."""
    counts: dict[str, int]
    seconds: dict[str, float]
    plan: RenderPlan
    look: BesidePlanes
    """What is seen of all of them beside the near and the far plane."""

    def frame(self) -> Frame:
        """Return the picture of all parts, which are one object."""
        outputs = {name: self.outputs[name] for name in self.plan.outputs}
        stats = FrameStats(**self.counts, seconds=self.seconds, face_id=self.outputs["face_id"])
        _ = stats.pixels_covered
        plan = self.plan.with_(look=self.look)
        return Frame(outputs, plan, stats, face_starts=np.array([0, self.faces]))


def mesh_of(part: Any, material: Material | None) -> Mesh | None:
    """
    Return a part of a mesh, wherever it comes from; ``None`` if it has no face.

    Parameters
    ----------
    part : Mesh, (vertices, faces), a list of such pairs, or a callable that returns one of them
        Vertices (V, 3), world space, and faces (F, 3), vertex numbers.
    material : Material or None
        For what comes without one.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    if callable(part):
        part = part()
    if isinstance(part, Mesh):
        return part
    pairs = [part] if isinstance(part, tuple) else part
    if not isinstance(pairs, (list, tuple)) or not all(
        isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in pairs
    ):
        raise ValueError(
            "partitions must give a Mesh, (vertices, faces), or a list of such pairs; got "
            f"{in_short(part)}"
        )
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pairs)])
    faces = [
        np.asarray(own).reshape(-1, 3) + first
        for (_, own), first in zip(pairs, starts[:-1], strict=True)
    ]
    if not sum(map(len, faces)):
        return None
    vertices = np.concatenate([np.asarray(own, np.float64) for own, _ in pairs])
    return Mesh(vertices, np.concatenate(faces), material=material or Material(shading="flat"))


def draw_layer(
    part: Any,
    setting: Scene,
    material: Material | None,
    camera: Camera,
    options: FrameRequest,
    threads: int,
    steps: tuple[int, int] = (0, 0),
) -> PartialImage | None:
    """
    Draw one part with the light of the whole; ``None`` if it has no face.

    ``steps`` say where planes are that the camera leaves open, as `settled` takes them.
    """
    checked = plan_part(mesh_of(part, material), setting, camera, options)
    if checked is None:
        return None
    scene, asked = checked
    outputs = tuple(dict.fromkeys((*options.outputs, "face_id")))
    clock, workers = StageClock(), Workers(threads)
    try:
        request = options._replace(outputs=outputs)
        planned = plan_views(request, scene, settled(camera, *steps))
        kept = {"depth": True, "draws": True}
        frame, seen = draw_frame(planned, workers, clock=clock, **kept)
    finally:
        workers.close()
    counts = {name: getattr(frame.stats, name) for name in COUNTS}
    (node,) = scene.nodes
    faces = len(node.mesh.faces)
    asked, seconds = asked.with_(camera=planned.plan.camera), frame.stats.seconds
    return PartialImage(
        faces, seen.coverage.depth, frame.arrays(), counts, seconds, asked, asked.look
    )


def plan_part(
    mesh: Mesh | None, setting: Scene, camera: Camera, options: FrameRequest
) -> tuple[Scene, RenderPlan] | None:
    """
    Return a part in the light of the whole, and the plan of it; ``None`` if it has no face.

    Raises
    ------
    ValueError
        If it shows what cannot be told from one part alone.
    """
    if mesh is None or not len(mesh.faces):
        return None
    _refuse_neighbours(mesh, options.outputs)
    scene = Scene()
    for name in ("lights", *EFFECT_FIELDS):
        setattr(scene, name, getattr(setting, name))
    scene.add(mesh)
    scene = scene.posed()
    plan = planning.plan_frame(options, scene, camera)
    _refuse_mixing(plan)
    return scene, plan


def _refuse_neighbours(mesh: Mesh, outputs: Sequence[str]) -> None:
    """Raise ``ValueError`` for what faces of other parts have a share in."""
    material = mesh.material
    asked = next((name for name in NORMAL_OUTPUTS if name in outputs), None)
    if asked is not None and mesh.normals is None:
        raise ValueError(
            f"partitions must have normals for the output {asked!r}, for those at their edges "
            "follow from faces of other partitions; give a Mesh with normals, or ask for "
            "'geometric_normal'"
        )
    if material.shading in SMOOTH and mesh.normals is None:
        raise ValueError(
            f"partitions must have normals where they are shaded by {material.shading!r}, for "
            "those at their edges follow from faces of other partitions; give a Mesh with normals, "
            "or shading 'flat' or 'unlit'"
        )
    if material.has_normal_map:
        raise ValueError(
            "partitions must have no normal_texture and no clearcoat_normal_texture: the tangents "
            "at their edges follow from faces of other partitions"
        )


def _refuse_mixing(plan: RenderPlan) -> None:
    """Raise ``ValueError`` if a pixel shows more than its nearest face."""
    sees_through = any(isinstance(one.effect, SeesThrough) for one in plan.planned)
    if plan.layers is not None or plan.pictures > 1 or sees_through:
        raise ValueError(
            "partitions must be opaque: what is seen through a face, or mixed at its edges, may "
            "lie in another partition; use alpha_mode 'opaque' or 'mask', no transmission, "
            "and quality.samples of 1"
        )


def merge_layers(first: PartialImage | None, second: PartialImage | None) -> PartialImage | None:
    """
    Return what two neighbours show together; the first one's faces have the lower numbers.

    Raises
    ------
    ValueError
        If they have more faces together than numbers reach, or attributes of different sizes.
    """
    if first is None or second is None:
        return first if second is None else second
    faces = first.faces + second.faces
    if faces > LARGEST_FACE:
        raise ValueError(f"partitions must have at most {LARGEST_FACE} faces together, got {faces}")
    is_nearer = second.depth > first.depth
    outputs = {}
    for name, own in first.outputs.items():
        other = second.outputs[name]
        if own.shape != other.shape:
            raise ValueError(
                f"partitions must have as many columns each in the output {name!r}, got "
                f"{own.shape[-1]} and {other.shape[-1]}"
            )
        if name == "face_id":
            other = np.where(other >= 0, other + np.int32(first.faces), other)
        mask = is_nearer.reshape(*is_nearer.shape, *(1,) * (own.ndim - 2))
        outputs[name] = np.where(mask, other, own)
    return PartialImage(
        faces,
        np.where(is_nearer, second.depth, first.depth),
        outputs,
        {name: first.counts[name] + second.counts[name] for name in COUNTS},
        {
            name: first.seconds.get(name, 0.0) + second.seconds.get(name, 0.0)
            for name in dict.fromkeys((*first.seconds, *second.seconds))
        },
        first.plan,
        first.look.beside(second.look),
    )


def merge_tree(layers: Sequence[Any], merge: Callable[[Any, Any], Any]) -> Any:
    """Merge neighbours, then neighbours of those, until one is left."""
    while len(layers) > 1:
        pairs = [merge(*layers[n : n + 2]) for n in range(0, len(layers) - 1, 2)]
        layers = [*pairs, *layers[len(pairs) * 2 :]]
    return layers[0]
