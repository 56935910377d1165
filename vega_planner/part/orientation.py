# SPDX-License-Identifier: Apache-2.0
"""Turning faces so that neighbours agree."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints, face_cross
from vega_planner.part.topology import connected_labels, face_pairs


def agreeing(vertices: Floats, faces: Ints) -> tuple[Ints, int]:
    """Turn faces so that both faces of an edge run through it in opposite directions.

    Each face is a pair of nodes of a graph, as it is and turned; the pieces of the graph
    are the consistent choices. In each piece the orientation with the larger area stays.
    A piece that cannot be oriented, as a Möbius strip, is left as it is.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        The faces, and how many were turned.
    """
    count = len(faces)
    pairs, _, agree = face_pairs(faces)
    first, second = pairs.T
    shift = np.where(agree, 0, count)
    links = np.concatenate(
        [
            np.stack([first, second + shift], axis=1),
            np.stack([first + count, (second + shift + count) % (2 * count)], axis=1),
        ]
    )
    labels = connected_labels(2 * count, links)
    as_is, turned = labels[:count], labels[count:]
    piece = np.minimum(as_is, turned)
    areas = np.linalg.norm(face_cross(vertices, faces), axis=1)
    votes = np.bincount(piece, weights=np.where(as_is < turned, areas, -areas), minlength=count)
    turn = (as_is != turned) & ((as_is < turned) != (votes[piece] >= 0))
    result = faces.copy()
    result[turn] = faces[turn][:, ::-1]
    return result, int(turn.sum())
