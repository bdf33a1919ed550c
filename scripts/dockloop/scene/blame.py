"""Finds which setting is to blame for what is said of a scene: by trial, whatever the words are."""

from collections.abc import Callable, Sequence


def find_guilty(settings: Sequence[str], say: Callable[[list[str]], str]) -> str | None:
    """Return the last setting without which nothing is said.

    If there is none, other settings give the same fault or another one. Then it is the last of
    those that remain when all without a part in what is said are left out.

    Args:
        settings: all of them, in their order.
        say: returns what is said of a scene with some of them; an empty text: nothing.

    Returns:
        The setting; None: nothing is said, or the same without any of them.
    """

    def leave_out(text: str, texts: Sequence[str]) -> list[str]:
        return [each for each in texts if each != text]

    said, kept = say([*settings]), [*settings]
    if not said:
        return None
    for text in reversed(settings):
        if not say(leave_out(text, settings)):
            return text
    for text in settings:
        if say(leave_out(text, kept)) == said:
            kept = leave_out(text, kept)
    return kept[-1] if kept else None
