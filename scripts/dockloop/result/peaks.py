"""Where the peaks of loads arose: time, step of the sequence, part of the hardware."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dockloop.native.variables import happened
from dockloop.result.criteria import PEAK, PEAK_TIME
from dockloop.result.recording import Result

PEAK_STEP = "capture.peak_step."


def list_with_places(name: str) -> list[str]:
    """Return an output and, if it is a peak of a load, those of its time and step."""
    load = name.removeprefix(PEAK)
    return [name] if load == name else [name, f"{PEAK_TIME}{load}", f"{PEAK_STEP}{load}"]


def name_step(scene: Mapping[str, Any], number: float) -> str | None:
    """Return the name of a step of the sequence, counted from 1; None: there is no such step."""
    steps = scene.get("mechanism", {}).get("sequence", {}).get("steps", [])
    return steps[int(number) - 1]["name"] if 1 <= number <= len(steps) else None


def list_steps_after(run: Result, time: float) -> dict[str, float]:
    """Return the steps that a run entered for the first time after a time [s], with their times."""
    times = (
        {}
        if "sequence.step" not in run
        else {
            str(name_step(run.scene, i + 1)): float(entered)
            for i, entered in enumerate(run.vector("sequence.entered")[-1])
            if entered > time
        }
    )
    return dict(sorted(times.items(), key=lambda item: item[1]))


def find_peak(run: Result, load: str) -> dict:
    """Return ``value`` of a peak at the end of a run, ``time`` [s] and ``step``.

    Time and step are None where there was no load, step also without a sequence. An FMU of an
    older version does not report them.
    """
    peak: dict = {"value": float(run[f"{PEAK}{load}"][-1]), "time": None, "step": None}
    if f"{PEAK_TIME}{load}" in run and happened(run[f"{PEAK_TIME}{load}"][-1]):
        peak["time"] = float(run[f"{PEAK_TIME}{load}"][-1])
        peak["step"] = name_step(run.scene, run[f"{PEAK_STEP}{load}"][-1])
    return peak


def find_leg_peak(run: Result, count: int) -> dict:
    """Return ``value``, ``time`` [s], ``step`` and ``place`` of the largest force along a leg.

    The place is the name of the leg, as in ``leg[3]``. Of legs whose peaks the FMU does not report,
    the values at the communication points count.
    """
    legs = [f"leg[{i + 1}]" for i in range(count)]
    peaks = [find_sampled_peak(run, [f"{leg}.force" for leg in legs])]
    for leg in legs:
        if f"{leg}.peak" in run:
            value, time, step = (run[f"{leg}.{m}"][-1] for m in ("peak", "peak_time", "peak_step"))
            found = {"value": float(value), "time": float(time), "step": name_step(run.scene, step)}
            peaks.append({**found, "place": leg})
    return max(peaks, key=lambda peak: peak["value"])


def find_sampled_peak(run: Result, names: list[str]) -> dict:
    """Return the same of the sizes of some outputs at the communication points."""
    sizes = np.abs(np.column_stack([run[name] for name in names]))
    row, column = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    step = run["sequence.step"][row] if "sequence.step" in run else 0
    return {
        "value": float(sizes[row, column]),
        "time": float(run["time"][row]),
        "step": name_step(run.scene, step),
        "place": names[column].rpartition(".")[0],
    }


def say_place(peak: Mapping[str, Any]) -> str:
    """Say part, time and step of a peak, as in ``in leg[3] at 1.25 s in step 'align'``."""
    words = [f"in {peak['place']}"] if peak.get("place") else []
    words += [f"at {peak['time']:.4g} s"] if peak.get("time") is not None else []
    words += [f"in step '{peak['step']}'"] if peak.get("step") else []
    return " ".join(words)


def count_steps(scene: Mapping[str, Any], numbers: np.ndarray) -> dict[str, int]:
    """Return in how many cases a peak arose in each step, the most frequent step first.

    Args:
        scene: resolved, with its mechanism.
        numbers: of steps, shape (cases,); 0 and NaN do not count.
    """
    found, counts = np.unique(numbers[np.isfinite(numbers) & (numbers > 0)], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {str(name_step(scene, found[i])): int(counts[i]) for i in order}


def say_steps(steps: Mapping[str, int]) -> str:
    """Say in which steps of the sequence the peaks arose: ``8 of 12 in step 'align'``."""
    total = sum(steps.values())
    return "arose in " + ", ".join(f"step '{name}' {n} of {total}" for name, n in steps.items())
