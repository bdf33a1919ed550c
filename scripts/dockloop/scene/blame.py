"""Finds which setting is to blame for what is said of a scene: by trial, whatever the words are."""

from collections.abc import Callable, Sequence


def find_guilty(settings: Sequence[str], say: Callable[[list[str]], str]) -> str | None:
    """Return the last setting without which nothing is said, or else something else is said.

    Args:
        settings: all of them, in their order.
        say: returns what is said of a scene with some of them; an empty text: nothing.

    Returns:
        The setting; None: nothing is said, or the same without any of them.
    """
    said = say([*settings])
    if not said or said == say([]):
        return None
    others = {text: say([each for each in settings if each != text]) for text in settings}
    alone = [text for text, other in others.items() if not other]
    changing = [text for text, other in others.items() if other != said]
    return (alone or changing or settings)[-1]
