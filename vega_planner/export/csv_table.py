# SPDX-License-Identifier: Apache-2.0
"""One self-contained CSV table of a job: joints, velocities, tip and valve, and its reader.

Unlike the result folder's `trajectory.csv` it has the velocities, the tip in the part frame
and the valve with its lead and lag, so that a controller needs nothing else.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vega_planner.export.job import ExportJob
from vega_planner.results.tables import format_rows, read_table

#: Digits after the point of SI columns, and of the tip's millimetres.
_SI_DIGITS, _TIP_DIGITS = 9, 6
_TIP = ("x_mm", "y_mm", "z_mm", "tool_x", "tool_y", "tool_z")
_END = ("valve", "extrude", "path_id")


def write_csv(job: ExportJob) -> str:
    """Write a job; the columns of the tip are there where the robot is at hand."""
    names = ["t_s", *job.joint_names, *(f"{name}_velocity" for name in job.joint_names)]
    columns = [job.times, *job.positions.T, *job.velocities.T]
    digits = [_SI_DIGITS] * len(columns)
    if job.robot is not None:
        points, axes = job.tip_in_part()
        names += _TIP
        columns += [*points.T, *axes.T]
        digits += [_TIP_DIGITS] * 3 + [_SI_DIGITS] * 3
    names += _END
    columns += [job.valve, job.extrude, job.path_id]
    rows = np.column_stack(columns).astype(np.float64)
    return ",".join(names) + "\n" + format_rows(rows, [*digits, 0, 0, 0]).decode()


def read_csv(source: str | Path) -> ExportJob:
    """Read back what `write_csv` wrote.

    Args:
        source: Path of the file.

    Raises:
        InvalidInput: If it is no such table.
    """
    table = read_table(Path(source), ("t_s", *_END))
    names = tuple(name.removesuffix("_velocity") for name in table if name.endswith("_velocity"))
    return ExportJob(
        joint_names=names,
        times=table["t_s"],
        positions=np.column_stack([table[name] for name in names]),
        velocities=np.column_stack([table[f"{name}_velocity"] for name in names]),
        valve=table["valve"] > 0.5,
        extrude=table["extrude"] > 0.5,
        path_id=table["path_id"].astype(np.int64),
    )
