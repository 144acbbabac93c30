"""
What ``import pyrender`` finds in the processes that a program starts.

``python -m rasterjit.compat.pyrender`` puts this folder on their path.
"""

import sys

from rasterjit.compat import pyrender

is_stand_in = True
"""Tells `install` that this is not pyrender itself."""

pyrender.install()
sys.modules[__name__] = pyrender
