# SPDX-License-Identifier: Apache-2.0
"""Judgements of sheets for which the right one is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.datatypes import REASON_CODES, Layer, LayerStack
from vega_planner.errors import Cancelled
from vega_planner.printability import assess_printability
from vega_planner.printability.orientation import tilt_of, tilted
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import silent
from vega_planner.robot.workcell import place
from vega_planner.settings import PrintabilitySettings
from vega_planner.substrate import stand_on_substrate

from .envelopes import default_cell, dome, ellipsoid

SETTINGS = PrintabilitySettings()


def judged(stack, cell=None, **changes):
    settings = replace(SETTINGS, **changes)
    return assess_printability(stack, cell or default_cell(), settings, silent)


def test_a_dome_on_the_plate_is_fully_printable():
    report = judged(dome()).report
    assert report.status == "fully"
    assert report.reachable_ratio == report.accessible_ratio == 1.0
    assert report.collision_free_ratio == pytest.approx(1.0)
    assert report.reasons == () and report.split_layers == 0


def test_normals_at_the_foot_of_a_dome_collide_with_the_plate():
    report = judged(dome(), orientation="normal").report
    assert report.status != "fully"
    assert report.reasons[0].code == "plate"
    assert report.reasons[0].where_mm[2] < 6.0


def test_the_upright_nozzle_prints_a_dome_too():
    axes = judged(dome(), orientation="vertical").sheets[0].outside.axes
    assert np.allclose(axes, [0, 0, 1])


def test_the_tool_clears_the_plate_by_the_clearance_at_every_bead():
    stack, cell = dome(), default_cell()
    shape = ToolShape.of(cell.tool)
    for layer, sheet in zip(stack.layers, judged(stack).sheets):
        bead = layer.vertices.copy()
        slope = np.hypot(*layer.vertex_normals[:, :2].T)
        bead[:, 2] = np.maximum(bead[:, 2], np.maximum(0.4, 0.6 * slope))
        assert shape.height_above(bead, sheet.outside.axes).min() >= 0.2 - 1e-3


def test_axes_follow_the_normal_where_there_is_room():
    stack = dome()
    layer, side = stack.layers[0], judged(stack).sheets[0].outside
    high = layer.vertices[:, 2] > 6.5
    angle = np.einsum("ij,ij->i", side.axes, layer.vertex_normals)[high]
    assert np.degrees(np.arccos(np.clip(angle, -1, 1))).max() < 3.0


def test_the_tilt_changes_by_no_more_than_the_rate():
    stack = dome()
    layer = stack.layers[0]
    side = judged(stack, max_tilt_rate_deg_mm=8.0).sheets[0].outside
    tilt = np.degrees(tilt_of(side.axes))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = layer.faces[:, a], layer.faces[:, b]
        length = np.linalg.norm(layer.vertices[i] - layer.vertices[j], axis=1)
        lean_bound = np.degrees(tilt_of(layer.vertex_normals)) - SETTINGS.max_lean_deg
        free = (tilt[i] > lean_bound[i] + 0.1) & (tilt[j] > lean_bound[j] + 0.1)
        assert (np.abs(tilt[i] - tilt[j])[free] <= 8.0 * length[free] + 1e-6).all()


@pytest.mark.parametrize("limit", [30.0, 75.0])
def test_no_axis_tilts_further_than_the_settings_allow(limit):
    for sheet in judged(dome(), max_tilt_deg=limit).sheets:
        assert np.degrees(tilt_of(sheet.outside.axes)).max() <= limit + 1e-6


def test_a_part_beyond_the_travel_is_told_so_face_by_face():
    stack = dome()
    far = place(default_cell(), (5000.0, 0.0, 0.0, 0.0))
    report = judged(stack, far).report
    assert report.status == "not" and report.reachable_ratio == 0.0
    assert {reason.code for reason in report.reasons} == {"out_of_travel"}
    code = 1 + REASON_CODES.index("out_of_travel")
    assert all((codes == code).all() for codes in report.face_reasons)
    assert report.reasons[0].area_mm2 == pytest.approx(stack.layers[0].area)


def test_closed_shells_in_their_bowl_are_conditionally_printable():
    stack = ellipsoid()
    cell = stand_on_substrate(default_cell(), stack.part)
    report = judged(stack, cell).report
    assert report.status == "conditionally"
    assert report.split_layers == len(stack.layers)
    assert report.collision_free_ratio > 0.999


def test_a_sheet_under_a_roof_of_its_own_layer_is_not_seen():
    stack = dome()
    flat = np.array([[-6, -6, 0.4], [6, -6, 0.4], [6, 6, 0.4], [-6, 6, 0.4]], float)
    roof = flat + np.array([0, 0, 3])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    layer = Layer(
        0, "envelope", 0.4, np.vstack([flat, roof]), np.vstack([faces, faces + 4]), np.full(8, 0.8)
    )
    two = LayerStack(stack.part, "field", 0.8, (layer,))
    side = judged(two).sheets[0].outside
    assert not side.seen[:4].any() and side.seen[4:].all()


def test_planar_layers_are_printed_upright_from_the_bottom_up():
    stack = dome()
    layers = []
    for k in range(4):
        r = np.sqrt(12**2 - (0.8 * k + 0.4) ** 2) - 0.6
        turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        ring = np.column_stack([r * np.cos(turn), r * np.sin(turn), 0 * turn])
        v = np.vstack([[[0, 0, 0]], ring]) + np.array([0, 0, 0.8 * k + 0.4])
        f = np.array([[0, 1 + j, 1 + (j + 1) % 48] for j in range(48)])
        layers.append(Layer(k, "planar", 0.8 * k + 0.4, v, f, np.full(49, 0.8)))
    report = judged(LayerStack(stack.part, "planar", 0.8, tuple(layers)))
    assert report.report.status == "fully"
    assert all(np.allclose(s.outside.axes, [0, 0, 1]) for s in report.sheets)


def test_a_report_that_raises_stops_the_work():
    def stop(progress):
        raise Cancelled("stop")

    with pytest.raises(Cancelled):
        assess_printability(dome(), default_cell(), SETTINGS, stop)


def test_tilted_axes_have_the_azimuth_of_the_normal():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tilt = rng.uniform(0.01, 1.3, 200)
    axes = tilted(normals, tilt)
    assert np.allclose(tilt_of(axes), tilt)
    cross = normals[:, 0] * axes[:, 1] - normals[:, 1] * axes[:, 0]
    assert np.abs(cross).max() < 1e-12
