"""From a sweep file to its cases: which values each quantity takes in each case.

Distributions are sampled together, over a unit cube with one dimension per quantity (two per disc):
at random, as a Latin hypercube or as a scrambled Sobol sequence, always from the seed of the file.
Every point of the grids meets the same samples, so that differences between grid points are not
those of chance.
"""

import copy
import hashlib
import json
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base import schema
from dockloop.base.errors import UsageError
from dockloop.base.number import as_number
from dockloop.base.paths import SWEEPS, next_to, shown
from dockloop.native.variables import NAMED_NUMBERS
from dockloop.scene.find import find_scene, find_shipped, read_toml
from dockloop.scene.resolve import write_scene
from dockloop.scene.values import to_text
from dockloop.sweeps.fitted import draw_fitted, read_fitted

_MAX_CASES = 10_000_000
LISTED = ("grid", "cases")  # not drawn at random
_SOURCES = {"cases": "the table ", "fit": "the fit "}  # what a file of an entry is
Value = float | int | bool | str


@dataclass(frozen=True)
class Quantity:
    """What varies.

    Attributes:
        name: a key of the scene or a start value; of named cases the column of their names.
        unit: if known.
        named: of named cases: what each one sets.
        units: of named cases: units of what they set, where these are stated.
        file: of named cases: the table that has them.
    """

    name: str
    unit: str
    named: Mapping[str, Mapping[str, Value]] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    file: str = ""

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


