"""Split the colour of one pixel into its terms, and into the faces that it is blended from."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.inspect.pixel_report import ColorPart, LightTerm, LightTerms
from rasterjit.pipeline import records
from rasterjit.pipeline.fragments import fragment_bands
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import ShadingNeeds
from rasterjit.pipeline.records import Lighting, Surface
from rasterjit.pipeline.surface import scalar_colors
from rasterjit.pipeline.surface.material_maps import EMISSIVE
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.primitive_expansion import Primitives
from rasterjit.rendering import frame_shading as shading
from rasterjit.rendering.effect_registry import prepare_effects
from rasterjit.rendering.frame_shading import with_opaque_pass
from rasterjit.rendering.pass_runner import Shading, light_vertices
from rasterjit.rendering.renderer import find_visible
from rasterjit.runtime.threads import Workers
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.effect import ActiveEffect, FrameContext
from rasterjit.survey.packed_scene import SceneArrays
from rasterjit.survey.plan import RenderPlan

LIGHT_COLOR = slice(4, 7)
"""Columns of ``Lighting.lights``."""

POST_LIGHT_PLACES = {"seen", "sample"}
"""Places of effects that act after the sum of all light."""

BLENDING_NOTE = ", and what mixing 8-bit codes differs by"
"""Name of the part that blending 8-bit codes adds, which do not add up as light does."""

FaceShares = dict[int, float]
"""Share of a pixel that each face makes up, from 0 to 1; the visible one comes first."""


class LightRig(NamedTuple):
    """Lights and effects that a surface is shaded with."""

    lighting: Lighting | None
    effects: tuple[ActiveEffect, ...]

    def without_effects(self, *places: str) -> LightRig:
        """Return a copy in which effects at some places change nothing."""
        return self._replace(
            effects=tuple(
                active if set(places).isdisjoint(active.effect.places) else _neutralize(active)
                for active in self.effects
            )
        )

    def with_lighting(self, **fields: Any) -> LightRig:
        """Return a copy with other fields of the lighting."""
        return self._replace(lighting=self.lighting._replace(**fields))


def _neutralize(active: ActiveEffect) -> ActiveEffect:
    """Return an effect with data that changes nothing, so that its stages stay compiled."""
    return active._replace(record=active.effect.neutral(active.record))


class VisibleScene(NamedTuple):
    """A scene, drawn up to visibility."""

    scene: Scene
    cache: SceneCache
    plan: RenderPlan
    arrays: SceneArrays
    seen: visibility_pass.RasterizedView
    lists: visibility_pass.TileLists
    """Lists of the tiles' triangles, those of culled faces included."""
    primitives: Primitives | None
    """Lines and points."""


def find_object(drawn: VisibleScene, face: int) -> int:
    """Return the number of the object that has a face."""
    return int(np.searchsorted(drawn.arrays.face_starts, face, side="right")) - 1


def find_surface(drawn: VisibleScene) -> tuple[Surface, LightRig]:
    """Return surface and light of the objects; vertices are not lit yet."""
    plan, cache, workers = drawn.plan, drawn.cache, Workers(1)
    context = FrameContext(plan, cache, drawn.seen.placement, workers, drawn.seen)
    find = partial(find_visible, cache=cache, workers=workers, clock=lambda _: None)
    light = LightRig(plan.lighting, prepare_effects(with_opaque_pass(context, find)))
    surface = shading.find_surface(plan, cache.tables)
    points = drawn.seen.coverage.points
    if plan.facts.shades_points and points is not None:
        surface = surface._replace(points=points.read)
    return surface, light


