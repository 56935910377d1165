# SPDX-License-Identifier: Apache-2.0
"""A side that the separating surface leaves empty gives no patches."""

import numpy as np

from vega_planner.printability.sides import INSIDE, OUTSIDE
from vega_planner.splitting.split import _patches, _Piece


def test_an_empty_side_gives_no_patches():
    none, no_faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    zero = np.zeros(0)
    piece = _Piece(none, no_faces, zero, none, none, zero, zero, np.zeros(0, np.int64))
    for side in (OUTSIDE, INSIDE):
        assert _patches(piece, side, 0, 0.1) == []
