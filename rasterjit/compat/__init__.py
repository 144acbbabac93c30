"""Interfaces of other renderers over this one, for scripts that were written for them."""
