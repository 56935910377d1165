# SPDX-License-Identifier: Apache-2.0
"""The dependency graph and the sequence it yields."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.ordering.graph import break_cycles, cycles, sequence


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(1, 25), st.floats(0, 0.5), st.integers(0, 10**6))
def test_a_sequence_obeys_every_edge_of_a_graph_without_cycles(count, share, seed):
    rng = np.random.default_rng(seed)
    place = rng.permutation(count)
    before = (rng.random((count, count)) < share) & (place[:, None] < place[None, :])
    assert not cycles(before)
    order = sequence(before, [(int(k),) for k in rng.integers(0, 5, count)])
    assert sorted(order) == list(range(count))
    rank = np.argsort(order)
    assert (rank[np.nonzero(before)[0]] < rank[np.nonzero(before)[1]]).all()


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(2, 15), st.integers(0, 10**6))
def test_soft_edges_give_way_and_hard_ones_stay(count, seed):
    rng = np.random.default_rng(seed)
    place = rng.permutation(count)
    hard = (rng.random((count, count)) < 0.3) & (place[:, None] < place[None, :])
    soft = np.where(rng.random((count, count)) < 0.3, rng.random((count, count)), 0.0)
    np.fill_diagonal(soft, 0.0)
    kept, dropped = break_cycles(hard, soft)
    assert not cycles(kept)
    assert (kept | ~hard).all()
    assert not (kept & dropped).any()
    assert ((kept | dropped) == (hard | (soft > 0))).all()


def test_nodes_that_wait_for_each_other_are_found():
    before = np.zeros((5, 5), bool)
    before[0, 1] = before[1, 2] = before[2, 0] = before[3, 4] = True
    assert cycles(before) == [[0, 1, 2]]


def test_among_free_nodes_the_smallest_key_comes_first():
    before = np.zeros((4, 4), bool)
    before[3, 0] = True
    assert sequence(before, [(0,), (2,), (1,), (3,)]) == [2, 1, 3, 0]
