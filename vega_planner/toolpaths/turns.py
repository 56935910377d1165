# SPDX-License-Identifier: Apache-2.0
"""Ends of parallel lines, bent into the holes that the lines leave beside the rim's loop.

Where two neighbouring lines end at a loop and no link joins them there, a hole stays
between the two ends and the loop: the wider, the flatter the lines meet the loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, row_lengths
from vega_planner.toolpaths.carrier import Carrier
from vega_planner.toolpaths.coverage_kernels import distance_to_segments
from vega_planner.toolpaths.isolines import AXIS, CELL, NORMAL, POSITION, RIM, Line
from vega_planner.toolpaths.linking import Pass
from vega_planner.toolpaths.segment_cells import cells_around

#: An end is moved as long as a circle of this radius fits in beside it, in spacings: a
#: little less than half of the widest gap that is allowed.
_RADIUS = 0.54

#: It is moved by this at a time, and by so much at most, in spacings.
_STEP, _FARTHEST = 0.08, 1.3

#: The line is bent over this many times what its end is moved, but no less than so many
#: spacings: bent over more, the two sides of a turn would part.
_BENT, _LEAST_BENT = 2.0, 0.35

#: Directions in which a circle is looked for.
_DIRECTIONS = 40

#: A circle whose middle is nearer to the rim than this, in spacings, lies outside the loop.
_INSIDE = 0.9

#: What a line gains in length by its bend, it gives back in width, down to this part of it.
_NARROWEST = 0.65


def bend_ends(
    passes: list[Pass], lines: list[Line], carrier: Carrier, spacing: float
) -> list[Pass]:
    """Bend the ends of lines into the holes beside them.

    Args:
        passes: What is laid, the lines among it.
        lines: Lines whose ends may be moved.
        carrier: What lines carry on the patch.
        spacing: Spacing of the lines [mm].

    Returns:
        The passes, with as many rows as before.
    """
    if not passes:
        return passes
    rows = np.concatenate([item.rows for item in passes])
    begin = np.cumsum([0] + [len(item.rows) for item in passes])
    ends = _ends_of(rows, begin, lines, _BENT * _FARTHEST * spacing)
    moved = np.zeros((len(ends.row), 3))
    wide: Ints = np.arange(len(moved))
    for _ in range(round(2 * _FARTHEST / _STEP)):
        if not len(wide):
            break
        position = ends.bent(rows, moved, spacing)
        at = ends.row[wide]
        way = _ways_out(position, begin, at, rows[at, NORMAL], carrier, spacing)
        going = (way != 0.0).any(1) & (row_lengths(moved[wide]) < _FARTHEST * spacing)
        wide = wide[going]
        moved[wide] += _STEP * spacing * way[going]
    position = ends.bent(rows, moved, spacing)
    changed = np.flatnonzero((position != rows[:, POSITION]).any(1))
    if not len(changed):
        return passes
    rows[:, CELL] *= ends.thinned(rows, position, moved, spacing)
    rows[changed] = _moved_rows(rows[changed], position[changed], carrier)
    return [Pass(rows[a:b], item.closed) for a, b, item in zip(begin, begin[1:], passes)]


@dataclass(frozen=True, eq=False)
class _Ends:
    """Ends of lines in the rows of all passes, and the pieces of the lines before them.

    Attributes:
        row: Row of each end, shape (k,).
        beyond: Row on the other side of it, where a link goes on, else the same, (k,).
        owner: End that each place of a piece belongs to, shape (m,).
        place: Its row, shape (m,).
        walked: Its distance from the end along the line [mm], shape (m,).
    """

    row: Ints
    beyond: Ints
    owner: Ints
    place: Ints
    walked: Floats

    def bent(self, rows: Floats, moved: Floats, spacing: float) -> Floats:
        """Positions of all rows when ends have moved, each with the piece before it."""
        weight = self._weight(moved, spacing)
        some = np.flatnonzero(weight)
        place, shift = self.place[some], moved[self.owner[some]]
        normal = rows[place, NORMAL]
        normal = normal / row_lengths(normal)[:, None]
        shift = shift - np.einsum("ij,ij->i", normal, shift)[:, None] * normal
        position: Floats = rows[:, POSITION].copy()
        np.add.at(position, place, weight[some, None] * shift)
        return position

    def thinned(self, rows: Floats, after: Floats, moved: Floats, spacing: float) -> Floats:
        """Factor on the width of each row that makes up for what was gained in length."""
        before = rows[:, POSITION]
        weight = self._weight(moved, spacing)
        same = np.flatnonzero(np.diff(self.owner) == 0)
        i, j = self.place[same], self.place[same + 1]
        mean = 0.5 * (weight[same] + weight[same + 1])
        step = row_lengths(after[j] - after[i])
        longer = step - row_lengths(before[j] - before[i])
        count = len(self.row)
        gain = np.asarray(np.bincount(self.owner[same], longer, count), np.float64)
        room = np.asarray(np.bincount(self.owner[same], mean * step, count), np.float64)
        link = row_lengths(after[self.beyond] - after[self.row])
        part = np.where(np.isin(self.beyond, self.row), 0.5, 1.0)
        gain += part * (link - row_lengths(before[self.beyond] - before[self.row]))
        room += 0.5 * link
        loss = np.clip(gain / np.maximum(room, 1e-9), 0.0, 1.0 - _NARROWEST)
        factor = np.ones(len(rows))
        np.minimum.at(factor, self.place, 1.0 - weight * loss[self.owner])
        return factor

    def _weight(self, moved: Floats, spacing: float) -> Floats:
        """How far each place of a piece goes with its end, 0..1."""
        size = row_lengths(moved)
        reach = np.maximum(_BENT * size, _LEAST_BENT * spacing)
        weight = np.maximum(1.0 - self.walked / reach[self.owner], 0.0) ** 2
        return np.where(size[self.owner] > 0.0, weight, 0.0)


def _ends_of(rows: Floats, begin: Ints, lines: list[Line], reach: float) -> _Ends:
    """Find the ends of lines in the passes they became part of."""
    at = {row.tobytes(): n for n, row in enumerate(np.ascontiguousarray(rows[:, POSITION]))}
    row: list[int] = []
    beyond: list[int] = []
    owner: list[Ints] = []
    place: list[Ints] = []
    walked: list[Floats] = []
    for line in lines:
        first = at.get(line.rows[0, POSITION].tobytes())
        last = at.get(line.rows[-1, POSITION].tobytes())
        if line.closed or first is None or last is None:
            continue
        item = int(np.searchsorted(begin, first, side="right")) - 1
        if not begin[item] <= last < begin[item + 1]:
            continue
        for a, b in ((first, last), (last, first)):
            step = 1 if b > a else -1
            piece = np.arange(a, b + step, step)
            length = row_lengths(np.diff(rows[piece, POSITION], axis=0))
            way = np.append(0.0, np.cumsum(length))
            count = int(np.searchsorted(way, reach))
            owner.append(np.full(count, len(row)))
            place.append(piece[:count])
            walked.append(way[:count])
            row.append(a)
            beyond.append(int(np.clip(a - step, begin[item], begin[item + 1] - 1)))
    none = np.zeros(0, np.int64)
    return _Ends(
        np.array(row, np.int64),
        np.array(beyond, np.int64),
        np.concatenate([none, *owner]),
        np.concatenate([none, *place]),
        np.concatenate([np.zeros(0), *walked]),
    )


def _ways_out(
    position: Floats, begin: Ints, at: Ints, normals: Floats, carrier: Carrier, spacing: float
) -> Floats:
    """Unit direction from some rows to the middle of the hole beside each, else zero, (k, 3)."""
    radius = _RADIUS * spacing
    inner = np.ones(len(position) - 1, np.bool_)
    inner[begin[1:-1] - 1] = False
    a, b = position[:-1][inner], position[1:][inner]
    size = 1.1 * radius
    cells = cells_around(a, b, size)
    normals = normals / row_lengths(normals)[:, None]
    u = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    u /= row_lengths(u)[:, None]
    v = np.cross(normals, u)
    turn = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ways = np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * v[:, None]
    centres = (position[at][:, None] + radius * ways).reshape(-1, 3)
    free = np.flatnonzero(distance_to_segments(centres, a, b, *cells) > 0.99 * radius)
    if len(free):
        free = free[carrier.column(centres[free], RIM) > _INSIDE * spacing]
    owner = free // _DIRECTIONS
    flat = ways.reshape(-1, 3)
    out = np.zeros((len(at), 3))
    # where holes lie on opposite sides, the first of their directions decides
    out[owner[::-1]] = 1e-3 * flat[free[::-1]]
    np.add.at(out, owner, flat[free])
    return out / np.maximum(row_lengths(out), 1e-12)[:, None]


def _moved_rows(rows: Floats, position: Floats, carrier: Carrier) -> Floats:
    """Rows at other places near by, with what the patch has there."""
    cell = rows[:, CELL]
    moved = rows + carrier.rows(position, cell) - carrier.rows(rows[:, POSITION], cell)
    moved[:, POSITION], moved[:, CELL] = position, cell
    moved[:, AXIS] /= row_lengths(moved[:, AXIS])[:, None]
    return np.asarray(moved)
