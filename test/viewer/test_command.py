# SPDX-License-Identifier: Apache-2.0
"""The command that is shown does what was clicked."""

import shlex
from pathlib import Path

import pytest

from vega_planner.cli import join_negative
from vega_planner.cli.commands import read_settings
from vega_planner.cli.parser import make_parser
from vega_planner.settings import Settings
from vega_planner.viewer.command import OPTIONS, needs_file, plan_command, save_settings

OTHER = {
    "layers.thickness_mm": 0.65,
    "toolpaths.width_mm": 1.4,
    "trajectory.speed_mm_s": 7.5,
    "layers.engine": "minkowski",
    "toolpaths.pattern": "spiral",
    "toolpaths.angle_deg": -30.0,
    "toolpaths.spacing": "euclidean",
    "printability.orientation": "vertical",
    "cell.robot": "ur5e",
    "cell.tool": "my tool.yaml",
    "cell.material": "other",
    "cell.pose": "-5,0,0,10",
}


def changed(changes):
    nested = {}
    for key, value in changes.items():
        section, name = key.split(".")
        nested.setdefault(section, {})[name] = value
    return Settings().updated(nested)


def parsed(command):
    words = shlex.split(command.replace("\\\n", " "))
    assert words[:2] == ["vega", "plan"]
    return make_parser().parse_args(join_negative(words[1:]))


def test_every_option_has_a_case_here():
    assert set(OTHER) == set(OPTIONS)


@pytest.mark.parametrize("keys", [[key] for key in OTHER] + [list(OTHER)])
def test_the_command_parses_back_into_the_same_settings(keys):
    settings = changed({key: OTHER[key] for key in keys})
    brr = ("point:-1.5,0,3", "faces:/a b/f.txt")
    settings = settings.updated({"part": {"brr": brr}})
    command = plan_command("my part.stl", "out/x", brr, settings, Settings(), None, Path("unused"))
    options = parsed(command)
    assert (options.part, options.output) == ("my part.stl", "out/x")
    assert read_settings(options) == settings


def test_what_has_no_option_goes_into_a_settings_file(tmp_path):
    settings = changed({"printability.clearance_mm": 0.9, "layers.thickness_mm": 0.5})
    assert needs_file(settings, Settings())
    own = tmp_path / "own.yaml"
    save_settings(settings, own)
    command = plan_command("p.stl", "o", ("down",), settings, Settings(), None, own)
    assert read_settings(parsed(command)) == settings.updated({"part": {"brr": ("down",)}})


def test_the_settings_file_beside_the_part_is_named(tmp_path):
    beside = tmp_path / "part.yaml"
    beside.write_text("layers:\n  thickness_mm: 0.6\n")
    base = changed({"layers.thickness_mm": 0.6})
    command = plan_command("p.stl", "o", ("none",), base, base, beside, Path("unused"))
    assert read_settings(parsed(command)) == base.updated({"part": {"brr": ("none",)}})
