"""
Render sort-last: draw the parts of a mesh on the machines that hold them, then merge by depth.

References
----------
.. [1] S. Molnar, M. Cox, D. Ellsworth, H. Fuchs, "A Sorting Classification of Parallel Rendering",
   IEEE Computer Graphics and Applications 14(4), 1994: the name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.distributed import clusters
from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.output_table import Outputs, is_attribute
from rasterjit.rendering import planning, view_warnings
from rasterjit.rendering.batch import check_arguments
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import Cull, FrameRequest, plan_frame
from rasterjit.rendering.renderer import draw_frame
from rasterjit.runtime.clocks import StageClock
from rasterjit.runtime.threads import Workers
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, check_camera, move_planes
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.validation import brief, thread_count
from rasterjit.survey.clip_planes import PlaneNeeds, merge_needs
from rasterjit.survey.effect import OpaquePassEffect, ScreenEffect
from rasterjit.survey.facts import NORMAL_OUTPUTS
from rasterjit.survey.object_counts import SMOOTH
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from distributed import Client

MAX_FACES = 2**31 - 1
"""Most faces of all parts together, as face numbers are int32."""

SUMMED_STATS = (
    "triangles_in", "outside", "culled", "degenerate", "unsampled", "invalid", "drawn", "clipped",
)  # fmt: skip
"""Fields of `FrameStats` that are summed over parts."""


@dataclass
class PartialImage:
    """The image of some neighbouring parts of a mesh."""

    face_count: int
    """Number of faces of the parts."""
    depth: NDArray[Any]
    """(H, W), stored depth: greater is nearer."""
    outputs: dict[str, NDArray[Any]]
    """(H, W, ...) each; ``face_id`` counts from the first face of the parts."""
    counts: dict[str, int]
    seconds: dict[str, float]
    plan: RenderPlan
    plane_needs: PlaneNeeds
    """What all parts need of automatic near and far planes."""

    def frame(self) -> Frame:
        """Return the frame of all parts, which are one object."""
        outputs = {name: self.outputs[name] for name in self.plan.outputs}
        stats = FrameStats(**self.counts, seconds=self.seconds, face_id=self.outputs["face_id"])
        _ = stats.pixels_covered
        plan = self.plan.for_picture(plane_needs=self.plane_needs)
        return Frame(outputs, plan, stats, face_starts=np.array([0, self.face_count]))


def make_part_mesh(part: Any, material: Material | None) -> Mesh | None:
    """
    Convert a part to a `Mesh`; ``None`` if it has no face.

    Parameters
    ----------
    part : Mesh, (vertices, faces), a list of such pairs, or a callable that returns one of them
        Vertices (V, 3), world space, and faces (F, 3), vertex numbers.
    material : Material or None
        Material of parts that are no ``Mesh``.

    Raises
    ------
    ValueError
        If ``part`` is something else.
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
            f"{brief(part)}"
        )
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pairs)])
    faces = [
        np.asarray(indices).reshape(-1, 3) + first
        for (_, indices), first in zip(pairs, starts[:-1], strict=True)
    ]
    if not sum(map(len, faces)):
        return None
    vertices = np.concatenate([np.asarray(positions, np.float64) for positions, _ in pairs])
    return Mesh(vertices, np.concatenate(faces), material=material or Material(shading="flat"))


def draw_part(
    part: Any,
    setting: Scene,
    material: Material | None,
    camera: Camera,
    options: FrameRequest,
    threads: int,
    steps: tuple[int, int] = (0, 0),
) -> PartialImage | None:
    """
    Draw one part with the lights and effects of ``setting``; ``None`` if it has no face.

    ``steps`` place automatic planes, as `move_planes` takes them.
    """
    planned_part = plan_part(make_part_mesh(part, material), setting, camera, options)
    if planned_part is None:
        return None
    scene, plan = planned_part
    outputs = tuple(dict.fromkeys((*options.outputs, "face_id")))
    clock, workers = StageClock(), Workers(threads)
    try:
        request = options._replace(outputs=outputs)
        planned_frame = plan_frame(request, scene, move_planes(camera, *steps))
        frame, drawing = draw_frame(planned_frame, workers, clock=clock, depth=True, draws=True)
    finally:
        workers.close()
    counts = {name: getattr(frame.stats, name) for name in SUMMED_STATS}
    (node,) = scene.nodes
    plan = plan.for_picture(camera=planned_frame.plan.camera)
    return PartialImage(
        len(node.mesh.faces), drawing.coverage.depth, frame.arrays(), counts, frame.stats.seconds,
        plan, plan.plane_needs,
    )  # fmt: skip


