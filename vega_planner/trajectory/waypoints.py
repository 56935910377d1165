# SPDX-License-Identifier: Apache-2.0
"""Passes and travels as one row of tip poses in the robot's base frame, and its refinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, ToolpathSet, row_lengths
from vega_planner.errors import InvalidInput
from vega_planner.robot.workcell import Workcell

#: Poses nearer than this are one pose [m, rad].
_SAME = 1e-9
#: New poses keep this part of an interval between them.
_NEAREST = 1e-4
#: A pass and the travels beside it have to meet this well [m].
_JOINT_GAP = 2e-6
#: Corners above this may slow the tip [rad].
_SHARP = 0.05
#: First pose after a segment's start, and before its end, at the latest [m].
_FIRST_STEP = 5e-5
#: Largest angle between the nozzle and evenly turned axes between two poses [rad].
_LARGEST_BOW = np.radians(0.1)
#: On travel, turning by one radian counts as much path as this length [m].
TRAVEL_RADIUS = 0.02


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Tip poses of a whole job in order, cut into segments: a travel, a pass, a travel, ...

    A segment begins with a copy of the pose the one before ended with.

    Attributes:
        points: Tip positions [m], base frame, shape (n, 3).
        axes: Unit nozzle axes, base frame, shape (n, 3).
        path: Path parameter [m]: arc length of the tip while printing, and on travel a
            length that also grows where only the axis turns. Shape (n,).
        starts: First row of each segment, and n at the end, shape (m + 1,).
        path_id: Index of the pass of each segment, -1 for travel, shape (m,).
    """

    points: Floats
    axes: Floats
    path: Floats
    starts: Ints
    path_id: Ints

    @property
    def segment(self) -> Ints:
        """Segment of each pose, shape (n,)."""
        return np.repeat(np.arange(len(self.path_id)), np.diff(self.starts))

    @property
    def joined(self) -> Bools:
        """True for the intervals i to i + 1 that lie within one segment, shape (n - 1,)."""
        inside = np.ones(len(self.points) - 1, np.bool_)
        inside[self.starts[1:-1] - 1] = False
        return inside

    @property
    def printing(self) -> Bools:
        """True for the intervals i to i + 1 on which a bead is laid, shape (n - 1,)."""
        return self.joined & (self.path_id[self.segment[:-1]] >= 0)


def waypoints_of(toolpaths: ToolpathSet, cell: Workcell) -> Waypoints:
    """Line up the passes and travels of a job in the base frame.

    Raises:
        InvalidInput: If there is no pass, or a travel does not lead to its pass.
    """
    passes, travels = toolpaths.passes, toolpaths.travels
    if not passes:
        raise InvalidInput("there is no toolpath to time; at least one pass is needed")
    if len(travels) != len(passes) + 1:
        raise InvalidInput(
            f"{len(travels)} travels for {len(passes)} passes; expected {len(passes) + 1}"
        )
    pieces: list[tuple[int, Floats, Floats]] = [(-1, travels[0].points, travels[0].axes)]
    for k, path in enumerate(passes):
        pieces.append((k, path.points, path.axes))
        pieces.append((-1, travels[k + 1].points, travels[k + 1].axes))
    counts = np.array([len(piece[1]) for piece in pieces])
    points, axes = cell.to_base(
        np.concatenate([piece[1] for piece in pieces]),
        np.concatenate([piece[2] for piece in pieces]),
    )
    axes /= row_lengths(axes)[:, None]
    starts = np.concatenate([[0], np.cumsum(counts)])
    ids = np.array([piece[0] for piece in pieces])
    _check_joints(points, starts, ids)
    # What meets within the tolerance is made to meet exactly: passes win over travels.
    for k in range(1, len(ids)):
        pose = starts[k] - 1 if ids[k] < 0 else starts[k]
        points[[starts[k] - 1, starts[k]]] = points[pose]
        axes[[starts[k] - 1, starts[k]]] = axes[pose]
    return _without_repeats(points, axes, starts, ids)


def _check_joints(points: Floats, starts: Ints, ids: Ints) -> None:
    gaps = row_lengths(points[starts[1:-1]] - points[starts[1:-1] - 1])
    worst = int(np.argmax(gaps))
    if gaps[worst] > _JOINT_GAP:
        travel = (worst + 1) // 2
        raise InvalidInput(
            f"travel {travel} misses the pass it meets by {gaps[worst] * 1000:.4f} mm; "
            f"allowed: {_JOINT_GAP * 1000:g}"
        )


