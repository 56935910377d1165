# SPDX-License-Identifier: Apache-2.0
"""Printability: reach, line of sight, clearance of the solid tool, and the final check."""

from vega_planner.printability.assessment import (
    Assessment,
    SheetAssessment,
    Side,
    assess_printability,
)

__all__ = ["Assessment", "SheetAssessment", "Side", "assess_printability"]
