# SPDX-License-Identifier: Apache-2.0
"""Errors of dispenser and robot, put on the beads of a virtual print."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from vega_planner.assess.beads import BeadRows, section_area, section_width
from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput


@dataclass(frozen=True)
class Dispensing:
    """What goes wrong between the plan and the bead.

    Attributes:
        flow_ratio: Flow over the flow that was planned; from a pressure that is off.
        speed_ratio: Speed of the tip over the speed the pressure was set for, along
            the whole print; a slow tip leaves a wide bead.
        start_lag_mm: Length of each pass before the material comes; negative where it
            comes early and piles up at the start.
        stop_lag_mm: Length worth of material that still comes after the end of each
            pass, and piles up there; negative where the flow stops early.
        ripple_ratio: Standard deviation of the flow over its mean, along the path.
        ripple_mm: Length over which the flow's ripple is correlated.
        wander_mm: Standard deviation of the tip's distance from its path.
        offset_mm: Error along x, y, z that is the same everywhere.
    """

    flow_ratio: float = 1.0
    speed_ratio: float = 1.0
    start_lag_mm: float = 0.0
    stop_lag_mm: float = 0.0
    ripple_ratio: float = 0.0
    ripple_mm: float = 5.0
    wander_mm: float = 0.0
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("flow_ratio", 0.01, 100.0),
            ("speed_ratio", 0.01, 100.0),
            ("ripple_ratio", 0.0, 0.5),
            ("ripple_mm", 0.01, 1e6),
            ("wander_mm", 0.0, 10.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InvalidInput(f"dispensing {name} is {value:g}; allowed: {low:g} to {high:g}")


#: Nothing goes wrong.
PERFECT = Dispensing()


def dispensed(
    beads: BeadRows, errors: Dispensing, seed: int = 0, speeds_mm_s: Floats | None = None
) -> BeadRows:
    """Put the errors on the beads.

    The section keeps its height, which the gap under the nozzle sets; its area is that
    of the flow over the speed.

    Args:
        beads: What was planned.
        errors: What goes wrong.
        seed: Seed of ripple and wander.
        speeds_mm_s: Speed of the tip at the rows over the set speed, shape (n,), where
            it is not the same everywhere.

    Returns:
        What is deposited.
    """
    if speeds_mm_s is None and all(
        getattr(errors, item.name) == item.default for item in fields(errors)
    ):
        return beads
    generator = np.random.default_rng(seed)
    steps = np.linalg.norm(np.diff(beads.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    flow = np.full(len(along), errors.flow_ratio / errors.speed_ratio)
    if speeds_mm_s is not None:
        flow = flow / np.maximum(speeds_mm_s, 0.05)
    flow = flow * np.maximum(1 + errors.ripple_ratio * _ripple(generator, along, errors), 0.1)
    points = beads.points + np.asarray(errors.offset_mm)
    if errors.wander_mm > 0:
        drift = np.column_stack([_ripple(generator, along, errors) for _ in range(3)])
        points = points + errors.wander_mm * drift
    area = section_area(beads.width, beads.height) * flow
    beads = replace(beads, points=points, width=section_width(area, beads.height))
    if errors.start_lag_mm or errors.stop_lag_mm:
        beads = _lagged(beads, errors, along)
    return beads


def _ripple(generator: np.random.Generator, along: Floats, errors: Dispensing) -> Floats:
    """Draw noise of unit variance, correlated over `ripple_mm` along the path."""
    knots = np.arange(0.0, along[-1] + 2 * errors.ripple_mm, errors.ripple_mm)
    return np.interp(along, knots, generator.normal(size=len(knots))) * np.sqrt(1.5)


def _lagged(beads: BeadRows, errors: Dispensing, along: Floats) -> BeadRows:
    """Cut off what comes late or stops early, and pile up what comes early or late."""
    extrude, width = beads.extrude.copy(), beads.width.copy()
    area = section_area(beads.width, beads.height)
    joined = beads.joined
    starts = np.flatnonzero(joined & ~np.concatenate([[False], joined[:-1]]))
    ends = np.flatnonzero(joined & ~np.concatenate([joined[1:], [False]])) + 1
    for first, last in zip(starts, ends):
        inside = slice(first, last + 1)
        late = along[inside] - along[first] <= errors.start_lag_mm - 1e-9
        early = along[last] - along[inside] < -errors.stop_lag_mm - 1e-9
        extrude[inside] &= ~(late | early)
        for row, extra in ((first, -errors.start_lag_mm), (last, errors.stop_lag_mm)):
            if extra > 0:
                width[row] = _blob_width(width[row], beads.height[row], area[row] * extra)
    return replace(beads, extrude=extrude, width=width)


def _blob_width(width: float, height: float, extra: float) -> float:
    """Find the width of the round end of a bead that holds some more material.

    Args:
        width: Width of the bead [mm].
        height: Its height [mm].
        extra: Volume to add to the half cake ahead of the bead's end [mm³].
    """
    side = 0.5 * min(height, width)

    def half_cake(radius: float) -> float:
        flat = max(radius - side, 0.0)
        whole = np.pi * flat**2 * height + np.pi**2 * flat * side**2 + 4 / 3 * np.pi * side**3
        return float(0.5 * whole)

    wanted = half_cake(0.5 * width) + extra
    low, high = 0.5 * width, 0.5 * width + np.sqrt(2 * extra / (np.pi * height)) + height
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if half_cake(middle) < wanted else (low, middle)
    return float(low + high)
