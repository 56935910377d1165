# SPDX-License-Identifier: Apache-2.0
"""Who may import what, read from the syntax trees."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted([*ROOT.glob("vega_planner/**/*.py"), *ROOT.glob("vega_robot_driver/**/*.py")])
ROS = {"unique_identifier_msgs", "control_msgs",
       "rclpy", "vega_msgs", "std_msgs", "sensor_msgs", "visualization_msgs", "shape_msgs",
       "trajectory_msgs", "diagnostic_msgs", "std_srvs", "geometry_msgs", "tf2_msgs",
       "action_msgs", "lifecycle_msgs", "builtin_interfaces", "rcl_interfaces"}  # fmt: skip
FLOW = ["part", "layers", "printability", "splitting", "ordering", "toolpaths", "trajectory"]
MADE_FROM_IT = {"assess", "export", "viewer", "results", "nodes", "cli"}
HEAVY = {"open3d", "sklearn", "pinocchio", "matplotlib", "toppra", "coal", "viser"}


def imports(path, top_level_only=False):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = tree.body if top_level_only else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def room(path):
    parts = path.relative_to(ROOT).parts
    return parts[1] if len(parts) > 2 else ""


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_only_the_nodes_know_ros(path):
    if room(path) != "nodes":
        assert not {name.split(".")[0] for name in imports(path)} & ROS


@pytest.mark.parametrize(
    "path", [p for p in SOURCES if room(p) in FLOW], ids=lambda p: str(p.relative_to(ROOT))
)
def test_the_flow_imports_nothing_that_is_made_from_it(path):
    rooms = {n.split(".")[1] for n in imports(path) if n.startswith("vega_planner.")}
    assert not rooms & MADE_FROM_IT
    assert not any(name.startswith("vega_robot_driver") for name in imports(path))


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_heavy_packages_are_imported_where_they_are_used(path):
    assert not {name.split(".")[0] for name in imports(path, top_level_only=True)} & HEAVY


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_source_says_its_licence_first(path):
    assert path.read_text(encoding="utf-8").startswith("# SPDX-License-Identifier: Apache-2.0")


def test_help_loads_no_numerical_package():
    code = (
        "import sys\n"
        "from vega_planner.cli.parser import make_parser\n"
        "make_parser().format_help()\n"
        "print([m for m in ('numpy', 'numba', 'scipy', 'yaml') if m in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert shown.stdout.strip() == "[]"
