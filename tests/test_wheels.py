"""The wheels of other platforms: tag, files, symbols of the module, runs.

1. Of every platform, with other files in the place of compiled ones: tag, files, the library found.
2. Of the platforms whose module is compiled (``scripts/platforms wheel PLATFORM``): only the stable
   ABI of Python 3.12 is used, and nothing but the runtime of the system.
3. linux64, and win64 under Wine: the module does the default docking in a Python 3.12 without any
   other package, and ends where the native module ends.
4. Label `long`: linux64 in a new environment of Python 3.12 or later without a compiler: run,
   build, sweep, view.

macOS wheels are read but not run: no Mac is at hand.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile

import abi3info
import lief
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.fmu import binaries
from dockloop.native.core import load_core, to_json
from test_binary import FLOORS, LOADS, WINE, exports, parse, start_wine
from test_package import use_without_a_compiler

sys.path.append(str(paths.ROOT / "scripts" / "lib"))

from make_wheel import find_module, write_wheel

from programs import call

PLATFORMS = list(binaries.EXTENSIONS)
MODULE_STAMP = "module.sha256"
PYTHONS = paths.BUILD / "deps" / "python"  # fetched by scripts/platforms wheel
TAGS = {
    "linux64": r"manylinux_2_\d+_x86_64",
    "win64": "win_amd64",
    "aarch64-linux": r"manylinux_2_\d+_aarch64",
    "darwin64": "macosx_11_0_x86_64",
    "aarch64-darwin": "macosx_11_0_arm64",
}
DYNAMIC_LOOKUP = -2  # in place of a library: any part of the process may have the symbol (macOS)
SCENE = "idss_25t_350t"
OUTCOMES = ("captured", "time_of_capture", "relative.axial", "capture.peak.load_ratio")

# Of a Python without numpy: the module alone, driven as dl.Docking drives it.
DRIVE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import _core
docking = _core.Docking(open(sys.argv[2], encoding="utf-8").read(), "scene")
docking.start()
while docking.time < 4.0:
    docking.step(0.05)
names = sys.argv[3:]
print(json.dumps(dict(zip(names, docking.get(docking.find(names))))))
"""


def need_module(platform):
    """Return the module of a platform; skip the test if none of the present sources is there."""
    module = find_module(platform)
    stamp = module.with_name(MODULE_STAMP)
    if not (stamp.exists() and stamp.read_text().strip() == binaries.fingerprint()):
        pytest.skip(f"no module of the present sources: scripts/platforms wheel {platform}")
    return module


# ---------------------------------------------------------------- of every platform


@pytest.fixture
def pretended(tmp_path, monkeypatch):
    """A folder of compiled files of every platform, which are those of this machine."""
    monkeypatch.setattr(paths, "PLATFORMS", tmp_path / "platforms")
    for platform in PLATFORMS:
        library = binaries.portable_library(platform)
        library.parent.mkdir(parents=True)
        shutil.copy(paths.LIBRARY, library)
        shutil.copy(load_core().__file__, find_module(platform))


