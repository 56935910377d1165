# SPDX-License-Identifier: Apache-2.0
"""The three measures of the paper: volumetric error, surface deviation, chamfer distance.

- e1 is the volume inside the target and outside the print (undershoot) and the reverse
  (overshoot), over the target's volume.
- e2 is the signed distance of the print's surface to the target's, above zero outside.
  Its mean, deviation and 95th percentile are those of the absolute value, as the paper
  reports them, weighted by area.
- e3 is the mean squared distance of the print's surface to the target's plus the same
  the other way round. The paper takes it between the meshes' vertices; here it is the
  limit for dense point sets, which does not depend on how the meshes are triangulated.

Source: the paper, section III.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from vega_planner.assess.closest import SurfaceDistance
from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry, face_cross

#: Samples of the target's surface for the chamfer distance.
TARGET_SAMPLES = 100_000


@dataclass(frozen=True)
class Fidelity:
    """How true a print is, by the paper's measures.

    Attributes:
        e1_pct: Volumetric error, under- and overshoot [% of the target's volume].
        under_pct: Undershoot [% of the target's volume].
        over_pct: Overshoot [% of the target's volume].
        e2_mean_mm: Mean absolute surface deviation.
        e2_std_mm: Standard deviation of the absolute surface deviation.
        e2_p95_mm: 95th percentile of the absolute surface deviation.
        e3_mm2: Chamfer distance [mm²].
    """

    e1_pct: float
    under_pct: float
    over_pct: float
    e2_mean_mm: float
    e2_std_mm: float
    e2_p95_mm: float
    e3_mm2: float

    def as_dict(self) -> dict[str, float]:
        """The figures by name, rounded to what they can mean."""
        return {name: round(value, 6) for name, value in asdict(self).items()}


@dataclass(frozen=True, eq=False)
class Deviation:
    """Signed distance of a surface to the target, vertex by vertex.

    Attributes:
        signed: e2 at the vertices [mm], above zero outside the target, shape (n,).
        areas: Area that each vertex stands for [mm²], shape (n,).
        free: True where the closest point of the target is not restrained, shape (n,).
        feet: Closest points of the target [mm], shape (n, 3).
        faces: Faces of the target they lie on, shape (n,).
    """

    signed: Floats
    areas: Floats
    free: Bools
    feet: Floats
    faces: Ints


def vertex_areas(vertices: Floats, faces: Ints) -> Floats:
    """Share the area of faces among their corners [mm²], shape (n,)."""
    thirds = np.linalg.norm(face_cross(vertices, faces), axis=1) / 6
    areas = np.bincount(faces.ravel(), np.repeat(thirds, 3), minlength=len(vertices))
    return areas.astype(np.float64)


def measure_deviation(
    vertices: Floats, faces: Ints, target: SurfaceDistance, restrained: Bools
) -> Deviation:
    """Measure e2 at the vertices of a surface.

    Args:
        vertices: Points of the print's surface [mm], shape (n, 3).
        faces: Its faces, shape (m, 3).
        target: The target.
        restrained: True for the target's restrained faces, shape (k,).
    """
    return measure_points(vertices, target, restrained, vertex_areas(vertices, faces))


def measure_points(
    points: Floats, target: SurfaceDistance, restrained: Bools, areas: Floats | None = None
) -> Deviation:
    """Measure e2 at points, which stand for equal areas where these are not given."""
    found = target.query(points)
    free = target.touching(~restrained)[found.faces, found.features]
    areas = np.ones(len(points)) if areas is None else areas
    return Deviation(found.signed, areas, free, found.feet, found.faces)


def sample_surface(mesh: TriangleGeometry, count: int) -> tuple[Floats, Ints]:
    """Spread points evenly over a surface, the same ones every time.

    Points follow the faces in order, one for each equal share of the area; within a
    face they follow the additive sequence of the plastic number.

    Args:
        mesh: The surface.
        count: Number of points.

    Returns:
        Points [mm], shape (count, 3), and the faces they lie on, shape (count,).
    """
    total = np.cumsum(mesh.face_areas)
    at = (np.arange(count) + 0.5) / count * total[-1]
    faces = np.minimum(np.searchsorted(total, at), len(total) - 1)
    plastic = 1.32471795724474602596
    u, v = (np.outer([1 / plastic, 1 / plastic**2], np.arange(count)) + 0.5) % 1.0
    outside = u + v > 1
    u, v = np.where(outside, 1 - u, u), np.where(outside, 1 - v, v)
    a, b, c = (mesh.vertices[mesh.faces[faces, k]] for k in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), faces


def weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
    """Find the value below which a share of the weight lies."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    at = int(np.searchsorted(total, share * total[-1]))
    return float(values[order[min(at, len(order) - 1)]])


def surface_figures(
    deviation: Deviation, back: Floats, chosen: Bools | None = None
) -> tuple[float, float, float, float]:
    """Sum up e2 and e3.

    Args:
        deviation: e2 at the vertices of the print's surface.
        back: Distances from samples of the target to the print's surface [mm].
        chosen: The vertices that count, shape (n,); all when absent.

    Returns:
        Mean, standard deviation and 95th percentile of the absolute e2 [mm]; e3 [mm²].
        All zero where nothing counts.
    """
    values, weights = np.abs(deviation.signed), deviation.areas
    if chosen is not None:
        values, weights = values[chosen], weights[chosen]
    if weights.sum() <= 0 or len(back) == 0:
        return 0.0, 0.0, 0.0, 0.0
    mean = float(np.average(values, weights=weights))
    square = float(np.average(values**2, weights=weights))
    spread = float(np.sqrt(max(square - mean**2, 0.0)))
    return mean, spread, weighted_quantile(values, weights, 0.95), square + float((back**2).mean())
