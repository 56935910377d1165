# SPDX-License-Identifier: Apache-2.0
"""When the dispenser is switched, so that material flows while the tip moves along a bead."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.robot.material import Material

#: The valve is left open over pauses shorter than this [s].
SHORTEST_PAUSE_S = 0.05


def rests(path_id: Ints, reconfigures: Bools, material: Material) -> Floats:
    """Find how long the arm rests before each segment of a job.

    Args:
        path_id: Index of the pass of each segment, -1 for travel, shape (m,).
        reconfigures: True for the segments that change the configuration, shape (m,).
        material: Its dwells at the start of a pass, with pressure, and at its end, without.

    Returns:
        Times [s], shape (m,).
    """
    waits = np.where(path_id >= 0, material.start_dwell_s, 0.0)
    after = np.concatenate([[False], path_id[:-1] >= 0])
    return np.where(after & (path_id < 0) & ~reconfigures, material.end_dwell_s, waits)


def switching_times(starts: Floats, ends: Floats, material: Material) -> Floats:
    """Find the times at which the dispenser is switched on and off.

    Args:
        starts: Times at which the tip is at the starts of beads [s], rising, shape (m,); the
            beads begin after the dwell.
        ends: Times at which they end [s], shape (m,).
        material: Its lead and lag.

    Returns:
        On and off times [s], shape (k, 2), k <= m: `lead_s` before a bead begins, but not
        before time 0, and `lag_s` before it ends, but not before its middle. Beads with a
        shorter pause than `SHORTEST_PAUSE_S` between them share one switching.
    """
    on = np.maximum(np.asarray(starts) - material.lead_s, 0.0)
    off = np.maximum(np.asarray(ends) - material.lag_s, 0.5 * (starts + ends))
    if not len(on):
        return np.zeros((0, 2))
    apart = on[1:] - off[:-1] > SHORTEST_PAUSE_S
    first = np.concatenate([[True], apart])
    last = np.concatenate([apart, [True]])
    return np.column_stack([on[first], off[last]])
