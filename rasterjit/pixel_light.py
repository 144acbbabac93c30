"""The terms that the colour of one pixel is made of, each found by the kernel that shades it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import passes, stages
from rasterjit.explanation import LightTerm, LightTerms
from rasterjit.kernels import fogging, interpolation, records, shading, visibility
from rasterjit.kernels.maps import EMITTED
from rasterjit.kernels.records import (
    Environment,
    Fog,
    Geometry,
    Lighting,
    Placement,
    Surface,
)
from rasterjit.plan import RenderPlan
from rasterjit.plan_arrays import SceneArrays
from rasterjit.prepared import Prepared
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.scene import Scene

COLOR = slice(4, 7)
"""Columns of ``Lighting.lights``."""


class Drawn(NamedTuple):
    """A scene drawn as far as visibility."""

    scene: Scene
    prepared: Prepared
    plan: RenderPlan
    arrays: SceneArrays
    geometry: Geometry
    placement: Placement
    coverage: stages.Coverage
    lists: stages.TileLists
    """With culled faces."""


def owner_of(drawn: Drawn, face: int) -> int:
    """Return the number of the object that has a face."""
    return int(np.searchsorted(drawn.arrays.face_starts, face, side="right")) - 1


def find_look(drawn: Drawn) -> tuple[Surface, Lighting | None]:
    """Return what the objects look like and what lights them; vertices are not lit yet."""
    plan, prepared, workers = drawn.plan, drawn.prepared, stages.Workers(1)
    lighting = passes.find_lighting(
        plan, prepared, drawn.geometry, drawn.placement, drawn.coverage, workers
    )
    return passes.find_surface(plan, prepared, drawn.placement, None, workers), lighting


def light_of(
    drawn: Drawn, whole: Surface, lighting: Lighting | None, x: int, y: int
) -> tuple[LightTerms, NDArray[np.float32]]:
    """Return the terms of the visible face's colour and the colour, (4,) float32, linear."""
    face = int(drawn.coverage.face_id[y, x])
    owner = owner_of(drawn, face)
    material = drawn.prepared.looks.meshes[owner].material
    linear = shade(drawn, whole, lighting, x, y)
    # Fog lies over the sum of all light.
    clear = None if lighting is None else lighting._replace(fog=_no_fog(lighting.fog))
    surface, zero = _without_emission(whole), np.zeros(3, np.float32)
    texture, uv = None, np.full(2, np.nan, np.float32)
    if whole.textures is not None and material.base_color_texture is not None:
        texture = shade(drawn, _white(surface), clear, x, y)[:3]
        uv = _interpolate(drawn, whole.textures.uv, x, y)
    emission = zero
    if material.emits:
        emission = shade(drawn, _unlit(whole, 0.0), clear, x, y)[:3]
    fog = ()
    if lighting is not None and lighting.fog is not None:
        fog = (LightTerm("fog", linear[:3] - shade(drawn, whole, clear, x, y)[:3], zero),)
    own = material.shading, texture, uv, emission
    if clear is None or material.shading == "unlit":
        base = shade(drawn, surface, clear, x, y)[:3]
        return LightTerms(own[0], base, *own[1:3], zero, fog, emission), linear
    dark = clear._replace(lights=clear.lights[:0], ambient=zero)
    no_sky = _no_environment(clear.environment)
    ambient = dark._replace(ambient=clear.ambient, environment=no_sky)
    white = dark._replace(ambient=np.ones(3, np.float32), environment=no_sky)
    if clear.occlusion is not None:
        white = white._replace(occlusion=np.ones_like(clear.occlusion))
    shown = _unlit(surface, 1.0) if material.shading == "pbr" else surface
    base = shade(drawn, shown, white, x, y)[:3]
    terms = tuple(_light_terms(drawn, surface, clear, x, y))
    if clear.environment is not None:
        terms += (LightTerm("environment", shade(drawn, surface, dark, x, y)[:3], zero),)
    shed = shade(drawn, surface, ambient, x, y)[:3]
    return LightTerms(own[0], base, *own[1:3], shed, terms + fog, emission), linear


def _light_terms(
    drawn: Drawn, surface: Surface, lighting: Lighting, x: int, y: int
) -> Iterator[LightTerm]:
    """Let each light shine alone, on the surface without its highlight, and on that alone."""
    matt, black = surface.materials.copy(), surface.materials.copy()
    matt[:, records.MATERIAL_SPECULAR] = 0.0
    # Microfacets have their highlights from the base colour: they are told what to show.
    black[black[:, records.MATERIAL_MODEL] != records.PBR, :3] = 0.0
    kinds = []
    for n, materials in enumerate((matt, black)):
        facets = lighting.microfacets
        if facets is not None:
            facets = facets._replace(parts=np.eye(2, dtype=np.float32)[n])
        kinds.append((surface._replace(materials=materials), facets))
    dark = np.zeros(3, np.float32)
    for n, name in enumerate(_light_names(drawn)):
        # The others stay, without light: shadow maps are numbered by light.
        lights = lighting.lights.copy()
        lights[:n, COLOR], lights[n + 1 :, COLOR] = 0.0, 0.0
        no_sky = _no_environment(lighting.environment)
        alone = lighting._replace(lights=lights, ambient=dark, environment=no_sky)
        diffuse, specular = (
            shade(drawn, part, alone._replace(microfacets=facets), x, y)[:3]
            for part, facets in kinds
        )
        yield LightTerm(name, diffuse, specular)


