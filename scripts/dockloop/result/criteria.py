"""Criteria: texts such as ``captured within 5 s and load_ratio < 1`` that a docking meets or not.

A criterion is made of

* conditions: ``captured``, ``contact``, the names of other outcomes (``rebound``, ``miss``),
  outputs that are true or false (``latched[1]``); ``captured within 5 s`` also limits the time,
  which counts from first contact (that of ``contact``: from the start),
* comparisons of numbers: ``load_ratio < 1``, ``0.1 <= relative.axial <= 0.2``; of outputs at the
  end of the run, peak loads, the quantities that vary; with ``+ - * /``, ``abs``, ``min``, ``max``,
* comparisons of choices with their names: ``phase == "aligned"``,
* ``and``, ``or``, ``not``, parentheses.

The text is parsed by Python, but nothing of it is executed: every node of the tree must be one of
those above. What never happens is at a time of plus infinity.
"""

import ast
import math
import operator
import re
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.native.core import list_loads, read_choices
from dockloop.native.variables import Variable, happened

Values = Mapping[str, Any]
NEVER = ("time_of_contact", "time_of_capture")  # see has_happened()
PEAK = "capture.peak."
PEAK_TIME = "capture.peak_time."
_LONGEST = 500  # characters of a criterion
_EVENTS = {  # that `within` takes: their time, and the time from which it counts
    "captured": ("time_of_capture", "time_of_contact"),
    "contact": ("time_of_contact", None),
}
_WITHIN = re.compile(r"([\w.\[\]]+)\s+within\s+([-+.\deE]+)(?:\s*s)?\b")
_COMPARE: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ARITHMETIC: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: lambda a, b: a / b if b else math.nan,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max}


@dataclass(frozen=True)
class Criterion:
    """A condition on one docking.

    Attributes:
        text: what the user wrote.
        outputs: outputs of the FMU that it looks at.
        calc: returns whether values meet it: outputs at the end and what varies, by name.
        grade: says how far values are from the limit: above 0 where they meet it. Conditions
            without a number have the grades 1 and -1.
    """

    text: str
    outputs: tuple[str, ...]
    calc: Callable[[Values], bool]
    grade: Callable[[Values], float]

    def holds(self, values: Values) -> bool:
        """Return whether a docking meets the criterion.

        Args:
            values: at least its `outputs`, at the end of the run, and the quantities that vary.
        """
        return bool(self.calc(_with_never(values)))

    def rank(self, values: Values) -> float:
        """Return how near a docking is to meeting the criterion: infinite if it does."""
        return math.inf if self.holds(values) else min(self.grade(_with_never(values)), 0.0)


def say_not_seen(stop: float, end: float, steps: Mapping[str, float] | None = None) -> str | None:
    """Say what runs that end before their scene have not seen; None: they run to its end.

    Args:
        stop: end of the runs [s].
        end: end of the scene [s].
        steps: steps of the sequence that begin later, with their times [s], where they are known.
    """
    if stop >= end:
        return None
    text = f"not seen: the scene runs to {end:g} s, and what happens after {stop:g} s"
    if steps:
        text += ", with the steps " + ", ".join(f"'{n}' ({t:.4g} s)" for n, t in steps.items())
        text += ","
    return f"{text} is not judged"


def has_happened(name: str, value: float) -> bool:
    """Return whether an output is not the time, -1, of what did not happen."""
    return not (name in NEVER or name.startswith(PEAK_TIME)) or happened(value)


def _with_never(values: Values) -> Values:
    """Return values in which what never happened is at a time of plus infinity."""
    return {n: v if has_happened(n, v) else math.inf for n, v in values.items()}


@dataclass(frozen=True)
class _Term:
    """A part of a criterion: what kind of value it has, and how it follows from values."""

    kind: str  # condition, number, text, choice
    calc: Callable[[Values], Any]
    variable: str = ""  # of a choice
    graded: Callable[[Values], float] | None = None  # of a condition with numbers

    def grade(self, v: Values) -> float:
        """Return how far a condition is from its limit."""
        if self.graded is None:
            return 1.0 if self.calc(v) else -1.0
        grade = self.graded(v)
        return -math.inf if math.isnan(grade) else grade


def parse_criterion(
    text: str,
    outputs: Mapping[str, Variable],
    quantities: Collection[str] = (),
    *,
    option: str = "--criterion",
) -> Criterion:
    """Parse a criterion.

    Args:
        text: as in the head of this module.
        outputs: variables of the FMU that are outputs, by name.
        quantities: names of other numbers, those that vary.
        option: of the command line, for messages.

    Raises:
        UsageError: naming the criterion, what is wrong in it, and what can be written.
    """
    return _Parser(text, outputs, quantities, option).parse()


