"""Which effects a frame needs, and why: decided from a few facts, put into words when printed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.plan_answers import Effect, answer_effects
from rasterjit.plan_contents import SMOOTH, Contents, Facts, in_words
from rasterjit.plan_layers import (
    Transparency,
    antialiasing_reason,
    mixing_note,
    transparency_reason,
)
from rasterjit.plan_lights import PlannedLights, describe_shadows
from rasterjit.scene.ambient_occlusion import AmbientOcclusion
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.outline import Outline
from rasterjit.scene.quality import SUPERSAMPLED, Quality
from rasterjit.scene.scene import Wireframe
from rasterjit.scene.tone_map import ToneMap

STANDARD = Quality.standard()
"""What nothing is said about."""


class Grounds(NamedTuple):
    """
    The facts about a scene and the outputs, as they were when the frame was planned.

    What a scene asks for is kept as it was asked, used or not; ``None`` where it was not.
    """

    outputs: tuple[str, ...]
    """Names of what the frame is to hold, of ``plan.OUTPUTS``, without repeats."""
    facts: Facts
    in_view: NDArray[np.bool_]
    """Which objects may be seen, (O,)."""
    contents: Contents
    """Of all objects."""
    seen: Contents
    """Of those in view."""
    has_lights: bool
    """Whether the scene has any light, but for its environment."""
    wireframe: Wireframe | None
    diagnose: bool
    """Whether the fates of faces are found."""
    environment: Environment | None
    fog: Fog | None
    tone_map: ToneMap | None
    ambient_occlusion: AmbientOcclusion | None
    outline: Outline | None
    quality: Quality
    transparency: Transparency
    has_background: bool
    """Whether the render was given a background."""
    fog_reaches: bool
    """Whether fog may cover anything."""
    lights: PlannedLights
    """Those of the scene's that reach what is seen."""
    is_uneven: bool
    """Whether an object in view with interpolated normals is scaled unlike along its axes, as far
    as it is of account."""

    @property
    def is_colored(self) -> bool:
        """Whether any output shows colour."""
        return "color" in self.outputs or "linear" in self.outputs

    @property
    def draws_faces(self) -> bool:
        """Whether faces are drawn, and not the edges alone."""
        return self.wireframe is None or self.wireframe.mode == "overlay"

    @property
    def colors_faces(self) -> bool:
        """Whether the colour of faces is asked for."""
        return self.is_colored and self.draws_faces

    @property
    def shades(self) -> bool:
        """Whether the colour of a face is asked for that may be seen."""
        return self.colors_faces and self.seen.objects > 0

    @property
    def is_lit(self) -> bool:
        """Whether that colour depends on light."""
        return self.shades and self.seen.unlit < self.seen.objects

    @property
    def has_headlight(self) -> bool:
        """Whether the default light shines, for there is no other."""
        return self.is_lit and not self.has_lights and self.environment is None

    @property
    def has_ambient_light(self) -> bool:
        """Whether light comes from all around, of a light or the environment."""
        return (
            self.has_headlight
            or self.has_environment_light
            or any(isinstance(light, AmbientLight) for light in self.lights.lights)
        )

    @property
    def needs_normals(self) -> bool:
        """Whether vertex normals are read."""
        is_smooth = not SMOOTH.isdisjoint(self.seen.shadings)
        return is_smooth and (self.is_lit or "normal" in self.outputs)

    @property
    def finds_faces(self) -> bool:
        """Whether the face at every pixel is found: shown, counted, or in a buffer."""
        return self.draws_faces or self.diagnose or bool({*self.outputs} - {"color", "linear"})

    @property
    def needs_cutouts(self) -> bool:
        """Whether faces are drawn with their holes."""
        return self.finds_faces and self.seen.cut_out > 0

    @property
    def casts_shadows(self) -> bool:
        """Whether any light may cast shadows on what is seen."""
        return self.is_lit and self.lights.have_shadows

    @property
    def shades_through_holes(self) -> bool:
        """Whether shadow maps are drawn with holes: what is out of view casts shadows as well."""
        return self.casts_shadows and self.contents.cut_out > 0

    @property
    def needs_textures(self) -> bool:
        """Whether textures are read."""
        return self.shades and any(self.seen.textured)

    @property
    def occludes(self) -> bool:
        """Whether something dims ambient light, and there is some on what is lit by the pixel."""
        effect = self.ambient_occlusion
        return (
            effect is not None
            and effect.strength > 0.0
            and self.is_lit
            and bool(self.seen.shadings - {"unlit", "gouraud"})
            and self.has_ambient_light
        )

    @property
    def draws_outlines(self) -> bool:
        """Whether outlines are drawn: they are 8-bit pixels, around faces."""
        return self.outline is not None and "color" in self.outputs and self.draws_faces

    @property
    def pictures(self) -> int:
        """How many whole pictures are averaged, of faces or of what lies behind them all."""
        has_edges = self.shades or self.shows_environment
        samples = self.quality.samples
        return int(samples) if has_edges and samples in SUPERSAMPLED else 1

    @property
    def mixes_samples(self) -> bool:
        """Whether a pixel of one picture shows several samples, or areas."""
        return self.shades and self.quality.samples not in (1, *SUPERSAMPLED)

    @property
    def antialiases(self) -> bool:
        """Whether the colour of a pixel is that of several samples, or of areas."""
        return self.mixes_samples or self.pictures > 1

    @property
    def needs_microfacets(self) -> bool:
        """Whether light falls on metallic-roughness materials."""
        return self.is_lit and self.seen.pbr > 0

    @property
    def needs_maps(self) -> bool:
        """Whether more lies over the objects than a base colour."""
        return self.shades and self.seen.has_maps

    @property
    def renormalizes(self) -> bool:
        """
        Whether interpolated normals are scaled to length one at every pixel.

        If not, they are of that length at the vertices all the same. Under normal maps, and where
        an object is scaled unevenly, that takes scaling at every pixel.
        """
        return self.quality.renormalize or self.seen.normals > 0 or self.is_uneven

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
        return is_wanted and ("color" in self.outputs or self.mixes_codes)

    @property
    def mixes_codes(self) -> bool:
        """Whether what a pixel shows is mixed as 8-bit sRGB codes, which all colour then is."""
        is_mixed = self.transparency.used or self.antialiases
        return is_mixed and self.quality.blending == "srgb8"

    @property
    def draws_edges(self) -> bool:
        """Whether edges are drawn: they are 8-bit pixels, so linear colour has none."""
        return self.wireframe is not None and "color" in self.outputs


