"""Fragments: pixels with several faces, by antialiasing or by transparency."""