def _without_repeats(points: Floats, axes: Floats, starts: Ints, ids: Ints) -> Waypoints:
    """Drop poses that repeat the one before, but keep both ends of each segment."""
    ends = np.zeros(len(points), np.bool_)
    ends[starts[:-1]] = True
    ends[starts[1:] - 1] = True
    moved = row_lengths(np.diff(points, axis=0))
    turned = row_lengths(np.diff(axes, axis=0))
    keep = ends | np.concatenate([[True], (moved > _SAME) | (turned > _SAME)])
    # A last-but-one pose that repeats the last is dropped in favour of the end.
    before_end = starts[1:] - 2
    before_end = before_end[before_end >= starts[:-1] + 1]
    twin = (moved[before_end] <= _SAME) & (turned[before_end] <= _SAME)
    keep[before_end[twin]] = False
    new_starts = np.concatenate([[0], np.cumsum(keep)[starts[1:] - 1]])
    points, axes = points[keep], axes[keep]
    return Waypoints(points, axes, _path(points, axes, new_starts, ids), new_starts, ids)


def _path(points: Floats, axes: Floats, starts: Ints, ids: Ints) -> Floats:
    travel = (ids < 0)[np.repeat(np.arange(len(ids)), np.diff(starts))][:-1]
    step = row_lengths(np.diff(points, axis=0))
    turn = TRAVEL_RADIUS * row_lengths(np.diff(axes, axis=0))
    step = np.where(travel | (step <= _SAME), np.hypot(step, turn), step)
    step[starts[1:-1] - 1] = 0.0
    return np.concatenate([[0.0], np.cumsum(step)])


def refined(way: Waypoints, interval: Ints, fraction: Floats) -> tuple[Waypoints, Floats]:
    """Insert poses between the poses there are: on the chord, with the axis turned smoothly.

    Args:
        way: The poses.
        interval: Interval i (from pose i to i + 1) each new pose lies in, shape (k,).
        fraction: Where in it, above 0 and below 1, shape (k,).

    Returns:
        The refined row, and for each of its poses where it lies in the old one: the old
        index plus the fraction, shape (n + k,).
    """
    order = np.argsort(interval + fraction, kind="stable")
    interval, fraction = interval[order], fraction[order]
    fresh = np.ones(len(interval), np.bool_)
    fresh[1:] = (np.diff(interval) > 0) | (np.diff(fraction) > _NEAREST)
    interval, fraction = interval[fresh], fraction[fresh]
    n = len(way.points)
    index = np.concatenate([np.arange(n), interval])
    part = np.concatenate([np.zeros(n), fraction])
    where = np.argsort(index + part, kind="stable")
    index, part = index[where], part[where]
    after = np.minimum(index + 1, n - 1)
    weight = part[:, None]
    points = (1.0 - weight) * way.points[index] + weight * way.points[after]
    path = (1.0 - part) * way.path[index] + part * way.path[after]
    axes = way.axes[index].copy()
    new = np.flatnonzero(part > 0)
    axes[new] = _turned_smoothly(way, index[new], part[new])
    added = np.bincount(way.segment[interval], minlength=len(way.path_id))
    starts = way.starts + np.concatenate([[0], np.cumsum(added)])
    return Waypoints(points, axes, path, starts, way.path_id), index + part


def evenly_cut(pieces: Ints) -> tuple[Ints, Floats]:
    """List the poses that cut intervals into equal pieces, as `refined` takes them.

    Args:
        pieces: Number of pieces of each interval, shape (n - 1,); 1 leaves it whole.
    """
    rows = np.flatnonzero(pieces > 1)
    count = pieces[rows] - 1
    interval = np.repeat(rows, count)
    within = np.arange(len(interval)) - np.repeat(np.cumsum(count) - count, count) + 1
    return interval, within / pieces[interval]


def turned_evenly(a: Floats, b: Floats, fraction: Floats) -> Floats:
    """Turn unit vectors a towards b by a fraction of the angle between them (slerp)."""
    cosine = np.clip(np.einsum("ij,ij->i", a, b), -1.0, 1.0)
    angle = np.arccos(cosine)
    small = angle < 1e-4
    sine = np.where(small, 1.0, np.sin(angle))
    wa = np.where(small, 1.0 - fraction, np.sin((1.0 - fraction) * angle) / sine)
    wb = np.where(small, fraction, np.sin(fraction * angle) / sine)
    mixed = wa[:, None] * a + wb[:, None] * b
    return mixed / row_lengths(mixed)[:, None]


