# SPDX-License-Identifier: Apache-2.0
"""Plans for machines' controllers: G-code, URScript, CSV."""

from vega_planner.export.export_plan import FORMATS, export_plan

__all__ = ["FORMATS", "export_plan"]
