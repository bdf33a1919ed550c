"""Words of the command line that several commands share, next to the parser."""

from argparse import Namespace as Options
from collections.abc import Callable, Iterable
from typing import Any

LIMIT = 60.0  # s of processor time that a docking to be judged may take


def list_words(
    options: Options, names: Iterable[str], write: Callable[[Any], str] = str
) -> list[str]:
    """Return the words that give options again: ``--scene``, ``--set``, and those of `names`."""
    words = []
    for option, texts in (("--scene", options.overrides), ("--set", getattr(options, "set", []))):
        words += [word for text in texts for word in (option, text)]
    for name in names:
        value = getattr(options, name)
        if isinstance(value, bool):
            words.append(f"--{name}" if value else f"--no-{name}")
        elif value is not None:
            words += [f"--{name}", write(value)]
    return words
