"""Masks of objects and COCO annotations: the public name of ``rasterjit.outputs.masks``."""

import sys

from rasterjit.outputs import masks

sys.modules[__name__] = masks
