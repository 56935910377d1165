# SPDX-License-Identifier: Apache-2.0
"""Handing the restraint region from one layer's solid to the next, as the paper does.

From the restrained faces of A_i the representative normal is their spherical L1 median;
the centroids' nearest neighbours among the centroids of D are candidates, those whose
normal lies within θ_edge of the median stay. The paper then picks one at random; here
the best by a score is taken, so that the result does not change from run to run, and
the region is grown from it. A restraint region of several smooth surfaces is handed on
surface by surface, and each separate body of D gets its own choice.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry
from vega_planner.part.regions import grow_region, smooth_pairs
from vega_planner.part.topology import body_labels, connected_labels

#: Candidates looked up for each restrained centroid.
NEIGHBOURS = 4


class _Surface(TriangleGeometry):
    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self.vertices, self.faces = vertices, faces

    @property
    def centroids(self) -> Floats:
        return self.vertices[self.faces].mean(1)


def spherical_median(normals: Floats, weights: Floats | None = None) -> Floats:
    """Find the direction with the least sum of angles to given directions.

        n_median = argmin over n in S² of Σ w_i arccos(n · n_i)

    by Weiszfeld's iteration in the tangent plane, started from the best of the given
    directions and the mean.

    Args:
        normals: Unit vectors, shape (n, 3), n >= 1.
        weights: Weights w_i > 0, shape (n,); the paper has all equal.

    Returns:
        Unit vector, shape (3,).

    Source:
        The paper, section II, spherical L1 formulation; [Fletcher2009]_ for the iteration.
    """
    weight = np.ones(len(normals)) if weights is None else np.asarray(weights, dtype=float)
    weight = weight / weight.sum()
    mean = weight @ normals
    length = np.linalg.norm(mean)
    starts = normals[:: max(1, len(normals) // 64)]
    if length > 1e-9:
        starts = np.vstack([mean / length, starts])
    costs = np.arccos(np.clip(starts @ normals.T, -1.0, 1.0)) @ weight
    best = starts[int(np.argmin(np.round(costs, 12)))]
    best_cost = float(costs.min())
    here = best
    for _ in range(200):
        cosine = np.clip(normals @ here, -1.0, 1.0)
        angle = np.arccos(cosine)
        away = angle > 1e-9
        if not away.any():
            break
        tangent = normals[away] - cosine[away, None] * here
        sine = np.maximum(np.linalg.norm(tangent, axis=1), 1e-12)
        # log map of n_i at here is angle * tangent / sine; Weiszfeld divides by the angle.
        pull = weight[away] / angle[away]
        step = ((weight[away] / sine) @ tangent) / pull.sum()
        size = np.linalg.norm(step)
        if size < 1e-12:
            break
        here = np.cos(size) * here + np.sin(size) * step / size
        here = here / np.linalg.norm(here)
        cost = float(np.arccos(np.clip(normals @ here, -1.0, 1.0)) @ weight)
        if cost < best_cost:
            best, best_cost = here, cost
        if size < 1e-10:
            break
    return best


def transfer_restraint(
    vertices: Floats,
    faces: Ints,
    restrained: Bools,
    next_vertices: Floats,
    next_faces: Ints,
    edge_angle_deg: float,
) -> Bools:
    """Find the restraint region of an eroded solid from that of the solid before it.

    Args:
        vertices: Points of A_i [mm], shape (n, 3).
        faces: Faces of A_i, shape (m, 3).
        restrained: Restrained faces ∂A_i*, shape (m,).
        next_vertices: Points of D [mm], shape (p, 3).
        next_faces: Faces of D, shape (q, 3).
        edge_angle_deg: θ_edge [deg]: neighbouring faces that bend by more belong to
            different surfaces.

    Returns:
        Restrained faces ∂A*_(i+1), shape (q,).

    Source:
        The paper, section II (fig. 3). Leaves it in weighing normals by area, since the
        triangles of booleans differ much in size, and in the deterministic choice.
    """
    before, after = _Surface(vertices, faces), _Surface(next_vertices, next_faces)
    chosen = np.zeros(len(next_faces), dtype=bool)
    if not restrained.any():
        return chosen
    from scipy.spatial import cKDTree

    tree = cKDTree(after.centroids)
    bodies = body_labels(next_faces)
    pairs = smooth_pairs(before, edge_angle_deg)
    labels = connected_labels(len(faces), pairs[restrained[pairs].all(1)])
    for label in np.unique(labels[restrained]):
        surface = np.flatnonzero(restrained & (labels == label) & (before.face_areas > 0))
        if len(surface):
            chosen |= _hand_on(before, surface, after, tree, bodies, edge_angle_deg)
    return chosen


def _hand_on(
    before: _Surface,
    surface: Ints,
    after: _Surface,
    tree: Any,
    bodies: Ints,
    edge_angle_deg: float,
) -> Bools:
    """Hand one smooth surface on to every body of the next solid that shows it."""
    normals = before.face_normals[surface]
    centroids = before.centroids[surface]
    median = spherical_median(normals, before.face_areas[surface])
    count = min(NEIGHBOURS, len(after.faces))
    _, near = tree.query(centroids, k=count)
    candidates = np.unique(near)
    alike = after.face_normals @ median
    candidates = candidates[alike[candidates] >= np.cos(np.radians(edge_angle_deg))]
    seeds = np.zeros(len(after.faces), dtype=bool)
    for body in np.unique(bodies[candidates]):
        mine = candidates[bodies[candidates] == body]
        seeds[mine[_best(before, surface, after, mine)]] = True
    # A curved region spreads further from its median than θ_edge; its successor may too.
    spread = float(np.degrees(np.arccos(np.clip((normals @ median).min(), -1.0, 1.0))))
    limit = max(edge_angle_deg, spread + 1.0)
    allowed = (alike >= np.cos(np.radians(min(limit, 180.0)))) | (after.face_areas <= 0)
    return grow_region(after, seeds, allowed, edge_angle_deg)


def _best(before: _Surface, surface: Ints, after: _Surface, candidates: Ints) -> int:
    """Pick the candidate that lies on the old region: least distance to it, then largest.

    The restraint region does not move, so the right candidates lie on the old one.
    """
    centroids = after.centroids[candidates]
    origins, normals = before.centroids[surface], before.face_normals[surface]
    offsets = centroids[:, None, :] - origins[None]  # (c, s, 3)
    nearest = np.einsum("csi,csi->cs", offsets, offsets).argmin(1)
    rows = np.arange(len(candidates))
    height = np.abs(np.einsum("ci,ci->c", offsets[rows, nearest], normals[nearest]))
    bend = 1.0 - np.einsum("ci,ci->c", after.face_normals[candidates], normals[nearest])
    keys = [np.round(column, 6) for column in centroids.T]
    score = np.round(height + bend, 6)
    return int(np.lexsort((*keys, -np.round(after.face_areas[candidates], 6), score))[0])


def restraint_disagreement(
    vertices: Floats, faces: Ints, exact: Bools, transferred: Bools
) -> float:
    """Compare two restraint regions of one solid: area in one of them over area in any."""
    areas = _Surface(vertices, faces).face_areas
    either = float(areas[exact | transferred].sum())
    return float(areas[exact != transferred].sum()) / either if either > 0 else 0.0
