"""Which effects a frame needs, and why: decided from a few facts, put into words when printed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rasterjit.plan_answers import Answers, Effect, answer_effects, answers_of
from rasterjit.plan_layers import Transparency, antialiasing_reason, is_see_through
from rasterjit.plan_lights import PlannedLights, describe_shadows
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.material import TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Wireframe
from rasterjit.scene.texture import Texture
from rasterjit.scene.tone_map import ToneMap

SMOOTH = frozenset(("gouraud", "phong", "pbr"))
"""Ways of shading that read vertex normals."""

BLINN_PHONG = frozenset(("flat", "gouraud", "phong"))
"""Ways of shading that have a Blinn-Phong highlight."""


class Contents(NamedTuple):
    """What the objects of a scene are, as far as it decides what a frame needs."""

    shadings: frozenset[str]
    texture_filters: tuple[str, ...]
    """What each texture is for, and its filter."""
    has_uv: bool
    """Whether any object has texture coordinates."""
    lacks_uv: bool
    """Whether any object has a texture and nothing to lay it by."""
    highlights: int
    """Number of objects with a specular highlight."""
    has_textured_highlight: bool
    """Whether the light of a textured object's vertices holds a highlight."""
    masked: int
    """Number of objects whose material has an alpha mask."""
    cut_out: int
    """Number of those that can have a hole."""
    has_textured_hole: bool
    """Whether any of those has a base colour texture."""
    lacks_mask_uv: bool
    """Whether any of those has nothing to lay it by."""
    has_blended: bool = False
    """Whether any material is blended."""
    see_through: tuple[int, ...] = ()
    """Numbers of the objects that what lies behind them is seen through."""
    answers: Answers = Answers()
    """How materials answer light, beyond colours and highlights."""


