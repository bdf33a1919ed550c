"""Measure dockloop and other engines on the same mechanisms in one run, and write the report.

Called by ``scripts/bench`` once everything is compiled. Programs take turns, round after round, and
the least time of each figure counts: other work on the machine can only add. So ratios of one
report are good; its microseconds are those of one machine.
"""

import argparse
import json
import math
import platform
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from datetime import date
from pathlib import Path

import matplotlib as mpl
from fmpy import fmi2, read_model_description

from benchmarks import mechanisms
from dockloop import paths
from dockloop.core import run_core
from dockloop.fmu import build_fmu

DATA = paths.ROOT / "tests" / "data"
REFERENCE = DATA / "hexapod_bench_reference.json"
BENCH = paths.MECHANISMS / "hexapod_bench.json"
LEGS = (3, 6, 12, 24, 36, 48, 60)
ACCURACIES = (1e-4, 1e-6, 1e-8, 1e-10)  # m
TRUSTED = 1e-6  # relative error of accelerations, beyond which a time has no meaning
FLOOR = "hand-written"
PEERS = ("pinocchio", "mujoco")


def make_documents(folder: Path) -> None:
    """Write the mechanisms: for dockloop with legs, for others as bodies and loops with states."""
    bench = json.loads(BENCH.read_text())
    start = json.loads((DATA / "hexapod_bench.json").read_text())["initial"]
    nested = json.loads((DATA / "crank_nested.json").read_text())
    keys = ("q", "v_independent", "tau")  # base at rest, no loads but these
    states = [{key: state[key] for key in keys} for state in nested["states"]]
    documents = [
        mechanisms.expand(bench, start),
        {"name": "crank_nested", "mechanism": nested["mechanism"], "states": states},
    ]
    for count in LEGS:
        document = mechanisms.hexapod(bench, count)
        (folder / f"{document['name']}.json").write_text(json.dumps(document))
        documents.append(mechanisms.expand(document, start))
    for document in documents:
        file = folder / f"{document['name']}_states.json"
        for state in document["states"]:
            state["external"] = []
        file.write_text(json.dumps(document))
        evaluated = json.loads(run_core("check", file, "--states", str(file)))
        for state, expected in zip(document["states"], evaluated, strict=True):
            state["expected"] = expected
        file.write_text(json.dumps(document))
        if document["name"] != "crank_nested":  # its ring has an inertia that MuJoCo refuses
            (folder / f"{document['name']}.xml").write_text(mechanisms.to_mjcf(document))


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
        Per file what to tell a benchmark: ``FILE`` or ``FILE,KERNEL``.
    """
    generator = paths.COMPILED / "dockloop-kernel"
    told = {file: str(file) for file in arguments}
    for number, (file, kind) in enumerate(arguments.items()):
        if not generator.exists():
            break
        source, kernel = folder / f"kernel{number}.c", folder / f"kernel{number}.so"
        made = subprocess.run([generator, kind, file], capture_output=True, text=True, check=False)
        source.write_text(made.stdout)
        options = ["-O2", "-fno-math-errno", "-ffp-contract=off", "-shared", "-fPIC"]
        command = ["cc", *options, "-o", kernel, source, "-lm"]
        if made.returncode or subprocess.run(command, check=False).returncode:
            print(f"bench: no kernel of {file.name}: {made.stderr.strip()}", file=sys.stderr)
        else:
            told[file] += f",{kernel}"
    return told


def list_programs(folder: Path, peers: list[str], quick: bool) -> dict[str, list[str]]:
    """Return the command of each program that is there; each prints Google Benchmark's JSON."""
    legs = [n for n in LEGS if not quick or n in (6, 60)]
    google = [
        f"--benchmark_min_time={0.01 if quick else 0.05}",
        "--benchmark_repetitions=1" if quick else "--benchmark_repetitions=3",
        "--benchmark_enable_random_interleaving=true",
        "--benchmark_format=json",
    ]
    once = [*google[:1], "--benchmark_repetitions=1", *google[2:]]

    def states(name: str) -> str:
        return str(folder / f"{name}_states.json")

    several = [f"legs_{n}" for n in legs]
    phases = r"--benchmark_filter=^(hexapod_bench|crank_nested)/|/(accelerations|with reactions)$"
    mechanism_files = [BENCH, DATA / "crank_nested.json", *(folder / f"{x}.json" for x in several)]
    scenes = {name: folder / name for name in ("idss_25t_350t", "hexapod_bench")}
    models = [at / "resources" / "model.json" for at in scenes.values()]
    told = make_kernels(
        dict.fromkeys(mechanism_files, "mechanism") | dict.fromkeys(models, "scene"), folder
    )
    flags = ["--quick"] if quick else []
    commands = {
        "mechanism_bench": [*(told[file] for file in mechanism_files), phases, *google],
        "motion_bench": [told[BENCH], str(REFERENCE), *once],
        "rates_bench": [*(told[file] for file in models), *google],
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
        Per figure its least time ``ns`` and what else was told about it.
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


# ------------------------------------------------------------------------------------- the report


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table; the first column is text, others are figures."""
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def us(ns: float | None) -> str:
    """Write a time in microseconds with three digits."""
    return "-" if ns is None else f"{ns / 1e3:.3g}"


def evaluations_table(figures: dict, mechanism: str) -> str:
    """Compare all codes on one mechanism."""
    prefix = f"{mechanism}/"
    codes: dict[str, dict[str, dict]] = {}
    for name, figure in figures.items():
        code, _, what = name.removeprefix(prefix).rpartition("/")
        if name.startswith(prefix) and what in ("accelerations", "with reactions"):
            codes.setdefault(code, {})[what] = figure
    floor = codes.get(FLOOR, {})
    rows = []
    for code, told in codes.items():
        error = next((x["error"] for x in told.values() if "error" in x), None)
        trusted = error is None or error < TRUSTED

        def ratio(what, told=told):
            return (
                f"{told[what]['ns'] / floor[what]['ns']:.2f}"
                if what in told and what in floor
                else "-"
            )

        rows.append(
            [
                code if trusted else f"{code} (accelerations wrong)",
                *(
                    us(told[what]["ns"]) if what in told else "-"
                    for what in ("accelerations", "with reactions")
                ),
                *(ratio(what) for what in ("accelerations", "with reactions")),
                "-" if error is None else f"{error:.0e}",
            ]
        )
    head = ["code", "accelerations µs", "with cut forces, base wrench µs"]
    head += ["the former, floor 1", "the latter, floor 1", "error of accelerations"]
    return table(head, rows)


def find_motions(figures: dict) -> dict[str, list[tuple[float, float, float, str]]]:
    """Return per integrated code its (error [m], time [ns], evaluations, setting), all settings."""
    motions: dict[str, list] = {}
    for name, figure in figures.items():
        parts = name.split("/")
        if len(parts) == 3 and "error" in figure and "evaluations" in figure:
            code = "dockloop FMU" if parts[0] == "FMU" else parts[0]
            setting = f"{parts[1]} {parts[2]}"
            motions.setdefault(code, []).append(
                (figure["error"], figure["ns"], figure["evaluations"], setting)
            )
    return motions


def motions_table(figures: dict) -> str:
    """Cheapest setting of each code for each accuracy."""
    rows = []
    for code, points in find_motions(figures).items():
        row = [code]
        for accuracy in ACCURACIES:
            good = [point for point in points if point[0] <= accuracy]
            if not good:
                row.append("not reached")
                continue
            _, ns, evaluations, setting = min(good, key=lambda point: point[1])
            row.append(f"{ns / 1e6:.3g} ({evaluations:.0f}, {setting})")
        rows.append(row)
    return table(["code", *(f"{accuracy:.0e} m" for accuracy in ACCURACIES)], rows)


def draw_motions(figures: dict, file: Path) -> None:
    """Draw error against time, settings that are dearer and worse than another left out."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    for code, points in find_motions(figures).items():
        front, best = [], float("inf")
        for error, ns, *_ in sorted(points, key=lambda point: point[1]):
            if error < best:
                front.append((ns / 1e6, error))
                best = error
        axes.loglog(*zip(*front, strict=True), marker="o", markersize=3, label=code)
    axes.set(
        xlabel="processor time of 5 s of motion [ms]",
        ylabel="largest error of the ring's position [m]",
        title="hexapod_bench: work and precision, one run on one machine",
    )
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=150)
    plt.close(figure)


