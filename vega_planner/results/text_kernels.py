# SPDX-License-Identifier: Apache-2.0
"""Kernel that prints tables of numbers with fixed decimals.

Python's own formatting takes over a second for the 700,000 numbers of a large job;
`tables.format_rows` is the plain function in front, and its test compares with it.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

_COMMA, _NEWLINE, _MINUS, _POINT, _ZERO = 44, 10, 45, 46, 48


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
    digits = np.empty(24, np.uint8)
    at = 0
    rows, columns = values.shape
    for i in range(rows):
        for k in range(columns):
            scale = 1
            for _ in range(decimals[k]):
                scale *= 10
            scaled = np.int64(np.rint(abs(values[i, k]) * scale))
            if values[i, k] < 0 and scaled != 0:
                out[at] = _MINUS
                at += 1
            whole, part = scaled // scale, scaled % scale
            count = 0
            while True:
                digits[count] = _ZERO + whole % 10
                whole //= 10
                count += 1
                if whole == 0:
                    break
            for j in range(count):
                out[at + j] = digits[count - 1 - j]
            at += count
            if decimals[k] > 0:
                out[at] = _POINT
                for j in range(decimals[k]):
                    out[at + decimals[k] - j] = _ZERO + part % 10
                    part //= 10
                at += 1 + decimals[k]
            out[at] = _NEWLINE if k == columns - 1 else _COMMA
            at += 1
    return at
