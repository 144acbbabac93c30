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
from rasterjit.rendering.frame_shading import look_behind
from rasterjit.rendering.pass_runner import Shading, light_vertices
from rasterjit.rendering.renderer import find_visible
from rasterjit.runtime.threads import Workers
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.scene import Scene
from rasterjit.survey.cache import SceneCache
from rasterjit.survey.effect import ActiveEffect, FrameContext
from rasterjit.survey.packed_scene import SceneArrays
from rasterjit.survey.plan import RenderPlan

COLOR = slice(4, 7)
"""Columns of ``Lighting.lights``."""

AFTER_LIGHT_PLACES = {"seen", "sample"}
"""Places of effects that act after the sum of all light."""

CODE_DIFFERENCE = ", and what mixing 8-bit codes differs by"
"""Name of the part that makes up for blending codes, which do not add up as light does."""

Shares = dict[int, float]
"""How much of a pixel each face makes up, from 0 to 1; the visible one comes first."""


class Lit(NamedTuple):
    """Lighting of the objects: lights and effects."""

    lighting: Lighting | None
    effects: tuple[ActiveEffect, ...]

    def without(self, *places: str) -> Lit:
        """Return a copy in which effects at some places change nothing."""
        return self._replace(
            effects=tuple(
                one if set(places).isdisjoint(one.effect.places) else _neutralize(one)
                for one in self.effects
            )
        )

    def by(self, **fields: Any) -> Lit:
        """Return a copy with other fields of the lighting."""
        return self._replace(lighting=self.lighting._replace(**fields))


def _neutralize(one: ActiveEffect) -> ActiveEffect:
    """Return an effect that changes nothing, as data: no other stage is compiled."""
    return one._replace(record=one.effect.neutral(one.record))


class VisibleScene(NamedTuple):
    """A scene drawn as far as visibility."""

    scene: Scene
    cache: SceneCache
    plan: RenderPlan
    arrays: SceneArrays
    seen: visibility_pass.Seen
    lists: visibility_pass.TileLists
    """Lists of triangles, with culled faces."""
    primitives: Primitives | None
    """Its lines and points."""


def object_of(drawn: VisibleScene, face: int) -> int:
    """Return the number of the object that has a face."""
    return int(np.searchsorted(drawn.arrays.face_starts, face, side="right")) - 1


def find_surface(drawn: VisibleScene) -> tuple[Surface, Lit]:
    """Return surface and lighting of the objects; vertices are not lit yet."""
    plan, cache, workers = drawn.plan, drawn.cache, Workers(1)
    context = FrameContext(plan, cache, drawn.seen.placement, workers, drawn.seen)
    find = partial(find_visible, cache=cache, workers=workers, clock=lambda _: None)
    lit = Lit(plan.lighting, prepare_effects(look_behind(context, find)))
    surface = shading.find_surface(plan, cache.tables)
    points = drawn.seen.coverage.points
    if plan.facts.shades_points and points is not None:
        surface = surface._replace(points=points.read)
    return surface, lit


def light_terms(
    drawn: VisibleScene, whole: Surface, lit: Lit, x: int, y: int
) -> tuple[LightTerms, NDArray[np.float32]]:
    """Return the terms of the visible face's colour, and the colour, (4,) float32, linear."""
    face = int(drawn.seen.coverage.face_id[y, x])
    owner = object_of(drawn, face)
    material = drawn.cache.tables.meshes[owner].material
    linear = shade(drawn, whole, lit, x, y)
    # Fog and the like lie over the sum of all light.
    clear = lit.without(*AFTER_LIGHT_PLACES)
    surface, zero = _without_emission(whole), np.zeros(3, np.float32)
    texture, uv = None, np.full(2, np.nan, np.float32)
    if whole.textures is not None and material.base_color_texture is not None:
        texture = shade(drawn, _white_unlit(surface), clear, x, y)[:3]
        uv = _interpolate(drawn, whole.textures.uv, x, y)
    emission = zero
    if material.emits:
        emission = shade(drawn, _scaled_unlit(whole, 0.0), clear, x, y)[:3]
    over = tuple(_effect_terms(drawn, whole, lit, clear, x, y))
    own = material.shading, texture, uv, emission
    shown_for = scalar_at(drawn, surface, clear, x, y)
    if lit.lighting is None or material.shading == "unlit":
        base = shade(drawn, surface, clear, x, y)[:3]
        return LightTerms(own[0], base, *own[1:3], zero, over, emission, *shown_for), linear
    dark = clear.by(lights=lit.lighting.lights[:0], ambient=zero)
    ambient = dark.without("around").by(ambient=lit.lighting.ambient)
    white = dark.without("around", "rows").by(ambient=np.ones(3, np.float32))
    shown = surface
    if material.shading == "pbr":
        # The base colour lies below varnish.
        shown = _scaled_unlit(surface, 1.0)._replace(layers=None)
    base = shade(drawn, shown, white, x, y)[:3]
    terms = tuple(_light_terms(drawn, surface, clear, x, y))
    for one in lit.effects:
        if "around" in one.effect.places:
            terms += (_effect_term(one, shade(drawn, surface, dark, x, y)[:3]),)
    shed = shade(drawn, surface, ambient, x, y)[:3]
    return LightTerms(own[0], base, *own[1:3], shed, terms + over, emission, *shown_for), linear


