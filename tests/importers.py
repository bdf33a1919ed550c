"""Runs a file in FMPy and in other importers: libcosim, ecos, fmpy.ssp, a container FMU.

Used by tests that show that the same file runs elsewhere. Every importer runs in a process of its
own: they are compiled programs that know nothing of each other, and one that crashes fails one
test. By hand::

    .venv/bin/python tests/importers.py ecos build/fmu/idss_25t_350t.fmu 0.01 400 relative.axial

A file is an FMU, or an SSP package with a component called `docking`. Here 400 steps of 0.01 s are
made from time 0, and the value of `relative.axial` at the end is printed as JSON.
"""

import ctypes
import functools
import importlib.util
import io
import json
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

import pytest

from programs import call

COMPONENT = "docking"
PARAMETER_SET = "scene"  # ecos applies the set of this name


def run_importer(importer: str, file: Path, step: float, count: int, names: Iterable[str]) -> dict:
    """Run a file in an importer; skips the test, with the reason, where that is not installed.

    Returns:
        The value of each variable at the end.
    """
    return {n: v[-1] for n, v in record_importer(importer, file, step, count, names).items()}


def record_importer(
    importer: str, file: Path, step: float, count: int, names: Iterable[str], *, every: int = 0
) -> dict:
    """Run a file in an importer and look at it while it runs.

    Args:
        importer: one of those that `find_obstacle` knows.
        file: an FMU, or an SSP package.
        step: communication step [s].
        count: number of steps.
        names: outputs; of `docking`, or `COMPONENT::NAME` in a package.
        every: steps between two looks; 0 = one look, at the end.

    Returns:
        The values of each variable after `every`, 2 `every`, ... steps.
    """
    if reason := find_obstacle(importer):
        pytest.skip(reason)
    every = every or count
    assert count % every == 0
    words = (importer, file, repr(step), f"{count}/{every}", *names)
    return json.loads(call(sys.executable, __file__, *words).splitlines()[-1])


def find_obstacle(importer: str) -> str:
    """Return why an importer cannot run here, or nothing."""
    packages = {
        "fmpy": "fmpy",
        "libcosim": "libcosimpy",
        "ecos": "ecospy",
        "fmpy.ssp": "fmpy",
        "container": "fmu_manipulation_toolbox",
        "sequential container": "fmu_manipulation_toolbox",
    }
    package = packages[importer]
    if importlib.util.find_spec(package) is None:
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        return f"the Python package {package} is not installed (Python {version})"
    if importer == "ecos":
        try:
            ctypes.CDLL("libtbb.so.12")
        except OSError:
            return "ecospy needs the system package libtbb12"
    return ""


