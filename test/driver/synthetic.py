# SPDX-License-Identifier: Apache-2.0
"""Small jobs and machines for the driver's tests."""

from __future__ import annotations

import numpy as np

from vega_robot_driver.job import PrintJob, estimated_velocities
from vega_robot_driver.machine import Machine

JOINTS = ("x_axis", "y_axis", "z_axis", "a_axis", "b_axis")
LIMITS = {
    "lower": (-0.2, -0.08, -0.16, -1.57, -1.57),
    "upper": (0.2, 0.08, 0.0, 1.57, 1.57),
    "velocity": (0.5, 0.5, 0.5, 3.14, 3.14),
}


def zigzag_job(
    passes: int = 5, seconds: float = 4.0, joints: tuple[str, ...] = JOINTS
) -> PrintJob:
    """Straight passes of 20 mm at 5 mm/s with 1 s of travel between them."""
    step, times, rows, extrude, path_id = 0.02, [], [], [], []
    clock = 0.0
    for index in range(passes):
        for is_pass, duration in ((False, 1.0), (True, seconds)):
            count = round(duration / step)
            for k in range(count + (index == 0 and not is_pass)):
                s = (k + 1 if (index or is_pass) else k) / count
                ease = s * s * (3 - 2 * s)
                if is_pass:
                    x = ease * 0.02 if index % 2 == 0 else (1 - ease) * 0.02
                    y = 0.0012 * index
                else:
                    x = 0.0 if index % 2 == 0 else 0.02
                    y = 0.0012 * (index - 1 + ease) if index else 0.0
                row = np.zeros(len(joints))
                row[:3] = x, y, -0.05
                row[3:5] = 0.1 * x / 0.02, 0.05
                times.append(clock)
                rows.append(row)
                extrude.append(is_pass)
                path_id.append(index if is_pass else -1)
                clock += step
    t, p = np.array(times), np.array(rows)
    return PrintJob(
        joint_names=joints,
        times=t,
        positions=p,
        velocities=estimated_velocities(t, p),
        extrude=np.array(extrude),
        path_id=np.array(path_id),
        path_layer=np.arange(passes) // 2,
    )


def machine(**changes: object) -> Machine:
    """A simulated machine with the axes of the jobs above."""
    values: dict = {
        "hardware": "simulated",
        "joint_names": JOINTS,
        "start": (0.0,) * 5,
        "orphan_s": 5.0,
        **LIMITS,
        **changes,
    }
    return Machine(**values)
