# SPDX-License-Identifier: Apache-2.0
"""Progress reports: how a long stage tells how far it is, and is told to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Progress:
    """Where a job stands.

    Attributes:
        stage: Name of the running stage, as in `summary.json`.
        fraction: Progress of the whole job, 0 to 1, never falling.
        layers: Number of layers generated so far.
        detail: A few words for a person, or empty.
    """

    stage: str
    fraction: float
    layers: int = 0
    detail: str = ""


#: Receives progress and may raise `Cancelled` to stop the job.
Report = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Discard a report."""


def within(report: Report, stage: str, start: float, end: float) -> Report:
    """Make a report whose fractions 0 to 1 run from `start` to `end` of the whole job.

    Args:
        report: Receiver of the whole job's progress.
        stage: Stage name put into each report.
        start: Fraction of the whole job at which the stage begins.
        end: Fraction of the whole job at which the stage ends.

    Returns:
        A report to hand to the stage.
    """

    highest = start

    def scaled(progress: Progress) -> None:
        nonlocal highest  # a stage that goes through its work twice does not fall back
        fraction = start + (end - start) * min(max(progress.fraction, 0.0), 1.0)
        highest = max(highest, fraction)
        report(replace(progress, stage=stage, fraction=highest))

    return scaled
