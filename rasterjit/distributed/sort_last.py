"""
Sort-last rendering: draw the parts of a mesh where they are, and keep the nearest faces.

S. Molnar, M. Cox, D. Ellsworth and H. Fuchs, "A Sorting Classification of Parallel Rendering", IEEE
Computer Graphics and Applications 14(4), 1994, name it so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rasterjit.distributed import layers
from rasterjit.distributed.clusters import (
    cancel,
    connected,
    reaching,
    require_dask,
    result_of,
    retried,
    scatter,
    send,
)
from rasterjit.outputs.frame import Frame
from rasterjit.outputs.table import Outputs, is_attribute
from rasterjit.rendering import view_warnings
from rasterjit.rendering.batch import check_arguments
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.planning import Cull, FrameRequest
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera, check_camera
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.validation import in_short, thread_count
from rasterjit.survey.clip_planes import join
from rasterjit.survey.effect import LooksAround

if TYPE_CHECKING:
    from distributed import Client


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
    Render a mesh that no machine holds as a whole, each part of it where it is.

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
    require_dask()
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
        raise ValueError(f"material must be a Material or None, got {in_short(material)}")
    camera = check_camera("camera", camera)
    parts = _parts_of(partitions)
    for name in options.outputs:
        if name in ("uv", "scalar") or is_attribute(name):
            _check_meshes(name, partitions, parts)
    # What is here is looked at here, before anything is sent.
    planned = [
        layers.plan_part(layers.mesh_of(part, material), setting, camera, options)
        for part in filter(_is_here, parts)
    ]
    steps = join([found[1].look for found in planned if found is not None]).steps
    own = thread_count("threads", threads) or 1
    with connected(client) as chosen:

        def draw(steps: tuple[int, int]) -> layers.PartialImage:
            found = retried(
                lambda: _render_once(parts, setting, material, camera, options, own, steps, chosen),
                "the partitions",
            )
            if found is None:
                raise ValueError("partitions must have at least one face together, got none")
            return found

        layer = draw(steps)
        if layer.look.steps != steps:
            # Parts that are not here show what planes that are left open would cut.
            layer = draw(layer.look.steps)
    frame = layer.frame()
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
) -> layers.PartialImage | None:
    """Send what is here, draw and merge."""
    import dask

    shared = send(setting, client)
    held = [n for n, part in enumerate(parts) if _is_here(part)]
    sent = dict(zip(held, scatter([parts[n] for n in held], client), strict=True))
    draw = dask.delayed(layers.draw_layer, pure=False)
    merge = dask.delayed(layers.merge_layers, pure=False)
    drawn = [
        draw(sent.get(n, part), shared, material, camera, options, threads, steps)
        for n, part in enumerate(parts)
    ]
    with reaching(client):
        future = client.compute(layers.merge_tree(drawn, merge), optimize_graph=False)
    try:
        return result_of(future, client)
    finally:
        cancel([future], client)


def _parts_of(partitions: Any) -> list[Any]:
    """Return the parts: meshes, pairs, callables or delayed ones; or raise ``ValueError``."""
    from dask.bag import Bag
    from dask.delayed import Delayed

    if isinstance(partitions, Bag):
        return partitions.to_delayed(optimize_graph=True)
    if isinstance(partitions, (str, bytes, dict, Mesh, np.ndarray)) or not isinstance(
        partitions, Iterable
    ):
        raise ValueError(
            f"partitions must be a sequence of parts or a dask Bag, got {in_short(partitions)}"
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
                f"callable or a Delayed; got {in_short(part)}"
            )
    return parts


def _is_here(part: Any) -> bool:
    """Tell whether this process holds a part; others are loaded by workers."""
    return isinstance(part, (Mesh, tuple, list))


def _check_meshes(output: str, partitions: Any, parts: Sequence[Any]) -> None:
    """Raise ``ValueError`` if an output is asked of parts that only a `Mesh` can have."""
    from dask.bag import Bag

    if isinstance(partitions, Bag) or any(isinstance(part, (tuple, list)) for part in parts):
        raise ValueError(f"outputs has {output!r}, but partitions of (vertices, faces) have none")


JOINING = tuple(one for one in EFFECTS if isinstance(one, LooksAround) and one.joins_faces)
"""Effects that no part of a scene has alone."""


def _check_setting(setting: Any) -> Scene:
    """Return the light of the whole, or raise ``ValueError`` for what parts cannot show alone."""
    if setting is None:
        return Scene()
    if not isinstance(setting, Scene):
        raise ValueError(f"setting must be a Scene or None, got {in_short(setting)}")
    if setting.nodes:
        joined = {effect.field for effect in JOINING}
        held = [name.replace("_", " ") for name in EFFECT_FIELDS if name not in joined]
        raise ValueError(
            f"setting must be a scene without meshes, got {len(setting.nodes)}: its lights, "
            f"{', '.join(held[:-1])} and {held[-1]} hold for all partitions"
        )
    if setting.labelled:
        raise ValueError(
            f"setting must have no labels, got {len(setting.labelled)}: they are drawn over the "
            "finished picture, which no partition has"
        )
    for effect in JOINING:
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
