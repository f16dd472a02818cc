"""Warp kept quiet, and tests that need a GPU skipped where there is none."""

import pytest
import warp as wp

if hasattr(wp.config, "log_level"):
    wp.config.log_level = wp.LOG_WARNING
else:
    wp.config.quiet = True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    needs_cuda = [item for item in items if item.get_closest_marker("cuda")]
    if needs_cuda and wp.get_cuda_device_count() == 0:
        for item in needs_cuda:
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))
