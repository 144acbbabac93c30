"""
Decide, from the scene, the camera and the outputs, what a frame needs; all else is ``None``.

This is the only place that decides, and the border to the kernels: the arrays that they read are
cast and joined here, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import transforms
from rasterjit.kernels.records import Encoding, Lighting, Shadows, Viewport
from rasterjit.kernels.resolve import encoding_table
from rasterjit.kernels.setup import GUARD_PIXELS
from rasterjit.plan_atmosphere import check_atmosphere, fog_record, is_fog_in_reach, tone_record
from rasterjit.plan_boxes import Boxes, mesh_boxes
from rasterjit.plan_contents import Facts, may_have_holes, textures_read
from rasterjit.plan_depth import DepthFormat, depth_format
from rasterjit.plan_effects import Effect, Grounds, list_effects
from rasterjit.plan_layers import Layers, find_transparency, layers_of
from rasterjit.plan_lights import NO_LIGHTS, PlannedLights, lighting_of, plan_lights
from rasterjit.plan_quality import lights_under, meshes_under
from rasterjit.plan_views import Views, are_even, view_nodes
from rasterjit.scene.ambient_occlusion import RADIUS_OF_SCENE, AmbientOcclusion
from rasterjit.scene.camera import Camera
from rasterjit.scene.color import linear_color
from rasterjit.scene.environment import Environment
from rasterjit.scene.light import (
    AmbientLight,
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
)
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import Quality, differences
from rasterjit.scene.scene import Node, Scene, Wireframe, meshes_of
from rasterjit.validation import one_of, whole_size

OUTPUTS = (
    "color", "depth", "face_id", "object_id", "barycentric", "uv", "normal", "position", "linear",
    "distance", "object_position", "nocs", "geometric_normal", "material_id", "instance_id",
    "coverage", "motion", "motion_visible",
)  # fmt: skip
"""What a frame can hold."""

MOTION_OUTPUTS = ("motion", "motion_visible")
"""Those that compare what is seen with an earlier view."""

CULL_MODES = ("none", "back", "front")

GEOMETRY = ("depth_format", "precision", "interpolation")
"""Settings of the way from vertices to weights that a plan names where they are not standard."""

HEADLIGHT_DIRECTION = (-0.3, -0.5, -1.0)
"""Direction of the default light in view space: over the viewer's right shoulder."""
HEADLIGHT_INTENSITY = 0.9
HEADLIGHT_AMBIENT = 0.1
"""The default light's two parts add up to 1, so a white surface facing it is white."""


