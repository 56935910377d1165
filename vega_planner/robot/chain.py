# SPDX-License-Identifier: Apache-2.0
"""The joints between base and tip as plain arrays, read out of pinocchio's model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import BadRobot
from vega_planner.robot.description import Description, acceleration_extensions

#: Stands for "no limit" of a joint that turns endlessly [rad].
UNLIMITED = 1e9
#: Limits taken where a description has none: m/s and rad/s, and the time in which a joint
#: reaches its speed. Cautious, and told to the user.
ASSUMED_VELOCITY = {False: 0.25, True: 1.0}
ASSUMED_RISE_S = 0.2


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain with its limits. Metres, radians, seconds.

    Attributes:
        joint_names: Names from base to tip, length j.
        rotations: Frames of the joints in the frames before them, shape (j, 3, 3).
        offsets: Their origins, shape (j, 3).
        axes: Joint axes in the joints' own frames, shape (j, 3).
        revolute: True for turning joints, False for sliding ones, shape (j,).
        tip: Tip in the last frame, shape (3,).
        tip_axes: Nozzle axis (z of the tip frame) and x of the tip frame, in the last
            frame, shape (2, 3).
        lower: Lowest positions, shape (j,).
        upper: Highest positions, shape (j,).
        velocity: Largest velocities, shape (j,).
        acceleration: Largest accelerations, shape (j,).
        T_base_plate: Pose of the build plate's top in the base frame, shape (4, 4).
        assumptions: What was assumed because the description does not say it.
    """

    joint_names: tuple[str, ...]
    rotations: Floats
    offsets: Floats
    axes: Floats
    revolute: Bools
    tip: Floats
    tip_axes: Floats
    lower: Floats
    upper: Floats
    velocity: Floats
    acceleration: Floats
    T_base_plate: Floats
    assumptions: tuple[str, ...] = ()

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The tuple that the kernels take."""
        return (
            self.rotations,
            self.offsets,
            self.axes,
            self.revolute,
            self.tip,
            self.tip_axes,
        )


def read_chain(description: Description) -> Chain:
    """Build the chain between the base and the tip of a described robot.

    Joints off this chain (a gripper's) are left out.

    Raises:
        BadRobot: If the URDF is wrong, the plate moves, or there are under five joints.
    """
    import pinocchio

    try:
        model = pinocchio.buildModelFromXML(description.urdf)
    except Exception as error:  # pinocchio raises bare RuntimeError, ValueError and others
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise BadRobot(f"URDF {description.source} cannot be read: {reason}") from error
    plate = model.frames[model.getFrameId(description.plate_frame)]
    tip = model.frames[model.getFrameId(description.tip_frame)]
    if plate.parentJoint != 0:
        raise BadRobot(
            f"robot '{description.name}': '{description.plate_frame}' hangs on joint "
            f"'{model.names[plate.parentJoint]}'; the plate must stand still"
        )
    ids = [i for i in model.supports[tip.parentJoint] if i != 0]
    names = tuple(model.names[i] for i in ids)
    if len(ids) < 5:
        raise BadRobot(
            f"robot '{description.name}' has {len(ids)} joints between base and "
            f"'{description.tip_frame}' ({', '.join(names) or 'none'}); at least 5 are needed"
        )
    motions = [_motion(model, i, pinocchio) for i in ids]
    limits = [_limits(model, i, bool(m[0])) for i, m in zip(ids, motions, strict=True)]
    accelerations = acceleration_extensions(description.urdf)
    assumptions: list[str] = []
    table = [
        _overridden(name, m[0], limit, accelerations, description, assumptions)
        for name, m, limit in zip(names, motions, limits, strict=True)
    ]
    lower, upper, velocity, acceleration = np.array(table).T
    placements = [model.jointPlacements[i] for i in ids]
    rotation = tip.placement.rotation
    return Chain(
        joint_names=names,
        rotations=np.array([p.rotation for p in placements]),
        offsets=np.array([p.translation for p in placements]),
        axes=np.array([m[1] for m in motions]),
        revolute=np.array([m[0] for m in motions]),
        tip=np.array(tip.placement.translation),
        tip_axes=np.array([rotation[:, 2], rotation[:, 0]]),
        lower=lower.copy(),
        upper=upper.copy(),
        velocity=velocity.copy(),
        acceleration=acceleration.copy(),
        T_base_plate=np.array(plate.placement.homogeneous),
        assumptions=tuple(assumptions),
    )


def _motion(model: Any, joint: int, pinocchio: Any) -> tuple[bool, Floats]:
    """Kind (turning?) and axis of a joint with one degree of freedom."""
    if model.joints[joint].nv != 1:
        raise BadRobot(
            f"joint '{model.names[joint]}' has {model.joints[joint].nv} degrees of freedom; "
            "only joints with one are known"
        )
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, pinocchio.neutral(model))
    subspace = np.array(data.S).reshape(6)
    turning = bool(np.linalg.norm(subspace[3:]) > 0.5)
    return turning, subspace[3:] if turning else subspace[:3]


def _limits(model: Any, joint: int, turning: bool) -> tuple[float, float, float]:
    if model.joints[joint].nq == 2:  # continuous: pinocchio keeps cosine and sine
        lower, upper = -UNLIMITED, UNLIMITED
    else:
        index = model.joints[joint].idx_q
        lower = float(np.clip(model.lowerPositionLimit[index], -UNLIMITED, UNLIMITED))
        upper = float(np.clip(model.upperPositionLimit[index], -UNLIMITED, UNLIMITED))
        if turning and lower == upper == 0.0:
            lower, upper = -UNLIMITED, UNLIMITED
    return lower, upper, float(model.velocityLimit[model.joints[joint].idx_v])


def _overridden(
    name: str,
    turning: bool,
    limits: tuple[float, float, float],
    accelerations: dict[str, float],
    description: Description,
    assumptions: list[str],
) -> tuple[float, float, float, float]:
    """The URDF's limits with the configuration's over them and the gaps filled."""
    own = description.joints.get(name, {})
    lower, upper, velocity = limits
    try:
        lower, upper = float(own.get("lower", lower)), float(own.get("upper", upper))
        velocity = float(own.get("velocity", velocity))
        acceleration = float(own.get("acceleration", accelerations.get(name, 0.0)))
    except (TypeError, ValueError) as error:
        raise BadRobot(f"robot '{description.name}', joint '{name}': {error}") from error
    if not 0.0 < velocity < 1e6:
        velocity = ASSUMED_VELOCITY[turning]
        assumptions.append(f"joint '{name}': no velocity limit, {velocity:g} assumed")
    if not 0.0 < acceleration < 1e9:
        acceleration = velocity / ASSUMED_RISE_S
        assumptions.append(f"joint '{name}': no acceleration limit, {acceleration:.4g} assumed")
    if not lower < upper:
        raise BadRobot(
            f"robot '{description.name}', joint '{name}': limits {lower:g} to {upper:g} are empty"
        )
    return lower, upper, velocity, acceleration
