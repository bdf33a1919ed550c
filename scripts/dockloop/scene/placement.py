"""Where vehicles begin: the core places them, the scene holds the places."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dockloop.base.errors import DockloopError, UsageError, warn
from dockloop.native.core import core_errors, name_source, place, to_json
from dockloop.native.variables import VEHICLES
from dockloop.scene.resolve import SceneReader

NEVER_TOUCH = (
    "with these conditions the capture surfaces never touch; the mating planes meet at the"
    " stated time instead"
)
_AT_START = (
    "no effect while initial.at is not 'first_contact': the states of [chaser] and [target] hold"
)
_IN_SEQUENCE = "no effect in a sequence, whose steps say when vehicles part"
_NOT_DRIVEN = "no effect without a vehicle that a host integrates: chaser.motion=driven"
_STARTS = ("at", "capture_body", "joints")  # of [initial], all that acts at the start


def find_idleness(key: str, document: dict) -> str:
    """Return why a key of a resolved scene has no effect; empty: it acts."""
    section, member = (*key.split("."), "")[:2]
    if section == "initial" and member not in _STARTS:
        return "" if document["initial"]["at"] == "first_contact" else _AT_START
    if section == "coupling":
        motions = [document.get(vehicle, {}).get("motion") for vehicle in VEHICLES]
        return "" if "driven" in motions else _NOT_DRIVEN
    if key == "phases.rebound_gap" and "sequence" in document["mechanism"]:
        return _IN_SEQUENCE
    return ""


def _list_unused(initial: dict) -> list[str]:
    """Return the keys of conditions at first contact that a scene without one states."""
    values = {
        "approach_time": initial["approach_time"],
        "closing_speed": initial["closing_speed"],
        "lateral_offset": initial["lateral"],
        "pitch_yaw_deg": initial["tilt"],
        "roll_deg": initial["roll"],
        "lateral_speed": initial["lateral_velocity"],
        "roll_rate_deg_s": initial["angular_velocity"][0],
        "pitch_yaw_rate_deg_s": initial["angular_velocity"][1:],
    }
    return [f"initial.{key}" for key, value in values.items() if np.any(value)]


def read_placed(
    path: Path,
    overrides: Sequence[str] = (),
    reader: SceneReader | None = None,
    say: Callable[[str], None] | None = None,
    given_by: Mapping[str, str] | None = None,
    *,
    starts: bool = False,
) -> dict:
    """Resolve a scene, and put the start states of both vehicles into the document.

    Args:
        path: the scene file.
        overrides: ``KEY=VALUE`` texts, as given to ``--scene``.
        reader: of this scene, which has read its files.
        say: receives a warning; default: it is printed.
        given_by: as for `SceneReader.resolve`.
        starts: let a docking start, too: values that go together are checked there.

    Raises:
        UsageError: naming override or file, member, value and limit.
    """

    def place_and_check(document: dict) -> str:
        warning = find_placement(document, path)
        with core_errors(path) as core:
            docking = core.Docking(to_json(document), name_source(path))
            if starts:
                docking.start()
        return warning

    document = (reader or SceneReader(path)).resolve(overrides, given_by, place_and_check, say)
    for text in overrides:
        why = find_idleness(text.partition("=")[0].strip(), document)
        if why and why != _AT_START:  # of that the placement warns
            begin = (given_by or {}).get(text, f"--scene {text}")
            (say or warn)(f"{begin}: has {why}")
    return document


@contextmanager
def blaming_start(path: Path, overrides: Sequence[str], label: str = "") -> Iterator[None]:
    """Let a refusal to start begin with the override to blame, if the scene alone does not start.

    Args:
        path: the scene file.
        overrides: ``KEY=VALUE`` texts, as given to ``--scene``.
        label: with what the refusal begins, unless it begins with the file or with the member.
    """
    try:
        yield
    except UsageError as error:
        try:
            read_placed(path, overrides, say=lambda _: None, starts=True)
        except DockloopError as found:
            said = str(error).removeprefix(label).removeprefix(f"{name_source(path)}: ")
            if isinstance(found, UsageError) and str(found).endswith(said):
                raise found from None
        raise


def find_placement(document: dict, source: Path) -> str:
    """Put the start states of both vehicles into a document that states them at first contact.

    Args:
        document: a resolved scene, changed in place.
        source: the scene file, for messages.

    Returns:
        A warning, or an empty text.
    """
    if document["initial"]["at"] != "first_contact":
        unused = _list_unused(document["initial"])
        verb = "have" if unused[1:] else "has"
        return f"{' and '.join(unused)} {verb} {_AT_START}" if unused else ""
    placed = place(document, source)
    for vehicle in VEHICLES:
        document[vehicle] |= placed[vehicle]
    if placed["touches"]:
        return ""
    return NEVER_TOUCH
