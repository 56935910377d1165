# SPDX-License-Identifier: Apache-2.0
"""CSV tables of the result folder: `toolpath.csv` and `trajectory.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Floats, PrintTrajectory, ToolpathSet
from vega_planner.errors import InvalidInput

#: Columns of `toolpath.csv` with the decimals they are written with: lengths to 10 nm.
TOOLPATH_COLUMNS = {
    "path_id": 0,
    "layer": 0,
    "patch": 0,
    "x_mm": 5,
    "y_mm": 5,
    "z_mm": 5,
    "tool_x": 8,
    "tool_y": 8,
    "tool_z": 8,
    "width_mm": 4,
    "height_mm": 4,
    "extrude": 0,
}

#: Decimals of times [s] and joint positions [m, rad] in `trajectory.csv`.
SI_DECIMALS = 9

_LARGEST = 1e9


def format_rows(values: Floats, decimals: Sequence[int]) -> bytes:
    """Print a table of numbers.

    Args:
        values: Finite numbers below 1e9 in magnitude, shape (n, k).
        decimals: Digits after the point for each of the k columns, 0 to 9.

    Returns:
        Text with commas between columns and a newline after each row.

    Raises:
        InvalidInput: If a number is not finite or too large.
    """
    from vega_planner.results.text_kernels import print_rows

    values = np.ascontiguousarray(values, np.float64)
    if values.size and not np.abs(values).max() < _LARGEST:  # also catches NaN
        raise InvalidInput(f"a table holds {np.abs(values).max():g}; must be below {_LARGEST:g}")
    out = np.empty(values.size * 22 + 1, np.uint8)
    used = print_rows(values, np.asarray(decimals, np.int64), out)
    return out[:used].tobytes()


def toolpath_rows(toolpaths: ToolpathSet) -> Floats:
    """Lay out every waypoint in print order, as in `TOOLPATH_COLUMNS`.

    Travel rows carry path_id -1 and extrude 0, with the layer, patch, width and height
    of the pass they lead to; the first row of each pass has extrude 0, since a bead
    ends at the row that says so.
    """
    if not toolpaths.passes:
        return np.zeros((0, len(TOOLPATH_COLUMNS)))
    blocks = []
    for index, move in enumerate(toolpaths.travels):
        path = toolpaths.passes[min(index, len(toolpaths.passes) - 1)]
        inner = slice(0 if index == 0 else 1, None if index == len(toolpaths.passes) else -1)
        points, axes = move.points[inner], move.axes[inner]
        block = np.empty((len(points), len(TOOLPATH_COLUMNS)))
        block[:, :3] = -1, path.layer, path.patch
        block[:, 3:6], block[:, 6:9] = points, axes
        block[:, 9:] = path.width[0], path.height[0], 0
        blocks.append(block)
        if index < len(toolpaths.passes):
            blocks.append(_pass_rows(index, toolpaths))
    return np.concatenate(blocks)


def _pass_rows(index: int, toolpaths: ToolpathSet) -> Floats:
    path = toolpaths.passes[index]
    block = np.empty((len(path.points), len(TOOLPATH_COLUMNS)))
    block[:, :3] = index, path.layer, path.patch
    block[:, 3:6], block[:, 6:9] = path.points, path.axes
    block[:, 9], block[:, 10], block[:, 11] = path.width, path.height, 1
    block[0, 11] = 0
    return block


def toolpath_csv(toolpaths: ToolpathSet) -> bytes:
    """Print `toolpath.csv`."""
    header = ",".join(TOOLPATH_COLUMNS) + "\n"
    return header.encode() + format_rows(toolpath_rows(toolpaths), list(TOOLPATH_COLUMNS.values()))


def trajectory_csv(trajectory: PrintTrajectory) -> bytes:
    """Print `trajectory.csv`: time, joints, extrude, path_id."""
    names = ["t_s", *trajectory.joint_names, "extrude", "path_id"]
    rows = np.column_stack(
        [trajectory.times, trajectory.positions, trajectory.extrude, trajectory.path_id]
    )
    decimals = [SI_DECIMALS] * (1 + len(trajectory.joint_names)) + [0, 0]
    return (",".join(names) + "\n").encode() + format_rows(rows, decimals)


def velocities_csv(trajectory: PrintTrajectory) -> bytes:
    """Print `velocities.csv`: time and joint velocities [m/s, rad/s], row by row as the above.

    Between the rows of `trajectory.csv` a joint follows the cubic Hermite curve, which needs
    them; a driver does not guess them.
    """
    header = ",".join(["t_s", *trajectory.joint_names]) + "\n"
    rows = np.column_stack([trajectory.times, trajectory.velocities])
    return header.encode() + format_rows(rows, [SI_DECIMALS] * rows.shape[1])


def read_table(path: str | Path, columns: Sequence[str] | None = None) -> dict[str, Floats]:
    """Read a CSV table of numbers.

    Args:
        path: CSV file with a header line.
        columns: Names that must be there.

    Returns:
        Columns by name, each of shape (n,).

    Raises:
        InvalidInput: If the file cannot be read, is not a table of numbers or lacks a
            column.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8") as file:
            names = file.readline().strip().split(",")
            values = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InvalidInput(f"table {path} cannot be read: {error}") from error
    missing = [name for name in columns or () if name not in names]
    if missing:
        raise InvalidInput(f"table {path} has no column {missing[0]}; has: {', '.join(names)}")
    if values.size == 0:
        values = np.zeros((0, len(names)))
    if values.shape[1] != len(names):
        raise InvalidInput(f"table {path} has {values.shape[1]} columns and {len(names)} names")
    return {name: values[:, k].copy() for k, name in enumerate(names)}
