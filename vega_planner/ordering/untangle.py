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

#: Heights of the bands they are cut into where that does not help, in bead widths, so that
#: whole beads fit into a band on a wall.
BANDS_WIDTHS = (4.0, 2.0)

#: Height of the bands, in bead widths, where even those leave too much in the nozzle's way:
#: a bead and the room it needs, at the price of a wall that is not filled as well.
FINEST_WIDTHS = 1.25

#: Number of patches at which cutting ends.
MOST_PATCHES = 1500


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
    whole = graph
    for widths in BANDS_WIDTHS if cut else ():
        report(Progress("ordering", 0.35))
        finer = in_bands(task, whole, widths)
        if finer is None:
            break
        graph = finer
        if not graph.tangles():
            break
    return graph


def in_bands(task: OrderTask, graph: Graph, widths: float) -> Graph | None:
    """Cut the patches that wait for each other into bands of height.

    Args:
        task: What stays the same while orders are tried.
        graph: The patches, with what stands in their way.
        widths: Height of the bands, in bead widths.

    Returns:
        The graph of the pieces; None where there would be too many.
    """
    height = widths * task.bead_width_mm
    tangled = {node for nodes in graph.tangles() for node in nodes}
    patches: list[Patch] = []
    for node, patch in enumerate(graph.patches):
        if node not in tangled:
            patches.append(patch)
            continue
        low, high = patch.vertices[:, 2].min(), patch.vertices[:, 2].max()
        first = task.cell.placement.plate_z_mm + height
        cuts = np.arange(first, high - 0.3 * height, height)
        patches += bands(patch, [float(z) for z in cuts if z > low + 0.3 * height])
    if len(patches) > MOST_PATCHES:
        return None
    if len(patches) > len(graph.patches):
        return task.with_blocking(task.graph(patches))
    return graph


def _raised(patch: Patch, most: float) -> Patch:
    tilt = np.minimum(tilt_of(patch.tool_axes), most)
    return replace(patch, tool_axes=tilted(patch.tool_axes, tilt))
