"""What ``import pyribbit`` finds in the processes that a program starts: the same as pyrender."""

import sys

from rasterjit.compat import pyrender

is_stand_in = True
"""Tells `install` that this is not pyribbit itself."""

pyrender.install()
sys.modules[__name__] = pyrender
