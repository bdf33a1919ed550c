"""Where vehicles begin: the core places them, the scene holds the places."""

from pathlib import Path

from dockloop.base import paths
from dockloop.base.errors import warn
from dockloop.native.core import place
from dockloop.native.variables import VEHICLES

NEVER_TOUCH = (
    "with these conditions the capture surfaces never touch; the mating planes meet at the"
    " stated time instead"
)


def place_vehicles(document: dict, source: Path) -> None:
    """Put the start states of both vehicles into a document that states them at first contact.

    Args:
        document: a resolved scene, changed in place.
        source: the scene file, for messages.
    """
    if warning := find_placement(document, source):
        warn(f"{paths.shown(source)}: {warning}")


def find_placement(document: dict, source: Path) -> str:
    """Do the work of `place_vehicles`; returns a warning, or an empty text."""
    if document["initial"]["at"] != "first_contact":
        return ""
    placed = place(document, source)
    for vehicle in VEHICLES:
        document[vehicle] |= placed[vehicle]
    if placed["touches"]:
        return ""
    return NEVER_TOUCH