def list_effects(grounds: Grounds) -> tuple[Effect, ...]:
    """Return what is in and what is out, with the reason."""
    samples = grounds.quality.samples
    return (
        Effect("shading", grounds.shades, _shading_reason(grounds)),
        Effect("lights", _has_light(grounds), _light_reason(grounds)),
        Effect("shadows", grounds.casts_shadows, _shadow_reason(grounds)),
        Effect("smooth normals", grounds.needs_normals, _normal_reason(grounds)),
        Effect("textures", grounds.needs_textures, _texture_reason(grounds)),
        Effect(
            "alpha masks",
            grounds.needs_cutouts or grounds.shades_through_holes,
            _mask_reason(grounds),
        ),
        *answer_effects(grounds.seen, grounds.contents, grounds.shades, grounds.is_lit),
        Effect("environment light", grounds.has_environment_light, _sky_light_reason(grounds)),
        Effect("environment background", grounds.shows_environment, _sky_reason(grounds)),
        Effect("fog", grounds.has_fog, _fog_reason(grounds)),
        Effect("tone mapping", grounds.maps_tones, _tone_reason(grounds)),
        Effect("ambient occlusion", grounds.occludes, _occlusion_reason(grounds)),
        Effect("outline", grounds.draws_outlines, _outline_reason(grounds)),
        Effect(
            "transparency",
            grounds.transparency.used,
            transparency_reason(grounds.transparency, grounds.quality),
        ),
        Effect(
            "anti-aliasing",
            grounds.antialiases,
            antialiasing_reason(
                samples, grounds.pictures, grounds.shades, mixing_note(grounds.quality)
            ),
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
    shadings = ", ".join(sorted(grounds.seen.shadings))
    return shadings + _asked(grounds, "shading") if shadings else "no object is in view"


def _has_light(grounds: Grounds) -> bool:
    """Tell whether any light shines on what is seen, but for the environment."""
    return grounds.is_lit and (grounds.has_headlight or bool(grounds.lights.lights))


def _unlit_reason(grounds: Grounds) -> str:
    """Say why no light is needed."""
    if grounds.shades and grounds.contents.unlit < grounds.contents.objects:
        return "every material in view is unlit"
    if grounds.colors_faces and not grounds.shades:
        return "no object is in view"
    return "nothing is shaded, or every material is unlit"


def _light_reason(grounds: Grounds) -> str:
    """Say what lights the scene, or why nothing needs to."""
    if not grounds.is_lit:
        return _unlit_reason(grounds)
    asked = _asked(grounds, "math") if grounds.seen.highlights else ""
    if grounds.has_headlight:
        return f"a headlight, for the scene has no lights{asked}"
    if not grounds.has_lights:
        return "no headlight, for the scene has an environment"
    kinds = _counted([type(light).__name__ for light in grounds.lights.lights])
    return "; ".join(filter(None, (kinds, *grounds.lights.notes))) + asked


def _shadow_reason(grounds: Grounds) -> str:
    """Say which maps are drawn, or why none is."""
    if not grounds.is_lit:
        return "nothing is lit"
    notes = grounds.lights.shadow_notes
    if grounds.lights.have_shadows:
        asked = _asked(grounds, "shadow_size", "shadow_taps")
        return "; ".join((describe_shadows(grounds.lights.lights), *notes)) + asked
    return "; ".join(notes) or "no light casts them"


def _normal_reason(grounds: Grounds) -> str:
    """Say which objects are smooth, if any."""
    smooth = sorted(SMOOTH & grounds.seen.shadings)
    if smooth:
        return "shading " + ", ".join(smooth) + _scaling(grounds)
    hidden = not SMOOTH.isdisjoint(grounds.contents.shadings)
    return "no object in view is smooth" if hidden else "no object is smooth"


def _scaling(grounds: Grounds) -> str:
    """Say, where the quality asks not to scale interpolated normals, what becomes of them."""
    if grounds.quality.renormalize or {"phong", "pbr"}.isdisjoint(grounds.seen.shadings):
        return ""
    if grounds.seen.normals:
        return "; quality.renormalize is False, but not under normal maps"
    if grounds.is_uneven:
        return "; quality.renormalize is False, but not where an object is scaled unevenly"
    return "; quality.renormalize is False"


def _asked(grounds: Grounds, *names: str) -> str:
    """Say what the quality asks for by some of its settings, as far as it is no standard."""
    values = {name: getattr(grounds.quality, name) for name in names}
    return "".join(
        f"; quality.{name} is {value!r}"
        for name, value in values.items()
        if value != getattr(STANDARD, name)
    )


def _texture_reason(grounds: Grounds) -> str:
    """Say what the textures are, or why none is read."""
    if not any(grounds.contents.textured):
        return "no material has a texture that is read"
    if not grounds.colors_faces:
        return "nothing is shaded"
    if not any(grounds.seen.textured):
        return "no object in view has a texture that is read"
    described = _counted(grounds.facts.describe_textures(grounds.in_view))
    return described + _asked(grounds, "texture_filter")


def _mask_reason(grounds: Grounds) -> str:
    """Say what has holes, or why nothing has."""
    contents, seen = grounds.contents, grounds.seen
    if contents.masked == 0:
        return "no material has the alpha_mode 'mask'"
    if contents.cut_out == 0:
        return "no alpha of an object with a mask is below its alpha_cutoff"
    if not grounds.finds_faces:
        return "only the wireframe is drawn"
    if seen.cut_out > 0:
        return f"{seen.cut_out} of {seen.masked} objects with a mask can have holes"
    outside = in_words(0, contents.cut_out)
    return f"{outside}, in shadows alone" if grounds.shades_through_holes else outside


def _occlusion_reason(grounds: Grounds) -> str:
    """Say why ambient light is dimmed in corners or not."""
    effect = grounds.ambient_occlusion
    if effect is None:
        return "scene.ambient_occlusion is None"
    if effect.strength == 0.0:
        return "its strength is 0"
    if not grounds.is_lit:
        return _unlit_reason(grounds)
    if not grounds.seen.shadings - {"unlit", "gouraud"}:
        return "what is lit is lit at its vertices"
    if not grounds.has_ambient_light:
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
        return _unlit_reason(grounds)
    if not grounds.environment.lights:
        return "the environment is black"
    mirrored = ", mirrored by pbr" if grounds.seen.pbr else ""
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
    by_height = ", by height" if grounds.fog.height is not None else ""
    asked = _asked(grounds, "math") if grounds.fog.mode != "linear" else ""
    return f"mode {grounds.fog.mode}{by_height}{asked}"


def _tone_reason(grounds: Grounds) -> str:
    """Say how light is brought onto the screen."""
    if grounds.tone_map is None:
        return "scene.tone_map is None"
    if "color" not in grounds.outputs and not grounds.mixes_codes:
        return "no output shows colour in 8 bits"
    if grounds.tone_map.is_neutral:
        return "curve none, exposure 0"
    exposure = float(grounds.tone_map.exposure)
    asked = "" if exposure.is_integer() else _asked(grounds, "math")
    return f"curve {grounds.tone_map.curve}, exposure {exposure:g}{asked}"


def _wireframe_reason(grounds: Grounds) -> str:
    """Say why edges are drawn or not."""
    if grounds.wireframe is None:
        return "scene.wireframe is None"
    if not grounds.draws_edges:
        return "no output shows colour in 8 bits"
    if grounds.quality.lines == "bresenham":
        return f"mode {grounds.wireframe.mode}"
    return f"mode {grounds.wireframe.mode}, by coverage{mixing_note(grounds.quality)}"


def _counted(kinds: Sequence[str]) -> str:
    """Return how many there are of each kind."""
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items())
