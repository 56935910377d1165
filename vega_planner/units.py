# SPDX-License-Identifier: Apache-2.0
"""The two crossings between millimetres (geometry) and SI (machines) use these."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

_Length = TypeVar("_Length", float, NDArray[np.float64])

MM_PER_M = 1000.0


def mm_to_m(length: _Length) -> _Length:
    """Convert a length, or an array of lengths, from millimetres to metres."""
    return length / MM_PER_M


def m_to_mm(length: _Length) -> _Length:
    """Convert a length, or an array of lengths, from metres to millimetres."""
    return length * MM_PER_M
