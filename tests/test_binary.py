"""The library of the FMU on every platform: exports, needs, age of systems, runs, what is packed.

The native library and the portable ones of ``DOCKLOOP_PLATFORMS`` (default: linux64 and win64) must
be there; ``scripts/test`` builds them. Others are looked at where they are built.
"""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import lief
import pytest
from fmpy import read_model_description
from fmpy.model_description import read_build_description

from dockloop.base import paths
from dockloop.fmu import binaries
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from programs import call

FUNCTIONS = 44  # of FMI 2.0, both interfaces
REQUIRED = os.environ.get("DOCKLOOP_PLATFORMS", "linux64 win64").split()
LIBRARIES = ["native", *binaries.EXTENSIONS]

# Newest symbol versions that each library may ask for, and the libraries it may load.
FLOORS = {
    "native": {"GLIBC": (2, 34), "GLIBCXX": (3, 4, 29), "CXXABI": (1, 3, 11)},
    "linux64": {"GLIBC": (2, 17)},
    "aarch64-linux": {"GLIBC": (2, 17)},
}
LOADS = {
    "native": r"lib(stdc\+\+|m|gcc_s|c)\.so\.\d",
    "linux64": r"lib(m|c|pthread|dl)\.so\.\d|ld-linux-x86-64\.so\.2",
    "aarch64-linux": r"lib(m|c|pthread|dl)\.so\.\d|ld-linux-aarch64\.so\.1",
    "win64": r"KERNEL32\.dll|ntdll\.dll|api-ms-win-crt-[a-z]+-l1-1-0\.dll",
    "darwin64": r"/usr/lib/libSystem\.B\.dylib",
    "aarch64-darwin": r"/usr/lib/libSystem\.B\.dylib",
}
HOSTS = Path(__file__).parent
HEADERS = Path(sys.modules["fmpy"].__file__).parent / "c-code"
WINE = Path("/usr/lib/wine/wine64")


def library(name):
    """Return the library of a platform; skip the test if it was not asked for."""
    if name == "native":
        return paths.LIBRARY
    file = binaries.portable_library(name)
    if not file.exists():
        if name not in REQUIRED:
            pytest.skip(f"{name} is not in DOCKLOOP_PLATFORMS: '{' '.join(REQUIRED)}'")
        pytest.fail(f"{paths.shown(file)} is not there: scripts/platforms {name}")
    stamp = file.with_name(binaries.STAMP)
    assert stamp.read_text().strip() == binaries.fingerprint(), f"old: scripts/platforms {name}"
    return file


@functools.cache
def parse(file):
    """Return the library, a file or its bytes, as an object of lief: ELF, PE or Mach-O."""
    return lief.parse(list(file) if isinstance(file, bytes) else str(file))


def exports(binary):
    """Return the names that other programs can see."""
    if isinstance(binary, lief.ELF.Binary):
        return {symbol.name for symbol in binary.exported_symbols}
    if isinstance(binary, lief.PE.Binary):
        return {entry.name for entry in binary.get_export().entries}
    trie = binary.dyld_info if binary.has_dyld_info else binary.dyld_exports_trie
    names = {entry.symbol.name.removeprefix("_") for entry in trie.exports}
    # The linker of zig has no list of exports: new and delete, and the file header, stay visible.
    visible = re.compile(
        r"_Z(nw|na|dl|da)(m|Pv|Pvm)(St11align_val_t)?|_mh_dylib_header|__dso_handle"
    )
    return {name for name in names if not visible.fullmatch(name)}


@pytest.mark.parametrize("name", LIBRARIES)
def test_only_fmi2_functions_are_exported(name):
    names = exports(parse(library(name)))
    assert len(names) == FUNCTIONS, sorted(names)
    assert all(name.startswith("fmi2") for name in names), sorted(names)


@pytest.mark.parametrize("name", LIBRARIES)
def test_it_needs_nothing_but_the_runtime_of_the_system(name):
    loaded = [getattr(needed, "name", needed) for needed in parse(library(name)).libraries]
    if "darwin" in name:  # the first is the name of the library itself
        assert loaded.pop(0) == "@rpath/dockloop.dylib"
    assert loaded
    assert [needed for needed in loaded if not re.fullmatch(LOADS[name], needed)] == []


@pytest.mark.parametrize(("name", "runtime"), [(n, r) for n in FLOORS for r in FLOORS[n]])
def test_it_runs_on_systems_as_old_as_promised(name, runtime):
    needed = parse(library(name)).symbols_version_requirement
    texts = [version.name for group in needed for version in group.get_auxiliary_symbols()]
    assert {text.split("_")[0] for text in texts} <= {*FLOORS[name], "GCC"}
    versions = [text.removeprefix(f"{runtime}_") for text in texts if f"{runtime}_" in text]
    newest = max(tuple(int(part) for part in version.split(".")) for version in versions)
    assert newest <= FLOORS[name][runtime]


