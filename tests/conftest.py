"""Settings of all tests: Warp's and MuJoCo's logs, tests that are skipped, and the effort of the fuzz tests."""

import gc
import os
from collections.abc import Iterator

import pytest
import warp as wp
from hypothesis import HealthCheck, settings

from rigcast.quiet import quiet_warp

# `make fuzz` uses the second profile; a failure is printed with code that reproduces it
_PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True, database=None)
settings.register_profile("suite", _PATIENT, max_examples=200, derandomize=True)
settings.register_profile("fuzz", _PATIENT, max_examples=20_000)
settings.load_profile("suite")

quiet_warp()


@pytest.fixture(scope="session", autouse=True)
def working_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Run in a temporary folder, as MuJoCo writes MUJOCO_LOG.TXT to the current one."""
    before = os.getcwd()
    os.chdir(tmp_path_factory.mktemp("working"))
    yield
    os.chdir(before)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--hypothesis-profile") != "fuzz":
        for item in items:
            if item.get_closest_marker("long"):
                item.add_marker(pytest.mark.skip(reason="long: run by make fuzz"))
    needs_cuda = [item for item in items if item.get_closest_marker("cuda")]
    if needs_cuda and wp.get_cuda_device_count() == 0:
        for item in needs_cuda:
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))


@pytest.fixture
def no_older_objects() -> Iterator[None]:
    """Hide the million objects that exist already from the garbage collector and from `gc.get_objects`."""
    gc.freeze()
    yield
    gc.unfreeze()
