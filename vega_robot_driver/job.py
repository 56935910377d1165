# SPDX-License-Identifier: Apache-2.0
"""A print job: joint motion over time, and when to dispense. SI units throughout."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, frozen_array
from vega_planner.errors import CertificateMismatch, InvalidInput
from vega_planner.job_digest import job_digest
from vega_robot_driver.curve import Curve


@dataclass(frozen=True, eq=False)
class PrintJob:
    """What a machine is asked to do.

    Attributes:
        joint_names: As in the URDF, shape (j,).
        times: Times along the path [s], strictly rising from 0, shape (n,), n >= 2.
        positions: Joint positions [m, rad], shape (n, j).
        velocities: Joint velocities [m/s, rad/s], shape (n, j).
        extrude: True where the dispenser is on during the interval that ends at the
            sample, shape (n,).
        path_id: Pass each sample belongs to, -1 on travel, shape (n,).
        path_layer: Layer of each pass, shape (p,), or of length 0 where unknown.
    """

    joint_names: tuple[str, ...]
    times: Floats
    positions: Floats
    velocities: Floats
    extrude: Bools
    path_id: Ints
    path_layer: Ints

    def __post_init__(self) -> None:
        count, joints = len(self.times), len(self.joint_names)
        if count < 2:
            raise InvalidInput(f"a job has {count} samples; at least 2 are needed")
        for name, dtype, shape in (
            ("times", np.float64, (count,)),
            ("positions", np.float64, (count, joints)),
            ("velocities", np.float64, (count, joints)),
            ("extrude", np.bool_, (count,)),
            ("path_id", np.int64, (count,)),
            ("path_layer", np.int64, (None,)),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), dtype, shape))
        if np.diff(self.times).min() <= 0:
            raise InvalidInput("the job's times do not rise strictly")

    @property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.times[-1])

    @property
    def paths(self) -> int:
        """Number of passes."""
        return int(self.path_id.max(initial=-1)) + 1

    @cached_property
    def path_ends(self) -> Floats:
        """Time of each pass's last sample [s], rising, shape (p,)."""
        ends = np.zeros(self.paths)
        inside = self.path_id >= 0
        np.maximum.at(ends, self.path_id[inside], self.times[inside])
        return np.maximum.accumulate(ends)

    @cached_property
    def _hash(self) -> str:
        return job_digest(
            self.joint_names,
            self.times,
            self.positions,
            self.velocities,
            self.extrude,
            self.path_id,
        )

    def digest(self) -> str:
        """Hash what the machine will do; see `job_digest`."""
        return self._hash

    def extremes(self, dt: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Find what the curve between the samples asks of the joints, at full speed.

        Args:
            dt: Cycle time [s] at which the machine follows the curve.

        Returns:
            Lowest and highest positions, largest speeds and the times of these [s], each
            of shape (j,).
        """
        return Curve(self.times, self.positions, self.velocities).extremes(dt)

    def intervals(self, *, lead_s: float = 0.0, lag_s: float = 0.0) -> Floats:
        """List when the dispenser is on.

        Args:
            lead_s: Time by which it is switched on before a bead starts.
            lag_s: Time by which it is switched off before a bead ends, but not before
                its middle.

        Returns:
            Times [s] at which it goes on and off, rising, shape (k, 2).
        """
        on = np.concatenate([[False], self.extrude[1:], [False]])  # over the intervals
        edges = np.flatnonzero(on[1:] != on[:-1])
        beads = self.times[edges].reshape(-1, 2)
        spans = beads - [lead_s, lag_s]
        spans[:, 1] = np.maximum(spans[:, 1], beads.mean(axis=1))
        spans = spans[spans[:, 1] > spans[:, 0]]
        if len(spans) == 0:
            return np.zeros((0, 2))
        joined = [spans[0]]
        for span in spans[1:]:
            if span[0] <= joined[-1][1]:
                joined[-1] = np.array([joined[-1][0], span[1]])
            else:
                joined.append(span)
        return np.maximum(np.array(joined), self.times[0])

    def layer_of(self, path: int) -> int:
        """Name the layer of a pass, -1 where there is none or it is unknown."""
        return int(self.path_layer[path]) if 0 <= path < len(self.path_layer) else -1


def estimated_velocities(times: Floats, positions: Floats) -> Floats:
    """Estimate joint velocities from a path's samples.

    The derivative of the parabola through each sample and its neighbours, nothing at
    the ends, and nothing where a joint turns round, so that the curve between samples does
    not overshoot.

    Args:
        times: Rising times [s], shape (n,).
        positions: Joint positions, shape (n, j).

    Returns:
        Velocities, shape (n, j).
    """
    step = np.diff(times)[:, None]
    slope = np.diff(positions, axis=0) / step
    velocities = np.zeros_like(positions)
    inner = (slope[:-1] * step[1:] + slope[1:] * step[:-1]) / (step[1:] + step[:-1])
    limit = 3 * np.minimum(abs(slope[:-1]), abs(slope[1:]))
    inner = np.clip(inner, -limit, limit)
    velocities[1:-1] = np.where(slope[:-1] * slope[1:] > 0, inner, 0.0)
    return velocities


def read_job(folder: str | Path) -> tuple[PrintJob, str]:
    """Read the job of a result folder.

    Args:
        folder: Result folder of a plan.

    Returns:
        The job, and the text of its certificate, empty where it has none.

    Raises:
        InvalidInput: If the folder holds no readable job.
    """
    folder = Path(folder)
    table = _table(folder / "trajectory.csv")
    names = tuple(name for name in table if name not in ("t_s", "extrude", "path_id"))
    for needed in ("t_s", "extrude", "path_id"):
        if needed not in table:
            raise InvalidInput(f"{folder / 'trajectory.csv'} has no column {needed}")
    positions = np.column_stack([table[name] for name in names])
    path_id = table["path_id"].astype(np.int64)
    certificate = folder / "certificate.json"
    job = PrintJob(
        joint_names=names,
        times=table["t_s"],
        positions=positions,
        velocities=_velocities(folder / "velocities.csv", names, positions.shape),
        extrude=table["extrude"] > 0.5,
        path_id=path_id,
        path_layer=_layers(folder / "toolpath.csv", int(path_id.max(initial=-1)) + 1),
    )
    return job, certificate.read_text(encoding="utf-8") if certificate.is_file() else ""


def _table(path: Path) -> dict[str, Floats]:
    try:
        with path.open(encoding="utf-8") as file:
            names = file.readline().strip().split(",")
            values = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InvalidInput(f"job table {path} cannot be read: {error}") from error
    if values.shape[1:] != (len(names),) or len(values) < 2:
        raise InvalidInput(f"job table {path} has {values.shape} numbers for {len(names)} names")
    return {name: values[:, k].copy() for k, name in enumerate(names)}


def _velocities(path: Path, names: tuple[str, ...], shape: tuple[int, ...]) -> Floats:
    table = _table(path)
    missing = [name for name in names if name not in table]
    if missing:
        raise InvalidInput(f"job table {path} has no column {missing[0]}")
    velocities = np.column_stack([table[name] for name in names])
    if velocities.shape != shape:
        raise InvalidInput(f"job table {path} has {len(velocities)} rows; expected {shape[0]}")
    return velocities


def _layers(path: Path, paths: int) -> Ints:
    """Read which layer each pass belongs to, where the folder says so."""
    if not path.is_file():
        return np.zeros(0, np.int64)
    table = _table(path)
    layers = np.full(paths, -1, np.int64)
    index = table["path_id"].astype(np.int64)
    inside = (index >= 0) & (index < paths)
    layers[index[inside]] = table["layer"][inside].astype(np.int64)
    return layers


def check_certificate(job: PrintJob, text: str) -> None:
    """Refuse a job whose certificate is missing, belongs to another job, or tells of a collision.

    Args:
        job: The job.
        text: Content of its `certificate.json`.

    Raises:
        CertificateMismatch: Saying what does not match, or what collides.
    """
    if not text.strip():
        raise CertificateMismatch("the job carries no certificate (certificate.json of its plan)")
    try:
        certificate: dict[str, Any] = json.loads(text)
        expected = str(certificate["sha256"]["job"])
    except (ValueError, KeyError, TypeError) as error:
        raise CertificateMismatch(f"the certificate cannot be read: {error}") from error
    if job.digest() != expected:
        raise CertificateMismatch(
            f"the certificate is for job {expected[:12]}, this is job {job.digest()[:12]}"
        )
    if certificate.get("collision_free", True) is not True:
        check = certificate.get("check")
        told = check if isinstance(check, dict) else {}
        raise CertificateMismatch(
            "the certificate says that the job collides: "
            f"{told.get('colliding_waypoints', 'unknown')} waypoints of the nozzle, "
            f"{told.get('touching_samples', 'unknown')} samples of the robot's links "
            f"({', '.join(map(str, told.get('touching_links') or [])) or 'none named'}); see "
            "the reasons in its summary.json, and plan again"
        )
