# SPDX-License-Identifier: Apache-2.0
"""Turn the nozzle where it collides: the smoothest clear way through a table of directions.

Along a stretch around the colliding waypoints, many directions are held against what is
there at each moment. Of all sequences of clear directions the one is taken that turns
least and stays nearest to what was planned (dynamic programming), and then smoothed as far
as it stays clear.
"""

from __future__ import annotations

import itertools

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.printability.collisions import Surroundings
from vega_planner.toolpaths.travel import slerp

#: Stretches reach this far beyond the colliding waypoints, and are joined within it [mm].
RAMP_MM = 4.0

#: Spacing of the stations at which directions are tried [mm], and most of them at a time.
STATION_MM, MOST_STATIONS = 0.6, 600

#: Clearance a station is content with [mm].
ENOUGH_MM = 0.02

#: Directions tried: tilts [deg] and azimuths; fewer for stretches of many stations.
FINE = ((6.0, 12.0, 18.0, 26.0, 36.0, 48.0, 62.0), 16)
COARSE = ((8.0, 16.0, 28.0, 44.0, 62.0), 12)
FEW_STATIONS = 250

#: What leaving the planned direction by 1 rad costs over 1 mm, against turning by 1 rad
#: within 1 mm; and what a touch costs.
_STAY, _TOUCH = 0.02, 1e3

#: Rounds of averaging neighbours.
_SMOOTHINGS = 4


def candidate_axes(max_tilt_deg: float, few: bool = False) -> Floats:
    """Directions tried for the nozzle, upright first, shape (k, 3)."""
    tilts, azimuths = COARSE if few else FINE
    axes = [(0.0, 0.0, 1.0)]
    for tilt in np.radians([t for t in tilts if t <= max_tilt_deg]):
        for turn in np.arange(azimuths) * (2 * np.pi / azimuths):
            axes.append((np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)))
    return np.array(axes)


