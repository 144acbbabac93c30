"""The exact reference: the public name of ``rasterjit.inspect.oracle``."""

import sys

from rasterjit.inspect import oracle

sys.modules[__name__] = oracle
