# SPDX-License-Identifier: Apache-2.0
"""The values that flow from stage to stage.

Each is a frozen dataclass of read-only arrays, checked once when built and trusted
afterwards. Lengths are millimetres in the part frame (z up) until the trajectory,
which is SI.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vega_planner.errors import InvalidInput

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def _is_frozen(values: ArrayLike) -> TypeGuard[NDArray[Any]]:
    if type(values) is not np.ndarray:
        return False
    flags = values.flags
    return flags.c_contiguous and flags.owndata and not flags.writeable


def frozen_array(
    name: str, values: ArrayLike, dtype: type, shape: tuple[int | None, ...]
) -> NDArray:
    """Copy values into a read-only C-ordered array, unless they are one, and check them.

    Args:
        name: What the array is called in an error text.
        values: Anything numpy can make an array of.
        dtype: Element type of the result.
        shape: Expected shape; None stands for any length.

    Returns:
        An array with `writeable` off.

    Raises:
        InvalidInput: If the shape differs or a floating-point value is not finite.
    """
    array: NDArray[Any]
    if _is_frozen(values) and values.dtype == dtype:
        array = values
    else:
        array = np.array(values, dtype=dtype, order="C")
    matches = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not matches:
        wanted = tuple("any" if n is None else n for n in shape)
        raise InvalidInput(f"{name} has shape {array.shape}; expected {wanted}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise InvalidInput(f"{name} has a value that is not finite")
    array.flags.writeable = False
    return array


def face_cross(vertices: Floats, faces: Ints) -> Floats:
    """Compute the cross product of two edges of each triangle.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        Vectors along the face normals, twice the face area long [mm²], shape (m, 3).
    """
    a, b, c = np.ascontiguousarray(vertices.T)[:, faces.T].transpose(1, 0, 2)
    (ux, uy, uz), (vx, vy, vz) = b - a, c - a
    return np.column_stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])


def row_lengths(vectors: Floats) -> Floats:
    """Measure the length of each row, several times faster than numpy's norm.

    Args:
        vectors: Rows, shape (n, k).

    Returns:
        Lengths, shape (n,).
    """
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _unit(vectors: Floats) -> Floats:
    lengths = row_lengths(vectors)
    return vectors / np.where(lengths > 0, lengths, 1.0)[:, None]


class TriangleGeometry:
    """What every triangulated value can tell about itself."""

    vertices: Floats
    faces: Ints

    @cached_property
    def _cross(self) -> Floats:
        return face_cross(self.vertices, self.faces)

    @cached_property
    def face_areas(self) -> Floats:
        """Areas of the faces [mm²], shape (m,)."""
        return 0.5 * row_lengths(self._cross)

    @cached_property
    def face_normals(self) -> Floats:
        """Unit face normals by the right-hand rule, shape (m, 3); zero where degenerate."""
        return _unit(self._cross)

    @cached_property
    def vertex_normals(self) -> Floats:
        """Unit vertex normals, the faces weighted by their area, shape (n, 3)."""
        corners = self.faces.T.ravel()
        total = [
            np.bincount(corners, np.tile(self._cross[:, x], 3), len(self.vertices))
            for x in range(3)
        ]
        return _unit(np.column_stack(total))

    @cached_property
    def area(self) -> float:
        """Total area [mm²]."""
        return float(self.face_areas.sum())

    def _freeze_mesh(self) -> None:
        vertices = frozen_array("vertices", self.vertices, np.float64, (None, 3))
        faces = frozen_array("faces", self.faces, np.int64, (None, 3))
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise InvalidInput(f"faces name vertex {faces.max()}; there are {len(vertices)}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)


@dataclass(frozen=True, eq=False)
class Part(TriangleGeometry):
    """The solid to print: watertight, normals outward, lowest point on z = 0.

    Attributes:
        name: Short name, usually the stem of the file it came from.
        vertices: Points [mm] in the part frame, shape (n, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (m, 3).
        restrained: True for the faces of the buffer restraint region (BRR), which are
            not buffered: the paper's ∂A*. Shape (m,).
        brr: The SPECs the region was chosen by; `("none",)` for full enveloping.
        warnings: What a person should know: repairs with how far the surface moved,
            guesses of the unit, the reasons of an automatic region.
        source: Path or URI the mesh came from, or empty.
    """

    name: str
    vertices: Floats
    faces: Ints
    restrained: Bools
    brr: tuple[str, ...] = ("none",)
    warnings: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        self._freeze_mesh()
        restrained = frozen_array("restrained", self.restrained, np.bool_, (len(self.faces),))
        object.__setattr__(self, "restrained", restrained)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [mm³]."""
        corners = self.vertices[self.faces]
        return float(
            np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        )

    @property
    def bounds(self) -> Floats:
        """Lowest and highest corner of the bounding box [mm], shape (2, 3)."""
        columns = self.vertices.T  # each on its own takes a tenth of the time
        return np.array([[x.min() for x in columns], [x.max() for x in columns]])


@dataclass(frozen=True, eq=False)
class Layer(TriangleGeometry):
    """A sheet of material: the middle surface of one layer of beads.

    Faces are counter-clockwise seen from the side the layer was eroded from, that is
    with normals away from the core of the part (upward for planar layers). An open
    layer's rim lies on the restraint region.

    Attributes:
        index: Position in the stack it belongs to, in generation order.
        kind: "envelope", "core" (fills what the envelopes leave) or "planar".
        depth_mm: Distance to the buffered surface; height above z = 0 where planar.
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        thickness: Local thickness of the layer at the vertices [mm], shape (n,), > 0.
        mitre: How much thicker the layer is on its sharp edges than the beads that are laid
            there, shape (n,), at least 1; None where nowhere.
    """

    index: int
    kind: str
    depth_mm: float
    vertices: Floats
    faces: Ints
    thickness: Floats
    mitre: Floats | None = None

    def __post_init__(self) -> None:
        self._freeze_mesh()
        thickness = frozen_array("thickness", self.thickness, np.float64, (len(self.vertices),))
        if len(thickness) and thickness.min() <= 0:
            raise InvalidInput(f"thickness {thickness.min():g} mm; must be above 0")
        object.__setattr__(self, "thickness", thickness)
        if self.mitre is not None:
            mitre = frozen_array("mitre", self.mitre, np.float64, (len(self.vertices),))
            object.__setattr__(self, "mitre", mitre)

    @property
    def bead_thickness(self) -> Floats:
        """Thickness with which beads are laid [mm], shape (n,)."""
        return self.thickness if self.mitre is None else self.thickness / self.mitre


@dataclass(frozen=True, eq=False)
class LayerStack:
    """All layers of a part.

    Attributes:
        part: The part they fill.
        engine: "field", "minkowski" or "planar".
        thickness_mm: Nominal layer thickness t.
        layers: Envelope layers in generation order: layer N lies at depth (N + 1/2) t,
            000 is the outermost. For "planar", from the bottom up.
        cores: Layers that fill the core the envelopes leave, with their own thickness.
        uncovered_ratio: Volume inside no layer's own thickness over the part's volume.
        overfill_ratio: Volume claimed more than once, or outside, over the part's volume.
        warnings: What a person should know.
    """

    part: Part
    engine: str
    thickness_mm: float
    layers: tuple[Layer, ...]
    cores: tuple[Layer, ...] = ()
    uncovered_ratio: float = 0.0
    overfill_ratio: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def sheets(self) -> tuple[Layer, ...]:
        """Every layer: the envelopes, then the cores."""
        return self.layers + self.cores


@dataclass(frozen=True, eq=False)
class Patch(TriangleGeometry):
    """A piece of one layer that is printed in one go, with the nozzle's direction.

    Faces are counter-clockwise seen from the side that is printed from, so that the
    normals point at the nozzle. (A bowl is printed from inside: such patches have the
    faces of their layer turned over.)

    Attributes:
        layer: Index into `LayerStack.sheets` of the layer it was cut from.
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        thickness: Local layer thickness [mm], shape (n,).
        tool_axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
    """

    layer: int
    vertices: Floats
    faces: Ints
    thickness: Floats
    tool_axes: Floats

    def __post_init__(self) -> None:
        self._freeze_mesh()
        count = len(self.vertices)
        thickness = frozen_array("thickness", self.thickness, np.float64, (count,))
        tool_axes = frozen_array("tool_axes", self.tool_axes, np.float64, (count, 3))
        if count and abs(row_lengths(tool_axes) - 1).max() > 1e-6:
            raise InvalidInput("tool_axes are not unit vectors")
        object.__setattr__(self, "thickness", thickness)
        object.__setattr__(self, "tool_axes", tool_axes)


@dataclass(frozen=True, eq=False)
class Toolpath:
    """One uninterrupted deposition (a pass), in the part frame.

    Attributes:
        points: Tip positions [mm], on the middle surface of the layer, shape (n, 3),
            n >= 2. A bead joins consecutive points.
        axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
        width: Bead width at the points [mm], shape (n,), > 0.
        height: Bead height along the axis at the points [mm], shape (n,), > 0.
        patch: Index of the patch in print order; -1 for a prime line.
        layer: Index of the patch's layer in `LayerStack.sheets`; -1 for a prime line.
        closed: True where the last point joins the first again (it is repeated).
    """

    points: Floats
    axes: Floats
    width: Floats
    height: Floats
    patch: int
    layer: int
    closed: bool = False

    def __post_init__(self) -> None:
        count = len(self.points)
        if count < 2:
            raise InvalidInput(f"a toolpath has {count} points; at least 2 are needed")
        object.__setattr__(
            self, "points", frozen_array("points", self.points, np.float64, (count, 3))
        )
        object.__setattr__(self, "axes", frozen_array("axes", self.axes, np.float64, (count, 3)))
        for name in ("width", "height"):
            values = frozen_array(name, getattr(self, name), np.float64, (count,))
            if values.min() <= 0:
                raise InvalidInput(f"{name} {values.min():g} mm; must be above 0")
            object.__setattr__(self, name, values)

    @cached_property
    def length_mm(self) -> float:
        """Length of the pass [mm]."""
        return float(row_lengths(np.diff(self.points, axis=0)).sum())


@dataclass(frozen=True, eq=False)
class Travel:
    """A move without deposition, from the end of one pass to the start of the next.

    Attributes:
        points: Tip positions [mm], shape (n, 3), n >= 2, both ends included.
        axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
    """

    points: Floats
    axes: Floats

    def __post_init__(self) -> None:
        count = len(self.points)
        object.__setattr__(
            self, "points", frozen_array("points", self.points, np.float64, (count, 3))
        )
        object.__setattr__(self, "axes", frozen_array("axes", self.axes, np.float64, (count, 3)))

    @cached_property
    def length_mm(self) -> float:
        """Length of the move [mm]."""
        return float(row_lengths(np.diff(self.points, axis=0)).sum())


@dataclass(frozen=True, eq=False)
class ToolpathSet:
    """All passes in print order with the moves between them.

    Attributes:
        passes: The depositions in print order.
        travels: travels[i] leads to passes[i]; travels[0] comes from above the part,
            and one more at the end leaves it. Length len(passes) + 1.
        warnings: What a person should know.
    """

    passes: tuple[Toolpath, ...]
    travels: tuple[Travel, ...]
    warnings: tuple[str, ...] = ()

    @property
    def path_length_mm(self) -> float:
        """Total printed length [mm]."""
        return sum(path.length_mm for path in self.passes)

    @property
    def travel_length_mm(self) -> float:
        """Total length of the moves between passes [mm], without the first and the last."""
        return sum(move.length_mm for move in self.travels[1:-1])


@dataclass(frozen=True, eq=False)
class PrintTrajectory:
    """Joint motion over time, in SI units.

    Between samples the joints follow the cubic Hermite curve of positions and
    velocities.

    Attributes:
        joint_names: As in the URDF, shape (j,).
        times: Times from the start [s], strictly rising, shape (n,).
        positions: Joint positions [m, rad], shape (n, j).
        velocities: Joint velocities [m/s, rad/s], shape (n, j).
        extrude: True where the dispenser is on during the interval that ends at the
            sample, shape (n,).
        path_id: Index of the pass the sample belongs to, -1 on travel, shape (n,).
        T_base_part: Pose of the part frame in the robot's base, metres, shape (4, 4).
        slow_ratio: Printed length on which the tip moves more than 1 % below the set
            speed, over the printed length.
        warnings: What a person should know.
        dispensing: Times at which the dispenser is switched on and off [s], shape (k, 2):
            the beads with the material's lead and lag.
    """

    joint_names: tuple[str, ...]
    times: Floats
    positions: Floats
    velocities: Floats
    extrude: Bools
    path_id: Ints
    T_base_part: Floats
    slow_ratio: float = 0.0
    warnings: tuple[str, ...] = ()
    dispensing: Floats = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        count, joints = len(self.times), len(self.joint_names)
        times = frozen_array("times", self.times, np.float64, (count,))
        if count > 1 and np.diff(times).min() <= 0:
            raise InvalidInput("times do not rise strictly")
        object.__setattr__(self, "times", times)
        for name, dtype, shape in (
            ("positions", np.float64, (count, joints)),
            ("velocities", np.float64, (count, joints)),
            ("extrude", np.bool_, (count,)),
            ("path_id", np.int64, (count,)),
            ("T_base_part", np.float64, (4, 4)),
            ("dispensing", np.float64, (None, 2)),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), dtype, shape))

    @property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.times[-1]) if len(self.times) else 0.0


