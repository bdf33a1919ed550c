"""Sweeps: what their journals promise.

1. A sweep that ends by Ctrl-C or kill -9 goes on with --resume to the same table, by either engine;
   a finished one with more cases. Results are kept as they arrive, without waiting for the disk.
2. The journal of another set-up, of an unfinished sweep, of other finished cases, of another
   command and that of another process are refused, and stay.
3. Damage: a result that was changed is reported once, and only its case runs again; a file that is
   cut off or overwritten is refused with one sentence, and stays.
4. A full disk loses nothing.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

from pyarrow import parquet

from dockloop import journal as journals
from dockloop import paths
from dockloop.cases import Result
from dockloop.errors import UsageError
from dockloop.journal import Journal
from mishaps import change, count_results, full_disk, read_results
from small_sweeps import NAMED, SHORT, run_table, vary, write

SPEEDS = ["sweep", "absorber_1d_speeds", "--no-plots", "-o", "mine.parquet"]


# ---------------------------------------------------------------- going on


STOPPED = """
import os, signal, sys
from dockloop import cli
from dockloop.journal import Journal

def add(journal, values, result, real=Journal.add):
    real(journal, values, result)
    if len(journal) == 3:
        os.killpg(0, signal.SIG%s)  # as a terminal does: to all processes