def scalar_at(
    drawn: VisibleScene, surface: Surface, lit: Lit, x: int, y: int
) -> tuple[float | None, NDArray[np.float32] | None]:
    """Return the scalar of the visible face, and its colour, (3,) linear; None if it has none."""
    face_id, shapes = drawn.seen.coverage.face_id, drawn.cache.shapes
    face = int(face_id[y, x])
    field = drawn.cache.tables.meshes[object_of(drawn, face)].field
    if field is None:
        return None, None
    of_vertices, of_faces = shapes.scalars
    if field.of_faces and of_faces is not None and surface.face_colors is not None:
        return float(of_faces[face]), surface.face_colors[face, :3].copy()
    scalar = np.empty(face_id.shape, np.float32)
    scalar_colors.fill_scalars(face_id, (y, y + 1), drawn.seen.geometry, of_vertices, scalar)
    plain = _white_unlit(surface)._replace(fields=surface.fields, textures=None)
    return float(scalar[y, x]), shade(drawn, plain, lit, x, y)[:3]


def _effect_terms(
    drawn: VisibleScene, surface: Surface, lit: Lit, clear: Lit, x: int, y: int
) -> Iterator[LightTerm]:
    """Yield the change by each effect that acts on lit samples, in order."""
    before = clear.effects
    for n, one in enumerate(lit.effects):
        if not AFTER_LIGHT_PLACES.isdisjoint(one.effect.places):
            after = (*before[:n], one, *before[n + 1 :])
            with_it, without = (
                shade(drawn, surface, lit._replace(effects=some), x, y)[:3]
                for some in (after, before)
            )
            before = after
            yield _effect_term(one, with_it - without)


def _effect_term(one: ActiveEffect, added: NDArray[np.float32]) -> LightTerm:
    """Return the light that an effect adds to a colour, (3,) float32, as a term."""
    effect = one.effect
    return LightTerm(
        effect.term or effect.name, added, np.zeros(3, np.float32), is_of_effect=True,
        is_told_apart=False,
    )  # fmt: skip


def _light_terms(
    drawn: VisibleScene, surface: Surface, lit: Lit, x: int, y: int
) -> Iterator[LightTerm]:
    """Shade with each light alone: diffuse and specular apart."""
    diffuse, black = surface.materials.copy(), surface.materials.copy()
    diffuse[:, records.MATERIAL_SPECULAR] = 0.0
    # Microfacets have their highlights from the base colour: they are told what to show.
    black[black[:, records.MATERIAL_MODEL] != records.PBR, :3] = 0.0
    kinds = []
    for n, materials in enumerate((diffuse, black)):
        facets = surface.microfacets
        if facets is not None:
            facets = facets._replace(lobes=np.eye(2, dtype=np.float32)[n])
        kinds.append(surface._replace(materials=materials, microfacets=facets))
    dark = np.zeros(3, np.float32)
    for n, name in enumerate(_light_names(drawn)):
        # The others stay, without light: shadow maps are numbered by light.
        lights = lit.lighting.lights.copy()
        lights[:n, COLOR], lights[n + 1 :, COLOR] = 0.0, 0.0
        alone = lit.without("around").by(lights=lights, ambient=dark)
        if lit.lighting.pyrender is not None:
            yield LightTerm(name, shade(drawn, surface, alone, x, y)[:3], dark, is_told_apart=False)
            continue
        diffuse, specular = (shade(drawn, part, alone, x, y)[:3] for part in kinds)
        yield LightTerm(name, diffuse, specular)


