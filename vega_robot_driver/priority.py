# SPDX-License-Identifier: Apache-2.0
"""Real-time scheduling, where it is granted.

Priorities rise from the threads beside the cycle, over the cycle, to emulated drives: the cycle
waits for them without giving the processor up. What a process starts has none of it.
"""

from __future__ import annotations

import contextlib
import os

HELPERS, CYCLE, DRIVES = 60, 80, 85


def claim(priority: int, thread: int = 0) -> None:
    """Ask for a priority above everything ordinary; it may be refused.

    Args:
        priority: The priority.
        thread: Native number of a thread, 0 for the one that asks.
    """
    with contextlib.suppress(OSError):
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(thread, policy, os.sched_param(priority))
