"""Arguments of Python under which every warning is an error, as in pytest's own process."""

STRICT = ("-W", "error", "-W", "ignore:sharp edges are rounded off")
"""Boxes of tests are shaded as balls, to have averages that can be checked."""