def find_light_terms(
    drawn: VisibleScene, surface: Surface, light: LightRig, x: int, y: int
) -> tuple[LightTerms, NDArray[np.float32]]:
    """Return the terms of the visible face's colour, and the colour, (4,) float32, linear."""

    def shade(surface: Surface, light: LightRig) -> NDArray[np.float32]:
        return shade_pixel(drawn, surface, light, x, y)[:3]

    face = int(drawn.seen.coverage.face_id[y, x])
    material = drawn.cache.tables.meshes[find_object(drawn, face)].material
    # Leave out effects on the sum of all light, such as fog.
    clear = light.without_effects(*POST_LIGHT_PLACES)
    unemissive, black = _remove_emission(surface), np.zeros(3, np.float32)
    # Texture and post-light effects.
    texture, uv = None, np.full(2, np.nan, np.float32)
    if surface.textures is not None and material.base_color_texture is not None:
        texture = shade(_make_white_unlit(unemissive), clear)
        uv = _interpolate(drawn, surface.textures.uv, x, y)
    post_light = tuple(_find_effect_terms(drawn, surface, light, clear, x, y))
    # Emission, base colour, ambient light and lights.
    base_surface, base_light, ambient = unemissive, clear, black
    terms: tuple[LightTerm, ...] = ()
    emission_surface, emission_light = _make_scaled_unlit(surface, 0.0), clear
    if light.lighting is not None and material.shading != "unlit":
        dark = clear.with_lighting(lights=light.lighting.lights[:0], ambient=black)
        # A clearcoat dims emission, too.
        emission_surface, emission_light = surface, dark.without_effects("around")
        ambient_light = dark.without_effects("around").with_lighting(ambient=light.lighting.ambient)
        ambient, white = shade(unemissive, ambient_light), np.ones(3, np.float32)
        base_light = dark.without_effects("around", "rows").with_lighting(ambient=white)
        if material.shading == "pbr":
            # The base colour lies below the clearcoat.
            base_surface = _make_scaled_unlit(unemissive, 1.0)
        terms = (
            *_find_terms_by_light(drawn, unemissive, clear, x, y),
            *(
                _make_effect_term(active, shade(unemissive, dark))
                for active in light.effects
                if "around" in active.effect.places
            ),
        )
    emission = shade(emission_surface, emission_light) if material.emits else black
    light_terms = LightTerms(
        material.shading, shade(base_surface, base_light), texture, uv, ambient,
        terms + post_light, emission, *find_scalar(drawn, unemissive, clear, x, y),
    )  # fmt: skip
    return light_terms, shade_pixel(drawn, surface, light, x, y)


def find_scalar(
    drawn: VisibleScene, surface: Surface, light: LightRig, x: int, y: int
) -> tuple[float | None, NDArray[np.float32] | None]:
    """Return the scalar of the visible face, and its colour, (3,) linear; None if it has none."""
    face_id, shapes = drawn.seen.coverage.face_id, drawn.cache.shapes
    face = int(face_id[y, x])
    field = drawn.cache.tables.meshes[find_object(drawn, face)].field
    if field is None:
        return None, None
    vertex_scalars, face_scalars = shapes.scalars
    if field.of_faces and face_scalars is not None and surface.face_colors is not None:
        return float(face_scalars[face]), surface.face_colors[face, :3].copy()
    scalar = np.empty(face_id.shape, np.float32)
    scalar_colors.fill_scalars(face_id, (y, y + 1), drawn.seen.geometry, vertex_scalars, scalar)
    plain = _make_white_unlit(surface)._replace(fields=surface.fields, textures=None)
    return float(scalar[y, x]), shade_pixel(drawn, plain, light, x, y)[:3]


def _find_effect_terms(
    drawn: VisibleScene, surface: Surface, light: LightRig, clear: LightRig, x: int, y: int
) -> Iterator[LightTerm]:
    """Yield the change by each effect that acts on lit samples, in order."""
    before = clear.effects
    for n, active in enumerate(light.effects):
        if not POST_LIGHT_PLACES.isdisjoint(active.effect.places):
            after = (*before[:n], active, *before[n + 1 :])
            changed, unchanged = (
                shade_pixel(drawn, surface, light._replace(effects=effects), x, y)[:3]
                for effects in (after, before)
            )
            before = after
            yield _make_effect_term(active, changed - unchanged)


