# SPDX-License-Identifier: Apache-2.0
"""The command line as a person uses it: a process, its exit status and its two streams."""

import subprocess
import sys
from pathlib import Path

import pytest

VEGA = [sys.executable, "-c", "import sys; from vega_planner.cli import main; sys.exit(main())"]


def vega(*words, cwd=None):
    return subprocess.run([*VEGA, *map(str, words)], capture_output=True, text=True, cwd=cwd)


def complains(done, *parts):
    """One clear line on stderr, nothing on stdout, status 2."""
    assert done.returncode == 2, done
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    for part in parts:
        assert part in done.stderr
    return True


@pytest.mark.parametrize(
    "command",
    ["plan", "slice", "simulate", "evaluate", "compare", "print", "substrate", "view", "export"],
)
def test_every_command_explains_itself(command):
    done = vega(command, "--help")
    assert done.returncode == 0 and command in done.stdout and done.stderr == ""


@pytest.mark.parametrize(
    "words, parts",
    [
        ((), ("COMMAND",)),
        (("bake",), ("bake", "plan")),
        (("plan", "p.stl"), ("-o/--output",)),
        (("plan", "p.stl", "-o", "o", "--thicknes", "1", "--nope"), ("--nope",)),
        (("plan", "p.stl", "-o", "o", "--engine", "magic"), ("magic", "field", "minkowski")),
        (("plan", "p.stl", "-o", "o", "--thickness", "thick"), ("--thickness", "thick")),
        (("plan", "p.stl", "-o", "o", "--thickness", "0"), ("thickness_mm", "0.05")),
        (("plan", "p.stl", "-o", "o", "--thickness", "nan"), ("thickness_mm",)),
        (("plan", "p.stl", "-o", "o", "--settings", "none.yaml"), ("none.yaml",)),
        (("export", "nowhere", "--format", "kuka"), ("kuka", "gcode")),
    ],
)
def test_bad_usage_is_one_line_and_status_2(tmp_path, words, parts):
    assert complains(vega(*words, cwd=tmp_path), *parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name, content, parts",
    [
        ("missing.stl", None, ("missing.stl",)),
        ("empty.stl", b"", ("empty.stl",)),
        ("noise.stl", b"\x00\x01\x02" * 100, ("noise.stl",)),
        ("part.xyz", b"1 2 3", ("part.xyz", "stl")),
        ("half.ply", b"ply\nformat ascii 1.0\nelement vertex 4\n", ("half.ply",)),
        (
            "nan.obj",
            b"v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
            ("'nan'", "not finite"),
        ),
        ("flat.obj", b"v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n", ("'flat'", "no volume")),
    ],
)
def test_a_bad_mesh_is_one_line_and_leaves_nothing_behind(tmp_path, name, content, parts):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    before = sorted(tmp_path.iterdir())
    assert complains(vega("plan", name, "-o", "out", cwd=tmp_path), *parts)
    assert sorted(tmp_path.iterdir()) == before


def test_an_output_that_is_a_file_is_refused_and_kept(tmp_path):
    (tmp_path / "out").write_text("mine")
    (tmp_path / "p.stl").write_text("")
    assert complains(vega("plan", "p.stl", "-o", "out", cwd=tmp_path), "out", "is a file")
    assert (tmp_path / "out").read_text() == "mine"


def test_a_restraint_region_that_means_nothing_names_the_choices(tmp_path):
    part = next(Path(__file__).resolve().parents[2].glob("parts/part1_*.stl"))
    done = vega("plan", part, "-o", "out", "--brr", "sideways", cwd=tmp_path)
    assert complains(done, "sideways", "down", "normal:X,Y,Z")
    assert list(tmp_path.iterdir()) == []
