"""
List the passes of layered materials: clearcoat, sheen and custom specular, around the base passes.

Only layers in view have passes; without any, this module is not imported.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.lighting import clearcoat, dielectrics, sheen
from rasterjit.pipeline.passes import Pass, ShadingArrays, ShadingNeeds, fixed
from rasterjit.pipeline.surface import layer_rows as moves
from rasterjit.pipeline.surface import sample_block as rows

BASE, LIT_TO_ROUGHNESS, COLOR, NORMAL = 3, 6, 3, 3
"""Numbers of consecutive rows that are moved together."""

ON_COAT = fixed(moves.exchange_rows, rows.NORMAL_X, rows.COAT_NORMAL_X, NORMAL)
"""Swaps the normals of the base layer and the clearcoat."""


def kept(source: int, target: int, number: int = COLOR) -> Pass:
    """Return the pass that copies rows."""
    return fixed(moves.copy_rows, source, target, number)


def darkened(target: int) -> Pass:
    """Return the pass that makes a colour black."""

    def black(a: ShadingArrays) -> tuple[Any, ...]:
        return np.zeros((len(a.surface.layers.stand_ins), COLOR), np.float32), target

    return Pass(moves.fill_rows, black)


def exchanged(base: int, lit: int, passes: list[Pass]) -> list[Pass]:
    """Return passes that run with a layer's rows swapped in for the surface's."""
    change = [
        fixed(moves.exchange_rows, rows.RED, base, BASE),
        fixed(moves.exchange_rows, rows.LIT, lit, LIT_TO_ROUGHNESS),
    ]
    return [*change, *passes, *change]


def on_varnish(passes: list[Pass]) -> list[Pass]:
    """Return passes that light the clearcoat instead of the surface."""
    return [ON_COAT, *exchanged(rows.COAT_RED, rows.COAT_LIT, passes), ON_COAT]


def on_stand_ins(passes: list[Pass]) -> list[Pass]:
    """Return passes that light only a white surface of the sample's roughness: a probe."""
    return [
        Pass(moves.fill_rows, lambda a: (a.surface.layers.stand_ins, rows.LAYER_RED)),
        kept(rows.ROUGHNESS, rows.LAYER_ROUGHNESS, 1),
        *exchanged(rows.LAYER_RED, rows.LAYER_LIT, passes),
    ]


def starting_passes(needs: ShadingNeeds, normalize: Pass) -> list[Pass]:
    """Return the passes before any light."""
    return [ON_COAT, normalize, ON_COAT] if needs.coats else []


def light_passes(needs: ShadingNeeds, n: int, shiny: Pass, facets: Pass) -> list[Pass]:
    """
    Return the passes that add one light.

    Parameters
    ----------
    needs : ShadingNeeds
    n : int
        The number of the light.
    shiny : Pass
        That of Blinn-Phong materials.
    facets : Pass
        That of microfacets.
    """

    def lit_by(a: ShadingArrays) -> tuple[Any, ...]:
        return a.lighting.lights, n, a.surface.microfacets.parts

    passes = [shiny]
    if needs.sheens:
        passes.append(kept(rows.OUT_RED, rows.BELOW_RED))
    if needs.dielectrics:
        passes.append(kept(rows.OUT_RED, rows.BEFORE_RED))
    passes.append(facets)
    if needs.dielectrics:
        passes.append(Pass(dielectrics.light_own_mirrors, lit_by))
    if needs.sheens:
        fibres = Pass(sheen.light_fibres, lambda a: (*lit_by(a), a.surface.layers.albedo))
        passes.append(fibres)
    if needs.coats:
        passes += on_varnish([facets])
    return passes


def around_passes(
    needs: ShadingNeeds, facets: Pass, matt: Pass, is_first: bool = False
) -> list[Pass]:
    """
    Return the passes that add ambient light.

    Parameters
    ----------
    needs : ShadingNeeds
    facets, matt : Pass
        Those that show it on microfacets, and on what LIT tells.
    is_first : bool
        Whether nothing was shown before: what is seen is written, not added to.
    """
    passes: list[Pass] = []
    for is_there, target in (
        (needs.sheens, rows.BELOW_RED),
        (needs.dielectrics, rows.BEFORE_RED),
    ):
        if is_there:
            passes.append(darkened(target) if is_first else kept(rows.OUT_RED, target))
    passes.append(facets)
    if needs.dielectrics:
        passes += on_stand_ins([facets])
        passes.append(kept(rows.LAYER_OUT, rows.WHITE_RED))
    if needs.dielectrics or (needs.sheens and is_first):
        passes += on_stand_ins([matt])
    if needs.dielectrics:
        passes.append(Pass(dielectrics.show_around_on_own_mirrors, lambda a: (a.viewer,)))
    if needs.sheens and not is_first:
        # Constant ambient light does not depend on the normal.
        leaning = fixed(moves.exchange_rows, rows.NORMAL_X, rows.LEANING_X, NORMAL)
        passes += [Pass(sheen.lean_normals, lambda a: (a.viewer,)), leaning]
        passes += [*on_stand_ins([matt]), leaning]
    if needs.sheens:
        passes.append(fibres_around())
    if needs.coats:
        passes += on_varnish([facets])
    return passes


def fibres_around() -> Pass:
    """Return the pass that adds ambient light to the sheen."""
    return Pass(sheen.show_around_on_fibres, lambda a: (a.viewer, a.surface.layers.albedo))


def finishing_passes(needs: ShadingNeeds) -> list[Pass]:
    """
    Return the passes after all lights and emission.

    Transmitted light is attenuated by the layers above as well.
    """
    passes: list[Pass] = []
    if needs.through:
        passes.append(darkened(rows.BELOW_RED))
        if needs.sheens:
            turned = fixed(moves.exchange_rows, rows.OUT_RED, rows.TINT_RED, COLOR)
            passes += [darkened(rows.LAYER_OUT), turned, fibres_around(), turned]
    if needs.coats:
        passes.append(coated(rows.COAT_OUT, rows.OUT_RED))
        if needs.through:
            passes.append(coated(rows.BELOW_RED, rows.TINT_RED))
    return passes


def coated(coat: int, below: int) -> Pass:
    """Return the pass that blends the clearcoat over three rows of colours."""
    return Pass(clearcoat.lay_coats, lambda a: (a.viewer, coat, below))
