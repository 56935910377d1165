# SPDX-License-Identifier: Apache-2.0
"""A check of a result folder that shares nothing with the planner.

It reads `toolpath.csv` alone, with the tool's profile and the height of the plate, and
asks of chosen rows: is any bead laid before inside the tool? No grid, no distance field:
every segment of bead near the tool is sampled through its section and held against the
profile. What the tip has to touch does not count: within `TIP_MM` behind the tip, or one
and a half bead heights where that is more, it stands in its own bead and between that
bead's neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

TIP_MM, TIP_HEIGHTS = 2.0, 1.5

#: A tip that moves freely counts from here on, this far from where a pass ends or begins.
FREE_MM = 2.5

#: Spacing of the samples along and across a bead [mm].
ALONG_MM = 0.25

#: The planner's grid and these samples round a bead off; less than this is no touch [mm].
ROUNDING_MM = 0.1


@dataclass(frozen=True)
class Touch:
    """A row at which the tool is inside something."""

    row: int
    depth_mm: float
    what: str


class Print:
    """The rows of a toolpath and what they leave behind."""

    def __init__(self, folder, profile, plate_z_mm=0.0):
        with (Path(folder) / "toolpath.csv").open() as file:
            names = file.readline().strip().split(",")
            table = np.loadtxt(file, delimiter=",", ndmin=2)
        column = {name: table[:, k] for k, name in enumerate(names)}
        self.points = np.column_stack([column[f"{x}_mm"] for x in "xyz"])
        self.axes = np.column_stack([column[f"tool_{x}"] for x in "xyz"])
        self.path = column["path_id"].astype(int)
        self.width, self.height = column["width_mm"], column["height_mm"]
        self.plate = plate_z_mm
        self.distance, self.radius = (np.asarray(v, float) for v in profile)
        # bead k ends at row k
        self.ends = np.flatnonzero(column["extrude"] > 0.5)
        self.middle = 0.5 * (self.points[self.ends] + self.points[self.ends - 1])
        step = np.linalg.norm(self.points[self.ends] - self.points[self.ends - 1], axis=1)
        wide = np.maximum(self.width[self.ends], self.width[self.ends - 1])
        high = np.maximum(self.height[self.ends], self.height[self.ends - 1])
        self.ball = 0.5 * step + 0.5 * np.maximum(wide, high)

    def __len__(self):
        return len(self.points)

    def free_rows(self):
        """True for travel rows that are away from both ends of their move."""
        free = self.path < 0
        edges = np.flatnonzero(np.diff(free.astype(int), prepend=0, append=0))
        for first, last in zip(edges[::2], edges[1::2]):
            for end in (first - 1, last):
                if 0 <= end < len(self):
                    gap = np.linalg.norm(self.points[first:last] - self.points[end], axis=1)
                    free[first:last] &= gap > FREE_MM
        return free

    def touches(self, rows):
        """Find the touches at some rows."""
        free = self.free_rows()
        found = []
        for row in rows:
            p, u = self.points[row], self.axes[row]
            sine = np.sqrt(max(0.0, 1.0 - u[2] ** 2))
            low = p[2] + (self.distance * u[2] - self.radius * sine).min() - self.plate
            if low < -1e-6:
                found.append(Touch(int(row), float(-low), "plate"))
            start = 0.0 if free[row] else max(TIP_MM, TIP_HEIGHTS * self.height[row])
            depth = self._depth(row, p, u, start)
            if depth > ROUNDING_MM:
                found.append(Touch(int(row), depth, "bead"))
        return found

    def _depth(self, row, p, u, start):
        # the bead that ends at this very row is being laid
        count = np.searchsorted(self.ends, row)
        away = self.middle[:count] - p
        s = away @ u
        r = np.sqrt(np.maximum((away**2).sum(1) - s**2, 0.0))
        ball = self.ball[:count]
        # radius rises along the tool, so its largest value within reach is at s + ball
        reach = np.interp(s + ball, self.distance, self.radius)
        near = (s + ball > start) & (s - ball < self.distance[-1]) & (r - ball < reach)
        worst = -np.inf
        for k in np.flatnonzero(near):
            q = self._bead(int(self.ends[k])) - p
            s = q @ u
            r = np.sqrt(np.maximum((q**2).sum(1) - s**2, 0.0))
            inside = np.interp(s, self.distance, self.radius) - r
            # ahead of where the tool begins to count, and beyond its end, nothing is inside
            inside = np.minimum(inside, np.minimum(s - start, self.distance[-1] - s))
            worst = max(worst, float(inside.max()))
        return worst

    def _bead(self, row):
        """Samples of the bead that ends at a row: its stadium section along its length."""
        a, b = self.points[row - 1], self.points[row]
        w = 0.5 * (self.width[row] + self.width[row - 1])
        h = 0.5 * (self.height[row] + self.height[row - 1])
        u = self.axes[row]
        count = max(2, int(np.ceil(np.linalg.norm(b - a) / ALONG_MM)) + 1)
        line = a + np.linspace(0, 1, count)[:, None] * (b - a)
        side = np.cross(u, b - a)
        length = np.linalg.norm(side)
        if length < 1e-9:
            side, length = np.cross(u, [1.0, 0, 0] if abs(u[0]) < 0.9 else [0, 1.0, 0]), 1.0
            length = np.linalg.norm(side)
        side = side / length
        turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        flat = 0.5 * max(w - h, 0.0)
        x = 0.5 * h * np.cos(turn) + flat * np.sign(np.round(np.cos(turn), 9))
        z = 0.5 * h * np.sin(turn)
        x, z = np.r_[x, 0.0, -0.5 * flat, 0.5 * flat], np.r_[z, 0.0, 0.0, 0.0]
        section = x[:, None] * side + z[:, None] * u
        return (line[:, None, :] + section[None, :, :]).reshape(-1, 3)


def spread(count, most, seed=0):
    """Rows to look at: evenly spread, each somewhere in its share."""
    if count <= most:
        return np.arange(count)
    edges = np.linspace(0, count, most + 1)
    shift = np.random.default_rng(seed).uniform(size=most)
    return np.unique((edges[:-1] + shift * np.diff(edges)).astype(int).clip(0, count - 1))
