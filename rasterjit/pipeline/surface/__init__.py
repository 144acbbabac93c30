"""Surfaces: gather the samples of a row with all that lighting needs to know of them."""
