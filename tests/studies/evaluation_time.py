"""What one evaluation costs, now and in an earlier version: tests/validation/evaluation_time.md.

An evaluation is the fastest that the version has for the purpose: the earlier one has special code
for legs and generated code, and its general one. Programs of `tests/benchmarks` and FMUs of both
versions take turns, round after round, and the least time of each counts. The docking is that of
the earlier version in both.

Examples:
    git clone . ../before && git -C ../before checkout 3d3eb40    # before one evaluation
    ../before/scripts/bench --peers none --quick                    # compiles it
    cmake --build ../before/build/release --target dockloop-kernel
    scripts/bench --peers none --quick
    .venv/bin/python tests/studies/evaluation_time.py --before ../before     # ten minutes
"""

import json
import re
import resource
import shutil
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import NamedTuple

from dockloop.base.paths import COMPILED, ROOT
from dockloop.base.progress import ProgressBar
from dockloop.fmu.kernel import FLAGS
from page import Table, call, find_commit, make_parser, write_page

PAGE = ROOT / "tests" / "validation" / "evaluation_time.md"
SCENE = "idss_25t_350t"
ROUNDS = 8
OTHER_CODE = ("hand-written", "phase", "no closed forms")  # no evaluation of the core
REFERENCE = (
    "hexapod_bench",
    "--step",
    "0.01",
    "--output",
    "ring.position[1]",
    "--tolerance",
    "1e-22",
)
SPANS = (0.01, 20.0)  # [s] of motion with 32 digits: start and end of the program count in both
FMU_HOST = COMPILED / "fmu_bench"  # a host like any other, for both versions
QUICK = ["--benchmark_min_time=0.03", "--benchmark_format=json"]


class Row(NamedTuple):
    """A row of the page: its title, the pattern of its figures, its aim."""

    title: str
    pattern: str
    aim: str


ROWS = (
    Row("`hexapod_bench`, accelerations", r"hexapod_bench/.*/accelerations", "<= 1.1"),
    Row("`hexapod_bench`, with reactions", r"hexapod_bench/.*/with reactions", "<= 1.1"),
    Row("crank legs, accelerations", r"hexapod_r1r2r3/.*/accelerations", "<= 1.1"),
    Row("square crank legs, accelerations", r"hexapod_r1r2r3_square/.*/accelerations", "<= 1.1"),
    Row("`crank_nested`, accelerations", r"crank_nested/.*/accelerations", "<= 1.1"),
    Row("docking, right-hand side, apart", r"rates/.*/1 whole", "<= 1.1"),
    Row("docking, right-hand side, surfaces near", r"rates/.*/8 whole, surfaces near", "<= 1.1"),
    Row("docking, right-hand side, in contact", r"rates/.*/9 whole, in contact", "<= 1.1"),
    Row("docking, eight columns of a Jacobian", r"rates/.*/eight derivatives", "<= 0.25"),
    Row("docking, a derivative of model exchange", r"exchange/derivative", "<= 0.25"),
    Row("docking, 10 ms of a driven chaser", r"driven/step", "<= 1.1"),
    Row("docking, 10 ms of a free chaser", r"free/step", "<= 1.1"),
    Row("`hexapod_bench`, an evaluation with 32 digits", r"digits/evaluation", "<= 0.25"),
)


