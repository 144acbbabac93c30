"""Visibility: which face is seen at each sample, and how deep it lies."""
