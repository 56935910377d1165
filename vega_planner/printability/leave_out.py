# SPDX-License-Identifier: Apache-2.0
"""Leave out the little that cannot be laid without touching, and say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Part, Toolpath, ToolpathSet, Travel
from vega_planner.printability.collisions import CollisionCheck
from vega_planner.toolpaths.coverage import deposited_volume

#: Volume over the part's that may be left out for the rest to be printed.
MOST_RATIO = 0.001


def leave_out(
    toolpaths: ToolpathSet, check: CollisionCheck, part: Part
) -> tuple[ToolpathSet, np.ndarray] | None:
    """Cut the colliding stretches out of the passes, where they are next to nothing.

    Args:
        toolpaths: Passes and travel.
        check: The check of them.
        part: The part, for its volume.

    Returns:
        The toolpaths with a warning that tells what is left out, and the indices of the
        moves that have to be found anew: those that bridge a cut are straight. None where
        nothing collides while printing, or the stretches hold more than `MOST_RATIO` of
        the part.
    """
    bad = check.of_passes(toolpaths)
    if not any(len(hit) for hit in bad):
        return None
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
    if not passes:
        return None
    travels.append(toolpaths.travels[-1] if same else None)
    lost = deposited_volume(toolpaths.passes) - deposited_volume(passes)
    if lost > MOST_RATIO * part.volume:
        return None
    warning = (
        f"{lost:.3g} mm³ of bead, {100 * lost / part.volume:.2g} % of the part, cannot be laid "
        "without touching what is there, and is left out"
    )
    anew = np.array([n for n, move in enumerate(travels) if move is None], np.int64)
    moves = tuple(
        move if move is not None else _bridge(passes, n, toolpaths)
        for n, move in enumerate(travels)
    )
    warnings = (*toolpaths.warnings, warning)
    return ToolpathSet(tuple(passes), moves, warnings), anew


def _pieces(path: Toolpath, hit: np.ndarray) -> list[Toolpath]:
    """Cut a pass at its colliding waypoints; what is left of less than two points goes."""
    if not len(hit):
        return [path]
    kept = np.ones(len(path.points), np.bool_)
    kept[hit] = False
    index = np.flatnonzero(kept)
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    return [
        replace(
            path, points=path.points[run], axes=path.axes[run], width=path.width[run],
            height=path.height[run], closed=False,
        )
        for run in runs
        if len(run) >= 2
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
