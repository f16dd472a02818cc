"""The files of a data set in a temporary folder, and the data set made from them."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from small_datasets import MODULE_NAME, contents, make, write_files


@contextmanager
def _own_modules() -> Iterator[None]:
    """Forget the module of a folder afterwards, as Python would use it for others of the same name."""
    before = list(sys.path)
    yield
    sys.path[:] = before
    sys.modules.pop(MODULE_NAME, None)


@pytest.fixture
def path(tmp_path: Path) -> Iterator[Path]:
    """The path of a small data set's description."""
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
    """The files of `whole_folder`."""
    return contents(whole_folder)
