# SPDX-License-Identifier: Apache-2.0
"""Spiral pattern: one line from the rim to the middle, without steps.

It starts with a closed loop along the rim and ends with a closed last loop, so that
neither has a gap; the turns between slide from each loop to the next. Where a turn
leaves or joins a closed loop, both are thinner by what the other one fills.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.toolpaths.isolines import CELL, POSITION, Line
from vega_planner.toolpaths.linking import Pass, link_loops
from vega_planner.toolpaths.polyline_kernels import nearest_on, slide, unroll


def spiral_passes(
    lines: list[Line], spacing: float, longest: float, toward: Floats
) -> list[Pass] | None:
    """Join nested loops into a spiral.

    Args:
        lines: Loops and ridge lines of a patch, by level.
        spacing: Distance between loops [mm].
        longest: Longest link between ridge lines [mm].
        toward: Horizontal direction in which the spiral starts, shape (3,).

    Returns:
        The spiral, and a pass for what is left in the middle; None where the loops are
        not one inside the other.
    """
    loops = [line for line in lines if line.closed]
    if [loop.level for loop in loops] != list(range(len(loops))) or len(loops) < 2:
        return None
    segment, place = int(np.argmax(loops[0].rows[:, POSITION] @ toward)), 0.0
    turn = unroll(loops[0].rows, segment, place, True, 0.0)
    pieces = [_thinned(turn, 0.5, 1.0)]
    last = len(loops) - 2
    for n, inner in enumerate(loops[1:]):
        part = slide(turn, inner.rows)
        _, segment, place = nearest_on(inner.rows, True, part[-1])
        turn = unroll(inner.rows, segment, place, True, 0.0)
        part = _thinned(part, 0.5 if n == 0 else 1.0, 0.5 if n == last else 1.0)
        pieces.append(part[1:])
    pieces.append(_thinned(turn, 0.5, 1.0)[1:])
    passes = [Pass(np.concatenate(pieces), False)]
    rest = [line for line in lines if not line.closed]
    return passes + link_loops(rest, spacing, longest, toward)


def _thinned(rows: Floats, start: float, end: float) -> Floats:
    """Scale the strip of a turn from one share at its start to another at its end."""
    rows = rows.copy()
    rows[:, CELL] *= start + (end - start) * _fractions(rows)
    return rows


def _fractions(rows: Floats) -> Floats:
    """Length along a polyline over its whole length at its rows, shape (n,)."""
    step = np.linalg.norm(np.diff(rows[:, POSITION], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])
    return length / max(float(length[-1]), 1e-12)
