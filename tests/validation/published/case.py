"""What every case of this folder is made of: inputs with their origin, and comparisons with bands.

A band is a member of the comparison and is written before the result is known. A comparison that
fails for a known reason carries that reason; the page shows both, and the band stays as it is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

GIVEN, ASSUMED, DERIVED = "given", "assumed", "derived"


@dataclass(frozen=True)
class Input:
    """One number of a case, with its origin: given in the source, assumed here, or derived."""

    name: str
    value: str
    origin: str
    where: str = ""


@dataclass(frozen=True)
class Comparison:
    """One comparison: what was found, what was expected, and whether the band holds."""

    what: str
    found: str
    expected: str
    band: str
    agrees: bool
    reason: str = ""  # why it fails, where that is known

    @property
    def verdict(self) -> str:
        """Return the word of the table."""
        return "agrees" if self.agrees else "fails"


@dataclass(frozen=True)
class Case:
    """One case: source, inputs, and the comparisons of each strength.

    Attributes:
        letter: of the list of cases.
        title: one line.
        source: with pages.
        inputs: all numbers that are not those of a shipped file.
        words: what the case shows and what it does not show.
        exact: against a closed form or an independent solution; a failure fails the tests.
        trend: order, sign, ratio, scale; a failure fails the release run.
        scenario: reported only.
        figure: draws into matplotlib axes; None for no figure.
    """

    letter: str
    title: str
    source: str
    inputs: tuple[Input, ...]
    words: str
    exact: Callable[[], list[Comparison]] | None = None
    trend: Callable[[], list[Comparison]] | None = None
    scenario: Callable[[], list[Comparison]] | None = None
    figure: Callable[[object], None] | None = None


def compare_near(
    what: str, found: float, expected: float, *, relative: float = 0.0, absolute: float = 0.0
) -> Comparison:
    """Compare two numbers; the band is `absolute` plus `relative` times the expected size."""
    band = absolute + relative * abs(expected)
    stated = f"{relative:g} relative" if relative else f"{absolute:g} absolute"
    digits = max(3, 1 + math.ceil(-math.log10(relative or absolute / max(abs(expected), absolute))))
    return Comparison(
        what,
        f"{found:.{digits}g}",
        f"{expected:.{digits}g}",
        stated,
        bool(abs(found - expected) <= band),
    )


def compare_range(what: str, found: float, low: float, high: float, reason: str = "") -> Comparison:
    """Compare a number with a published range."""
    agrees = bool(low <= found <= high)
    return Comparison(
        what, f"{found:.3g}", f"{low:g} to {high:g}", "the range", agrees, "" if agrees else reason
    )


def compare_words(
    what: str, found: str, expected: str, agrees: bool, reason: str = ""
) -> Comparison:
    """Compare an order, a sign or an outcome."""
    return Comparison(
        what, found, expected, "order or sign", bool(agrees), "" if agrees else reason
    )
