# SPDX-License-Identifier: Apache-2.0
"""Splitting: cut a layer into pieces that can each be printed in one go."""

from vega_planner.splitting.split import split_layers

__all__ = ["split_layers"]
