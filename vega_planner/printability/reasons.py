# SPDX-License-Identifier: Apache-2.0
"""Why not: reasons by layer and cause, with what would help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import REASON_CODES, Ints, LayerStack, Reason
from vega_planner.printability.remedies import Access, remedy_of
from vega_planner.printability.sides import SheetAssessment
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Areas below this [mm²] are slivers and not worth a reason.
LEAST_AREA_MM2 = 1.0


def reasons_of(
    stack: LayerStack,
    codes: list[Ints],
    judged: Sequence[SheetAssessment],
    cell: Workcell,
    settings: PrintabilitySettings,
    access: Access,
) -> tuple[Reason, ...]:
    """Collect the reasons against printing, largest area first.

    Args:
        stack: The layers.
        codes: Per sheet the code index of each face, 0 printable.
        judged: Judgement of each sheet.
        cell: Robot, tool and placement.
        settings: The limits in force.
        access: Holds the tool at vertices of a sheet, to try what would help.
    """
    found: list[Reason] = []
    concerned: dict[int, list[tuple[int, Ints]]] = {}
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
            found.append(Reason(name, number, area, where, ""))
            vertices = np.unique(layer.faces[faces])
            vertices = vertices[judged[number].outside.code[vertices] == value]
            concerned.setdefault(int(value), []).append((number, vertices))
    found.sort(key=lambda reason: (-reason.area_mm2, reason.layer, reason.code))
    remedies = {
        REASON_CODES[value - 1]: remedy_of(value, sheets, stack, judged, access, cell, settings)
        for value, sheets in sorted(concerned.items())
    }
    return tuple(replace(reason, remedy=remedies[reason.code]) for reason in found)
