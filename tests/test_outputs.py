"""Files that commands write: none of another program is replaced, none is left half written.

1. Whatever stands where a command would write, and was not made by it, stays as it is, and nothing
   is done: every file of every command, against every kind of file.
2. What a command made it makes again; what another command made it does not.
3. A write that fails leaves the old file or none, and no rest next to it.
4. A place that cannot be written is reported before the work.
"""

import errno
import json
import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from matplotlib.figure import Figure
from pyarrow import parquet

from dockloop.base import files as outputs
from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError

SWEEP = ["sweep", "absorber_1d_speeds", "--engine", "core", "--workers", "1"]
SOLUTION = ["truth", "absorber_1d", "--output", "gap", "--stop", "0.1", "--step", "0.1"]
TRADE = ["trade", "absorber_1d", "--quick", "--methods", "explicit", "--stop", "0.1"]
RUN = ["run", "absorber_1d", "--stop", "0.1"]

# What a command is given, and the files that it writes.
COMMANDS = {
    "run": (
        [*RUN, "-o", "own.csv"],
        [
            *("own.csv", "own_summary.json"),
            *(f"own_{name}.png" for name in ("motion", "loads", "energy")),
        ],
    ),
    "run view": (
        [*RUN, "-o", "own.csv", "--no-plots", "--view"],
        ["own.csv", "own_summary.json", "own_view.html"],
    ),
    "run npz": ([*RUN, "-o", "own.npz", "--no-plots"], ["own.npz", "own_summary.json"]),
    "sweep": (
        [*SWEEP, "-o", "own.parquet", "--csv"],
        [
            *("own.parquet", "own.jsonl", "own.csv", "own_summary.json"),
            *("own_envelope.png", "own_loads.png"),
        ],
    ),
    "trade": (
        [*TRADE, "-o", "own"],
        [f"own/{name}" for name in ("trade.csv", "trade.md", "trade.jsonl", "work_precision.png")],
    ),
    "truth": ([*SOLUTION, "-o", "own.json"], ["own.json"]),
    "linearise": (
        ["linearise", "absorber_1d", "--at", "0.2", "-o", "own.json"],
        ["own.json", "own.png"],
    ),
    "build": (["build", "absorber_1d", "-o", "own.fmu"], ["own.fmu"]),
    "build reference": (
        ["build", "absorber_1d", "--reference", "-o", "own.fmu"],
        ["own.fmu"],
    ),
    "ssp": (["ssp", "idss_25t_350t", "-o", "own.ssp"], ["own.ssp"]),
}
TARGETS = [(name, file) for name, (_, files) in COMMANDS.items() for file in files]


def write_figure(path):
    Figure().savefig(path, format="png")


def write_table(path):
    parquet.write_table(pyarrow.table({"a": [1]}), path)


FOREIGN = {
    "mechanism": lambda path: shutil.copy(paths.MECHANISMS / "absorber_1d.json", path),
    "scene": lambda path: shutil.copy(paths.SCENES / "absorber_1d.toml", path),
    "empty": lambda path: path.write_bytes(b""),
    "no newline": lambda path: path.write_text("notes of mine"),
    "binary": lambda path: path.write_bytes(bytes(range(256))),
    "columns": lambda path: path.write_text("time,chaser.position[1],mine\n0,1,2\n"),
    "json lines": lambda path: path.write_text('{"a": 1}\n{"a": 2}\n'),
    "arrays": lambda path: np.savez(path.open("wb"), names=["time"], values=[1]),
    "figure": write_figure,
    "table": write_table,
    "zip": lambda path: shutil.make_archive(path.with_suffix(""), "zip", path.parent),
    "other command": lambda path: path.write_text('{"made_by": "dockloop extremes"}\n'),
}


def snapshot(folder: Path) -> dict:
    """Everything below a folder: content of files, targets of links."""
    return {
        str(path.relative_to(folder)): path.readlink()
        if path.is_symlink()
        else path.read_bytes()
        if path.is_file()
        else None
        for path in sorted(folder.rglob("*"))
    }


def assert_stopped(outcome, folder, before, *words):
    """One sentence with `words`, and the folder is as it was."""
    assert outcome.status == 2, outcome
    assert outcome.err.count("\n") == 1, outcome.err
    assert "defect" not in outcome.err
    assert outcome.out == ""
    for word in words:
        assert word in outcome.err, outcome.err
    assert snapshot(folder) == before


# ---------------------------------------------------------------- foreign files


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize(("command", "file"), TARGETS)
def test_a_foreign_file_stays_and_nothing_is_done(dockloop, tmp_path, command, file, kind):
    target = tmp_path / file
    target.parent.mkdir(parents=True, exist_ok=True)
    FOREIGN[kind](target)
    if kind == "zip":
        target.with_suffix(".zip").rename(target)
    before = snapshot(tmp_path)
    assert target.is_file()
    words = [file, "choose another -o", "did not write"]
    assert_stopped(dockloop(*COMMANDS[command][0]), tmp_path, before, *words)


