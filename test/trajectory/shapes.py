# SPDX-License-Identifier: Apache-2.0
"""Toolpaths drawn by formula, with travels that lift off along the nozzle."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Toolpath, ToolpathSet, Travel


def pass_of(points, axes, patch=0, width=1.2, height=0.8):
    n = len(points)
    axes = np.asarray(axes) / np.linalg.norm(axes, axis=1, keepdims=True)
    return Toolpath(points, axes, np.full(n, width), np.full(n, height), patch, patch)


def with_travels(passes, lift=8.0, top=60.0):
    """Join passes by travels: up along the nozzle, over, and down along the nozzle."""
    travels = []

    def lifted(path, end):
        return path.points[end] + lift * path.axes[end]

    for before, after in zip([None, *passes], [*passes, None]):
        points, axes = [], []
        if before is not None:
            points += [before.points[-1], lifted(before, -1)]
            axes += [before.axes[-1]] * 2
        if before is None or after is None:
            edge = points[-1] if points else lifted(after, 0)
            points.append(np.array([edge[0], edge[1], top]))
            axes.append(np.array([0.0, 0.0, 1.0]))
        if after is not None:
            points += [lifted(after, 0), after.points[0]]
            axes += [after.axes[0]] * 2
        travels.append(Travel(np.array(points), np.array(axes)))
    return ToolpathSet(tuple(passes), tuple(travels))


def dome_spiral(radius=30.0, rim_deg=60.0, spacing=1.03, step=0.5, floor=0.4):
    """A spiral from the rim of a spherical cap to its apex, nozzle along the normal."""
    rim = np.radians(rim_deg)
    turns = rim * radius / spacing
    u = np.linspace(0.0, 1.0, int(turns * 400))
    tilt, turn = rim * (1 - u), 2 * np.pi * turns * u
    axes = np.column_stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
    )
    points = radius * axes
    points[:, 2] += floor - radius * np.cos(rim)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.interp(np.arange(0, arc[-1], step), arc, u)
    tilt, turn = rim * (1 - at), 2 * np.pi * turns * at
    axes = np.column_stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
    )
    points = radius * axes
    points[:, 2] += floor - radius * np.cos(rim)
    return pass_of(points, axes)


def dome_lines(radius=30.0, rim_deg=60.0, spacing=1.03, step=0.5, offset=0.0):
    """Parallel lines to and fro over a spherical cap, one pass."""
    rim = np.radians(rim_deg)
    half = radius * np.sin(rim)
    rows = []
    for k, y in enumerate(np.arange(-half + 1 + offset, half - 1, spacing)):
        width = np.sqrt(half * half - y * y)
        x = np.linspace(-width, width, max(int(2 * width / step), 2))
        row = np.column_stack([x, np.full_like(x, y)])
        rows.append(row if k % 2 == 0 else row[::-1])
    flat = np.vstack(rows)
    z = np.sqrt(radius**2 - (flat**2).sum(1))
    axes = np.column_stack([flat, z]) / radius
    points = np.column_stack([flat, z - radius * np.cos(rim) + 0.4])
    return pass_of(points, axes)


def line(corners):
    """A flat polyline with the nozzle upright."""
    corners = np.asarray(corners, dtype=float)
    return pass_of(corners, np.tile([0.0, 0.0, 1.0], (len(corners), 1)))
