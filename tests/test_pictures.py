"""The pictures of docs/sensors.md are those that its command makes."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

CHECKOUT = Path(__file__).resolve().parent.parent
TEXT = (CHECKOUT / "docs" / "sensors.md").read_text()
PICTURES = re.findall(r"!\[[^]]+\]\((sensors/[^)]+)\)", TEXT)


def test_every_picture_is_shown() -> None:
    kept = {f"sensors/{path.name}" for path in (CHECKOUT / "docs" / "sensors").iterdir()}
    assert set(PICTURES) == kept
    assert len(PICTURES) == len(kept)


def test_pictures_are_what_the_commands_make(tmp_path: Path) -> None:
    scripts = re.findall(r"examples/(\w+\.py) docs/sensors", (CHECKOUT / "Makefile").read_text())
    for name in scripts:
        command = [sys.executable, CHECKOUT / "examples" / name, tmp_path]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
    assert [name for name in PICTURES if not are_alike(CHECKOUT / "docs" / name, tmp_path / Path(name).name)] == []


def are_alike(*pictures: Path) -> bool:
    """Whether pictures are equal, but for a few pixels whose noise another processor may round otherwise."""
    kept, made = (np.asarray(Image.open(path).convert("RGB"), np.int16) for path in pictures)
    return kept.shape == made.shape and bool((np.abs(kept - made).max(axis=-1) > 8).mean() < 0.002)
