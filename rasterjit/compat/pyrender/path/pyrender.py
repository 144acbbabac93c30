"""
What ``import pyrender`` finds in the processes that a program starts.

``python -m rasterjit.compat.pyrender`` puts this folder on their path.
"""

from rasterjit.compat.pyrender import install

is_stand_in = True
"""Tells `install` that this is not pyrender itself."""

install()
