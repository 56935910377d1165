# SPDX-License-Identifier: Apache-2.0
"""Stage 7: toolpaths to a timed joint trajectory with dispensing."""

from vega_planner.trajectory.make_trajectory import make_trajectory

__all__ = ["make_trajectory"]