def _turned_smoothly(way: Waypoints, index: Ints, part: Floats) -> Floats:
    """Axes within intervals, turned evenly but for a small bow that rounds changes of rate.

    Even turns from pose to pose make the rotary axes jerk at every pose. The bow is what a
    cubic through the axes adds to the chord, cut to `_LARGEST_BOW`.
    """
    length = np.diff(way.path)
    chord = np.diff(way.axes, axis=0)
    rate = chord / np.where(length > 0, length, np.inf)[:, None]
    h0, h1 = length[:-1, None], length[1:, None]
    total = np.where(h0 + h1 > 0, h0 + h1, 1.0)
    slope = np.zeros_like(way.axes)
    slope[1:-1] = (rate[:-1] * h1 + rate[1:] * h0) / total
    # a cubic that turns much faster than the chords beside it would overshoot
    size = row_lengths(rate)
    most = 2.0 * np.minimum(size[:-1], size[1:])
    steep = row_lengths(slope[1:-1])
    slope[1:-1] *= np.minimum(1.0, most / np.where(steep > 0, steep, 1.0))[:, None]
    ends = np.unique(np.concatenate([way.starts[:-1], way.starts[1:] - 1]))
    slope[ends] = rate[np.minimum(ends, len(rate) - 1)]
    slope[way.starts[1:] - 1] = rate[way.starts[1:] - 2]
    e0 = length[index, None] * slope[index] - chord[index]
    e1 = length[index, None] * slope[index + 1] - chord[index]
    w = part[:, None]
    bow = w * (1.0 - w) * ((1.0 - w) * e0 - w * e1)
    largest = 0.15 * (row_lengths(e0) + row_lengths(e1))
    bow *= np.minimum(1.0, _LARGEST_BOW / np.maximum(largest, 1e-12))[:, None]
    axes = turned_evenly(way.axes[index], way.axes[index + 1], part) + bow
    return np.asarray(axes / row_lengths(axes)[:, None])


def knots_for_timing(
    way: Waypoints, speed: Floats, tolerance: float, acceleration: float
) -> tuple[Ints, Floats]:
    """Choose where the time law needs poses beside the given ones.

    Close to the ends of a segment, where the tip speeds up and comes to rest, and close to
    corners, so that the smooth curve through the poses cuts each corner by less than the
    tolerance.

    Args:
        way: The poses.
        speed: Speed of each interval [m/s], shape (n - 1,).
        tolerance: How far the curve may leave the path [m].
        acceleration: Acceleration that the arm surely has along the path [m/s²].

    Returns:
        Intervals and fractions as `refined` takes them.
    """
    length = np.diff(way.path)
    joined = way.joined & (length > 0)
    braking = speed**2 / (2.0 * acceleration)
    first = np.zeros(len(length), np.bool_)
    first[way.starts[:-1]] = True
    last = np.zeros(len(length), np.bool_)
    last[way.starts[1:] - 2] = True
    # A curve through a corner of angle φ with poses h away leaves the chords by φ h / 8.
    step = np.diff(way.points, axis=0)
    size = row_lengths(step)[:, None]
    direction = step / np.where(size > 0, size, 1.0)
    corner = np.zeros(len(way.points))
    inner = np.einsum("ij,ij->i", direction[:-1], direction[1:])
    corner[1:-1] = np.arccos(np.clip(inner, -1.0, 1.0))
    corner[way.starts[:-1]] = 0.0
    corner[way.starts[1:] - 1] = 0.0
    near = np.where(corner > 1e-3, 8.0 * tolerance / np.maximum(corner, 1e-3), np.inf)
    pieces: list[tuple[Ints, Floats]] = []

    def add(wanted: Bools, distance: Floats, side: int) -> None:
        """A pose at a distance from the interval's start, or from its end; or in its middle."""
        rows = np.flatnonzero(wanted & joined & (distance < length))
        share = np.minimum(distance[rows] / length[rows], 0.5)
        pieces.append((rows, share if side > 0 else 1.0 - share))

    # What is slow at an end or in a corner gets its speed back over the braking distance.
    for end, at, side in ((first, near[:-1], 1), (last, near[1:], -1)):
        add(np.isfinite(at), at, side)
        slow = end | (at < 8.0 * tolerance / _SHARP)
        distance = np.where(end, np.minimum(braking, _FIRST_STEP), 1.3 * at)
        furthest = np.maximum(9.0 * braking, np.where(end, 0.0, 1.301 * at))
        furthest = np.minimum(furthest, 0.5 * length)
        while (again := slow & (distance <= furthest)).any():
            add(again, distance, side)
            distance = 3.0 * distance
    rows = np.concatenate([piece[0] for piece in pieces])
    shares = np.concatenate([piece[1] for piece in pieces])
    return rows, shares


def passes_there(path_id: Ints) -> Ints:
    """Count the passes that are there at poses of a job, by the pass of each, -1 on travel.

    The pass that is being laid does not count: the nozzle stands in it.
    """
    begun = np.maximum.accumulate(path_id)
    return np.where(path_id < 0, begun + 1, begun)