def test_the_mechanism_next_to_a_scene_survives_its_run_and_its_sweep(dockloop, tmp_path):
    """The file that `run own.toml -o own.csv` once replaced."""
    mechanism = shutil.copy(paths.MECHANISMS / "absorber_1d.json", tmp_path / "own.json")
    text = (paths.SCENES / "absorber_1d.toml").read_text().replace('"absorber_1d"', '"own"')
    (tmp_path / "own.toml").write_text(text)
    sweep = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    (tmp_path / "many.toml").write_text(sweep.replace('"absorber_1d"', '"own.toml"'))
    dockloop.succeed("run", "own.toml", "--stop", "0.1", "-o", "own.csv")
    assert json.loads((tmp_path / "own_summary.json").read_text())["scene"] == "own"
    dockloop.succeed("sweep", "many.toml", "--no-plots", "-o", "many.parquet")
    assert json.loads((tmp_path / "many_summary.json").read_text())["sweep"] == "many"
    assert mechanism.read_text() == (paths.MECHANISMS / "absorber_1d.json").read_text()
    before = snapshot(tmp_path)
    refused = dockloop("truth", "own.toml", "--output", "gap", "-o", "own.json")
    assert_stopped(refused, tmp_path, before, "own.json: is a mechanism", "choose another -o")
    refused = dockloop("build", "own.toml", "-o", "own.toml")
    assert_stopped(refused, tmp_path, before, "own.toml: is a scene", "choose another -o")