def phases_table(figures: dict, prefix: str) -> str:
    """Phases of one evaluation in the order of their numbers."""
    rows = [
        (int(found[1]), [found[2], us(figure["ns"])])
        for name, figure in figures.items()
        if (found := re.fullmatch(re.escape(prefix) + r"(\d+) (.*)", name))
    ]
    return table(["phase", "µs"], [row for _, row in sorted(rows, key=lambda row: row[0])])


def legs_table(figures: dict) -> str:
    """Time of an evaluation against the number of legs, per code."""
    times: dict[str, dict[int, float]] = {}
    for name, figure in figures.items():
        found = re.fullmatch(r"legs_(\d+)/(.*)/(accelerations|with reactions)", name)
        if not found or figure.get("error", 0.0) > TRUSTED * 1e3:
            continue
        times.setdefault(f"{found[2]}, {found[3]}", {})[int(found[1])] = figure["ns"]
    counts = sorted({count for each in times.values() for count in each})
    rows = [[code, *(us(each.get(count)) for count in counts)] for code, each in times.items()]
    for row, each in zip(rows, times.values(), strict=True):
        low, high = min(each), max(each)
        slope = (each[high] - each[low]) / (high - low) if high > low else float("nan")
        row.append(us(slope))
    head = ["µs with so many legs", *map(str, counts), "a leg more"]
    return table(head, rows)


