"""What became of one docking of many."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

STATUSES = ("done", "refused", "failed", "lost")  # what can become of a case


@dataclass
class Result:
    """What became of one case.

    Attributes:
        status: one of `STATUSES`: refused is its start, failed a step, lost its worker.
        reason: why it is not done.
        warning: what the FMU or the placement had to say.
        end_time: where it ended [s].
        outputs: the values of the outputs there; empty unless done.
        histories: times [s], then each output that is kept at every communication point; empty
            unless done.
        assured: of assured cases (`dockloop.sweeps.assured.run_assured`).
    """

    status: str
    reason: str | None = None
    warning: str | None = None
    end_time: float | None = None
    outputs: tuple[float | int | bool, ...] = ()
    histories: tuple[Sequence[float], ...] = ()
    assured: dict[str, Any] | None = None
