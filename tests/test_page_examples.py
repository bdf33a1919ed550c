"""Every example of the pages: commands run, JSON and TOML are read, programs end without an error.

1. Commands run block by block in a folder that has the files of which the pages speak. Long work is
   cut short by options at the end of the line (`SHORT`).
2. A list in JSON or TOML is taken by the reader of the product, in a mechanism to which it belongs.
   Connectors in XML are variables of a docking, with their units.
3. Programs in Python run as they stand.
4. Commands within sentences are parsed. Of `run` every scene, key and start value is set in a
   docking; `check` and `variables` run. With words in capitals, or without argument, a command is
   only a name.
5. A tutorial runs from its first line to its last: what is to be saved is saved, commands run, and
   print what the page shows.
6. What does not run here is in `ELSEWHERE`, with the reason; each entry is needed.
"""

import functools
import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import dockloop as dl
from dockloop import cli
from dockloop.base import paths
from dockloop.fmu.build import write_fmu
from dockloop.fmu.ssp import take_out
from dockloop.fmu.vehicle_fmu import NEEDED, THRUST, UNITS, read_row
from dockloop.scene.find import find_scene
from dockloop.scene.resolve import parse_value
from dockloop.studies.fits.trials import list_trials
from dockloop.sweeps import sampling
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import read_sweep
from dockloop.view.browser import find_browser
from programs import call
from test_words import list_files

DEFAULT = "idss_25t_350t"
TUTORIALS = "scripts/tutorials/"
WRITTEN = ("tests/validation/maps/", "modelDescription/trade/")  # by the command that they show

ELSEWHERE = {  # beginning of a line, or what is in it: why it does not run here
    r"scripts/(demo|test|bench|platforms|fuzz|site)\b": "sets up or tests the whole project",
    r"(cmake|ctest|cc|npm|npx|cp) ": "compiles, or fetches packages",
    r"build/release/": "a program for developers",
    r"build/example/": "tests/test_cpp.py",
    r"(\.venv/bin/)?pip install": "installs packages; tests/test_package.py",
    r"\.venv/bin/python (-m pytest|tests/)": "runs the tests",
    r"\.venv/bin/python scripts/examples/": "tests/test_examples.py, tests/test_ssp.py",
    r"\.venv/bin/dask ": "a server, started so by tests/mishaps.py",
    r"\.venv/bin/dockloop live ": "a server until Ctrl-C: tests/test_live.py",
    r".* --scheduler ": "needs a cluster: tests/test_sweep.py",
    r".* --rare ": "hundreds of dockings: tests/test_rare.py",
    r".*trade idss_25t_350t( --resume)? +#": "a quarter of an hour: tests/test_trade.py",
    r"(import zipfile|from ecospy|from fmpy.ssp|from pathlib)": "an importer: tests/test_ssp.py",
}
SHORT = {  # command: options that cut it short
    "run": ("--stop", "0.5"),
    "sweep": (),
    "review": ("--stop", "1", "--tolerance", "0.25", "--directions", "2"),
    "envelope": ("--stop", "1", "--tolerance", "0.25", "--coarse", "2", "--check", "0"),
    "map": ("--stop", "0.3", "--points", "3"),
    "trade": ("--stop", "0.5", "--tolerances", "1e-3"),
    "truth": ("--stop", "0.2"),
    "extremes": ("--random", "1"),
}
WHOLE = ("absorber_1d",)  # scenes that need no cut
NEEDS = {"--still": find_browser, "--film": lambda: find_browser() and shutil.which("ffmpeg")}
AROUND = {  # members of a list in JSON: the mechanism that has them, members that do not fit
    "forces": ("apda", ("forces", "failures", "sequence")),
    "failures": ("apda", ()),
    "leg_defaults": ("idss_hexapod", ()),
    "capture": ("probe_drogue", ("sequence",)),
    "patterns": ("hexapod", ("legs", "forces", "failures", "sequence")),
}


FITTED = ["slow", "fast"]  # tests of a list
SCENARIOS = "name;initial.closing_speed [mm/s];chaser.mass;solver.method\n"
SCENARIOS += "slow;50;20000;bdf\nlight;100;8000;\n"


class Block(NamedTuple):
    """An example of a page."""

    place: str
    language: str
    text: str


