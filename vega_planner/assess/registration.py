# SPDX-License-Identifier: Apache-2.0
"""Registration: finding the pose of a scan on its target, from any start.

Pairs of scan points are laid onto pairs of target points with the same distance and the
same angles between normals; each such pose is judged by a distance field. The best are
refined by ICP, point to plane, against the target's true surface and with weights that
fall to zero for what does not belong to it. Everything is drawn from one seed: the same
scan gives the same pose.

Source:
    Drost, Ulrich, Navab, Ilic: Model globally, match locally, CVPR 2010 (pair features);
    Chen, Medioni: Object modelling by registration of multiple range images, 1992 (ICP).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.assess import registration_kernels as kernels
from vega_planner.assess.closest import SurfaceDistance
from vega_planner.assess.fidelity import sample_surface
from vega_planner.datatypes import Floats, Ints, TriangleGeometry
from vega_planner.errors import InvalidInput, NotRegistered
from vega_planner.progress import Progress, Report, silent

#: Share of the target's size up to which a point of the scan counts as fitting.
FIT_RATIO = 0.02
#: Share of the target's size beyond which a point is clutter and does not count.
CLUTTER_RATIO = 0.08
#: Least share of the points that are not clutter that must fit.
LEAST_FIT = 0.75
#: Least share of the scan that must not be clutter.
LEAST_USED = 0.3
#: A second pose that fits this much as well makes the first uncertain.
AMBIGUOUS_RATIO = 0.8

_PAIR_POINTS, _PROBES, _PAIRS, _MOST, _KEPT = 450, 96, 3000, 96, 192
_DISTANCE_BINS, _ANGLE_BINS = 24, 9
_COARSE_POINTS, _FINE_POINTS = 1500, 24_000


@dataclass(frozen=True, eq=False)
class Registration:
    """Pose of a scan on its target, and how sure it is.

    Attributes:
        T_target_scan: Takes scan points to the target, shape (4, 4), lengths in mm.
        rms_mm: Root mean square distance of the points that count.
        fit_ratio: Share of the points that are not clutter that lie within
            `FIT_RATIO` of the target's size.
        used_ratio: Share of the scan's points that are not clutter.
        sigma_mm: Standard deviation of the position, from the noise and the shape.
        sigma_deg: Standard deviation of the direction; large where the shape can turn
            on itself.
        runner_up_ratio: Misfit of this pose over that of the best one that is
            different; near 1 where the part looks the same from several sides.
    """

    T_target_scan: Floats
    rms_mm: float
    fit_ratio: float
    used_ratio: float
    sigma_mm: float
    sigma_deg: float
    runner_up_ratio: float

    @property
    def ambiguous(self) -> bool:
        """Whether another pose fits nearly as well: the part is symmetric, or too little
        of it was scanned."""
        return bool(self.runner_up_ratio > AMBIGUOUS_RATIO or self.sigma_deg > 0.5)

    @property
    def certainty(self) -> float:
        """From 0 to 1: the share that fits, less where another pose fits as well."""
        rival = max(self.runner_up_ratio - 0.5, 0.0) * 2
        return round(float(self.fit_ratio * (1 - 0.5 * min(rival, 1.0))), 4)

    def apply(self, points: Floats) -> Floats:
        """Move points of the scan onto the target, shape (n, 3)."""
        return points @ self.T_target_scan[:3, :3].T + self.T_target_scan[:3, 3]


def register(
    scan: TriangleGeometry,
    target: TriangleGeometry,
    *,
    surface: SurfaceDistance | None = None,
    start: Floats | None = None,
    seed: int = 0,
    report: Report = silent,
) -> Registration:
    """Find the pose of a scan on its target.

    Args:
        scan: Scanned surface [mm], anywhere and in any direction; may have holes, be
            partial, noisy and hold clutter.
        target: What was to be printed [mm].
        surface: Closest-point queries on the target, where they are there already.
        start: A pose to refine (from markers), shape (4, 4); searched for when absent.
        seed: Seed of the choice of points.
        report: Told how far it is; may raise `Cancelled`.

    Raises:
        NotRegistered: If no pose fits well enough; carries the best one found.
    """
    surface = surface or SurfaceDistance(target.vertices, target.faces)
    size = float(np.linalg.norm(np.ptp(target.vertices, axis=0)))
    points, normals = _oriented_points(scan, _FINE_POINTS, size)
    generator = np.random.default_rng(seed)
    report(Progress("registration", 0.1))
    if start is None:
        poses = _search(points, normals, target, surface, size, generator)
        poses = np.concatenate([_as_it_lies(points, target), poses])
    else:
        poses = np.asarray(start, np.float64)[None]
    report(Progress("registration", 0.5))
    few = generator.permutation(len(points))[:_COARSE_POINTS]
    found = [_icp(pose, points[few], normals[few], surface, size, 25) for pose in poses]
    refined = np.array([pose for pose, _ in found])
    first = int(np.argmin([misfit for _, misfit in found]))
    best, rival = _choose(refined, first, points[few], surface, size)
    report(Progress("registration", 0.8))
    pose, _ = _icp(refined[best], points, normals, surface, size, 20)
    result = _judge(pose, points, normals, surface, size, rival)
    if result.fit_ratio < LEAST_FIT or result.used_ratio < LEAST_USED:
        error = NotRegistered(
            f"scan cannot be registered: at the best pose {100 * result.fit_ratio:.0f} % of it "
            f"lies within {FIT_RATIO * size:.2f} mm of the target (at least "
            f"{100 * LEAST_FIT:.0f} % needed), and {100 * (1 - result.used_ratio):.0f} % is "
            f"clutter (at most {100 * (1 - LEAST_USED):.0f} %); check that scan and target "
            "are of the same part and in millimetres, or cut the surroundings away"
        )
        error.best = result
        raise error
    return result


def pose_from_markers(scan_points: Floats, target_points: Floats) -> Floats:
    """Find the pose that lays marked points of the scan onto those of the target.

    Args:
        scan_points: At least three points not on a line, shape (n, 3).
        target_points: Where they belong, shape (n, 3).

    Returns:
        Pose of least squares, shape (4, 4).

    Raises:
        InvalidInput: If there are too few points, or all on a line.
    """
    a, b = np.asarray(scan_points, np.float64), np.asarray(target_points, np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3 or len(a) < 3:
        raise InvalidInput(f"markers have shapes {a.shape} and {b.shape}; expected (3 or more, 3)")
    u, values, vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    if values[1] < 1e-6 * max(values[0], 1e-12):
        raise InvalidInput("markers lie on one line; a third direction is needed")
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    pose = np.eye(4)
    pose[:3, :3] = u @ flip @ vt
    pose[:3, 3] = b.mean(0) - pose[:3, :3] @ a.mean(0)
    return pose


def _oriented_points(scan: TriangleGeometry, count: int, size: float) -> tuple[Floats, Floats]:
    """Spread points over a scan, with normals of the plane through their surroundings."""
    from scipy.spatial import cKDTree

    points, faces = sample_surface(scan, count)
    rough = scan.face_normals[faces]
    tree = cKDTree(points)
    _, near = tree.query(points, k=24)
    around = points[near] - points[near].mean(1, keepdims=True)
    _, _, vectors = np.linalg.svd(around, full_matrices=False)
    normals = vectors[:, 2]
    votes = np.einsum("ijk,ik->i", rough[near], normals)
    return points, normals * np.where(votes < 0, -1.0, 1.0)[:, None]


def _search(
    points: Floats,
    normals: Floats,
    target: TriangleGeometry,
    surface: SurfaceDistance,
    size: float,
    generator: np.random.Generator,
) -> Floats:
    """Collect poses worth refining, best first, shape (k, 4, 4)."""
    model, faces = sample_surface(target, _PAIR_POINTS)
    model_normals = target.face_normals[faces]
    step, limit = size / 56, CLUTTER_RATIO * size
    low = target.vertices.min(0) - limit
    shape = np.ceil((np.ptp(target.vertices, axis=0) + 2 * limit) / step).astype(int) + 1
    axes = [low[k] + step * np.arange(shape[k]) for k in range(3)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    nodes = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    grid = surface.query(nodes, signed=False, bound_mm=limit).signed.reshape(z.shape)
    a, b = np.divmod(np.arange(_PAIR_POINTS**2), _PAIR_POINTS)
    keys = _pair_keys(model, model_normals, a, b, size)
    order = np.argsort(keys, kind="stable")
    order = order[keys[order] >= 0]
    chosen = generator.integers(0, len(points), (4 * _PAIRS, 2))
    scan_keys = _pair_keys(points, normals, chosen[:, 0], chosen[:, 1], size)
    chosen, scan_keys = chosen[scan_keys >= 0][:_PAIRS], scan_keys[scan_keys >= 0][:_PAIRS]
    poses = np.tile(np.eye(4), (_KEPT, 1, 1))
    scores = np.full(_KEPT, np.inf)
    kernels.try_pairs(
        points,
        normals,
        chosen,
        model,
        model_normals,
        np.column_stack([a[order], b[order]]),
        np.searchsorted(keys[order], scan_keys, "left"),
        np.searchsorted(keys[order], scan_keys, "right"),
        _MOST,
        points[generator.integers(0, len(points), _PROBES)],
        grid,
        low,
        step,
        limit,
        poses,
        scores,
    )
    distinct: list[Floats] = []
    for at in np.argsort(scores, kind="stable"):
        if np.isfinite(scores[at]) and all(_differ(poses[at], p, size) for p in distinct):
            distinct.append(poses[at])
        if len(distinct) == 24:
            break
    if not distinct:
        raise NotRegistered("scan cannot be registered: it has no pair of points like the target")
    return np.array(distinct)


def _pair_keys(points: Floats, normals: Floats, a: Ints, b: Ints, size: float) -> Ints:
    """Number the features of pairs; -1 for pairs too close to tell a direction."""
    line = points[b] - points[a]
    length = np.linalg.norm(line, axis=1)
    line = line / np.maximum(length, 1e-12)[:, None]
    key = np.minimum((length / size * _DISTANCE_BINS).astype(np.int64), _DISTANCE_BINS)
    for first, second in ((normals[a], line), (normals[b], line), (normals[a], normals[b])):
        cosine = np.clip(np.einsum("ij,ij->i", first, second), -1, 1)
        angle = (np.arccos(cosine) / np.pi * _ANGLE_BINS).astype(np.int64)
        key = key * (_ANGLE_BINS + 1) + angle
    return np.where(length > 0.2 * size, key, -1)


def _differ(first: Floats, second: Floats, size: float) -> bool:
    """Whether two poses are more than 8 degrees or 4 % of the size apart."""
    turn = (np.trace(first[:3, :3].T @ second[:3, :3]) - 1) / 2
    return bool(
        turn < np.cos(np.radians(8)) or np.linalg.norm(first[:3, 3] - second[:3, 3]) > 0.04 * size
    )


def _icp(
    pose: Floats,
    points: Floats,
    normals: Floats,
    surface: SurfaceDistance,
    size: float,
    steps: int,
) -> tuple[Floats, float]:
    """Refine a pose; returns it with its misfit (mean distance, each cut at a limit)."""
    limit = CLUTTER_RATIO * size
    scale = limit
    for _ in range(steps):
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        residual, rows, weights, scale = _linearised(moved, pose, normals, surface, scale, limit)
        if not weights.any():
            break
        normal = rows.T @ (rows * weights[:, None])
        turn = np.linalg.solve(
            normal + 1e-9 * np.trace(normal) * np.eye(6), -rows.T @ (weights * residual)
        )
        middle = moved.mean(0)
        change = np.eye(4)
        change[:3, :3] = _rotation(turn[:3])
        change[:3, 3] = middle - change[:3, :3] @ middle + turn[3:]
        pose = change @ pose
        if np.linalg.norm(turn[:3]) * size < 1e-6 and np.linalg.norm(turn[3:]) < 1e-6:
            break
    moved = points @ pose[:3, :3].T + pose[:3, 3]
    distances = surface.query(moved, signed=False, bound_mm=limit).signed
    return pose, float(distances.mean())


def _linearised(
    moved: Floats,
    pose: Floats,
    normals: Floats,
    surface: SurfaceDistance,
    scale: float,
    limit: float,
) -> tuple[Floats, Floats, Floats, float]:
    """Residuals, their change with turn and shift, weights, and the next scale."""
    found = surface.query(moved, bound_mm=limit)
    # The direction to the closest point is the plane's normal, also at edges; very near
    # the surface it is noise, and the face's own normal is better.
    away = moved - found.feet
    direction = surface.normals[found.faces, 0]
    far = np.abs(found.signed) > 0.02 * limit
    direction = np.where(far[:, None], away / np.where(far, found.signed, 1.0)[:, None], direction)
    residual = np.einsum("ij,ij->i", away, direction)
    agree = np.einsum("ij,ij->i", normals @ pose[:3, :3].T, direction) > 0.3
    inside = agree & (np.abs(found.signed) < limit)
    spread = float(np.median(np.abs(residual[inside]))) if inside.any() else limit
    scale = min(scale, max(5 * 1.4826 * spread, 1e-4 * limit))
    share = residual / scale
    weights = np.where(inside & (np.abs(share) < 1), (1 - share**2) ** 2, 0.0)
    arms = moved - moved.mean(0)
    rows = np.column_stack([np.cross(arms, direction), direction])
    return residual, rows, weights, scale


def _rotation(turn: Floats) -> Floats:
    """Rotation matrix of a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _as_it_lies(points: Floats, target: TriangleGeometry) -> Floats:
    """Two first guesses: the scan is in place, or only shifted."""
    shifted = np.eye(4)
    shifted[:3, 3] = sample_surface(target, 2000)[0].mean(0) - points.mean(0)
    return np.array([np.eye(4), shifted])


