"""Geometry: vertices to the screen, clipping, set-up, binning, weights of corners."""