@pytest.mark.parametrize("platform", ["win64", "darwin64", "aarch64-darwin"])
def test_a_wheel_has_tag_and_files_of_its_platform(platform, pretended, tmp_path):
    wheel = write_wheel(tmp_path, platform)
    assert re.fullmatch(rf"dockloop-[\d.]+-cp312-abi3-{TAGS[platform]}\.whl", wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    package = tmp_path / "site" / "dockloop"
    assert (package / find_module(platform).name).exists()
    assert (package / "view" / "web" / "view.js").exists()
    code = "from dockloop.fmu.binaries import find_libraries as f; print(*f())"
    site = os.pathsep.join([str(tmp_path / "site"), *filter(None, sys.path)])
    environment = os.environ | {"PYTHONPATH": site}
    found = call(sys.executable, "-S", "-c", code, cwd=tmp_path, env=environment)
    assert found.split() == [platform]


# ---------------------------------------------------------------- compiled modules


def list_imports(binary):
    """Return the names of Python that a module takes from the interpreter."""
    if isinstance(binary, lief.PE.Binary):
        symbols = {entry.name for library in binary.imports for entry in library.entries}
    elif isinstance(binary, lief.ELF.Binary):  # its imported_symbols are those with a type
        symbols = {symbol.name for symbol in binary.dynamic_symbols if symbol.shndx == 0}
    else:
        symbols = {symbol.name for symbol in binary.imported_symbols}
    names = {name.removeprefix("_") if name.startswith("__Py") else name for name in symbols}
    names = {name.removeprefix("_") if name.startswith("_Py") else name for name in names}
    return {name for name in names if name.startswith("Py")}


def find_age(name):
    """Return the first version of Python whose stable ABI has a name."""
    for names in (abi3info.FUNCTIONS, abi3info.DATAS):  # codespell:ignore datas
        for symbol, entry in names.items():
            if symbol.name.removeprefix("_") == name:
                return entry.added.major, entry.added.minor
    return None


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_module_uses_only_the_stable_abi_of_python_3_12(platform):
    names = list_imports(parse(need_module(platform)))
    assert len(names) > 50
    ages = {name: find_age(name) for name in names}
    assert {name: age for name, age in ages.items() if age is None or age > (3, 12)} == {}


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_module_shows_only_its_start_and_needs_only_the_system(platform):
    binary = parse(need_module(platform))
    # Types of nanobind stay visible: its own declarations say so.
    visible = {name for name in exports(binary) if not re.match(r"_ZT[VIS]N8nanobind", name)}
    assert visible == {"PyInit__core"}
    loaded = [getattr(needed, "name", needed) for needed in binary.libraries]
    if "darwin" in platform:  # the first is the name of the module itself
        assert loaded.pop(0) == "_core.abi3.so"
    allowed = rf"{LOADS[platform]}|python3\.dll"
    assert [needed for needed in loaded if not re.fullmatch(allowed, needed)] == []


@pytest.mark.parametrize("platform", ["darwin64", "aarch64-darwin"])
def test_a_module_of_macos_leaves_only_python_to_be_found_later(platform):
    bindings = parse(need_module(platform)).bindings
    names = {entry.symbol.name for entry in bindings if entry.library_ordinal == DYNAMIC_LOOKUP}
    assert len(names) > 50
    assert [name for name in names if not name.lstrip("_").startswith("Py")] == []


@pytest.mark.parametrize("platform", [name for name in PLATFORMS if name in FLOORS])
def test_a_wheel_of_linux_runs_on_systems_as_old_as_the_library(platform, tmp_path):
    need_module(platform)
    floor = "_".join(map(str, FLOORS[platform]["GLIBC"]))
    assert f"-cp312-abi3-manylinux_{floor}_" in write_wheel(tmp_path, platform).name


# ---------------------------------------------------------------- runs


def drive_natively():
    """Return what the native module finds for the docking of `DRIVE`."""
    docking = dl.Docking(SCENE)
    while docking.time < 4.0:
        docking.step(0.05)
    return {name: float(docking.get(name)) for name in OUTCOMES}


def drive(module, folder, words, environment, root=""):
    """Do the docking of `DRIVE` with a module, in the Python that `words` start."""
    shutil.copy(module, folder)
    (folder / "drive.py").write_text(DRIVE)
    (folder / "scene.json").write_text(to_json(dl.Scene(SCENE).document))
    places = [f"{root}{folder / 'drive.py'}", f"{root}{folder}", f"{root}{folder / 'scene.json'}"]
    said = call(*words, *places, *OUTCOMES, env=environment, stdin=subprocess.DEVNULL)
    return json.loads(said.strip().splitlines()[-1])


def assert_same(values, others):
    """Assert that two compilers agree, within what `test_binary.assert_same_end` allows."""
    assert values["captured"] == others["captured"] == 1.0
    for name, value in values.items():
        assert others[name] == pytest.approx(value, rel=6e-3 if "peak" in name else 2e-4, abs=2e-4)


def test_the_module_of_linux64_does_the_docking(tmp_path):
    module = need_module("linux64")
    python = PYTHONS / "linux" / "bin" / "python3.12"
    environment = {"PATH": "/nowhere"}
    assert_same(drive_natively(), drive(module, tmp_path, [python, "-I"], environment))


def write_python3_dll(module, folder):
    """Write the library that passes the stable ABI on to python312.dll.

    Every Python for Windows has it, but not the one that Maven Central offers.
    """
    (needed,) = [entry for entry in parse(module).imports if entry.name == "python3.dll"]
    names = "".join(f"  {entry.name}=python312.{entry.name}\n" for entry in needed.entries)
    (folder / "python3.def").write_text(f"LIBRARY python3.dll\nEXPORTS\n{names}")
    (folder / "empty.c").write_text("int unused;\n")
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
    options = ["-shared", "-nostdlib", "-Wl,--no-entry", "-o", "python3.dll"]
    cache = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(folder / "zig"))
    subprocess.run(
        [*compiler, "empty.c", "python3.def", *options],
        cwd=folder,
        env=os.environ | cache,
        check=True,
    )


def test_the_module_of_win64_does_the_docking_under_wine(tmp_path):
    module = need_module("win64")
    write_python3_dll(module, tmp_path)
    environment = start_wine(tmp_path / "wine")
    words = [WINE, PYTHONS / "windows" / "python.exe", "-I"]
    assert_same(drive_natively(), drive(module, tmp_path, words, environment, root="Z:"))


def find_python():
    """Return a Python that can use the wheel of linux64; skip the test if there is none.

    The one of Maven Central has ctypes, which FMPy needs, only on systems with libffi.so.7.
    """
    installed = (shutil.which(f"python3.{minor}") for minor in range(12, 20))
    for python in filter(None, [PYTHONS / "linux" / "bin" / "python3.12", *installed]):
        words = [python, "-c", "import ctypes, ensurepip"]
        if subprocess.run(words, capture_output=True, check=False).returncode == 0:
            return python
    pytest.skip("no Python 3.12 or later with ctypes")


@pytest.mark.long
def test_the_wheel_of_linux64_works_without_a_compiler(tmp_path):
    need_module("linux64")
    wheel = write_wheel(tmp_path / "wheels", "linux64")
    subprocess.run([find_python(), "-m", "venv", tmp_path / "venv"], check=True)
    programs = tmp_path / "venv" / "bin"
    install = [programs / "python", "-m", "pip", "install", "--quiet"]
    subprocess.run([*install, f"{wheel}[sweep,tables]"], check=True)
    site = next((tmp_path / "venv" / "lib").glob("python3*/site-packages"))
    use_without_a_compiler(programs, site, tmp_path)
