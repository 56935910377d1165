# SPDX-License-Identifier: Apache-2.0
"""What a scanner adds to a surface and takes from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, TriangleGeometry
from vega_planner.errors import InvalidInput


@dataclass(frozen=True)
class Scanner:
    """Errors of a scanner.

    Attributes:
        noise_mm: Standard deviation of the noise along the surface's normal.
        resolution_mm: Details smaller than this are smoothed away; 0 keeps all.
    """

    noise_mm: float = 0.0
    resolution_mm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("noise_mm", "resolution_mm"):
            if not 0 <= getattr(self, name) < 10:
                raise InvalidInput(f"scanner {name} is {getattr(self, name):g}; allowed: 0 to 10")


#: A scanner that sees everything as it is.
IDEAL = Scanner()


class _Mesh(TriangleGeometry):
    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self.vertices, self.faces = vertices, faces


def scanned(vertices: Floats, faces: Ints, scanner: Scanner, seed: int = 0) -> tuple[Floats, Ints]:
    """Scan a surface: smooth it to the scanner's resolution and add its noise.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        scanner: The scanner.
        seed: Seed of the noise.

    Returns:
        The scanned mesh, of the same faces.
    """
    if scanner.resolution_mm > 0:
        vertices = _smoothed(vertices, faces, 0.5 * scanner.resolution_mm)
    if scanner.noise_mm > 0:
        noise = np.random.default_rng(seed).normal(0.0, scanner.noise_mm, len(vertices))
        vertices = vertices + noise[:, None] * _Mesh(vertices, faces).vertex_normals
    return vertices, faces


def _smoothed(vertices: Floats, faces: Ints, sigma: float) -> Floats:
    """Average a surface over a neighbourhood of standard deviation sigma [mm].

    Each step of averaging with the neighbours adds the mean squared edge length over
    four to the variance in each direction along the surface.
    """
    from scipy.sparse import coo_matrix

    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths2 = ((vertices[sides[:, 0]] - vertices[sides[:, 1]]) ** 2).sum(1)
    steps = max(1, round(sigma**2 / max(0.25 * float(lengths2.mean()), 1e-12)))
    ones = np.ones(2 * len(sides))
    links = coo_matrix(
        (ones, (np.concatenate([sides[:, 0], sides[:, 1]]), np.r_[sides[:, 1], sides[:, 0]])),
        shape=(len(vertices), len(vertices)),
    ).tocsr()
    counts = np.maximum(np.asarray(links.sum(1)).ravel(), 1.0)[:, None]
    for _ in range(min(steps, 200)):
        vertices = 0.5 * (vertices + links @ vertices / counts)
    return vertices
