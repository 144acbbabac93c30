"""The platform of OSMesa, which nothing here needs."""

from rasterjit.compat.pyrender.platforms.base import Platform


class OSMesaPlatform(Platform):
    """A platform that does nothing, as `Platform` is."""
