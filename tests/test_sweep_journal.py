"""Sweeps: what their journals promise.

1. A sweep that ends by Ctrl-C, with a line torn in the middle, goes on with --resume to the same
   table with one worker, by either engine; a finished one with more cases.
2. The journal of another set-up, of an unfinished sweep, of other finished cases and that of
   another process are refused, and stay.
3. Damage: a line that was changed is reported once and its case is run again, all others are kept;
   a journal without its first line is refused, and stays.
4. A full disk loses nothing.
"""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from pyarrow import parquet

from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.files import cannot_write
from dockloop.runs.outcome import Result
from dockloop.sweeps import table as sweep_table
from dockloop.sweeps.journal import Journal
from mishaps import full_disk, lines_of, wait_for_lines
from small_sweeps import MANY, NAMED, SHORT, run_table, vary, write

pytestmark = pytest.mark.usefixtures("native")  # the bits of FMUs are compared with the core's

SPEEDS = ["sweep", "absorber_1d_speeds", "--no-plots", "-o", "mine.parquet"]


# ---------------------------------------------------------------- going on


@pytest.mark.parametrize("engine", ["core", "fmu"])
def test_an_interrupted_sweep_goes_on_to_the_same_table_with_one_worker(
    dockloop, reference, tmp_path, engine
):
    """Ctrl-C, then a line torn in the middle, then --resume: nothing twice, no bit different."""
    path, whole = reference
    output, journal = tmp_path / "mine.parquet", tmp_path / "mine.jsonl"
    command = ["sweep", str(path), "--engine", engine, "--workers", "1", "-o", str(output)]
    command.append("--no-plots")
    # Where tests run in the background, Ctrl-C is ignored, and that is inherited.
    program = ["env", "--default-signal=INT", sys.executable, "-m", "dockloop"]
    first = subprocess.Popen(
        [*program, *command], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_for_lines(journal, 3)
    os.killpg(first.pid, signal.SIGINT)  # as a terminal does: to all processes
    said = first.communicate(timeout=60)[1]
    assert first.returncode == 130, said
    assert said.count("\n") == 1, said
    assert "of 12 cases" in said, said
    assert "--resume" in said, said
    kept = lines_of(journal)
    assert 3 <= kept < 12, kept
    assert not output.exists()

    refused = dockloop(*command)
    assert refused.status == 2, refused
    assert f"holds {kept} of 12 cases" in refused.err, refused
    journal.write_bytes(journal.read_bytes()[:-10])
    summary = dockloop.read(*command, "--resume", "--json")
    assert summary["time"]["ran"] == 12 - (kept - 1)
    assert summary["time"]["workers"] == 1
    assert output.read_bytes() == whole.read_bytes()
    _, *lines = journal.read_text().splitlines()
    assert len({str(json.loads(line)["values"]) for line in lines}) == len(lines) == 12


def test_a_finished_sweep_goes_on_with_more_cases(cluster, reference, tmp_path):
    path, whole = reference
    more = write(tmp_path, SHORT.replace("cases = 12", "cases = 14"))
    journal = tmp_path / "mine.jsonl"
    journal.write_bytes((path.parent / "mine.jsonl").read_bytes())
    output = run_table(
        more, tmp_path / "mine.parquet", scheduler=cluster.scheduler_address, resume=True
    )
    both = [parquet.read_table(file).to_pylist() for file in (whole, output)]
    assert len(both[1]) == 14
    assert both[1][:12] == both[0]
    other = write(tmp_path, SHORT.replace("step = 0.25", "step = 0.5"))
    with pytest.raises(UsageError, match="made with another experiment"):
        run_table(other, tmp_path / "mine.parquet", resume=True)


def test_resume_makes_the_table_of_more_cases_and_of_those_that_it_had(dockloop, tmp_path):
    shipped = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    path, table = write(tmp_path, shipped), tmp_path / "t.parquet"
    command = ["sweep", str(path), "--no-plots", "-o", "t.parquet"]
    assert dockloop(*command).status == 0
    write(tmp_path, shipped.replace("0.05, 0.10", "0.05, 0.10, 0.11"))
    assert dockloop(*command).status == 2
    reported = dockloop(*command, "--resume", "--json")
    assert json.loads(reported.out)["time"]["ran"] == 4, reported.err
    assert dockloop(*command).status == 0  # it is the same sweep now
    assert parquet.read_table(table).num_rows == 12
    foreign = tmp_path / "else.parquet"
    assert dockloop("sweep", "absorber_1d_speeds", "--no-plots", "-o", str(foreign)).status == 0
    foreign.replace(table)
    (tmp_path / "t.jsonl").unlink()
    refused = dockloop(*command, "--resume")  # the table of fewer cases, but nothing to go on with
    assert refused.status == 2, refused
    assert "of another sweep" in refused.err


def test_a_journal_that_holds_nothing_needs_no_resume(dockloop):
    """What is left when there is no scheduler."""
    failed = dockloop(*SPEEDS, "--scheduler", "nonsense://x")
    assert failed.status == 2, failed
    assert "nonsense://x: must be an address like tcp://host:8786" in failed.err
    assert dockloop(*SPEEDS).status == 0


# ---------------------------------------------------------------- other journals


def test_the_finished_table_of_another_sweep_stays(dockloop, tmp_path):
    """Other cases, another seed, another scene, other outcomes; the same sweep is made again."""
    shipped = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    path, table, journal = write(tmp_path, shipped), tmp_path / "t.parquet", tmp_path / "t.jsonl"
    command = ["sweep", str(path), "--no-plots", "-o", "t.parquet"]
    assert dockloop(*command).status == 0
    before, lines = table.read_bytes(), journal.read_bytes()
    for old, new in (
        ("0.05, 0.10", "0.05, 0.11"),
        ("seed = 1", "seed = 2"),
        ("step = 0.5", "step = 0.25"),
        ('worst = "capture.peak.compression"', 'outcomes = ["outcome"]'),
        ("[experiment]", "[set]\n'solver.rtol' = 1e-9\n[experiment]"),
    ):
        assert old in shipped
        write(tmp_path, shipped.replace(old, new))
        for without in (None, journal, table):  # either is enough to know it
            held = without.read_bytes() if without else b""
            if without:
                without.unlink()
            refused = dockloop(*command)
            assert refused.status == 2, (refused, new)
            assert "of another sweep" in refused.err
            assert "choose another -o or delete" in refused.err
            assert refused.err.count("\n") == 1
            if without:
                assert not without.exists()
                without.write_bytes(held)
        assert (table.read_bytes(), journal.read_bytes()) == (before, lines)
    path.write_text(f"# a comment\n{shipped}")
    assert dockloop(*command).status == 0
    assert dockloop(*command, "--resume").status == 0


def test_another_meaning_of_a_named_case_is_another_sweep(dockloop, tmp_path):
    text = vary(NAMED, more="[experiment]\nstop = 1.0\nstep = 0.5")
    write(tmp_path, text)
    assert dockloop("sweep", "mine.toml", "--no-plots").status == 0
    write(tmp_path, text.replace("30e3", "31e3"))
    again = dockloop("sweep", "mine.toml", "--no-plots", "--resume")
    assert again.status != 0
    assert "another" in again.err or "differ" in again.err, again.err


def test_two_sweeps_do_not_write_one_journal(tmp_path):
    first = Journal(tmp_path / "a.jsonl", {}, 1, resume=False)
    with pytest.raises(UsageError, match="another sweep is writing it"):
        Journal(tmp_path / "a.jsonl", {}, 1, resume=True)
    first.close()


def test_another_dockloop_that_writes_the_journal_is_reported(tmp_path):
    """Also while the file is put in order."""
    journal = Journal(tmp_path / "a.jsonl", {}, 2, resume=False)
    journal.add((1.0,), Result("done"))
    journal.close()
    path = tmp_path / "a.jsonl"
    path.write_text(path.read_text() + "?\n")
    second = Journal(path, {}, 2, resume=True)
    with pytest.raises(UsageError, match="another sweep is writing it"):
        Journal(path, {}, 2, resume=True)
    second.add((2.0,), Result("done"))
    second.close()
    assert set(Journal(path, {}, 2, resume=True).known) == {(1.0,), (2.0,)}


def test_a_table_that_cannot_be_written_is_reported_before_the_first_case(
    dockloop, tmp_path, monkeypatch
):
    def fail(*_, **__):
        raise AssertionError("a case was run")

    monkeypatch.setattr("dockloop.sweeps.campaign.Campaign.run", fail)
    (tmp_path / "mine.parquet").mkdir()
    refused = dockloop(*SPEEDS)
    assert refused.status == 2, refused
    assert "mine.parquet: is a folder" in refused.err
    assert not (tmp_path / "mine.jsonl").exists()


# ---------------------------------------------------------------- damage


def change_figure(line: str) -> str:
    """One digit of an outcome."""
    place = line.index('"outputs"') + 20
    digit = next(i for i in range(place, len(line)) if line[i] in "123456789")
    return line[:digit] + str(10 - int(line[digit])) + line[digit + 1 :]


DAMAGE = {
    "figure": change_figure,
    "value": lambda line: line.replace('"values": [0.', '"values": [1.'),
    "status": lambda line: line.replace('"done"', '"nonsense"'),
    "checksum": lambda line: line[:-4] + '0"}' if line[-4] != "0" else line[:-4] + '1"}',
    "half": lambda line: line[: len(line) // 2],
    "empty": lambda line: "",
    "other": lambda line: '{"a": 1}',
    "binary": lambda line: "\x00\x01\x02",
    "list": lambda line: "[1, 2]",
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_changed_line_is_reported_once_and_only_its_case_is_run_again(dockloop, tmp_path, damage):
    assert dockloop(*SPEEDS).status == 0
    whole, journal = (tmp_path / "mine.parquet").read_bytes(), tmp_path / "mine.jsonl"
    lines = journal.read_text().splitlines()
    changed = DAMAGE[damage](lines[3])
    assert changed != lines[3]
    journal.write_text("\n".join([*lines[:3], changed, *lines[4:], ""]))
    refused = dockloop(*SPEEDS)
    assert refused.status == 2, refused
    assert "holds 7 of 8 cases" in refused.err
    reported = dockloop.succeed(*SPEEDS, "--resume", "--json")
    assert reported.err == (
        "dockloop: warning: mine.jsonl: line 4 is damaged or was changed: its case is run again\n"
    )
    assert json.loads(reported.out)["time"]["ran"] == 1
    assert (tmp_path / "mine.parquet").read_bytes() == whole
    again = dockloop(*SPEEDS, "--resume", "--json")
    assert (again.status, again.err) == (0, ""), again
    assert json.loads(again.out)["time"]["ran"] == 0
    assert sorted(journal.read_text().splitlines()[1:]) == sorted(lines[1:])


def test_many_changed_lines_are_reported_in_one(dockloop, tmp_path):
    assert dockloop(*SPEEDS).status == 0
    journal = tmp_path / "mine.jsonl"
    header, *lines = journal.read_text().splitlines()
    journal.write_text("\n".join([header, *("?" for _ in lines[:-1]), lines[-1], ""]))
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert "lines 2, 3, 4, 5, 6, 7, 8 are damaged" in reported.err
    assert reported.err.count("\n") == 1
    assert json.loads(reported.out)["time"]["ran"] == 7


def test_a_status_that_unknown_is_no_result(tmp_path):
    """Not even with the right checksum."""
    journal = Journal(tmp_path / "a.jsonl", {}, 2, resume=False)
    journal.add((1.0,), Result("done", outputs=(1.0,)))
    journal.add((2.0,), Result("nonsense"))
    journal.close()
    assert set(Journal(tmp_path / "a.jsonl", {}, 2, resume=True).known) == {(1.0,)}


def test_a_journal_without_its_first_line_is_refused(dockloop, tmp_path):
    assert dockloop(*SPEEDS).status == 0
    journal = tmp_path / "mine.jsonl"
    text = journal.read_text()
    journal.write_text(text.replace('"quantities"', '"quantitles"', 1))
    for more in ([], ["--resume"]):
        refused = dockloop(*SPEEDS, *more)
        assert refused.status == 2, refused
        assert "mine.jsonl: line 1 is damaged or was changed" in refused.err
        assert refused.err.count("\n") == 1
    assert journal.read_text() == text.replace('"quantities"', '"quantitles"', 1)


# ---------------------------------------------------------------- full disks


def test_a_table_without_space_comes_from_the_journal(dockloop, tmp_path, monkeypatch):
    command = ("sweep", str(write(tmp_path, MANY.format(cases=1))), "--no-plots", "--json")
    command += ("-o", str(tmp_path / "own.parquet"))

    def fail(*_, **__):
        raise cannot_write(tmp_path / "own.parquet", OSError(errno.ENOSPC, "full"))

    with monkeypatch.context() as full:
        full.setattr(sweep_table, "write_table", fail)
        failed = dockloop(*command)
    assert failed.status == 1, failed
    assert "no space is left on the disk); the journal has all results: the same" in failed.err
    assert dockloop.read(*command, "--resume")["time"]["ran"] == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_loses_no_case(dockloop, tmp_path):
    """First there is no space for the first line of the journal, then none for its fifth."""
    with full_disk(1, 6):
        for kept in (0, 3):
            reported = dockloop(*SPEEDS)
            assert reported.status == 1, reported
            assert reported.err == (
                "dockloop: mine.jsonl: cannot be written (no space is left on the disk); the same"
                " command with --resume goes on\n"
            )
            assert (tmp_path / "mine.jsonl").exists() == bool(kept)
            assert not (tmp_path / "mine.parquet").exists()
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert json.loads(reported.out)["time"]["ran"] == 8 - kept, reported
