"""What users write passes a type checker, which finds what is wrong in it.

mypy sees rigcast as it is installed: its rooms are in one folder, and what it reports of that is not the user's.
"""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import rigcast

pytestmark = pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")

CHECKOUT = Path(__file__).resolve().parent.parent
SETTINGS = """[mypy]
strict = true
follow_imports = silent
ignore_missing_imports = true
"""
# each line that a type checker is to object to ends in # wrong
USER = """
import rigcast

rigcast.Lidarr(name="top")  # wrong
rigcast.__version__.split(".")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One with the package as an installation has it, and settings of a user."""
    package = tmp_path / "site" / "rigcast"
    package.mkdir(parents=True)
    rooms = [CHECKOUT / room for room in ("sensors", "kernels", "configs")]
    for path in [*(CHECKOUT / "rigcast").iterdir(), *rooms]:
        (package / path.name).symlink_to(path)
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    return tmp_path


def test_a_type_checker_objects_to_what_is_wrong_and_to_nothing_else(folder: Path) -> None:
    user = USER + "".join(f"rigcast.{name}\n" for name in rigcast.__all__)
    (folder / "user.py").write_text(user)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=mypy.ini", "user.py"],
        cwd=folder,
        env={"MYPYPATH": "site"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    found = {int(line) for line in re.findall(r"^user\.py:(\d+): error", done.stdout, re.MULTILINE)}
    wrong = {k for k, line in enumerate(user.splitlines(), start=1) if line.endswith("# wrong")}
    assert found == wrong, done.stdout + done.stderr
