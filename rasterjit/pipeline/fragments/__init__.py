"""Fragments: pixels that show several faces, beside each other or behind each other."""