class Region(NamedTuple):
    """A part of a picture, pixels."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True)
class RenderPlan:
    """
    What one frame consists of; prints as a table.

    Attributes
    ----------
    size : (int, int)
        Width and height, pixels.
    outputs : tuple of str
    grounds : Grounds
        What the decisions rest on.
    """

    size: tuple[int, int]
    camera: Camera
    quality: Quality
    outputs: tuple[str, ...]
    background: NDArray[np.float32]
    cull: str
    wireframe: Wireframe | None
    ambient_occlusion: AmbientOcclusion | None
    outline: Outline | None
    draws_faces: bool
    lighting: Lighting | None
    lights: PlannedLights
    needs_normals: bool
    needs_gouraud: bool
    diagnose: bool
    needs_textures: bool
    needs_matt_light: bool
    needs_microfacets: bool
    needs_maps: bool
    grounds: Grounds
    encoding: Encoding
    layers: Layers | None
    """What a pixel shows besides its nearest face; ``None`` -> nothing."""
    pictures: int
    """How many pictures, each moved by a part of a pixel, the colours are the mean of; 1 -> the
    frame is the picture."""
    environment: Environment | None
    """What lights the scene from all around."""
    backdrop: Environment | None
    """What is seen where no face is."""
    depth_format: DepthFormat
    """What depths are rounded to before they are compared."""
    previous: RenderPlan | None = None
    """What the scene was seen like before; ``None`` -> nobody asks."""
    surfaces: int | None = None
    """How many surfaces of each pixel are found, the nearest ones; ``None`` -> one, as always."""
    region: Region | None = None
    """The part of the picture that is drawn; ``None`` -> all of it."""
    shadow_maps: tuple[Shadows | None, ...] | None = None
    """Those that are drawn already, for each step of pictures; ``None`` -> none are."""

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row, in the whole picture, of the first pixel that is drawn."""
        return (0, 0) if self.region is None else self.region[:2]

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """What is in and what is out, with the reason; made when first asked for."""
        return list_effects(self.grounds)

    @property
    def needs_depth(self) -> bool:
        """Whether the depth of the whole frame is kept."""
        return "depth" in self.outputs or self.reads_depth or self.diagnose

    @property
    def reads_depth(self) -> bool:
        """Whether a pass that follows visibility looks at the depth."""
        hides_edges = self.wireframe is not None and self.draws_faces
        looks_around = self.ambient_occlusion is not None or self.outline is not None
        return hides_edges or looks_around or self.casts_shadows

    @property
    def keeps_lists(self) -> bool:
        """Whether a pass that follows visibility draws the tiles once more."""
        draws_again = self.layers is not None or "coverage" in self.outputs
        return self.diagnose or draws_again or self.surfaces is not None

    @property
    def compares_views(self) -> bool:
        """Whether what is seen is compared with an earlier view."""
        return not set(MOTION_OUTPUTS).isdisjoint(self.outputs)

    @property
    def is_affine(self) -> bool:
        """Whether values are interpolated on the screen, not on the face."""
        return self.quality.interpolation == "affine"

    @property
    def casts_shadows(self) -> bool:
        """Whether any light may cast shadows on what is seen."""
        return self.grounds.casts_shadows

    @property
    def needs_faces(self) -> bool:
        """Whether the face at every pixel is found: shown, in front of edges, or in a buffer."""
        return self.grounds.finds_faces

    @property
    def needs_cutouts(self) -> bool:
        """Whether faces are drawn with their holes."""
        return self.grounds.needs_cutouts

    @property
    def has_textured_holes(self) -> bool:
        """Whether a texture decides where those holes are."""
        return self.grounds.seen.textured_holes > 0

    @property
    def in_view(self) -> NDArray[np.bool_]:
        """Which objects may be seen, (O,)."""
        return self.grounds.in_view

    @property
    def needs_color(self) -> bool:
        """Whether any output shows colour."""
        return self.grounds.is_colored

    def __str__(self) -> str:
        width, height = self.size
        rows = [
            ("size", f"{width} x {height} pixels"),
            ("outputs", ", ".join(self.outputs)),
            ("sub-pixel bits", str(self.quality.subpixel_bits)),
            ("culling", self.cull),
        ]
        if self.pictures > 1:
            rows.append(("pictures", f"{self.pictures} of {self.quality.samples}"))
        if self.surfaces is not None:
            rows.append(("surfaces", f"the nearest {self.surfaces} of each pixel"))
        if self.previous is not None:
            rows.append(("previous view", self._describe_previous(self.previous)))
        changed = differences(self.quality, Quality.standard())
        rows += [(name.replace("_", " "), changed[name]) for name in GEOMETRY if name in changed]
        rows += [
            (effect.name, f"{'in ' if effect.used else 'out'} ({effect.reason})")
            for effect in self.effects
        ]
        widest = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{widest}}  {text}" for name, text in rows)

    def _describe_previous(self, previous: RenderPlan) -> str:
        """Say what motion is found against."""
        camera = "the same camera" if previous.camera is self.camera else "another camera"
        looks = "motion_visible" in self.outputs
        return f"{camera}; " + ("its faces are found" if looks else "its faces are not looked at")


class Stock(NamedTuple):
    """What is known of a scene's objects before a camera looks at them."""

    facts: Facts
    """What they are."""
    bounds: NDArray[np.float64]
    """Low and high corner of each, (O, 2, 3), model space; NaN for one without a finite face."""


def stock_of(nodes: Sequence[Node], quality: Quality) -> Stock:
    """Look through the objects of a scene, with the materials that are in force."""
    meshes = meshes_under(meshes_of(nodes), quality)
    return Stock(Facts(meshes), mesh_boxes(meshes))


