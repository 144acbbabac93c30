"""Matrices and point transforms: the public name of ``rasterjit.scene.transforms``."""

import sys
from typing import TYPE_CHECKING

from rasterjit.scene import transforms

if TYPE_CHECKING:
    from rasterjit.scene.transforms import *  # noqa: F403

sys.modules[__name__] = transforms
