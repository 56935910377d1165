# SPDX-License-Identifier: Apache-2.0
"""The bead: a stadium section, width across and height along the tool axis."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from vega_planner.datatypes import Floats

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
