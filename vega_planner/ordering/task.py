# SPDX-License-Identifier: Apache-2.0
"""What is known of the patches while an order is looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, Layer, LayerStack, Patch
from vega_planner.ordering.dependencies import Support, find_blocking, find_support
from vega_planner.ordering.graph import cycles
from vega_planner.ordering.samples import Samples, sample_patches
from vega_planner.printability.assessment import WIDTH_RATIO, Assessment, stage_height
from vega_planner.printability.material import DistanceField, Material
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Share of a patch that must lie on another for it to wait for that one.
SUPPORT_SHARE = 0.1

#: Share of a patch's poses that meet another for the other to wait. Poses fewer than this
#: are turned out of the way, one by one, when the sequence is checked.
BLOCK_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Graph:
    """Patches with what they lie on and what stands in their way."""

    patches: tuple[Patch, ...]
    material: Material
    samples: Samples
    support: Support
    blocked: Floats

    @property
    def hard(self) -> Bools:
        """Edges of support: of two that lie on each other, the one that carries more."""
        share = self.support.share
        hard = share > SUPPORT_SHARE
        return hard & ~(hard.T & (share < share.T))

    @property
    def soft(self) -> Floats:
        """Weights of the edges of blocking."""
        return np.where(self.blocked > BLOCK_SHARE, self.blocked, 0.0)

    def tangles(self) -> list[list[int]]:
        """Groups of patches that wait for each other."""
        return cycles(self.hard | (self.soft > 0))


@dataclass(frozen=True, eq=False)
class OrderTask:
    """What stays the same while orders are tried."""

    stack: LayerStack
    cell: Workcell
    settings: PrintabilitySettings
    surroundings: DistanceField
    tool: ToolShape
    assessment: Assessment | None

    @property
    def bead_width_mm(self) -> float:
        """Width of the beads; the paper's proportion to the thickness where none is known."""
        if self.assessment is not None and self.assessment.width_mm is not None:
            return self.assessment.width_mm
        return WIDTH_RATIO * self.stack.thickness_mm

    def graph(self, patches: Sequence[Patch]) -> Graph:
        """Find what the patches lie on; blocking is left open."""
        count = len(patches)
        if self.assessment is not None and _are_sheets(patches, self.assessment.layers):
            material = self.assessment.material
        else:
            material = Material(self.stack.part, patches, stage_height(self.stack))
        owner = np.repeat(np.arange(count), np.diff(material.first))
        samples = sample_patches(patches)
        plate = self.cell.placement.plate_z_mm
        support = find_support(samples, count, material, owner, self.surroundings, plate)
        return Graph(tuple(patches), material, samples, support, np.zeros((count, count)))

    def with_blocking(self, graph: Graph, patches: Sequence[Patch] | None = None) -> Graph:
        """Find what stands in the nozzle's way, with other axes where patches are given."""
        patches = graph.patches if patches is None else tuple(patches)
        samples = sample_patches(patches)
        blocked = find_blocking(
            samples, samples, len(patches), self.tool, self.settings.clearance_mm
        )
        return replace(graph, patches=patches, samples=samples, blocked=blocked)


def _are_sheets(patches: Sequence[Patch], sheets: Sequence[Layer]) -> bool:
    """Tell whether the patches are the sheets, whole and in their order."""
    return len(patches) == len(sheets) and all(
        patch.layer == number
        and np.array_equal(patch.faces, sheet.faces)
        and np.array_equal(patch.vertices, sheet.vertices)
        for number, (patch, sheet) in enumerate(zip(patches, sheets))
    )