def _without_emission(surface: Surface) -> Surface:
    """Return a surface that sends out no light."""
    if surface.maps is None:
        return surface
    factors = surface.maps.factors.copy()
    factors[:, EMISSIVE:] = 0.0
    return surface._replace(maps=surface.maps._replace(factors=factors))


def _scaled_unlit(surface: Surface, share: float) -> Surface:
    """Return an unlit surface that shows its base colour times a factor."""
    materials = surface.materials.copy()
    materials[:, :3] *= np.float32(share)
    materials[:, records.MATERIAL_MODEL] = records.UNLIT
    return surface._replace(materials=materials)


def _white_unlit(surface: Surface) -> Surface:
    """Return an unlit surface with white colours, which shows its texture alone."""
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


def _light_names(drawn: VisibleScene) -> list[str]:
    """Name the lights that are not ambient, in the order the plan has them."""
    scene, planned = drawn.scene, drawn.plan.facts.lights
    if not scene.lights:
        return ["headlight"] if scene.environment is None else []
    return [
        f"{type(light).__name__} {n}"
        for light, n in zip(planned.lights, planned.numbers, strict=True)
        if not isinstance(light, AmbientLight)
    ]


def shade(
    drawn: VisibleScene, surface: Surface, lit: Lit, x: int, y: int, face: int | None = None
) -> NDArray[np.float32]:
    """
    Shade one pixel with the stages of a frame; return its linear colour, (4,) float32.

    ``face`` is the one to shade; default the visible one.
    """
    geometry, placement, plan = drawn.seen.geometry, drawn.seen.placement, drawn.plan
    face = int(drawn.seen.coverage.face_id[y, x]) if face is None else face
    needs = plan.shading.of(surface, lit.lighting)

    def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
        return _lit_vertices(drawn, needs, surface, Lit(lighting, lit.effects), face)

    surface = shading.light_surface(plan, surface, lit.lighting, light)
    row = np.full((1, plan.size[0]), tile_rasterizer.NOTHING, np.int32)
    row[0, x] = face
    linear, no_color = np.empty((1, plan.size[0], 4), np.float32), np.empty((1, 0), np.uint32)
    stages = Shading(
        needs, geometry, placement, surface, lit.lighting, lit.effects, plan.facts.encoding,
        plan.background,
    )  # fmt: skip
    stages.shade(row, y, linear, no_color)
    return linear[0, x].copy()


def _lit_vertices(
    drawn: VisibleScene, needs: ShadingNeeds, surface: Surface, lit: Lit, face: int
) -> NDArray[np.float32]:
    """Light the vertices of one face, if its object is shaded by Gouraud; (V, 2, 3)."""
    vertices = np.zeros((len(drawn.arrays.positions), 2, 3), np.float32)
    for vertex in drawn.arrays.faces[face].tolist():
        light_vertices(
            needs, (vertex, vertex + 1), drawn.arrays.vertex_starts, drawn.seen.placement, surface,
            lit.lighting, lit.effects, vertices,
        )  # fmt: skip
    return vertices


