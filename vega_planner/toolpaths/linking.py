# SPDX-License-Identifier: Apache-2.0
"""Joining lines into few long passes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.toolpaths.isolines import POSITION, Line
from vega_planner.toolpaths.polyline_kernels import line_length, nearest_on, unroll

#: Rise from one line to the next, over the longest link, from which on a pass climbs or
#: descends. It does not do both: one that descends is turned round, so that walls are
#: printed upwards.
LEVEL_RATIO = 0.1


@dataclass(frozen=True, eq=False)
class Pass:
    """Lines joined into one deposition.

    Attributes:
        rows: As in `Line`; where closed, the first row is repeated at the end.
        closed: True for a single loop.
    """

    rows: Floats
    closed: bool


def link_loops(lines: list[Line], spacing: float, longest: float, toward: Floats) -> list[Pass]:
    """Join loops into passes, each loop in the other direction than the one before.

    A loop ends one spacing before its start; there the path steps to the next loop and
    goes back the way it came. The steps fill the slot that the open ends leave, and a
    wrist that follows the loops never winds up.

    Args:
        lines: Loops and ridge lines, by level.
        spacing: Distance between loops [mm].
        longest: Longest step [mm].
        toward: Horizontal direction in which the first loop starts, shape (3,).

    Returns:
        Passes from the rim inwards.
    """
    waiting = list(lines)
    passes: list[Pass] = []
    while waiting:
        line = waiting.pop(0)
        start = int(np.argmax(line.rows[:, POSITION] @ toward))
        if passes:
            start = _gate(line, waiting, start)
        passes.append(_walk(line, start, waiting, spacing, longest))
    return passes


def _gate(line: Line, waiting: list[Line], otherwise: int) -> int:
    """Row of a line that is nearest to a line of the next level, so that it can go on."""
    best, row = np.inf, otherwise
    for other in waiting:
        if other.level != line.level + 1 or other.component != line.component:
            continue
        for n in range(0, len(line.rows), 3):
            distance = nearest_on(other.rows, other.closed, line.rows[n])[0]
            if distance < best:
                best, row = distance, n
    return row


def _walk(line: Line, start: int, waiting: list[Line], spacing: float, longest: float) -> Pass:
    """Build one pass from a row of a line, taking what it can reach from `waiting`."""
    segment, place, forward = start, 0.0, True
    if not line.closed:
        forward = start < len(line.rows) / 2
    pieces: list[Floats] = []
    trend = 0
    while True:
        if line.closed:
            # no link fills the slot at the very first loop: it is left narrower
            gap = spacing if pieces else 0.6 * spacing
            rows = unroll(line.rows, segment, place, forward, gap)
        else:
            rows = line.rows if forward else line.rows[::-1]
        found = _nearest(rows[-1], line, waiting, longest, trend)
        if found is None:
            if line.closed:
                rows = unroll(line.rows, segment, place, forward, 0.0)
            pieces.append(rows)
            break
        pieces.append(rows)
        n, segment, place = found
        before = line
        line = waiting.pop(n)
        trend = trend or _slope(before, line, longest)
        if line.closed:
            forward = not forward if before.closed else forward
        else:
            forward = segment == 0 and place < 0.5
    alone = len(pieces) == 1 and line.closed
    return Pass(np.concatenate(pieces), alone)


def _nearest(
    row: Floats, line: Line, waiting: list[Line], longest: float, trend: int
) -> tuple[int, int, float] | None:
    """Find the line to go on with: its index, and where it is to be entered."""
    best, found = longest, None
    for n, other in enumerate(waiting):
        if other.level > line.level + 1:
            break
        if other.level < line.level - 1 or other.component != line.component:
            continue
        if trend * _slope(line, other, longest) < 0:
            continue
        if other.closed:
            distance, segment, place = nearest_on(other.rows, True, row)
        else:
            distance, segment, place = _nearest_end(other.rows, row)
        if distance < best:
            best, found = distance, (n, int(segment), float(place))
    return found


def _slope(line: Line, other: Line, longest: float) -> int:
    """Tell whether a line lies higher (1) or lower (-1) than the one before, or about level."""
    z = POSITION.start + 2
    rise = float(other.rows[:, z].mean() - line.rows[:, z].mean())
    return int(np.sign(rise)) if abs(rise) > LEVEL_RATIO * longest else 0


def _nearest_end(rows: Floats, row: Floats) -> tuple[float, int, float]:
    head = float(np.linalg.norm(rows[0, POSITION] - row[POSITION]))
    tail = float(np.linalg.norm(rows[-1, POSITION] - row[POSITION]))
    return (head, 0, 0.0) if head <= tail else (tail, len(rows) - 2, 1.0)


def pass_length(item: Pass) -> float:
    """Length of a pass [mm]."""
    return float(line_length(item.rows, False))


def link_lines(
    loops: list[Line],
    lines: list[Line],
    guides: list[Line],
    spacing: float,
    longest: float,
    toward: Floats,
) -> list[Pass]:
    """Join the rim's loops and the lines inside them into passes, back and forth.

    Args:
        loops: Loops along the rim.
        lines: Lines inside.
        guides: Curves that longer links follow.
        spacing: Distance between lines [mm].
        longest: Longest link [mm].
        toward: Horizontal direction in which the first pass starts, shape (3,).

    Returns:
        Passes in order.
    """
    passes = link_loops(loops, spacing, longest, toward)
    waiting = list(lines)
    at = passes[-1].rows[-1] if passes else None
    while waiting:
        n, forward, _ = _closest_end(waiting, at)
        pieces: list[Floats] = []
        while True:
            line = waiting.pop(n)
            rows = line.rows
            if line.closed:
                rows = unroll(rows, 0, 0.0, True, 0.0)
            pieces.append(rows if forward else rows[::-1])
            at = pieces[-1][-1]
            if not waiting:
                break
            n, forward, distance = _closest_end(waiting, at)
            if distance > longest or waiting[n].component != line.component:
                break
            if distance > 2 * spacing:
                target = waiting[n].rows[0 if forward else -1]
                pieces.append(_along_guide(guides, at, target))
        passes.append(Pass(np.concatenate(pieces), False))
    return passes


def _closest_end(lines: list[Line], at: Floats | None) -> tuple[int, bool, float]:
    """Find the line with the end nearest to a row, and whether that is its head."""
    if at is None:
        return 0, True, 0.0
    heads = np.array([line.rows[0, POSITION] for line in lines])
    tails = np.array([line.rows[-1, POSITION] for line in lines])
    head = np.linalg.norm(heads - at[POSITION], axis=1)
    tail = np.linalg.norm(tails - at[POSITION], axis=1)
    n = int(np.argmin(np.minimum(head, tail)))
    return n, bool(head[n] <= tail[n]), float(min(head[n], tail[n]))


def _along_guide(guides: list[Line], a: Floats, b: Floats) -> Floats:
    """Rows of the guide curve between two rows, the shorter way; none without a guide."""
    best, rows = np.inf, a[None, :][:0]
    for guide in guides:
        x, i, _ = nearest_on(guide.rows, guide.closed, a)
        y, j, _ = nearest_on(guide.rows, guide.closed, b)
        if max(x, y) >= best:
            continue
        best = max(x, y)
        n = len(guide.rows)
        if not guide.closed:
            rows = guide.rows[i + 1 : j + 1] if i <= j else guide.rows[j + 1 : i + 1][::-1]
            continue
        up = np.arange(i + 1, i + 1 + (j - i) % n) % n
        down = np.arange(i, i - (i - j) % n, -1) % n
        rows = guide.rows[up if len(up) <= len(down) else down]
    return rows