def list_blocks():
    """Return the fenced examples of all pages, and lines with commands that are indented."""
    blocks = []
    for name in (name for name in list_files() if name.endswith(".md")):
        if name.startswith(WRITTEN):
            continue
        text = (paths.ROOT / name).read_text(encoding="utf-8")
        fence = re.compile(r"^( *)```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
        for found in fence.finditer(text):
            line = text.count("\n", 0, found.start()) + 1
            body = re.sub(f"^{found[1]}", "", found[3], flags=re.MULTILINE)
            blocks.append(Block(f"{name}:{line}", found[2], body))
        plain = fence.sub("", text)
        lines = re.findall(r"^    ((?:\.venv|scripts|build|ctest)\b.*)", plain, re.MULTILINE)
        blocks += [Block(name, "sh", "\n".join(lines))] if lines else []
    return blocks


BLOCKS = list_blocks()


def list_lines(block):
    """Return the commands of a block, each on one line and without its remark."""
    lines = re.sub(r"\\\n\s*", " ", block.text).splitlines()
    return [line for line in lines if line.strip() and not line.startswith("#")]


def list_spoken():
    """Return the commands within sentences, each once, with a page that has it."""
    spoken = {}
    for name in (name for name in list_files() if name.endswith(".md")):
        text = (paths.ROOT / name).read_text(encoding="utf-8")
        text = re.sub(r"^( *)```(\w*)\n(.*?)^ *```", "", text, flags=re.MULTILINE | re.DOTALL)
        for found in re.findall(r"`(?:\.venv/bin/)?dockloop\s([^`]+)`", text):
            words = shlex.split(found)
            is_whole = len(words) > 1 and not words[1].startswith("-")
            if is_whole and not any(re.match(r"-?[A-Z]{3}", word) for word in words):
                spoken[tuple(words)] = name
    return spoken


SPOKEN = list_spoken()
OWN = ("own", "mine", "lever")  # names of what the reader makes


def find_reason(line):
    """Return why a line does not run here, or None."""
    return next((reason for text, reason in ELSEWHERE.items() if re.match(text, line)), None)


def choose(language):
    """Return the blocks of a language of which something runs here, but for tutorials."""
    chosen = [b for b in BLOCKS if b.language == language and not b.place.startswith(TUTORIALS)]
    if language == "sh":
        chosen = [b for b in chosen if any(not find_reason(line) for line in list_lines(b))]
    else:
        chosen = [b for b in chosen if not find_reason(b.text)]
    return [pytest.param(block, id=block.place) for block in chosen]


@pytest.fixture(scope="module")
def files(tmp_path_factory, runs):
    """A folder with the files of which pages speak."""
    folder = tmp_path_factory.mktemp("pages")
    for name in ("modelDescription", "tests", "scripts"):
        (folder / name).symlink_to(paths.ROOT / name)
    (folder / "build" / "fmu").mkdir(parents=True)
    shutil.copy(runs.fmu(DEFAULT), folder / "build" / "fmu" / f"{DEFAULT}.fmu")
    shutil.copy(runs.fmu(DEFAULT), folder / "own.fmu")
    (folder / "first_docking").mkdir()
    for name in ("mine.toml", "first_docking/first.toml"):
        shutil.copy(paths.SCENES / f"{DEFAULT}.toml", folder / name)
    measured = np.genfromtxt(
        paths.ROOT / "tests/data/measured_mujoco.csv", delimiter=",", names=True
    )
    time, axial, force = (
        measured[name] for name in ("time_s", "relativeaxial_mm", "captureforce1_N")
    )
    rows = np.column_stack([time, force / 4.4482216, axial / 25.4])  # s, lbf, in
    text = "\n".join(";".join(f"{x:.6g}" for x in row) for row in rows)
    (folder / "rig.csv").write_text("t;Fz;dx\n" + text.replace(".", ","))
    (folder / "scenarios.csv").write_text(SCENARIOS)
    tests = next(block.text for block in BLOCKS if block.text.startswith("[[test]]"))
    (folder / "tests.toml").write_text(tests)
    for name in FITTED:
        shutil.copy(paths.ROOT / "tests/data/measured_mujoco.csv", folder / f"{name}.csv")
    (folder / "map.toml").write_text(
        't = "time:s"\nFz = "capture.force[1]:lbf"\ndx = "relative.axial:in"\n'
    )
    docking = dl.Docking(DEFAULT)
    docking.step(0.1)
    (folder / "own.bin").write_bytes(docking.save())
    run = (sys.executable, "-m", "dockloop")
    for words in (
        ("run", DEFAULT, "--stop", "6", "-o", "own.csv"),
        ("sweep", "absorber_1d_speeds", "-o", "sweep/own.parquet"),
    ):
        subprocess.run([*run, *words, "--no-plots"], cwd=folder, check=True, capture_output=True)
    (folder / "sweep" / "own.parquet").rename(folder / "own.parquet")
    scene = dl.Scene(DEFAULT)
    write_fmu(take_out(scene.document, "chaser"), scene.path, folder / "vehicle.fmu", bare=True)
    (map_of_names,) = (
        b.text for b in BLOCKS if b.language == "toml" and "[chaser.start]" in b.text
    )
    (folder / "names.toml").write_text(map_of_names)
    describe_vehicle(tomllib.loads(map_of_names)["chaser"], folder / "tug.fmu")
    moved = [f"--outputs=chaser.{name}" for name in ("position", "velocity", "attitude")]
    moved += ["--outputs=chaser.angular_velocity", "--stop", "1", "--no-plots", "-o", "host.csv"]
    subprocess.run([*run, "run", DEFAULT, *moved], cwd=folder, check=True, capture_output=True)
    return folder


def describe_vehicle(rows, to):
    """Write an FMU with the variables that a map names; it has no library."""
    causalities = {**NEEDED, **THRUST}
    members = [(m, causalities[m], row) for m, row in rows.items() if m != "start"]
    members += [(m, "parameter", row) for m, row in rows["start"].items()]
    variables = ""
    for member, causality, row in members:
        for name in read_row(member, member, row):
            more = 'variability="fixed" initial="exact"' if causality == "parameter" else ""
            start = 'start="1"' if causality != "output" else ""
            variables += (
                f'<ScalarVariable name="{name}" valueReference="0" causality="{causality}" {more}>'
                f'<Real unit="{UNITS[member]}" {start}/></ScalarVariable>'
            )
    with zipfile.ZipFile(to, "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            '<fmiModelDescription fmiVersion="2.0"><CoSimulation modelIdentifier="own"/>'
            f"<ModelVariables>{variables}</ModelVariables></fmiModelDescription>",
        )


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    """A copy of these files; shipped sweeps have 8 cases of 3 s."""
    shutil.copytree(files, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.setattr(sampling, "SWEEPS", tmp_path / "short")
    (tmp_path / "short").mkdir()
    for sweep in paths.SWEEPS.glob("*.toml"):
        text = re.sub(r"^cases = \d+", "cases = 8", sweep.read_text(), flags=re.MULTILINE)
        text = re.sub(r"^stop = 25.0", "stop = 3.0", text, flags=re.MULTILINE)
        (tmp_path / "short" / sweep.name).write_text(text)
    return tmp_path


@pytest.mark.long
@pytest.mark.parametrize("block", choose("sh"))
def test_the_commands_of_a_page_run(dockloop, folder, block):
    for line in list_lines(block):
        if find_reason(line):
            continue
        program, command, *words = shlex.split(line, comments=True)
        assert program in (".venv/bin/dockloop", "dockloop"), line
        if not all(found() for option, found in NEEDS.items() if option in words):
            continue
        cut = () if words[0] in WHOLE else SHORT.get(command, ())
        dockloop.succeed(command, *words, *cut)


@pytest.mark.parametrize("words", [pytest.param(w, id=" ".join(w)[:60]) for w in SPOKEN])
def test_the_commands_within_sentences_are_understood(words, dockloop):
    options = cli._make_parser(words).parse_args(words)
    name = Path(words[1]).stem
    if name in OWN or SPOKEN[words].startswith("tests/validation/random_"):
        return  # made by the reader; drawn at random, of which some are refused
    if words[0] == "run":
        overrides = dict(text.split("=", 1) for text in options.overrides)
        docking = dl.Docking(name, {key: parse_value(v) for key, v in overrides.items()})
        for setting in options.set:
            key, _, value = setting.rpartition("=")
            docking.set(key, parse_value(value))
    elif words[0] in ("check", "variables") and "-o" not in words:
        assert dockloop(*words).status == 0


@pytest.mark.parametrize("block", choose("json"))
def test_the_reader_of_mechanisms_takes_what_a_page_shows(block):
    if block.text.startswith("{"):
        document = json.loads(block.text)
    else:
        members = json.loads(f"{{{block.text}}}")
        name, others = AROUND[next(iter(members))]
        around = json.loads((paths.MECHANISMS / f"{name}.json").read_text())
        document = {k: v for k, v in around.items() if k not in others} | members
    assert dl.check(document)["degrees_of_freedom"] >= 1


@pytest.mark.parametrize("block", choose("toml"))
def test_the_reader_of_sweeps_takes_what_a_page_shows(block, tmp_path):
    members = tomllib.loads(block.text)
    if "start" in members.get("chaser", {}):
        return  # a map of names: a command of its page reads it
    if "test" in members:  # of a fit
        assert [trial.name for trial in list_trials(members["test"], is_plan=False)] == FITTED
        return
    if members.keys() & {"chaser", "force"}:  # of a scene
        scene = tomllib.loads(find_scene(DEFAULT).read_text())
        chaser = scene["chaser"] | members.get("chaser", {})
        dl.Docking(scene | members | {"chaser": chaser}).step(0.01)
        return
    (tmp_path / "mine.toml").write_text(block.text)
    (tmp_path / "scenarios.csv").write_text(SCENARIOS)
    sweep = read_sweep(str(tmp_path / "mine.toml"))
    assert len(sweep.cases) == (2 if "scenarios.csv" in block.text else 256 * 3 * 2)
    assert Planner(sweep).quantities


@pytest.mark.long
@pytest.mark.parametrize("block", choose("python"))
def test_the_programs_of_a_page_run(block, folder):
    said = call(sys.executable, "-c", block.text, cwd=folder)
    if block.place.startswith("README.md"):
        assert 100 < float(said.split()[-2]) < 3500  # N, below the rated load


MANY = r"(?<=^cases = )\d{4,}"  # of a tutorial: as many as a test has time for
FEW = "160"


def save(path, block):
    """Save what a tutorial shows: a file, members to add, or keys to change."""
    old = path.read_text() if path.exists() else ""
    if path.suffix == ".json":
        members = json.loads(block if block.startswith("{") else f"{{{block}}}")
        block = json.dumps(json.loads(old or "{}") | members)
    elif old:
        key = block.split()[0]
        block = re.sub(rf"^{key} = .*\n", block, old, flags=re.MULTILINE)
    path.write_text(re.sub(MANY, FEW, block, flags=re.MULTILINE))


def is_alike(shown, printed):
    """Return whether a word is the printed one; numbers agree within 2 %, or are rounding."""
    bare = [word.strip("(),;:%") for word in (shown, printed)]
    try:
        a, b = map(float, bare)
    except ValueError:
        return shown == printed
    return abs(a - b) <= 0.02 * abs(b) or max(abs(a), abs(b)) < 1e-9


def is_printed(line, text):
    """Return whether the words of a line stand in a text one after the other."""
    shown, printed = line.split(), text.split()
    return any(all(map(is_alike, shown, printed[i:])) for i in range(len(printed) - len(shown) + 1))


@pytest.mark.long
@pytest.mark.parametrize("page", [p for p in list_files() if p.startswith(TUTORIALS)])
def test_a_tutorial_runs_from_its_first_line_to_its_last(page, dockloop, own_folder):
    (own_folder / "tests").symlink_to(paths.ROOT / "tests")
    parts = re.split(r"^```(\w*)\n(.*?)^```", (paths.ROOT / page).read_text(), flags=re.M | re.S)
    printed, shown = "", 0

    run_python = functools.partial(call, sys.executable)
    for before, language, block in zip(parts[::3], parts[1::3], parts[2::3], strict=False):
        names = re.findall(rf"`(\w+\.{language.replace('python', 'py')})`", before)
        if language == "text":
            missing = [line for line in block.splitlines() if not is_printed(line, printed)]
            assert not missing, (missing, printed)
            shown += 1
        elif names:
            save(own_folder / names[-1], block)
        elif language == "python":
            run_python("-c", block)
        elif language == "sh":
            printed = ""
            for line in list_lines(Block(page, language, block)):
                program, *words = shlex.split(line, comments=True)
                if program == ".venv/bin/python":
                    printed += run_python(*words)
                elif not find_reason(line):
                    outcome = dockloop.succeed(*words)
                    printed += outcome.out
    assert shown


def test_words_that_were_not_printed_are_found():
    printed = "load peak\ntension 755.1 N (3.0e-14)"
    assert is_printed("tension 750 N", printed)
    assert is_printed("peak tension 755.1 N (9e-15)", printed)
    assert not is_printed("tension 700 N", printed)
    assert not is_printed("shear 755.1 N", printed)


def test_every_entry_of_what_runs_elsewhere_is_needed():
    lines = [line for b in BLOCKS if b.language == "sh" for line in list_lines(b)]
    lines += [b.text for b in BLOCKS if b.language == "python"]
    unused = [text for text in ELSEWHERE if not any(re.match(text, line) for line in lines)]
    assert not unused
    assert len(choose("sh")) > 15
    assert {block.language for block in BLOCKS} == {"", "sh", "text", "json", "toml", "python"}
