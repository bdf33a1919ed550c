"""The package outside of the clone.

1. Laid out as it is installed, in another folder: commands, scenes, schemas, FMUs, Python.
2. Label `long`: the same after a real ``pip install`` into a new environment, which compiles
   everything.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from dockloop import paths
from dockloop.core import load_core

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


def lay_out(site: Path) -> None:
    """Put the package into a folder as CMakeLists.txt and pyproject.toml install it."""
    package = site / "dockloop"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(paths.ROOT / "scripts" / "dockloop", package, ignore=ignored)
    no_trades = shutil.ignore_patterns("trade")
    shutil.copytree(paths.MODELS, package / "data" / "modelDescription", ignore=no_trades)
    (package / "data" / "bin").mkdir()
    for file in (paths.LIBRARY, paths.GENERATOR):
        shutil.copy(file, package / "data" / "bin")
    shutil.copy(paths.ROOT / "LICENSE", package / "data")
    shutil.copy(load_core().__file__, package)


def check_package(python: list, folder: Path, environment: dict[str, str]) -> None:
    """Use the package that a Python sees, in a folder of its own; -S: no editable installation."""
    folder.mkdir()
    clean = {name: value for name, value in os.environ.items() if not name.startswith("DOCKLOOP_")}

    def call(*words: str) -> str:
        done = subprocess.run(
            [*python, *words],
            cwd=folder,
            env=clean | environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = call("-c", "from dockloop import paths; print(paths.ROOT)")
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


@pytest.mark.long
def test_pip_install_gives_a_working_package(tmp_path):
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    install += ["--config-settings=cmake.define.CMAKE_CXX_FLAGS_RELEASE=-O0"]  # compiles faster
    subprocess.run([*install, f"{paths.ROOT}[sweep]"], check=True, cwd=tmp_path)
    check_package([python], tmp_path / "elsewhere", {"PYTHONPATH": ""})
