# SPDX-License-Identifier: Apache-2.0
"""The force along each axis that does not move it: recorded once, fed forward ever after."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, Floats

#: Speed at which most of the friction is there [m/s, rad/s].
TURNING_SPEED = 2e-4
#: Samples that are averaged into one value, and the most values of an axis.
PER_BIN, MOST_BINS = 25, 4000


@dataclass(frozen=True, eq=False)
class AxisDisturbance:
    """The force an axis takes at steady speed.

    Attributes:
        places: Rising positions [m, rad], shape (n,).
        forward: Force there while moving up [N, Nm], shape (n,).
        backward: Force there while moving down, shape (n,).
    """

    places: Floats
    forward: Floats
    backward: Floats

    def __call__(self, q: float, v: float) -> float:
        """Find the force at a position and a speed, held beyond the calibrated range."""
        up = np.interp(q, self.places, self.forward)
        down = np.interp(q, self.places, self.backward)
        share = np.tanh(v / TURNING_SPEED)
        return float(0.5 * (up + down) + 0.5 * (up - down) * share)


@dataclass(frozen=True, eq=False)
class DisturbanceMap:
    """The disturbance of all axes.

    Attributes:
        joint_names: The axes.
        axes: Their disturbances.
        homing_epoch: Homing to which the positions belong.
    """

    joint_names: tuple[str, ...]
    axes: tuple[AxisDisturbance, ...]
    homing_epoch: int

    def __call__(self, q: Floats, v: Floats) -> Floats:
        """Find the forces at joint positions (j,) and speeds (j,)."""
        return np.array([axis(*at) for axis, *at in zip(self.axes, q, v, strict=True)])

    def write(self, path: Path) -> None:
        """Write it to a file."""
        arrays = {
            f"{name}.{part}": getattr(axis, part)
            for name, axis in zip(self.joint_names, self.axes, strict=True)
            for part in ("places", "forward", "backward")
        }
        fresh = path.with_suffix(".new.npz")
        np.savez(fresh, homing_epoch=np.array(self.homing_epoch), **arrays)
        fresh.replace(path)

    @classmethod
    def read(
        cls, path: Path, joint_names: tuple[str, ...], homing_epoch: int
    ) -> DisturbanceMap | None:
        """Read the map of these axes; None where there is none of them and their homing."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["homing_epoch"]) != homing_epoch:
                    return None
                parts = ("places", "forward", "backward")
                axes = tuple(
                    AxisDisturbance(*(file[f"{name}.{part}"] for part in parts))
                    for name in joint_names
                )
        except (OSError, ValueError, KeyError):
            return None
        return cls(joint_names, axes, homing_epoch)


class Recording:
    """Forces of a calibration run, cycle by cycle.

    Args:
        count: Number of axes.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._rows: list[tuple[Floats, Floats, Floats]] = []

    def add(self, positions: Floats, speeds: Floats, forces: Floats) -> None:
        """Take one cycle: measured positions, wanted speeds, applied forces, shape (j,)."""
        self._rows.append((positions, speeds.copy(), forces))

    def to_map(self, joint_names: tuple[str, ...], homing_epoch: int) -> DisturbanceMap:
        """Average the forces at steady speed by position and direction."""
        if not self._rows:
            self._rows.append((np.zeros(self._count),) * 3)
        places, speeds, forces = (np.array(column) for column in zip(*self._rows, strict=True))
        axes = tuple(
            _averaged(places[:, k], speeds[:, k], forces[:, k]) for k in range(self._count)
        )
        return DisturbanceMap(joint_names, axes, homing_epoch)


def _averaged(place: Floats, speed: Floats, force: Floats) -> AxisDisturbance:
    steady = np.abs(speed) > 0.999 * np.abs(speed).max()
    up, down = steady & (speed > 0), steady & (speed < 0)
    if up.sum() < PER_BIN or down.sum() < PER_BIN:  # it was not swept
        return AxisDisturbance(np.zeros(1), np.zeros(1), np.zeros(1))
    low, high = place[up | down].min(), place[up | down].max()
    count = int(np.clip(min(up.sum(), down.sum()) // PER_BIN, 2, MOST_BINS))
    edges = np.linspace(low, high, count + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return AxisDisturbance(
        middle, _profile(place, force, up, edges), _profile(place, force, down, edges)
    )


def _profile(place: Floats, force: Floats, chosen: Bools, edges: Floats) -> Floats:
    """Mean force between the edges, and between them where nothing was seen, (n,)."""
    total = np.histogram(place[chosen], edges, weights=force[chosen])[0]
    number = np.histogram(place[chosen], edges)[0]
    seen = number > 0
    middle = 0.5 * (edges[1:] + edges[:-1])
    return np.interp(middle, middle[seen], total[seen] / number[seen])