class Cases(Sequence[tuple[Value, ...]]):
    """The values of all cases, one tuple per case, made when it is looked at.

    All samples come at the first point of the grids, then at the next; the last grid is the
    fastest. What is kept grows by one number per sample and quantity that is drawn.
    """

    def __init__(
        self, vary: list[dict], drawn: np.ndarray, accuracy: float | np.ndarray | None = None
    ) -> None:
        """Join samples and grids.

        Args:
            vary: what varies, as in a sweep file.
            drawn: of `transform_cube`.
            accuracy: last value of a case, one of all cases or one of each; None: there is none.
        """
        self._drawn = drawn
        self._columns: list[list[Value] | int] = []  # the values of a list, or a column of `drawn`
        for entry in vary:
            if entry["type"] in LISTED:
                self._columns.append(_values(entry))
            else:
                first = sum(isinstance(column, int) for column in self._columns)
                self._columns += range(first, first + len(_names(entry)))
        self._strides, stride = [0] * len(self._columns), len(drawn)
        for number, column in reversed(list(enumerate(self._columns))):
            if not isinstance(column, int):
                self._strides[number] = stride
                stride *= len(column)
        self._count = stride
        self._accuracy = None if accuracy is None else np.broadcast_to(accuracy, stride)

    def __len__(self) -> int:
        """Return how many cases there are."""
        return self._count

    def __getitem__(self, index: Any) -> Any:
        """Return a case."""
        row = range(self._count)[index]
        sample = self._drawn[row % len(self._drawn)].tolist()
        values = (
            sample[column] if isinstance(column, int) else column[row // stride % len(column)]
            for column, stride in zip(self._columns, self._strides, strict=True)
        )
        if self._accuracy is None:
            return tuple(values)
        return (*values, float(self._accuracy[row]))

    def at_accuracy(self, accuracy: np.ndarray) -> "Cases":
        """Return the same cases, each at another accuracy."""
        cases = copy.copy(self)
        cases._accuracy = accuracy
        return cases

    def list_examples(self, number: int) -> list[Value]:
        """Return the values of a list that one quantity takes, or one value that was drawn."""
        column = self._columns[number] if number < len(self._columns) else 0
        return [self[-1][number]] if isinstance(column, int) else list(dict.fromkeys(column))

    def count_points(self) -> int:
        """Return how many points the grids have; all samples come at each of them."""
        return self._count // len(self._drawn)

    def find_digest(self) -> str:
        """Return the SHA-256 of the values; the accuracy is left out."""
        digest = hashlib.sha256(json.dumps([self._columns, self._drawn.shape]).encode())
        digest.update(self._drawn.tobytes())
        return digest.hexdigest()


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
        assured: each case is repeated until its figures are within the accuracy.
        form: how the table of cases was read; empty: there is none, or nothing to say.
        given_by: of what options set and vary: with what messages about it begin, by name.
    """

    path: Path
    text: str
    scene: Path
    document: dict
    quantities: list[Quantity]
    cases: Cases
    passes: Passes | None = None
    assured: bool = False
    form: str = ""
    given_by: Mapping[str, str] = field(default_factory=dict)

    def name_setting(self, name: str, where: str = "") -> str:
        """Return with what messages about something that is set or varies begin."""
        where = where or ("set" if name in self.document["set"] else "vary")
        return self.given_by.get(name) or f"{shown(self.path)}: {where} '{name}'"

    def complete(self, drawn: Iterable[Value]) -> tuple[Value, ...]:
        """Return the values of a case from those that the file varies."""
        return tuple(drawn) if self.passes is None else (*drawn, self.passes.accuracy)


def read_sweep(
    reference: str, passes: Passes | None = None, table: Any = None, fitted: str | None = None
) -> Sweep:
    """Read a sweep file and draw its cases.

    Args:
        reference: name of a shipped sweep, or path of a .toml file.
        passes: at which accuracy cases run.
        table: of cases, in place of the key ``cases``: a path or a ``pandas.DataFrame``.
        fitted: file of a fit, whose parameters vary as well; None: none.

    Raises:
        UsageError: naming file, member, value and limit.
    """
    path = find_shipped(reference, "sweep", SWEEPS)
    given, text = read_toml(path)
    if "chaser" in given:
        raise UsageError(f"{shown(path)}: is a scene, no sweep: 'dockloop run' runs it")
    if table is not None:
        given["cases"] = table
    return make_sweep(given, path, text, passes, fitted)


def make_sweep(
    given: dict,
    path: Path,
    text: str | None = None,
    passes: Passes | None = None,
    fitted: str | None = None,
) -> Sweep:
    """Draw the cases of the members of a sweep file. Raises UsageError like `read_sweep`.

    Args:
        given: the members.
        path: the file; a scene of the user's own is looked up next to it.
        text: what the file says; default: the members as TOML.
        passes: at which accuracy cases run.
        fitted: file of a fit, whose parameters vary as well; None: none.
    """
    if fitted is not None:
        entry = {"type": "fit", "file": str(Path(fitted).resolve())}
        given = {**given, "vary": [*given.get("vary", []), entry]}
    if isinstance(given.get("scene"), Mapping):
        given = {**given, "scene": str(write_scene(given["scene"]))}
    table, form = given.get("cases"), ""
    if hasattr(table, "columns") or (isinstance(table, str | Path) and str(table)):
        (given, form), text = _write_out(given, path), None
    schema.check(given, "sweep", path)
    floats = {name: given[name] for name in ("seed", "cases") if isinstance(given.get(name), float)}
    given = {**given, **{name: int(value) for name, value in floats.items()}}
    if "vary" not in given:
        raise UsageError(
            f"{shown(path)}: lacks the member 'vary', or a table of cases (cases = \"FILE\")"
        )
    read = [read_fitted(e, path.parent) if e["type"] == "fit" else e for e in given["vary"]]
    if read != given["vary"]:
        given, text = {**given, "vary": read}, None
    if "cases" not in given and any(entry["type"] == "fit" for entry in read):
        raise UsageError(
            f"{shown(path)}: lacks 'cases': how often the parameters of the fit are drawn, for"
            " example cases = 64"
        )
    document = {"title": path.stem, **schema.list_defaults("sweep"), "set": {}, **given}
    _check_members(document, path)
    _check_not_drawn(document, path)
    document["experiment"] = given.get("experiment", {})
    own = next_to(path, given["scene"])
    try:
        scene = find_scene(str(own) if own.suffix == ".toml" else given["scene"])
    except UsageError as error:
        raise UsageError(f"{shown(path)}: scene: {error}") from None
    quantities = list_quantities(document)
    if passes:
        decided = {name for entry in document["vary"] for name in _decided(entry)}
        if "accuracy" in decided | set(document["set"]):
            raise UsageError(f"{shown(path)}: decides 'accuracy' already: leave out --accuracy")
        quantities.append(Quantity("accuracy", ""))
    if text is None:
        text = "".join(f"{name} = {to_text(value)}\n" for name, value in given.items())
    cases = _draw(document, passes)
    return Sweep(path, text, scene, document, quantities, cases, passes, form=form)


def _write_out(given: dict, path: Path) -> tuple[dict, str]:
    """Return members with the cases of a table as named cases, and how the table was read."""
    from dockloop.sweeps.scenarios import read_scenarios

    entry, form = read_scenarios(given["cases"], path)
    others = {name: value for name, value in given.items() if name != "cases"}
    return others | {"vary": [entry, *given.get("vary", [])]}, form


def _check_not_drawn(document: dict, path: Path) -> None:
    """Refuse quantities that are drawn at random next to a table of cases."""
    drawn = [name for e in document["vary"] if e["type"] not in LISTED for name in _names(e)]
    if drawn and any(_is_table(entry) for entry in document["vary"]):
        raise UsageError(
            f"{shown(path)}: vary draws '{drawn[0]}' at random, but the cases are those of a table:"
            " only grids and named cases may vary as well"
        )


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
    if refine is not None and not (isinstance(refine, str) and refine.strip()):
        raise UsageError(f"--refine {refine!r}: must be a criterion, for example not captured")
    names = NAMED_NUMBERS["accuracy"]
    named = names.get(accuracy) if isinstance(accuracy, str) else None
    first = as_number(accuracy) if named is None else float(named)
    if named is None and not 0.0 < first <= 1.0:
        raise UsageError(
            f"--accuracy {accuracy!r}: must be a number above 0, at most 1, or {', '.join(names)}"
        )
    if refine is None or refine_accuracy is None:
        return Passes(first)
    second = as_number(refine_accuracy)
    if not 0.0 < second < (first if first > 0.0 else 1.0):
        raise UsageError(
            f"--refine-accuracy {refine_accuracy!r}: must be a number above 0, below --accuracy"
        )
    return Passes(first, refine, second)


def list_quantities(document: dict) -> list[Quantity]:
    """Return what varies, in the order of the sweep file; a disc gives two."""
    quantities = []
    for entry in document["vary"]:
        if entry["type"] == "fit":
            both = (entry["numbers"][member] for member in ("names", "units"))
            quantities += [Quantity(name, unit) for name, unit in zip(*both, strict=True)]
            continue
        first, *direction = _names(entry)
        named = (entry.get(member, {}) for member in ("cases", "units"))
        more = (*named, entry.get("file", "")) if entry["type"] == "cases" else ()
        quantities.append(Quantity(first, entry.get("unit", ""), *more))
        quantities += [Quantity(name, "deg") for name in direction]
    return quantities


def list_discs(document: dict) -> list[tuple[str, str]]:
    """Return magnitude and direction of every disc."""
    discs = (entry for entry in document["vary"] if entry["type"] == "disc")
    return [(entry["magnitude"], entry["direction"]) for entry in discs]


def _names(entry: dict) -> list[str]:
    """Return the names of the columns of an entry."""
    if entry["type"] == "disc":
        return [entry["magnitude"], entry["direction"]]
    return entry["numbers"]["names"] if entry["type"] == "fit" else [entry["name"]]


def _is_table(entry: dict) -> bool:
    """Return whether an entry has the cases of a table."""
    return entry["type"] == "cases" and "file" in entry


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
    has_table = any(_is_table(entry) for entry in document["vary"])  # before those of the file
    for number, entry in enumerate(document["vary"], 0 if has_table else 1):
        here = f"vary[{number}]" if "file" not in entry else _SOURCES[entry["type"]] + entry["file"]
        where = f"{shown(path)}: {here}"
        for name in _decided(entry):
            if name in owners:
                raise UsageError(f"{where} varies '{name}', which {owners[name]} decides already")
            owners[name] = here
        if entry["type"] in LISTED:
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
    if document["cases"] > 1 and all(entry["type"] in LISTED for entry in document["vary"]):
        raise UsageError(
            f"{shown(path)}: cases is {document['cases']}: must be 1 when only grids and named"
            " cases vary"
        )


def count_drawn(document: dict) -> int:
    """Return how many numbers are drawn at random in a case: one per quantity, two per disc."""
    return sum(len(_names(entry)) for entry in document["vary"] if entry["type"] not in LISTED)


def transform_cube(document: dict, cube: np.ndarray) -> np.ndarray:
    """Return the quantities that are drawn at random for points of the unit cube, shape as there.

    Args:
        document: the members of a sweep file.
        cube: shape (cases, `count_drawn`).
    """
    columns: list[np.ndarray] = []
    for entry in document["vary"]:
        if entry["type"] not in LISTED:
            own = cube.T[len(columns) : len(columns) + len(_names(entry))]
            columns += _TRANSFORMS[entry["type"]](entry, *own)
    return np.column_stack(columns) if columns else cube


def _draw(document: dict, passes: Passes | None) -> Cases:
    """Return the cases of a sweep file."""
    width = count_drawn(document)
    cube = sample_cube(document["sampling"], document["cases"], width, document["seed"])
    return Cases(
        document["vary"], transform_cube(document, cube), passes.accuracy if passes else None
    )


def sample_cube(sampling: str, count: int, width: int, seed: int) -> np.ndarray:
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


def _fit(entry: dict, *u: np.ndarray) -> list[np.ndarray]:
    return list(draw_fitted(entry["numbers"], np.column_stack(u)).T)


_TRANSFORMS: dict[str, Callable[..., list[np.ndarray]]] = {
    "uniform": _uniform,
    "normal": _normal,
    "disc": _disc,
    "fit": _fit,
}
