"""Matrices and point transforms: the public name of ``rasterjit.scene.transforms``."""

import sys

from rasterjit.scene import transforms

sys.modules[__name__] = transforms
