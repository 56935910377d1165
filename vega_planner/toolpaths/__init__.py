# SPDX-License-Identifier: Apache-2.0
"""Pattern, spacing, orientation, linking and travel: patches to passes."""

from vega_planner.toolpaths.lay import lay_toolpaths

__all__ = ["lay_toolpaths"]
