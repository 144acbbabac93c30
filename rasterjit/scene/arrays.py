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


def _frozen(value: Any) -> Any:
    """Return an array made read-only; anything else as it is."""
    return read_only(value) if isinstance(value, np.ndarray) else value


class HoldsArrays:
    """Base class of objects whose arrays, also in dictionaries, stay read-only when copied."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its arrays are read-only too."""
        for name, value in state.items():
            if isinstance(value, dict):
                value = {key: _frozen(item) for key, item in value.items()}
            self.__dict__[name] = _frozen(value)

    def _with(self: Holder, **changes: Any) -> Holder:
        """Return a copy that shares all attributes but those given."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, **changes)
        return other