def arc_length(points: Floats) -> Floats:
    """Distance along a polyline at its points [mm], shape (n,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def turned_clear(
    points: Floats,
    axes: Floats,
    hits: Ints,
    first: int,
    around: Surroundings,
    max_tilt_deg: float,
    fixed_ends: bool,
    budget: int,
) -> Floats:
    """Turn the nozzle around colliding waypoints of a pass or a move.

    Args:
        points: Tips [mm], shape (n, 3).
        axes: Unit axes as planned, shape (n, 3).
        hits: Colliding waypoints, rising.
        first: Number of waypoint 0 in the whole print.
        around: What is there at each moment.
        max_tilt_deg: Largest angle from the vertical.
        fixed_ends: Whether the first and the last axis have to stay.
        budget: Poses tried by `around` at which trying ends; the rest stays as it is.

    Returns:
        New unit axes, shape (n, 3).
    """
    along = arc_length(points)
    axes = axes.copy()
    for low, high in _stretches(along, hits):
        for begin, end in _parts(along, low, high):
            if around.tried >= budget:
                return axes
            at = _stations(along, begin, end, hits)
            _turn(points, axes, along, at, first, around, max_tilt_deg, fixed_ends)
    return axes


def _stretches(along: Floats, hits: Ints) -> list[tuple[int, int]]:
    """Index ranges around the hits, ramps included, joined where they meet."""
    found: list[tuple[int, int]] = []
    for hit in hits:
        low = int(np.searchsorted(along, along[hit] - RAMP_MM))
        high = int(np.searchsorted(along, along[hit] + RAMP_MM, side="right")) - 1
        if found and low <= found[-1][1]:
            found[-1] = (found[-1][0], max(high, found[-1][1]))
        else:
            found.append((low, high))
    return found


def _parts(along: Floats, low: int, high: int) -> list[tuple[int, int]]:
    """Cut a stretch that has too many stations."""
    count = int(np.ceil((along[high] - along[low]) / (STATION_MM * MOST_STATIONS)))
    if count <= 1:
        return [(low, high)]
    cuts = np.searchsorted(along, np.linspace(along[low], along[high], count + 1)[1:-1])
    edges = [low, *(int(cut) for cut in cuts), high]
    return [(a, b) for a, b in itertools.pairwise(edges) if b > a]


def _turn(
    points: Floats,
    axes: Floats,
    along: Floats,
    at: Ints,
    first: int,
    around: Surroundings,
    max_tilt_deg: float,
    fixed_ends: bool,
) -> None:
    last = len(points) - 1
    tries = candidate_axes(max_tilt_deg, few=len(at) > FEW_STATIONS)
    count = len(tries) + 1
    table = np.repeat(tries[None], len(at), axis=0)
    table = np.concatenate([axes[at][:, None], table], axis=1)  # (stations, count, 3)
    # at its last waypoint, the whole of a pass is there as the move begins
    number = first + at + ((at == last) & (not fixed_ends))
    free = np.array([around.is_free(first + int(k)) for k in at])
    gap = around.clearance(
        np.repeat(points[at], count, axis=0),
        table.reshape(-1, 3),
        np.repeat(free, count),
        np.repeat(number, count),
    ).reshape(len(at), count)
    held = np.zeros(len(at), np.bool_)
    held[0] = bool(at[0] > 0) or fixed_ends
    held[-1] = held[-1] or bool(at[-1] < last) or fixed_ends
    chosen = _best_way(table, gap, along[at], held)
    rows = np.arange(len(at))
    way = table[rows, chosen]
    clear = gap[rows, chosen] >= ENOUGH_MM
    way = _smooth(way, clear, held, points[at], free, number, around)
    for k in range(len(at) - 1):
        a, b = at[k], at[k + 1]
        share = (along[a : b + 1] - along[a]) / max(along[b] - along[a], 1e-12)
        axes[a : b + 1] = slerp(way[k], way[k + 1], share)
    axes[at] = way


def _stations(along: Floats, low: int, high: int, hits: Ints) -> Ints:
    """Both ends, every so often a waypoint between, and the hits that are not crowded."""
    hit = np.zeros(len(along), np.bool_)
    hit[hits] = True
    chosen = [low]
    for k in range(low + 1, high):
        gap = along[k + 1] - along[chosen[-1]]
        if gap > STATION_MM or (hit[k] and along[k] - along[chosen[-1]] > 0.25 * STATION_MM):
            chosen.append(k)
    if high > low:
        chosen.append(high)
    return np.array(chosen, np.int64)


def _best_way(table: Floats, gap: Floats, along: Floats, held: np.ndarray) -> Ints:
    """Choose a direction at each station: clear, near to the planned one, turning least."""
    cosine = np.clip(np.einsum("nki,ni->nk", table, table[:, 0]), -1.0, 1.0)
    step = np.maximum(np.diff(along), 0.05)
    share = np.concatenate([[step[0] if len(step) else 1.0], step])
    cost = _STAY * share[:, None] * np.arccos(cosine) ** 2
    depth = np.maximum(ENOUGH_MM - gap, 0.0)
    cost += np.where(depth > 0, _TOUCH * (1.0 + depth), 0.0)
    cost[held, 1:] = 1e9
    back = np.zeros(gap.shape, np.int64)
    total = cost[0]
    for k in range(1, len(table)):
        turn = np.arccos(np.clip(table[k] @ table[k - 1].T, -1.0, 1.0)) ** 2 / step[k - 1]
        sums = turn + total[None, :]
        back[k] = sums.argmin(1)
        total = sums[np.arange(len(sums)), back[k]] + cost[k]
    chosen = np.empty(len(table), np.int64)
    chosen[-1] = int(total.argmin())
    for k in range(len(table) - 1, 0, -1):
        chosen[k - 1] = back[k, chosen[k]]
    return chosen


def _smooth(
    way: Floats,
    clear: np.ndarray,
    held: np.ndarray,
    tips: Floats,
    free: np.ndarray,
    number: Ints,
    around: Surroundings,
) -> Floats:
    """Average neighbours where the result is as clear as before."""
    for _ in range(_SMOOTHINGS):
        if len(way) < 3:
            break
        mean = way.copy()
        mean[1:-1] = way[:-2] + 2.0 * way[1:-1] + way[2:]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        gap = around.clearance(tips, mean, free, number)
        good = (gap >= ENOUGH_MM) | ~clear
        good &= ~held
        way = np.where(good[:, None], mean, way)
    return way
