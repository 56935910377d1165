# SPDX-License-Identifier: Apache-2.0
"""Where a print stands at a time: row of the toolpath, joints, dispenser."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints

#: Added to the length per row [mm], so that equal points still have an order.
_TICK_MM = 1e-6


@dataclass(frozen=True)
class Moment:
    """A print at one time.

    Attributes:
        row: Last row of the toolpath that is reached.
        tip: Position of the tip [mm], part frame.
        axis: Unit vector from the tip back along the nozzle.
        layer: Layer of the pass, or the one to come on travel.
        path: Index of the pass, -1 on travel.
        dispensing: True while material is laid.
        joints: Joint positions [m, rad] by name; empty without a trajectory.
    """

    row: int
    tip: tuple[float, float, float]
    axis: tuple[float, float, float]
    layer: int
    path: int
    dispensing: bool
    joints: dict[str, float]


@dataclass(frozen=True, eq=False)
class Timeline:
    """A toolpath over time.

    Attributes:
        points: Tip positions [mm] in the part frame, shape (n, 3).
        axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
        layer: Layer of each row, shape (n,).
        path_id: Pass of each row, -1 on travel, shape (n,).
        extrude: True where a bead ends at the row, shape (n,).
        times: Time at which the tip is at each row [s], rising, shape (n,).
        joint_names: Names of the joints, length j.
        joint_times: Times of the trajectory's samples [s], shape (k,).
        joint_positions: Joint positions [m, rad], shape (k, j).
        joint_path: Pass of each sample, -1 on travel, shape (k,).
    """

    points: Floats
    axes: Floats
    layer: Ints
    path_id: Ints
    extrude: Bools
    times: Floats
    joint_names: tuple[str, ...]
    joint_times: Floats
    joint_positions: Floats
    joint_path: Ints

    @property
    def duration_s(self) -> float:
        """Time of the last row [s]."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @cached_property
    def layer_starts(self) -> dict[int, float]:
        """Time at which each layer is begun [s], by layer."""
        printing = np.flatnonzero(self.path_id >= 0)
        layers, first = np.unique(self.layer[printing], return_index=True)
        return {int(n): float(self.times[printing[i]]) for n, i in zip(layers, first, strict=True)}

    def at(self, time_s: float) -> Moment:
        """Tell where the print stands.

        Args:
            time_s: Time from the start; held between 0 and the duration.
        """
        last = len(self.times) - 1
        row = int(np.clip(np.searchsorted(self.times, time_s, side="right") - 1, 0, last))
        after = min(row + 1, last)
        gap = self.times[after] - self.times[row]
        share = float(np.clip((time_s - self.times[row]) / gap, 0, 1)) if gap > 0 else 0.0
        tip = self.points[row] + share * (self.points[after] - self.points[row])
        axis = self.axes[row] + share * (self.axes[after] - self.axes[row])
        axis = axis / (np.linalg.norm(axis) or 1.0)
        dispensing = bool(self.extrude[after]) and 0.0 < time_s < self.duration_s
        return Moment(
            row=row,
            tip=(float(tip[0]), float(tip[1]), float(tip[2])),
            axis=(float(axis[0]), float(axis[1]), float(axis[2])),
            layer=int(self.layer[after]),
            path=int(self.path_id[after] if dispensing else self.path_id[row]),
            dispensing=dispensing,
            joints=self._joints(time_s),
        )

    def _joints(self, time_s: float) -> dict[str, float]:
        times = self.joint_times
        if not len(times):
            return {}
        after = int(np.clip(np.searchsorted(times, time_s), 1, max(len(times) - 1, 1)))
        before = after - 1 if len(times) > 1 else 0
        after = min(after, len(times) - 1)
        gap = times[after] - times[before]
        share = float(np.clip((time_s - times[before]) / gap, 0, 1)) if gap > 0 else 0.0
        start, end = self.joint_positions[before], self.joint_positions[after]
        return dict(zip(self.joint_names, (start + share * (end - start)).tolist()))


def row_times(
    points: Floats, path_id: Ints, sample_times: Floats, sample_path: Ints, duration_s: float
) -> Floats:
    """Find the time at which the tip passes each row of a toolpath.

    The trajectory says when each pass begins and ends; in between, and on travel, the
    rows are placed by the length of the way.

    Args:
        points: Tip positions of the rows [mm], shape (n, 3).
        path_id: Pass of each row, -1 on travel, shape (n,).
        sample_times: Times of the trajectory [s], shape (k,).
        sample_path: Pass of each sample, -1 on travel, shape (k,).
        duration_s: Time at the last row where the trajectory has no samples [s].

    Returns:
        Times [s], not falling, shape (n,).
    """
    count = len(points)
    if count == 0:
        return np.zeros(0)
    way = np.zeros(count)
    way[1:] = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))
    way += _TICK_MM * np.arange(count)
    end = float(sample_times[-1]) if len(sample_times) else duration_s
    passes, row_first, row_last = _extents(path_id)
    found, sample_first, sample_last = _extents(sample_path)
    both = np.intersect1d(passes, found)
    rows = np.searchsorted(passes, both)
    samples = np.searchsorted(found, both)
    knots_way = np.column_stack([way[row_first[rows]], way[row_last[rows]]]).ravel()
    knots_time = np.column_stack(
        [sample_times[sample_first[samples]], sample_times[sample_last[samples]]]
    ).ravel()
    knots_way = np.concatenate([[way[0]], knots_way, [way[-1]]])
    knots_time = np.concatenate([[0.0], knots_time, [end]])
    order = np.argsort(knots_way, kind="stable")
    times = np.interp(way, knots_way[order], np.maximum.accumulate(knots_time[order]))
    return np.maximum.accumulate(times)


def _extents(path_id: Ints) -> tuple[Ints, Ints, Ints]:
    """Passes and the first and last index of each."""
    printing = np.flatnonzero(path_id >= 0)
    passes, first, counts = np.unique(path_id[printing], return_index=True, return_counts=True)
    return passes, printing[first], printing[first + counts - 1]