def _make_effect_term(active: ActiveEffect, added: NDArray[np.float32]) -> LightTerm:
    """Return the light that an effect adds to a colour, (3,) float32, as a term."""
    effect = active.effect
    return LightTerm(
        effect.term or effect.name, added, np.zeros(3, np.float32), is_of_effect=True,
        is_told_apart=False,
    )  # fmt: skip


def _find_terms_by_light(
    drawn: VisibleScene, surface: Surface, light: LightRig, x: int, y: int
) -> Iterator[LightTerm]:
    """Yield the diffuse and specular light of each light alone."""
    diffuse, black = surface.materials.copy(), surface.materials.copy()
    diffuse[:, records.MATERIAL_SPECULAR] = 0.0
    # Microfacets take highlights from the base colour: ``lobes`` selects diffuse or specular.
    black[black[:, records.MATERIAL_MODEL] != records.PBR, :3] = 0.0
    kinds = []
    for n, materials in enumerate((diffuse, black)):
        facets = surface.microfacets
        if facets is not None:
            facets = facets._replace(lobes=np.eye(2, dtype=np.float32)[n])
        kinds.append(surface._replace(materials=materials, microfacets=facets))
    dark = np.zeros(3, np.float32)
    for n, name in enumerate(_name_lights(drawn)):
        # Keep the others as black lights, as shadow maps are numbered by light.
        lights = light.lighting.lights.copy()
        lights[:n, LIGHT_COLOR], lights[n + 1 :, LIGHT_COLOR] = 0.0, 0.0
        alone = light.without_effects("around").with_lighting(lights=lights, ambient=dark)
        if light.lighting.pyrender is not None:
            added = shade_pixel(drawn, surface, alone, x, y)[:3]
            yield LightTerm(name, added, dark, is_told_apart=False)
        else:
            diffuse, specular = (shade_pixel(drawn, part, alone, x, y)[:3] for part in kinds)
            yield LightTerm(name, diffuse, specular)


def _remove_emission(surface: Surface) -> Surface:
    """Return a surface without emission."""
    if surface.maps is None:
        return surface
    factors = surface.maps.factors.copy()
    factors[:, EMISSIVE:] = 0.0
    return surface._replace(maps=surface.maps._replace(factors=factors))


def _make_scaled_unlit(surface: Surface, share: float) -> Surface:
    """Return an unlit surface with its base colour times a factor."""
    materials = surface.materials.copy()
    materials[:, :3] *= np.float32(share)
    materials[:, records.MATERIAL_MODEL] = records.UNLIT
    return surface._replace(materials=materials, layers=None)


def _make_white_unlit(surface: Surface) -> Surface:
    """Return an unlit surface with white colours, which shows only its texture."""
    materials = surface.materials.copy()
    materials[:, :4] = 1.0
    materials[:, records.MATERIAL_MODEL] = records.UNLIT
    colors = {
        name: None if value is None else np.ones_like(value)
        for name, value in surface._asdict().items()
        if name in ("vertex_colors", "face_colors")
    }
    return surface._replace(materials=materials, fields=None, layers=None, **colors)


def _interpolate(
    drawn: VisibleScene, values: NDArray[np.float32], x: int, y: int
) -> NDArray[np.float32]:
    """Interpolate an attribute of vertices, (V, K), at a pixel, (K,)."""
    face_id = drawn.seen.coverage.face_id
    attribute = np.empty((*face_id.shape, values.shape[1]), np.float32)
    whole = drawn.seen.geometry
    barycentric.fill_attribute(face_id, (y, y + 1), whole, values, attribute)
    return attribute[y, x].copy()


def _name_lights(drawn: VisibleScene) -> list[str]:
    """Return names of the lights that are not ambient, in the order of the plan."""
    scene, planned = drawn.scene, drawn.plan.facts.lights
    if not scene.lights:
        return ["headlight"] if scene.environment is None else []
    return [
        f"{type(light).__name__} {n}"
        for light, n in zip(planned.lights, planned.numbers, strict=True)
        if not isinstance(light, AmbientLight)
    ]


