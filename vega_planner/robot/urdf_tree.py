# SPDX-License-Identifier: Apache-2.0
"""Checks of a URDF's links and joints, so that a mistake is told in one line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from xml.etree import ElementTree

from vega_planner.errors import BadRobot

_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def check_tree(root: ElementTree.Element, source: str) -> None:
    """Check that the links and joints of a URDF form one tree.

    Args:
        root: The `robot` element.
        source: Where it came from, for the error text.

    Raises:
        BadRobot: Naming the first link or joint that is wrong.
    """

    def refuse(text: str) -> BadRobot:
        return BadRobot(f"URDF {source}: {text}")

    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    for kind, names in (("link", links), ("joint", [j.get("name", "") for j in joints])):
        name, count = Counter(names).most_common(1)[0] if names else ("", 0)
        if count > 1 or "" in names:
            raise refuse(f"{kind} '{name}' occurs {count} times" if name else f"unnamed {kind}")
    if not links:
        raise refuse("there is no link")
    children: list[str] = []
    for joint in joints:
        name = joint.get("name", "")
        ends = [end.get("link", "") for end in joint.findall("parent") + joint.findall("child")]
        if len(ends) != 2:
            raise refuse(f"joint '{name}' needs one parent and one child")
        unknown = [end for end in ends if end not in links]
        if unknown:
            raise refuse(f"joint '{name}' names link '{unknown[0]}', which does not exist")
        if joint.get("type") not in _KINDS:
            raise refuse(
                f"joint '{name}' is of type '{joint.get('type')}'; choices: {', '.join(_KINDS)}"
            )
        _check_limit(joint, refuse)
        children.append(ends[1])
    twice = [name for name, count in Counter(children).items() if count > 1]
    if twice:
        raise refuse(f"link '{twice[0]}' hangs on more than one joint")
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise refuse(f"{len(roots)} links hang on no joint ({', '.join(roots)}); expected 1")


def _check_limit(joint: ElementTree.Element, refuse: Callable[[str], BadRobot]) -> None:
    kind, name = joint.get("type"), joint.get("name", "")
    limit = joint.find("limit")
    if limit is None:
        if kind in ("revolute", "prismatic"):
            raise refuse(f"joint '{name}' has no limit")
        return
    for key in ("lower", "upper", "velocity", "effort"):
        value = limit.get(key, "0")
        try:
            float(value)
        except ValueError as error:
            text = f"joint '{name}': {key} is '{value}'; expected a number"
            raise refuse(text) from error
