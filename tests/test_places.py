"""Where a command runs: closed streams, a folder that is gone or read-only, a clone that moved.

Each case works, or is refused in one sentence with the remedy: never a traceback, never silence.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dockloop.base import paths
from dockloop.base.errors import DockloopError
from dockloop.native import compiled
from programs import run

DOCKLOOP = [sys.executable, "-m", "dockloop"]
RUN = ["run", "absorber_1d", "--stop", "0.1", "--no-plots"]
GONE = "the current folder is not there any more: change to another folder\n"


def call(script, *words, **more):
    """Let a shell run a command, with `script` after it."""
    return run("sh", "-c", f'"$@" {script}', "sh", *words, **more)


def run_python(text, folder):
    """Run a program that is a file, as the users' own are."""
    file = folder / "own.py"
    file.write_text(text)
    return call("", sys.executable, file, cwd=folder)


@pytest.mark.parametrize("words", [["variables", "absorber_1d"], ["run", "--help"], RUN])
def test_a_closed_standard_output_is_refused(tmp_path, words):
    done = call(">&-", *DOCKLOOP, *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "dockloop: standard output is closed: let it go to a file, or to /dev/null\n"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("stream", ["2>&-", "2>/dev/full", "2>&1 >/dev/null | true"])
def test_a_standard_error_that_takes_nothing_changes_no_status(tmp_path, stream):
    pipe = "; exit 2" if "|" in stream else ""  # sh reports the last of a pipe
    assert call(stream + pipe, *DOCKLOOP, "run", "nothing", cwd=tmp_path).returncode == 2
    done = call(stream, *DOCKLOOP, *RUN, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    if "|" not in stream:
        assert done.stdout.startswith("absorber_1d: One-dimensional absorber")


def test_with_all_streams_closed_but_one_the_result_is_whole(tmp_path):
    done = call("<&- 2>&-", *DOCKLOOP, *RUN, "-o", "own.csv", cwd=tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "own.csv").read_text().startswith("time,")


@pytest.mark.parametrize("output", ["own.csv", "OUTSIDE/own.csv"])
def test_a_current_folder_that_is_gone_is_named(tmp_path, output):
    gone = tmp_path / "gone"
    gone.mkdir()
    words = [*DOCKLOOP, *RUN, "-o", output.replace("OUTSIDE", str(tmp_path))]
    done = run("sh", "-c", 'rmdir ../gone && "$@"', "sh", *words, cwd=gone)
    assert (done.returncode, done.stderr) == (2, f"dockloop: {GONE}")


@pytest.mark.parametrize(
    "work", ["dl.sweep('absorber_1d_speeds', output='own.parquet')", "run.view('own.html')"]
)
def test_a_script_in_a_folder_that_is_gone_gets_the_error_of_this_package(tmp_path, work):
    done = run_python(
        "import os, dockloop as dl\nrun = dl.run('absorber_1d', stop=0.1)\n"
        f"os.mkdir('gone')\nos.chdir('gone')\nos.rmdir('../gone')\n{work}\n",
        tmp_path,
    )
    assert done.stderr.endswith(f"dockloop.base.errors.UsageError: {GONE}")


def test_a_script_without_a_guard_runs_worker_processes(tmp_path):
    done = run_python(
        "import sys, dockloop as dl\nname = __file__\nprint('begin')\n"
        "print(len(dl.sweep('absorber_1d_speeds', engine='fmu', workers=1)))\n"
        "assert __file__ == name and __spec__ is None\n",
        tmp_path,
    )
    assert (done.stdout, done.stderr) == ("begin\n8\n", "")


def test_a_temporary_folder_on_a_disk_without_programs_is_named(tmp_path):
    mount = f'mount -t tmpfs -o noexec tmpfs {tmp_path} && export TMPDIR={tmp_path} && exec "$@"'
    if subprocess.run(["unshare", "-m", "sh", "-c", mount, "sh", "true"], check=False).returncode:
        pytest.skip("this process may mount nothing")
    file = tmp_path.parent / "own.csv"
    done = call("", "unshare", "-m", "sh", "-c", mount, "sh", *DOCKLOOP, *RUN, "-o", file)
    assert done.returncode == 1
    assert done.stderr.endswith(
        f": {tmp_path} is mounted noexec, so let TMPDIR name another folder\n"
    )


def test_another_user_in_a_read_only_folder_is_refused_and_without_home_runs():
    other = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"]
    if call("", *other, sys.executable, "-c", "import dockloop").returncode:
        pytest.skip("this process cannot become another user")
    done = call("", *other, *DOCKLOOP, *RUN, cwd="/")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "dockloop: build/results/absorber_1d/absorber_1d.csv: cannot be written (Permission"
        " denied): choose another -o\n"
    )
    with_figures = ["env", "-u", "HOME", *other, *DOCKLOOP, *RUN[:-1], "-o"]
    folder = Path("/tmp") / f"dockloop-test-{os.getpid()}"
    folder.mkdir()
    folder.chmod(0o777)
    try:
        done = call("", *with_figures, folder / "own.csv")
        assert (done.returncode, done.stderr) == (0, "")
    finally:
        shutil.rmtree(folder)


def test_results_are_below_the_current_folder_in_a_clone_too(tmp_path):
    done = call("", *DOCKLOOP, *RUN, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "build" / "results" / "absorber_1d" / "absorber_1d.csv").is_file()


@pytest.fixture
def moved(monkeypatch, tmp_path):
    """A build folder that is a copy of another."""
    folder = tmp_path / "moved"
    folder.mkdir()
    shutil.copyfile(paths.COMPILED / "CMakeCache.txt", folder / "CMakeCache.txt")
    generator = folder / "dockloop-kernel"
    monkeypatch.setattr(paths, "COMPILED", folder)
    monkeypatch.setattr(paths, "GENERATOR", generator)
    monkeypatch.setattr(compiled, "TARGETS", {generator: "dockloop-kernel"})
    return generator


def test_a_clone_that_moved_is_named_once_with_the_remedy(dockloop, moved, tmp_path):
    first, second = (dockloop("build", "absorber_1d", "-o", tmp_path / "a.fmu") for _ in range(2))
    assert first.status == second.status == 0
    (line,) = first.err.splitlines()
    assert line.startswith("dockloop: warning: goes on without dockloop-kernel: ")
    assert "then moved or copied: remove moved and build it in a clone with scripts/demo" in line
    assert (second.err, "then moved or copied" in second.out) == ("", True)
    with pytest.raises(DockloopError, match="then moved or copied"):
        compiled.find_compiled(moved)


def test_a_request_to_end_leaves_no_files_behind(tmp_path):
    """As for other hosts of FMUs: github.com/CATIA-Systems/FMPy/issues/675."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    words = [*DOCKLOOP, "run", "absorber_1d", "--stop", "1e5", "--no-plots", "-o", "own.csv"]
    words += ["--outputs", "relative.axial"]  # all would be too large, which is refused
    process = subprocess.Popen(
        words,
        cwd=tmp_path,
        env=os.environ | {"TMPDIR": str(folder)},
        stderr=subprocess.PIPE,
        text=True,
    )
    while not list(folder.glob("*/*")) and process.poll() is None:
        time.sleep(0.01)
    process.terminate()
    assert process.communicate()[1] == "dockloop: interrupted\n"
    assert process.returncode == 130
    assert [file.name for file in tmp_path.rglob("*")] == ["temporary"]


def test_a_sweep_on_workers_leaves_no_files_and_looks_at_none_of_its_folder(tmp_path):
    """As in github.com/joblib/joblib/issues/1378: a module of Python in the current folder."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    for name in ("signal", "types", "copy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(__name__)\n")
    program = Path(sys.executable).with_name("dockloop")
    words = [program, "sweep", "absorber_1d_speeds", "--engine", "fmu", "--workers", "1"]
    env = os.environ | {"TMPDIR": str(folder)}
    done = call("", *words, "--no-plots", "-o", "own.parquet", cwd=tmp_path, env=env)
    assert (done.returncode, done.stderr) == (0, "")
    assert not list(folder.iterdir())


def test_figures_of_a_command_do_not_follow_the_settings_of_the_user(tmp_path):
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfigure.figsize: 1, 1\n")
    words = ["run", "absorber_1d", "--stop", "0.1", "-o", "own.csv"]
    figures = []
    for folder in (tmp_path, tmp_path / "other"):
        folder.mkdir(exist_ok=True)
        done = call("", *DOCKLOOP, *words, cwd=folder)
        assert (done.returncode, done.stderr) == (0, "")
        figures.append((folder / "own_loads.png").read_bytes())
    assert figures[0] == figures[1]


@pytest.mark.parametrize("stream", ["open('/dev/full', 'w')", "io.StringIO()"])
def test_a_script_keeps_its_standard_error(tmp_path, stream):
    done = run_python(
        "import contextlib, io, sys\nfrom dockloop.base.errors import is_watched, say\n"
        f"stream = sys.stderr = {stream}\nif 'full' not in {stream!r}: stream.close()\n"
        "say('lost')\nassert sys.stderr is stream and not is_watched()\n"
        "with contextlib.redirect_stderr(io.StringIO()) as other: say('heard')\n"
        "print(other.getvalue(), end='')\n",
        tmp_path,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "heard\n", "")


def test_a_program_ends_while_threads_of_it_still_step(tmp_path):
    """Python ends such threads when they want the interpreter, in the middle of C++."""
    done = run_python(
        "import threading, dockloop as dl\n"
        "one, other = dl.Docking('absorber_1d'), dl.Docking('absorber_1d')\n"
        "def step():\n    while True: other.step(0.001)\n"
        "for work in (lambda: one.record([0.0, 1e5]), step):\n"
        "    threading.Thread(target=work, daemon=True).start()\n"
        "while other.time < 0.1: pass\n",
        tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
