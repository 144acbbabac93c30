"""Cameras of other programs: the public name of ``rasterjit.io.cameras``."""

import sys
from typing import TYPE_CHECKING

from rasterjit.io import cameras

if TYPE_CHECKING:
    from rasterjit.io.cameras import *  # noqa: F403

sys.modules[__name__] = cameras