class _Parser:
    """Turns the tree of a text into a function of values."""

    def __init__(
        self,
        text: str,
        outputs: Mapping[str, Variable],
        quantities: Collection[str],
        option: str,
    ) -> None:
        self._text, self._outputs, self._quantities = text, outputs, quantities
        self._option = option
        self._used: dict[str, None] = {}
        self._short = {load: f"{PEAK}{load}" for load in (*list_loads(), "load_ratio")}
        outcomes = read_choices()["outcome"] if "outcome" in outputs else ()
        self._outcomes = {
            choice.name.replace(" ", "_"): choice.number
            for choice in outcomes
            if choice.name not in _EVENTS
        }

    def parse(self) -> Criterion:
        """Return the criterion."""
        if not self._text.strip() or len(self._text) > _LONGEST:
            raise self._error(f"must have 1 to {_LONGEST} characters")
        try:
            term = self._visit(self._read_tree())
        except (ValueError, RecursionError, MemoryError):
            raise self._error("cannot be read: it is nested too deeply, or no text") from None
        if term.kind != "condition":
            raise self._error(f"is a {term.kind}, no condition: compare it, e.g. load_ratio < 1")
        return Criterion(self._text, tuple(self._used), term.calc, term.grade)

    def _error(self, wrong: str) -> UsageError:
        return UsageError(f"{self._option} '{self._text}': {wrong}")

    def _read_tree(self) -> ast.expr:
        text = _WITHIN.sub(r"within(\1, \2)", self._text.strip())
        if re.search(r"\bwithin\b(?!\()", text):
            raise self._error("'within' needs an event and a time, e.g. captured within 5 s")
        try:
            return ast.parse(text, mode="eval").body
        except SyntaxError as error:
            near = text[max(0, (error.offset or 1) - 1) :][:20] or "its end"
            raise self._error(
                f"cannot be read at '{near}': write comparisons (<, <=, ==, !=, >=, >) with and,"
                " or, not"
            ) from None

    def _visit(self, node: ast.expr) -> _Term:
        match node:
            case ast.BoolOp():
                return self._join(node)
            case ast.UnaryOp(op=ast.Not()):
                inner = self._want("condition", node.operand)
                return _Term(
                    "condition", lambda v: not inner.calc(v), graded=lambda v: -inner.grade(v)
                )
            case ast.UnaryOp(op=ast.USub()):
                inner = self._want("number", node.operand)
                return _Term("number", lambda v: -inner.calc(v))
            case ast.BinOp() if type(node.op) in _ARITHMETIC:
                left, right = self._want("number", node.left), self._want("number", node.right)
                combine = _ARITHMETIC[type(node.op)]
                return _Term("number", lambda v: combine(left.calc(v), right.calc(v)))
            case ast.Compare():
                return self._compare(node)
            case ast.Call(func=ast.Name(id="within"), args=[event, limit]):
                return self._limit(ast.unparse(event), limit)
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in _FUNCTIONS:
                return self._call(name, node.args)
            case ast.Constant(value=bool(value)):
                return _Term("condition", lambda _: value)
            case ast.Constant(value=int(value) | float(value)):
                if abs(value) > sys.float_info.max:
                    raise self._error("has a number that is too large: must be below 1e308")
                return _Term("number", lambda _: value)
            case ast.Constant(value=str(value)):
                return _Term("text", lambda _: value)
            case ast.Name() | ast.Attribute() | ast.Subscript():
                return self._name(ast.unparse(node))
        raise self._error(f"'{ast.unparse(node)}' has no place in a criterion")

    def _want(self, kind: str, node: ast.expr) -> _Term:
        """Return a part that must be of one kind."""
        term = self._visit(node)
        if term.kind != kind:
            hint = ": compare it, e.g. load_ratio < 1" if kind == "condition" else ""
            raise self._error(f"'{ast.unparse(node)}' is a {term.kind}, no {kind}{hint}")
        return term

    def _join(self, node: ast.BoolOp) -> _Term:
        parts = [self._want("condition", value) for value in node.values]
        is_and = isinstance(node.op, ast.And)
        join, pick = (all, min) if is_and else (any, max)
        return _Term(
            "condition",
            lambda v: join(part.calc(v) for part in parts),
            graded=lambda v: pick(part.grade(v) for part in parts),
        )

    def _call(self, name: str, arguments: list[ast.expr]) -> _Term:
        if len(arguments) < (1 if name == "abs" else 2) or (name == "abs" and len(arguments) > 1):
            raise self._error(f"{name}() has {len(arguments)} numbers in it: abs takes 1, min and"
                              " max take several")  # fmt: skip
        parts = [self._want("number", argument) for argument in arguments]
        function = _FUNCTIONS[name]
        return _Term("number", lambda v: function(*(part.calc(v) for part in parts)))

    def _compare(self, node: ast.Compare) -> _Term:
        """Return a comparison, or a chain of some."""
        terms = [self._visit(part) for part in (node.left, *node.comparators)]
        if any(term.kind in ("choice", "text") for term in terms):
            return self._compare_choice(node, terms)
        for term, part in zip(terms, (node.left, *node.comparators), strict=True):
            if term.kind != "number":
                raise self._error(f"'{ast.unparse(part)}' is a {term.kind} and cannot be compared")
        pairs = list(zip(node.ops, terms[:-1], terms[1:], strict=True))
        if any(type(op) not in _COMPARE for op in node.ops):
            raise self._error(f"'{ast.unparse(node)}': compare with <, <=, ==, !=, >= or >")

        def calc(v: Values) -> bool:
            return all(_COMPARE[type(op)](a.calc(v), b.calc(v)) for op, a, b in pairs)

        def grade(v: Values) -> float:
            return min(_grade(op, a.calc(v), b.calc(v)) for op, a, b in pairs)

        return _Term("condition", calc, graded=grade)

    def _compare_choice(self, node: ast.Compare, terms: list[_Term]) -> _Term:
        """Return ``phase == "aligned"`` or ``outcome != "miss"``."""
        kinds = sorted(term.kind for term in terms)
        is_fit = kinds in (["choice", "text"], ["choice", "number"])
        if not is_fit or not isinstance(node.ops[0], ast.Eq | ast.NotEq):
            raise self._error(
                f"'{ast.unparse(node)}': a choice is compared with one of its names, by == or !=,"
                ' e.g. outcome == "captured"'
            )
        choice, other = terms if terms[0].kind == "choice" else terms[::-1]
        wanted = self._constant(other)
        if other.kind == "text":
            names = {c.name: c.number for c in _find_choices(choice.variable)}
            if wanted not in names:
                near = did_you_mean(wanted, names)
                raise self._error(
                    f"'{choice.variable}' is never '{wanted}'{near}: it is one of"
                    f" {', '.join(names)}"
                )
            wanted = names[wanted]
        compare = _COMPARE[type(node.ops[0])]
        return _Term("condition", lambda v: compare(int(choice.calc(v)), wanted))

    def _limit(self, event: str, node: ast.expr) -> _Term:
        """Return ``EVENT within T s``."""
        if event not in _EVENTS:
            raise self._error(f"'{event}' has no time: 'within' takes one of {', '.join(_EVENTS)}")
        limit = self._constant(self._want("number", node))
        if not limit >= 0.0:
            raise self._error(f"'within' has the time {limit:g} s: must be at least 0 s")
        happened, (name, since) = self._name(event), _EVENTS[event]
        time = self._output(name)
        begin = self._output(since) if since else None

        def delay(v: Values) -> float:
            return time(v) - (begin(v) if begin else 0.0)

        def calc(v: Values) -> bool:
            return happened.calc(v) and delay(v) <= limit

        def grade(v: Values) -> float:
            return limit - delay(v) if happened.calc(v) else -math.inf

        return _Term("condition", calc, graded=grade)

    def _constant(self, term: _Term) -> Any:
        """Return the value of a part in which nothing varies."""
        try:
            return term.calc({})
        except KeyError as error:
            raise self._error(f"{error} varies: a number or a name must stand there") from None

    def _name(self, name: str) -> _Term:
        """Return what a name stands for."""
        if name == "contact" and "time_of_contact" in self._outputs:
            time = self._output("time_of_contact")
            return _Term("condition", lambda v: time(v) < math.inf)
        if name in self._outcomes and name not in self._outputs:
            number, outcome = self._outcomes[name], self._output("outcome")
            return _Term("condition", lambda v: int(outcome(v)) == number)
        if name in self._quantities:
            return _Term("number", lambda v: v[name])
        full = self._short.get(name, name)
        if full not in self._outputs:
            known = [*self._outputs, *self._short, *self._outcomes, *_EVENTS, *self._quantities]
            raise self._error(
                f"there is no '{name}'{did_you_mean(name, known)}: outputs that the scene exports"
                " can stand here (dockloop variables SCENE), and load_ratio, captured, contact,"
                " rebound, miss"
            )
        calc = self._output(full)
        if name == "captured" and "time_of_capture" in self._outputs:
            return self._captured(calc)
        if self._outputs[full].type == "Boolean":
            return _Term("condition", lambda v: bool(calc(v)))
        if _find_choices(full):
            return _Term("choice", calc, full)
        return _Term("number", calc)

    def _captured(self, calc: Callable[[Values], Any]) -> _Term:
        """Return ``captured``; its grade falls with the time of the capture."""
        time = self._output("time_of_capture")

        def grade(v: Values) -> float:
            return 1.0 / (1.0 + max(0.0, time(v))) if calc(v) else -1.0

        return _Term("condition", lambda v: bool(calc(v)), graded=grade)

    def _output(self, name: str) -> Callable[[Values], Any]:
        """Return how an output is read, and remember that it is."""
        if name not in self._outputs:
            raise self._error(f"needs the output '{name}', which the scene does not export")
        self._used[name] = None
        return lambda v: v[name]


def _grade(op: ast.cmpop, a: float, b: float) -> float:
    """Return how far a comparison is from its limit, over the size of the right side."""
    scale = abs(b) if 0.0 < abs(b) < math.inf else 1.0
    match op:
        case ast.Lt() | ast.LtE():
            return (b - a) / scale
        case ast.Gt() | ast.GtE():
            return (a - b) / scale
        case ast.Eq():
            return -abs(a - b) / scale
    return abs(a - b) / scale


def _find_choices(variable: str) -> tuple:
    """Return the choices of an output; those of every latch have one list."""
    return read_choices().get(re.sub(r"\[\d+\]", "", variable), ())
