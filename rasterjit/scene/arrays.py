"""Name the types of arrays that descriptions and buffers hold, and keep held arrays read-only."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.validation import read_only

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
Int32 = NDArray[np.int32]
UInt8 = NDArray[np.uint8]
Bool = NDArray[np.bool_]

Holder = TypeVar("Holder", bound="HoldsArrays")


def _kept(value: Any) -> Any:
    """Return an array so that nothing writes to it; anything else as it is."""
    return read_only(value) if isinstance(value, np.ndarray) else value


class HoldsArrays:
    """An object whose arrays, or dictionaries of arrays, stay as they are."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its arrays are read-only too."""
        for name, value in state.items():
            if isinstance(value, dict):
                value = {own: _kept(one) for own, one in value.items()}
            self.__dict__[name] = _kept(value)

    def _with(self: Holder, **changes: Any) -> Holder:
        """Return a copy that shares all attributes but those given."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, **changes)
        return other
