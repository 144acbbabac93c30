"""Geometry stages: transform, clipping, triangle setup, binning, barycentric weights."""
