"""Silencing of Warp, in every supported version."""

import warp as wp


def quiet_warp() -> None:
    """Let Warp print only warnings and errors."""
    if hasattr(wp.config, "log_level"):
        wp.config.log_level = wp.LOG_WARNING
    else:
        wp.config.quiet = True
