"""The pictures of docs/sensors.md are those that its command makes."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CHECKOUT = Path(__file__).resolve().parent.parent
TEXT = (CHECKOUT / "docs" / "sensors.md").read_text()
PICTURES = re.findall(r"!\[[^]]+\]\((sensors/[^)]+)\)", TEXT)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for name in re.findall(r"examples/(\w+\.py) docs/sensors", (CHECKOUT / "Makefile").read_text()):
        script = CHECKOUT / "examples" / name
        subprocess.run([sys.executable, script, folder], check=True, capture_output=True, timeout=300)
    return folder


def test_every_picture_is_shown() -> None:
    kept = {f"sensors/{path.name}" for path in (CHECKOUT / "docs" / "sensors").iterdir()}
    assert set(PICTURES) == kept
    assert len(PICTURES) == len(kept)


@pytest.mark.parametrize("picture", PICTURES)
def test_a_picture_is_what_the_command_makes(picture: str, drawn: Path) -> None:
    """But for pixels whose noise another processor rounds otherwise."""
    kept, made = (
        np.asarray(Image.open(path).convert("RGB"), np.int16)
        for path in (CHECKOUT / "docs" / picture, drawn / Path(picture).name)
    )
    assert kept.shape == made.shape
    assert (np.abs(kept - made).max(axis=-1) > 8).mean() < 0.002
