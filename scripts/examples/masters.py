"""A docking put together by a master that is not ours: libcosim, ecos, FMPy, or a container FMU.

The package of `dockloop ssp` holds three units: the docking with its vehicles `driven`, and a rigid
body for each of them. A master makes one system of them. What matters is when it hands on values:

=========================  ======================================  ===============================
master                     in a step                               before the first step
=========================  ======================================  ===============================
libcosim                   parallel: set all, step all, read all   values are handed on
ecos                       the same                                the same
container (FMPy runs it)   the same                                the same
sequential container       one unit after the other, each with     the same
                           what is new until then
fmpy (its `fmpy.ssp`)      parallel                                nothing: all inputs are 0
=========================  ======================================  ===============================

In a parallel master the loads that a vehicle feels from t to t + H are those that the docking sends
at t, before the step is made. With `coupling.mode` = 2 the docking announces them: the package says
so by itself. In a sequential one the docking comes first and its vehicles make the same step with
the mean that it found: `coupling.mode` = 1, `--scene coupling.mode=sequential`. FMPy loses the
announcement for its very first step, and takes inputs that are all 0 as not reported yet: harmless
as long as nothing is in contact.

Next to the result stands that of one FMU that integrates both vehicles. Needs, as well as FMPy,
`pip install libcosimpy ecospy fmu-manipulation-toolbox` and for ecos `apt-get install libtbb12`.
"""

import argparse
import tempfile
import zipfile
from pathlib import Path

from fmpy import read_model_description, simulate_fmu

from dockloop.fmu.build import build_fmu
from dockloop.fmu.ssp import PARAMETER_SET, build_ssp
from dockloop.native.core import list_loads, name_choice

ACCURATE = ("solver.rtol=1e-9", "solver.atol_position=1e-11", "solver.atol_velocity=1e-11")
RESULTS = {
    "outcome": "",
    "time_of_contact": "s",
    "time_of_capture": "s",
    **{f"capture.peak.{load}": unit for load, unit in list_loads().items()},
    "relative.axial": "m",
    "relative.lateral": "m",
}


def run_libcosim(package: Path, step: float, count: int) -> list:
    """Libcosim reads an unpacked package, and counts time in nanoseconds."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    with zipfile.ZipFile(package) as archive:
        archive.extractall(package.parent)
    step_ns = round(step * 1e9)
    execution = CosimExecution.from_ssp_file(str(package.parent), step_size=step_ns)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.simulate_until(count * step_ns)
    docking = execution.slave_index_from_instance_name("docking")
    description = read_model_description(package.parent / "resources" / "docking.fmu")
    variables = {v.name: v for v in description.modelVariables}
    read = {"Real": observer.last_real_values, "Integer": observer.last_integer_values}
    return [
        read[variables[name].type](docking, [variables[name].valueReference])[0] for name in RESULTS
    ]


def run_ecos(package: Path, step: float, count: int) -> list:
    """Ecos applies the parameter values of a package only with their name."""
    from ecospy.EcosSimulation import EcosSimulation

    simulation = EcosSimulation(ssp_path=str(package), step_size=step)
    simulation.init(parameter_set=PARAMETER_SET)
    simulation.step(count)
    outcome, *others = RESULTS
    values = [simulation.get_real(f"docking::{name}") for name in others]
    return [simulation.get_integer(f"docking::{outcome}"), *values]


def run_fmpy(package: Path, step: float, count: int) -> list:
    """FMPy makes every step that begins before the stop time."""
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(package, stop_time=(count - 0.5) * step, step_size=step)
    return [result[f"docking.{name}"][-1].item() for name in RESULTS]


def run_container(package: Path, step: float, count: int, sequential: bool = False) -> list:
    """One FMU of all units, for tools without SSP; FMPy runs it here."""
    from fmu_manipulation_toolbox.assembly import Assembly

    assembly = Assembly(package.name, fmu_directory=package.parent, default_step_size=step)
    assembly.root.sequential = sequential
    for name in RESULTS:
        assembly.root.add_output("docking.fmu", name, name)
    assembly.make_fmu()
    return run_fmu(package.with_suffix(".fmu"), step, count)


def run_sequential_container(package: Path, step: float, count: int) -> list:
    """The same, with the units stepped one after the other: the docking first."""
    return run_container(package, step, count, sequential=True)


def run_fmu(fmu: Path, step: float, count: int) -> list:
    """One FMU in FMPy."""
    result = simulate_fmu(
        fmu, stop_time=count * step, step_size=step, output_interval=step, output=list(RESULTS)
    )
    return [result[name][-1].item() for name in RESULTS]


MASTERS = {
    "libcosim": run_libcosim,
    "ecos": run_ecos,
    "fmpy": run_fmpy,
    "container": run_container,
    "sequential-container": run_sequential_container,
}


def main() -> None:
    """Dock in a master, dock in one FMU, compare."""
    parser = argparse.ArgumentParser(
        description="A docking whose vehicles are FMUs of their own, against one FMU for all.",
        epilog="example: python scripts/examples/masters.py --master ecos --step 0.02",
    )
    parser.add_argument("--master", choices=MASTERS, required=True)
    parser.add_argument("--scene", default="idss_25t_350t", help="default: %(default)s")
    parser.add_argument("--step", type=float, default=0.01, metavar="H", help="s (%(default)s)")
    parser.add_argument("--stop", type=float, default=5.0, metavar="T", help="s (%(default)s)")
    options = parser.parse_args()
    count = round(options.stop / options.step)

    mode = "sequential" if options.master.startswith("sequential") else "parallel"
    settings = (*ACCURATE, f"experiment.step={options.step!r}", f"coupling.mode={mode}")
    with tempfile.TemporaryDirectory() as folder:
        package = build_ssp(options.scene, settings, Path(folder) / "docking.ssp", bare=True)
        found = MASTERS[options.master](package, options.step, count)
        alone = build_fmu(options.scene, settings, Path(folder) / "alone.fmu", bare=True)
        expected = run_fmu(alone, options.step, count)

    print(f"{'':30} {options.master:>20} {'one FMU':>14} {'difference':>12}")
    for (name, unit), a, b in zip(RESULTS.items(), found, expected, strict=True):
        if name == "outcome":
            print(f"{name:30} {name_choice(name, a):>20} {name_choice(name, b):>14}")
        else:
            print(f"{f'{name} {unit}':30} {a:20.6f} {b:14.6f} {a - b:12.1e}")


if __name__ == "__main__":
    main()
