# SPDX-License-Identifier: Apache-2.0
"""Conformal substrates for parts without a flat base."""

from vega_planner.substrate.bowl import Substrate, make_substrate, stands_flat
from vega_planner.substrate.standing import stand_on_substrate

__all__ = ["Substrate", "make_substrate", "stand_on_substrate", "stands_flat"]
