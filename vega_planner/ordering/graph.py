# SPDX-License-Identifier: Apache-2.0
"""The dependency graph: what must be printed before what, and a sequence that obeys."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Bools, Floats


def cycles(before: Bools) -> list[list[int]]:
    """Find the groups of nodes that wait for each other.

    Args:
        before: before[a, b] is True where a must come before b, shape (n, n).

    Returns:
        Strongly connected groups of more than one node, each sorted.
    """
    if _free_of_cycles(before):
        return []
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count, group = connected_components(csr_array(before), directed=True, connection="strong")
    members: list[list[int]] = [[] for _ in range(count)]
    for node, number in enumerate(group):
        members[number].append(node)
    return sorted(nodes for nodes in members if len(nodes) > 1)


def _free_of_cycles(before: Bools) -> bool:
    """Tell whether taking away nodes that wait for nothing leaves none."""
    waits = before.sum(0)
    free = list(np.flatnonzero(waits == 0))
    taken = 0
    while free:
        after = np.flatnonzero(before[free.pop()])
        taken += 1
        waits[after] -= 1
        free.extend(after[waits[after] == 0])
    return taken == len(before)


def break_cycles(hard: Bools, soft: Floats) -> tuple[Bools, Bools]:
    """Drop the weakest soft edges until no cycle is left.

    Args:
        hard: Edges that stay, shape (n, n).
        soft: Weights of the edges that may go, 0 where there is none, shape (n, n).

    Returns:
        The edges kept and those dropped, both (n, n). Hard edges are dropped only where
        they form a cycle among themselves.
    """
    kept = hard | (soft > 0)
    weight = np.where(hard, 1e6 + soft, soft)
    dropped = np.zeros_like(kept)
    while True:
        groups = cycles(kept)
        if not groups:
            return kept, dropped
        for nodes in groups:
            inner = np.ix_(nodes, nodes)
            edges = np.where(kept[inner], weight[inner], np.inf)
            # all edges as weak as the weakest go at once, so that few rounds are needed
            weak = edges <= edges.min() * 1.25 + 1e-12
            dropped[inner] |= weak & kept[inner]
            kept[inner] &= ~weak


def sequence(before: Bools, keys: Sequence[tuple]) -> list[int]:
    """Order nodes so that every edge is obeyed, the smallest free key first.

    Args:
        before: before[a, b] is True where a must come before b; without cycles.
        keys: Priority of each node, smallest first; the node's number breaks ties.
    """
    waits = before.sum(0)
    free: list[tuple[tuple, int]] = [
        (keys[int(node)], int(node)) for node in np.flatnonzero(waits == 0)
    ]
    heapq.heapify(free)
    order: list[int] = []
    while free:
        _, node = heapq.heappop(free)
        order.append(node)
        for after in (int(other) for other in np.flatnonzero(before[node])):
            waits[after] -= 1
            if waits[after] == 0:
                heapq.heappush(free, (keys[after], after))
    return order
