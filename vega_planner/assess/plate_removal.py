# SPDX-License-Identifier: Apache-2.0
"""Cutting the build plate and other surroundings out of a scan."""

from __future__ import annotations

import numpy as np

from vega_planner.assess.closest import ClosestPoints
from vega_planner.assess.fidelity import sample_surface
from vega_planner.datatypes import Bools, Floats, TriangleGeometry

_SAMPLES, _TRIALS = 4000, 400
#: A plane that reaches further than this share of the target's size is no part of it.
_PLATE_RATIO = 1.15


def without_plate(scan: TriangleGeometry, size: float, seed: int = 0) -> Bools:
    """Tell which faces do not belong to a plate that is larger than the target.

    Args:
        scan: The scanned surface [mm].
        size: Diagonal of the target's bounding box [mm].
        seed: Seed of the planes that are tried.

    Returns:
        True for the faces to keep, shape (m,).
    """
    keep = np.ones(len(scan.faces), bool)
    if np.linalg.norm(np.ptp(scan.vertices, axis=0)) < 1.25 * size:
        return keep
    points, faces = sample_surface(scan, _SAMPLES)
    normals = scan.face_normals[faces]
    generator = np.random.default_rng(seed)
    tolerance = 0.012 * size
    best: Bools = np.zeros(len(points), bool)
    plane = (np.zeros(3), 0.0)
    for at in generator.integers(0, len(points), _TRIALS):
        normal, offset = normals[at], float(points[at] @ normals[at])
        on = (np.abs(points @ normal - offset) < tolerance) & (normals @ normal > 0.9)
        if on.sum() > best.sum():
            best, plane = on, (normal, offset)
    if best.sum() < 30:
        return keep
    for _ in range(3):
        plane, spread = _fit(points[best], plane[0])
        tolerance = max(4 * spread, 0.002 * size)
        heights = points @ plane[0] - plane[1]
        best = (np.abs(heights) < tolerance) & (normals @ plane[0] > 0.8)
        if best.sum() < 30:
            return keep
    flat = points[best] - points[best].mean(0)
    extent = np.ptp(flat @ np.linalg.svd(flat, full_matrices=False)[2].T, axis=0)
    if np.linalg.norm(extent[:2]) < _PLATE_RATIO * size:
        return keep
    return (scan.vertices @ plane[0] - plane[1])[scan.faces].max(1) > tolerance


def _fit(points: Floats, like: Floats) -> tuple[tuple[Floats, float], float]:
    """Fit a plane; returns it with the spread of the points about it."""
    middle = points.mean(0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    normal = normal if normal @ like > 0 else -normal
    heights = (points - middle) @ normal
    return (normal, float(middle @ normal)), 1.4826 * float(np.median(np.abs(heights)))


def belongs(
    scan: TriangleGeometry, found: ClosestPoints, limit: float, floor: float, rms: float
) -> Bools:
    """Tell which faces of a registered scan belong to the print.

    What is farther from the target than `limit` is clutter. So is what lies flat beside
    the target's foot: its normal is square to the way to the target.

    Args:
        scan: Scan in the target's frame [mm].
        found: Closest points of the target for its vertices.
        limit: Distance from which a point is clutter [mm].
        floor: Height of the target's lowest point [mm].
        rms: Typical distance of scan and target [mm].

    Returns:
        True for the faces to keep, shape (m,).
    """
    near = (np.abs(found.signed) < limit)[scan.faces].all(1)
    away = scan.vertices - found.feet
    away /= np.maximum(np.abs(found.signed), 1e-9)[:, None]
    square = np.abs(np.einsum("ijk,ik->ij", away[scan.faces], scan.face_normals)).max(1) < 0.35
    beside = (found.feet[scan.faces, 2] < floor + 0.6).all(1)
    off = np.abs(found.signed)[scan.faces].min(1) > max(3 * rms, 0.1)
    return near & ~(square & beside & off)
