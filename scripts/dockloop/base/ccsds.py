"""Reads messages of CCSDS in their keyword form as tables: OEM (502.0-B) and AEM (504.0-B).

An orbit ephemeris message has position and velocity, an attitude ephemeris message quaternions:

    CCSDS_OEM_VERS = 2.0
    META_START
    OBJECT_NAME = CHASER
    REF_FRAME = EME2000
    TIME_SYSTEM = UTC
    META_STOP
    2026-06-01T12:00:00.000  6778.0 0.0 0.0  0.0 7.668 0.0

The columns are ``time``, ``position[1]``, ... and ``attitude[1]``, ...: (w, x, y, z), body axes to
the frame that the message names. The turn of CCSDS from A to B is that of B in A.
"""

import re
from datetime import date, timedelta
from pathlib import Path

import numpy as np

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.number import read_number
from dockloop.base.paths import read_bytes, shown
from dockloop.base.tables import Column, Table

_OWN = {  # keywords with an effect, or none on the motion
    "OEM": ("REF_FRAME", "REF_FRAME_EPOCH"),
    "AEM": ("REF_FRAME_A", "REF_FRAME_B", "ATTITUDE_DIR", "ATTITUDE_TYPE", "QUATERNION_TYPE"),
}
_SHARED = (
    *("CREATION_DATE", "ORIGINATOR", "CLASSIFICATION", "MESSAGE_ID", "OBJECT_NAME", "OBJECT_ID"),
    *("CENTER_NAME", "TIME_SYSTEM", "START_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME"),
    *("STOP_TIME", "INTERPOLATION", "INTERPOLATION_METHOD", "INTERPOLATION_DEGREE"),
)
_SECTIONS = ("META_START", "META_STOP", "DATA_START", "DATA_STOP")
_UNITS = {"position": "km", "velocity": "km/s", "attitude": "1"}
_MOTION = [f"{name}[{i}]" for name in ("position", "velocity") for i in (1, 2, 3)]
_QUATERNIONS = {  # places of w, x, y, z in a row
    "FIRST": [f"attitude[{i}]" for i in (1, 2, 3, 4)],
    "LAST": [f"attitude[{i}]" for i in (2, 3, 4, 1)],
}
_HEAD = 4096  # bytes in which a message says what it is
_BEGIN = re.compile(rb"(?:\xef\xbb\xbf)?\s*CCSDS_(OEM|AEM)_VERS")
_DAY_OF_YEAR = re.compile(r"(\d{4})-(\d{3})(T.*)")


def find_kind(path: Path) -> str:
    """Return ``OEM`` or ``AEM``; empty: the file is no message. Raises UsageError."""
    begin = _BEGIN.match(read_bytes(path, "table", _HEAD))
    return begin[1].decode() if begin else ""


def read_message(path: Path) -> Table | None:
    """Return the rows of a message; None: the file is none.

    `Table.form` has its frame, time system and unknown keywords.

    Raises:
        UsageError: naming file, line or keyword, and what is expected.
    """
    kind, place = find_kind(path), shown(path)
    if not kind:
        return None
    found, rows = _split(read_bytes(path, "table").decode("utf-8-sig", "replace"), place)
    frame = found.get("REF_FRAME", "")
    names, signs = _MOTION, np.ones(len(_MOTION))
    if kind == "AEM":
        names = _QUATERNIONS[_find_type(found, place)]
        inverts = _is_from_body(found, place)
        signs = np.array([-1.0 if inverts and name != "attitude[1]" else 1.0 for name in names])
        frame = found["REF_FRAME_B" if is_body(found["REF_FRAME_A"]) else "REF_FRAME_A"]
    lines, cells = [number for number, _ in rows], [row for _, row in rows]
    values = np.array([_read_row(place, number, row[1:], len(names)) for number, row in rows])
    columns = [Column("time", "time", None, None, [_find_date(row[0]) for row in cells], lines)]
    for name, column in zip(names, (values * signs).T, strict=True):
        columns.append(Column(name, name, _UNITS[name.partition("[")[0]], None, column, lines))
    known = [f"CCSDS_{kind}_VERS", *_SHARED, *_OWN[kind]]
    unknown = [f"{name}{did_you_mean(name, known)}" for name in found if name not in known]
    form = {"message": kind, "frame": frame, "time_system": found.get("TIME_SYSTEM", "")}
    return Table(place, columns, "line", form | {"unknown": unknown})