@pytest.mark.parametrize("name", LIBRARIES)
def test_no_path_of_the_build_machine_is_inside(name):
    content = library(name).read_bytes()
    for path in (paths.ROOT, Path(sys.prefix), Path.home() / ".cache"):
        assert str(path).encode() not in content


# ---------------------------------------------------------------- runs


def compile_master(folder):
    """Compile master.c, a host in one page of C."""
    program = folder / "master.exe"
    subprocess.run(["cc", f"-I{HEADERS}", HOSTS / "master.c", "-o", program], check=True)
    return program


def compile_master_for_windows(folder):
    """Compile the same for Windows, without the C runtime of the compiler."""
    program, unit = folder / "master.exe", folder / "master.o"
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-O1"]
    libraries = ["-nostdlib", "-lkernel32", "-lucrtbase", "-Wl,--entry=start"]
    cache = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(folder / "zig"))
    for words in (
        [f"-I{HEADERS}", "-c", HOSTS / "master_windows.c", "-o", unit],
        [unit, *libraries, "-o", program],
    ):
        subprocess.run([*compiler, *words], check=True, env=os.environ | cache)
    return program


def start_wine(folder):
    """Make a folder for Wine's files; returns the environment of its programs."""
    assert WINE.exists(), "apt-get install --no-install-recommends wine64"
    settings = {"WINEPREFIX": str(folder), "WINEARCH": "win64", "WINEDEBUG": "-all"}
    # Python asks Windows for its version by WMI, of which Wine 8 lacks a part.
    environment = os.environ | settings | {"WINEDLLOVERRIDES": "wbemprox="}
    # A program that starts while Wine still makes its prefix sometimes ends without a word.
    subprocess.run([WINE, "wineboot", "-i"], env=environment, check=False)
    return environment


def final_values(fmu, file, resources, *program, stop=None, environment=None):
    """Run the default experiment with a library, or until `stop`; return the Reals at the end."""
    model = read_model_description(fmu)
    reals = {v.name: v.valueReference for v in model.modelVariables if v.type == "Real"}
    experiment = model.defaultExperiment
    ends = call(
        *(*program, file, resources, model.guid),
        *(stop or experiment.stopTime, experiment.stepSize),
        input="\n".join(map(str, reals.values())),
        env=os.environ | (environment or {}),
    )
    return dict(zip(reals, map(float, ends.split()), strict=True))


def assert_same_end(values, others):
    """Assert that two runs end alike, but for counts of the solver and what is only rounding.

    Another libm changes last digits, these move the steps of the solver, and what is left is of the
    size of its error. So does another compiler. Differences measured, relative to the value and at
    least to one unit: 1e-4 for linux64 and win64, 2e-5 for aarch64-linux, but 1.4e-3, 8e-4 and 4e-5
    for peaks and their times, which are those of steps.
    """
    for peaks, limit in ((False, 2e-4), (True, 6e-3)):
        difference, name = max(
            (abs(value - others[name]) / max(1.0, abs(value)), name)
            for name, value in values.items()
            if not (name.startswith("solver.") or name.endswith(".residual"))
            and (".peak" in name) == peaks
        )
        assert difference < limit, f"{name}: {difference:.2g}"


@pytest.fixture(scope="module")
def host(runs, tmp_path_factory):
    """The FMU of the default docking, unpacked, and its end with the native library."""
    folder = tmp_path_factory.mktemp("host é")  # libraries must open it whatever its name
    fmu = runs.complete_fmu("idss_25t_350t")
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    master = compile_master(folder)
    resources = (folder / "resources").as_uri()
    return fmu, folder, final_values(fmu, paths.LIBRARY, resources, master)


# For CMake: files of other projects, and files that name things as others do.
ALONE = """
file(GLOB alone ${CMAKE_SOURCE_DIR}/*/*.c ${CMAKE_SOURCE_DIR}/*/lanes_base.cpp
  ${CMAKE_SOURCE_DIR}/docking/interface_stiffness.cpp)
set_source_files_properties(${alone} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
"""


def run_cmake(*arguments, **settings):
    """Run CMake with settings; fails with the end of what it said."""
    options = [f"-D{name}={value}" for name, value in settings.items()]
    call("cmake", *arguments, *options)