Journal.add = add
sys.exit(cli.main())
"""


@pytest.mark.parametrize(("engine", "end"), [("core", "INT"), ("fmu", "INT"), ("core", "KILL")])
def test_a_stopped_sweep_goes_on_to_the_same_table_with_one_worker(
    dockloop, request, tmp_path, engine, end
):
    """Ctrl-C or kill -9, then --resume: nothing lost, nothing twice, no bit different."""
    if engine == "core":  # its compiler is another one than that of portable FMUs
        path, whole = write(tmp_path, SHORT), tmp_path / "whole.parquet"
        dockloop("sweep", str(path), "--engine", engine, "-o", str(whole), "--no-plots")
    else:
        path, whole = request.getfixturevalue("reference")
    output, journal = tmp_path / "mine.parquet", tmp_path / "mine.sqlite"
    command = ["sweep", str(path), "--engine", engine, "--workers", "1", "-o", str(output)]
    command.append("--no-plots")
    # Where tests run in the background, Ctrl-C is ignored, and that is inherited.
    program = ["env", "--default-signal=INT", sys.executable, "-c", STOPPED % end]
    first = subprocess.Popen(
        [*program, *command], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    said = first.communicate(timeout=600)[1]
    kept = count_results(journal)
    if end == "INT":
        assert first.returncode == 130, said
        assert said == (
            f"dockloop: interrupted with {kept} of 12 cases in mine.sqlite; the same command with"
            " --resume goes on\n"
        )
    assert 3 <= kept < 12, kept
    assert not output.exists()

    refused = dockloop(*command)
    assert refused.status == 2, refused
    assert f"holds {kept} of 12 cases" in refused.err, refused
    done = dockloop(*command, "--resume", "--json")
    assert done.status == 0, done
    summary = json.loads(done.out)
    assert summary["time"]["ran"] == 12 - kept
    assert summary["time"]["workers"] == 1
    assert output.read_bytes() == whole.read_bytes()
    assert count_results(journal) == 12


def test_a_finished_sweep_goes_on_with_more_cases(cluster, reference, tmp_path):
    path, whole = reference
    more = write(tmp_path, SHORT.replace("cases = 12", "cases = 14"))
    journal = tmp_path / "mine.sqlite"
    journal.write_bytes((path.parent / "mine.sqlite").read_bytes())
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
    (tmp_path / "t.sqlite").unlink()
    refused = dockloop(*command, "--resume")  # the table of fewer cases, but nothing to go on with
    assert refused.status == 2, refused
    assert "of another sweep" in refused.err


def test_results_are_kept_at_once_without_waiting_for_the_disk(tmp_path, monkeypatch):
    """A copy of the files holds what was added so far; the disk is forced once a second at most."""
    path = tmp_path / "a.sqlite"
    journal = Journal(path, {}, 3, resume=False)
    monkeypatch.setattr(journals, "_SYNC", float("inf"))
    before = path.read_bytes()
    for number in range(3):
        journal.add((number,), Result("done", outputs=(1.5,)))
        assert count_results(path) == number + 1
    assert path.read_bytes() == before  # the results are in the other file
    monkeypatch.setattr(journals, "_SYNC", 0.0)
    journal.add((3,), Result("done", outputs=(float("inf"),)))
    assert path.read_bytes() != before
    assert journal[3,] == Result("done", outputs=(float("inf"),))
    journal.close()
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert [journal[number,].outputs for number in range(3)] == [(1.5,)] * 3
    assert (len(journal), (4,) in journal) == (4, False)


def test_a_journal_that_holds_nothing_needs_no_resume(dockloop):
    """What is left when the scheduler cannot be reached."""
    failed = dockloop(*SPEEDS, "--scheduler", "nonsense://x")
    assert failed.status == 1, failed
    assert "cannot be reached" in failed.err
    assert dockloop(*SPEEDS).status == 0


# ---------------------------------------------------------------- other journals


def test_the_finished_table_of_another_sweep_stays(dockloop, tmp_path):
    """Other cases, another seed, another scene, other outcomes; the same sweep is made again."""
    shipped = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    path, table, journal = write(tmp_path, shipped), tmp_path / "t.parquet", tmp_path / "t.sqlite"
    command = ["sweep", str(path), "--no-plots", "-o", "t.parquet"]
    assert dockloop(*command).status == 0
    before, results = table.read_bytes(), journal.read_bytes()
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
        assert (table.read_bytes(), journal.read_bytes()) == (before, results)
    path.write_text(f"# a comment\n{shipped}")
    assert dockloop(*command).status == 0
    assert dockloop(*command, "--resume").status == 0


def test_another_meaning_of_a_named_case_is_another_sweep(dockloop, tmp_path):
    text = vary(NAMED, more="[experiment]\nstop = 1.0\nstep = 0.5")
    write(tmp_path, text)
    assert dockloop("sweep", "mine.toml", "--no-plots").status == 0
    write(tmp_path, text.replace("30e3", "31e3"))
    again = dockloop("sweep", "mine.toml", "--no-plots", "--resume")
    assert again.status == 2
    assert "made with another named_cases" in again.err, again.err


def test_the_journal_of_another_command_stays(tmp_path):
    path = tmp_path / "a.sqlite"
    Journal(path, {}, 1, resume=False, work="trade").close()
    before = path.read_bytes()
    for resume in (False, True):
        with pytest.raises(
            UsageError, match="a file of 'dockloop trade', which 'dockloop sweep' did"
        ):
            Journal(path, {}, 1, resume=resume)
    assert path.read_bytes() == before


def test_a_journal_of_an_earlier_version_stays(dockloop, tmp_path):
    """These were texts with another ending."""
    old = tmp_path / "mine.jsonl"
    old.write_text('{"made_by": "dockloop sweep"}\n')
    assert dockloop(*SPEEDS, "--resume").status == 0
    assert old.read_text() == '{"made_by": "dockloop sweep"}\n'


def test_two_sweeps_do_not_write_one_journal(tmp_path):
    path = tmp_path / "a.sqlite"
    first = Journal(path, {}, 2, resume=False)
    for _ in range(2):
        with pytest.raises(UsageError, match="another sweep is writing it"):
            Journal(path, {}, 2, resume=True)
        first.add((1.0,), Result("done"))
    first.close()
    second = Journal(path, {}, 2, resume=True)
    assert (1.0,) in second
    second.close()


WRITE = """
import time
from pathlib import Path
from dockloop.journal import Journal
journal = Journal(Path("mine.sqlite"), {}, 8, resume=False)
print("open", flush=True)
time.sleep(600)
"""


def test_another_process_that_writes_the_journal_is_reported(dockloop, tmp_path):
    """At once, with and without --resume; when it is dead its journal is free."""
    with subprocess.Popen([sys.executable, "-c", WRITE], stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        for more in ((), ("--resume",)):
            began = time.monotonic()
            refused = dockloop(*SPEEDS, *more)
            assert time.monotonic() - began < 30.0
            assert (refused.status, refused.err) == (
                2,
                "dockloop: mine.sqlite: another sweep is writing it\n",
            )
        other.kill()
    assert dockloop(*SPEEDS).status == 0


def test_a_table_that_cannot_be_written_is_reported_before_the_first_case(
    dockloop, tmp_path, monkeypatch
):
    def fail(*_, **__):
        raise AssertionError("a case was run")

    monkeypatch.setattr("dockloop.sweeps.run_cases", fail)
    (tmp_path / "mine.parquet").mkdir()
    refused = dockloop(*SPEEDS)
    assert refused.status == 2, refused
    assert "mine.parquet: is a folder" in refused.err
    assert not (tmp_path / "mine.sqlite").exists()


# ---------------------------------------------------------------- damage


def change_figure(journal: Path) -> None:
    """Change one digit of an outcome, on the disk."""
    raw = bytearray(journal.read_bytes())
    place = raw.index(b'"outputs"') + 20
    digit = next(i for i in range(place, len(raw)) if raw[i] in b"123456789")
    raw[digit] = ord("1") + ord("9") - raw[digit] if raw[digit] != ord("5") else ord("6")
    journal.write_bytes(raw)


DAMAGE = {
    "figure": change_figure,
    "value": "UPDATE results SET content = replace(content, '[0.', '[1.') WHERE rowid = 3",
    "checksum": "UPDATE results SET crc = crc + 1 WHERE rowid = 3",
    "half": "UPDATE results SET content = substr(content, 1, 99) WHERE rowid = 3",
    "empty": "UPDATE results SET content = x'' WHERE rowid = 3",
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_changed_result_is_reported_once_and_only_its_case_is_run_again(
    dockloop, tmp_path, damage
):
    assert dockloop(*SPEEDS).status == 0
    whole, journal = (tmp_path / "mine.parquet").read_bytes(), tmp_path / "mine.sqlite"
    results = sorted(read_results(journal))
    change(journal, DAMAGE[damage])
    for _ in range(2):
        refused = dockloop(*SPEEDS)
        assert refused.status == 2, refused
        assert "holds 7 of 8 cases" in refused.err
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert reported.status == 0, reported
    assert reported.err == (
        "dockloop: warning: mine.sqlite: 1 of 8 results are damaged or were changed: their cases"
        " run again\n"
    )
    assert json.loads(reported.out)["time"]["ran"] == 1
    assert (tmp_path / "mine.parquet").read_bytes() == whole
    again = dockloop(*SPEEDS, "--resume", "--json")
    assert (again.status, again.err) == (0, ""), again
    assert json.loads(again.out)["time"]["ran"] == 0
    assert sorted(read_results(journal)) == results


def test_many_changed_results_are_reported_in_one(dockloop, tmp_path):
    assert dockloop(*SPEEDS).status == 0
    change(tmp_path / "mine.sqlite", "UPDATE results SET content = x'00' WHERE rowid < 8")
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert "7 of 8 results are damaged" in reported.err
    assert reported.err.count("\n") == 1
    assert json.loads(reported.out)["time"]["ran"] == 7


RUIN = {
    "cut off": lambda raw: raw[: len(raw) // 2],
    "one page less": lambda raw: raw[:-4096],
    "overwritten": lambda raw: raw[:4096] + bytes(range(256)) * 16 + raw[8192:],
    "no results": lambda raw: raw.replace(b"results", b"resulta"),
    "another set-up": lambda raw: raw.replace(b'{"dockloop":', b'{"dockloop"?'),
    "no head": lambda raw: b"?" * 100 + raw[100:],
}


@pytest.mark.parametrize("ruin", RUIN)
def test_a_ruined_journal_is_refused_and_stays(dockloop, tmp_path, ruin):
    assert dockloop(*SPEEDS).status == 0
    journal = tmp_path / "mine.sqlite"
    ruined = RUIN[ruin](journal.read_bytes())
    assert ruined != journal.read_bytes()
    journal.write_bytes(ruined)
    for more in ((), ("--resume",)):
        refused = dockloop(*SPEEDS, *more)
        assert (refused.status, refused.err.count("\n")) == (2, 1), refused
        if ruin == "no head":  # this may be anything
            assert "mine.sqlite: is a file of something else, which" in refused.err
            assert "choose another -o" in refused.err
        else:
            assert "mine.sqlite: is damaged (" in refused.err
            assert "): delete the file, or write elsewhere with -o\n" in refused.err
        assert journal.read_bytes() == ruined
    journal.unlink()
    assert dockloop(*SPEEDS).status == 0


# ---------------------------------------------------------------- full disks


def test_a_full_disk_loses_no_case(dockloop, tmp_path):
    """First there is no space for an empty journal, then none for its fourth result."""
    words = "dockloop: mine.sqlite: cannot be written (no space is left on the disk); the same"
    for result in (0, 4):
        with full_disk(result):
            reported = dockloop(*SPEEDS)
        assert reported.status == 1, reported
        assert reported.err == f"{words} command with --resume goes on\n"
        assert [file.name for file in tmp_path.iterdir()] == ["mine.sqlite"] * bool(result)
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert json.loads(reported.out)["time"]["ran"] == 8 - 3, reported
