# SPDX-License-Identifier: Apache-2.0
"""An emulated axis: what the motor of a drive moves. All its numbers are invented."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

#: Integration step of an axis that is pushed [s].
_STEP = 0.00025
#: Speed within which friction turns round [m/s, rad/s].
_TURNING = 2e-4


@dataclass(frozen=True)
class Forces:
    """What an axis has to be pushed against. SI: N and kg, or Nm and kg m².

    Attributes:
        scale: Increments per metre or radian.
        mass: Moved mass or inertia.
        rated: Force at 1000 per mille of the drive's target torque.
        gravity: Constant force.
        coulomb: Dry friction.
        viscous: Friction by speed [N s/m].
        cogging: Amplitude of the magnets' force.
        pitch: Distance after which it repeats [m, rad].
        noise: Standard deviation of a force that changes every millisecond.
    """

    scale: float
    mass: float
    rated: float
    gravity: float = 0.0
    coulomb: float = 0.0
    viscous: float = 0.0
    cogging: float = 0.0
    pitch: float = 0.024
    noise: float = 0.0


@dataclass
class Axis:
    """A linear or rotary axis, in increments.

    Attributes:
        travel: Hard stops.
        speed_limit: Largest speed [1/s].
        acceleration_limit: Largest acceleration [1/s²].
        lag_s: Time constant of the position loop.
        position: Where it is.
        speed: How fast it moves.
        jammed: Whether something blocks it.
        origin: What its encoder shows more than its position.
        absolute: Whether the encoder knows its position without homing.
        forces: What a push has to overcome; None for an axis that takes no torque.
        chance: Source of the force noise.
    """

    travel: tuple[float, float]
    speed_limit: float
    acceleration_limit: float
    lag_s: float = 0.0015
    position: float = 0.0
    speed: float = 0.0
    jammed: bool = False
    origin: int = 0
    absolute: bool = True
    forces: Forces | None = None
    chance: random.Random = field(default_factory=lambda: random.Random(0))

    def move(self, wanted_speed: float, dt: float) -> None:
        """Change the speed as far as the motor can, and move."""
        fastest, most = self.speed_limit, self.acceleration_limit * dt
        if not -fastest <= wanted_speed <= fastest:
            wanted_speed = min(max(wanted_speed, -fastest), fastest)
        change = wanted_speed - self.speed
        if not -most <= change <= most:
            change = min(max(change, -most), most)
        self.speed += change
        self._advance(dt)

    def push(self, share: float, dt: float) -> None:
        """Push with a share of the rated force, against everything that resists."""
        forces = self.forces
        if forces is None:
            return self.move(0.0, dt)
        noise = self.chance.gauss(0.0, forces.noise) if forces.noise else 0.0
        steps = max(1, round(dt / _STEP))
        h = dt / steps
        turn = 2 * math.pi / (forces.pitch * forces.scale)
        pushed = share * forces.rated - forces.gravity + noise
        by_mass = h / forces.mass
        speed = self.speed / forces.scale
        for _ in range(steps):
            phase = turn * (self.position + self.origin)
            ripple = math.sin(phase) + 0.4 * math.sin(3 * phase + 0.7)
            # Friction is taken at the end of the step: stiff, and yet it never pushes.
            drag = forces.viscous + forces.coulomb / max(abs(speed), _TURNING)
            speed = (speed + by_mass * (pushed - forces.cogging * ripple)) / (1.0 + by_mass * drag)
            self.speed = speed * forces.scale
            self._advance(h)
            speed = self.speed / forces.scale  # a stop or a jam has taken it
        return None

    def _advance(self, dt: float) -> None:
        if self.jammed:
            self.speed = 0.0
        self.position += self.speed * dt
        low, high = self.travel
        if not low <= self.position <= high:
            self.position, self.speed = min(max(self.position, low), high), 0.0
