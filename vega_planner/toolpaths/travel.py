# SPDX-License-Identifier: Apache-2.0
"""Moves between passes: back along the nozzle, over what is printed, and down again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from vega_planner.datatypes import Floats, Toolpath, Travel
from vega_planner.toolpaths.clearance_kernels import is_clear, raise_map

#: Distance along the nozzle that is left and approached first [mm].
RETRACT_MM = 3.0
#: Less is enough to a pass that starts as near as this [mm].
_SHORT_RETRACT_MM, _NEAR_MM = 1.5, 25.0
#: More is tried where the tool stands in a narrow place [mm].
_LONG_RETRACTS_MM = (6.0, 12.0, 20.0, 32.0, 48.0)
#: Room between the tool and what is printed, or the plate [mm].
_ROOM_MM = 0.3
#: Cells of the coarse height map, which answers most questions, and of the fine one [mm].
_CELL_MM, _FINE_MM = 1.0, 0.25
#: Hops that are tried [mm], and how far the nozzle is turned upright on them.
_HOPS_MM = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
_UPRIGHT = (0.0, 0.5, 1.0)
#: Longest way drawn back along the nozzle [mm].
_REACH_MM = 60.0
#: Largest distance and largest turn between points of a move.
_STEP_MM, _TURN_RAD = 3.0, math.radians(5.0)


class ToolProfile(Protocol):
    """Radius of a tool against the distance behind its tip."""

    @property
    def distance(self) -> Floats:
        """Distances behind the tip [mm], rising from 0, shape (k,)."""

    @property
    def radius(self) -> Floats:
        """Radii there [mm], shape (k,)."""


def slerp(a: Floats, b: Floats, w: Floats) -> Floats:
    """Turn one unit vector into another by the shorter way.

    Args:
        a: First unit vector, shape (3,).
        b: Second unit vector, shape (3,).
        w: Parts of the way 0..1, shape (k,).

    Returns:
        Unit vectors, shape (k, 3).
    """
    angle = math.acos(float(np.clip(a @ b, -1.0, 1.0)))
    if angle < 1e-6:
        mixed = (1 - w)[:, None] * a + w[:, None] * b
    else:
        side = b - math.cos(angle) * a
        length = np.linalg.norm(side)
        if length < 1e-9:
            side = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
            length = np.linalg.norm(side)
        side = side / length
        mixed = np.cos(angle * w)[:, None] * a + np.sin(angle * w)[:, None] * side
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def slerp_one(a: Floats, b: Floats, w: float) -> Floats:
    """Turn one unit vector part of the way into another, shape (3,)."""
    return slerp(a, b, np.array([w]))[0]


def polyline_of_poses(points: list[Floats], axes: list[Floats]) -> Travel:
    """Put intermediate points on a polyline of poses.

    Args:
        points: Corners [mm], each of shape (3,).
        axes: Unit vectors from the tip back along the nozzle there, each of shape (3,).

    Returns:
        The move, in steps of a few millimetres and degrees; the corners are kept.
    """
    out_points, out_axes = [points[0][None]], [axes[0][None]]
    for p, q, u, v in zip(points, points[1:], axes, axes[1:]):
        turn = math.acos(float(np.clip(u @ v, -1.0, 1.0)))
        count = max(
            1, math.ceil(float(np.linalg.norm(q - p)) / _STEP_MM), math.ceil(turn / _TURN_RAD)
        )
        w = np.arange(1, count + 1) / count
        out_points.append(np.vstack([p + w[:-1, None] * (q - p), q]))
        out_axes.append(np.vstack([slerp(u, v, w[:-1]), v]))
    return Travel(np.concatenate(out_points), np.concatenate(out_axes))


class TravelPlanner:
    """Finds moves above what is printed so far.

    Print order decides: call `move` for the way to a pass, then `add` when it is
    printed.
    """

    def __init__(self, low: Floats, high: Floats, plate_z_mm: float, profile: ToolProfile) -> None:
        """Start with an empty plate.

        Args:
            low: Lowest corner of everything that will be printed [mm], shape (3,).
            high: Highest corner [mm], shape (3,).
            plate_z_mm: Height of the plate [mm].
            profile: The tool.
        """
        self._corner = np.asarray(low[:2], dtype=float) - 2.0
        extent = np.asarray(high[:2]) + 2.0 - self._corner
        self._maps = [
            (size, np.full(tuple(np.ceil(extent / size).astype(int) + 1), float(plate_z_mm)))
            for size in (_CELL_MM, _FINE_MM)
        ]
        self._floor = self._top = float(plate_z_mm)
        self._ceiling = float(high[2])
        self._distance = np.array(profile.distance, dtype=float)
        self._radius = np.array(profile.radius, dtype=float)
        self.blocked = 0

    def add(self, path: Toolpath) -> None:
        """Put a printed pass on the map."""
        self.add_points(path.points, 0.5 * path.height, 0.5 * float(path.width.max()))

    def add_points(self, points: Floats, rise: Floats, reach: float) -> None:
        """Put points of something solid on the map.

        Args:
            points: Positions [mm], shape (k, 3).
            rise: How far it reaches above them [mm], shape (k,).
            reach: How far it reaches to the sides [mm].
        """
        for size, heights in self._maps:
            raise_map(heights, self._corner, size, points, reach, rise)
        self._top = max(self._top, float((points[:, 2] + rise).max()))

    def arrive(self, path: Toolpath) -> Travel:
        """Make the first move, from above the part to a pass."""
        return polyline_of_poses(*self._column(path.points[0], path.axes[0], -1))

    def leave(self, path: Toolpath) -> Travel:
        """Make the last move, from a pass to above the part."""
        return polyline_of_poses(*self._column(path.points[-1], path.axes[-1], 1))

    def move(self, before: Toolpath, after: Toolpath) -> Travel:
        """Make the move from the end of one pass to the start of the next.

        The shortest way back, hop and way down that is clear is taken. Where none is, the
        tool draws back along its axis until it is above everything, and `blocked` counts it.
        """
        a, u = before.points[-1], before.axes[-1]
        b, v = after.points[0], after.axes[0]
        for way in self._ways(a, u, b, v):
            if self._clear(way):
                return _joined(a, u, way, b, v)
        self.blocked += 1
        out, out_axes = self._column(a, u, 1)
        into, into_axes = self._column(b, v, -1)
        return polyline_of_poses(out + into, out_axes + into_axes)

    def _ways(self, a: Floats, u: Floats, b: Floats, v: Floats) -> Iterator[Travel]:
        """Ways between two poses: first short retracts with rising hops, then longer ones."""
        up = np.array([0.0, 0.0, 1.0])
        near = float(np.linalg.norm(b - a)) < _NEAR_MM
        plain = [(r, h) for h in _HOPS_MM for r in ((_SHORT_RETRACT_MM,) * near + (RETRACT_MM,))]
        far = [(r, h) for r in _LONG_RETRACTS_MM for h in _HOPS_MM]
        tries = sorted(plain + far, key=lambda way: way[0] + way[1])
        for retract, hop in tries:
            back, front = a + retract * u, b + retract * v
            if hop == 0.0:
                yield polyline_of_poses([back, front], [u, v])
                continue
            level = max(back[2], front[2]) + hop
            if level > max(self._top, back[2], front[2]) + _REACH_MM:
                continue
            points = [back, _at(back, level), _at(front, level), front]
            for turn in _UPRIGHT:
                axes = [u, slerp_one(u, up, turn), slerp_one(v, up, turn), v]
                yield polyline_of_poses(points, axes)

    def _clear(self, way: Travel) -> bool:
        """Tell whether a way is clear on the coarse map, or else on the fine one."""
        return any(
            is_clear(
                heights,
                self._corner,
                size,
                self._floor,
                self._top,
                way.points,
                way.axes,
                self._distance,
                self._radius,
                _ROOM_MM,
            )
            for size, heights in self._maps
        )

    def _column(self, p: Floats, u: Floats, sign: int) -> tuple[list[Floats], list[Floats]]:
        """Poses from a pass straight back along the nozzle, then up and upright."""
        room = max(self._top, self._ceiling) + RETRACT_MM + _ROOM_MM
        rise = max(room + self._drop(u) - p[2], RETRACT_MM)
        back = p + min(rise / max(u[2], 0.05), _REACH_MM) * u
        up = np.array([0.0, 0.0, 1.0])
        points, axes = [p, back, _at(back, max(back[2], room + self._drop(u)))], [u, u, u]
        points.append(points[-1] + 2.0 * up)
        axes.append(up)
        return (points, axes) if sign > 0 else (points[::-1], axes[::-1])

    def _drop(self, axis: Floats) -> float:
        """How far the tool hangs below its tip when tilted [mm]."""
        sine = math.sqrt(max(0.0, 1 - float(axis[2]) ** 2))
        return float(np.max(self._radius * sine - self._distance * axis[2]))


def _at(point: Floats, height: float) -> Floats:
    return np.array([point[0], point[1], height])


def _joined(a: Floats, u: Floats, way: Travel, b: Floats, v: Floats) -> Travel:
    return Travel(np.vstack([a, way.points, b]), np.vstack([u, way.axes, v]))
