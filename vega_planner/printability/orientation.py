# SPDX-License-Identifier: Apache-2.0
"""Orientation policies: which way the nozzle points over a sheet.

The tool axis u is the unit vector from the tip back along the nozzle, away from the
surface. All policies keep the azimuth of the normal and choose a tilt, the angle
between u and the vertical, no larger than the normal's own:

- normal: u is the normal, as in the paper.
- vertical: u points straight up.
- collision-free: the largest tilt at which the solid tool is clear, no larger than the
  settings allow, and changing by no more than a set rate along the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, row_lengths
from vega_planner.printability.mesh_kernels import limit_slope
from vega_planner.settings import PrintabilitySettings

#: Steps in which the nozzle is raised towards the vertical until it is clear.
RAISE_RAD = np.radians(12.5)

#: Directions tried where the normal's own azimuth holds no clear one.
SEARCH_TILTS_DEG, SEARCH_AZIMUTHS = (8.0, 16.0, 26.0, 40.0, 58.0), 12

#: Tells the clearance [mm] of tool poses; arguments are indices, tips and axes.
Clearance = Callable[[Ints, Floats, Floats], Floats]


@dataclass(frozen=True, eq=False)
class Oriented:
    """Tool axes over a sheet and whether the tool is clear there.

    Attributes:
        axes: Unit tool axes, shape (n, 3).
        clear: True where the tool keeps its clearance, shape (n,).
    """

    axes: Floats
    clear: Bools


def tilted(normals: Floats, tilt: Floats) -> Floats:
    """Make axes with the azimuth of the normals and a given tilt.

    Args:
        normals: Unit normals, shape (n, 3).
        tilt: Angles from the vertical [rad], shape (n,).

    Returns:
        Unit axes, shape (n, 3); vertical where a normal has no azimuth.
    """
    level = np.hypot(normals[:, 0], normals[:, 1])
    sine = np.where(level > 1e-9, np.sin(tilt) / np.maximum(level, 1e-9), 0.0)
    up = np.where(level > 1e-9, np.cos(tilt), 1.0)
    axes = np.column_stack([normals[:, 0] * sine, normals[:, 1] * sine, up])
    return axes / row_lengths(axes)[:, None]


def tilt_of(directions: Floats) -> Floats:
    """Measure the angle of unit vectors from the vertical [rad]."""
    return np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])


def orient(
    vertices: Floats,
    faces: Ints,
    normals: Floats,
    tilt_limit: Floats,
    clearance: Clearance,
    settings: PrintabilitySettings,
) -> Oriented:
    """Choose the nozzle's direction at the vertices of a sheet.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        normals: Unit normals on the side the nozzle comes from, shape (n, 3).
        tilt_limit: Largest tilt the plate leaves [rad], shape (n,); negative where none.
        clearance: The solid check against everything but the plate.
        settings: Policy, largest tilt and rate, clearance.
    """
    every = np.arange(len(vertices))
    own = tilt_of(normals)
    if settings.orientation != "collision-free":
        tilt = own if settings.orientation == "normal" else np.zeros(len(vertices))
        axes = normals.copy() if settings.orientation == "normal" else tilted(normals, tilt)
        clear = (tilt <= tilt_limit + 1e-9) & (
            clearance(every, vertices, axes) >= settings.clearance_mm
        )
        return Oriented(axes, clear)
    most = np.minimum(tilt_limit, np.radians(settings.max_tilt_deg))
    tilt = np.maximum(np.minimum(own, most), 0.0)
    clear = tilt_limit >= 0
    tilt, found = raise_until_clear(vertices, normals, tilt, clearance, settings.clearance_mm)
    axes, found = smoothed(vertices, faces, normals, tilt, found, tilt_limit, clearance, settings)
    return Oriented(axes, clear & found)


def smoothed(
    vertices: Floats,
    faces: Ints,
    normals: Floats,
    tilt: Floats,
    found: Bools,
    tilt_limit: Floats,
    clearance: Clearance,
    settings: PrintabilitySettings,
) -> tuple[Floats, Bools]:
    """Bound the change of the tilt along a sheet, and look further where nothing is clear.

    Args:
        vertices: Tips [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        normals: Unit vectors that give the azimuth, shape (n, 3).
        tilt: Tilts [rad], clear where `found`, shape (n,).
        found: True where the tilt is clear, shape (n,).
        tilt_limit: Largest tilt the plate leaves [rad], shape (n,).
        clearance: The solid check.
        settings: Rate, lean and clearance.

    Returns:
        Unit axes, shape (n, 3), and where they are clear.
    """
    # where nothing is clear the normal's tilt stands, so as not to bend what is next to it
    most_tilt = np.minimum(tilt_of(normals), np.radians(settings.max_tilt_deg))
    tilt = np.where(found, tilt, most_tilt)
    smooth = tilt.copy()
    limit_slope(vertices, faces, smooth, np.radians(settings.max_tilt_rate_deg_mm))
    # a small cap turns faster than the rate allows; there the lean counts for more
    least = tilt_of(normals) - np.radians(settings.max_lean_deg)
    smooth = np.maximum(smooth, np.minimum(tilt, least))
    moved = np.flatnonzero(found & (smooth < tilt - 1e-3))
    if len(moved):
        axes = tilted(normals[moved], smooth[moved])
        worse = clearance(moved, vertices[moved], axes) < settings.clearance_mm
        smooth[moved[worse]] = tilt[moved[worse]]
    axes = tilted(normals, smooth)
    lost = np.flatnonzero(~found & (tilt_limit >= 0))
    if len(lost):
        most = np.minimum(tilt_limit[lost], np.radians(settings.max_tilt_deg))
        other, ok = search_around(
            vertices[lost],
            normals[lost],
            most,
            lambda index, tips, poses: clearance(lost[index], tips, poses),
            settings,
        )
        axes[lost[ok]] = other[ok]
        found = found.copy()
        found[lost[ok]] = True
    return axes, found


def search_around(
    vertices: Floats,
    normals: Floats,
    most: Floats,
    clearance: Clearance,
    settings: PrintabilitySettings,
) -> tuple[Floats, Bools]:
    """Look for a clear axis in all directions, the one nearest to the normal.

    In a valley or beside a ridge the free direction may point anywhere.

    Args:
        vertices: Tips [mm], shape (n, 3).
        normals: Unit normals, shape (n, 3).
        most: Largest tilts [rad], shape (n,).
        clearance: The solid check.
        settings: Lean and clearance.

    Returns:
        Unit axes, shape (n, 3), and where one was found.
    """
    best = np.full(len(vertices), np.cos(np.radians(settings.max_lean_deg)))
    axes = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    found = np.zeros(len(vertices), np.bool_)
    for tilt in np.radians(SEARCH_TILTS_DEG):
        for azimuth in np.arange(SEARCH_AZIMUTHS) * (2 * np.pi / SEARCH_AZIMUTHS):
            axis = np.array(
                [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]
            )
            near = normals @ axis
            todo = np.flatnonzero((near > best) & (tilt <= most))
            if not len(todo):
                continue
            poses = np.tile(axis, (len(todo), 1))
            ok = todo[clearance(todo, vertices[todo], poses) >= settings.clearance_mm]
            axes[ok], best[ok], found[ok] = axis, near[ok], True
    return axes, found


def raise_until_clear(
    vertices: Floats, normals: Floats, tilt: Floats, clearance: Clearance, wanted_mm: float
) -> tuple[Floats, Bools]:
    """Turn the tool towards the vertical, step by step, until it is clear.

    Args:
        vertices: Tips [mm], shape (n, 3).
        normals: Unit normals that give the azimuth, shape (n, 3).
        tilt: Tilts to begin with [rad], shape (n,).
        clearance: The solid check.
        wanted_mm: Clearance to reach.

    Returns:
        The first clear tilt of each point, zero where there is none, and whether it is
        clear.
    """
    tilt = tilt.copy()
    found = np.ones(len(vertices), np.bool_)
    todo = np.arange(len(vertices))
    while len(todo):
        gap = clearance(todo, vertices[todo], tilted(normals[todo], tilt[todo]))
        todo = todo[gap < wanted_mm]
        upright = tilt[todo] <= 0
        found[todo[upright]] = False
        todo = todo[~upright]
        tilt[todo] = np.maximum(tilt[todo] - RAISE_RAD, 0.0)
    return tilt, found
