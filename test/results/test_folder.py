# SPDX-License-Identifier: Apache-2.0
import pytest

from vega_planner.errors import InvalidInput, OutputError
from vega_planner.results.folder import check_output_folder, write_folder


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_new_folder_holds_just_what_was_written(tmp_path):
    write_folder(tmp_path / "a" / "out", {"x.txt": b"1", "sub/y.txt": lambda: b"2"})
    assert contents(tmp_path / "a" / "out") == {"x.txt": b"1", "sub/y.txt": b"2"}
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["out"]


def test_a_second_result_replaces_the_first_and_spares_what_is_not_its_own(tmp_path):
    out = tmp_path / "out"
    write_folder(out, {"x": b"1", "layers/0": b"1", "layers/1": b"1", "old": b"1"})
    (out / "mine").write_text("kept")
    write_folder(out, {"x": b"2", "layers/0": b"2"}, obsolete=("old", "never"))
    assert contents(out) == {"x": b"2", "layers/0": b"2", "mine": b"kept"}


@pytest.mark.parametrize("fail_at", range(4))
def test_a_failure_at_any_file_leaves_the_earlier_result_whole(tmp_path, fail_at):
    out = tmp_path / "out"
    write_folder(out, {f"f{k}": b"old" for k in range(4)})

    def full():
        raise OSError(28, "No space left on device")

    files = {f"f{k}": (full if k == fail_at else b"new") for k in range(4)}
    with pytest.raises(OutputError, match="no space left"):
        write_folder(out, files)
    assert contents(out) == {f"f{k}": b"old" for k in range(4)}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_while_moving_in_puts_everything_back(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_folder(out, {"a": b"old", "b": b"old"})
    rename = type(out).rename

    def failing(self, target):
        if self.parent.name == "new" and self.name == "b":
            monkeypatch.undo()
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(type(out), "rename", failing)
    with pytest.raises(OutputError):
        write_folder(out, {"a": b"new", "b": b"new", "c": b"new"})
    assert contents(out) == {"a": b"old", "b": b"old"}


def test_an_output_below_a_file_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInput, match="is a file"):
        check_output_folder(tmp_path / "file" / "out")