def _split(text: str, place: str) -> tuple[dict[str, str], list[tuple[int, list[str]]]]:
    """Return the keywords with their values, and the rows with the numbers of their lines."""
    found: dict[str, str] = {}
    rows: list[tuple[int, list[str]]] = []
    text = re.sub(  # the lines stay
        r"(?s)COVARIANCE_START.*?COVARIANCE_STOP", lambda part: "\n" * part[0].count("\n"), text
    )
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        name, is_pair, value = (part.strip() for part in line.partition("="))
        if not line or line.startswith("COMMENT"):
            continue
        if line == "META_START" and rows:
            raise UsageError(f"{place}: line {number} begins a second segment: split the message")
        if is_pair:
            found[name] = value
        elif line not in _SECTIONS:
            rows.append((number, line.split()))
    if not rows:
        raise UsageError(f"{place}: has no line of an epoch and values: is the message cut off?")
    return found, rows


def _read_row(place: str, number: int, cells: list[str], count: int) -> list[float]:
    """Return the numbers behind an epoch. Those behind `count`, as accelerations, are not used."""
    if len(cells) < count:
        raise UsageError(
            f"{place}: line {number} has {len(cells)} values behind its epoch: must have {count}"
        )
    try:
        return [read_number(cell) for cell in cells[:count]]
    except ValueError as error:
        raise UsageError(f"{place}: line {number}: {error}") from None


def is_body(frame: str) -> bool:
    """Return whether a frame of CCSDS is fixed on a spacecraft."""
    return frame.upper().startswith("SC_BODY")


def _find_type(found: dict[str, str], place: str) -> str:
    """Return where the scalar part of a quaternion stands: ``FIRST`` or ``LAST``."""
    if (attitude := found.get("ATTITUDE_TYPE", "").upper()) != "QUATERNION":
        raise UsageError(
            f"{place}: ATTITUDE_TYPE is '{attitude}': must be QUATERNION; other forms can come as a"
            " table with chaser.attitude[1] to [4]"
        )
    last = found.get("QUATERNION_TYPE", "LAST").upper()  # version 2 has no other order
    if last not in _QUATERNIONS:
        raise UsageError(f"{place}: QUATERNION_TYPE is '{last}': must be FIRST or LAST")
    return last


def _is_from_body(found: dict[str, str], place: str) -> bool:
    """Return whether the turn is from body axes to the others, so that the inverse is meant."""
    frames = [found.get(name, "") for name in ("REF_FRAME_A", "REF_FRAME_B")]
    if sum(map(is_body, frames)) != 1:
        raise UsageError(
            f"{place}: REF_FRAME_A is '{frames[0]}' and REF_FRAME_B '{frames[1]}': one of them must"
            " be SC_BODY_1, the vehicle"
        )
    direction = found.get("ATTITUDE_DIR", "A2B").upper()
    if direction not in ("A2B", "B2A"):
        raise UsageError(f"{place}: ATTITUDE_DIR is '{direction}': must be A2B or B2A")
    return is_body(frames[0]) == (direction == "A2B")


def _find_date(epoch: str) -> str:
    """Return an epoch with month and day."""
    found = _DAY_OF_YEAR.fullmatch(epoch)
    if not found:
        return epoch
    year, day, rest = found.groups()
    return f"{date(int(year), 1, 1) + timedelta(int(day) - 1)}{rest}"