def _no_fog(fog: Fog | None) -> Fog | None:
    """Return fog that covers nothing: as data, so that no other form of a kernel is compiled."""
    zero = np.float32(0.0)
    return (
        None if fog is None else fog._replace(mode=fogging.EXPONENTIAL, density=zero, falloff=zero)
    )


def _no_environment(environment: Environment | None) -> Environment | None:
    """Return an environment without light, as data."""
    return None if environment is None else environment._replace(intensity=np.float32(0.0))


def _without_emission(surface: Surface) -> Surface:
    """Return a surface that sends out no light."""
    if surface.maps is None:
        return surface
    factors = surface.maps.factors.copy()
    factors[:, EMITTED:] = 0.0
    return surface._replace(maps=surface.maps._replace(factors=factors))


def _unlit(surface: Surface, share: float) -> Surface:
    """Return a surface that shows a share of its base colour, whatever light falls on it."""
    materials = surface.materials.copy()
    materials[:, :3] *= np.float32(share)
    materials[:, records.MATERIAL_MODEL] = records.UNLIT
    return surface._replace(materials=materials)


def _white(surface: Surface) -> Surface:
    """Return a surface whose colours are white, unlit: what is seen is the texture."""
    materials = surface.materials.copy()
    materials[:, :4] = 1.0
    materials[:, records.MATERIAL_MODEL] = records.UNLIT
    colors = {
        name: None if value is None else np.ones_like(value)
        for name, value in surface._asdict().items()
        if name in ("vertex_colors", "face_colors")
    }
    return surface._replace(materials=materials, **colors)


def _interpolate(drawn: Drawn, values: NDArray[np.float32], x: int, y: int) -> NDArray[np.float32]:
    """Return what an attribute of vertices, (V, K), is at a pixel, (K,)."""
    face_id = drawn.coverage.face_id
    attribute = np.empty((*face_id.shape, values.shape[1]), np.float32)
    interpolation.fill_attribute(face_id, (y, y + 1), drawn.geometry, values, attribute)
    return attribute[y, x].copy()


def _light_names(drawn: Drawn) -> list[str]:
    """Name the lights that are not ambient, in the order the plan has them."""
    scene, planned = drawn.scene, drawn.plan.lights
    if not scene.lights:
        return ["headlight"] if scene.environment is None else []
    return [
        f"{type(light).__name__} {n}"
        for light, n in zip(planned.lights, planned.numbers, strict=True)
        if not isinstance(light, AmbientLight)
    ]


def shade(
    drawn: Drawn,
    surface: Surface,
    lighting: Lighting | None,
    x: int,
    y: int,
    face: int | None = None,
) -> NDArray[np.float32]:
    """
    Shade one pixel with the engine's kernel; return its linear colour, (4,) float32.

    ``face`` is the one to shade; default the visible one.
    """
    geometry, placement, plan = drawn.geometry, drawn.placement, drawn.plan
    face = int(drawn.coverage.face_id[y, x]) if face is None else face
    if plan.needs_gouraud and lighting is not None:
        lit = _lit_vertices(drawn, surface, lighting, face)
        matt = None
        if plan.needs_matt_light:
            matt = _lit_vertices(drawn, surface, lighting._replace(highlights=None), face)
        surface = surface._replace(lit_vertices=lit, matt_vertices=matt)
    row = np.full((1, plan.size[0]), visibility.NOTHING, np.int32)
    row[0, x] = face
    linear, no_color = np.empty((1, plan.size[0], 4), np.float32), np.empty((1, 0), np.uint32)
    shading.shade_rows(
        row, y, geometry, placement, surface, lighting, plan.background, plan.encoding,
        linear, no_color,
        shading.scratch_memory(
            shading.sample_rows(surface, lighting), surface.textures is not None
        ),
    )  # fmt: skip
    return linear[0, x].copy()


def _lit_vertices(
    drawn: Drawn, surface: Surface, lighting: Lighting, face: int
) -> NDArray[np.float32]:
    """Light the vertices of one face, if its object is shaded by Gouraud; (V, 2, 3)."""
    lit = np.zeros((len(drawn.arrays.positions), 2, 3), np.float32)
    for vertex in drawn.arrays.faces[face].tolist():
        shading.light_vertices(
            (vertex, vertex + 1), drawn.arrays.vertex_starts, drawn.placement, surface, lighting,
            lit, shading.scratch_memory(shading.sample_rows(surface, lighting)),
        )  # fmt: skip
    return lit
