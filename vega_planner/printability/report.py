# SPDX-License-Identifier: Apache-2.0
"""The outcome of the filters by area."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer, LayerStack, PrintabilityReport
from vega_planner.printability.reasons import reasons_of
from vega_planner.printability.remedies import Access
from vega_planner.printability.sides import INSIDE, NEITHER, OUTSIDE, SheetAssessment
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Area that may be printed from inside and the layers still count as printed as they are.
SLIVER_RATIO = 1e-4

#: Area that may be lost to slivers and still count as printable.
NEGLIGIBLE_RATIO = 2e-3


def summarised(
    stack: LayerStack,
    judged: list[SheetAssessment],
    cell: Workcell,
    settings: PrintabilitySettings,
    held: Access,
) -> PrintabilityReport:
    """Sum up the judgement of all sheets.

    Args:
        stack: The layers, cores as they were judged.
        judged: One judgement per sheet.
        cell: Robot, tool and placement.
        settings: The limits in force.
        held: Holds the tool at vertices of a sheet, to try what would help.
    """
    total = reach = access = clear = printable = 0.0
    split = 0
    codes = []
    for layer, sheet in zip(stack.sheets, judged):
        area, faces = layer.face_areas, layer.faces
        total += layer.area
        sides = [sheet.outside] + ([sheet.inside] if sheet.inside is not None else [])
        reach += _area_where(area, faces, np.any([s.reachable for s in sides], axis=0))
        access += _area_where(area, faces, sheet.outside.seen | _used(layer, sheet, INSIDE))
        clear += _area_where(area, faces, np.any([s.clear for s in sides], axis=0))
        printable += float(area[sheet.side != NEITHER].sum())
        if layer.kind != "core":
            split += len(np.unique(sheet.side[sheet.side != NEITHER])) > 1
        code = np.zeros(len(faces), np.int64)
        bad = np.flatnonzero(sheet.side == NEITHER)
        code[bad] = sheet.outside.code[faces[bad]].max(1)
        codes.append(code)
    total = max(total, 1e-300)
    # what fills the core has no outer side and is printed from wherever it can be
    turned = sum(
        float(layer.face_areas[sheet.side != OUTSIDE].sum())
        for layer, sheet in zip(stack.sheets, judged)
        if layer.kind != "core"
    )
    whole = turned <= SLIVER_RATIO * total
    status = "fully" if whole else "conditionally"
    if printable < (1 - NEGLIGIBLE_RATIO) * total:
        status = "not"
    return PrintabilityReport(
        status=status,
        reachable_ratio=reach / total,
        accessible_ratio=access / total,
        collision_free_ratio=clear / total,
        split_layers=split,
        reasons=reasons_of(stack, codes, judged, cell, settings, held),
        face_reasons=tuple(codes),
        unprintable_ratio=max(0.0, 1.0 - printable / total),
    )


def _used(layer: Layer, sheet: SheetAssessment, side: int) -> Bools:
    """Mark the vertices of the faces that are printed from a side."""
    mark = np.zeros(len(layer.vertices), np.bool_)
    mark[layer.faces[sheet.side == side].ravel()] = True
    return mark


def _area_where(areas: Floats, faces: Ints, good: Bools) -> float:
    if good.all():
        return float(areas.sum())
    return float((areas * good[faces].mean(1)).sum())
