"""The exact reference: the public name of ``rasterjit.inspect.oracle``."""

import sys
from typing import TYPE_CHECKING

from rasterjit.inspect import oracle

if TYPE_CHECKING:
    from rasterjit.inspect.oracle import *  # noqa: F403

sys.modules[__name__] = oracle
