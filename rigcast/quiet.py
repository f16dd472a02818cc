"""Warp kept quiet, in every version that is supported."""

import warp as wp


def quiet_warp() -> None:
    """Let Warp say only what is wrong."""
    if hasattr(wp.config, "log_level"):
        wp.config.log_level = wp.LOG_WARNING
    else:
        wp.config.quiet = True
