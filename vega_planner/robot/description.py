# SPDX-License-Identifier: Apache-2.0
"""Finding and completing the description of a robot: URDF, plate, nozzle and limits.

A robot is named by a file of config/robots, by such a YAML file elsewhere, or by a URDF
or xacro file. Beside a URDF a YAML file of the same stem may say what the URDF does not:

    plate:  {parent: base_link, xyz: [0.5, 0, 0.1], rpy: [0, 0, 0]}   top of the build plate,
            with size: [0.18, 0.18, 0.012] where the links are to be held against it
    nozzle: {parent: tool0, xyz: [0, 0, 0.1], rpy: [3.14159, 0, 0]}   tip, z back along it
    joints: {NAME: {velocity: 1.0, acceleration: 5.0, lower: -1.0, upper: 1.0}}

Metres and radians throughout.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from vega_planner.errors import BadRobot, InvalidInput
from vega_planner.robot.urdf_tree import check_tree
from vega_planner.robot.yaml_file import numbers, read_mapping
from vega_planner.shared_files import choices, named_file, shared_file

_KEYS = (
    "name",
    "urdf",
    "package",
    "plate",
    "nozzle",
    "plate_frame",
    "tip_frame",
    "joints",
    "geometry",
)


@dataclass(frozen=True)
class Description:
    """A robot's URDF, complete with plate and tip, and what else is known of its joints.

    Attributes:
        name: Name of the robot.
        urdf: URDF text in which both frames exist; mesh files have absolute paths.
        plate_frame: Link on the top of the build plate, z up.
        tip_frame: Link at the nozzle's tip, z back along the nozzle.
        joints: Limits that replace or extend the URDF's, by joint name.
        source: File the URDF came from.
    """

    name: str
    urdf: str
    plate_frame: str
    tip_frame: str
    joints: dict[str, dict[str, Any]] = field(default_factory=dict)
    source: str = ""


def load_description(spec: str) -> Description:
    """Find a robot by name or path and complete its URDF.

    Raises:
        InvalidInput: If there is no such robot.
        BadRobot: If a file is wrong, or plate or tip are not described.
    """
    path = Path(spec).expanduser()
    if not path.is_file() or path.suffix in (".yaml", ".yml"):
        config_path = named_file("robot", spec, "config", "robots")
        config = read_mapping(config_path, "robot", _KEYS)
        return _completed(_urdf_path(config, config_path), config)
    sidecar = path.with_suffix(".yaml")
    if sidecar.is_file():
        return _completed(path, read_mapping(sidecar, "robot", _KEYS))
    return _completed(path, {})


def _urdf_path(config: dict[str, Any], config_path: Path) -> Path:
    urdf = config.get("urdf")
    if not isinstance(urdf, str):
        raise BadRobot(f"robot file {config_path}: 'urdf' is {urdf!r}; expected a path")
    package = config.get("package")
    if package is None:
        beside = config_path.parent / urdf
        path = beside if beside.is_file() else shared_file("urdf", urdf)
    else:
        path = _package_folder(str(package)) / urdf
    if not path.is_file():
        raise BadRobot(f"robot file {config_path}: there is no URDF at {path}")
    return path


def _package_folder(package: str) -> Path:
    """Folder of an installed Python package, found without importing it."""
    from importlib.util import find_spec

    found = find_spec(package)
    if found is None or not found.submodule_search_locations:
        raise BadRobot(
            f"the robot's description is in the Python package '{package}', which is not "
            f"installed; pip install {package.replace('_', '-')}"
        )
    return Path(next(iter(found.submodule_search_locations)))


def expand_xacro(path: Path) -> str:
    """Expand a xacro file into URDF text.

    Raises:
        BadRobot: If xacro is missing or refuses the file.
    """
    try:
        import xacro
    except ImportError as error:
        raise BadRobot(f"{path} needs the Python package xacro, which is not installed") from error
    try:
        root = xacro.process_file(str(path)).documentElement
        return '<?xml version="1.0"?>\n' + root.toprettyxml(indent="  ")
    except Exception as error:  # xacro raises many kinds of its own, of the parser and of eval
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise BadRobot(f"xacro file {path} cannot be expanded: {reason}") from error


def _completed(path: Path, config: dict[str, Any]) -> Description:
    root = _parsed(path)
    _make_meshes_absolute(root, path.parent)
    robot_name = root.get("name", path.stem)
    if not config and not {"tip", "build_plate"} <= _link_names(root):
        config = _config_of_same_robot(robot_name) or {}
    plate = _frame(root, path, config, "plate", "plate_frame", "build_plate")
    tip = _frame(root, path, config, "nozzle", "tip_frame", "tip")
    joints = config.get("joints") or {}
    if not isinstance(joints, dict) or not all(isinstance(v, dict) for v in joints.values()):
        raise BadRobot(f"robot '{robot_name}': 'joints' must map joint names to their limits")
    return Description(
        name=str(config.get("name", robot_name)),
        urdf=ElementTree.tostring(root, encoding="unicode"),
        plate_frame=plate,
        tip_frame=tip,
        joints=joints,
        source=str(path),
    )


def _parsed(path: Path) -> ElementTree.Element:
    """Parse a URDF; prefixes of extensions (`drake:`) become part of the name."""
    if path.suffix == ".xacro":
        text = expand_xacro(path)
    else:
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise BadRobot(f"URDF file {path} cannot be read: {error}") from error
    text = re.sub(r"(</?)(?!xmlns)(\w+):(?=\w)", r"\1\2_", text)
    text = re.sub(r"(\s)(?!xmlns)([A-Za-z_]\w*):(\w+\s*=)", r"\1\2_\3", text)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise BadRobot(f"URDF file {path} is not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise BadRobot(f"URDF file {path} begins with <{root.tag}>; expected <robot>")
    check_tree(root, str(path))
    return root


def _link_names(root: ElementTree.Element) -> set[str]:
    return {link.get("name", "") for link in root.iter("link")}


def _make_meshes_absolute(root: ElementTree.Element, folder: Path) -> None:
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if name and "://" not in name:
            mesh.set("filename", (folder.absolute() / name).as_uri())


def _config_of_same_robot(robot_name: str) -> dict[str, Any] | None:
    """The shipped configuration of a robot, for a bare copy of its URDF."""
    if robot_name not in choices("config", "robots"):
        return None
    return read_mapping(shared_file("config", "robots", f"{robot_name}.yaml"), "robot", _KEYS)


def _frame(
    root: ElementTree.Element,
    path: Path,
    config: dict[str, Any],
    mount_key: str,
    name_key: str,
    default: str,
) -> str:
    """Name the link of a frame, and add it where the configuration says how it is mounted."""
    links = _link_names(root)
    mount = config.get(mount_key)
    name = str(config.get(name_key, default))
    if mount is None:
        if name in links:
            return name
        raise BadRobot(
            f"{path} has no link '{name}'; name it there, or describe '{mount_key}' (parent, "
            f"xyz, rpy) in {path.with_suffix('.yaml').name} beside it"
        )
    where = f"'{mount_key}' of {path.name}"
    if not isinstance(mount, dict):
        raise BadRobot(f"{where} is {mount!r}; expected parent, xyz and rpy")
    parent = str(mount.get("parent", ""))
    if parent not in links:
        raise BadRobot(f"{where}: no link '{parent}'; has: {', '.join(sorted(links))}")
    if name in links:
        raise BadRobot(f"{where}: link '{name}' exists already; name the new one by '{name_key}'")
    origin = {
        key: " ".join(f"{value!r}" for value in numbers(mount, key, where, 3))
        for key in ("xyz", "rpy")
    }
    link = ElementTree.SubElement(root, "link", {"name": name})
    if "size" in mount:
        _draw_below(link, numbers(mount, "size", where, 3))
    mount_name = f"{name}_mount"
    while any(joint.get("name") == mount_name for joint in root.iter("joint")):
        mount_name += "_"
    joint = ElementTree.SubElement(root, "joint", {"name": mount_name, "type": "fixed"})
    ElementTree.SubElement(joint, "parent", {"link": parent})
    ElementTree.SubElement(joint, "child", {"link": name})
    ElementTree.SubElement(joint, "origin", origin)
    return name


def _draw_below(link: ElementTree.Element, size: list[float]) -> None:
    """Draw a box of a size [m] whose top is the link's frame."""
    for kind in ("visual", "collision"):
        element = ElementTree.SubElement(link, kind)
        ElementTree.SubElement(element, "origin", {"xyz": f"0 0 {-0.5 * size[2]!r}"})
        geometry = ElementTree.SubElement(element, "geometry")
        ElementTree.SubElement(geometry, "box", {"size": " ".join(f"{x!r}" for x in size)})


def acceleration_extensions(urdf: str) -> dict[str, float]:
    """Accelerations that some URDFs give as an extension of `limit`, by joint name."""
    found: dict[str, float] = {}
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        limit = joint.find("limit")
        for key, value in (limit.attrib if limit is not None else {}).items():
            if key.endswith("acceleration"):
                try:
                    found[joint.get("name", "")] = float(value)
                except ValueError as error:
                    raise InvalidInput(
                        f"joint '{joint.get('name')}': {key} is '{value}'; expected a number"
                    ) from error
    return found


if __name__ == "__main__":  # make urdf
    expanded = expand_xacro(shared_file("urdf", "vega5.urdf.xacro"))
    shared_file("urdf", "vega5.urdf").write_text(expanded, encoding="utf-8")