def aims_table(figures: dict, fmpy: dict[str, float]) -> str:
    """Compare what was reached with what is aimed at; dockloop counts by its fastest code."""

    def best(mechanism: str, what: str, *codes: str) -> float:
        """Least time [ns] of the codes whose names contain one of `codes`."""
        times = [
            figure["ns"]
            for name, figure in figures.items()
            if name.startswith(f"{mechanism}/")
            and name.endswith(f"/{what}")
            and any(code in name for code in codes)
            and figure.get("error", 0.0) < TRUSTED
        ]
        return min(times, default=float("nan"))

    def motion(accuracy: float, *codes: str) -> float:
        times = [
            ns
            for code, points in find_motions(figures).items()
            for error, ns, *_ in points
            if error <= accuracy and any(part in code for part in codes)
        ]
        return min(times, default=float("nan"))

    ours, peer = ("general", "kernel"), ("Pinocchio", "MuJoCo")
    alone = best("hexapod_bench", "accelerations", *ours)
    floor = best("hexapod_bench", "accelerations", FLOOR)
    engine = best("hexapod_bench", "with reactions", *peer)
    nested = best("crank_nested", "with reactions", *peer)
    docking = figures["docking/whole"]
    rows = [
        ("hexapod_bench, accelerations / floor", alone / floor, "<", 0.5),
        (
            "hexapod_bench, with reactions / floor's accelerations",
            best("hexapod_bench", "with reactions", *ours) / floor,
            "<",
            0.8,
        ),
        ("hexapod_bench, best engine / accelerations", engine / alone, ">", 25),
        (
            "crank_nested, best engine / accelerations",
            nested / best("crank_nested", "accelerations", *ours),
            ">",
            10,
        ),
        *(
            (
                f"5 s to {accuracy:.0e} m, Pinocchio / FMU",
                motion(accuracy, "Pinocchio") / motion(accuracy, "dockloop FMU"),
                ">",
                30,
            )
            for accuracy in ACCURACIES
        ),
        (
            "fmi2DoStep far from contact, median µs",
            figures["docking/step in phase 1"]["median"] / 1e3,
            "<",
            2,
        ),
        ("default docking, times real time", docking["times_real_time"], ">", 2000),
        (
            "the same through FMPy / C interface",
            fmpy["20 s in steps of 10 ms"] / docking["ns"],
            "<",
            3,
        ),
    ]
    cells = []
    for name, value, sign, aim in rows:
        met = value < aim if sign == "<" else value > aim
        verdict = "-" if math.isnan(value) else "yes" if met else "no"
        cells.append([name, f"{value:.3g}", f"{sign} {aim:g}", verdict])
    return table(["aim", "measured", "wanted", "met"], cells)


