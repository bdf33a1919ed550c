"""Runs with shorter communication steps: `run_finely`."""

from collections.abc import Callable
from dataclasses import replace

from dockloop.result.recording import Result

LONGEST = 0.05  # s, a communication step of reference solutions: the work of each is limited


def run_finely(run: Callable[[float], Result], step: float) -> Result:
    """Return a run at communication points that are a step apart, made with shorter steps.

    Args:
        run: makes the run with a communication step [s].
        step: between the points [s].
    """
    parts = max(1, round(step / LONGEST))
    made = run(step / parts)
    return replace(made, values=made.values[::parts])
