# SPDX-License-Identifier: Apache-2.0
"""The tool as the clearance check sees it: inscribed balls, rims, and the plate's limit.

The tool is a body of revolution; its profile is radius against distance behind the tip.
Inside it, the largest ball centred on the axis at distance s has the radius of the
distance from (s, 0) to the profile. These balls touch every smooth part of the outside;
what they leave out are the rims, which are checked as circles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from vega_planner.datatypes import Floats

#: The tip stands in its own bead and touches the neighbours of that bead: against
#: printed material and substrate the first millimetres do not count.
TIP_MM = 2.0

#: The same for thick layers, in layer thicknesses: their beads reach farther up the tip.
TIP_LAYERS = 1.5

#: Spacing of the profile samples [mm].
STEP_MM = 0.25


def tip_length(thickness_mm: float) -> float:
    """Length of the tip [mm] that touches the beads it lays, whatever the planner does."""
    return max(TIP_MM, TIP_LAYERS * thickness_mm)


class Profile(Protocol):
    """What is needed of a tool: see `vega_planner.robot.workcell.Tool`."""

    @property
    def distance(self) -> Floats:
        """Distances behind the tip [mm], rising, shape (k,)."""

    @property
    def radius(self) -> Floats:
        """Radii [mm] at the distances, linear between, shape (k,)."""


@dataclass(frozen=True, eq=False)
class ToolShape:
    """Samples of a tool's profile from `start_mm` behind the tip to its end.

    Attributes:
        start_mm: Where the check begins.
        distance: Corners of the whole profile: distance behind the tip [mm], shape (k,).
        radius: Radii at the corners [mm], shape (k,).
        samples: Radii of the tool at s = `STEP_MM` * index [mm].
        inscribed: Radii of the inscribed balls at the same places [mm].
        reach: For v = `STEP_MM` * index the largest s with s + inscribed(s) <= v [mm].
        rim_at: Rims: distance behind the tip [mm].
        rim_radius: Radii of the rims [mm].
    """

    start_mm: float
    distance: Floats
    radius: Floats
    samples: Floats
    inscribed: Floats
    reach: Floats
    rim_at: Floats
    rim_radius: Floats

    @classmethod
    def of(cls, tool: Profile, start_mm: float = TIP_MM) -> ToolShape:
        """Sample a tool.

        Args:
            tool: The tool with its profile.
            start_mm: Distance behind the tip below which the tool does not count.
        """
        distance = np.array(tool.distance, dtype=float)
        radius = np.array(tool.radius, dtype=float)
        end = distance[-1]
        count = int(np.floor(end / STEP_MM + 1e-9)) + 1
        along: Floats = np.arange(count, dtype=np.float64) * STEP_MM
        samples = np.interp(along, distance, radius)
        inscribed = np.maximum(_distance_to_profile(along, distance, radius, start_mm), 0.0)
        far = np.arange(int(np.ceil((along + inscribed).max() / STEP_MM)) + 2) * STEP_MM
        grown = np.maximum.accumulate(along + inscribed)
        index = np.searchsorted(grown, far, side="right") - 1
        reach = np.where(index >= 0, along[np.maximum(index, 0)], 0.0)
        corners = _convex_corners(distance, radius, start_mm)
        return cls(
            start_mm=start_mm,
            distance=distance,
            radius=radius,
            samples=samples,
            inscribed=inscribed,
            reach=reach,
            rim_at=corners[:, 0].copy(),
            rim_radius=corners[:, 1].copy(),
        )

    def height_above(self, tips: Floats, axes: Floats) -> Floats:
        """Measure how high the whole tool, tip included, stays above the tips' z = 0.

        The lowest point of a body of revolution is on one of its profile's corners, so
        the answer is exact: min over corners of z + s u_z - r sqrt(1 - u_z²).

        Args:
            tips: Tips [mm], shape (n, 3).
            axes: Unit vectors from the tip back along the tool, shape (n, 3).

        Returns:
            Lowest z of the tool [mm], shape (n,).
        """
        sine = np.sqrt(np.clip(1.0 - axes[:, 2] ** 2, 0.0, 1.0))
        low = axes[:, 2, None] * self.distance - sine[:, None] * self.radius
        return tips[:, 2] + low.min(1)

    @cached_property
    def outline(self) -> tuple[Floats, Floats, Floats]:
        """Outline behind `start_mm`, for an exact check.

        Returns:
            Distances behind the tip and radii of its corners [mm], shape (c,), and the
            largest radius of the tool up to s = `STEP_MM` * index [mm].
        """
        keep = self.distance > self.start_mm
        at = np.concatenate([[self.start_mm], self.distance[keep]])
        own = np.interp(self.start_mm, self.distance, self.radius)
        along = np.arange(int(np.ceil(at[-1] / STEP_MM)) + 3) * STEP_MM
        table = np.interp(along, self.distance, self.radius)
        # a corner between two samples must not be missed
        above = np.ceil(self.distance / STEP_MM).astype(np.int64)
        np.maximum.at(table, above, self.radius)
        widest = np.maximum.accumulate(table)
        return at, np.concatenate([[own], self.radius[keep]]), widest

    @cached_property
    def _tilt_table(self) -> tuple[Floats, Floats]:
        tilt = np.radians(np.arange(0.0, 180.01, 0.25))
        need = np.sin(tilt)[:, None] * self.radius - np.cos(tilt)[:, None] * self.distance
        return np.maximum.accumulate(need.max(1)), tilt

    def largest_tilt(self, height: Floats, clearance_mm: float) -> Floats:
        """Find how far the tool may tilt with its tip at a height above a plane.

        Args:
            height: Heights of the tips above the plane [mm], shape (n,).
            clearance_mm: Distance the tool keeps from the plane.

        Returns:
            Angles from the vertical [rad], shape (n,); negative where even the upright
            tool is too low.
        """
        need, tilt = self._tilt_table
        angle = np.interp(height - clearance_mm, need, tilt)
        return np.where(height - clearance_mm < need[0] - 1e-9, -1.0, angle)


def _distance_to_profile(along: Floats, distance: Floats, radius: Floats, start: float) -> Floats:
    """Distances from points of the axis to the outline of the tool behind `start`."""
    keep = distance > start
    s = np.concatenate([[start, start], distance[keep], [distance[-1]]])
    r = np.concatenate([[0.0, np.interp(start, distance, radius)], radius[keep], [0.0]])
    best = np.full(len(along), np.inf)
    for s0, r0, s1, r1 in zip(s[:-1], r[:-1], s[1:], r[1:]):
        ds, dr = s1 - s0, r1 - r0
        length = ds * ds + dr * dr
        t = np.clip(((along - s0) * ds - r0 * dr) / length, 0, 1) if length else 0.0 * along
        best = np.minimum(best, np.hypot(s0 + t * ds - along, r0 + t * dr))
    return np.where(along < start, 0.0, best)


def _convex_corners(distance: Floats, radius: Floats, start: float) -> Floats:
    """Rims of the outline behind `start`: where it turns towards the axis, and both ends."""
    keep = distance > start
    s = np.concatenate([[start], distance[keep]])
    r = np.concatenate([[np.interp(start, distance, radius)], radius[keep]])
    rims = [(s[0], r[0])]
    for k in range(1, len(s) - 1):
        turn = (s[k] - s[k - 1]) * (r[k + 1] - r[k]) - (r[k] - r[k - 1]) * (s[k + 1] - s[k])
        if turn < -1e-12:
            rims.append((s[k], r[k]))
    rims.append((s[-1], r[-1]))
    return np.array(rims)
