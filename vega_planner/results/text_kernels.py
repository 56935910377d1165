# SPDX-License-Identifier: Apache-2.0
"""Kernel that prints tables of numbers with fixed decimals.

Python's own formatting takes over a second for the 700,000 numbers of a large job;
`tables.format_rows` is the plain function in front, and its test compares with it.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

_COMMA, _NEWLINE, _MINUS, _POINT, _ZERO = 44, 10, 45, 46, 48


_TEN, _HUNDRED = np.uint64(10), np.uint64(100)
#: The digits of 00 to 99.
_PAIRS = np.array([48 + digit for n in range(100) for digit in divmod(n, 10)], np.uint8)


@kernel(inline="always")
def _print(number, size, at, out):
    """Print a number of so many digits, the last two first."""
    place = at + size - 1
    while place > at:
        tens = number // _HUNDRED
        pair = np.int64(number - tens * _HUNDRED)
        out[place] = _PAIRS[2 * pair + 1]
        out[place - 1] = _PAIRS[2 * pair]
        number = tens
        place -= 2
    if place == at:
        out[place] = _ZERO + np.uint8(number)


@kernel
def print_rows(values, decimals, out):
    """Print rows as text with a comma between columns and a newline after each row.

    Args:
        values: Finite numbers below 1e9 in magnitude, shape (n, k) float64.
        decimals: Digits after the point for each column, 0 to 9, shape (k,) int64.
        out: Buffer to fill, uint8; 22 bytes a number are always enough.

    Returns:
        Number of bytes written.
    """
    rows, columns = values.shape
    scales = np.empty(columns, np.uint64)
    for k in range(columns):
        scale = 1
        for _ in range(decimals[k]):
            scale *= 10
        scales[k] = scale
    at = 0
    for i in range(rows):
        for k in range(columns):
            scaled = np.uint64(np.rint(abs(values[i, k]) * np.float64(scales[k])))
            if values[i, k] < 0 and scaled != 0:
                out[at] = _MINUS
                at += 1
            whole = scaled // scales[k]
            part = scaled - whole * scales[k]
            size, rest = 1, whole // _TEN
            while rest != 0:
                size += 1
                rest //= _TEN
            _print(whole, size, at, out)
            at += size
            if decimals[k] > 0:
                out[at] = _POINT
                _print(part, decimals[k], at + 1, out)
                at += 1 + decimals[k]
            out[at] = _NEWLINE if k == columns - 1 else _COMMA
            at += 1
    return at
