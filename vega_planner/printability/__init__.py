# SPDX-License-Identifier: Apache-2.0
"""Printability: reach, line of sight, clearance of the solid tool, and the final check."""

from vega_planner.printability.assessment import Assessment, assess_printability
from vega_planner.printability.sides import SheetAssessment, Side

__all__ = ["Assessment", "SheetAssessment", "Side", "assess_printability"]