@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_made_it_makes_again(dockloop, tmp_path, command):
    arguments, files = COMMANDS[command]
    for _ in range(2):
        dockloop.succeed(*arguments)
        for file in files:
            assert (tmp_path / file).stat().st_size > 0, file
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.parametrize("is_installed", [False, True])
def test_only_a_clone_owns_its_build_folder(monkeypatch, tmp_path, is_installed):
    """The build folder of an installed package is one of the user's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(paths, "IS_INSTALLED", is_installed)
    monkeypatch.setattr(paths, "BUILD", Path("build"))
    file = tmp_path / "build" / "own.json"
    file.parent.mkdir()
    file.write_text("{}")
    if is_installed:
        with pytest.raises(UsageError, match="'dockloop run' did not write: choose another -o"):
            outputs.claim(file, outputs.json_kind("summary", "dockloop run"))
    else:
        outputs.claim(file, outputs.json_kind("summary", "dockloop run"))


def test_a_package_with_a_vehicle_of_another_author_stays(dockloop, tmp_path):
    command = ["ssp", "idss_25t_350t", "-o", "own.ssp"]
    assert dockloop(*command).status == 0
    assert dockloop(*command).status == 0
    with zipfile.ZipFile("own.ssp") as made, zipfile.ZipFile("other.ssp", "w") as other:
        for name in made.namelist():
            other.writestr(name, b"mine" if name == "resources/chaser.fmu" else made.read(name))
    Path("other.ssp").replace("own.ssp")
    before = snapshot(tmp_path)
    assert_stopped(dockloop(*command), tmp_path, before, "own.ssp")


def test_results_of_a_driven_vehicle_are_made_again(dockloop, tmp_path):
    command = ["run", "idss_25t_350t", "--scene", "chaser.motion=driven", "--stop", "0.1"]
    for _ in range(2):
        dockloop.succeed(*command, "--no-plots", "-o", "own.csv")


def test_a_result_by_an_fmu_goes_to_its_default_place_twice(dockloop, runs, tmp_path):
    for _ in range(2):
        dockloop.succeed("run", runs.fmu("absorber_1d"), "--stop", "0.1")
    folder = tmp_path / "build" / "results" / "absorber_1d"
    assert (folder / "absorber_1d_summary.json").is_file()


def test_files_of_another_command_are_foreign(dockloop, tmp_path):
    """Both would write own_summary.json and own_loads.png."""
    assert dockloop(*COMMANDS["run npz"][0]).status == 0
    before = snapshot(tmp_path)
    refused = dockloop(*COMMANDS["sweep"][0])
    assert_stopped(refused, tmp_path, before, "own_summary.json: is a file of 'dockloop run'")
    (tmp_path / "own.npz").rename(tmp_path / "else.npz")
    (tmp_path / "own_summary.json").unlink()
    assert dockloop(*COMMANDS["truth"][0]).status == 0
    before = snapshot(tmp_path)
    refused = dockloop("build", "absorber_1d", "-o", "own.json")
    assert_stopped(refused, tmp_path, before, "own.json: is a file of 'dockloop truth'")


def test_the_shipped_results_can_be_made_again():
    """`dockloop trade -o modelDescription/trade/NAME` replaces them."""
    from dockloop.studies.trades.report import KINDS

    for folder in sorted((paths.MODELS / "trade").iterdir()):
        for name, kind in KINDS.items():
            outputs.claim(folder / name, kind)


# ---------------------------------------------------------------- half written files


@pytest.mark.parametrize(
    ("command", "file"), [target for target in TARGETS if not target[1].endswith(".jsonl")]
)
def test_a_file_that_finds_no_space_does_not_get_its_name(
    dockloop, monkeypatch, tmp_path, command, file
):
    """Renaming, the last step of every write, finds none; test_sweep_journal.py has the journal."""
    real = Path.replace

    def replace(self, target):
        if Path(target) == tmp_path / file:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self))
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    reported = dockloop(*COMMANDS[command][0])
    assert reported.status == 1, reported
    has_journal = any(name.endswith(".jsonl") for name in COMMANDS[command][1])
    goes_on = "; the journal has all results: the same command with --resume goes on"
    assert reported.err == (
        f"dockloop: {file}: cannot be written (no space is left on the disk)"
        f"{goes_on if has_journal else ''}\n"
    )
    assert not (tmp_path / file).exists()
    assert not list(tmp_path.rglob("*.partial"))


KIND = outputs.json_kind("summary", "dockloop run")


@pytest.mark.parametrize("old", [None, '{"made_by": "dockloop run"}'])
def test_a_write_that_fails_in_the_middle_leaves_what_was_there(tmp_path, old):
    path = tmp_path / "own.json"
    if old:
        path.write_text(old)
    before = snapshot(tmp_path)

    def write(error):
        with outputs.writing(path, KIND) as partial:
            partial.write_text('{"made_')
            raise error

    with pytest.raises(DockloopError, match=r"own\.json: cannot be written \(no space is left"):
        write(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert snapshot(tmp_path) == before
    with pytest.raises(KeyboardInterrupt):
        write(KeyboardInterrupt())
    assert snapshot(tmp_path) == before


def test_a_file_that_comes_while_the_command_works_stays(tmp_path):
    path = tmp_path / "own.json"
    outputs.claim(path, KIND)
    path.write_text("notes of mine")
    with pytest.raises(UsageError, match="did not write"):
        outputs.write_text(path, KIND, '{"made_by": "dockloop run"}')
    assert path.read_text() == "notes of mine"


def test_a_link_stays_a_link_to_its_file(tmp_path):
    path, link = tmp_path / "there.json", tmp_path / "own.json"
    link.symlink_to("there.json")
    for text in ('{"made_by": "dockloop run"}', '{"made_by": "dockloop run", "a": 1}'):
        outputs.write_text(link, KIND, text)
        assert path.read_text() == text
        assert link.is_symlink()


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 16 kB, where the system lets this process have one."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = shutil.which("mount") or "mount"
    order = [mount, "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(order, capture_output=True, check=False).returncode:
        pytest.skip("a small disk can be had by root only")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("command", ["run", "sweep", "build", "build reference", "ssp"])
def test_on_a_disk_that_is_really_full_all_files_are_whole(dockloop, small_disk, command):
    arguments, files = COMMANDS[command]
    (small_disk / "filler").write_bytes(bytes(4096))
    reported = dockloop(*(f"small/{word}" if word in files else word for word in arguments))
    assert reported.status == 1, reported
    assert reported.err.count("\n") == 1, reported.err
    assert "cannot be written (no space is left on the disk)" in reported.err
    left = {path.name: path for path in small_disk.iterdir()}
    assert set(left) <= {"filler", "own.csv", "own.jsonl"}, left  # the journal is to go on with
    if "own.csv" in left:
        assert left["own.csv"].read_text().count("\n") == 12


# ---------------------------------------------------------------- places


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("place", ["folder", "below a file", "loop", "device", "nowhere"])
def test_a_place_that_cannot_be_written_is_reported_before_the_work(
    dockloop, tmp_path, command, place
):
    arguments, files = COMMANDS[command]
    if "-o" not in arguments:
        return
    first = tmp_path / files[0]
    chosen = arguments[arguments.index("-o") + 1]
    match place:
        case "folder":
            first.mkdir(parents=True)
        case "below a file":
            (tmp_path / "file").write_text("notes of mine")
            arguments = [f"file/{word}" if word == chosen else word for word in arguments]
        case "loop":
            first.parent.mkdir(exist_ok=True)
            first.symlink_to(first.name)
        case "device":
            first.parent.mkdir(exist_ok=True)
            first.symlink_to("/dev/null")
        case "nowhere":
            if not Path("/proc").is_dir():
                pytest.skip("no /proc here")
            arguments = [f"/proc/{word}" if word == chosen else word for word in arguments]
    before = snapshot(tmp_path)
    assert_stopped(dockloop(*arguments), tmp_path, before, "choose another -o")


@pytest.mark.usefixtures("permissions")
@pytest.mark.parametrize("command", ["run npz", "sweep", "trade", "truth", "build", "ssp"])
def test_a_folder_without_permission_is_reported_before_the_work(dockloop, tmp_path, command):
    arguments, _ = COMMANDS[command]
    tmp_path.chmod(0o555)
    try:
        before = snapshot(tmp_path)
        assert_stopped(dockloop(*arguments), tmp_path, before, "Permission denied")
    finally:
        tmp_path.chmod(0o755)


@pytest.mark.usefixtures("permissions")
def test_an_own_file_that_is_write_protected_stays(dockloop, tmp_path):
    arguments, (file, *_) = COMMANDS["run npz"]
    assert dockloop(*arguments).status == 0
    (tmp_path / file).chmod(0o444)
    before = snapshot(tmp_path)
    assert_stopped(dockloop(*arguments), tmp_path, before, f"{file}: is write-protected")