def fmu_table(figures: dict, fmpy: dict[str, float]) -> str:
    """What the FMU of the default docking costs its host."""
    rows = []
    for name, figure in figures.items():
        if not name.startswith(("docking/", "get/", "set", "set and get/")):
            continue
        notes = [
            f"{label} {figure[key]:{form}}"
            for key, label, form in (
                ("steps", "steps:", ".0f"),
                ("evaluations", "evaluations:", ".0f"),
                ("times_real_time", "times real time:", ".0f"),
                ("count", "variables:", ".0f"),
            )
            if key in figure
        ]
        notes += [f"{key} {us(figure[key])} µs" for key in ("median", "worst") if key in figure]
        rows.append([name, us(figure["ns"]), ", ".join(notes)])
    for name, ns in fmpy.items():
        floor = figures[{"20 s in steps of 10 ms": "docking/whole"}.get(name, name)]["ns"]
        rows.append([f"through FMPy: {name}", us(ns), f"times C interface: {ns / floor:.3g}"])
    return table(["default docking, 20 s in steps of 10 ms", "µs", ""], rows)


def describe_machine() -> str:
    """Name processor and compiler."""
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    model = re.search(r"model name\s*:\s*(.*)", text)
    family = re.search(r"cpu family\s*:\s*(.*)", text)
    compiler = subprocess.run(
        ["c++", "--version"], capture_output=True, text=True, check=False
    ).stdout.split("\n")[0]
    name = model[1] if model else platform.machine()
    return f"{name}{f' (family {family[1]})' if family else ''}, {compiler}"


def write_report(results: dict, folder: Path) -> None:
    """Write report.md, report.json and work_precision.png."""
    figures = results["figures"]
    draw_motions(figures, folder / "work_precision.png")
    codes = ["general"]
    codes += sorted({name.split("/")[1] for name in figures if "kernel/" in name})
    phase_titles = [
        (f"Phases of an evaluation: {mechanism}, general", f"{mechanism}/phase/")
        for mechanism in ("hexapod_bench", "crank_nested")
    ]
    for code in codes:
        if code != "general":
            title = f"Phases of an evaluation: hexapod_bench, {code}"
            phase_titles.append((title, f"hexapod_bench/{code}/"))
        title = f"Right-hand side of the default docking, {code}"
        phase_titles.append((title, f"idss_25t_350t/{code}/"))
    text = [
        "# Benchmarks",
        f"Made by `{results['command']}` on {results['date']}: {results['machine']}; "
        f"{results['rounds']} rounds, least times. Compare figures of one report only.",
        f"Codes: `general` is the core, a `kernel` a special code behind the same interface (here: "
        f"{', '.join(codes[1:]) or 'none'}), `{FLOOR}` the same mechanism reduced by hand in plain "
        "scalar C++ (the floor). Other engines always find cut forces along with accelerations; "
        "their error is the largest difference of an acceleration from that of dockloop.",
        "## Aims",
        aims_table(figures, results["fmpy"]),
        "## One evaluation: hexapod_bench",
        evaluations_table(figures, "hexapod_bench"),
        "## One evaluation: crank_nested (12 loops, nested)",
        evaluations_table(figures, "crank_nested"),
        "Planar loops leave two equations; other engines have the three of a point, one of them "
        "redundant.",
        "## 5 s of hexapod_bench: milliseconds for an accuracy",
        "Cheapest setting that reaches it: time in ms (evaluations, setting). Without an "
        "integrator of its own a code is moved by the same bare Runge-Kutta steps; the FMU has "
        "everything that it always has, output of the position included.",
        motions_table(figures),
        "![work and precision](work_precision.png)",
        "## Scaling with the number of legs",
        legs_table(figures),
        "## The FMU",
        fmu_table(figures, results["fmpy"]),
    ]
    for title, prefix in phase_titles:
        text += [f"## {title}", phases_table(figures, prefix)]
    (folder / "report.md").write_text("\n\n".join(text) + "\n")
    (folder / "report.json").write_text(json.dumps(results, indent=1) + "\n")


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", default=",".join(PEERS), help="comma-separated, or none")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=None)
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
        "machine": describe_machine(),
        "rounds": rounds,
        "fmpy": fmpy,
        "figures": figures,
    }
    write_report(results, folder)
    print(f"{paths.shown(folder / 'report.md')} ({time.monotonic() - began:.0f} s)")


if __name__ == "__main__":
    main()
