"""Data sets at URLs are read like those in folders, and only the requested parts are read."""

import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shell_calls import call_on_one_line
from small_datasets import make

import rigcast
from rigcast.sensors.errors import InputError

fsspec: Any = pytest.importorskip("fsspec")


@pytest.fixture
def memory() -> Iterator[Any]:
    """The file system of memory:// URLs, empty at first."""
    files = fsspec.filesystem("memory")
    yield files
    for name in files.ls("/", detail=False):
        files.rm(name, recursive=True)


@pytest.fixture(params=["npz", "zarr"])
def made(request: pytest.FixtureRequest, whole_folder: Path, path: Path) -> Path:
    """The folder of a data set, in either format."""
    if request.param == "npz":
        return whole_folder
    path.write_text(path.read_text() + "output: {format: zarr}\n")
    make(path)
    return path.parent / "out"


def assert_same_frames(got: Any, expected: Any) -> None:
    assert len(got) == len(expected)
    for one, other in zip(got, expected, strict=True):
        assert (one.scene, one.episode, one.sensor, one.time) == (other.scene, other.episode, other.sensor, other.time)
        assert set(one) == set(other)
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=f"{one!r}: {name}")


def test_frames_are_those_of_the_folder(made: Path, memory: Any) -> None:
    memory.put(f"{made}/", "/bucket/rooms", recursive=True)
    for url in ("memory://bucket/rooms", "memory://bucket/rooms/", made.as_uri()):
        frames = rigcast.open_dataset(url, verify=True)
        assert_same_frames(frames, rigcast.open_dataset(made))
        assert frames.of("top")[3].sensor == "top"


def test_no_more_is_read_than_is_asked_for(whole_folder: Path, memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.put(f"{whole_folder}/", "/rooms", recursive=True)
    opened, files_open = [], type(memory).open

    def noted(files: Any, path: str, *arguments: Any, **options: Any) -> Any:
        opened.append(path)
        return files_open(files, path, *arguments, **options)

    monkeypatch.setattr(type(memory), "open", noted)
    frames = rigcast.open_dataset("memory://rooms")
    assert opened == ["/rooms/dataset.json"]
    assert frames[0]["range"].shape == frames[1]["range"].shape
    assert opened == ["/rooms/dataset.json", "/rooms/room/000000/frames.npz"]


def test_files_that_are_not_as_they_were_written_are_named(whole_folder: Path, memory: Any) -> None:
    memory.put(f"{whole_folder}/", "/rooms", recursive=True)
    memory.rm("/rooms/room/000001/frames.npz")
    memory.pipe("/rooms/room/000000/ids.json", b"{}")
    faults = sorted(rigcast.open_dataset("memory://rooms").verify())
    assert [fault.split(": ")[:2] for fault in faults] == [
        [
            "memory://rooms/room/000000/ids.json",
            f"got another checksum than the manifest's, {faults[0].split(', ')[1]}",
        ],
        ["memory://rooms/room/000001/frames.npz", "missing"],
    ]
    with pytest.raises(InputError, match=r"memory://rooms/room/000001/frames\.npz: missing"):
        rigcast.open_dataset("memory://rooms", verify=True)


def test_an_open_data_set_goes_to_other_processes(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder.as_uri())
    first = frames[0]["range"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(frames))[0]["range"], first)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("memory://nothing/here", r"memory://nothing/here/dataset\.json: not the manifest of a data set"),
        ("nowhere://bucket/rooms", "nowhere://bucket/rooms: Protocol not known: nowhere"),
    ],
)
def test_a_url_without_a_data_set_is_refused(url: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        rigcast.open_dataset(url)


def test_without_fsspec_it_is_said_what_to_install(whole_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(
        InputError, match=r"a data set at a URL needs fsspec, .*pip install 'rigcast\[remote\]' brings it"
    ):
        rigcast.open_dataset("memory://rooms")
    assert len(rigcast.open_dataset(whole_folder))


def test_the_shell_verifies_at_a_url(whole_folder: Path, memory: Any) -> None:
    memory.put(f"{whole_folder}/", "/rooms", recursive=True)
    code, output = call_on_one_line("dataset", "rooms.yaml", "--out", "memory://rooms", "--verify")
    assert (code, "memory://rooms: " in output, "all unchanged" in output) == (0, True, True), output
    memory.pipe("/rooms/room/000000/ids.json", b"{}")
    code, output = call_on_one_line("dataset", "rooms.yaml", "--out", "memory://rooms", "--verify")
    assert (code, "1 wrong" in output) == (1, True), output


def test_the_shell_writes_to_folders_only(path: Path) -> None:
    code, output = call_on_one_line("dataset", str(path), "--out", "memory://rooms")
    assert (code, "--out: got memory://rooms: data sets are written to folders" in output) == (2, True), output