def test_the_sources_inside_make_the_library_again(host):
    """The quickest way to compile them: several files at a time, not optimised."""
    fmu, folder, _ = host
    if not REQUIRED:
        pytest.skip("DOCKLOOP_PLATFORMS is empty: FMUs hold no sources")
    build, alone = folder / "build", folder / "alone.cmake"
    alone.write_text(ALONE)
    configure = ["-G", "Ninja", "-S", folder / "sources", "-B", build]
    run_cmake(*configure, CMAKE_BUILD_TYPE="Debug", CMAKE_EXPORT_COMPILE_COMMANDS="ON")
    compiled = {
        str(Path(unit["file"]).relative_to(folder / "sources"))
        for unit in json.loads((build / "compile_commands.json").read_text())
    }
    (configuration,) = read_build_description(fmu)
    (files,) = configuration.sourceFileSets
    (named,) = read_model_description(fmu).buildConfigurations
    assert set(files.sourceFiles) == set(named.sourceFileSets[0].sourceFiles) == compiled

    run_cmake(
        *configure,
        CMAKE_CXX_FLAGS_DEBUG="-O0",
        CMAKE_C_FLAGS_DEBUG="-O0",
        CMAKE_UNITY_BUILD="ON",
        CMAKE_PROJECT_dockloop_INCLUDE=alone,
    )
    workers = str(len(os.sched_getaffinity(0)))  # each takes more than 1 GB
    run_cmake("--build", build, "--target", "install", "--parallel", workers)
    own = folder / "binaries" / "linux64" / "idss_25t_350t.so"
    assert len(exports(parse(own))) == FUNCTIONS
    # This library is 150 times as slow. The docking captures at 2.8 s.
    native, again = (
        final_values(fmu, file, (folder / "resources").as_uri(), folder / "master.exe", stop="3.2")
        for file in (paths.LIBRARY, own)
    )
    assert native["time_of_capture"] > 0.0
    assert_same_end(native, again)


def test_linux64_ends_where_the_native_library_ends(host):
    fmu, folder, values = host
    resources = (folder / "resources").as_uri()
    ended = final_values(fmu, library("linux64"), resources, folder / "master.exe")
    assert_same_end(values, ended)


def test_win64_ends_where_the_native_library_ends_under_wine(host, tmp_path):
    fmu, folder, values = host
    windows = library("win64")
    master = compile_master_for_windows(tmp_path)
    environment = start_wine(tmp_path / "wine")
    ended = final_values(
        fmu,
        f"Z:{windows}",
        (folder / "resources").as_uri().replace("file:///", "file:///Z:/"),
        WINE,
        master,
        environment=environment,
    )
    assert_same_end(values, ended)


# ---------------------------------------------------------------- what is packed


@pytest.fixture
def three_platforms(tmp_path, monkeypatch):
    """A folder of portable libraries: win64 of the present sources, two of others."""
    monkeypatch.setattr(paths, "PLATFORMS", tmp_path / "platforms")
    for platform, stamp in {
        "linux64": "older",
        "win64": binaries.fingerprint(),
        "aarch64-linux": "older",
    }.items():
        file = binaries.portable_library(platform)
        file.parent.mkdir(parents=True)
        file.write_text(f"library of {platform}")
        file.with_name(binaries.STAMP).write_text(f"{stamp}\n")


def test_libraries_of_other_sources_are_left_out_with_one_warning(
    three_platforms, tmp_path, capsys
):
    with zipfile.ZipFile(build_fmu("absorber_1d", output=tmp_path / "absorber_1d.fmu")) as archive:
        packed = {name: archive.read(name) for name in archive.namelist() if "binaries/" in name}
    assert packed == {
        "binaries/linux64/absorber_1d.so": paths.LIBRARY.read_bytes(),
        "binaries/win64/absorber_1d.dll": b"library of win64",
    }
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("scripts/platforms linux64 aarch64-linux")


def test_run_loads_the_library_of_its_processor(tmp_path, monkeypatch):
    """FMPy alone would look into linux64."""
    monkeypatch.setattr(
        "dockloop.fmu.build.find_libraries", lambda: {"aarch64-linux": paths.LIBRARY}
    )
    monkeypatch.setattr("dockloop.fmu.binaries.machine", lambda: "aarch64")
    fmu = build_fmu("absorber_1d", output=tmp_path / "absorber_1d.fmu", kernel=False, bare=True)
    assert len(run_fmu(fmu, stop=0.2).time) > 2


def test_the_fingerprint_follows_the_sources(tmp_path, monkeypatch):
    before = binaries.fingerprint()
    for folder in ("src", "fmu"):
        shutil.copytree(paths.ROOT / folder, tmp_path / folder)
    shutil.copy(paths.ROOT / "CMakeLists.txt", tmp_path)
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    assert binaries.fingerprint() == before
    (tmp_path / "src" / "sim" / "phases.cpp").open("a").write("\n")
    assert binaries.fingerprint() != before
