"""Where pyrender has its `Renderer`, which stands in ``offscreen``, with the names it imports."""

from rasterjit.compat.pyrender.constants import RenderFlags as RenderFlags
from rasterjit.compat.pyrender.constants import TextAlign as TextAlign
from rasterjit.compat.pyrender.offscreen import Renderer as Renderer
