# SPDX-License-Identifier: Apache-2.0
"""The bead: a stadium section, width across and height along the tool axis."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from vega_planner.datatypes import Floats, row_lengths

_Length = TypeVar("_Length", float, Floats)

#: What the two round sides lack against a rectangle of the same width, per height.
ROUNDING = 1 - math.pi / 4

#: The flow is varied between these parts of the nominal, no further: beyond, a bead
#: stops looking like a bead.
LEAST_FLOW, MOST_FLOW = 0.6, 1.4


def section_area(width: _Length, height: _Length) -> _Length:
    """Area of the section [mm²]: a rectangle with half circles at both sides."""
    return (width - height) * height + math.pi / 4 * height * height


def fill_spacing(width: float, height: float) -> float:
    """Spacing [mm] at which beads side by side deposit the volume between them.

    Section over height: 1.03 mm for a bead of 1.2 by 0.8 mm.
    """
    return section_area(width, height) / height


def fill_width(cell: Floats, height: Floats, nominal: float) -> Floats:
    """Width [mm] with which a bead fills a strip.

    Args:
        cell: Width of the strip [mm], shape (n,).
        height: Height of bead and strip [mm], shape (n,).
        nominal: Strip of a bead at nominal flow [mm].

    Returns:
        Widths, at least the height so that the section stays a stadium, shape (n,).
    """
    cell = np.clip(cell, LEAST_FLOW * nominal, MOST_FLOW * nominal)
    return np.maximum(cell + ROUNDING * height, height)


def lean(points: Floats, axes: Floats, normals: Floats) -> Floats:
    """Sine of the angle by which the nozzle leans across the path.

    Args:
        points: A pass, shape (n, 3), n >= 2.
        axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
        normals: Normals of the surface, any length, shape (n, 3).
    """
    along = np.gradient(points, axis=0)
    across = np.cross(normals, along)
    across /= np.maximum(row_lengths(across)[:, None], 1e-12)
    up = np.cross(along, across)
    up /= np.maximum(row_lengths(up)[:, None], 1e-12)
    side = np.einsum("ij,ij->i", axes, across)
    return np.abs(side) / np.maximum(np.hypot(side, np.einsum("ij,ij->i", axes, up)), 1e-12)


def leaning_section(width: Floats, height: Floats, sine: Floats) -> tuple[Floats, Floats]:
    """Reshape a bead laid with a nozzle that leans, keeping its section area.

    A flat bead turned by an angle d stands out of its layer, by (w - h)/2 sin d + h/2
    from the middle. With the area A fixed this is least at
    h^2 = A sin d / (1 - pi/4 sin d), or at the round bead where that is higher than wide.

    Args:
        width: Width of the upright bead [mm], shape (n,).
        height: Its height [mm], shape (n,).
        sine: sin d, shape (n,).

    Returns:
        Width and height, the height no less than before.
    """
    area = section_area(width, height)
    best = np.sqrt(area * sine / (1 - math.pi / 4 * sine))
    height = np.maximum(height, np.minimum(best, np.sqrt(area / (math.pi / 4))))
    return np.maximum(area / height + ROUNDING * height, height), height
