# SPDX-License-Identifier: Apache-2.0
"""Every format gives the same part; every broken file gives one clear line."""

from __future__ import annotations

import sys

import manifold3d
import numpy as np
import pytest

from vega_planner.errors import BadMesh
from vega_planner.part import load_part
from vega_planner.part.readers import read_mesh
from vega_planner.settings import PartSettings

NO_BRR = PartSettings(brr=("none",))
SIDES = np.array([10.0, 20.0, 30.0])


@pytest.fixture(scope="module")
def block():
    mesh = manifold3d.Manifold.cube(list(SIDES)).to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def binary_stl(vertices, faces, header=b"made by hand"):
    rows = np.zeros(len(faces), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    rows["c"] = vertices[faces]
    return header.ljust(80) + len(faces).to_bytes(4, "little") + rows.tobytes()


def ascii_stl(vertices, faces):
    lines = ["solid block"]
    for face in faces:
        lines += ["  facet normal 0 0 0", "    outer loop"]
        lines += ["      vertex {:.6e} {:.6e} {:.6e}".format(*vertices[v]) for v in face]
        lines += ["    endloop", "  endfacet"]
    return ("\n".join([*lines, "endsolid block"]) + "\n").encode()


def binary_ply(vertices, faces):
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    rows["n"], rows["v"] = 3, faces
    return header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def ascii_ply(vertices, faces):
    lines = [
        "ply\nformat ascii 1.0",
        f"element vertex {len(vertices)}",
        "property float x\nproperty float y\nproperty float z",
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header",
        *("{} {} {}".format(*v) for v in vertices),
        *("3 {} {} {}".format(*f) for f in faces),
    ]
    return ("\n".join(lines) + "\n").encode()


def obj(vertices, faces):
    lines = ["v {} {} {}".format(*v) for v in vertices]
    return "\n".join(lines + ["f {} {} {}".format(*(f + 1)) for f in faces]).encode()


def off(vertices, faces):
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0", *("{} {} {}".format(*v) for v in vertices)]
    return "\n".join(lines + ["3 {} {} {}".format(*f) for f in faces]).encode()


def three_mf(vertices, faces, unit="millimeter"):
    import io
    import zipfile

    points = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*v) for v in vertices)
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in faces)
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model"><mesh><vertices>{points}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    return buffer.getvalue()


