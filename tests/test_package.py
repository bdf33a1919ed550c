"""The package outside of the clone.

1. Laid out as it is installed, in another folder: commands, scenes, schemas, FMUs, Python.
2. The wheel of ``scripts/platforms wheel``, installed by pip into a new environment without a
   compiler: run, build, sweep, view.
3. Label `long`: the same after a real ``pip install`` into a new environment, which compiles
   everything.
"""

import functools
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from dockloop.base import paths

sys.path.append(str(paths.ROOT / "scripts" / "lib"))

from make_wheel import lay_out, write_wheel

import programs

SWEEP = """
scene = "absorber_1d"
cases = 8
outcomes = ["relative.axial"]
[[vary]]
type = "uniform"
name = "chaser.mass"
range = [800.0, 1000.0]
[experiment]
stop = 0.2
step = 0.1
"""


def check_package(python: list, folder: Path, environment: dict[str, str]) -> None:
    """Use the package that a Python sees, in a folder of its own; -S: no editable installation."""
    folder.mkdir()
    clean = {name: value for name, value in os.environ.items() if not name.startswith("DOCKLOOP_")}

    call = functools.partial(programs.call, *python, cwd=folder, env=clean | environment)
    where = call("-c", "from dockloop.base import paths; print(paths.ROOT)")
    assert not Path(where.strip()).is_relative_to(paths.ROOT)
    ran = json.loads(call("-m", "dockloop", "run", "absorber_1d", "--stop", "0.2", "--json"))
    assert ran["files"][0] == "build/results/absorber_1d/absorber_1d.csv"
    assert all((folder / file).exists() for file in ran["files"])
    call("-m", "dockloop", "build", "idss_25t_350t", "-o", "mine.fmu")
    with zipfile.ZipFile(folder / "mine.fmu") as fmu:
        assert "documentation/index.html" in fmu.namelist()
    assert json.loads(call("-m", "dockloop", "check", "idss_hexapod", "--json"))["loops"]
    code = "import dockloop as dl; print(len(dl.run('absorber_1d', stop=0.2).time))"
    assert int(call("-c", code)) == 21
    (folder / "mine.toml").write_text(SWEEP)
    if "pyarrow" in call("-m", "pip", "list"):
        swept = json.loads(call("-m", "dockloop", "sweep", "mine.toml", "--json"))
        assert swept["status"] == {"done": 8}


def test_a_package_outside_of_the_clone_has_all_that_it_needs(tmp_path):
    lay_out(tmp_path / "site")
    path = os.pathsep.join([str(tmp_path / "site"), sysconfig.get_paths()["purelib"]])
    check_package([sys.executable, "-S"], tmp_path / "elsewhere", {"PYTHONPATH": path})


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the wheel is for Linux x86_64")
def test_the_wheel_works_without_a_compiler(tmp_path):
    wheel = write_wheel(tmp_path / "wheels")
    assert re.fullmatch(r"dockloop-[\d.]+-cp3\d+-cp3\d+-manylinux_2_\d+_x86_64\.whl", wheel.name)
    assert write_wheel(tmp_path / "again").read_bytes() == wheel.read_bytes()
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    place = tmp_path / "venv" / "bin"
    install = ("-m", "pip", "install", "--quiet", "--no-deps", "--no-index", str(wheel))
    subprocess.run([place / "python", *install], check=True)
    # Packages that dockloop needs are taken from .venv, but not dockloop: it comes from the wheel.
    site = next((tmp_path / "venv" / "lib").glob("python3*/site-packages"))
    (site / "needed.pth").write_text(sysconfig.get_paths()["purelib"])
    use_without_a_compiler(place, site, tmp_path)


def use_without_a_compiler(place: Path, site: Path, home: Path) -> None:
    """Run, build, sweep and view with an installed package; no compiler is on the path."""
    folder = home / "elsewhere"
    folder.mkdir()
    (folder / "mine.toml").write_text(SWEEP)
    environment = {"PATH": str(place), "HOME": str(home)}
    assert not any(shutil.which(name, path=str(place)) for name in ("cc", "gcc", "c++", "clang"))

    def call(name: str, *words: str) -> str:
        return programs.call(place / name, *words, cwd=folder, env=environment)

    where = call("python", "-c", "import dockloop, dockloop._core as c; print(c.__file__)").strip()
    assert Path(where).is_relative_to(site), where
    ran = json.loads(call("dockloop", "run", "idss_25t_350t", "--stop", "1", "--json"))
    assert all((folder / file).exists() for file in ran["files"])
    assert "mine.fmu" in call("dockloop", "build", "absorber_1d", "-o", "mine.fmu")
    again = json.loads(call("dockloop", "run", "mine.fmu", "--stop", "0.2", "--json"))
    assert again["files"]
    swept = json.loads(call("dockloop", "sweep", "mine.toml", "--json", "--no-plots"))
    assert swept["status"] == {"done": 8}
    call("dockloop", "view", ran["files"][0], "-o", "own.html")
    assert (folder / "own.html").stat().st_size > 100_000


@pytest.mark.long
def test_pip_install_gives_a_working_package(tmp_path):
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    install += ["--config-settings=cmake.define.CMAKE_CXX_FLAGS_RELEASE=-O0"]  # compiles faster
    subprocess.run([*install, f"{paths.ROOT}[sweep]"], check=True, cwd=tmp_path)
    check_package([python], tmp_path / "elsewhere", {"PYTHONPATH": ""})
