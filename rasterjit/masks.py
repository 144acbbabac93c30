"""Masks of objects and COCO annotations: the public name of ``rasterjit.outputs.masks``."""

import sys
from typing import TYPE_CHECKING

from rasterjit.outputs import masks

if TYPE_CHECKING:
    from rasterjit.outputs.masks import *  # noqa: F403

sys.modules[__name__] = masks