def run_libcosim(file: Path, step: float, looks: range, names: list[str], folder: Path) -> list:
    """Libcosim counts time in whole nanoseconds and wants an SSP package unpacked."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    step_ns = round(step * 1e9)
    if file.suffix == ".ssp":
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        execution = CosimExecution.from_ssp_file(ssp_path=str(folder), step_size=step_ns)
    else:
        execution = CosimExecution.from_step_size(step_size=step_ns)
        slave = CosimLocalSlave(fmu_path=str(file), instance_name=COMPONENT)
        execution.add_local_slave(local_slave=slave)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    readers = {
        "Real": observer.last_real_values,
        "Integer": observer.last_integer_values,
        "Boolean": observer.last_boolean_values,
    }
    read = []
    for (component, _), variable in zip(
        map(split_name, names), find_variables(file, names), strict=True
    ):
        index = execution.slave_index_from_instance_name(component)
        read.append((readers[variable.type], index, [variable.valueReference]))
    rows = []
    for look in looks:
        assert execution.simulate_until(target_time=look * step_ns)
        rows.append([reader(index, reference)[0] for reader, index, reference in read])
    return rows


def run_ecos(file: Path, step: float, looks: range, names: list[str], folder: Path) -> list:
    """Ecos takes an SSP package as it is; FMUs are put together in a structure."""
    from ecospy.EcosSimulation import EcosSimulation
    from ecospy.EcosSimulationStructure import EcosSimulationStructure
    from ecospy.lib import EcosLib

    EcosLib.set_log_level("warn")
    if file.suffix == ".ssp":
        simulation = EcosSimulation(ssp_path=str(file), step_size=step)
        simulation.init(parameter_set=PARAMETER_SET)
    else:
        structure = EcosSimulationStructure()
        structure.add_model(COMPONENT, str(file))
        simulation = EcosSimulation(structure=structure, step_size=step)
        simulation.init()
    readers = {
        "Real": simulation.get_real,
        "Integer": simulation.get_integer,
        "Boolean": simulation.get_bool,
    }
    read = [
        (readers[variable.type], "::".join(split_name(name)))
        for name, variable in zip(names, find_variables(file, names), strict=True)
    ]
    rows = []
    for _ in looks:
        simulation.step(looks.step)
        rows.append([reader(name) for reader, name in read])
    simulation.terminate()
    return rows


def run_fmpy(file: Path, step: float, looks: range, names: list[str], folder: Path) -> list:
    """FMPy runs FMUs only; each step ends at a whole multiple of the step."""
    from fmpy import simulate_fmu

    result = simulate_fmu(
        str(file), stop_time=looks[-1] * step, step_size=step, output_interval=step, output=names
    )
    return [[result[name][look].item() for name in names] for look in looks]


def run_fmpy_ssp(file: Path, step: float, looks: range, names: list[str], folder: Path) -> list:
    """fmpy.ssp adds up its time, and ends with the first step that begins at the end or later."""
    from fmpy.ssp.simulation import simulate_ssp

    count = looks[-1]
    result = simulate_ssp(str(file), stop_time=(count - 0.5) * step, step_size=step)
    assert len(result) == count
    columns = [result[".".join(split_name(name))] for name in names]
    return [[column[look - 1].item() for column in columns] for look in looks]


def run_container(
    file: Path,
    step: float,
    looks: range,
    names: list[str],
    folder: Path,
    *,
    sequential: bool = False,
) -> list:
    """The fmu-manipulation-toolbox makes one FMU of all, which FMPy runs."""
    from fmu_manipulation_toolbox.assembly import Assembly

    (folder / file.name).write_bytes(file.read_bytes())
    description = file.name
    if file.suffix == ".fmu":
        description = "box.json"
        content = {"name": "box.fmu", "fmu": [file.name], "step_size": step}
        (folder / description).write_text(json.dumps(content))
    assembly = Assembly(description, fmu_directory=folder, default_step_size=step)
    assembly.root.sequential = sequential
    if file.suffix == ".fmu":
        assembly.root.auto_output = True
    else:
        # Connected outputs are there already, as locals called COMPONENT.NAME.
        shown = {".".join(("seen", *split_name(name))): split_name(name) for name in names}
        for outside, (component, inside) in shown.items():
            assembly.root.add_output(f"{component}.fmu", inside, outside)
        names = list(shown)
    assembly.make_fmu()
    made = "box.fmu" if file.suffix == ".fmu" else f"{file.stem}.fmu"
    return run_fmpy(folder / made, step, looks, names, folder)


def run_sequential_container(*arguments) -> list:
    """The same with the units stepped one after the other, each with what is new until then."""
    return run_container(*arguments, sequential=True)


def split_name(name: str) -> tuple[str, str]:
    """Return component and variable of `COMPONENT::NAME`; without a component it is `docking`."""
    component, _, variable = name.rpartition("::")
    return component or COMPONENT, variable


def find_variables(file: Path, names: list[str]) -> list:
    """Return what the FMUs say of these variables."""
    from fmpy import read_model_description

    @functools.cache
    def variables_of(component: str) -> dict:
        fmu = file
        if file.suffix == ".ssp":
            with zipfile.ZipFile(file) as archive:
                fmu = io.BytesIO(archive.read(f"resources/{component}.fmu"))
        return {v.name: v for v in read_model_description(fmu).modelVariables}

    return [variables_of(component)[variable] for component, variable in map(split_name, names)]


def main() -> None:
    """Run what the command line says, as one process."""
    runs = {
        "fmpy": run_fmpy,
        "libcosim": run_libcosim,
        "ecos": run_ecos,
        "fmpy.ssp": run_fmpy_ssp,
        "container": run_container,
        "sequential container": run_sequential_container,
    }
    importer, file, step, count, *names = sys.argv[1:]
    count, _, every = count.partition("/")
    every = int(every or count)
    looks = range(every, int(count) + 1, every)
    with tempfile.TemporaryDirectory(prefix="dockloop-test-") as folder:
        rows = runs[importer](Path(file), float(step), looks, names, Path(folder))
    print()
    columns = zip(*rows, strict=True)
    print(json.dumps(dict(zip(names, columns, strict=True))), flush=True)


if __name__ == "__main__":
    main()
