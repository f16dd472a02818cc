"""Warp kept quiet, MuJoCo's log elsewhere, tests skipped that need a GPU or long, and how hard the fuzz tests try."""

import gc
import os
from collections.abc import Iterator

import pytest
import warp as wp
from hypothesis import HealthCheck, settings

from rigcast.quiet import quiet_warp

# `make fuzz` takes the second; a fault that it finds is printed with the example that shows it
_PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True, database=None)
settings.register_profile("suite", _PATIENT, max_examples=200, derandomize=True)
settings.register_profile("fuzz", _PATIENT, max_examples=20_000)
settings.load_profile("suite")

quiet_warp()


@pytest.fixture(scope="session", autouse=True)
def working_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """MuJoCo writes MUJOCO_LOG.TXT into the current folder."""
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
    """The collector, and who asks it for all objects, passes over those that were there before: a million of them."""
    gc.freeze()
    yield
    gc.unfreeze()
