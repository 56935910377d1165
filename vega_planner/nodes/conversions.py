# SPDX-License-Identifier: Apache-2.0
"""Messages to the planner's values and back. Messages are SI, geometry is millimetres."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
import yaml
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion
from numpy.typing import NDArray
from shape_msgs.msg import Mesh, MeshTriangle
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from vega_msgs.action import PlanLayers
from vega_msgs.msg import JointPath, Layers, Toolpaths
from vega_planner.datatypes import Floats, Ints, Layer, PrintTrajectory, Toolpath
from vega_planner.errors import InvalidInput, VegaError
from vega_planner.nodes.worker import PlanOutcome, PlanRequest, mesh_path
from vega_planner.settings import Settings
from vega_planner.units import m_to_mm, mm_to_m

_CODES = {"d": "<f8", "i": "<i4", "I": "<u4"}


def flat(code: str, values: Any) -> array:
    """Lay values out as the array of a message field, without touching each one.

    Args:
        code: Type code of `array.array`: "d", "i" or "I".
        values: Numbers of any shape.
    """
    result = array(code)
    result.frombytes(np.ascontiguousarray(values, _CODES[code]).tobytes())
    return result


def joined(pieces: list[NDArray], width: int) -> NDArray:
    """Stack arrays of `width` columns, also none at all."""
    return np.concatenate(pieces) if pieces else np.zeros((0, width))


def offsets_of(counts: list[int]) -> NDArray[np.int64]:
    """Where each of some pieces begins when they are laid end to end, and where all end."""
    return np.concatenate([[0], np.cumsum(np.array(counts, np.int64))]).astype(np.int64)


# -- requests ---------------------------------------------------------------------------


def request_from_msg(goal: PlanLayers.Goal, base: Settings) -> PlanRequest:
    """Read a planning goal.

    Args:
        goal: The goal.
        base: The node's own settings, which the goal's replace.

    Raises:
        InvalidInput: If a setting or the mesh's address is wrong.
    """
    settings = base
    if goal.settings.strip():
        try:
            changes = yaml.safe_load(goal.settings) or {}
        except yaml.YAMLError as error:
            reason = " ".join(str(error).split())
            raise InvalidInput(f"the goal's settings are no YAML: {reason}") from error
        settings = settings.updated(changes)
    for item in goal.options:
        settings = settings.updated(_nested(item.key, item.value))
    if goal.brr:
        settings = settings.updated({"part": {"brr": list(goal.brr)}})
    vertices = faces = None
    if not goal.mesh:
        vertices, faces = mesh_from_msg(goal.inline_mesh)
    return PlanRequest(
        mesh=mesh_path(goal.mesh),
        vertices=vertices,
        faces=faces,
        restrained_faces=tuple(goal.brr_faces),
        settings=settings,
        folder=goal.output_folder,
    )


def _nested(key: str, text: str) -> dict[str, Any]:
    """Turn 'layers.thickness_mm', '0.6' into {'layers': {'thickness_mm': 0.6}}."""
    try:
        value: Any = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InvalidInput(f"setting '{key}' is {text!r}; expected a YAML value") from error
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


def mesh_from_msg(mesh: Mesh) -> tuple[Floats, Ints]:
    """Read an inline mesh: points [mm], shape (n, 3), and faces, shape (m, 3)."""
    points = np.array([(p.x, p.y, p.z) for p in mesh.vertices], np.float64).reshape(-1, 3)
    faces = np.array([t.vertex_indices for t in mesh.triangles], np.int64).reshape(-1, 3)
    return m_to_mm(points), faces


def mesh_to_msg(vertices: Floats, faces: Ints) -> Mesh:
    """Write a mesh of points [mm] as a message."""
    mesh = Mesh()
    mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in mm_to_m(vertices).tolist()]
    mesh.triangles = [
        MeshTriangle(vertex_indices=np.array(face, np.uint32)) for face in faces.tolist()
    ]
    return mesh


# -- results ----------------------------------------------------------------------------


def result_to_msg(outcome: PlanOutcome, goal: PlanLayers.Goal) -> PlanLayers.Result:
    """Write a plan as a result, with as much of it as the goal asks for."""
    trajectory = outcome.trajectory
    result = PlanLayers.Result(
        status=outcome.status,
        folder=outcome.folder,
        summary=outcome.summary,
        certificate=outcome.certificate,
        layer_count=len(outcome.sheets),
        path_count=len(outcome.toolpaths.passes),
        duration=trajectory.duration_s,
    )
    if goal.include_geometry:
        result.layers = layers_to_msg(outcome.sheets)
        result.toolpaths = toolpaths_to_msg(outcome.toolpaths.passes)
    if goal.include_trajectory:
        path_layer = [path.layer for path in outcome.toolpaths.passes]
        result.trajectory = trajectory_to_msg(trajectory, path_layer)
    if goal.include_joint_trajectory:
        result.joint_trajectory = joint_trajectory_to_msg(trajectory)
    return result


def error_to_msg(error: VegaError) -> PlanLayers.Result:
    """Write an error as a result."""
    stage = f"{error.stage}: " if error.stage else ""
    return PlanLayers.Result(error_code=error.code, error_msg=f"{stage}{error}")


def layers_to_msg(sheets: tuple[Layer, ...]) -> Layers:
    """Write layers as flat arrays."""
    return Layers(
        kinds=[sheet.kind for sheet in sheets],
        depths=flat("d", [mm_to_m(sheet.depth_mm) for sheet in sheets]),
        vertex_offsets=flat("I", offsets_of([len(sheet.vertices) for sheet in sheets])),
        face_offsets=flat("I", offsets_of([len(sheet.faces) for sheet in sheets])),
        vertices=flat("d", mm_to_m(joined([sheet.vertices for sheet in sheets], 3))),
        faces=flat("i", joined([sheet.faces for sheet in sheets], 3)),
        thickness=flat("d", mm_to_m(joined([s.thickness[:, None] for s in sheets], 1))),
    )


def layers_from_msg(msg: Layers) -> tuple[Layer, ...]:
    """Read layers from flat arrays."""
    vertices = m_to_mm(np.array(msg.vertices).reshape(-1, 3))
    faces = np.array(msg.faces, np.int64).reshape(-1, 3)
    thickness = m_to_mm(np.array(msg.thickness))
    sheets = []
    for index, kind in enumerate(msg.kinds):
        points = slice(msg.vertex_offsets[index], msg.vertex_offsets[index + 1])
        triangles = slice(msg.face_offsets[index], msg.face_offsets[index + 1])
        depth = m_to_mm(float(msg.depths[index]))
        sheets.append(
            Layer(index, kind, depth, vertices[points], faces[triangles], thickness[points])
        )
    return tuple(sheets)


def toolpaths_to_msg(passes: tuple[Toolpath, ...]) -> Toolpaths:
    """Write passes as flat arrays."""
    return Toolpaths(
        point_offsets=flat("I", offsets_of([len(path.points) for path in passes])),
        points=flat("d", mm_to_m(joined([path.points for path in passes], 3))),
        axes=flat("d", joined([path.axes for path in passes], 3)),
        width=flat("d", mm_to_m(joined([path.width[:, None] for path in passes], 1))),
        height=flat("d", mm_to_m(joined([path.height[:, None] for path in passes], 1))),
        layer=flat("i", [path.layer for path in passes]),
        patch=flat("i", [path.patch for path in passes]),
        closed=[path.closed for path in passes],
    )


def toolpaths_from_msg(msg: Toolpaths) -> tuple[Toolpath, ...]:
    """Read passes from flat arrays."""
    points = m_to_mm(np.array(msg.points).reshape(-1, 3))
    axes = np.array(msg.axes).reshape(-1, 3)
    width, height = m_to_mm(np.array(msg.width)), m_to_mm(np.array(msg.height))
    passes = []
    for index, closed in enumerate(msg.closed):
        rows = slice(msg.point_offsets[index], msg.point_offsets[index + 1])
        passes.append(
            Toolpath(
                points[rows],
                axes[rows],
                width[rows],
                height[rows],
                patch=msg.patch[index],
                layer=msg.layer[index],
                closed=closed,
            )
        )
    return tuple(passes)


def trajectory_to_msg(trajectory: PrintTrajectory, path_layer: list[int]) -> JointPath:
    """Write joint motion as flat arrays."""
    return JointPath(
        joint_names=list(trajectory.joint_names),
        times=flat("d", trajectory.times),
        positions=flat("d", trajectory.positions),
        velocities=flat("d", trajectory.velocities),
        extrude=trajectory.extrude.tolist(),
        path_id=flat("i", trajectory.path_id),
        path_layer=flat("i", path_layer),
        base_part=pose_to_msg(trajectory.T_base_part),
    )


def trajectory_from_msg(msg: JointPath) -> PrintTrajectory:
    """Read joint motion from flat arrays."""
    joints, count = len(msg.joint_names), len(msg.times)
    return PrintTrajectory(
        joint_names=tuple(msg.joint_names),
        times=np.array(msg.times),
        positions=np.array(msg.positions).reshape(count, joints),
        velocities=np.array(msg.velocities).reshape(count, joints),
        extrude=np.array(msg.extrude, np.bool_),
        path_id=np.array(msg.path_id, np.int64),
        T_base_part=pose_from_msg(msg.base_part),
    )


def joint_trajectory_to_msg(trajectory: PrintTrajectory) -> JointTrajectory:
    """Write joint motion the way other drivers read it; slow, for a point is an object."""
    msg = JointTrajectory(joint_names=list(trajectory.joint_names))
    msg.header.frame_id = "base"
    whole = np.floor(trajectory.times).astype(np.int64)
    nanos = np.minimum(np.rint((trajectory.times - whole) * 1e9), 999_999_999).astype(np.int64)
    rows = zip(trajectory.positions, trajectory.velocities, whole.tolist(), nanos.tolist())
    msg.points = [
        JointTrajectoryPoint(
            positions=flat("d", q),
            velocities=flat("d", v),
            time_from_start=Duration(sec=second, nanosec=nano),
        )
        for q, v, second, nano in rows
    ]
    return msg


def pose_to_msg(T: Floats) -> Pose:
    """Write a pose matrix [m], shape (4, 4), as position and quaternion (xyzw)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    place = T[:3, 3].tolist()
    return Pose(
        position=Point(x=place[0], y=place[1], z=place[2]),
        orientation=Quaternion(x=x, y=y, z=z, w=w),
    )


def pose_from_msg(msg: Pose) -> Floats:
    """Read a pose as a matrix [m], shape (4, 4)."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    turn = msg.orientation
    T[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    T[:3, 3] = msg.position.x, msg.position.y, msg.position.z
    return T
