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


def copy(source: int, target: int, number: int = COLOR_ROWS) -> Pass:
    """Return the pass that copies rows."""
    return fixed(copy_rows, source, target, number)


def fill_black(target: int) -> Pass:
    """Return the pass that writes black to three rows."""

    def black(a: ShadingArrays) -> tuple[Any, ...]:
        return np.zeros((len(a.surface.layers.probe_rows), COLOR_ROWS), np.float32), target

    return Pass(fill_rows, black)


def swapped(base: int, lit: int, passes: list[Pass]) -> list[Pass]:
    """Return passes that run with a layer's rows swapped in for the surface's."""
    swap = [
        fixed(swap_rows, rows.RED, base, BASE_ROWS),
        fixed(swap_rows, rows.LIT, lit, LIGHTING_ROWS),
    ]
    return [*swap, *passes, *swap]


def on_clearcoat(passes: list[Pass]) -> list[Pass]:
    """Return passes that light the clearcoat instead of the surface."""
    return [SWAP_NORMALS, *swapped(rows.COAT_RED, rows.COAT_LIT, passes), SWAP_NORMALS]


def on_probe(passes: list[Pass]) -> list[Pass]:
    """Return passes that light a probe: a white surface of the sample's roughness."""
    return [
        Pass(fill_rows, lambda a: (a.surface.layers.probe_rows, rows.LAYER_RED)),
        copy(rows.ROUGHNESS, rows.LAYER_ROUGHNESS, 1),
        *swapped(rows.LAYER_RED, rows.LAYER_LIT, passes),
    ]


def starting_passes(needs: ShadingNeeds, normalize: Pass) -> list[Pass]:
    """Return the passes before all lights: they normalize the clearcoat's normals."""
    return [SWAP_NORMALS, normalize, SWAP_NORMALS] if needs.coats else []


def light_passes(needs: ShadingNeeds, n: int, blinn_phong: Pass, microfacets: Pass) -> list[Pass]:
    """
    Return the passes that add one light.

    Parameters
    ----------
    needs : ShadingNeeds
    n : int
        Index of the light.
    blinn_phong : Pass
        That of Blinn-Phong materials.
    microfacets : Pass
        That of microfacets.
    """

    def lit_by(a: ShadingArrays) -> tuple[Any, ...]:
        return a.lighting.lights, n, a.surface.microfacets.lobes

    passes = [blinn_phong]
    if needs.sheens:
        passes.append(copy(rows.OUT_RED, rows.BEFORE_SHEEN_RED))
    if needs.dielectrics:
        passes.append(copy(rows.OUT_RED, rows.BEFORE_SPECULAR_RED))
    passes.append(microfacets)
    if needs.dielectrics:
        passes.append(Pass(dielectrics.add_dielectric_light, lit_by))
    if needs.sheens:
        sheens = Pass(sheen.light_sheen, lambda a: (*lit_by(a), a.surface.layers.albedo))
        passes.append(sheens)
    if needs.coats:
        passes += on_clearcoat([microfacets])
    return passes


def ambient_passes(
    needs: ShadingNeeds, microfacets: Pass, diffuse: Pass, is_first: bool = False
) -> list[Pass]:
    """
    Return the passes that add ambient light.

    Parameters
    ----------
    needs : ShadingNeeds
    microfacets, diffuse : Pass
        Those that add it to microfacets, and to samples by their row LIT.
    is_first : bool
        Whether no light was added before: colours are written, not added to.
    """
    passes: list[Pass] = []
    for is_needed, target in (
        (needs.sheens, rows.BEFORE_SHEEN_RED),
        (needs.dielectrics, rows.BEFORE_SPECULAR_RED),
    ):
        if is_needed:
            passes.append(fill_black(target) if is_first else copy(rows.OUT_RED, target))
    passes.append(microfacets)
    if needs.dielectrics:
        passes += on_probe([microfacets])
        passes.append(copy(rows.LAYER_OUT, rows.MIRROR_PROBE_RED))
    if needs.dielectrics or (needs.sheens and is_first):
        passes += on_probe([diffuse])
    if needs.dielectrics:
        passes.append(Pass(dielectrics.add_dielectric_ambient, lambda a: (a.viewer,)))
    if needs.sheens and not is_first:
        # Constant ambient light does not depend on the normal.
        bend = fixed(swap_rows, rows.NORMAL_X, rows.BENT_NORMAL_X, NORMAL_ROWS)
        passes += [Pass(sheen.bend_normals, lambda a: (a.viewer,)), bend]
        passes += [*on_probe([diffuse]), bend]
    if needs.sheens:
        passes.append(sheen_ambient())
    if needs.coats:
        passes += on_clearcoat([microfacets])
    return passes


def sheen_ambient() -> Pass:
    """Return the pass that adds ambient light to the sheen."""
    return Pass(sheen.add_ambient_sheen, lambda a: (a.viewer, a.surface.layers.albedo))


def finishing_passes(needs: ShadingNeeds) -> list[Pass]:
    """
    Return the passes after all lights and emission.

    Transmitted light is attenuated by the layers above as well.
    """
    passes: list[Pass] = []
    if needs.transmission:
        passes.append(fill_black(rows.BEFORE_SHEEN_RED))
        if needs.sheens:
            swap = fixed(swap_rows, rows.OUT_RED, rows.TINT_RED, COLOR_ROWS)
            passes += [fill_black(rows.LAYER_OUT), swap, sheen_ambient(), swap]
    if needs.coats:
        passes.append(clearcoat_over(rows.COAT_OUT, rows.OUT_RED))
        if needs.transmission:
            passes.append(clearcoat_over(rows.BEFORE_SHEEN_RED, rows.TINT_RED))
    return passes


def clearcoat_over(coat: int, below: int) -> Pass:
    """Return the pass that blends the clearcoat over three rows of colours."""
    return Pass(clearcoat.blend_clearcoats, lambda a: (a.viewer, coat, below))