@dataclass(frozen=True)
class Reason:
    """Why something cannot be printed, where, and what would help.

    Attributes:
        code: "out_of_travel", "wrist_limit", "own_layer", "printed_part", "plate",
            "substrate", "robot_body" or "no_support".
        layer: Index into `LayerStack.sheets`, or -1 where it concerns all.
        area_mm2: Area concerned.
        where_mm: A point in the middle of it, part frame.
        remedy: What would help, with numbers.
    """

    code: str
    layer: int
    area_mm2: float
    where_mm: tuple[float, float, float]
    remedy: str


@dataclass(frozen=True, eq=False)
class PrintabilityReport:
    """Outcome of the printability filters, by area over all layers.

    Attributes:
        status: "fully" (every layer as it is), "conditionally" (after splitting, or but for
            at most a hundredth) or "not".
        reachable_ratio: Area that passes f1 over the whole area.
        accessible_ratio: Area that passes f2, the paper's line test.
        collision_free_ratio: Area where the solid tool is clear of plate, substrate,
            own layer and what is printed before, at some allowed orientation.
        split_layers: Number of layers that had to be split.
        reasons: What stands against printing, largest area first.
        face_reasons: Per sheet, the code index of each face: 0 printable, else
            1 + index into `REASON_CODES`, shape (m,) int64.
        unprintable_ratio: Area that can be printed from neither side over the whole area.
    """

    status: str
    reachable_ratio: float
    accessible_ratio: float
    collision_free_ratio: float
    split_layers: int = 0
    reasons: tuple[Reason, ...] = ()
    face_reasons: tuple[Ints, ...] = field(default=(), repr=False)
    unprintable_ratio: float = 0.0


REASON_CODES = (
    "out_of_travel",
    "wrist_limit",
    "own_layer",
    "printed_part",
    "plate",
    "substrate",
    "robot_body",
    "no_support",
)
