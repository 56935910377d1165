# SPDX-License-Identifier: Apache-2.0
"""What is printed at any moment: every bead laid so far, held against the tool exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Floats, Ints, Toolpath
from vega_planner.parallel import cores, map_threads
from vega_planner.part.morton import morton_order
from vega_planner.printability import bead_kernels as kernels
from vega_planner.printability.tool_shape import STEP_MM, ToolShape

#: Fewer poses than this are not worth a second thread.
_FEW = 256


class Beads:
    """The beads of passes in the order in which they are laid.

    Args:
        passes: Passes in print order.
        first: Number of the first waypoint of each pass, rising, shape (n,).
    """

    def __init__(self, passes: Sequence[Toolpath], first: Ints) -> None:
        counts = [len(path.points) - 1 for path in passes]
        self._beads = np.empty((sum(counts), 11))
        row = 0
        laid = []
        for path, count, number in zip(passes, counts, first):
            kernels.lay_beads(path.points, path.axes, path.width, path.height, row, self._beads)
            laid.append(np.arange(count) + int(number) + 1)
            row += count
        #: Number of the waypoint at which each bead ends.
        self.laid = np.concatenate(laid) if laid else np.zeros(0, np.int64)
        self._tree = _tree(self._beads)

    def clearance(
        self,
        tool: ToolShape,
        tips: Floats,
        axes: Floats,
        number: Ints,
        enough_mm: float = 0.3,
        give_up_mm: float = -np.inf,
    ) -> Floats:
        """Measure how far a tool stays clear of what is laid before some waypoints.

        Args:
            tool: The tool; what is before its `start_mm` does not count.
            tips: Tips [mm], shape (n, 3).
            axes: Unit vectors from the tip back along the tool, shape (n, 3).
            number: Number of the waypoint at whose time each pose is held, shape (n,).
            enough_mm: Clearance beyond which the exact value does not matter.
            give_up_mm: Clearance below which the exact value does not matter.

        Returns:
            Clearances [mm], negative where the tool is in a bead, shape (n,).
        """
        out = np.full(len(tips), np.inf)
        if not len(tips) or not len(self.laid):
            return out
        counts = np.searchsorted(self.laid, number)
        at, radius, widest = tool.outline

        def measure(piece: Ints) -> None:
            part = np.empty(len(piece))
            kernels.bead_clearance(
                np.ascontiguousarray(tips[piece]), np.ascontiguousarray(axes[piece]),
                counts[piece], self._beads, *self._tree, at, radius, widest, STEP_MM, enough_mm,
                give_up_mm, part,
            )  # fmt: skip
            out[piece] = part

        share = 1 if len(tips) < _FEW else 4 * cores()
        map_threads(measure, np.array_split(np.arange(len(tips)), share))
        return out

    def nearest_to(self, tool: ToolShape, tip: Floats, axis: Floats, number: int) -> int:
        """Name the bead that reaches deepest into a tool pose, of those laid before.

        Returns:
            The number of the waypoint at which that bead ends; -1 where there is none.
        """
        count = int(np.searchsorted(self.laid, number))
        if not count:
            return -1
        away = self._beads[:count, :3] - tip
        s = away @ axis
        r = np.sqrt(np.maximum((away**2).sum(1) - s * s, 0.0))
        reach = np.linalg.norm(self._beads[:count, 3:6], axis=1) + self._beads[:count, 9]
        depth = np.interp(s, tool.distance, tool.radius) - r
        depth = np.minimum(depth, np.minimum(s - tool.start_mm, tool.distance[-1] - s)) + reach
        return int(self.laid[int(np.argmax(depth))])


def _tree(beads: Floats) -> tuple[Ints, Floats, Ints, Ints]:
    """Build the tree over blocks of beads that `bead_clearance` goes down.

    Returns:
        Blocks in the order of the leaves, balls of the nodes, the first bead of each, and
        where the levels begin.
    """
    leaves = _balls(beads, kernels.BLOCK)
    block = morton_order(leaves[:, :3]) if len(leaves) else np.zeros(0, np.int64)
    balls, earliest = [leaves[block]], [block * kernels.BLOCK]
    while len(balls[-1]) > 1:
        starts = np.arange(0, len(balls[-1]), kernels.CHILDREN)
        earliest.append(np.minimum.reduceat(earliest[-1], starts))
        balls.append(_balls(balls[-1], kernels.CHILDREN))
    level = np.cumsum([0, *(len(rows) for rows in balls)])
    columns = np.ascontiguousarray(np.concatenate(balls).T)
    return block, columns, np.concatenate(earliest), level


def _balls(rows: Floats, size: int) -> Floats:
    balls = np.empty((-(-len(rows) // size), 4))
    kernels.enclose(rows, balls, size)
    return balls
