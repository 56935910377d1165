# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import trimesh

from vega_planner.errors import InvalidInput
from vega_planner.results.ply import mesh_ply, read_mesh_ply


def test_a_mesh_reads_back_to_the_bit_and_as_an_independent_reader_sees_it(tmp_path):
    ball = trimesh.creation.icosphere(3, 20.0)
    thickness = np.linspace(0.5, 1.5, len(ball.vertices))
    path = tmp_path / "ball.ply"
    path.write_bytes(mesh_ply(ball.vertices, ball.faces, {"thickness": thickness}))
    vertices, faces, extra = read_mesh_ply(path)
    np.testing.assert_array_equal(vertices, ball.vertices)
    np.testing.assert_array_equal(faces, ball.faces)
    np.testing.assert_allclose(extra["thickness"], thickness, rtol=1e-7)
    other = trimesh.load(path, process=False)
    np.testing.assert_array_equal(other.vertices, ball.vertices)
    np.testing.assert_array_equal(other.faces, ball.faces)


@pytest.mark.parametrize("content", [b"", b"ply\nend_header\n", b"not a mesh"])
def test_a_broken_file_is_refused_with_its_name(tmp_path, content):
    path = tmp_path / "broken.ply"
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"broken\.ply"):
        read_mesh_ply(path)
