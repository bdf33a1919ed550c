"""From a sweep file to its cases: which values each quantity takes in each case.

Distributions are sampled together, over a unit cube with one dimension per quantity (two per disc):
at random, as a Latin hypercube or as a scrambled Sobol sequence, always from the seed of the file.
Every point of the grids meets the same samples, so that differences between grid points are not
those of chance.
"""

import itertools
import json
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dockloop import schema
from dockloop.errors import UsageError, did_you_mean
from dockloop.paths import SWEEPS, find_absence, is_file, shown
from dockloop.scene import find_scene, read_toml
from dockloop.variables import NAMED_NUMBERS

_MAX_CASES = 10_000_000
_LISTED = ("grid", "cases")  # not drawn at random
Value = float | int | bool | str


@dataclass(frozen=True)
class Quantity:
    """What varies.

    Attributes:
        name: a key of the scene or a start value; of named cases the column of their names.
        unit: if known.
        named: of named cases: what each one sets.
    """

    name: str
    unit: str
    named: Mapping[str, Mapping[str, Value]] | None = None

    def settings(self, value: Value) -> Mapping[str, Value]:
        """Return what a case with this value sets."""
        return {self.name: value} if self.named is None else self.named[str(value)]


@dataclass(frozen=True)
class Passes:
    """At which ``accuracy`` cases run: all of them, then critical ones again.

    Attributes:
        accuracy: of all cases.
        refine: criterion of the cases that run again; empty: none do.
        refine_accuracy: of these.
    """

    accuracy: float
    refine: str = ""
    refine_accuracy: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """A sweep file, checked.

    Attributes:
        path: the file.
        text: what it says.
        scene: the scene file.
        document: its members, with defaults for all that have one.
        quantities: what varies, in the order of the columns of `cases`; with passes ``accuracy``
            is the last one.
        cases: the value of every quantity in every case.
        passes: at which accuracy cases run; None: as file and scene say.
    """

    path: Path
    text: str
    scene: Path
    document: dict
    quantities: list[Quantity]
    cases: list[tuple[Value, ...]]
    passes: Passes | None = None

    def complete(self, drawn: Iterable[Value], accuracy: float | None = None) -> tuple[Value, ...]:
        """Return the values of a case from those that the file varies.

        Args:
            drawn: these.
            accuracy: of the case; default: that of all cases.
        """
        if self.passes is None:
            return tuple(drawn)
        return (*drawn, self.passes.accuracy if accuracy is None else accuracy)


def read_sweep(reference: str, passes: Passes | None = None) -> Sweep:
    """Read a sweep file and draw its cases.

    Args:
        reference: name of a shipped sweep, or path of a .toml file.
        passes: at which accuracy cases run.

    Raises:
        UsageError: naming file, member, value and limit.
    """
    path = _find_sweep(reference)
    given, text = read_toml(path)
    return make_sweep(given, path, text, passes)


def make_sweep(
    given: dict, path: Path, text: str | None = None, passes: Passes | None = None
) -> Sweep:
    """Draw the cases of the members of a sweep file. Raises UsageError like `read_sweep`.

    Args:
        given: the members.
        path: the file; a scene of the user's own is looked up next to it.
        text: what the file says; default: the members as JSON.
        passes: at which accuracy cases run.
    """
    schema.check(given, "sweep", path)
    document = {"title": path.stem, **schema.list_defaults("sweep"), "set": {}, **given}
    _check_members(document, path)
    document["experiment"] = given.get("experiment", {})
    next_to = path.parent / given["scene"]
    try:
        scene = find_scene(str(next_to) if next_to.suffix == ".toml" else given["scene"])
    except UsageError as error:
        raise UsageError(f"{shown(path)}: scene: {error}") from None
    quantities = list_quantities(document)
    if passes:
        decided = {name for entry in document["vary"] for name in _decided(entry)}
        if "accuracy" in decided | set(document["set"]):
            raise UsageError(f"{shown(path)}: decides 'accuracy' already: leave out --accuracy")
        quantities.append(Quantity("accuracy", ""))
    text = json.dumps(given) if text is None else text
    sweep = Sweep(path, text, scene, document, quantities, [], passes)
    return replace(sweep, cases=[sweep.complete(case) for case in _draw(document)])