def shade_pixel(
    drawn: VisibleScene, surface: Surface, light: LightRig, x: int, y: int, face: int | None = None
) -> NDArray[np.float32]:
    """
    Shade one pixel with the stages of a frame; return its linear colour, (4,) float32.

    ``face`` defaults to the visible one.
    """
    geometry, placement, plan = drawn.seen.geometry, drawn.seen.placement, drawn.plan
    face = int(drawn.seen.coverage.face_id[y, x]) if face is None else face
    needs = plan.shading.of(surface, light.lighting)

    def light_vertices_of_face(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
        vertex_light = LightRig(lighting, light.effects)
        return _light_face_vertices(drawn, needs, surface, vertex_light, face)

    surface = shading.light_surface(plan, surface, light.lighting, light_vertices_of_face)
    row = np.full((1, plan.size[0]), tile_rasterizer.NOTHING, np.int32)
    row[0, x] = face
    linear, empty_color = np.empty((1, plan.size[0], 4), np.float32), np.empty((1, 0), np.uint32)
    stages = Shading(
        needs, geometry, placement, surface, light.lighting, light.effects, plan.facts.encoding,
        plan.background,
    )  # fmt: skip
    stages.shade(row, y, linear, empty_color)
    return linear[0, x].copy()


def _light_face_vertices(
    drawn: VisibleScene, needs: ShadingNeeds, surface: Surface, light: LightRig, face: int
) -> NDArray[np.float32]:
    """Light the vertices of one face, if its object is shaded by Gouraud; (V, 2, 3)."""
    vertices = np.zeros((len(drawn.arrays.positions), 2, 3), np.float32)
    for vertex in drawn.arrays.faces[face].tolist():
        light_vertices(
            needs, (vertex, vertex + 1), drawn.arrays.vertex_starts, drawn.seen.placement, surface,
            light.lighting, light.effects, vertices,
        )  # fmt: skip
    return vertices


def find_color_parts(
    drawn: VisibleScene,
    surface: Surface,
    light: LightRig,
    face_color: NDArray[np.float32],
    linear: NDArray[np.float32],
    x: int,
    y: int,
) -> tuple[ColorPart, ...]:
    """
    Return the parts of a pixel's colour, the visible face first; none if it shows one face only.

    Parameters
    ----------
    drawn : VisibleScene
    surface : Surface
    light : LightRig
    face_color : (4,) float32, linear
        Colour of the visible face; of the background where the pixel's centre shows none.
    linear : (4,) float32, linear
        Colour of the pixel, which the parts add up to.
    x, y : int
    """
    # A supersampled pixel has two parts, one of a single face none.
    winner, quality = int(drawn.seen.coverage.face_id[y, x]), drawn.plan.quality
    samples = drawn.plan.facts.supersamples
    if samples is not None and winner >= 0:
        mean = f"what the mean of {samples} samples, each shaded by itself, differs by"
        return (
            ColorPart(_name_face(drawn, winner), winner, 1.0, 1.0, face_color[:3]),
            ColorPart(mean, None, 1.0, 1.0, linear[:3] - face_color[:3]),
        )
    if drawn.plan.layers is None or samples is not None:
        return ()
    # Find each face's share of the samples, through the faces before it.
    drawn = _sample_viewport(drawn)
    colors = {winner: face_color} if winner >= 0 else {}
    shares: FaceShares = dict.fromkeys(colors, 0.0)
    behind = 0.0
    for faces, weight in _find_visible_layers(drawn, surface, light, x, y):
        through = weight
        for face in faces:
            if face not in colors:
                colors[face] = shade_pixel(drawn, surface, light, x, y, face)
            alpha = _face_alpha(drawn, face, colors[face])
            shares[face] = shares.get(face, 0.0) + through * alpha
            through *= 1.0 - alpha
        behind += through
    shares = {face: share for face, share in shares.items() if share > 0.0 or face == winner}
    if shares in ({winner: 1.0}, {}):
        return ()
    # List the faces and the background.
    opacity = float(linear[3]) or 1.0
    parts = [
        ColorPart(
            _name_face(drawn, face), face, _face_alpha(drawn, face, colors[face]), share / opacity,
            _scale(share / opacity, colors[face][:3]),
        )
        for face, share in shares.items()
    ]  # fmt: skip
    remainder = linear[:3] - sum(part.color for part in parts)
    has_sky, image = drawn.plan.facts.shows_environment, drawn.plan.facts.background_image
    alpha = 1.0 if has_sky else float(drawn.plan.background[3])
    if image is not None:
        alpha = image.alpha_at(x, y)
    if behind * alpha > 0.0:
        name = "environment" if has_sky else "background"
        name += BLENDING_NOTE if quality.blending == "srgb8" else ""
        parts.append(ColorPart(name, None, alpha, behind * alpha / opacity, remainder))
    elif quality.blending == "srgb8":
        parts.append(ColorPart(BLENDING_NOTE.removeprefix(", and "), None, 1.0, 1.0, remainder))
    return tuple(parts)


def _sample_viewport(drawn: VisibleScene) -> VisibleScene:
    """Return the scene with a viewport for samples anywhere in their pixels."""
    viewport = fragment_bands.make_sampled_viewport(
        drawn.seen.geometry.viewport, drawn.plan.layers.samples
    )
    geometry = drawn.seen.geometry._replace(viewport=viewport)
    return drawn._replace(seen=drawn.seen._replace(geometry=geometry))


def _find_visible_layers(
    drawn: VisibleScene, surface: Surface, light: LightRig, x: int, y: int
) -> Iterator[tuple[list[int], float]]:
    """Yield the faces of each sample or area, nearest first, and its share of the pixel."""
    plan, geometry, workers = drawn.plan, drawn.seen.geometry, Workers(1)
    alpha_tests = shading.find_alpha_tests(plan, drawn.cache)
    if alpha_tests is not None:
        alpha_tests = alpha_tests._replace(geometry=geometry)
    finder = fragment_bands.Finder(geometry, alpha_tests)
    lists = fragment_bands.split_tile_lists(
        drawn.seen.coverage, geometry.viewport, plan.layers.is_blended, workers
    )
    first = y - y % TILE_SIZE
    rows = first, min(first + TILE_SIZE, geometry.viewport.height)
    if plan.layers.samples == "area":
        shown, shares, rest = fragment_bands.find_areas(rows, lists, finder, workers.memory)
        for face, share in zip(shown[:, y - first, x], shares[:, y - first, x], strict=False):
            if face >= 0:
                yield [int(face)], float(share)
        yield [], float(rest[y - first, x])
        return
    samples = int(plan.layers.samples)
    memory, max_layers = workers.memory, plan.layers.most
    for band in fragment_bands.find_layers(rows, lists, samples, finder, memory, max_layers):
        row = y - band.first_row
        if not 0 <= row < band.opaque.shape[1]:
            continue
        for transparent, opaque in zip(
            band.transparent[:, :, row, x].tolist(), band.opaque[:, row, x].tolist(), strict=True
        ):
            yield [face for face in (*transparent, opaque) if face >= 0], 1.0 / samples


def _face_alpha(drawn: VisibleScene, face: int, color: NDArray[np.float32]) -> float:
    """Return the alpha of a face at the pixel."""
    if not drawn.plan.layers.is_blended[find_object(drawn, face)]:
        return 1.0
    return float(min(max(color[3], 0.0), 1.0))


def _name_face(drawn: VisibleScene, face: int) -> str:
    """Return the number of a face and its object, in words."""
    owner = find_object(drawn, face)
    name = drawn.scene.nodes[owner].name
    if drawn.cache.cut is not None:
        face, owner = drawn.cache.cut.original_numbers(face, owner)
    numbered = f"object {owner}"
    return f"face {face} of {numbered if name == numbered else f'{numbered} {name}'}"


def _scale(share: float, color: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a share of a colour, which may be infinite if the share is 0."""
    if share == 0.0:
        return np.zeros(3, np.float32)
    return np.float32(share) * color
