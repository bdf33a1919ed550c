"""The two ways in which a command fails, and the help that a misspelt name gets."""

import difflib
from collections.abc import Iterable


class DockloopError(Exception):
    """The work failed. The text is one sentence for people."""

    exit_status = 1


class UsageError(DockloopError):
    """Bad usage or a bad file: the text names the file, the member and the limit."""

    exit_status = 2


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Suggest the known names nearest to a misspelt one.

    Args:
        word: what was written.
        known: what could have been meant.

    Returns:
        `` (did you mean 'a' or 'b'?)`` with a leading blank, or an empty string.
    """
    near = difflib.get_close_matches(word, list(known), n=3, cutoff=0.6)
    return f" (did you mean {' or '.join(repr(name) for name in near)}?)" if near else ""
