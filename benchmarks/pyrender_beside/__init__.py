"""Scenes drawn by pyrender and by `rasterjit.compat.pyrender`, compared and timed."""
