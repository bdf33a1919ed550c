"""The shared library of the FMU: what it exports, what it needs, how old a system it runs on."""

import re
import subprocess

import pytest

from dockloop import paths

FLOORS = {"GLIBC": (2, 32), "GLIBCXX": (3, 4, 29), "CXXABI": (1, 3, 9)}


def dump(*options):
    """Run objdump, which comes with the compiler."""
    return subprocess.run(
        ["objdump", *options, str(paths.LIBRARY)], check=True, capture_output=True, text=True
    ).stdout


def test_only_fmi2_functions_are_exported():
    rows = [line.split() for line in dump("-T").splitlines() if " g " in line]
    names = {row[-1] for row in rows if "*UND*" not in row}
    assert len(names) == 34
    assert all(name.startswith("fmi2") for name in names)


def test_it_needs_nothing_but_the_runtime_of_the_system():
    needed = set(re.findall(r"NEEDED\s+(\S+)", dump("-p")))
    assert needed <= {"libstdc++.so.6", "libm.so.6", "libgcc_s.so.1", "libc.so.6"}


@pytest.mark.parametrize("runtime", FLOORS)
def test_it_runs_on_systems_as_old_as_promised(runtime):
    versions = re.findall(rf"\b{runtime}_([0-9.]+)", dump("-T"))
    newest = max(tuple(int(part) for part in version.split(".")) for version in versions)
    assert newest <= FLOORS[runtime]


def test_no_path_of_the_build_machine_is_inside():
    assert str(paths.LIBRARY.parents[2]).encode() not in paths.LIBRARY.read_bytes()
