# SPDX-License-Identifier: Apache-2.0
"""The hash by which a driver knows the job that a certificate belongs to."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints

#: Resolution to which numbers count (SI): that of the result folder's tables.
PER_UNIT = 1e9


def job_digest(
    joint_names: Sequence[str],
    times: Floats,
    positions: Floats,
    velocities: Floats,
    extrude: Bools,
    path_id: Ints,
) -> str:
    """Hash what a machine will do: motion, deposition and passes.

    Numbers count to the resolution of `trajectory.csv`, rounded as they are printed, so that
    a job read from a result folder and the same job sent in a message have one hash.

    Args:
        joint_names: As in the URDF, length j.
        times: Times [s], shape (n,).
        positions: Joint positions [m, rad], shape (n, j).
        velocities: Joint velocities [m/s, rad/s], shape (n, j).
        extrude: Whether the dispenser is on before each sample, shape (n,).
        path_id: Pass of each sample, shape (n,).

    Returns:
        SHA-256 in hexadecimal digits.
    """
    digest = hashlib.sha256(",".join(joint_names).encode())
    for values in (times, positions, velocities):
        digest.update(np.rint(np.asarray(values) * PER_UNIT).astype("<i8").tobytes())
    digest.update(np.asarray(extrude).astype("<i1").tobytes())
    digest.update(np.asarray(path_id).astype("<i8").tobytes())
    return digest.hexdigest()
