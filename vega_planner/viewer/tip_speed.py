# SPDX-License-Identifier: Apache-2.0
"""How fast the tip moves along each pass, from the motion of the joints."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints

#: Keeps the end of one pass before the start of the next on the common axis.
_INSIDE = 1.0 - 1e-9


def tip_speeds(
    points: Floats, path_id: Ints, tips: Floats, times: Floats, sample_path: Ints
) -> Floats:
    """Find the speed at the points of a toolpath.

    Toolpath and trajectory are matched pass by pass, by the share of the pass's length.

    Args:
        points: Waypoints [mm], shape (n, 3).
        path_id: Pass of each, -1 on travel, shape (n,).
        tips: Tip at each sample of the trajectory [mm], any frame, shape (k, 3).
        times: Times of the samples [s], strictly rising, shape (k,).
        sample_path: Pass of each sample, -1 on travel, shape (k,).

    Returns:
        Speeds [mm/s], shape (n,); 0 on travel and where the trajectory lacks the pass.
    """
    speeds = np.zeros(len(points))
    rows, samples = path_id >= 0, sample_path >= 0
    if not rows.any() or not samples.any():
        return speeds
    step = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(times)
    # A sample belongs to the interval before it and to the one after it.
    inner = sample_path[1:] == sample_path[:-1]
    before = np.concatenate([[False], inner])
    after = np.concatenate([inner, [False]])
    padded = np.concatenate([[0.0], step, [0.0]])
    total = np.where(before, padded[:-1], 0.0) + np.where(after, padded[1:], 0.0)
    at_samples = total / np.maximum(before.astype(float) + after, 1.0)
    speeds[rows] = np.interp(
        _places(points, path_id, rows), _places(tips, sample_path, samples), at_samples[samples]
    )
    speeds[rows & ~np.isin(path_id, sample_path)] = 0.0
    return speeds


def _places(points: Floats, path_id: Ints, chosen: Bools) -> Floats:
    """Number of the pass, plus the share of it that lies behind; not falling."""
    ids = path_id[chosen]
    length = np.linalg.norm(np.diff(points[chosen], axis=0), axis=1)
    length = np.where(ids[1:] == ids[:-1], length, 0.0)
    way = np.concatenate([[0.0], np.cumsum(length)])
    first = np.searchsorted(ids, ids, side="left")
    last = np.searchsorted(ids, ids, side="right") - 1
    whole = way[last] - way[first]
    share = (way - way[first]) / np.where(whole > 0, whole, 1.0)
    return np.asarray(ids + _INSIDE * share, dtype=np.float64)