def plan_part(
    mesh: Mesh | None, setting: Scene, camera: Camera, options: FrameRequest
) -> tuple[Scene, RenderPlan] | None:
    """
    Return a scene of a part with the lights and effects of ``setting``, and its plan.

    ``None`` if the part has no face.

    Raises
    ------
    ValueError
        If the part has features that depend on other parts.
    """
    if mesh is None or not len(mesh.faces):
        return None
    _check_neighbours(mesh, options.outputs)
    scene = Scene()
    for name in ("lights", *EFFECT_FIELDS):
        setattr(scene, name, getattr(setting, name))
    scene.add(mesh)
    scene = scene.posed()
    plan = planning.make_plan(options, scene, camera)
    _check_opaque(plan)
    return scene, plan


def _check_neighbours(mesh: Mesh, outputs: Sequence[str]) -> None:
    """Raise ``ValueError`` for features that depend on faces of other parts."""
    material = mesh.material
    output = next((name for name in NORMAL_OUTPUTS if name in outputs), None)
    if output is not None and mesh.normals is None:
        raise ValueError(
            f"partitions must have normals for the output {output!r}, for those at their edges "
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


def _check_opaque(plan: RenderPlan) -> None:
    """Raise ``ValueError`` if pixels may show more than the nearest face."""
    sees_through = any(isinstance(planned.effect, OpaquePassEffect) for planned in plan.planned)
    if plan.layers is not None or plan.pictures > 1 or sees_through:
        raise ValueError(
            "partitions must be opaque: what is seen through a face, or mixed at its edges, may "
            "lie in another partition; use alpha_mode 'opaque' or 'mask', no transmission, "
            "and quality.samples of 1"
        )


def merge_images(first: PartialImage | None, second: PartialImage | None) -> PartialImage | None:
    """
    Merge the images of two neighbours by depth; the first one's faces have the lower numbers.

    Raises
    ------
    ValueError
        If they have more faces together than numbers reach, or attributes of different sizes.
    """
    if first is None or second is None:
        return first if second is None else second
    count = first.face_count + second.face_count
    if count > MAX_FACES:
        raise ValueError(f"partitions must have at most {MAX_FACES} faces together, got {count}")
    is_nearer = second.depth > first.depth
    outputs = {}
    for name, array in first.outputs.items():
        other = second.outputs[name]
        if array.shape != other.shape:
            raise ValueError(
                f"partitions must have as many columns each in the output {name!r}, got "
                f"{array.shape[-1]} and {other.shape[-1]}"
            )
        if name == "face_id":
            other = np.where(other >= 0, other + np.int32(first.face_count), other)
        mask = is_nearer.reshape(*is_nearer.shape, *(1,) * (array.ndim - 2))
        outputs[name] = np.where(mask, other, array)
    return PartialImage(
        count,
        np.where(is_nearer, second.depth, first.depth),
        outputs,
        {name: first.counts[name] + second.counts[name] for name in SUMMED_STATS},
        {
            name: first.seconds.get(name, 0.0) + second.seconds.get(name, 0.0)
            for name in dict.fromkeys((*first.seconds, *second.seconds))
        },
        first.plan,
        first.plane_needs.merge(second.plane_needs),
    )


def merge_pairwise(images: Sequence[Any], merge: Callable[[Any, Any], Any]) -> Any:
    """Merge neighbouring images pairwise until one is left."""
    while len(images) > 1:
        pairs = [merge(*images[n : n + 2]) for n in range(0, len(images) - 1, 2)]
        images = [*pairs, *images[len(pairs) * 2 :]]
    return images[0]


def render_partitions(
    partitions: Any,
    camera: Camera,
    *,
    setting: Scene | None = None,
    material: Material | None = None,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    outputs: Outputs = ("color",),
    background: Background = None,
    cull: Cull = "none",
    threads: int | None = None,
    client: Client | None = None,
) -> Frame:
    """
    Render a mesh whose parts lie on several machines, sort-last.

    Each part becomes colours, depths and face numbers; of two neighbours the nearer one is kept at
    every pixel, of equal depths the lower face number; then of two such results, up to the last.
    The frame has the bits of one machine that draws one mesh of all parts in order. Parts of a
    worker that is lost are loaded and drawn again by another one.

    Parameters
    ----------
    partitions : sequence or Bag
        The parts, in the order of their face numbers. Each is a ``Mesh``, or (vertices, (V, 3)
        float, world space; faces, (F, 3) int, vertex numbers of this part), or a list of such
        pairs, or a callable without arguments, or a ``dask.delayed.Delayed``, that gives one of
        these on a worker. A ``dask.bag.Bag`` holds such pairs. What this process holds is sent;
        what is loaded by the workers never comes here.
    camera : Camera
        A near plane that it leaves open is where no part is cut; parts that workers load are drawn
        again if they are cut at first.
    setting : Scene, optional
        A scene without meshes: its lights, environment, fog, tone map and vignette hold for
        all parts.
        Default: a headlight.
    material : Material, optional
        For parts that are no ``Mesh``. Default: flat shading.
    size, quality, outputs, background, cull
        As `rasterjit.render` takes them. There is one object; ``quality.samples`` must be 1.
    threads : int, optional
        Threads of each task. Default 1.
    client : distributed.Client, optional
        Default: that of a local cluster, which is closed at the end.

    Returns
    -------
    Frame
        ``stats`` are the sums over all parts; ``plan`` is that of the first part.

    Raises
    ------
    ValueError
        Naming the argument that is wrong. Also for what cannot be told from one part alone:
        transparency, several samples, shadows, ambient occlusion, eye-dome lighting, outlines,
        wireframes, normal maps, and smooth shading or the outputs normal and normal_camera without
        normals.
    ImportError
        If Dask is not installed.
    ConnectionError
        If the scheduler is lost.
    """
    clusters.require_dask()
    setting = _check_setting(setting)
    probe = Scene()
    probe.add(Mesh(np.eye(3), [(0, 1, 2)]))
    _, options = check_arguments(probe, size, quality, outputs, background, cull)
    if "nocs" in options.outputs:
        raise ValueError(
            "outputs has 'nocs', which needs the box of the whole mesh; ask for 'object_position'"
        )
    if options.quality.samples != 1:
        raise ValueError(
            f"quality.samples must be 1 where parts are merged, got {options.quality.samples!r}"
        )
    if material is not None and not isinstance(material, Material):
        raise ValueError(f"material must be a Material or None, got {brief(material)}")
    camera = check_camera("camera", camera)
    parts = _list_parts(partitions)
    for name in options.outputs:
        if name in ("uv", "scalar") or is_attribute(name):
            _check_meshes(name, partitions, parts)
    # Check the parts that this process holds before anything is sent.
    planned_parts = [
        plan_part(make_part_mesh(part, material), setting, camera, options)
        for part in filter(_is_local, parts)
    ]
    steps = merge_needs([part[1].plane_needs for part in planned_parts if part]).steps
    threads_each = thread_count("threads", threads) or 1
    with clusters.use_client(client) as dask_client:

        def draw(steps: tuple[int, int]) -> PartialImage:
            image = clusters.retry(
                lambda: _render_once(
                    parts, setting, material, camera, options, threads_each, steps, dask_client
                ),
                "the partitions",
            )
            if image is None:
                raise ValueError("partitions must have at least one face together, got none")
            return image

        image = draw(steps)
        if image.plane_needs.steps != steps:
            # Parts that only workers hold need other automatic planes.
            image = draw(image.plane_needs.steps)
    frame = image.frame()
    view_warnings.warn(view_warnings.warnings_of(frame.plan, frame.stats), set())
    return frame


def _render_once(
    parts: Sequence[Any],
    setting: Scene,
    material: Material | None,
    camera: Camera,
    options: FrameRequest,
    threads: int,
    steps: tuple[int, int],
    client: Client,
) -> PartialImage | None:
    """Send the parts that this process holds, draw all parts and merge their images."""
    import dask

    shared = clusters.send(setting, client)
    local = [n for n, part in enumerate(parts) if _is_local(part)]
    sent_data = dict(zip(local, clusters.scatter([parts[n] for n in local], client), strict=True))
    draw = dask.delayed(draw_part, pure=False)
    merge = dask.delayed(merge_images, pure=False)
    images = [
        draw(sent_data.get(n, part), shared, material, camera, options, threads, steps)
        for n, part in enumerate(parts)
    ]
    with clusters.report_lost_scheduler(client):
        future = client.compute(merge_pairwise(images, merge), optimize_graph=False)
    try:
        return clusters.wait_for_result(future, client)
    finally:
        clusters.cancel([future], client)


def _list_parts(partitions: Any) -> list[Any]:
    """Return the parts: meshes, pairs, callables or delayed ones; or raise ``ValueError``."""
    from dask.bag import Bag
    from dask.delayed import Delayed

    if isinstance(partitions, Bag):
        return partitions.to_delayed(optimize_graph=True)
    if isinstance(partitions, (str, bytes, dict, Mesh, np.ndarray)) or not isinstance(
        partitions, Iterable
    ):
        raise ValueError(
            f"partitions must be a sequence of parts or a dask Bag, got {brief(partitions)}"
        )
    parts = list(partitions)
    if not parts:
        raise ValueError("partitions must hold at least one part, got none")
    for number, part in enumerate(parts):
        if isinstance(part, (Mesh, Delayed)) or callable(part):
            continue
        if not isinstance(part, (list, tuple)):
            raise ValueError(
                f"partitions[{number}] must be a Mesh, (vertices, faces), a list of such pairs, a "
                f"callable or a Delayed; got {brief(part)}"
            )
    return parts


def _is_local(part: Any) -> bool:
    """Tell whether this process holds a part; others are loaded by workers."""
    return isinstance(part, (Mesh, tuple, list))


def _check_meshes(output: str, partitions: Any, parts: Sequence[Any]) -> None:
    """Raise ``ValueError`` if parts are no `Mesh`, which an output needs."""
    from dask.bag import Bag

    if isinstance(partitions, Bag) or any(isinstance(part, (tuple, list)) for part in parts):
        raise ValueError(f"outputs has {output!r}, but partitions of (vertices, faces) have none")


JOINING_EFFECTS = tuple(e for e in EFFECTS if isinstance(e, ScreenEffect) and e.joins_faces)
"""Effects that depend on faces of several parts."""


def _check_setting(setting: Any) -> Scene:
    """Return the setting, or raise ``ValueError`` for effects that depend on several parts."""
    if setting is None:
        return Scene()
    if not isinstance(setting, Scene):
        raise ValueError(f"setting must be a Scene or None, got {brief(setting)}")
    if setting.nodes:
        joined = {effect.field for effect in JOINING_EFFECTS}
        names = [name.replace("_", " ") for name in EFFECT_FIELDS if name not in joined]
        raise ValueError(
            f"setting must be a scene without meshes, got {len(setting.nodes)}: its lights, "
            f"{', '.join(names[:-1])} and {names[-1]} hold for all partitions"
        )
    if setting.labelled:
        raise ValueError(
            f"setting must have no labels, got {len(setting.labelled)}: they are drawn over the "
            "finished picture, which no partition has"
        )
    for effect in JOINING_EFFECTS:
        if getattr(setting, effect.field) is not None:
            raise ValueError(
                f"setting.{effect.field} must be None: it looks at faces of several partitions at "
                "once"
            )
    for number, light in enumerate(setting.lights):
        if not isinstance(light, AmbientLight) and light.shadow is not None:
            raise ValueError(
                f"setting.lights[{number}] must cast no shadow: what casts it may lie in another "
                "partition"
            )
    return setting
