"""A data set's files in a folder of their own, and what they make."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from small_datasets import MODULE_NAME, contents, make, write_files


@contextmanager
def _own_modules() -> Iterator[None]:
    """Each folder has a module of the same name; Python would keep the first."""
    before = list(sys.path)
    yield
    sys.path[:] = before
    sys.modules.pop(MODULE_NAME, None)


@pytest.fixture
def path(tmp_path: Path) -> Iterator[Path]:
    """The file of a small data set."""
    with _own_modules():
        yield write_files(tmp_path)


@pytest.fixture(scope="session")
def whole_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set of `path`, made without any disturbance, in another folder."""
    folder = tmp_path_factory.mktemp("whole")
    with _own_modules():
        make(write_files(folder))
    return folder / "out"


@pytest.fixture(scope="session")
def whole(whole_folder: Path) -> dict[str, bytes]:
    """Its files."""
    return contents(whole_folder)
