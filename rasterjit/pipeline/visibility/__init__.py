"""Visibility buffer: the nearest face at each sample, and its depth."""