STEP_FRAME = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('block','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('automotive design');
#2=PRODUCT_CONTEXT('',#1,'mechanical');
#3=PRODUCT('block','block','',(#2));
#4=PRODUCT_DEFINITION_FORMATION('','',#3);
#5=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#6=PRODUCT_DEFINITION('design','',#4,#5);
#7=PRODUCT_DEFINITION_SHAPE('','',#6);
#8=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#9=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#10=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#11=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),#8,'distance_accuracy','');
#12=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#11))
GLOBAL_UNIT_ASSIGNED_CONTEXT((#8,#9,#10))REPRESENTATION_CONTEXT('',''));
@DATA@
ENDSEC;
END-ISO-10303-21;
"""


def step(vertices, faces):
    """A boundary representation of plane triangles, in millimetres."""
    lines = []

    def entity(text):
        lines.append(f"#{100 + len(lines)}={text};")
        return 99 + len(lines)

    def triple(values):
        return "({:.9f},{:.9f},{:.9f})".format(*values)

    def direction(values):
        return entity(f"DIRECTION('',{triple(values / np.linalg.norm(values))})")

    points = [entity(f"CARTESIAN_POINT('',{triple(v)})") for v in vertices]
    corners = [entity(f"VERTEX_POINT('',#{p})") for p in points]
    edges = {}
    names = []
    for face in faces.tolist():
        loop = []
        for a, b in zip(face, [*face[1:], face[0]]):
            low, high = min(a, b), max(a, b)
            if (low, high) not in edges:
                along = vertices[high] - vertices[low]
                vector = entity(f"VECTOR('',#{direction(along)},{np.linalg.norm(along):.9f})")
                line = entity(f"LINE('',#{points[low]},#{vector})")
                edges[low, high] = entity(
                    f"EDGE_CURVE('',#{corners[low]},#{corners[high]},#{line},.T.)"
                )
            sense = ".T." if a < b else ".F."
            loop.append(entity(f"ORIENTED_EDGE('',*,*,#{edges[low, high]},{sense})"))
        a, b, c = vertices[face]
        axis, across = direction(np.cross(b - a, c - a)), direction(b - a)
        place = entity(f"AXIS2_PLACEMENT_3D('',#{points[face[0]]},#{axis},#{across})")
        plane = entity(f"PLANE('',#{place})")
        ring = entity(f"EDGE_LOOP('',({','.join(f'#{e}' for e in loop)}))")
        bound = entity(f"FACE_OUTER_BOUND('',#{ring},.T.)")
        names.append(entity(f"ADVANCED_FACE('',(#{bound}),#{plane},.T.)"))
    shell = entity(f"CLOSED_SHELL('',({','.join(f'#{n}' for n in names)}))")
    solid = entity(f"MANIFOLD_SOLID_BREP('block',#{shell})")
    shape = entity(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',(#{solid}),#12)")
    entity(f"SHAPE_DEFINITION_REPRESENTATION(#7,#{shape})")
    return STEP_FRAME.replace("@DATA@", "\n".join(lines)).encode()


WRITERS = {
    "binary.stl": binary_stl,
    "ascii.stl": ascii_stl,
    "UPPER.STL": binary_stl,
    "binary.ply": binary_ply,
    "ascii.ply": ascii_ply,
    "block.obj": obj,
    "block.off": off,
    "block.3mf": three_mf,
    "block.step": step,
    "block.stp": step,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_block(tmp_path, block, name):
    path = tmp_path / name
    path.write_bytes(WRITERS[name](*block))
    part = load_part(path, NO_BRR)
    assert part.name == path.stem and part.source == str(path)
    assert part.volume == pytest.approx(SIDES.prod(), rel=1e-6)
    np.testing.assert_allclose(part.bounds, [[-5, -10, 0], [5, 10, 30]], atol=1e-4)


def test_a_file_uri_and_a_string_are_paths_too(tmp_path, block):
    path = tmp_path / "with space.stl"
    path.write_bytes(binary_stl(*block))
    for source in (str(path), path.as_uri()):
        assert load_part(source, NO_BRR).volume == pytest.approx(6000)


def test_a_binary_stl_whose_header_says_solid_is_read_as_binary(tmp_path, block):
    path = tmp_path / "liar.stl"
    path.write_bytes(binary_stl(*block, header=b"solid facet"))
    assert load_part(path, NO_BRR).volume == pytest.approx(6000)


def test_stl_and_ply_load_without_the_mesh_library(tmp_path, block):
    import subprocess

    for name in ("binary.stl", "binary.ply"):
        (tmp_path / name).write_bytes(WRITERS[name](*block))
        code = (
            "import sys; from vega_planner.part import load_part; "
            f"load_part({str(tmp_path / name)!r}); "
            "print([m for m in ('trimesh', 'scipy', 'numba', 'manifold3d') if m in sys.modules])"
        )
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert run.stdout.strip() == "[]"


def test_what_is_written_as_part_ply_loads_to_the_same_faces_and_place(tmp_path, block):
    vertices, faces = block
    first = load_part((vertices + 0.1234567, faces), NO_BRR)
    path = tmp_path / "part.ply"
    path.write_bytes(binary_ply(first.vertices, first.faces))
    again = load_part(path, NO_BRR)
    assert (again.faces == first.faces).all()
    np.testing.assert_allclose(again.vertices, first.vertices, atol=1e-5)
    third = load_part((again.vertices, again.faces), NO_BRR)
    assert (third.vertices == again.vertices).all()


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("none.stl", None, "does not exist"),
        ("zero.stl", b"", "empty"),
        ("short.stl", b"solid", "too short"),
        ("cut.stl", bytes(80) + (9).to_bytes(4, "little") + bytes(50), "announces 9"),
        ("no.stl", bytes(84), "no triangle"),
        ("half.stl", b"solid x\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n", "cut short"),
        ("mesh.xyz", b"1 2 3", "choices: stl, obj, ply, 3mf, off, step, stp"),
        ("noise.ply", b"\x00\x01\x02", "cannot be read as PLY"),
        ("noise.3mf", b"PK\x03\x04nothing", "cannot be read as 3MF"),
        ("noise.off", b"hello", "cannot be read as OFF"),
        ("empty.obj", b"# nothing\n", "mesh"),
        ("noise.step", b"hello", "mesh"),
    ],
)
def test_a_broken_file_is_refused_in_one_line_with_its_name(tmp_path, name, data, words):
    path = tmp_path / name
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(BadMesh) as caught:
        load_part(path, NO_BRR)
    assert words in str(caught.value) and name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_and_a_foreign_uri_are_refused(tmp_path):
    with pytest.raises(BadMesh, match="cannot be read"):
        load_part(tmp_path, NO_BRR)
    with pytest.raises(BadMesh, match="file://"):
        load_part("https://example.org/a.stl", NO_BRR)
    with pytest.raises(BadMesh, match="choices"):
        load_part(42, NO_BRR)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1), ("cm", 10), ("m", 1000), ("inch", 25.4)])
def test_a_told_unit_scales_the_part(block, unit, factor):
    vertices, faces = block
    part = load_part((vertices / factor, faces), PartSettings(brr=("none",), unit=unit))
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), SIDES, rtol=1e-12)
    assert part.warnings == ()


def test_metres_are_guessed_where_millimetres_are_absurd(block):
    vertices, faces = block
    part = load_part((vertices / 1000, faces), NO_BRR)
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), SIDES, rtol=1e-12)
    assert any("metres" in line and "part.unit" in line for line in part.warnings)


@pytest.mark.parametrize(("unit", "factor"), [("inch", 25.4), ("meter", 1000), ("micron", 1e-3)])
def test_a_3mf_file_states_its_unit(tmp_path, block, unit, factor):
    vertices, faces = block
    path = tmp_path / "stated.3mf"
    path.write_bytes(three_mf(vertices / factor, faces, unit))
    part = load_part(path, NO_BRR)
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), SIDES, rtol=1e-6)
    assert any(unit in line for line in part.warnings)


@pytest.mark.parametrize("factor", [1e-9, 1e3])
def test_an_absurd_size_is_refused_with_the_choices(block, factor):
    vertices, faces = block
    with pytest.raises(BadMesh, match=r"allowed: 0.1 to 2000 mm.*part.unit") as caught:
        load_part((vertices * factor, faces), NO_BRR)
    assert "size" in str(caught.value)


def test_reading_changes_no_array_of_the_caller(block):
    vertices, faces = block
    before = vertices.copy(), faces.copy()
    load_part((vertices, faces[:, ::-1]), NO_BRR)
    assert (vertices == before[0]).all() and (faces == before[1]).all()


def test_every_reader_is_named_by_its_ending(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_bytes(b"x")
    with pytest.raises(BadMesh, match="gltf"):
        read_mesh(path)
