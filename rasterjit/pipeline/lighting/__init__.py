"""Lighting stages: shading models, direct and ambient light."""
