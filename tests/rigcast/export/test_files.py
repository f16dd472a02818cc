"""Files appear whole or not at all, and a folder that cannot be written is an error before work begins."""

from pathlib import Path

import pytest

from rigcast.export.files import make_writable, replacing
from rigcast.sensors.errors import InputError


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail_halfway() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        fail_halfway()
    assert (names_in(tmp_path), path.read_text()) == (["a.txt"], "old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert (temporary.parent, path.read_text()) == (tmp_path, "old")
    assert (names_in(tmp_path), path.read_text()) == (["a.txt"], "new")


def test_a_failed_write_names_the_file_and_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "gone" / "a.txt"
    with pytest.raises(InputError, match=r"a\.txt: cannot be written: No such file"), replacing(path) as temporary:
        temporary.write_text("new")


@pytest.mark.parametrize("place", ["file", "file/below", 300 * "x"])
def test_a_folder_that_cannot_be_written_is_an_input_error(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match=r"the output folder cannot be written: \w+"):
        make_writable(tmp_path / place)
    assert names_in(tmp_path) == ["file"]


def test_a_folder_is_made_and_tried_without_a_trace(tmp_path: Path) -> None:
    make_writable(tmp_path / "a" / "b")
    make_writable(tmp_path / "a" / "b")
    assert list(tmp_path.rglob("*")) == [tmp_path / "a", tmp_path / "a" / "b"]