def _choose(
    poses: Floats, first: int, points: Floats, surface: SurfaceDistance, size: float
) -> tuple[int, float]:
    """Choose among refined poses by the points that the first choice does not call clutter.

    Where several fit equally well the earliest wins: a symmetric part stays as it lies.

    Returns:
        The choice, and its misfit over that of the best different pose.
    """
    limit = CLUTTER_RATIO * size
    distances = np.array(
        [
            surface.query(
                points @ pose[:3, :3].T + pose[:3, 3], signed=False, bound_mm=limit
            ).signed
            for pose in poses
        ]
    )
    used = distances[first] < limit
    if not used.any():
        return first, 0.0
    misfits = distances[:, used].mean(1)
    best = int(np.argmax(misfits <= 1.005 * misfits.min()))
    others = [misfits[k] for k in range(len(poses)) if _differ(poses[k], poses[best], size)]
    rival = float(misfits[best]) / max(min(others), 1e-12) if others else 0.0
    return best, min(rival, 1.0)


def _judge(
    pose: Floats,
    points: Floats,
    normals: Floats,
    surface: SurfaceDistance,
    size: float,
    rival: float,
) -> Registration:
    """Say how well a pose fits and how sure it is."""
    moved = points @ pose[:3, :3].T + pose[:3, 3]
    limit = CLUTTER_RATIO * size
    residual, rows, weights, _ = _linearised(moved, pose, normals, surface, limit, limit)
    distances = surface.query(moved, signed=False, bound_mm=limit).signed
    used = distances < limit
    agree = used & (np.einsum("ij,ij->i", rows[:, 3:], normals @ pose[:3, :3].T) > 0.3)
    fits = agree & (distances < FIT_RATIO * size)
    counted = weights > 0
    noise = float(np.sqrt(np.average(residual**2, weights=weights))) if counted.any() else limit
    # Neighbouring points share their errors: count one point for each 24 of them.
    information = rows.T @ (rows * weights[:, None]) / max(noise, 1e-6) ** 2 / 24
    values, vectors = np.linalg.eigh(information)
    spread = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return Registration(
        T_target_scan=pose,
        rms_mm=noise,
        fit_ratio=float(fits.sum() / max(int(used.sum()), 1)),
        used_ratio=float(used.mean()),
        sigma_mm=float(np.sqrt(np.trace(spread[3:, 3:]))),
        sigma_deg=float(min(np.degrees(np.sqrt(np.trace(spread[:3, :3]))), 180.0)),
        runner_up_ratio=rival,
    )