class Grounds(NamedTuple):
    """
    The facts about a scene and the outputs, as they were when the frame was planned.

    What a scene asks for is kept as it was asked, used or not; ``None`` where it was not.
    """

    outputs: tuple[str, ...]
    """Names of what the frame is to hold, of ``plan.OUTPUTS``, without repeats."""
    contents: Contents
    light_kinds: tuple[str, ...]
    """Name of the class of each of the scene's lights, in order; empty means a headlight, unless
    there is an environment."""
    wireframe: Wireframe | None
    diagnose: bool
    """Whether the fates of faces are found."""
    environment: Environment | None
    fog: Fog | None
    tone_map: ToneMap | None
    ambient_occlusion: AmbientOcclusion | None
    outline: Outline | None
    quality: Quality
    has_ambient_light: bool
    """Whether a light without direction, the headlight's part too, sends anything."""
    transparency: Transparency
    has_background: bool
    """Whether the render was given a background."""
    fog_reaches: bool
    """Whether fog may cover anything."""
    lights: PlannedLights

    @property
    def is_colored(self) -> bool:
        """Whether any output shows colour."""
        return "color" in self.outputs or "linear" in self.outputs

    @property
    def draws_faces(self) -> bool:
        """Whether faces are drawn, and not the edges alone."""
        return self.wireframe is None or self.wireframe.mode == "overlay"

    @property
    def shades(self) -> bool:
        """Whether the colour of faces is asked for."""
        return self.is_colored and self.draws_faces

    @property
    def is_lit(self) -> bool:
        """Whether light reaches a colour that is asked for."""
        return self.shades and self.contents.shadings != {"unlit"}

    @property
    def needs_normals(self) -> bool:
        """Whether vertex normals are read."""
        is_smooth = not SMOOTH.isdisjoint(self.contents.shadings)
        return is_smooth and (self.is_lit or "normal" in self.outputs)

    @property
    def finds_faces(self) -> bool:
        """Whether the face at every pixel is found: shown, counted, or in a buffer."""
        return self.draws_faces or self.diagnose or bool({*self.outputs} - {"color", "linear"})

    @property
    def needs_cutouts(self) -> bool:
        """Whether faces are drawn with their holes."""
        return self.finds_faces and self.contents.cut_out > 0

    @property
    def needs_textures(self) -> bool:
        """Whether textures are read."""
        return self.shades and bool(self.contents.texture_filters)

    @property
    def occludes(self) -> bool:
        """Whether something dims ambient light, and there is some on what is lit by the pixel."""
        effect = self.ambient_occlusion
        return (
            effect is not None
            and effect.strength > 0.0
            and self.is_lit
            and bool(self.contents.shadings - {"unlit", "gouraud"})
            and (self.has_ambient_light or self.has_environment_light)
        )

    @property
    def draws_outlines(self) -> bool:
        """Whether outlines are drawn: they are 8-bit pixels, around faces."""
        return self.outline is not None and "color" in self.outputs and self.draws_faces

    @property
    def antialiases(self) -> bool:
        """Whether the colour of a pixel is that of several samples, or of areas."""
        return self.shades and self.quality.samples != 1

    @property
    def needs_microfacets(self) -> bool:
        """Whether light falls on metallic-roughness materials."""
        return self.is_lit and self.contents.answers.faceted > 0

    @property
    def needs_maps(self) -> bool:
        """Whether more lies over the objects than a base colour."""
        return self.shades and self.contents.answers.has_maps

    @property
    def has_environment_light(self) -> bool:
        """Whether any light from all around reaches a colour that is asked for."""
        return self.is_lit and self.environment is not None and self.environment.lights

    @property
    def shows_environment(self) -> bool:
        """Whether the environment is seen where no face is."""
        is_wanted = self.environment is not None and self.environment.background
        return is_wanted and self.is_colored and not self.has_background

    @property
    def has_fog(self) -> bool:
        """Whether fog may cover a colour that is asked for."""
        return self.shades and self.fog_reaches

    @property
    def maps_tones(self) -> bool:
        """Whether light is exposed, or a tone curve applied: to 8-bit colour alone."""
        is_wanted = self.tone_map is not None and not self.tone_map.is_neutral
        return is_wanted and "color" in self.outputs

    @property
    def draws_edges(self) -> bool:
        """Whether edges are drawn: they are 8-bit pixels, so linear colour has none."""
        return self.wireframe is not None and "color" in self.outputs


def contents_of(meshes: Sequence[Mesh]) -> Contents:
    """Look through the meshes of all objects; each mesh is looked at once."""
    counts = Counter(meshes)
    textured = [mesh for mesh in counts if mesh.material.base_color_texture is not None]
    read = [(mesh, textures_read(mesh.material)) for mesh in counts]
    textures = dict.fromkeys(pair for _, found in read for pair in found.items())
    see_through = {mesh for mesh in counts if is_see_through(mesh)}
    return Contents(
        frozenset(mesh.material.shading for mesh in counts),
        tuple(_described(name, texture) for name, texture in textures),
        any(mesh.uv is not None for mesh in counts),
        any(mesh.uv is None and bool(found) for mesh, found in read),
        sum(
            count
            for mesh, count in counts.items()
            if mesh.material.shading in BLINN_PHONG and mesh.material.specular > 0.0
        ),
        any(
            mesh.material.shading == "gouraud" and mesh.material.specular > 0.0 for mesh in textured
        ),
        sum(count for mesh, count in counts.items() if mesh.material.alpha_mode == "mask"),
        sum(count for mesh, count in counts.items() if may_have_holes(mesh)),
        any(may_have_holes(mesh) for mesh in textured),
        any(mesh.uv is None and may_have_holes(mesh) for mesh in textured),
        any(mesh.material.alpha_mode == "blend" for mesh in counts),
        tuple(n for n, mesh in enumerate(meshes) if mesh in see_through),
        answers_of(counts),
    )


def textures_read(material: Material) -> dict[str, Texture]:
    """Return the textures of a material that are read, by field."""
    textures = zip(TEXTURE_FIELDS, material.textures_read(), strict=True)
    return {name: texture for name, texture in textures if texture is not None}


