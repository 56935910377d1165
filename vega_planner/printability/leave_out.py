# SPDX-License-Identifier: Apache-2.0
"""Leave out the little that cannot be laid without touching, and say so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Ints, Part, Toolpath, ToolpathSet, Travel
from vega_planner.printability.collisions import NEXT_TO_NOTHING, CollisionCheck
from vega_planner.printability.turning import arc_length
from vega_planner.toolpaths.coverage import deposited_volume

#: How much of a pass goes where the move to or from it finds no way, time after time [mm].
TRIMS_MM = (0.0, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 1e9)

#: What is left between two cuts goes too where it is shorter than this, in bead widths.
SHORTEST_WIDTHS = 1.0


def leave_out(
    toolpaths: ToolpathSet, check: CollisionCheck, part: Part, most: float = NEXT_TO_NOTHING
) -> tuple[ToolpathSet, Ints] | None:
    """Cut the colliding stretches out of the passes, where they are next to nothing.

    Args:
        toolpaths: Passes and travel.
        check: The check of them.
        part: The part, for its volume.
        most: Volume over the part's that may be left out.

    Returns:
        The toolpaths with a warning that tells what is left out, and the indices of the
        moves that have to be found anew: those that bridge a cut are straight. None where
        nothing collides while printing, or the stretches hold more than allowed.
    """
    bad = check.of_passes(toolpaths)
    if not any(len(hit) for hit in bad):
        return None
    less, anew = _without(toolpaths, bad)
    ratio = left_out_ratio(toolpaths, less, part)
    if not less.passes or ratio > most:
        return None
    return _told(less, ratio, part), anew


def leave_out_everything(
    toolpaths: ToolpathSet,
    check: CollisionCheck,
    part: Part,
    settle: Callable[[ToolpathSet, Ints], tuple[ToolpathSet, CollisionCheck]],
) -> tuple[ToolpathSet, CollisionCheck]:
    """Leave out what collides until nothing does, however much it is.

    Where a move finds no clear way, the pass at the end that is in the way gets shorter,
    at first a little and then more and more.

    Args:
        toolpaths: Passes and travel.
        check: The check of them.
        part: The part, for its volume.
        settle: Finds new moves of given numbers and checks all anew.

    Returns:
        The toolpaths with a warning that tells what is left out, and their check.
    """
    less, found = toolpaths, check
    for trim in TRIMS_MM:
        if not found.colliding:
            break
        bad = found.of_passes(less)
        for number, end in _blocked_ends(less, found):
            path = less.passes[number]
            along = arc_length(path.points)
            away = along if end == 0 else along[-1] - along
            bad[number] = np.union1d(bad[number], np.flatnonzero(away <= trim))
        shorter, anew = _without(less, bad)
        if not shorter.passes:
            return toolpaths, check
        less, found = settle(shorter, anew)
    if found.colliding and found.colliding >= check.colliding:
        return toolpaths, check
    ratio = left_out_ratio(toolpaths, less, part)
    return _told(less, ratio, part), found


def left_out_ratio(before: ToolpathSet, after: ToolpathSet, part: Part) -> float:
    """Volume that is deposited no more, over the part's."""
    lost = deposited_volume(before.passes) - deposited_volume(after.passes)
    return max(0.0, lost / part.volume)


def _told(toolpaths: ToolpathSet, ratio: float, part: Part) -> ToolpathSet:
    if ratio <= 0.0:
        return toolpaths
    warning = (
        f"{ratio * part.volume:.3g} mm³ of bead, {100 * ratio:.2g} % of the part, cannot be laid "
        "without touching what is there, and is left out"
    )
    return replace(toolpaths, warnings=(*toolpaths.warnings, warning))


def _blocked_ends(toolpaths: ToolpathSet, check: CollisionCheck) -> list[tuple[int, int]]:
    """Ends of passes, 0 or -1, near which a move collides that has no other way."""
    ends = set()
    for number, hit in check.of_travels().items():
        along = arc_length(toolpaths.travels[number].points)
        for k in hit:
            late = along[k] > 0.5 * along[-1]
            if (late or number == 0) and number < len(toolpaths.passes):
                ends.add((number, 0))
            elif number > 0:
                ends.add((number - 1, -1))
    return sorted(ends)


def _without(toolpaths: ToolpathSet, bad: Sequence[Ints]) -> tuple[ToolpathSet, Ints]:
    """Cut waypoints out of the passes; which moves have to be found anew."""
    passes: list[Toolpath] = []
    travels: list[Travel | None] = []
    same = True  # the move before the next pass is as it was
    for path, move, hit in zip(toolpaths.passes, toolpaths.travels, bad):
        for piece in _pieces(path, hit):
            whole_start = same and np.array_equal(piece.points[0], path.points[0])
            travels.append(move if whole_start else None)
            passes.append(piece)
            same = False
        same = bool(passes) and np.array_equal(passes[-1].points[-1], path.points[-1])
    travels.append(toolpaths.travels[-1] if same else None)
    anew = np.array([n for n, move in enumerate(travels) if move is None], np.int64)
    moves = tuple(
        move if move is not None else _bridge(passes, n, toolpaths)
        for n, move in enumerate(travels)
    )
    return ToolpathSet(tuple(passes), moves, toolpaths.warnings), anew


def _pieces(path: Toolpath, hit: Ints) -> list[Toolpath]:
    """Cut a pass at its colliding waypoints; crumbs between go too."""
    if not len(hit):
        return [path]
    kept = np.ones(len(path.points), np.bool_)
    kept[hit] = False
    index = np.flatnonzero(kept)
    along = arc_length(path.points)
    shortest = SHORTEST_WIDTHS * float(path.width.mean())
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    return [
        replace(
            path, points=path.points[run], axes=path.axes[run], width=path.width[run],
            height=path.height[run], closed=False,
        )
        for run in runs
        if len(run) >= 2 and along[run[-1]] - along[run[0]] >= shortest
    ]  # fmt: skip


def _bridge(passes: list[Toolpath], number: int, toolpaths: ToolpathSet) -> Travel:
    """Join the passes beside a move, as straight as can be, for it to be found anew."""
    first, last = toolpaths.travels[0], toolpaths.travels[-1]
    start = (first.points[0], first.axes[0])
    end = (last.points[-1], last.axes[-1])
    if number > 0:
        start = (passes[number - 1].points[-1], passes[number - 1].axes[-1])
    if number < len(passes):
        end = (passes[number].points[0], passes[number].axes[0])
    return Travel(np.array([start[0], end[0]]), np.array([start[1], end[1]]))
