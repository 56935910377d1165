# SPDX-License-Identifier: Apache-2.0
"""Stage 1: load, repair and place the part; choose its restraint region."""

from vega_planner.part.load import load_part

__all__ = ["load_part"]
