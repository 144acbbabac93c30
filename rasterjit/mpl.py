"""Scenes in matplotlib's axes: the public name of ``rasterjit.compat.matplotlib``."""

import sys

from rasterjit.compat import matplotlib

sys.modules[__name__] = matplotlib
