# SPDX-License-Identifier: Apache-2.0
"""Beads of a filament slicer's G-code, so that its print can be printed virtually."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from vega_planner.assess.beads import BeadRows, section_width
from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput

_WORD = re.compile(r"([A-Z])([-+]?[0-9]*\.?[0-9]+)")
_SKIPPED = ("Skirt", "Skirt/Brim", "Brim", "Wipe tower", "Custom")


def read_gcode(
    path: str | Path,
    *,
    layer_height_mm: float,
    filament_diameter_mm: float = 1.75,
    centre: tuple[float, float] | None = (0.0, 0.0),
) -> BeadRows:
    """Read the extrusion moves of G-code as PrusaSlicer writes it.

    A bead's width follows from the filament it used. Skirts, brims and custom start
    moves (told by `;TYPE:` comments) are left out. Layers are flat: each bead's height
    is the step from the layer below, and its middle half of that under the nozzle.

    Args:
        path: G-code file.
        layer_height_mm: Height of the first layer.
        filament_diameter_mm: Diameter of the filament.
        centre: Where the middle of the print's box goes in x and y; None leaves it where
            the slicer put it.

    Raises:
        InvalidInput: If the file cannot be read or extrudes nothing.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InvalidInput(f"G-code {path} cannot be read: {error.strerror}") from error
    moves = _moves(lines)
    if not len(moves):
        raise InvalidInput(f"G-code {path} extrudes nothing")
    starts, ends, filament = moves[:, :3], moves[:, 3:6], moves[:, 6]
    levels = np.unique(ends[:, 2].round(4))
    steps = np.diff(levels, prepend=levels[0] - layer_height_mm)
    height = steps[np.searchsorted(levels, ends[:, 2].round(4))]
    length = np.linalg.norm(ends - starts, axis=1)
    area = 0.25 * np.pi * filament_diameter_mm**2 * filament / np.maximum(length, 1e-9)
    rows = np.stack([starts, ends], axis=1)
    rows[:, :, 2] -= 0.5 * height[:, None]
    if centre is not None:
        flat = rows[:, :, :2].reshape(-1, 2)
        rows[:, :, :2] += np.asarray(centre) - (flat.min(0) + flat.max(0)) / 2
    return _rows(rows, section_width(area, height), height)


def _rows(ends: Floats, width: Floats, height: Floats) -> BeadRows:
    """Lay out separate moves; moves that follow each other share a pass."""
    count = len(ends)
    follows = np.zeros(count, bool)
    follows[1:] = (np.abs(ends[1:, 0] - ends[:-1, 1]).max(1) < 1e-6) & (
        np.abs(height[1:] - height[:-1]) < 1e-6
    )
    return BeadRows(
        path_id=np.repeat(np.cumsum(~follows) - 1, 2),
        points=ends.reshape(-1, 3),
        axes=np.tile([0.0, 0.0, 1.0], (2 * count, 1)),
        width=np.repeat(width, 2),
        height=np.repeat(height, 2),
        extrude=np.tile([False, True], count),
    )


def _moves(lines: list[str]) -> Floats:
    """Collect extruding moves: start, end, filament used, shape (n, 7)."""
    place, used, relative, skipped = [0.0, 0.0, 0.0], 0.0, False, False
    moves: list[list[float]] = []
    for line in lines:
        if line.startswith(";TYPE:"):
            skipped = line[6:].strip() in _SKIPPED
            continue
        code = line.split(";", 1)[0].strip()
        if not code:
            continue
        if code.startswith(("M82", "M83")):
            relative = code.startswith("M83")
            continue
        if not code.startswith(("G0 ", "G1 ", "G92")):
            continue
        words = {letter: float(number) for letter, number in _WORD.findall(code)}
        if code.startswith("G92"):
            used = words.get("E", used)
            continue
        there = [words.get(axis, old) for axis, old in zip("XYZ", place)]
        filament = 0.0
        if "E" in words:
            filament = words["E"] if relative else words["E"] - used
            used = words["E"]
        moved = there[0] != place[0] or there[1] != place[1]
        if filament > 0 and moved and not skipped:
            moves.append([*place, *there, filament])
        place = there
    return np.array(moves).reshape(-1, 7)
