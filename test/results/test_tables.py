# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vega_planner.datatypes import PrintTrajectory, Toolpath, ToolpathSet, Travel
from vega_planner.errors import InvalidInput
from vega_planner.results.tables import (
    TOOLPATH_COLUMNS,
    format_rows,
    read_table,
    toolpath_csv,
    trajectory_csv,
)

UP = np.array([0.0, 0.0, 1.0])


def straight(start, end, count=3, index=0):
    points = np.linspace(start, end, count)
    axes = np.tile(UP, (count, 1))
    return Toolpath(points, axes, np.full(count, 1.2), np.full(count, 0.8), index, index)


def two_passes():
    passes = (straight((0, 0, 1), (10, 0, 1)), straight((0, 1, 1), (10, 1, 1), 4, 1))
    hops = [
        Travel([[0, 0, 9], [0, 0, 1]], [UP, UP]),
        Travel([[10, 0, 1], [10, 0, 5], [0, 1, 5], [0, 1, 1]], [UP] * 4),
        Travel([[10, 1, 1], [10, 1, 9]], [UP, UP]),
    ]
    return ToolpathSet(passes, tuple(hops))


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 20), st.integers(1, 6)),
        elements=st.floats(-1e6, 1e6, allow_subnormal=False),
    ),
    st.integers(0, 9),
)
def test_printed_rows_read_back_within_half_the_last_digit(values, decimals):
    text = format_rows(values, [decimals] * values.shape[1]).decode()
    lines = text.splitlines()
    assert len(lines) == len(values)
    for line, row in zip(lines, values, strict=True):
        numbers = [float(word) for word in line.split(",")]
        assert np.abs(np.array(numbers) - row).max() <= 0.5 * 10.0**-decimals + 1e-9
        assert all(len(word.partition(".")[2]) == decimals for word in line.split(","))


def test_no_number_is_printed_as_minus_zero():
    assert format_rows(np.array([[-1e-9, -0.0]]), [3, 0]) == b"0.000,0\n"


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_a_number_that_cannot_be_printed_is_refused(bad):
    with pytest.raises(InvalidInput):
        format_rows(np.array([[bad]]), [2])


def test_the_toolpath_table_reads_back_as_the_passes_in_order(tmp_path):
    paths = two_passes()
    (tmp_path / "t.csv").write_bytes(toolpath_csv(paths))
    table = read_table(tmp_path / "t.csv", list(TOOLPATH_COLUMNS))
    for index, path in enumerate(paths.passes):
        rows = table["path_id"] == index
        points = np.column_stack([table[f"{axis}_mm"][rows] for axis in "xyz"])
        np.testing.assert_allclose(points, path.points, atol=1e-5)
        np.testing.assert_array_equal(table["extrude"][rows], [0] + [1] * (len(points) - 1))
    travel = table["path_id"] == -1
    assert not table["extrude"][travel].any()
    assert travel.sum() == 1 + 2 + 1  # the ends of a move are the rows of its passes


def test_the_trajectory_table_keeps_nanometres(tmp_path):
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(1e-3, 1, 50))
    trajectory = PrintTrajectory(
        joint_names=("x", "c"),
        times=times,
        positions=rng.normal(size=(50, 2)),
        velocities=np.zeros((50, 2)),
        extrude=np.arange(50) % 2 == 0,
        path_id=np.arange(50) // 10 - 1,
        T_base_part=np.eye(4),
    )
    (tmp_path / "t.csv").write_bytes(trajectory_csv(trajectory))
    table = read_table(tmp_path / "t.csv", ["t_s", "x", "c", "extrude", "path_id"])
    np.testing.assert_allclose(table["t_s"], times, atol=1e-9)
    np.testing.assert_allclose(table["c"], trajectory.positions[:, 1], atol=1e-9)
    np.testing.assert_array_equal(table["path_id"], trajectory.path_id)


def test_a_table_without_a_wanted_column_names_it(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InvalidInput, match="no column c; has: a, b"):
        read_table(tmp_path / "t.csv", ["c"])
