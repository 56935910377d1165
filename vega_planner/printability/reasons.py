# SPDX-License-Identifier: Apache-2.0
"""Why not: reasons by layer and cause, with what would help."""

from __future__ import annotations

from typing import Any

import numpy as np

from vega_planner.datatypes import REASON_CODES, Ints, LayerStack, Reason
from vega_planner.settings import PrintabilitySettings

#: Areas below this [mm²] are slivers and not worth a reason.
LEAST_AREA_MM2 = 1.0


def reasons_of(
    stack: LayerStack,
    codes: list[Ints],
    judged: Any,
    cell: Any,
    settings: PrintabilitySettings,
) -> tuple[Reason, ...]:
    """Collect the reasons against printing, largest area first.

    Args:
        stack: The layers.
        codes: Per sheet the code index of each face, 0 printable.
        judged: Judgement of each sheet.
        cell: Robot, tool and placement.
        settings: The limits in force.
    """
    found = []
    for number, (layer, code) in enumerate(zip(stack.sheets, codes)):
        for value in np.unique(code[code > 0]):
            faces = np.flatnonzero(code == value)
            weights = layer.face_areas[faces]
            area = float(weights.sum())
            if area < LEAST_AREA_MM2:
                continue
            centres = layer.vertices[layer.faces[faces]].mean(1)
            middle = (centres * weights[:, None]).sum(0) / area
            nearest = centres[np.argmin(((centres - middle) ** 2).sum(1))]
            where = (float(nearest[0]), float(nearest[1]), float(nearest[2]))
            name = REASON_CODES[value - 1]
            found.append(Reason(name, number, area, where, _remedy(name, cell, settings)))
    found.sort(key=lambda reason: (-reason.area_mm2, reason.layer, reason.code))
    return tuple(found)


def _remedy(name: str, cell: Any, settings: PrintabilitySettings) -> str:
    texts = {
        "out_of_travel": "move the part towards the middle of the travel: --pose auto",
        "wrist_limit": (
            f"tilt the nozzle less: max_tilt_deg is {settings.max_tilt_deg:g}, "
            "or --orientation vertical"
        ),
        "own_layer": "split the layer, or choose a restraint region (--brr down)",
        "printed_part": (
            f"a smaller clearance than {settings.clearance_mm:g} mm, a slimmer tool, or another "
            "restraint region"
        ),
        "plate": "lift the part, let the nozzle stand steeper, or print on a substrate",
        "substrate": "a lower substrate (vega substrate --height), or a slimmer tool",
        "robot_body": "turn the part about z: --pose auto",
        "no_support": "a restraint region facing down (--brr down), or a substrate",
    }
    return texts[name]
