"""Cameras of other programs: the public name of ``rasterjit.io.cameras``."""

import sys

from rasterjit.io import cameras

sys.modules[__name__] = cameras
