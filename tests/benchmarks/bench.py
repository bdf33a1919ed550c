"""Measure dockloop and other engines on the same mechanisms in one run.

Called by ``scripts/bench`` once everything is compiled. Programs take turns, round after round, and
the least time of each figure counts: other work on the machine can only add. So ratios of one
report are good; its microseconds are those of one machine. What is written: ``report.py``.
"""

import argparse
import json
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from datetime import date
from pathlib import Path

from fmpy import fmi2, read_model_description

from benchmarks import mechanisms, report
from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.kernel import FLAGS
from dockloop.native import core

DATA = paths.ROOT / "tests" / "data"
REFERENCE = DATA / "hexapod_bench_reference.json"
BENCH = paths.MECHANISMS / "hexapod_bench.json"
LEGS = (3, 6, 12, 24, 36, 48, 60)
CRANKS = {"hexapod_r1r2r3": [0, 0, 1], "hexapod_r1r2r3_square": [0, 1, 0]}  # name: second axis
PEERS = ("pinocchio", "mujoco")


def make_documents(folder: Path) -> None:
    """Write the mechanisms: for dockloop with legs, for others as bodies and loops with states."""
    bench = json.loads(BENCH.read_text())
    start = json.loads((DATA / "hexapod_bench.json").read_text())["initial"]
    nested = json.loads((DATA / "crank_nested.json").read_text())
    keys = ("q", "v_independent", "tau")  # base at rest, no loads but these
    states = [{key: state[key] for key in keys} for state in nested["states"]]
    for name, second_axis in CRANKS.items():
        document = mechanisms.crank_hexapod(bench, name, second_axis)
        (folder / f"{name}.json").write_text(json.dumps(document))
    documents = [
        mechanisms.expand(bench, start),
        {"name": "crank_nested", "mechanism": nested["mechanism"], "states": states},
    ]
    for count in LEGS:
        document = mechanisms.hexapod(bench, count)
        (folder / f"{document['name']}.json").write_text(json.dumps(document))
        documents.append(mechanisms.expand(document, start))
    for document in documents:
        add_expected(document, folder)
        if document["name"] != "crank_nested":  # its ring has an inertia that MuJoCo refuses
            (folder / f"{document['name']}.xml").write_text(mechanisms.to_mjcf(document))


def add_expected(document: dict, folder: Path) -> None:
    """Close the states of a mechanism, add accelerations of dockloop, write NAME_states.json."""
    file = folder / f"{document['name']}_states.json"
    for state in document["states"]:
        state["external"] = []
    file.write_text(json.dumps(document))
    evaluated = core.evaluate(file.read_text(), file, file.read_text(), file)
    for state, expected in zip(document["states"], evaluated, strict=True):
        state["q"], state["expected"] = expected["q"], expected
    file.write_text(json.dumps(document))


def unpack_fmu(scene: str, folder: Path) -> Path:
    """Build the FMU of a scene and return the folder into which it was unpacked."""
    file = build_fmu(scene, (), folder / f"{scene}.fmu")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder / scene)
    return folder / scene


def make_kernels(arguments: dict[Path, str], folder: Path) -> dict[Path, str]:
    """Make generated kernels where this build has a generator.

    Args:
        arguments: file of a mechanism or a scene -> ``mechanism`` or ``scene``.
        folder: where to put them.

    Returns:
        Per file argument of a benchmark: ``FILE`` or ``FILE,KERNEL``.
    """
    generator = paths.COMPILED / "dockloop-kernel"
    reported = {file: str(file) for file in arguments}
    for number, (file, kind) in enumerate(arguments.items()):
        if not generator.exists():
            break
        source, kernel = folder / f"kernel{number}.c", folder / f"kernel{number}.so"
        made = subprocess.run([generator, kind, file], capture_output=True, text=True, check=False)
        source.write_text(made.stdout)
        command = ["cc", *FLAGS, "-o", kernel, source, "-lm"]
        if made.returncode or subprocess.run(command, check=False).returncode:
            print(f"bench: no kernel of {file.name}: {made.stderr.strip()}", file=sys.stderr)
        else:
            reported[file] += f",{kernel}"
    return reported


def list_programs(folder: Path, peers: list[str], quick: bool) -> dict[str, list[str]]:
    """Return the command of each program that is there; each prints Google Benchmark's JSON."""
    legs = [n for n in LEGS if not quick or n in (6, 60)]
    google = list_options(quick)
    once = [*google[:1], "--benchmark_repetitions=1", *google[2:]]

    def states(name: str) -> str:
        return str(folder / f"{name}_states.json")

    several = [f"legs_{n}" for n in legs]
    others = [*CRANKS, *several]
    phases = r"--benchmark_filter=^(hexapod_bench|crank_nested)/|/(accelerations|with reactions)$"
    mechanism_files = [BENCH, DATA / "crank_nested.json", *(folder / f"{x}.json" for x in others)]
    scenes = {name: folder / name for name in ("idss_25t_350t", "hexapod_bench")}
    models = [at / "resources" / "model.json" for at in scenes.values()]
    reported = make_kernels(
        dict.fromkeys(mechanism_files, "mechanism") | dict.fromkeys(models, "scene"), folder
    )
    flags = ["--quick"] if quick else []
    commands = {
        "mechanism_bench": [*(reported[file] for file in mechanism_files), phases, *google],
        "motion_bench": [reported[BENCH], str(REFERENCE), *once],
        "rates_bench": [*(reported[file] for file in models), *google],
        "fmu_bench docking": [str(scenes["idss_25t_350t"]), *flags],
        "fmu_bench motion": [str(scenes["hexapod_bench"]), str(REFERENCE), *flags],
    }
    motion = ["--motion", str(REFERENCE)]
    if "pinocchio" in peers:
        files = map(states, ("hexapod_bench", "crank_nested", *several))
        commands["pinocchio_bench"] = [*motion, *files, *once]
    if "mujoco" in peers:
        pairs = [(states(x), str(folder / f"{x}.xml")) for x in ("hexapod_bench", *several)]
        commands["mujoco_bench"] = [*motion, *(file for pair in pairs for file in pair), *once]
    return find_programs(commands)


