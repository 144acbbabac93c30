"""Fixtures of the tests of effects."""

from __future__ import annotations

import pytest

from rasterjit.effects.shadows import maps as shadow_maps


@pytest.fixture
def drawn(monkeypatch):
    """Catch the shadow maps that are drawn."""
    caught = []
    draw = shadow_maps.draw_shadows

    def catch(*arguments):
        caught.append(draw(*arguments))
        return caught[-1]

    monkeypatch.setattr(shadow_maps, "draw_shadows", catch)
    return caught
