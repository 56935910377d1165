# SPDX-License-Identifier: Apache-2.0
"""Print orders of parts where the right one is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.ordering import order_patches
from vega_planner.ordering.proof import proven_order
from vega_planner.ordering.task import OrderTask
from vega_planner.printability import assess_printability
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import silent
from vega_planner.settings import PrintabilitySettings
from vega_planner.splitting import split_layers
from vega_planner.substrate import stand_on_substrate

SETTINGS = PrintabilitySettings()


def planned(stack, cell, settings=SETTINGS):
    assessment = assess_printability(stack, cell, settings, silent)
    patches = split_layers(stack, assessment, cell, settings, silent)
    order = order_patches(patches, stack, cell, settings, silent, assessment)
    return assessment, patches, order


@pytest.fixture(scope="module")
def shells(envelopes):
    stack = envelopes.ellipsoid()
    cell = stand_on_substrate(envelopes.default_cell(), stack.part)
    return (stack, cell, *planned(stack, cell))


def test_a_dome_is_printed_whole_and_from_the_inside_out(envelopes):
    stack = envelopes.dome()
    _, _, order = planned(stack, envelopes.default_cell())
    assert order.report.status == "fully"
    assert [patch.layer for patch in order.patches] == list(range(len(stack.layers)))[::-1]
    assert order.violations() == ()
    assert order.report.collision_free_ratio == pytest.approx(1.0)


def test_without_the_assessment_the_graph_finds_the_same_order(envelopes):
    stack = envelopes.dome()
    cell = envelopes.default_cell()
    _, patches, _ = planned(stack, cell)
    order = order_patches(patches, stack, cell, SETTINGS, silent)
    layers = [patch.layer for patch in order.patches]
    assert layers[3:] == list(range(len(stack.layers)))[::-1][3:]


def test_closed_shells_become_bowls_from_outside_in_then_caps_from_inside_out(shells):
    stack, _, _, _, order = shells
    count = len(stack.layers)
    layers = [patch.layer for patch in order.patches]
    assert layers == [*range(count), *range(count)[::-1]]
    up = [float((p.face_normals[:, 2] * p.face_areas).sum()) for p in order.patches]
    assert all(value > 0 for value in up)  # bowls are turned over: printed from inside
    assert order.report.status == "conditionally"
    assert order.report.split_layers == count


def test_no_patch_floats_and_none_collides_when_its_turn_comes(shells):
    order = shells[-1]
    assert order.floating_mm2.sum() == 0
    area = sum(patch.area for patch in order.patches)
    assert order.colliding_mm2.sum() < 2e-3 * area


def test_bowls_and_caps_together_cover_the_shells(shells):
    stack, _, _, _, order = shells
    assert sum(p.area for p in order.patches) == pytest.approx(
        sum(layer.area for layer in stack.layers), rel=1e-9
    )


def test_tool_axes_keep_the_largest_tilt_and_lean(shells):
    for patch in shells[-1].patches:
        tilt = np.degrees(np.arccos(np.clip(patch.tool_axes[:, 2], -1, 1)))
        assert tilt.max() <= SETTINGS.max_tilt_deg + 1e-6


def test_the_same_part_gives_the_same_bytes(envelopes, shells):
    stack, cell, _, _, order = shells
    again = planned(stack, cell)[-1]
    for a, b in zip(order.patches, again.patches):
        assert a.vertices.tobytes() == b.vertices.tobytes()
        assert a.tool_axes.tobytes() == b.tool_axes.tobytes()


def test_a_reversed_order_is_told_as_a_violation(envelopes):
    stack = envelopes.dome()
    order = planned(stack, envelopes.default_cell())[-1]
    turned = replace(order, supports=order.supports[::-1, ::-1])
    kinds = {violation.kind for violation in turned.violations()}
    assert kinds == {"order"}


def test_nothing_to_order_is_an_empty_order(envelopes):
    stack = envelopes.dome()
    order = order_patches((), stack, envelopes.default_cell(), SETTINGS, silent)
    assert order.patches == () and order.violations() == ()


def test_an_order_is_given_up_as_soon_as_it_costs_more_than_it_may(envelopes):
    """Upside down every shell but the innermost floats on what is not there yet."""
    stack, cell = envelopes.dome(), envelopes.default_cell()
    assessment, patches, _ = planned(stack, cell)
    task = OrderTask(
        stack, cell, SETTINGS, assessment.surroundings, ToolShape.of(cell.tool), assessment
    )
    graph = task.graph(patches)
    order = sorted(range(len(patches)), key=lambda node: -patches[node].layer)
    good = proven_order(task, graph, order, silent)
    assert good is not None and good.cost == 0
    bad = proven_order(task, graph, order[::-1], silent)
    assert bad is not None and bad.cost > 0.5 * sum(patch.area for patch in patches)
    assert proven_order(task, graph, order[::-1], silent, 0.99 * bad.cost) is None
    again = proven_order(task, graph, order[::-1], silent, 1.01 * bad.cost)
    assert again is not None and again.cost == bad.cost
