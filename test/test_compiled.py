# SPDX-License-Identifier: Apache-2.0
"""Kernels: the machine code built at set-up, and what numba makes where that does not fit."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vega_planner import compiled
from vega_planner.part import surface_kernels
from vega_planner.toolpaths import polyline_kernels

ROOT = Path(__file__).resolve().parent.parent

PLAN = """
import sys
sys.path.insert(0, sys.argv[1])
from kernel_cases import half_ball
from vega_planner.pipeline import plan
from vega_planner.settings import Settings
result = plan((*half_ball(), "half ball"), Settings().updated({"part": {"brr": ["down"]}}))
result.write(__import__("pathlib").Path(sys.argv[2]))
print(len(result.stack.layers), [name for name in ("numba", "llvmlite") if name in sys.modules])
"""


def line(count: int = 7) -> np.ndarray:
    rows = np.zeros((count, 3))
    rows[:, 0] = np.arange(count)
    return rows


def built() -> dict:
    return compiled._built()


def test_a_plan_from_mesh_to_files_needs_no_compiler(tmp_path):
    words = [sys.executable, "-c", PLAN, str(ROOT / "tools"), str(tmp_path / "out")]
    said = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=True).stdout
    layers, loaded = said.split(" ", 1)
    assert int(layers) > 3
    assert loaded.strip() == "[]"


def test_built_code_and_numba_give_the_same_bytes():
    vertices = np.random.default_rng(3).normal(size=(50, 3))
    faces = np.random.default_rng(4).integers(0, 50, (80, 3))
    kernel = surface_kernels.vertex_normals
    assert (kernel.__module__, kernel.__name__) in built()
    np.testing.assert_array_equal(kernel(vertices, faces), kernel.dispatcher(vertices, faces))


@pytest.mark.parametrize(
    "rows",
    [
        np.asfortranarray(line()),
        line(14)[::2],
        np.repeat(line(), 2, axis=1)[:, ::2],
        line().astype(np.float32),
    ],
    ids=["Fortran order", "every other row", "every other column", "single precision"],
)
def test_arrays_that_no_built_code_takes_are_measured_rightly_all_the_same(rows):
    expected = float(np.linalg.norm(np.diff(np.asarray(rows, float), axis=0), axis=1).sum())
    assert polyline_kernels.line_length(rows, False) == pytest.approx(expected, rel=1e-6)


def test_code_that_only_reads_takes_what_may_and_what_may_not_be_written():
    fixed = np.random.default_rng(3).normal(size=(50, 3))
    free = fixed.copy()
    fixed.flags.writeable = False
    faces = np.random.default_rng(4).integers(0, 50, (80, 3))
    np.testing.assert_array_equal(
        surface_kernels.vertex_normals(fixed, faces), surface_kernels.vertex_normals(free, faces)
    )


def test_every_listed_signature_is_built():
    listed = compiled.signatures()
    assert {key: [words for words, _ in rows] for key, rows in built().items()} == listed


def test_libraries_of_other_kernels_are_not_used(tmp_path, monkeypatch):
    shutil.copytree(compiled.LIBRARIES, tmp_path / "compiled")
    made = tmp_path / "compiled" / "made.json"
    made.write_text(json.dumps(json.loads(made.read_text()) | {"state": "of another day"}))
    monkeypatch.setattr(compiled, "LIBRARIES", tmp_path / "compiled")
    assert compiled._built.__wrapped__() == {}


def test_without_libraries_numba_does_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "LIBRARIES", tmp_path / "nothing")
    monkeypatch.setattr(compiled, "_built", compiled._built.__wrapped__)
    fresh = compiled.Kernel(polyline_kernels.line_length.py_func, {})
    assert fresh(line(5), False) == 4.0