def color_parts(
    drawn: VisibleScene,
    surface: Surface,
    lit: Lit,
    own: NDArray[np.float32],
    linear: NDArray[np.float32],
    x: int,
    y: int,
) -> tuple[ColorPart, ...]:
    """
    Return the parts of a pixel's colour, the visible face first; none if nothing else is seen.

    Parameters
    ----------
    drawn : VisibleScene
    surface : Surface
    lit : Lit
    own : (4,) float32, linear
        The colour of the visible face, or what is behind all, where its centre shows none.
    linear : (4,) float32, linear
        The pixel's, which the parts add up to.
    x, y : int
    """
    # What one face alone shows has no parts.
    winner, quality = int(drawn.seen.coverage.face_id[y, x]), drawn.plan.quality
    samples = drawn.plan.facts.supersamples
    if samples is not None and winner >= 0:
        mean = f"what the mean of {samples} samples, each shaded by itself, differs by"
        return (
            ColorPart(_face_name(drawn, winner), winner, 1.0, 1.0, own[:3]),
            ColorPart(mean, None, 1.0, 1.0, linear[:3] - own[:3]),
        )
    if drawn.plan.layers is None or samples is not None:
        return ()
    # Each face's share of the samples, through those before it.
    drawn = _sample_viewport(drawn)
    colors = {winner: own} if winner >= 0 else {}
    shares: Shares = dict.fromkeys(colors, 0.0)
    behind = 0.0
    for faces, weight in _find_samples(drawn, surface, lit, x, y):
        through = weight
        for face in faces:
            if face not in colors:
                colors[face] = shade(drawn, surface, lit, x, y, face)
            alpha = _face_alpha(drawn, face, colors[face])
            shares[face] = shares.get(face, 0.0) + through * alpha
            through *= 1.0 - alpha
        behind += through
    shares = {face: share for face, share in shares.items() if share > 0.0 or face == winner}
    if shares in ({winner: 1.0}, {}):
        return ()
    # The faces, and what is behind them.
    opacity = float(linear[3]) or 1.0
    parts = [
        ColorPart(
            _face_name(drawn, face), face, _face_alpha(drawn, face, colors[face]), share / opacity,
            _scale(share / opacity, colors[face][:3]),
        )
        for face, share in shares.items()
    ]  # fmt: skip
    rest = linear[:3] - sum(part.color for part in parts)
    has_sky, image = drawn.plan.facts.shows_environment, drawn.plan.facts.background_image
    alpha = 1.0 if has_sky else float(drawn.plan.background[3])
    if image is not None:
        alpha = image.alpha_at(x, y)
    if behind * alpha > 0.0:
        name = "environment" if has_sky else "background"
        name += CODE_DIFFERENCE if quality.blending == "srgb8" else ""
        parts.append(ColorPart(name, None, alpha, behind * alpha / opacity, rest))
    elif quality.blending == "srgb8":
        parts.append(ColorPart(CODE_DIFFERENCE.removeprefix(", and "), None, 1.0, 1.0, rest))
    return tuple(parts)


def _sample_viewport(drawn: VisibleScene) -> VisibleScene:
    """Return the drawn scene with a viewport for samples anywhere in their pixels."""
    viewport = fragment_bands.sampled_viewport(
        drawn.seen.geometry.viewport, drawn.plan.layers.samples
    )
    geometry = drawn.seen.geometry._replace(viewport=viewport)
    return drawn._replace(seen=drawn.seen._replace(geometry=geometry))


def _find_samples(
    drawn: VisibleScene, surface: Surface, lit: Lit, x: int, y: int
) -> Iterator[tuple[list[int], float]]:
    """Yield the faces visible through each other, nearest first, with their shares."""
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
    most = plan.layers.most
    for band in fragment_bands.find_layers(rows, lists, samples, finder, workers.memory, most):
        row = y - band.first_row
        if not 0 <= row < band.opaque.shape[1]:
            continue
        for transparent, opaque in zip(
            band.transparent[:, :, row, x].tolist(), band.opaque[:, row, x].tolist(), strict=True
        ):
            yield [face for face in (*transparent, opaque) if face >= 0], 1.0 / samples


def _face_alpha(drawn: VisibleScene, face: int, color: NDArray[np.float32]) -> float:
    """Return the alpha of a face at the pixel."""
    if not drawn.plan.layers.is_blended[object_of(drawn, face)]:
        return 1.0
    return float(min(max(color[3], 0.0), 1.0))


def _face_name(drawn: VisibleScene, face: int) -> str:
    """Name a face by its number and its object."""
    owner = object_of(drawn, face)
    name = drawn.scene.nodes[owner].name
    if drawn.cache.cut is not None:
        face, owner = drawn.cache.cut.original_numbers(face, owner)
    place = f"object {owner}"
    return f"face {face} of {place if name == place else f'{place} {name}'}"


def _scale(share: float, color: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a share of a colour, which may be infinite if the share is 0."""
    if share == 0.0:
        return np.zeros(3, np.float32)
    return np.float32(share) * color
