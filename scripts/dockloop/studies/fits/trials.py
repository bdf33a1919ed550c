"""The tests that a fit takes together: files, or a TOML list of tests with what each one sets.

A list has a table ``[[test]]`` for each test. Its members: ``name`` (default: that of the file),
``file`` (next to the list), ``set`` (keys of the scene and start values of this test), ``noise``
(standard deviations by channel, in the units of the outputs), ``outcome`` (of the measured
docking), ``held_back`` (true: it is predicted, not fitted), ``columns`` and ``csv`` (as the
options, of this table).
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.histories import Data, parse_columns, read_data
from dockloop.base.number import as_number
from dockloop.base.paths import next_to, read_bytes, shown
from dockloop.base.tables import parse_form
from dockloop.native.core import list_choices
from dockloop.studies.measured.overlay import is_choice
from dockloop.sweeps.planning import Planner

_KINDS = {  # members of a test
    **dict.fromkeys(("name", "outcome", "columns", "csv"), str),
    "file": str | Path,
    **dict.fromkeys(("set", "noise"), Mapping),
    "held_back": bool,
}
_WORDS = {
    str: "a text",
    str | Path: "a path",
    Mapping: "a group of names with values",
    bool: "true or false",
}
_SIGMAS = 2.0  # standard deviations that an accuracy ``+-`` of a heading is


@dataclass(frozen=True)
class Trial:
    """One test.

    Attributes:
        name: of the test.
        file: of its table, as messages show it; empty: a test that is planned.
        settings: keys of the scene and start values in which it differs from the others.
        outcome: what became of the measured docking; empty: not stated.
        noise: standard deviation of channels, as far as stated, in the units of the outputs.
        is_held: it is predicted, not fitted.
        data: what was measured; None: a test that is planned.
    """

    name: str
    file: str
    settings: Mapping[str, Any]
    outcome: str
    noise: Mapping[str, float]
    is_held: bool
    data: Data | None = None
    columns: str = ""
    form: str = ""

    @property
    def is_captured(self) -> bool | None:
        """Whether the measured docking was captured; None: that was not measured."""
        if self.data is None or "captured" not in self.data:
            return None
        return bool((self.data["captured"] > 0.5).any())

    @property
    def channels(self) -> list[str]:
        """Names of the outputs with a residual: those that choose or count have none."""
        names = list(self.noise) if self.data is None else self.data.names
        return [name for name in names if not is_choice(name)]


def list_trials(data: Sequence[str | Path | Mapping[str, Any]], *, is_plan: bool) -> list[Trial]:
    """Return the tests of files, of lists of tests, and of members of such lists; reads no table.

    Raises:
        UsageError: naming file, test, member and what it must be.
    """
    trials: list[Trial] = []
    for given in data:
        if isinstance(given, Mapping):
            found = [("data", given, Path("data"))]
        elif Path(given).suffix == ".toml":
            found = [(shown(Path(given)), e, Path(given)) for e in _read_list(Path(given))]
        else:
            found = [(shown(Path(given)), {"file": str(given)}, Path("data"))]
        for place, entry, owner in found:
            trial = _make_trial(f"{place}: test {len(trials) + 1}", entry, owner, is_plan=is_plan)
            if any(trial.name == other.name for other in trials):
                raise UsageError(f"{place}: two tests have the name '{trial.name}': give each one")
            trials.append(trial)
    if not trials:
        raise UsageError("DATA: at least one test is needed")
    if all(trial.is_held for trial in trials):
        raise UsageError("DATA: at least one test must be fitted, not held_back")
    return trials


def _read_list(path: Path) -> list[Any]:
    """Return the entries of a list of tests."""
    try:
        members = tomllib.loads(read_bytes(path, "list of tests").decode("utf-8-sig"))
    except ValueError as error:
        raise UsageError(f"{shown(path)}: is no TOML file ({error})") from None
    tests = members.get("test")
    if not isinstance(tests, list) or not tests or not all(isinstance(t, dict) for t in tests):
        raise UsageError(f"{shown(path)}: must have a table [[test]] for each test")
    return tests


def _make_trial(place: str, entry: Mapping[str, Any], owner: Path, *, is_plan: bool) -> Trial:
    """Check the members of a test; its table is next to the owner."""
    for name, value in entry.items():
        if name not in _KINDS:
            near = did_you_mean(name, _KINDS) or f": must be one of {', '.join(_KINDS)}"
            raise UsageError(f"{place} has '{name}'{near}")
        if not isinstance(value, _KINDS[name]):
            raise UsageError(f"{place}: {name} is {value!r}: must be {_WORDS[_KINDS[name]]}")
    if not is_plan and not entry.get("file"):
        raise UsageError(f"{place} lacks 'file', its table")
    noise = {
        n: check_noise(f"{place}: noise of '{n}'", v) for n, v in entry.get("noise", {}).items()
    }
    check_outcome(f"{place}: outcome", outcome := entry.get("outcome", ""))
    file = next_to(owner, entry.get("file", ""))
    name = entry.get("name") or file.stem or place.rpartition(": ")[2]
    return Trial(
        name,
        "" if is_plan else str(file),
        dict(entry.get("set", {})),
        outcome,
        noise,
        entry.get("held_back", False) and not is_plan,
        None,
        entry.get("columns", ""),
        entry.get("csv", ""),
    )


def check_noise(place: str, value: Any) -> float:
    """Return a standard deviation. Raises UsageError: it is none."""
    number = as_number(value)
    if not 0.0 < number < np.inf:
        raise UsageError(f"{place} is {value!r}: must be a standard deviation above 0")
    return number


def check_outcome(place: str, outcome: str) -> None:
    """Raise UsageError for a text that is no outcome."""
    names = [choice.name for choice in list_choices("outcome")]
    if outcome and outcome not in names:
        near = did_you_mean(outcome, names)
        raise UsageError(f"{place} is '{outcome}': must be one of {', '.join(names)}{near}")


def read_trials(
    trials: Sequence[Trial],
    planner: Planner,
    columns: Sequence[str],
    form: str,
    noise: Mapping[str, float],
) -> list[Trial]:
    """Return the same tests with their tables, or for a plan with checked channels.

    Args:
        trials: of `list_trials`.
        planner: has the outputs of the scene.
        columns: of ``--columns``, for all tests.
        form: of ``--csv``, for all tests.
        noise: standard deviations by channel, for all tests.

    Raises:
        UsageError: naming file, column or row, and what is expected.
    """
    outputs = planner.list_outputs()
    units = [planner.variables[name].unit for name in outputs]
    read = []
    for trial in trials:
        place = trial.file or f"test '{trial.name}'"
        for name in (*noise, *trial.noise):
            if name not in outputs or is_choice(name):
                near = did_you_mean(name, outputs)
                raise UsageError(f"{place}: noise: '{name}' is no output that is measured{near}")
        data = None
        stated = {**noise, **trial.noise}
        if trial.file:
            own = [*columns, *([trial.columns] if trial.columns else [])]
            csv = trial.form or form
            data = read_data(
                Path(trial.file),
                ["time", *outputs],
                ["s", *units],
                parse_form(csv) if csv else {},
                parse_columns(own),
            )
            stated = {n: a / _SIGMAS for n, a in data.accuracies.items()} | stated
        trial = replace(trial, data=data, noise=stated)  # noqa: PLW2901
        if not trial.channels:
            remedy = "must have more than choices such as captured"
            remedy = remedy if trial.file else "state the noise of those that will be measured"
            raise UsageError(f"{place}: has no channel to fit: {remedy}")
        read.append(trial)
    return read
