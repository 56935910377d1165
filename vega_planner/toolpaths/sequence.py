# SPDX-License-Identifier: Apache-2.0
"""Order and direction of the passes of a patch with the shortest way between them.

For a few passes the best order is found exactly.

Source: M. Held and R. M. Karp, "A Dynamic Programming Approach to Sequencing Problems",
J. SIAM 10(1), 1962.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.toolpaths.isolines import POSITION
from vega_planner.toolpaths.linking import Pass

#: Up to so many passes the best order is found; for more, the nearest is next.
_EXACT = 8


def shortest_sequence(passes: list[Pass], at: Floats | None) -> list[tuple[int, bool]]:
    """Choose in what order and in which direction passes are laid.

    Args:
        passes: Passes of one patch.
        at: Where the tip is before [mm], shape (3,); anywhere when absent.

    Returns:
        Indices in order, each with True where the pass is walked backwards.
    """
    if not passes:
        return []
    ends = np.array([item.rows[[0, -1], POSITION] for item in passes])
    if len(passes) > _EXACT:
        return _nearest_next(ends, at)
    return _best(ends, at)


def _nearest_next(ends: Floats, at: Floats | None) -> list[tuple[int, bool]]:
    waiting = list(range(len(ends)))
    result: list[tuple[int, bool]] = []
    while waiting:
        k, backwards = 0, False
        if at is not None:
            away = np.linalg.norm(ends[waiting] - at, axis=2)
            k = int(np.argmin(away.min(1)))
            backwards = bool(away[k, 1] < away[k, 0])
        n = waiting.pop(k)
        result.append((n, backwards))
        at = ends[n, 0 if backwards else 1]
    return result


def _best(ends: Floats, at: Floats | None) -> list[tuple[int, bool]]:
    """Least length over all orders and directions, by the set of what is laid already."""
    n = len(ends)
    # state 2 k + d: pass k is the last one, walked backwards where d = 1
    entry, leave = ends.reshape(-1, 3), ends[:, ::-1].reshape(-1, 3)
    between = np.linalg.norm(leave[:, None] - entry[None], axis=2).tolist()
    first = [0.0] * (2 * n)
    if at is not None:
        first = np.linalg.norm(entry - at, axis=1).tolist()
    cost: list[dict[int, float]] = [{} for _ in range(1 << n)]
    came: list[dict[int, int]] = [{} for _ in range(1 << n)]
    for state in range(2 * n):
        cost[1 << (state // 2)][state] = first[state]
    for done in range(1, 1 << n):
        for state, length in cost[done].items():
            row = between[state]
            for after in range(2 * n):
                bit = 1 << (after // 2)
                if done & bit:
                    continue
                total = length + row[after]
                known = cost[done | bit]
                if total < known.get(after, np.inf) - 1e-9:
                    known[after] = total
                    came[done | bit][after] = state
    done = (1 << n) - 1
    state = min(cost[done], key=lambda s: (cost[done][s], s))
    result = []
    while True:
        result.append((state // 2, bool(state % 2)))
        before = came[done].get(state)
        if before is None:
            return result[::-1]
        done ^= 1 << (state // 2)
        state = before
