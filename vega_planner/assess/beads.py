# SPDX-License-Identifier: Apache-2.0
"""Beads: what a toolpath leaves behind, as rows of points with a section."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, ToolpathSet, frozen_array
from vega_planner.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class BeadRows:
    """Waypoints of a print. A bead joins consecutive rows of one pass.

    The section of a bead is a stadium: `width` across, `height` along the axis, its
    sides rounded by half the height.

    Attributes:
        path_id: Pass each row belongs to, below zero on travel, shape (n,).
        points: Centres of the section [mm], shape (n, 3).
        axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
        width: Bead width [mm], shape (n,).
        height: Bead height [mm], shape (n,).
        extrude: True where a bead ends at the row, shape (n,).
    """

    path_id: Ints
    points: Floats
    axes: Floats
    width: Floats
    height: Floats
    extrude: Bools

    def __post_init__(self) -> None:
        n = len(self.points)
        for name, dtype, shape in (
            ("path_id", np.int64, (n,)),
            ("points", np.float64, (n, 3)),
            ("axes", np.float64, (n, 3)),
            ("width", np.float64, (n,)),
            ("height", np.float64, (n,)),
            ("extrude", np.bool_, (n,)),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), dtype, shape))
        joined = np.flatnonzero(self.joined)
        used = np.union1d(joined, joined + 1)
        for name in ("width", "height"):
            values = getattr(self, name)[used]
            if len(values) and values.min() <= 0:
                raise InvalidInput(f"bead {name} {values.min():g} mm; must be above 0")
        lengths = np.linalg.norm(self.axes[used], axis=1)
        if len(used) and abs(lengths - 1).max() > 1e-3:
            raise InvalidInput("tool axes are not unit vectors")

    @property
    def joined(self) -> Bools:
        """True where a bead joins the row with the next, shape (n - 1,)."""
        same = self.path_id[1:] == self.path_id[:-1]
        return same & self.extrude[1:] & (self.path_id[1:] >= 0)

    @property
    def length_mm(self) -> float:
        """Length of all beads [mm]."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return float(steps[self.joined].sum())

    @property
    def volume_mm3(self) -> float:
        """Volume of all beads [mm³]: section times length, without the round ends."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        areas = section_area(self.width, self.height)
        return float((steps * 0.5 * (areas[1:] + areas[:-1]))[self.joined].sum())


def section_area(width: Floats, height: Floats) -> Floats:
    """Compute the area of a stadium section [mm²]."""
    flat, small = np.abs(width - height), np.minimum(width, height)
    return flat * small + 0.25 * np.pi * small**2


def section_width(area: Floats, height: Floats) -> Floats:
    """Find the width of a stadium section from its area and height.

    Args:
        area: Areas [mm²], shape (n,), > 0.
        height: Heights [mm], shape (n,), > 0.

    Returns:
        Widths [mm]; below the height where the area is less than the full circle's,
        where the stadium stands upright.
    """
    wide = area / height + height * (1 - 0.25 * np.pi)
    # upright: (h - w) w + pi/4 w² = area, with c = 1 - pi/4: c w² - h w + area = 0
    c = 1 - 0.25 * np.pi
    upright = (height - np.sqrt(np.maximum(height**2 - 4 * c * area, 0.0))) / (2 * c)
    return np.where(wide >= height, wide, upright)


def beads_of(toolpaths: ToolpathSet) -> BeadRows:
    """Lay out the passes of a toolpath as rows of beads; a prime line is left out."""
    passes = [path for path in toolpaths.passes if path.patch >= 0]
    if not passes:
        none, nowhere = np.zeros(0), np.zeros((0, 3))
        return BeadRows(none.astype(np.int64), nowhere, nowhere, none, none, none.astype(bool))
    extrude = np.concatenate([np.arange(len(path.points)) > 0 for path in passes])
    return BeadRows(
        path_id=np.repeat(np.arange(len(passes)), [len(path.points) for path in passes]),
        points=np.concatenate([path.points for path in passes]),
        axes=np.concatenate([path.axes for path in passes]),
        width=np.concatenate([path.width for path in passes]),
        height=np.concatenate([path.height for path in passes]),
        extrude=extrude,
    )


def read_beads(path: str | Path) -> BeadRows:
    """Read the beads of a `toolpath.csv`.

    Raises:
        InvalidInput: If it cannot be read, lacks a column or holds no bead.
    """
    from vega_planner.results.tables import TOOLPATH_COLUMNS, read_table

    columns = read_table(path, [name for name in TOOLPATH_COLUMNS if name != "layer"])
    beads = BeadRows(
        path_id=columns["path_id"].astype(np.int64),
        points=np.column_stack([columns[f"{axis}_mm"] for axis in "xyz"]),
        axes=np.column_stack([columns[f"tool_{axis}"] for axis in "xyz"]),
        width=columns["width_mm"],
        height=columns["height_mm"],
        # a prime line belongs to no patch and is not part of the print
        extrude=(columns["extrude"] > 0.5) & (columns["patch"] >= 0),
    )
    if not beads.joined.any():
        raise InvalidInput(f"{path} holds no bead")
    return beads
