# SPDX-License-Identifier: Apache-2.0
"""Patches of parts where the right split is known."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.printability import assess_printability
from vega_planner.progress import silent
from vega_planner.settings import PrintabilitySettings
from vega_planner.splitting import split_layers
from vega_planner.substrate import stand_on_substrate

SETTINGS = PrintabilitySettings()


def test_a_layer_that_is_printable_whole_stays_whole(envelopes):
    stack, cell = envelopes.dome(), envelopes.default_cell()
    assessment = assess_printability(stack, cell, SETTINGS, silent)
    patches = split_layers(stack, assessment, cell, SETTINGS, silent)
    assert len(patches) == len(stack.layers)
    for patch, layer in zip(patches, stack.layers):
        assert patch.vertices.tobytes() == layer.vertices.tobytes()
        assert patch.faces.tobytes() == layer.faces.tobytes()


def test_closed_shells_are_cut_near_their_widest_section(envelopes):
    stack = envelopes.ellipsoid()
    cell = stand_on_substrate(envelopes.default_cell(), stack.part)
    assessment = assess_printability(stack, cell, SETTINGS, silent)
    patches = split_layers(stack, assessment, cell, SETTINGS, silent)
    widest = 10.0
    for number, layer in enumerate(stack.layers):
        own = [patch for patch in patches if patch.layer == number]
        assert len(own) == 2
        assert sum(patch.area for patch in own) == pytest.approx(layer.area, rel=1e-9)
        top = min(own, key=lambda patch: patch.vertices[:, 2].max()).vertices[:, 2].max()
        assert abs(top - widest) < 2.0
        bowl = min(own, key=lambda patch: patch.vertices[:, 2].min())
        inward = np.array([0, 0, widest]) - bowl.vertices[bowl.faces].mean(1)
        assert (np.einsum("ij,ij->i", bowl.face_normals, inward) > 0).mean() > 0.99
