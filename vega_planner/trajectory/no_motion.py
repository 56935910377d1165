# SPDX-License-Identifier: Apache-2.0
"""The motion of a job in which nothing can be printed."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import PrintTrajectory
from vega_planner.robot.workcell import Workcell


def no_motion(cell: Workcell) -> PrintTrajectory:
    """Make a trajectory without samples, which still names joints and placement."""
    joints = len(cell.robot.joint_names)
    return PrintTrajectory(
        joint_names=cell.robot.joint_names,
        times=np.zeros(0),
        positions=np.zeros((0, joints)),
        velocities=np.zeros((0, joints)),
        extrude=np.zeros(0, bool),
        path_id=np.zeros(0, np.int64),
        T_base_part=cell.placement.T_base_part,
    )
