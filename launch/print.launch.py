# SPDX-License-Identifier: Apache-2.0
"""Brings up planner, driver, robot_state_publisher and RViz, and prints `mesh` where given.

ros2 launch vega print.launch.py mesh:=part.stl brr:=down hardware:=simulated rviz:=true
"""

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

ARGUMENTS = {
    "mesh": ("", "Mesh to print (path or file URI); empty only brings the nodes up."),
    "brr": ("", "Restraint region: SPECs separated by semicolons; empty: as in the settings."),
    "hardware": ("simulated", "simulated, emulated or ethercat."),
    "robot": ("", "Name of a robot in config/robots, or path of a URDF or xacro file."),
    "rviz": ("false", "Start RViz with the package's own view."),
    "settings": ("", "Settings YAML file."),
    "output": ("", "Result folder; default out/NAME below the current folder."),
    "print": ("true", "Print after planning."),
    "realtime": ("false", "Run a simulation at the pace of the clock."),
    "machine": ("", "YAML file of the bus, for hardware on a bus."),
}


def generate_launch_description() -> LaunchDescription:
    """Describe what is launched."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list:
    """Start what the arguments ask for and the machine has."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    robot = given["robot"] or "vega5"
    driver = LifecycleNode(
        package="vega",
        executable="robot_driver",
        name="robot_driver",
        namespace="",
        output="screen",
        parameters=[
            {
                "hardware": given["hardware"],
                "robot": robot,
                "realtime": _truth(given["realtime"]),
                "machine": given["machine"],
            }
        ],
    )
    planner = Node(
        package="vega",
        executable="planner",
        name="planner",
        output="screen",
        parameters=[{"cell.robot": robot}],
    )
    actions = [planner, driver, *_brought_up(driver)]
    actions += _state_publisher(robot)
    if _truth(given["rviz"]):
        actions += _rviz()
    if given["mesh"]:
        job = {name: given[name] for name in ("mesh", "brr", "settings", "output")}
        job |= {"robot": given["robot"], "print": _truth(given["print"])}
        actions.append(
            Node(
                package="vega",
                executable="print_job",
                name="print_job",
                output="screen",
                parameters=[job],
            )
        )
    return actions


def _brought_up(driver: LifecycleNode) -> list:
    """Configure the driver when it has started, and activate it when it is configured."""

    def change(transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(
                lifecycle_node_matcher=matches_action(driver), transition_id=transition
            )
        )

    return [
        RegisterEventHandler(
            OnStateTransition(
                target_lifecycle_node=driver,
                start_state="configuring",
                goal_state="inactive",
                entities=[change(Transition.TRANSITION_ACTIVATE)],
            )
        ),
        change(Transition.TRANSITION_CONFIGURE),
    ]


def _state_publisher(robot: str) -> list:
    """Start robot_state_publisher and tie its root to frame `base`."""
    from vega_planner.robot.robot import load_robot

    if not _installed("robot_state_publisher"):
        return [
            LogInfo(
                msg="robot_state_publisher is not installed: no link frames; the driver "
                "publishes robot_description and joint_states itself"
            )
        ]
    urdf = load_robot(robot).urdf
    actions = [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            output="screen",
            parameters=[{"robot_description": urdf}],
        )
    ]
    if _installed("tf2_ros"):
        root = _root_link(urdf)
        actions.append(
            Node(
                package="tf2_ros",
                executable="static_transform_publisher",
                name="base_frame",
                arguments=["--frame-id", "base", "--child-frame-id", root],
            )
        )
    return actions


def _root_link(urdf: str) -> str:
    """Name the link that is no joint's child."""
    from xml.etree import ElementTree

    root = ElementTree.fromstring(urdf)
    children = {joint.find("child").get("link") for joint in root.findall("joint")}
    return next(
        n for n in (link.get("name") for link in root.findall("link")) if n not in children
    )


def _rviz() -> list:
    if not _installed("rviz2"):
        return [LogInfo(msg="rviz2 is not installed: going on without it; see `vega view`")]
    view = f"{get_package_share_directory('vega')}/rviz/print.rviz"
    return [Node(package="rviz2", executable="rviz2", arguments=["-d", view], output="log")]


def _installed(package: str) -> bool:
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True


def _truth(text: str) -> bool:
    words = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
    if text.lower() not in words:
        raise RuntimeError(f"launch argument is '{text}'; choices: true, false")
    return words[text.lower()]
