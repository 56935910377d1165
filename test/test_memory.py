# SPDX-License-Identifier: Apache-2.0
"""Memory that is freed is kept for the arrays to come."""

import subprocess
import sys

#: Takes and frees 16 MB again and again; prints the page faults after the first time.
PROGRAM = """
import resource, sys
import numpy as np
from vega_planner.memory import keep_freed_memory
if sys.argv[1] == "keep":
    keep_freed_memory()
small = []
for turn in range(5):
    if turn == 1:
        began = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    pieces = [np.ones(250_000) for _ in range(8)]
    small.append(bytearray(1000))  # something that stays above them
    del pieces
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - began)
"""


def faults(word: str) -> int:
    words = [sys.executable, "-c", PROGRAM, word]
    return int(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def test_arrays_that_come_again_cost_no_page_faults():
    assert faults("keep") < 200 < 10_000 < faults("leave")