class Version:
    """A clone with its compiled programs, and the files that they measure."""

    def __init__(self, clone: Path, scene: Path, folder: Path) -> None:
        self.programs = clone / "build" / "release"
        for name in ("mechanism_bench", "rates_bench", "dockloop-kernel"):
            if not (self.programs / name).exists():
                raise SystemExit(f"{self.programs / name} is not compiled: see --help")
        self.command = clone / ".venv" / "bin" / "dockloop"
        self.scene = scene
        self.folder = folder
        self.mechanisms = [
            clone / "modelDescription" / "mechanisms" / "hexapod_bench.json",
            *(clone / "build" / "bench" / f"hexapod_r1r2r3{kind}.json" for kind in ("", "_square")),
            self.add_kernel(clone / "tests" / "data" / "crank_nested.json"),
        ]
        self.free = self.unpack("free")
        self.driven = self.unpack("driven", "--scene", "chaser.motion=driven")

    def add_kernel(self, mechanism: Path) -> str:
        """Make the generated code of a mechanism; return the argument for its benchmark."""
        source, kernel = self.folder / "kernel.c", self.folder / "kernel.so"
        source.write_text(call(self.programs / "dockloop-kernel", "mechanism", mechanism))
        call("cc", *FLAGS, "-o", kernel, source, "-lm")
        return f"{mechanism},{kernel}"

    def unpack(self, name: str, *options: str) -> Path:
        """Build an FMU of the docking and unpack it."""
        fmu, folder = self.folder / f"{name}.fmu", self.folder / name
        call(self.command, "build", self.scene, "-o", fmu, *options)
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
        return folder

    def measure(self) -> dict[str, float]:
        """Return one round of figures [ns]."""
        found: dict[str, float] = {}
        skipped = "|".join(OTHER_CODE)
        for name, files, prefix in (
            ("mechanism_bench", self.mechanisms, ""),
            ("rates_bench", [self.free / "resources" / "model.json"], "rates/"),
        ):
            for item in json.loads(call(self.programs / name, *files, *QUICK))["benchmarks"]:
                if not re.search(skipped, item["name"]):
                    found[prefix + item["name"]] = item["cpu_time"]
        for name, what in (("free", "docking"), ("driven", "docking"), ("free", "exchange")):
            said = json.loads(call(FMU_HOST, what, getattr(self, name), "--quick"))
            for item in said["benchmarks"]:
                if item["name"] == "docking/whole":
                    found[f"{name}/step"] = item["cpu_time"] / item["steps"]
                    found[f"{name}/evaluations"] = item["evaluations"]
                if what == "exchange":
                    found[item["name"]] = item["cpu_time"]
        found["digits/evaluation"] = self.time_digits()
        return found

    def time_digits(self) -> float:
        """Return the processor time of an evaluation with 32 digits [ns]."""
        seconds, evaluations = [], []
        for stop in SPANS:
            file = self.folder / f"reference_{stop}.json"
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            call(self.command, "truth", *REFERENCE, "--stop", stop, "-o", file)
            seconds.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
            evaluations.append(json.loads(file.read_text())["work"]["evaluations"])
        return 1e9 * (seconds[1] - seconds[0]) / (evaluations[1] - evaluations[0])


def find_least(rounds: list[dict[str, float]], pattern: str) -> tuple[float, str]:
    """Return the least time of the figures of a row, and the code that has it."""
    best = (float("inf"), "")
    for figures in rounds:
        for name, value in figures.items():
            if re.fullmatch(pattern, name):
                code = re.findall(r"general|leg kernel|generated kernel", name)
                best = min(best, (value, code[0] if code else ""))
    return best


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument(
        "--before", type=Path, required=True, metavar="CLONE", help="an earlier version, compiled"
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N")
    options = parser.parse_args()
    clones = (options.before.resolve(), ROOT)
    report = ProgressBar("rounds")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(clones[0] / "modelDescription", folder / "modelDescription")
        scene = folder / "modelDescription" / "scenes" / f"{SCENE}.toml"
        versions = []
        for i, clone in enumerate(clones):
            (folder / str(i)).mkdir()
            versions.append(Version(clone, scene, folder / str(i)))
        rounds: list[list[dict[str, float]]] = [[], []]
        for k in range(options.rounds):
            for version, figures in zip(versions, rounds, strict=True):
                figures.append(version.measure())
            report((k + 1) / options.rounds)
    table = Table("what", "before [µs]", "now [µs]", "now / before", "aim", "fastest code")
    for row in ROWS:
        (before, old_code), (now, new_code) = (find_least(each, row.pattern) for each in rounds)
        codes = f"{old_code} / {new_code}" if old_code else ""
        table.add(
                row.title, f"{before / 1e3:.3g}", f"{now / 1e3:.3g}", f"{now / before:.2f}",
                row.aim, codes,
            )  # fmt: skip
    counts = [
        " and ".join(f"{figures[0][f'{kind}/evaluations']:,.0f}" for kind in ("driven", "free"))
        for figures in rounds
    ]
    write_page(
        options.output,
        "Time of an evaluation, then and now",
        " ".join(["tests/studies/evaluation_time.py", *sys.argv[1:]]),
        f"Before: commit {find_commit(clones[0])}, with special code for legs and a general"
        f" one. Now: commit {find_commit()}, with one evaluation for all. By turns, least of"
        f" {options.rounds} rounds. The aims are those of the change to one evaluation: nothing"
        " slower by more than 10 %, and what had only the general code before four times faster.",
        table,
        f"Evaluations of 20 s with a driven and a free chaser: {counts[0]} before, {counts[1]}"
        " now. So the times of steps also show what has changed in methods, events and outputs.",
    )


if __name__ == "__main__":
    main()
