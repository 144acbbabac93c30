"""The platform of pyglet's hidden windows, which nothing here needs."""

from rasterjit.compat.pyrender.platforms.base import Platform


class PygletPlatform(Platform):
    """A platform that does nothing, as `Platform` is."""
