# SPDX-License-Identifier: Apache-2.0
"""When the dispenser is switched, so that material flows while the tip moves along a bead."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.robot.material import Material

#: The valve is left open over pauses shorter than this [s].
SHORTEST_PAUSE_S = 0.05


def switching_times(starts: Floats, ends: Floats, material: Material) -> Floats:
    """Find the times at which the dispenser is switched on and off.

    Args:
        starts: Times at which beads begin [s], rising, shape (m,).
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
