"""
List the passes of layered materials: clearcoat, sheen and custom specular, around the base passes.

Only layers in view have passes; without any, this module is not imported.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.lighting import clearcoat, dielectrics, sheen
from rasterjit.pipeline.passes import Pass, ShadingArrays, ShadingNeeds, fixed
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.layer_rows import copy_rows, fill_rows, swap_rows

BASE_ROWS, LIGHTING_ROWS, COLOR_ROWS, NORMAL_ROWS = 3, 6, 3, 3
"""Numbers of consecutive rows that are copied or swapped together."""

SWAP_NORMALS = fixed(swap_rows, rows.NORMAL_X, rows.COAT_NORMAL_X, NORMAL_ROWS)
"""Swaps the normals of the base layer and the clearcoat."""


def copy_colors(source: int, target: int) -> Pass:
    """Return the pass that copies three rows of colours."""
    return fixed(copy_rows, source, target, COLOR_ROWS)


def fill_black(target: int) -> Pass:
    """Return the pass that writes black to three rows."""

    def list_arguments(a: ShadingArrays) -> tuple[Any, ...]:
        return np.zeros((len(a.surface.layers.probe_rows), COLOR_ROWS), np.float32), target

    return Pass(fill_rows, list_arguments)


def swap_rows_around(layer_red: int, layer_lit: int, passes: list[Pass]) -> list[Pass]:
    """Return passes that run with a layer's rows swapped with the surface's."""
    swaps = [
        fixed(swap_rows, rows.RED, layer_red, BASE_ROWS),
        fixed(swap_rows, rows.LIT, layer_lit, LIGHTING_ROWS),
    ]
    return [*swaps, *passes, *swaps]


def light_clearcoat(passes: list[Pass]) -> list[Pass]:
    """Return passes that light the clearcoat instead of the surface."""
    return [SWAP_NORMALS, *swap_rows_around(rows.COAT_RED, rows.COAT_LIT, passes), SWAP_NORMALS]


def light_probe(passes: list[Pass]) -> list[Pass]:
    """Return passes that light a probe: a white surface of the sample's roughness."""
    return [
        Pass(fill_rows, lambda a: (a.surface.layers.probe_rows, rows.LAYER_RED)),
        fixed(copy_rows, rows.ROUGHNESS, rows.LAYER_ROUGHNESS, 1),
        *swap_rows_around(rows.LAYER_RED, rows.LAYER_LIT, passes),
    ]


def list_starting_passes(needs: ShadingNeeds, normalize: Pass) -> list[Pass]:
    """Return the passes before all lights, which normalize the clearcoat's normals."""
    return [SWAP_NORMALS, normalize, SWAP_NORMALS] if needs.coats else []


def list_light_passes(
    needs: ShadingNeeds, light: int, blinn_phong: Pass, microfacets: Pass
) -> list[Pass]:
    """
    Return the passes that add one light.

    Parameters
    ----------
    needs : ShadingNeeds
    light : int
        Index of the light.
    blinn_phong, microfacets : Pass
        The passes that add the light to Blinn-Phong and to microfacet materials.
    """

    def list_light_arguments(a: ShadingArrays) -> tuple[Any, ...]:
        return a.lighting.lights, light, a.surface.microfacets.lobes

    passes = [blinn_phong]
    if needs.sheens:
        passes.append(copy_colors(rows.OUT_RED, rows.BEFORE_SHEEN_RED))
    if needs.dielectrics:
        passes.append(copy_colors(rows.OUT_RED, rows.BEFORE_SPECULAR_RED))
    passes.append(microfacets)
    if needs.dielectrics:
        passes.append(Pass(dielectrics.add_dielectric_light, list_light_arguments))
    if needs.sheens:
        sheens = Pass(
            sheen.add_sheen_light, lambda a: (*list_light_arguments(a), a.surface.layers.albedo)
        )
        passes.append(sheens)
    if needs.coats:
        passes += light_clearcoat([microfacets])
    return passes


def list_ambient_passes(
    needs: ShadingNeeds, microfacets: Pass, diffuse: Pass, is_first: bool = False
) -> list[Pass]:
    """
    Return the passes that add ambient light.

    Parameters
    ----------
    needs : ShadingNeeds
    microfacets, diffuse : Pass
        The passes that add ambient light to microfacets, and to samples by their row LIT.
    is_first : bool
        Whether no light was added before: colours are written, not added to.
    """
    passes: list[Pass] = []
    for is_needed, target in (
        (needs.sheens, rows.BEFORE_SHEEN_RED),
        (needs.dielectrics, rows.BEFORE_SPECULAR_RED),
    ):
        if is_needed:
            passes.append(fill_black(target) if is_first else copy_colors(rows.OUT_RED, target))
    passes.append(microfacets)
    if needs.dielectrics:
        passes += light_probe([microfacets])
        passes.append(copy_colors(rows.LAYER_OUT, rows.MIRROR_PROBE_RED))
    if needs.dielectrics or (needs.sheens and is_first):
        passes += light_probe([diffuse])
    if needs.dielectrics:
        passes.append(Pass(dielectrics.add_dielectric_ambient, lambda a: (a.viewer,)))
    if needs.sheens and not is_first:
        # Constant ambient light does not depend on the normal.
        bend = fixed(swap_rows, rows.NORMAL_X, rows.BENT_NORMAL_X, NORMAL_ROWS)
        passes += [Pass(sheen.bend_normals, lambda a: (a.viewer,)), bend]
        passes += [*light_probe([diffuse]), bend]
    if needs.sheens:
        passes.append(add_ambient_sheen())
    if needs.coats:
        passes += light_clearcoat([microfacets])
    return passes


def add_ambient_sheen() -> Pass:
    """Return the pass that adds ambient light to the sheen."""
    return Pass(sheen.add_ambient_sheen, lambda a: (a.viewer, a.surface.layers.albedo))


def list_finishing_passes(needs: ShadingNeeds) -> list[Pass]:
    """
    Return the passes after all lights and emission.

    Transmitted light is attenuated by the layers above as well.
    """
    passes: list[Pass] = []
    if needs.transmission:
        passes.append(fill_black(rows.BEFORE_SHEEN_RED))
        if needs.sheens:
            swap = fixed(swap_rows, rows.OUT_RED, rows.TINT_RED, COLOR_ROWS)
            passes += [fill_black(rows.LAYER_OUT), swap, add_ambient_sheen(), swap]
    if needs.coats:
        passes.append(blend_clearcoat_over(rows.COAT_OUT, rows.OUT_RED))
        if needs.transmission:
            passes.append(blend_clearcoat_over(rows.BEFORE_SHEEN_RED, rows.TINT_RED))
    return passes


def blend_clearcoat_over(coat: int, below: int) -> Pass:
    """Return the pass that blends the clearcoat over three rows of colours."""
    return Pass(clearcoat.blend_clearcoats, lambda a: (a.viewer, coat, below))
