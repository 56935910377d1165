# SPDX-License-Identifier: Apache-2.0
"""Everything Vega raises on purpose.

Each class carries the error code of the ROS actions and the exit status of the
command line, so that one failure is told the same way everywhere.
"""

from __future__ import annotations


class VegaError(Exception):
    """Base of all errors raised on purpose.

    Attributes:
        code: Error code in the results of the ROS actions.
        exit_status: Exit status of the command line.
        stage: Name of the pipeline stage that the error passed through, if any.
    """

    code: int = 99
    exit_status: int = 2
    stage: str | None = None


class InvalidInput(VegaError, ValueError):
    """A value, option or argument is out of its range."""

    code = 100


class BadMesh(InvalidInput):
    """A mesh cannot be read, or cannot be repaired into a solid."""

    code = 101


class BadRestraint(InvalidInput):
    """A restraint region selects nothing, everything, or cannot be read."""

    code = 102


class BadRobot(InvalidInput):
    """A robot or tool description cannot be read or has too few axes."""

    code = 103


class NoLayers(VegaError):
    """The part yields no layer at all."""

    code = 110


class NotPrintable(VegaError):
    """Nothing of the part can be printed with this robot, tool and pose."""

    code = 111
    exit_status = 3


class Unreachable(VegaError):
    """A joint trajectory does not exist for a toolpath.

    Attributes:
        waypoint: Index of the first waypoint without a joint configuration.
    """

    code = 112
    exit_status = 3
    waypoint: int = -1


class NotRegistered(VegaError):
    """A scan cannot be laid onto its target.

    Attributes:
        best: The best registration found, or None.
    """

    code = 113
    best: object = None


class OutputError(VegaError, OSError):
    """A result cannot be written (no permission, no space)."""

    code = 120


class Busy(VegaError):
    """A second job was sent while one runs."""

    code = 121


class Cancelled(VegaError):
    """The caller asked to stop; nothing was left half-written."""

    code = 122
    exit_status = 4


class CertificateMismatch(VegaError):
    """A job does not carry a certificate that matches it."""

    code = 123
    exit_status = 4


class DriverError(VegaError):
    """The motion controller or the dispenser failed."""

    code = 200
    exit_status = 4


class LinkTimeout(DriverError, TimeoutError):
    """A device did not answer in time."""

    code = 201


class Refused(DriverError):
    """A device refused a command."""

    code = 202


class Faulted(DriverError):
    """A device is in its fault state."""

    code = 203


def error_class(code: int) -> type[VegaError]:
    """Find the class of an error code; `VegaError` itself for an unknown one."""
    todo: list[type[VegaError]] = [VegaError]
    while todo:
        kind = todo.pop()
        if kind.code == code:
            return kind
        todo.extend(kind.__subclasses__())
    return VegaError
