# SPDX-License-Identifier: Apache-2.0
"""Resolve cycles of patches that wait for each other: tilt, then cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Patch
from vega_planner.ordering.task import Graph, OrderTask
from vega_planner.printability.orientation import tilt_of, tilted
from vega_planner.progress import Progress, Report
from vega_planner.splitting.bands import bands

#: Largest tilts tried for patches that wait for each other [deg].
TILTS_DEG = (45.0, 20.0)

#: Heights of the bands they are cut into where that does not help [mm].
BANDS_MM = (6.0, 3.0, 1.5)

#: Number of patches at which cutting ends.
MOST_PATCHES = 400


def untangled(task: OrderTask, graph: Graph, report: Report, cut: bool) -> Graph:
    """Resolve cycles: first by steeper tool axes, then by cutting into bands of height."""
    for most_deg in TILTS_DEG:
        patches = list(graph.patches)
        for nodes in graph.tangles():
            for node in nodes:
                patches[node] = _raised(patches[node], np.radians(most_deg))
        steeper = task.with_blocking(graph, patches)
        if not steeper.tangles():
            return steeper
    for height in BANDS_MM if cut else ():
        report(Progress("ordering", 0.35))
        tangled = {node for nodes in graph.tangles() for node in nodes}
        patches = []
        for node, patch in enumerate(graph.patches):
            if node not in tangled:
                patches.append(patch)
                continue
            low, high = patch.vertices[:, 2].min(), patch.vertices[:, 2].max()
            first = task.cell.placement.plate_z_mm + height
            cuts = np.arange(first, high - 0.3 * height, height)
            patches += bands(patch, [float(z) for z in cuts if z > low + 0.3 * height])
        if len(patches) > MOST_PATCHES:
            break
        if len(patches) > len(graph.patches):
            graph = task.with_blocking(task.graph(patches))
        if not graph.tangles():
            break
    return graph


def _raised(patch: Patch, most: float) -> Patch:
    tilt = np.minimum(tilt_of(patch.tool_axes), most)
    return replace(patch, tool_axes=tilted(patch.tool_axes, tilt))
