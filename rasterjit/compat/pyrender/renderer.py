"""Where pyrender has its `Renderer`, which stands in ``offscreen``."""

from rasterjit.compat.pyrender.offscreen import Renderer as Renderer
