"""The wheel holds everything, and works where there is no checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
ROOMS = {
    "rigcast": "rigcast",
    "sensors": "rigcast/sensors",
    "kernels": "rigcast/kernels",
    "configs": "rigcast/configs",
}


def run(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed, run without PYTHON variables."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{command} gave {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a copy of the sources: setuptools leaves its build folder beside them."""
    source = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(CHECKOUT / name, source)
    for room in ROOMS:
        shutil.copytree(CHECKOUT / room, source / room, ignore=shutil.ignore_patterns("__pycache__"))
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    run(*pip, "--wheel-dir", "dist", ".", cwd=source)
    (built,) = (source / "dist").glob("rigcast-*.whl")
    return built


@pytest.fixture(scope="module")
def bin_folder(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of a fresh environment: the wheel and, by reference, the dependencies installed here."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder, symlinks=True)
    scripts, packages = (Path(sysconfig.get_path(key, "venv", {"base": str(folder)})) for key in ("scripts", "purelib"))
    pip = (sys.executable, "-m", "pip", "--python", scripts / "python", "install", "--quiet")
    run(*pip, "--no-deps", "--no-index", wheel, cwd=folder)
    # A folder named in a .pth file is searched; the .pth files in it (the editable install's) are not read.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return scripts


def test_wheel_holds_every_module_and_data_file(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"{package}/{path.relative_to(CHECKOUT / room).as_posix()}"
        for room, package in ROOMS.items()
        for path in (CHECKOUT / room).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert {name for name in packed if ".dist-info/" not in name} == wanted
    assert any(name.endswith("/licenses/LICENSE") for name in packed)


def test_installed_package_is_the_wheels(bin_folder: Path, tmp_path: Path) -> None:
    program = "import rigcast, rigcast.kernels, rigcast.sensors, rigcast.configs as c, sys; print(rigcast.__file__)"
    found = run(bin_folder / "python", "-c", f"{program}; print(c.__file__, *sys.path, sep='\\n')", cwd=tmp_path)
    package, configs, *search_path = found.splitlines()
    assert Path(package).is_relative_to(bin_folder.parent)
    assert Path(configs).is_relative_to(bin_folder.parent)
    assert str(CHECKOUT) not in search_path


def test_installed_presets_are_listed(bin_folder: Path, tmp_path: Path) -> None:
    listed = run(bin_folder / "rigcast", "presets", cwd=tmp_path)
    assert all(name in listed for name in ("velodyne_vlp16", "ouster_os1_64", "realsense_d435")), listed


def test_installed_rig_gives_one_frame(bin_folder: Path, tmp_path: Path) -> None:
    (package,) = bin_folder.parent.rglob("site-packages/rigcast")
    rig = package / "configs" / "minimal.yaml"
    run(bin_folder / "rigcast", "run", rig, "--duration", "0.2", "--out", "out", cwd=tmp_path)
    clouds = list((tmp_path / "out" / "top").glob("*.ply"))
    assert len(clouds) == 1, clouds
    assert clouds[0].stat().st_size > 1000
    assert (tmp_path / "out" / "top" / "preview.png").stat().st_size > 1000


def test_installed_demo_is_valid(bin_folder: Path, tmp_path: Path) -> None:
    (package,) = bin_folder.parent.rglob("site-packages/rigcast")
    run(bin_folder / "rigcast", "validate", package / "configs" / "demo.yaml", cwd=tmp_path)