def list_options(quick: bool) -> list[str]:
    """Return options of Google Benchmark."""
    return [
        f"--benchmark_min_time={0.01 if quick else 0.05}",
        "--benchmark_repetitions=1" if quick else "--benchmark_repetitions=3",
        "--benchmark_enable_random_interleaving=true",
        "--benchmark_format=json",
    ]


def find_programs(commands: dict[str, list[str]]) -> dict[str, list[str]]:
    """Return the command of each program that is compiled; a word behind its name comes first."""
    found = {}
    for name, arguments in commands.items():
        program, *first = name.split()
        path = paths.COMPILED / program
        if path.exists():
            found[name] = [str(path), *first, *arguments]
        else:
            print(f"bench: {program} is not compiled and left out", file=sys.stderr)
    return found


def measure(programs: dict[str, list[str]], rounds: int) -> dict[str, dict]:
    """Run all programs by turns.

    Returns:
        Per figure its least time ``ns`` and what else was reported about it.
    """
    figures: dict[str, dict] = {}
    for round_ in range(rounds):
        for name, command in programs.items():
            print(f"bench: round {round_ + 1} of {rounds}: {name}", file=sys.stderr)
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                sys.exit(f"bench: {name} failed: {done.stderr.strip()[-500:]}")
            for item in json.loads(done.stdout)["benchmarks"]:
                if item["run_type"] != "iteration":
                    continue
                known = figures.setdefault(item["name"], {"ns": float("inf")})
                known["ns"] = min(known["ns"], item["cpu_time"])
                # Whatever else a figure comes with; times among it are least times as well.
                for key, value in item.items():
                    if not isinstance(value, int | float) or key in _GOOGLE:
                        continue
                    is_time = key in ("median", "worst")
                    known[key] = min(known.get(key, value), value) if is_time else value
    for name, known in figures.items():
        if name == "docking/whole":
            known["times_real_time"] = 20e9 / known["ns"]
    return figures


_GOOGLE = {
    "cpu_time", "real_time", "iterations", "repetitions", "repetition_index", "threads",
    "family_index", "per_family_instance_index",
}  # fmt: skip


def measure_fmpy(folder: Path, rounds: int) -> dict[str, float]:
    """Return least processor times [ns] of the default docking through FMPy.

    Args:
        folder: an unpacked FMU.
        rounds: how many times the docking is run.

    Returns:
        ``20 s in steps of 10 ms`` (2000 calls), and of single calls.
    """
    description = read_model_description(str(folder))
    references = {v.name: v.valueReference for v in description.modelVariables}
    outputs = [
        v.valueReference
        for v in description.modelVariables
        if v.causality == "output" and v.type == "Real"
    ]
    one, push = [references["relative.position[1]"]], [references["chaser.force_ext[1]"]]
    times: dict[str, float] = {}

    def note(name: str, calls: int, work: Callable[[], object]) -> None:
        before = time.thread_time_ns()
        for _ in range(calls):
            work()
        spent = (time.thread_time_ns() - before) / calls
        times[name] = min(times.get(name, spent), spent)

    for _ in range(rounds):
        fmu = fmi2.FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="bench",
        )
        fmu.instantiate()
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()

        def run(fmu=fmu) -> None:
            for i in range(2000):
                fmu.doStep(currentCommunicationPoint=0.01 * i, communicationStepSize=0.01)

        note("20 s in steps of 10 ms", 1, run)
        for _ in range(10):
            note("get/one output", 1000, lambda fmu=fmu: fmu.getReal(one))
            note("get/all outputs", 100, lambda fmu=fmu: fmu.getReal(outputs))
            note("set/one input", 1000, lambda fmu=fmu: fmu.setReal(push, [0.0]))
        fmu.terminate()
        fmu.freeInstance()
    return times


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", default=",".join(PEERS), help="comma-separated, or none")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=None)
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    peers = [peer for peer in options.peers.split(",") if peer != "none"]
    rounds = options.rounds or (1 if options.quick else 5)
    began = time.monotonic()
    folder = paths.BUILD / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    make_documents(folder)
    for scene in ("idss_25t_350t", "hexapod_bench"):
        unpack_fmu(scene, folder)
    figures = measure(list_programs(folder, peers, options.quick), rounds)
    fmpy = measure_fmpy(folder / "idss_25t_350t", 1 if options.quick else 3)
    results = {
        "command": " ".join(["scripts/bench", *sys.argv[1:]]),
        "date": date.today().isoformat(),
        "machine": report.describe_machine(),
        "rounds": rounds,
        "fmpy": fmpy,
        "figures": figures,
    }
    report.write_report(results, folder)
    if options.page:
        for name in ("report.md", "work_precision.png"):
            shutil.copy(folder / name, Path(__file__).parent / name)
    print(f"{paths.shown(folder / 'report.md')} ({time.monotonic() - began:.0f} s)")


if __name__ == "__main__":
    main()