def plan_render(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    quality: Quality,
    outputs: Sequence[str],
    background: Any,
    cull: str,
    diagnose: bool = False,
    stock: Stock | None = None,
    views: Views | None = None,
) -> RenderPlan:
    """
    Check the arguments of a frame and decide what it needs.

    ``stock`` and ``views`` are those of the scene's nodes, where they are known already.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    size = whole_size("size", size, quality.subpixel_bits)
    outputs = check_outputs(outputs)
    one_of("cull", cull, CULL_MODES)
    if not isinstance(diagnose, bool):
        raise ValueError(f"diagnose must be True or False, got {diagnose!r}")
    if stock is None:
        check_scene(scene)
        stock = stock_of(scene.nodes, quality)
    if views is None:
        views = view_nodes(scene.nodes, camera, size)
    boxes = Boxes(
        stock.bounds, camera.eye_position(), views.relative_from_model, views.clip_from_relative
    )
    grounds = _grounds(scene, boxes, views, stock.facts, quality, outputs, background, diagnose)
    contents, seen = grounds.contents, grounds.seen
    if "uv" in outputs and contents.laid == 0:
        raise ValueError("outputs has 'uv', but no mesh of the scene has texture coordinates")
    if grounds.colors_faces and contents.unlaid:
        _refuse_texture(scene.nodes, quality)
    if contents.unlaid_holes and grounds.finds_faces:
        _refuse_texture([node for node in scene.nodes if may_have_holes(node.mesh)], quality)
    is_lit = grounds.is_lit
    lights = grounds.lights
    return RenderPlan(
        size=size,
        camera=camera,
        quality=quality,
        outputs=outputs,
        background=linear_color("background", "white" if background is None else background),
        cull=cull,
        wireframe=scene.wireframe if grounds.draws_edges else None,
        ambient_occlusion=_sized_occlusion(scene) if grounds.occludes else None,
        outline=scene.outline if grounds.draws_outlines else None,
        draws_faces=grounds.draws_faces,
        lighting=_lighting(scene, camera, seen.highlights, grounds),
        lights=lights,
        needs_normals=grounds.needs_normals,
        needs_gouraud=is_lit and seen.gouraud > 0,
        diagnose=diagnose,
        needs_textures=grounds.needs_textures,
        # The highlights of vertices lie on top of a texture: they are added up apart.
        needs_matt_light=is_lit and seen.textured_highlights > 0,
        needs_microfacets=grounds.needs_microfacets,
        needs_maps=grounds.needs_maps,
        grounds=grounds,
        encoding=Encoding(
            encoding_table(),
            None if not grounds.maps_tones else tone_record(scene.tone_map, quality.math),
        ),
        environment=scene.environment if grounds.has_environment_light else None,
        backdrop=scene.environment if grounds.shows_environment else None,
        layers=layers_of(
            grounds.transparency, grounds.mixes_samples, quality.samples, scene.nodes, quality
        ),
        pictures=grounds.pictures,
        depth_format=depth_format(quality.depth_format, camera, size),
    )


def _grounds(
    scene: Scene,
    boxes: Boxes,
    views: Views,
    facts: Facts,
    quality: Quality,
    outputs: tuple[str, ...],
    background: Any,
    diagnose: bool,
) -> Grounds:
    """Find what the decisions rest on."""
    only_edges = scene.wireframe is not None and scene.wireframe.mode == "only"
    colors_faces = not only_edges and not {"color", "linear"}.isdisjoint(outputs)
    grounds = Grounds(
        outputs=outputs,
        facts=facts,
        in_view=boxes.in_view,
        contents=facts.contents,
        seen=facts.contents_of(boxes.in_view),
        has_lights=bool(scene.lights),
        wireframe=scene.wireframe,
        diagnose=diagnose,
        environment=scene.environment,
        fog=scene.fog,
        tone_map=scene.tone_map,
        ambient_occlusion=scene.ambient_occlusion,
        outline=scene.outline,
        quality=quality,
        transparency=find_transparency(
            scene.nodes, colors_faces, facts.contents.blended > 0, facts.is_see_through,
            boxes.in_view,
        ),
        has_background=background is not None,
        fog_reaches=False,
        lights=NO_LIGHTS,
        is_uneven=not quality.renormalize and _any_uneven(views, boxes, facts),
    )  # fmt: skip
    # Look at fog and at lights only where a face shows them.
    if grounds.shades:
        grounds = grounds._replace(fog_reaches=is_fog_in_reach(scene.fog, boxes))
    if grounds.is_lit:
        lights = plan_lights(lights_under(scene.lights, quality), boxes, ~facts.is_see_through)
        grounds = grounds._replace(lights=lights)
    return grounds


def _any_uneven(views: Views, boxes: Boxes, facts: Facts) -> bool:
    """Tell whether an object in view with interpolated normals is scaled unlike along its axes."""
    chosen = boxes.in_view & facts.interpolates_normals
    return not are_even(views.relative_from_model[chosen]).all()


def _sized_occlusion(scene: Scene) -> AmbientOcclusion:
    """Return the scene's ambient occlusion, with a radius in scene units."""
    effect = scene.ambient_occlusion
    if effect.radius is not None:
        return effect
    _, radius = scene.bounding_sphere()
    # A scene of one point has no size; nothing occludes there.
    return replace(effect, radius=RADIUS_OF_SCENE * radius if radius > 0.0 else 1.0)


