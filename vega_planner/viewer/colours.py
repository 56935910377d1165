# SPDX-License-Identifier: Apache-2.0
"""Colours of layers, reasons and speeds: the same in the browser and in RViz. sRGB 0..255."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vega_planner.datatypes import REASON_CODES, Bools, Floats

Colour = tuple[int, int, int]

#: By `REASON_CODES`: reach in reds, collisions in violets, support in brown.
REASON_COLOURS: dict[str, Colour] = dict(
    zip(
        REASON_CODES,
        (
            (214, 39, 40), (255, 105, 97), (148, 65, 200), (199, 60, 170),
            (90, 60, 170), (120, 100, 210), (60, 60, 110), (140, 86, 50),
        ),
        strict=True,
    )
)  # fmt: skip
RESTRAINT: Colour = (240, 150, 40)
_RAMP = np.array([(38, 70, 160), (40, 140, 170), (70, 175, 110), (190, 200, 70), (250, 215, 90)])
_SLOW, _FAST = np.array([200, 35, 40]), np.array([45, 125, 190])


def layer_colour(index: int, count: int) -> Colour:
    """Colour of a layer: blue outside over green to yellow at the core."""
    place = (len(_RAMP) - 1) * index / max(count - 1, 1)
    low = min(int(place), len(_RAMP) - 2)
    red, green, blue = _RAMP[low] + (place - low) * (_RAMP[low + 1] - _RAMP[low])
    return int(red), int(green), int(blue)


def speed_colours(speeds: Floats, printing: Bools) -> NDArray[np.uint8]:
    """Colour points by the tip's speed: red where it stands, blue at the usual speed.

    Args:
        speeds: Speeds in any unit, shape (n,).
        printing: The points that count for the usual speed, shape (n,).

    Returns:
        Colours, shape (n, 3).
    """
    top = float(np.percentile(speeds[printing], 95)) if printing.any() else 1.0
    share = np.clip(speeds / max(top, 1e-9), 0.0, 1.0)[:, None]
    return np.asarray(_SLOW + share * (_FAST - _SLOW)).astype(np.uint8)
