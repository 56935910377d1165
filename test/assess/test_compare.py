# SPDX-License-Identifier: Apache-2.0
"""`vega compare` on a half ball: its folder, its figures, its page; and bad input."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from vega_planner.assess.compare import compare_folders
from vega_planner.cli import main
from vega_planner.errors import InvalidInput

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = ("http://", "https://", "<script", ' src="/', "<link")


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    sys.path.insert(0, str(ROOT / "tools"))
    from kernel_cases import half_ball

    vertices, faces = half_ball(5.0, 10, 24)
    path = tmp_path_factory.mktemp("part") / "ball.obj"
    rows = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices]
    path.write_text("\n".join([*rows, *(f"f {a} {b} {c}" for a, b, c in faces + 1)]) + "\n")
    return path


@pytest.fixture(scope="module")
def compared(ball, tmp_path_factory):
    out = tmp_path_factory.mktemp("work") / "out"
    words = ["compare", ball, "-o", out, "--brr", "down", "--voxel", 0.25, "-q"]
    assert main([str(word) for word in words]) == 0
    return out


def refused(capsys, *words, status=2):
    """Run a command that fails; return its one line."""
    assert main([str(word) for word in words]) == status
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 1
    assert shown.err.startswith(f"vega {words[0]}: ")
    return shown.err


def test_comparison_holds_two_whole_results_and_nothing_is_left_beside_it(compared):
    assert [path.name for path in compared.parent.iterdir()] == ["out"]
    assert sorted(path.name for path in compared.iterdir()) == [
        "comparison.json", "plan", "report.html", "slice",
    ]  # fmt: skip
    for name in ("plan", "slice"):
        files = {path.name for path in (compared / name).iterdir()}
        assert {"toolpath.csv", "summary.json", "printed.ply", "fidelity.json"} <= files


def test_figures_are_those_of_the_folders_and_changes_follow_from_them(compared):
    figures = json.loads((compared / "comparison.json").read_text())
    for name, folder in (("planar", "slice"), ("enveloping", "plan")):
        fidelity = json.loads((compared / folder / "fidelity.json").read_text())
        summary = json.loads((compared / folder / "summary.json").read_text())
        assert fidelity.items() <= figures[name].items()
        assert figures[name]["path_length_mm"] == summary["path_length_mm"]
    for key, change in figures["change_pct"]["free"].items():
        old, new = (figures[name]["free"][key] for name in ("planar", "enveloping"))
        assert change == pytest.approx(100 * (new / old - 1), abs=0.01)


def test_enveloping_beats_planar_on_a_half_ball(compared):
    change = json.loads((compared / "comparison.json").read_text())["change_pct"]["free"]
    assert change["e1_pct"] < -40
    assert change["e2_mean_mm"] < -50


def test_page_shows_both_prints_and_needs_nothing_else(compared):
    page = (compared / "report.html").read_text().replace("http://www.w3.org/2000/svg", "")
    assert page.count("data:image/png;base64,") == 11
    assert page.count("<svg") == 2
    assert "Comparison: ball" in page
    assert not [word for word in OUTSIDE if word in page]
    figures = json.loads((compared / "comparison.json").read_text())
    for name in ("planar", "enveloping"):
        assert f"{figures[name]['free']['e2_mean_mm']:.4f}" in page


def test_page_of_a_plan_says_what_its_summary_says(compared):
    page = (compared / "plan" / "plan.html").read_text().replace("http://www.w3.org/2000/svg", "")
    summary = json.loads((compared / "plan" / "summary.json").read_text())
    assert f"{summary['layers']} layers of {summary['layer_thickness_mm']:g} mm" in page
    assert page.count("data:image/png;base64,") >= 3
    assert not [word for word in OUTSIDE if word in page]


def test_comparing_again_gives_the_same_figures(compared, tmp_path):
    again = compare_folders(compared / "plan", compared / "slice", tmp_path / "again")
    assert again == json.loads((compared / "comparison.json").read_text())
    assert (tmp_path / "again/report.html").read_bytes() == (compared / "report.html").read_bytes()


def test_folder_without_a_virtual_print_is_refused(compared, tmp_path):
    with pytest.raises(InvalidInput, match="vega simulate"):
        compare_folders(compared / "plan", tmp_path, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("voxel", ["0", "-1", "nan", "inf"])
def test_comparison_with_a_bad_voxel_leaves_nothing(ball, tmp_path, capsys, voxel):
    words = ("compare", ball, "-o", tmp_path / "out", "--brr", "down", "--voxel", voxel)
    assert "voxel size" in refused(capsys, *words)
    assert list(tmp_path.iterdir()) == []


def test_comparison_that_fails_half_way_leaves_the_old_result(ball, tmp_path, capsys):
    """The voxels only turn out too small when the plan is made."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").write_text("old")
    words = ("compare", ball, "-o", tmp_path / "out", "--brr", "down", "--voxel", "0.001", "-q")
    assert "least possible" in refused(capsys, *words)
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "report.html"]
    assert (tmp_path / "out" / "report.html").read_text() == "old"


def test_simulating_what_is_no_result_names_what_is_missing(compared, tmp_path, capsys):
    assert "no such folder" in refused(capsys, "simulate", tmp_path / "nowhere")
    assert "it has no part.ply" in refused(capsys, "simulate", tmp_path)
    (tmp_path / "part.ply").write_bytes((compared / "plan" / "part.ply").read_bytes())
    assert "it has no toolpath.csv" in refused(capsys, "simulate", tmp_path)
    (tmp_path / "toolpath.csv").write_text("x_mm,y_mm\n1,2\n")
    assert "toolpath.csv" in refused(capsys, "simulate", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.ply", "toolpath.csv"]


def test_simulating_again_prints_the_figures_that_it_writes(compared, capsys):
    before = (compared / "plan" / "fidelity.json").read_bytes()
    assert main(["simulate", str(compared / "plan"), "--voxel", "0.25"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(before)
    assert (compared / "plan" / "fidelity.json").read_bytes() == before


def test_a_missing_scan_or_target_is_named(compared, ball, tmp_path, capsys):
    scan = compared / "plan" / "printed.ply"
    out = tmp_path / "out"
    assert "none.ply" in refused(capsys, "evaluate", tmp_path / "none.ply", ball, "-o", out)
    assert "none.stl" in refused(capsys, "evaluate", scan, tmp_path / "none.stl", "-o", out)
    assert not out.exists()


def test_a_virtual_print_is_evaluated_like_a_scan(compared, ball, tmp_path):
    scan = compared / "plan" / "printed.ply"
    assert main(["evaluate", str(scan), str(ball), "-o", str(tmp_path / "out"), "-q"]) == 0
    found = json.loads((tmp_path / "out" / "metrics.json").read_text())
    simulated = json.loads((compared / "plan" / "fidelity.json").read_text())
    assert found["e2_mean_mm"] == pytest.approx(simulated["e2_mean_mm"], abs=0.03)
    assert np.isfinite(found["e3_mm2"])