def _refuse_texture(nodes: Sequence[Node], quality: Quality) -> None:
    """Raise ``ValueError`` naming the object that has a texture and nothing to lay it by."""
    for node, mesh in zip(nodes, meshes_under(meshes_of(nodes), quality), strict=True):
        for name in textures_read(mesh.material) if mesh.uv is None else ():
            raise ValueError(
                f"the mesh of {node.name!r} must have uv, for its material has a {name}; got none"
            )


def check_scene(scene: Scene) -> None:
    """Raise ``ValueError`` if something in the scene's lists is not what belongs there."""
    for name, items, kinds in (
        ("nodes", scene.nodes, (Node,)),
        ("lights", scene.lights, (AmbientLight, DirectionalLight, PointLight, SpotLight)),
    ):
        if not isinstance(items, (list, tuple)):
            raise ValueError(f"scene.{name} must be a list, got {items!r}")
        if set(map(type, items)).issubset(kinds):
            continue
        for n, item in enumerate(items):
            if not isinstance(item, kinds):
                wanted = " or ".join(kind.__name__ for kind in kinds)
                article = "an" if wanted[0] in "AEIOU" else "a"
                raise ValueError(f"scene.{name}[{n}] must be {article} {wanted}, got {item!r}")
    if not scene.nodes:
        raise ValueError("scene must hold at least one mesh, got an empty scene")
    if scene.wireframe is not None and not isinstance(scene.wireframe, Wireframe):
        raise ValueError(f"scene.wireframe must be a Wireframe or None, got {scene.wireframe!r}")
    for name, kind in (("ambient_occlusion", AmbientOcclusion), ("outline", Outline)):
        value = getattr(scene, name)
        if value is not None and not isinstance(value, kind):
            raise ValueError(f"scene.{name} must be an {kind.__name__} or None, got {value!r}")
    check_atmosphere(scene)


def check_outputs(outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the outputs without repeats, or raise ``ValueError`` naming one that is unknown."""
    if isinstance(outputs, str):
        outputs = (outputs,)
    if not isinstance(outputs, (list, tuple, set, frozenset)):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    if not outputs:
        raise ValueError(f"outputs must name at least one of {', '.join(OUTPUTS)}; got none")
    for output in outputs:
        if output not in OUTPUTS:
            raise ValueError(
                f"outputs has {output!r}, which is unknown; possible are {', '.join(OUTPUTS)}"
            )
    return tuple(dict.fromkeys(outputs))


def viewport_of(
    size: tuple[int, int], subpixel_bits: int, region: Region | None = None
) -> Viewport:
    """Return the viewport record of an image (width, height), or of a part, with its guard band."""
    width, height = size
    left, top, columns, rows = region or (0, 0, width, height)
    return Viewport(
        columns,
        rows,
        1.0 + 2.0 * GUARD_PIXELS / width,
        1.0 + 2.0 * GUARD_PIXELS / height,
        subpixel_bits,
        max(subpixel_bits, 1),
        left=left,
        top=top,
        right=width - left - columns,
        bottom=height - top - rows,
    )


def _lighting(scene: Scene, camera: Camera, highlights: int, grounds: Grounds) -> Lighting | None:
    """
    Return the lights as rows, relative to the eye, and the fog; ``None`` if there is neither.

    No lights in the scene, and no environment, mean a headlight.
    """
    fog, powers = None, grounds.quality.math
    if grounds.has_fog:
        fog = fog_record(scene.fog, camera, grounds.seen.flat > 0, powers)
    if not grounds.is_lit:
        return None if fog is None else lighting_of([], camera, 0)._replace(fog=fog)
    lights: Sequence[Light] = grounds.lights.lights
    if grounds.has_headlight:
        lights = _headlight(camera)
    return lighting_of(lights, camera, highlights)._replace(
        fog=fog,
        renormalizes=int(grounds.renormalizes),
        library=np.int64(1) if highlights and powers == "library" else None,
    )


def _headlight(camera: Camera) -> list[Light]:
    """Return the lights of a scene that has none."""
    # The rows of the inverse transpose are the columns of the inverse.
    columns = transforms.normal_matrix(camera.view_matrix()).tolist()
    x, y, z = HEADLIGHT_DIRECTION
    direction = tuple((a * x + b * y) + c * z for a, b, c in zip(*columns, strict=True))
    return [DirectionalLight(direction, intensity=HEADLIGHT_INTENSITY), _headlight_ambient()]


@cache
def _headlight_ambient() -> AmbientLight:
    """Return the part of the default light that has no direction."""
    return AmbientLight(intensity=HEADLIGHT_AMBIENT)
