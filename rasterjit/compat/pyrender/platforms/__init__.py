"""Where pyrender draws: platforms that can be made and do nothing, since RasterJIT needs none."""

from rasterjit.compat.pyrender.platforms.base import Platform

__all__ = ["Platform"]
