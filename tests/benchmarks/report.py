"""The report of the benchmarks: tables in Markdown, the figures as JSON, a plot.

Figures are what `benchmarks.bench` measured: per name its least time ``ns`` and what else it
reported about it (``error``, ``evaluations``...). Names: ``MECHANISM/CODE/WHAT`` for evaluations,
``CODE/METHOD/SETTING`` for motions, and those of ``fmu_bench``.
"""

import json
import math
import platform
import re
import subprocess
from pathlib import Path

import matplotlib as mpl

ACCURACIES = (1e-4, 1e-6, 1e-8, 1e-10)  # m
TRUSTED = 1e-6  # relative error of accelerations, beyond which a time has no meaning
FLOOR = "hand-written"


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
    for code, reported in sorted(
        codes.items(), key=lambda item: min(x["ns"] for x in item[1].values())
    ):
        error = next((x["error"] for x in reported.values() if "error" in x), None)
        trusted = error is None or error < TRUSTED

        def ratio(what, reported=reported):
            return (
                f"{reported[what]['ns'] / floor[what]['ns']:.2f}"
                if what in reported and what in floor
                else "-"
            )

        rows.append(
            [
                code if trusted else f"{code} (accelerations wrong)",
                *(
                    us(reported[what]["ns"]) if what in reported else "-"
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
    motions = find_motions(figures).items()
    for code, points in sorted(motions, key=lambda item: min(point[1] for point in item[1])):
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
    """Draw error against time, settings that are more expensive and worse than another left out."""
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
    times = dict(sorted(times.items(), key=lambda item: min(item[1].values())))
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
    codes += sorted({x for name in figures for x in name.split("/") if x.endswith(" kernel")})
    phase_titles = [
        (f"Phases of an evaluation: {mechanism}, general", f"{mechanism}/phase/")
        for mechanism in ("hexapod_bench", "crank_nested")
    ]
    for code in codes:
        if code != "general":
            title = f"Phases of an evaluation: hexapod_bench, {code}"
            phase_titles.append((title, f"hexapod_bench/{code}/"))
        for scene in ("idss_25t_350t", "hexapod_bench"):
            title = f"Right-hand side of the scene {scene}, {code}"
            phase_titles.append((title, f"rates of {scene}/{code}/"))
    text = [
        "# Benchmarks",
        f"Made by `{results['command']}` on {results['date']}: {results['machine']}; "
        f"{results['rounds']} rounds, least times. Compare figures of one report only.",
        "Codes: `general` is the core. A `kernel` is a special code behind the same interface"
        f" (here: {', '.join(codes[1:]) or 'none'}). `{FLOOR}` is the same mechanism reduced by"
        " hand in plain scalar C++ (the floor). Other engines always find cut forces along with"
        " accelerations; their error is the largest difference of an acceleration from that of"
        " dockloop.",
        "## Aims",
        aims_table(figures, results["fmpy"]),
        "## One evaluation: hexapod_bench",
        evaluations_table(figures, "hexapod_bench"),
        "## One evaluation: crank_nested (12 loops, nested)",
        evaluations_table(figures, "crank_nested"),
        "Planar loops leave two equations; other engines have the three of a point, one of them "
        "redundant.",
        "## One evaluation: the ring of hexapod_bench on crank legs, R1R2R3 and R1R2R3_perp",
        evaluations_table(figures, "hexapod_r1r2r3"),
        evaluations_table(figures, "hexapod_r1r2r3_square"),
        "## 5 s of hexapod_bench: milliseconds for an accuracy",
        "Cheapest setting that reaches it: time in ms (evaluations, setting). Without an "
        "integrator of its own a code is moved by the same bare Runge-Kutta steps. The FMU has "
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
