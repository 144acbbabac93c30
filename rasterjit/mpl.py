"""Scenes in matplotlib's axes: the public name of ``rasterjit.compat.matplotlib``."""

import sys
from typing import TYPE_CHECKING

from rasterjit.compat import matplotlib

if TYPE_CHECKING:
    from rasterjit.compat.matplotlib import *  # noqa: F403

sys.modules[__name__] = matplotlib
