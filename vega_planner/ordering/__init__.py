# SPDX-License-Identifier: Apache-2.0
"""Ordering: the deposition sequence of the patches."""

from vega_planner.ordering.order import PrintOrder, Violation, order_patches

__all__ = ["PrintOrder", "Violation", "order_patches"]