def may_have_holes(mesh: Mesh) -> bool:
    """Return whether the alpha of a mesh with an alpha mask is below the cutoff anywhere."""
    material = mesh.material
    if material.alpha_mode != "mask":
        return False
    lowest = np.float32(material.base_color[3])
    for colors in (mesh.vertex_colors, mesh.face_colors):
        if colors is not None and len(colors) > 0:
            lowest = lowest * colors[:, 3].min()
    if material.base_color_texture is not None:
        lowest = lowest * np.float32(material.base_color_texture.lowest_alpha)
    return bool(lowest < np.float32(material.alpha_cutoff))


def _described(name: str, texture: Texture) -> str:
    """Say what a texture is for, and how it is filtered."""
    parts = f", {texture.anisotropy} times along" if texture.anisotropy > 1 else ""
    kind = name.removesuffix("_texture").replace("_", " ")
    return f"{texture.filter}{parts} ({kind})"


def list_effects(grounds: Grounds) -> tuple[Effect, ...]:
    """Return what is in and what is out, with the reason."""
    smooth = sorted(SMOOTH & grounds.contents.shadings)
    samples = grounds.quality.samples
    return (
        Effect("shading", grounds.shades, _shading_reason(grounds)),
        Effect("lights", grounds.is_lit, _light_reason(grounds)),
        Effect("shadows", grounds.is_lit and grounds.lights.have_shadows, _shadow_reason(grounds)),
        Effect(
            "smooth normals",
            grounds.needs_normals,
            "shading " + ", ".join(smooth) if smooth else "no object is smooth",
        ),
        Effect("textures", grounds.needs_textures, _texture_reason(grounds)),
        Effect("alpha masks", grounds.needs_cutouts, _mask_reason(grounds)),
        *answer_effects(grounds.contents.answers, grounds.shades, grounds.is_lit),
        Effect("environment light", grounds.has_environment_light, _sky_light_reason(grounds)),
        Effect("environment background", grounds.shows_environment, _sky_reason(grounds)),
        Effect("fog", grounds.has_fog, _fog_reason(grounds)),
        Effect("tone mapping", grounds.maps_tones, _tone_reason(grounds)),
        Effect("ambient occlusion", grounds.occludes, _occlusion_reason(grounds)),
        Effect("outline", grounds.draws_outlines, _outline_reason(grounds)),
        Effect("transparency", grounds.transparency.used, grounds.transparency.reason),
        Effect(
            "anti-aliasing",
            grounds.antialiases,
            antialiasing_reason(samples, grounds.shades),
        ),
        Effect("wireframe", grounds.draws_edges, _wireframe_reason(grounds)),
        Effect("diagnostics", grounds.diagnose, f"diagnose={grounds.diagnose}"),
    )


def _shading_reason(grounds: Grounds) -> str:
    """Say why faces are shaded or not."""
    if not grounds.is_colored:
        return "no output shows colour"
    if not grounds.draws_faces:
        return "only the wireframe is drawn"
    return ", ".join(sorted(grounds.contents.shadings))


def _light_reason(grounds: Grounds) -> str:
    """Say what lights the scene, or why nothing needs to."""
    if not grounds.is_lit:
        return "nothing is shaded, or every material is unlit"
    if not grounds.light_kinds and grounds.environment is not None:
        return "no headlight, for the scene has an environment"
    kinds = _counted(grounds.light_kinds) or "a headlight, for the scene has no lights"
    return "; ".join((kinds, *grounds.lights.notes))


def _shadow_reason(grounds: Grounds) -> str:
    """Say which maps are drawn, or why none is."""
    if not grounds.is_lit:
        return "nothing is lit"
    notes = grounds.lights.shadow_notes
    if grounds.lights.have_shadows:
        return "; ".join((describe_shadows(grounds.lights.lights), *notes))
    return "; ".join(notes) or "no light casts them"


