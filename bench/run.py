# SPDX-License-Identifier: Apache-2.0
"""Run the benchmarks one after the other: `make bench`, or `bench/run.py layers whole`.

Each is a script of its own that prints quality first, then seconds and memory.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
#: In the order of the pipeline. Scripts that help others are not listed.
ORDER = (
    "layers",
    "engines",
    "printability",
    "toolpaths",
    "spacing",
    "trajectory",
    "whole",
    "fidelity",
    "ruler",
    "driver",
    "viewer",
)


def main(names: list[str]) -> int:
    there = [name for name in ORDER if (HERE / f"{name}.py").is_file()]
    unknown = sorted(set(names) - set(there))
    if unknown:
        print(f"bench: unknown '{unknown[0]}'; choices: {', '.join(there)}", file=sys.stderr)
        return 2
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    failed = []
    for name in names or there:
        print(f"== {name}", flush=True)
        began = time.monotonic()
        done = subprocess.run([sys.executable, HERE / f"{name}.py"], env=environment)
        print(f"== {name}: {time.monotonic() - began:.0f} s, status {done.returncode}", flush=True)
        if done.returncode:
            failed.append(name)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
