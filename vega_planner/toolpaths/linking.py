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

    Each piece of the patch begins at one side with its rim, which is opened there, and
    goes on with the line next to it, so that it ends at the other side.

    Args:
        loops: Loops along the rim.
        lines: Lines inside.
        guides: Curves that longer links follow.
        spacing: Distance between lines [mm].
        longest: Longest link [mm].
        toward: Horizontal direction in which loops without lines inside start, shape (3,).

    Returns:
        Passes in order.
    """
    rims, waiting = list(loops), list(lines)
    passes: list[Pass] = []
    at: Floats | None = None
    while waiting:
        n, forward = _first_line(waiting, at)
        pieces: list[Floats] = []
        head = waiting[n].rows[0 if forward else -1]
        rim = _opened_rim(rims, waiting[n].component, head, spacing, longest)
        if rim is not None:
            pieces.append(rim)
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
    return link_loops(rims, spacing, longest, toward) + passes


def _first_line(lines: list[Line], at: Floats | None) -> tuple[int, bool]:
    """Choose a line at a side of what is left, and whether it is walked from its head."""
    side = []
    for piece in {line.component for line in lines}:
        levels = [line.level for line in lines if line.component == piece]
        side += [
            n
            for n, line in enumerate(lines)
            if line.component == piece and line.level in (min(levels), max(levels))
        ]
    side.sort()
    if at is None:
        lowest = min(side, key=lambda n: (lines[n].component, lines[n].level))
        return lowest, True
    n, forward, _ = _closest_end([lines[k] for k in side], at)
    return side[n], forward


def _opened_rim(
    rims: list[Line], component: int, head: Floats, spacing: float, longest: float
) -> Floats | None:
    """Take the loop nearest to the head of a line, opened there, out of the list."""
    best, found = longest, None
    for n, rim in enumerate(rims):
        if rim.component != component or not rim.closed:
            continue
        distance, segment, place = nearest_on(rim.rows, True, head)
        if distance < best:
            best, found = distance, (n, int(segment), float(place))
    if found is None:
        return None
    n, segment, place = found
    # no link fills the slot where the loop starts: it is left narrower
    return unroll(rims.pop(n).rows, segment, place, True, 0.0 * spacing)


def attach_lines(
    passes: list[Pass], lines: list[Line], longest: float, alone: float
) -> list[Pass]:
    """Put short lines at the ends of passes where they are near enough, else on their own.

    Args:
        passes: Passes, none of them closed.
        lines: Open lines.
        longest: Longest link [mm].
        alone: A line that is near no end of a pass is left out if it is shorter [mm].

    Returns:
        The passes, some of them longer, and new ones.
    """
    result = list(passes)
    waiting = list(lines)
    while waiting:
        best: tuple[float, int, int, bool, bool] | None = None
        for k, item in enumerate(result):
            if item.closed:
                continue
            for at_end in (True, False):
                n, forward, distance = _closest_end(waiting, item.rows[-1 if at_end else 0])
                if distance < longest and (best is None or distance < best[0]):
                    best = (distance, k, n, at_end, forward)
        if best is None:
            line = waiting.pop(0)
            if line_length(line.rows, False) >= alone:
                result.append(Pass(line.rows, False))
            continue
        _, k, n, at_end, forward = best
        rows = waiting.pop(n).rows
        rows = rows if forward else rows[::-1]
        pieces = [result[k].rows, rows] if at_end else [rows[::-1], result[k].rows]
        result[k] = Pass(np.concatenate(pieces), False)
    return result


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