def _texture_reason(grounds: Grounds) -> str:
    """Say what the textures are, or why none is read."""
    if not grounds.contents.texture_filters:
        return "no material has a texture that is read"
    return _counted(grounds.contents.texture_filters) if grounds.shades else "nothing is shaded"


def _mask_reason(grounds: Grounds) -> str:
    """Say what has holes, or why nothing has."""
    contents = grounds.contents
    if contents.masked == 0:
        return "no material has the alpha_mode 'mask'"
    if contents.cut_out == 0:
        return "no alpha of an object with a mask is below its alpha_cutoff"
    if not grounds.finds_faces:
        return "only the wireframe is drawn"
    return f"{contents.cut_out} of {contents.masked} objects with a mask can have holes"


def _occlusion_reason(grounds: Grounds) -> str:
    """Say why ambient light is dimmed in corners or not."""
    effect = grounds.ambient_occlusion
    if effect is None:
        return "scene.ambient_occlusion is None"
    if effect.strength == 0.0:
        return "its strength is 0"
    if not grounds.is_lit:
        return "nothing is shaded, or every material is unlit"
    if not grounds.contents.shadings - {"unlit", "gouraud"}:
        return "what is lit is lit at its vertices"
    if not (grounds.has_ambient_light or grounds.has_environment_light):
        return "no light comes from all around"
    radius = "a share of the scene's size" if effect.radius is None else f"{effect.radius:g}"
    return f"radius {radius}, strength {effect.strength:g}"


def _outline_reason(grounds: Grounds) -> str:
    """Say why the edges of shapes are drawn or not."""
    outline = grounds.outline
    if outline is None:
        return "scene.outline is None"
    if "color" not in grounds.outputs:
        return "no output shows colour in 8 bits"
    if not grounds.draws_faces:
        return "only the wireframe is drawn"
    return f"{', '.join(outline.edges)}, {outline.width} wide"


def _sky_light_reason(grounds: Grounds) -> str:
    """Say what light comes from all around, or why none does."""
    if grounds.environment is None:
        return "scene.environment is None"
    if not grounds.is_lit:
        return "nothing is shaded, or every material is unlit"
    if not grounds.environment.lights:
        return "the environment is black"
    mirrored = ", mirrored by pbr" if "pbr" in grounds.contents.shadings else ""
    return f"{grounds.environment.described}{mirrored}"


def _sky_reason(grounds: Grounds) -> str:
    """Say what is seen where no face is, as far as environments go."""
    if grounds.environment is None:
        return "scene.environment is None"
    if not grounds.is_colored:
        return "no output shows colour"
    if grounds.has_background:
        return "the render was given a background"
    if not grounds.environment.background:
        return "its background is False"
    return "where no face is"


def _fog_reason(grounds: Grounds) -> str:
    """Say what fog there is, or why it covers nothing."""
    if grounds.fog is None:
        return "scene.fog is None"
    if not grounds.shades:
        return "no face is shaded"
    if not grounds.fog_reaches:
        empty = grounds.fog.density == 0.0
        return "its density is 0" if empty else "it begins beyond everything"
    return f"mode {grounds.fog.mode}" + (", by height" if grounds.fog.height is not None else "")


def _tone_reason(grounds: Grounds) -> str:
    """Say how light is brought onto the screen."""
    if grounds.tone_map is None:
        return "scene.tone_map is None"
    if "color" not in grounds.outputs:
        return "no output shows colour in 8 bits"
    if grounds.tone_map.is_neutral:
        return "curve none, exposure 0"
    return f"curve {grounds.tone_map.curve}, exposure {grounds.tone_map.exposure:g}"


def _wireframe_reason(grounds: Grounds) -> str:
    """Say why edges are drawn or not."""
    if grounds.wireframe is None:
        return "scene.wireframe is None"
    if not grounds.draws_edges:
        return "no output shows colour in 8 bits"
    return f"mode {grounds.wireframe.mode}"


def _counted(kinds: Sequence[str]) -> str:
    """Return how many there are of each kind."""
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items())
