# SPDX-License-Identifier: Apache-2.0
"""One failure is told the same way everywhere: exceptions, actions, documentation."""

from __future__ import annotations

import re
from pathlib import Path

import vega_planner.errors as errors

ROOT = Path(__file__).resolve().parents[2]
ACTIONS = [
    ROOT / "vega_msgs" / "action" / f"{name}.action" for name in ("PlanLayers", "ExecutePrint")
]


def classes(base: type = errors.VegaError) -> set[type]:
    return {base}.union(*(classes(kind) for kind in base.__subclasses__()))


def constant(kind: type) -> str:
    if kind is errors.VegaError:
        return "UNKNOWN"
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).upper()


def declared() -> dict[str, int]:
    found = {}
    for path in ACTIONS:
        for name, value, comment in re.findall(
            r"^uint16 (\w+)=(\d+)(.*)$", path.read_text(), re.M
        ):
            assert name == "NONE" or re.match(r"\s+# \w", comment), (
                f"{path.name}: {name} says nothing"
            )
            assert found.setdefault(name, int(value)) == int(value)
    return found


def test_every_error_has_its_own_code():
    codes = [kind.code for kind in classes()]
    assert len(set(codes)) == len(codes)


def test_every_error_is_a_constant_of_an_action_with_its_code():
    constants = declared()
    for kind in classes():
        assert constants[constant(kind)] == kind.code


def test_every_constant_is_an_error():
    assert set(declared()) == {"NONE", *(constant(kind) for kind in classes())}


def test_every_error_is_documented():
    text = (ROOT / "docs" / "ros.md").read_text()
    for kind in classes():
        assert re.search(rf"\|\s*{kind.code}\s*\|\s*`{constant(kind)}`", text), constant(kind)


def test_codes_lead_back_to_their_classes():
    for kind in classes():
        assert errors.error_class(kind.code) is kind
