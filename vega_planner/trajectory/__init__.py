# SPDX-License-Identifier: Apache-2.0
"""Stage 7: toolpaths to a timed joint trajectory with dispensing."""

from vega_planner.trajectory.make_trajectory import make_clear_trajectory, make_trajectory
from vega_planner.trajectory.no_motion import no_motion

__all__ = ["make_clear_trajectory", "make_trajectory", "no_motion"]
