"""One docking in several threads, copied, reset, and stopped by its user within a step."""

import contextlib
import copy
import dataclasses
import functools
import os
import pickle
import signal
import threading
import time

import numpy as np
import pytest

import dockloop as dl
from dockloop.result.summary import summarise

SCENE = "idss_25t_350t"
STIFF = {"contact.restitution": 1e-6}  # a step in contact takes long


def show(docking):
    """Time and all outputs but counters of work."""
    names = [n for n, v in docking.variables.items() if v.causality == "output"]
    return docking.time, {n: docking.get(n) for n in names if not n.startswith("solver.")}


def test_steps_of_several_threads_are_all_counted(monkeypatch):
    """A clock that lets other threads run would lose counts that are read before and set after."""
    clock = time.perf_counter
    monkeypatch.setattr(
        "dockloop.runs.docking.time.perf_counter", lambda: time.sleep(1e-3) or clock()
    )
    docking = dl.Docking("absorber_1d")
    step = functools.partial(docking.step, 1 / 128)
    threads = [threading.Thread(target=lambda: [step() for _ in range(10)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert docking.summary["communication_steps"] == 40


def test_a_summary_has_the_first_outputs_although_no_step_reads_them(monkeypatch):
    overrides = {"initial.closing_speed": 0.05}
    docking = dl.Docking("absorber_1d", overrides)
    docking.set("chaser.velocity[2]", 0.01)
    read = []
    monkeypatch.setattr(docking, "_read_outputs", read.append)
    docking.step(0.1)
    assert read == []
    monkeypatch.undo()
    for _ in range(4):
        docking.step(0.1)
    run = dl.run("absorber_1d", overrides, {"chaser.velocity[2]": 0.01}, stop=0.5, step=0.1)
    expected = summarise(dataclasses.replace(run, values=run.values[[0, -1]]))
    for summary in (docking.summary, copy.copy(docking).summary):
        for name in expected.keys() - {"time", "communication_steps"}:
            assert summary[name] == expected[name], name


def test_steps_of_several_threads_are_all_made():
    docking = dl.Docking(SCENE)
    threads = [
        threading.Thread(target=lambda: [docking.step(1 / 128) for _ in range(96)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    alone = dl.Docking(SCENE)
    for _ in range(4 * 96):
        alone.step(1 / 128)
    assert docking.time == alone.time == 3.0
    assert show(docking) == show(alone)


def test_a_thread_that_reads_changes_nothing():
    docking, alone = dl.Docking(SCENE), dl.Docking(SCENE)
    done, read = threading.Event(), []

    def plot():
        while not done.is_set():
            read.append((docking.time, docking.get("relative.axial"), docking.save()))

    reader = threading.Thread(target=plot)
    reader.start()
    for _ in range(300):
        docking.step(1 / 64)
        alone.step(1 / 64)
    done.set()
    reader.join()
    assert len(read) > 10
    assert docking.get("relative.axial") == alone.get("relative.axial")
    assert docking.get("energy.dissipated") == alone.get("energy.dissipated")


def test_progress_of_a_run_may_read_the_docking():
    docking, axial = dl.Docking(SCENE), []
    docking.record(np.arange(129) / 64, lambda part: axial.append(docking.get("relative.axial")))
    assert axial[-1] == docking.get("relative.axial")


@pytest.mark.parametrize(
    "make",
    [copy.copy, copy.deepcopy, lambda docking: pickle.loads(pickle.dumps(docking))],
    ids=["copy", "deepcopy", "pickle"],
)
@pytest.mark.parametrize("begun", [False, True], ids=["before the start", "in contact"])
def test_a_copy_is_another_docking(make, begun):
    docking = dl.Docking(SCENE, {"initial.closing_speed": 0.08})
    docking.set("friction.coefficient", 0.2)
    if begun:
        docking.step(3.0)
    other = make(docking)
    assert show(other) == show(docking)
    other.step(1.0)
    assert other.time == docking.time + 1.0
    docking.step(1.0)
    assert show(other) == show(docking)


def test_reset_goes_back_to_the_start():
    docking = dl.Docking(SCENE)
    fresh = show(docking)
    docking.set("friction.coefficient", 0.2)
    docking.step(3.0)
    docking.reset()
    assert show(docking) == fresh


def test_the_user_stops_a_step():
    # A program that a shell started in the background ignores the signal.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    docking = dl.Docking(SCENE, STIFF)
    docking.step(2.0)
    before = show(docking)
    threading.Timer(0.02, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        docking.step(10.0)
    assert show(docking) == before
    docking.step(0.001)


@pytest.mark.parametrize("h", [10.0, 1e3, 1e9])
@pytest.mark.parametrize("scene", [SCENE, "apda"])
def test_a_hopeless_step_is_refused_after_a_bounded_number_of_evaluations(scene, h):
    """Refused or made, in about 2 s of a slow processor."""
    docking = dl.Docking(scene, STIFF if scene == SCENE else {})
    docking.step(0.5)
    before = show(docking)
    began = time.process_time()
    with contextlib.suppress(dl.DockloopError):
        docking.step(h)
    assert time.process_time() - began < 30.0  # days without the limit
    if docking.time == 0.5:
        assert show(docking) == before
