# SPDX-License-Identifier: Apache-2.0
"""The robot's moving links, held against plate, substrate and what is printed by then.

Every collision element of the URDF that moves is covered with balls. Against the plate
their centres count, which hold all corners and rims, so that the answer is exact for the
plate's top; against substrate and print the balls themselves do, so that nothing is missed
and a link keeps a few millimetres. The nozzle and the dispenser body are left to the check
of every waypoint, which is exact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, ToolpathSet
from vega_planner.errors import BadRobot
from vega_planner.parallel import cores, map_threads
from vega_planner.part.morton import morton_order
from vega_planner.printability import grid_kernels
from vega_planner.printability import link_kernels as kernels
from vega_planner.printability.link_kernels import COARSE, NEVER, PLATE, PRINT, SUBSTRATE
from vega_planner.robot.link_points import balls_on
from vega_planner.units import m_to_mm

if TYPE_CHECKING:
    from vega_planner.robot.robot import Robot
    from vega_planner.robot.tool import Tool
    from vega_planner.robot.workcell import Workcell

#: What lies within the tool's profile, made larger by this, is the tool [mm].
TOOL_MM = 4.0

#: Less deep in the plate than this is no touch: links are drawn roughly [mm].
TOUCH_MM = 0.5

#: Distance links keep where poses are tried: between two poses the arm strays a little [mm].
MARGIN_MM = 2.0

#: Finest voxels what is there is held in [mm], and about the most of them.
VOXEL_MM, VOXELS = 1.0, 400_000

#: Configurations of fewer than this are not worth a second thread.
_FEW = 512

#: Names of the obstacles by their bits.
OBSTACLES = {PLATE: "plate", SUBSTRATE: "substrate", PRINT: "printed_part"}


@dataclass(frozen=True, eq=False)
class LinkTrees:
    """The links that move, covered with balls in trees.

    Attributes:
        names: Names of the links.
        trees: What `link_kernels.touching` takes of them.
        plate: Corners of the build plate in its own frame [mm], where the URDF draws one.
        unread: Why links are covered in part or not at all, a line each.
        widest: Radius of the largest ball [mm].
    """

    names: tuple[str, ...]
    trees: tuple[Any, ...]
    plate: tuple[Floats, Floats] | None
    unread: tuple[str, ...]
    widest: float

    @classmethod
    def of(cls, robot: Robot, tool: Tool) -> LinkTrees:
        """Read the links of a robot, but for its tool."""
        unread: list[str] = []
        plate = None
        found = []
        urdf = ElementTree.fromstring(robot.urdf)
        carriers = _carriers(robot)
        for link in urdf.findall("link"):
            name = link.get("name", "")
            if name == "build_plate":
                points = m_to_mm(_covered(link, unread)[:, :3])
                plate = (points.min(0), points.max(0)) if len(points) else None
            if name not in carriers:
                continue
            joint, T = carriers[name]
            balls = m_to_mm(_covered(link, unread))
            balls[:, :3] = balls[:, :3] @ T[:3, :3].T + np.asarray(m_to_mm(T[:3, 3]))
            if joint == len(robot.joint_names) - 1:
                balls = balls[_off_tool(balls, robot, tool)]
            if len(balls):
                found.append((joint, name, balls[morton_order(balls[:, :3])]))
        found.sort(key=lambda item: item[0])
        return cls(
            names=tuple(name for _, name, _ in found),
            trees=_grown([balls for _, _, balls in found], [joint for joint, _, _ in found]),
            plate=plate,
            unread=tuple(unread),
            widest=max((float(balls[:, 3].max()) for _, _, balls in found), default=0.0),
        )


class LinkWatch:
    """Holds the links of a robot against what is there at any moment of a print.

    Args:
        toolpaths: Passes in print order.
        cell: Robot, tool, placement and substrate.
        margin_mm: Distance that links have to keep.
    """

    def __init__(self, toolpaths: ToolpathSet, cell: Workcell, margin_mm: float = 0.0) -> None:
        self.links: LinkTrees = link_trees(cell.robot, cell.tool)
        self._chain = cell.robot.chain.arrays
        T = np.array(np.linalg.inv(cell.placement.T_base_part), np.float64)
        T[:3, 3] = m_to_mm(T[:3, 3])
        self._T_part_base = np.ascontiguousarray(T[:3])
        self._what = (toolpaths, cell, self.links, margin_mm)

    def touching(self, q: Floats, now: Ints) -> Ints:
        """Tell what the links touch.

        Args:
            q: Joint positions [m, rad], shape (n, j).
            now: Passes of smaller number are there, shape (n,).

        Returns:
            Bits of `link_kernels` by configuration and link, shape (n, l).
        """
        return self._held(q, now, self._scene)

    def avoids(self, q: Floats) -> Bools:
        """Tell which configurations keep all links off plate, substrate and whole print.

        What is printed at any time counts, which is quick to tell and leaves room.

        Args:
            q: Joint positions [m, rad], shape (n, j).

        Returns:
            True where nothing is touched, shape (n,).
        """
        if not len(q):
            return np.zeros(0, np.bool_)
        return np.asarray(~self._held(q, np.zeros(len(q), np.int64), self._ever).any(1))

    @cached_property
    def _scene(self) -> tuple[Any, ...]:
        return _scene(*self._what)

    @cached_property
    def _ever(self) -> tuple[Any, ...]:
        """The scene with all passes, as distances."""
        laid, spacing = self._scene[4], self._scene[6]
        gap = np.empty(laid.shape, np.float32)
        grid_kernels.distance_to(laid < NEVER, spacing, gap)
        return (*self._scene[:-1], gap)

    def _held(self, q: Floats, now: Ints, scene: tuple[Any, ...]) -> Ints:
        found: Ints = np.zeros((len(q), len(self.links.names)), np.int64)
        if not found.size:
            return found
        q = np.ascontiguousarray(q, np.float64)
        now = np.ascontiguousarray(now, np.int64)

        def hold(rows: slice) -> None:
            kernels.touching(
                self._chain, q[rows], now[rows], self.links.trees, self._T_part_base, scene,
                found[rows], np.zeros((3, 3)),
            )  # fmt: skip

        pieces = 1 if len(q) < _FEW else 4 * cores()
        cuts = np.linspace(0, len(q), pieces + 1).astype(np.int64)
        map_threads(hold, [slice(int(a), int(b)) for a, b in itertools.pairwise(cuts)])
        return found

    def place(self, q: Floats, now: int, link: int, bit: int) -> Floats:
        """Find where a link touches something in one configuration [mm], part frame."""
        begins = self.links.trees[4]
        only = (*self.links.trees[:4], begins[link : link + 2], self.links.trees[5][link:][:1])
        where = np.zeros((3, 3))
        found = np.zeros((1, 1), np.int64)
        kernels.touching(
            self._chain, np.ascontiguousarray(q[None]), np.array([now]), only,
            self._T_part_base, self._scene, found, where,
        )  # fmt: skip
        return where[{PLATE: 0, SUBSTRATE: 1, PRINT: 2}[bit]]


class LinkPoses:
    """Tells which tool poses make a link touch something, whatever configuration is taken.

    Args:
        toolpaths: Passes in print order.
        cell: A robot with a closed form, tool, placement and substrate.
    """

    def __init__(self, toolpaths: ToolpathSet, cell: Workcell) -> None:
        self._cell = cell
        self._watch = LinkWatch(toolpaths, cell, MARGIN_MM)

    def touch(self, tips: Floats, axes: Floats, now: Ints) -> Bools:
        """Hold the links at tool poses.

        Args:
            tips: Tips [mm], part frame, shape (n, 3).
            axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
            now: Passes of smaller number are there, shape (n,).

        Returns:
            True where every configuration that reaches the pose touches something, (n,).
        """
        found = self._cell.robot.solve(*self._cell.to_base(tips, axes))
        touched = np.ones(len(tips), np.bool_)
        for k in range(found.valid.shape[1]):
            at = np.flatnonzero(found.valid[:, k] & touched)
            touched[at] = self._watch.touching(found.candidates[at, k], now[at]).any(1)
        return touched & found.valid.any(1)


_LAST: list[tuple[Robot, Tool, LinkTrees]] = []


def link_trees(robot: Robot, tool: Tool) -> LinkTrees:
    """Cover the links of a robot; the last answer is kept, for a plan asks more than once."""
    for known, other, trees in _LAST:
        if known is robot and other is tool:
            return trees
    found = LinkTrees.of(robot, tool)
    _LAST[:] = [(robot, tool, found)]
    return found


def _carriers(robot: Robot) -> dict[str, tuple[int, Floats]]:
    """The joint of the chain that carries each moving link, and its pose behind that joint.

    Joints off the chain stay where their zero is.
    """
    import pinocchio

    model: Any = pinocchio.buildModelFromXML(robot.urdf)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pinocchio.neutral(model))
    number = {model.getJointId(name): k for k, name in enumerate(robot.joint_names)}
    found = {}
    for frame, pose in zip(model.frames, data.oMf):
        on_chain = [j for j in model.supports[frame.parentJoint] if j in number]
        if frame.type == pinocchio.FrameType.BODY and on_chain:
            behind = data.oMi[on_chain[-1]].inverse() * pose
            found[frame.name] = (number[on_chain[-1]], np.array(behind.homogeneous))
    return found


def _covered(link: ElementTree.Element, unread: list[str]) -> Floats:
    """Cover a link with balls [m], shape (n, 4); none, and a line, where it cannot be read."""
    try:
        parts = [balls_on(element) for element in link.findall("collision")]
    except (BadRobot, ValueError) as error:
        unread.append(f"link '{link.get('name')}' is not checked: {error}")
        parts = []
    return np.concatenate([np.zeros((0, 4)), *parts])


def _off_tool(balls: Floats, robot: Robot, tool: Tool) -> Bools:
    """Mark the balls of the last link [mm] that are not the tool itself."""
    away = balls[:, :3] - m_to_mm(robot.chain.tip)
    axis = robot.chain.tip_axes[0]
    s = away @ axis
    r = np.linalg.norm(away - s[:, None] * axis, axis=1)
    return np.asarray(r > np.interp(s, tool.distance, tool.radius) + TOOL_MM)


def _grown(links: list[Floats], carriers: list[int]) -> tuple[Any, ...]:
    """Build the trees of all links, numbered through."""
    nodes, spans, skips, begins = [np.zeros((0, 4))], [np.zeros((0, 2), np.int64)], [], [0]
    first = 0
    for balls in links:
        most = 2 * len(balls) + 1
        node, span, skip = np.zeros((most, 4)), np.zeros((most, 2), np.int64), np.zeros(most, int)
        count = kernels.grow(np.ascontiguousarray(balls), node, span, skip)
        nodes.append(node[:count])
        spans.append(span[:count] + first)
        skips.append(skip[:count] + begins[-1])
        begins.append(begins[-1] + count)
        first += len(balls)
    return (
        np.concatenate([np.zeros((0, 4)), *links]),
        np.concatenate(nodes),
        np.concatenate(spans),
        np.concatenate([np.zeros(0, np.int64), *skips]),
        np.array(begins),
        np.array(carriers, np.int64),
    )


def _scene(
    toolpaths: ToolpathSet, cell: Workcell, links: LinkTrees, margin_mm: float
) -> tuple[Any, ...]:
    """Put plate, substrate and passes into what `link_kernels.touching` takes."""
    T: Floats = np.linalg.inv(cell.robot.chain.T_base_plate) @ cell.placement.T_base_part
    T[:3, 3] = m_to_mm(T[:3, 3])
    far = np.full(3, 1e9)
    low, high = (far, far) if links.plate is None else links.plate
    low, high = low - margin_mm, high + margin_mm
    passes = toolpaths.passes
    reach = 0.5 * max((float(path.width.max()) for path in passes), default=1.0) + margin_mm
    solids = [path.points for path in passes]
    if cell.substrate is not None:
        solids.append(cell.substrate.vertices)
    first = np.min([s.min(0) for s in solids], axis=0) if solids else np.zeros(3)
    last = np.max([s.max(0) for s in solids], axis=0) if solids else np.zeros(3)
    spacing = max(VOXEL_MM, float(np.prod(np.maximum(last - first, 1.0)) / VOXELS) ** (1 / 3))
    pad = links.widest + reach + 2.0 * spacing
    origin = first - pad
    shape = tuple(int(n) for n in np.ceil((last - first + 2 * pad) / spacing) + 1)
    laid = np.full(shape, NEVER, np.int32)
    for number, path in enumerate(passes):
        kernels.mark_passes(path.points, number, 0.7 * spacing, origin, spacing, laid)
    if cell.substrate is not None:
        solid = np.zeros(shape, np.bool_)
        mesh = cell.substrate
        grid_kernels.fill_mesh(mesh.vertices, mesh.faces, origin, spacing, solid)
        laid[solid] = kernels.ALWAYS
    cells = np.full([-(-n // COARSE) * COARSE for n in shape], NEVER, np.int32)
    cells[: shape[0], : shape[1], : shape[2]] = laid
    split = [size for n in cells.shape for size in (n // COARSE, COARSE)]
    cells = cells.reshape(split).min((1, 3, 5))
    # half a voxel more on both sides than the kernel looks
    wide = int(np.ceil((pad + spacing) / (COARSE * spacing)))
    earliest = least_about(cells, wide)
    around = reach + spacing
    return (
        np.ascontiguousarray(T[:3]), low, high, TOUCH_MM, laid, origin, spacing, reach,
        first - around, last + around, earliest, np.zeros((0, 0, 0), np.float32),
    )  # fmt: skip


def least_about(values: Ints, reach: int) -> Ints:
    """Take the smallest value within so many places along each axis, as a box.

    Args:
        values: Any shape.
        reach: Places to both sides.

    Returns:
        The same shape.
    """
    for axis in range(values.ndim):
        before, after = np.moveaxis(values, axis, 0), values.copy()
        least = np.moveaxis(after, axis, 0)
        for step in range(1, min(reach + 1, len(before))):
            np.minimum(least[step:], before[:-step], out=least[step:])
            np.minimum(least[:-step], before[step:], out=least[:-step])
        values = after
    return values
