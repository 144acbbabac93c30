"""Lighting: what surfaces show of the light that falls on them."""
