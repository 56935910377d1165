# SPDX-License-Identifier: Apache-2.0
"""The automatic pose reaches all and beats poses at the edge of the travel."""

from __future__ import annotations

import numpy as np

from vega_planner.printability.pose import choose_pose
from vega_planner.robot.workcell import place

from .envelopes import default_cell, dome


def test_from_anywhere_the_same_pose_is_found_and_reaches_all():
    stack, cell = dome(), default_cell()
    pose = choose_pose(stack, cell)
    assert pose == choose_pose(stack, place(cell, (500.0, 0.0, 0.0, 30.0)))
    moved = place(cell, pose)
    layer = stack.layers[0]
    up = np.tile([0.0, 0.0, 1.0], (len(layer.vertices), 1))
    assert moved.reachable(layer.vertices, up).all()