def read_passes(
    accuracy: float | str | None, refine: str | None, refine_accuracy: float | str | None
) -> Passes | None:
    """Return the passes of a sweep from what the user wrote; None: nothing.

    Raises:
        UsageError: one of them is missing or bad.
    """
    if accuracy is None and refine is None and refine_accuracy is None:
        return None
    if accuracy is None or (refine is None) != (refine_accuracy is None):
        raise UsageError(
            "--refine, --refine-accuracy: critical cases run again after a first pass: give both,"
            " and --accuracy of that pass"
        )
    names = NAMED_NUMBERS["accuracy"]
    first = float(names[str(accuracy)]) if accuracy in names else _read_number(accuracy)
    if not (0.0 < first <= 1.0 or accuracy in names):
        raise UsageError(
            f"--accuracy {accuracy}: must be greater than 0 and at most 1, or {', '.join(names)}"
        )
    if refine is None or refine_accuracy is None:
        return Passes(first)
    second = _read_number(refine_accuracy)
    if not 0.0 < second < (first if first > 0.0 else 1.0):
        raise UsageError(
            f"--refine-accuracy {refine_accuracy}: must be greater than 0 and less than --accuracy"
        )
    return Passes(first, refine, second)


def _read_number(given: float | str) -> float:
    """Return a number; not a number if it is none."""
    try:
        return float(given)
    except ValueError:
        return math.nan


def say_accuracy(accuracy: float) -> str:
    """Return an accuracy by its name, or as a number."""
    names = {number: name for name, number in NAMED_NUMBERS["accuracy"].items()}
    return names.get(int(accuracy), f"{accuracy:g}") if accuracy < 0.0 else f"{accuracy:g}"


def list_quantities(document: dict) -> list[Quantity]:
    """Return what varies, in the order of the sweep file; a disc gives two."""
    quantities = []
    for entry in document["vary"]:
        first, *direction = _names(entry)
        quantities.append(Quantity(first, entry.get("unit", ""), entry.get("cases")))
        quantities += [Quantity(name, "deg") for name in direction]
    return quantities


def list_discs(document: dict) -> list[tuple[str, str]]:
    """Return magnitude and direction of every disc."""
    discs = (entry for entry in document["vary"] if entry["type"] == "disc")
    return [(entry["magnitude"], entry["direction"]) for entry in discs]


def _find_sweep(reference: str) -> Path:
    """Find a sweep by name (among the shipped ones) or by path."""
    path = Path(reference)
    if path.suffix != ".toml":
        path = SWEEPS / f"{reference}.toml"
        if not is_file(path):
            names = [file.stem for file in sorted(SWEEPS.glob("*.toml"))]
            raise UsageError(
                f"no sweep '{reference}' in {shown(SWEEPS)}{did_you_mean(reference, names)}:"
                f" there are {', '.join(names)}; a sweep of your own is given by its path,"
                " ending in .toml"
            )
    if not is_file(path):
        raise UsageError(find_absence(path, "sweep file"))
    return path


def _names(entry: dict) -> list[str]:
    """Return the names of the columns of an entry."""
    return [entry["magnitude"], entry["direction"]] if entry["type"] == "disc" else [entry["name"]]


def _decided(entry: dict) -> list[str]:
    """Return the names of what an entry decides."""
    if entry["type"] != "cases":
        return _names(entry)
    return [entry["name"], *dict.fromkeys(n for case in entry["cases"].values() for n in case)]


def _values(entry: dict) -> list[Value]:
    """Return the values of an entry that is not drawn at random, one by one."""
    return list(entry["cases"]) if entry["type"] == "cases" else entry["values"]


def _check_members(document: dict, path: Path) -> None:
    """Check what a schema cannot say."""
    owners: dict[str, str] = dict.fromkeys(document.get("set", {}), "set")
    grid_points = 1
    for number, entry in enumerate(document["vary"], 1):
        where = f"{shown(path)}: vary[{number}]"
        for name in _decided(entry):
            if name in owners:
                raise UsageError(f"{where} varies '{name}', which {owners[name]} decides already")
            owners[name] = f"vary[{number}]"
        if entry["type"] in _LISTED:
            grid_points *= len(_values(entry))
        if entry["type"] == "grid":
            kinds = {str if isinstance(v, str) else type(v) for v in entry["values"]}
            if kinds - {int, float} and len(kinds) > 1:
                raise UsageError(f"{where}.values has {entry['values']}: must be all of one kind")
        elif "range" in entry:
            low, high = entry["range"]
            if low > high or (low == high and entry["type"] != "disc"):
                raise UsageError(f"{where}.range is [{low}, {high}]: must ascend")
            if entry["type"] == "disc" and low < 0.0:
                raise UsageError(f"{where}.range[1] is {low}: a radius must be at least 0")
        if entry["type"] == "disc" and not re.search("_deg$", entry["direction"]):
            raise UsageError(
                f"{where}.direction is '{entry['direction']}': must be a key in degrees (..._deg)"
            )
    total = grid_points * document["cases"]
    if total > _MAX_CASES:
        raise UsageError(
            f"{shown(path)}: cases times the points of the grids is {total}: must be at most"
            f" {_MAX_CASES}"
        )
    if document["cases"] > 1 and all(entry["type"] in _LISTED for entry in document["vary"]):
        raise UsageError(
            f"{shown(path)}: cases is {document['cases']}: must be 1 when only grids and named"
            " cases vary"
        )


