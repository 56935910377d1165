# SPDX-License-Identifier: Apache-2.0
"""Resolve cycles of patches that wait for each other by steeper tool axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Patch
from vega_planner.ordering.task import Graph, OrderTask
from vega_planner.printability.orientation import tilt_of, tilted

#: Largest tilts tried for patches that wait for each other [deg].
TILTS_DEG = (45.0, 20.0)


def untangled(task: OrderTask, graph: Graph) -> Graph:
    """Raise the tool over patches that wait for each other, if that resolves all cycles."""
    for most_deg in TILTS_DEG:
        patches = list(graph.patches)
        for nodes in graph.tangles():
            for node in nodes:
                patches[node] = _raised(patches[node], np.radians(most_deg))
        steeper = task.with_blocking(graph, patches)
        if not steeper.tangles():
            return steeper
    return graph


def _raised(patch: Patch, most: float) -> Patch:
    tilt = np.minimum(tilt_of(patch.tool_axes), most)
    return replace(patch, tool_axes=tilted(patch.tool_axes, tilt))
