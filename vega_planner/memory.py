# SPDX-License-Identifier: Apache-2.0
"""How a process that plans handles its memory."""

from __future__ import annotations

import ctypes
import sys

#: Numbers of `mallopt` in glibc's malloc.h, and the largest threshold it takes [bytes].
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_LARGEST = 32 * 1024 * 1024


def keep_freed_memory() -> None:
    """Keep what is freed for the arrays to come, where the C library lets itself be told.

    Every layer takes and frees arrays of megabytes; given back to the system each time, they
    cost a page fault for every 4 KiB when they come again. Call it early, and only in a
    process of our own.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return
    mallopt(_MMAP_THRESHOLD, _LARGEST)
    mallopt(_TRIM_THRESHOLD, 2**31 - 1)