def count_drawn(document: dict) -> int:
    """Return how many numbers are drawn at random in a case: one per quantity, two per disc."""
    return sum(len(_names(entry)) for entry in document["vary"] if entry["type"] not in _LISTED)


def transform_cube(document: dict, cube: np.ndarray) -> list[list[float]]:
    """Return the quantities that are drawn at random, for points of the unit cube.

    Args:
        document: the members of a sweep file.
        cube: shape (cases, `count_drawn`).
    """
    columns: list[np.ndarray] = []
    for entry in document["vary"]:
        if entry["type"] not in _LISTED:
            own = cube.T[len(columns) : len(columns) + len(_names(entry))]
            columns += _TRANSFORMS[entry["type"]](entry, *own)
    return np.column_stack(columns).tolist() if columns else [[]]


def _draw(document: dict) -> list[tuple[Value, ...]]:
    """Return the cases: all samples at the first point of the grids, then at the next."""
    entries = document["vary"]
    grids = [_values(entry) for entry in entries if entry["type"] in _LISTED]
    width = count_drawn(document)
    cube = _sample_cube(document["sampling"], document["cases"], width, document["seed"])
    samples = transform_cube(document, cube)

    cases = []
    for point in itertools.product(*grids):
        for sample in samples:
            on_grid, off_grid = iter(point), iter(sample)
            case: list[Value] = []
            for entry in entries:
                source = on_grid if entry["type"] in _LISTED else off_grid
                case += itertools.islice(source, len(_names(entry)))
            cases.append(tuple(case))
    return cases


def _sample_cube(sampling: str, count: int, width: int, seed: int) -> np.ndarray:
    """Return points of the unit cube, shape (count, width)."""
    from scipy.stats import qmc

    if width == 0 or sampling == "random":
        return np.random.default_rng(seed).random((count, width))
    if sampling == "latin_hypercube":
        return qmc.LatinHypercube(width, rng=np.random.default_rng(seed)).random(count)
    with warnings.catch_warnings():  # "balanced only if a power of 2": the file decides that
        warnings.simplefilter("ignore", UserWarning)
        return qmc.Sobol(width, rng=np.random.default_rng(seed)).random(count)


def _uniform(entry: dict, u: np.ndarray) -> list[np.ndarray]:
    low, high = entry["range"]
    return [low + (high - low) * u]


def _normal(entry: dict, u: np.ndarray) -> list[np.ndarray]:
    """Invert the distribution function, so that strata of `u` are strata of the quantity."""
    from scipy.stats import truncnorm

    mean, deviation = entry["mean"], entry["deviation"]
    low, high = ((x - mean) / deviation for x in entry.get("range", (-math.inf, math.inf)))
    smallest = 2.0**-53  # a sample of exactly 0 would be at minus infinity
    return [mean + deviation * truncnorm.ppf(np.maximum(u, smallest), low, high)]


def _disc(entry: dict, u: np.ndarray, w: np.ndarray) -> list[np.ndarray]:
    """Areas within a radius grow with its square, so the square is uniform."""
    inner, outer = entry["range"]
    return [np.sqrt(inner**2 + (outer**2 - inner**2) * u), 360.0 * w]


_TRANSFORMS: dict[str, Callable[..., list[np.ndarray]]] = {
    "uniform": _uniform,
    "normal": _normal,
    "disc": _disc,
}


def to_text(value: Any) -> str:
    """Return a value as it is written in TOML and after ``KEY=``, with all digits."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case list() | tuple():
            return "[" + ", ".join(map(to_text, value)) + "]"
        case dict():
            return "{" + ", ".join(f"{to_text(k)} = {to_text(v)}" for k, v in value.items()) + "}"
    return repr(value)


def as_setting(name: str, value: Any) -> str:
    """Return ``NAME=VALUE`` for ``--scene`` or ``--set``."""
    return f"{name}={to_text(value)}"
