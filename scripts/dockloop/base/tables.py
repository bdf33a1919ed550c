"""The one reader of tables that people and other programs write.

Text (CSV), Excel, Parquet, NPZ, MAT and HDF5 become the same: columns of cells, each with name,
unit and place. Of a text, delimiter, decimal comma, encoding, comments, header and row of units are
found, or stated (``--csv "sep=;, decimal=,"``). The content of a file says what it is, its name
does not. Nothing is guessed that changes values without a word: `Table.form` has what was found.
"""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from datetime import time as clock
from decimal import Decimal
from itertools import dropwhile, filterfalse
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import DockloopError, UsageError, did_you_mean
from dockloop.base.number import is_number, read_number
from dockloop.base.paths import read_bytes, shown
from dockloop.base.progress import import_optional
from dockloop.base.units import find_factor, is_unit

FORM = {  # what can be stated of a table: meaning
    "sep": "between cells: one character, tab or space",
    "decimal": ". or ,",
    "encoding": "such as utf-8 or cp1252",
    "comment": "beginning of lines that are left out",
    "header": "number of the line with the names",
    "units": "number of the line with the units",
    "date": "form of times, such as %d/%m/%Y %H:%M:%S.%f",
    "sheet": "of an Excel file",
}
_NAMED = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";"}
_SEPARATORS = ("\t", ";", "|", ",", " ")
_COMMENTS = ("#", "%", "//", "!")
_MISSING = ("", "na", "n/a", "n.a.", "#n/a", "null", "none", "nil", "-", "--")
_NAN = re.compile(r"[+-]?(nan(\(\w*\))?|1[.,]#(qnan|snan|ind)\w*)")  # as C libraries write it
_BOOLEANS = {"true": 1.0, "false": 0.0}
_OTHER_SIGN = {".": ",", ",": "."}
_GROUPED = {
    sign: re.compile(rf"[+-]?\d{{1,3}}(\{other}\d{{3}})+\{sign}\d+")
    for sign, other in _OTHER_SIGN.items()
}
_BETWEEN = r"['\u00a0\u2007\u2009\u2019\u202f]"  # thousands, beyond doubt
_SPACED = re.compile(rf"[+-]?\d{{1,3}}(?:{_BETWEEN}\d{{3}})+(?:[.,]\d+)?")
_FORTRAN = re.compile(r"[+-]?(?:\d+[.,]\d*|[.,]\d+)[dD][+-]?\d+|[+-]?\d+[dD][+-]\d+")  # no "3D2"
_AMBIGUOUS = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}")  # a group of thousands, or decimals
_SAMPLE = 100  # lines that decide about delimiter and decimal sign
_OTHERS: dict[bytes | tuple[bytes, ...], str] = {  # beginning of a file: what it is, what to do
    b"\xd0\xcf\x11\xe0": "an Excel file of before 2007: save it as .xlsx, without a password",
    (b"\x1f\x8b", b"BZh", b"7z\xbc", b"\xfd7zXZ", b"(\xb5/\xfd"): "compressed: unpack it",
    b"TDSm": "a TDMS file of LabVIEW: export the table as CSV or HDF5",
    b"MDF     ": "an MDF file: export the table as CSV or MAT",
    b"\x93NUMPY": "an array without names: write each column by numpy.savez",
    (b"ARROW1", b"FEA1\0"): "an Arrow file: save it as Parquet",
    (b"<?xml", b"<html", b"<!DOCTYPE"): "XML or HTML: export the table as CSV",
    (b"{", b"[{", b"[["): "a JSON file: export the table as CSV",
    b"%PDF": "a PDF file: export the table as CSV",
    b"SQLite format": "a database: export the table as CSV",
}
_HEADING = re.compile(
    r"(?P<name>.*?)"
    r"(?:\s*\[(?P<square>[^\[\]]*)\]|\s*\((?P<round>[^()]*)\)|\s*/\s*(?P<slash>[^\s/][^\s]*)"
    r"|\s*,\s*(?P<comma>[^\W\d_][^,\[\]()]*))"
    r"\s*(?:(?:\+-|±)\s*(?P<accuracy>\S+)\s*)?"
)
_BLANKS = ("_fillvalue", "missing_value")  # attributes of netCDF
_STATED = ("square", "round", "slash", "comma")
_WORD = re.compile(r'"[^"]*"|[\[(][^\])]*[\])](?:\s*(?:\+-|±)\s*\S+)?|[^\s\[(]+(?:\[\d+\]\S*)*')
_MOMENT = re.compile(
    r"(?:(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})\.(\d{1,2})\.(\d{4}))(?:[T\s]+|$))?"
    r"(?:(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d*)?))?\s*(Z|UTC|[+-]\d{2}:?\d{2})?)?"
)


_Moment = tuple[int, float, bool]  # day, second; whether it has a zone, and is in UTC
_Row = tuple[int, list[Any]]  # number of the line, cells


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        heading: as it is written.
        name: without unit and accuracy; empty: it has none.
        unit: as it is written; None: none is stated.
        accuracy: text behind ``+-``; None: none is stated.
        cells: numbers, texts, Booleans, dates; None or an empty text where nothing is.
        lines: where each cell stands: the number of its line or row.
    """

    heading: str
    name: str
    unit: str | None
    accuracy: str | None
    cells: Sequence[Any]
    lines: Sequence[int]


@dataclass(frozen=True)
class Table:
    """A table as it was read.

    Attributes:
        place: of the file, for messages.
        columns: in their order.
        line: what a row is called: ``line`` of a text, else ``row``.
        form: what was found or stated, for people and programs.
        has_order: whether a column belongs to the time on its left.
    """

    place: str
    columns: list[Column]
    line: str = "row"
    form: dict[str, Any] = field(default_factory=dict)
    has_order: bool = True

    def read_numbers(self, column: Column) -> np.ndarray:
        """Return the numbers of a column, NaN where nothing is. Raises UsageError: one is none."""
        if isinstance(column.cells, np.ndarray) and column.cells.dtype.kind in "biuf":
            values = column.cells.astype(float)
        else:
            values = np.array([self._to_number(cell) for cell in column.cells])
        if np.isinf(values).any():
            what = "a finite number; leave a cell empty that was not measured"
            raise self._refuse(column, int(np.argmax(np.isinf(values))), what)
        return values

    def has_moments(self, column: Column) -> bool:
        """Return whether the first cell of a column that is not empty is a date or time of day."""
        cell = next((cell for cell in column.cells if not is_missing(cell)), None)
        return not is_missing(cell) and math.isinf(self._to_number(cell))

    def read_times(self, columns: Sequence[Column]) -> tuple[list[np.ndarray], str]:
        """Return times, NaN where nothing is, and the first of all moments, from which they count.

        Raises:
            UsageError: one is none, or some columns have moments and others numbers.
        """
        with_moments = [self.has_moments(column) for column in columns]
        if not any(with_moments):
            return [self.read_numbers(column) for column in columns], ""
        if not all(with_moments):
            name = columns[with_moments.index(False)].name
            raise UsageError(f"{self.place}: '{name}' has numbers, other times are dates: use one")
        moments = [self._read_moments(column) for column in columns]
        every = [moment for column in moments for moment in column if moment]
        if len(columns) > 1 and any(not day and second >= 86400 for day, second, _ in every):
            raise UsageError(
                f"{self.place}: times of day pass midnight, and there are several: add dates"
            )
        if len({zone for *_, zone in every}) > 1:
            raise UsageError(
                f"{self.place}: some times have a time zone, others none: use one kind"
            )
        day, second, zone = min(every)
        hour, rest = divmod(second, 3600.0)
        start = f"{hour:02.0f}:{rest // 60.0:02.0f}:{rest % 60.0:012.9f}".rstrip("0").rstrip(".")
        start += " UTC" if zone else ""
        times = [
            np.array([86400 * (m[0] - day) + (m[1] - second) if m else math.nan for m in column])
            for column in moments
        ]
        return times, f"{date.fromordinal(day)} {start}" if day else start

    def _read_moments(self, column: Column) -> list[_Moment | None]:
        """Return the moments of a column, None where nothing is."""
        moments: list[_Moment | None] = []
        has_minutes = re.match("m+:s", (column.unit or "").lower())  # else 01:30 is of hours
        days, last = 0, -math.inf
        for row, cell in enumerate(column.cells):
            text = f"0:{cell}" if has_minutes and str(cell).count(":") == 1 else cell
            moment = None if is_missing(cell) else find_moment(text, self.form.get("date"))
            if moment and not moment[0]:  # a time of day, perhaps of the next one
                days += 86400 * (moment[1] + days < last - 43200)
                last = moment[1] + days
                moment = (0, last, moment[2])
            moments.append(moment)
            if moment is None and not is_missing(cell):
                raise self._refuse(
                    column,
                    row,
                    "a number or a time such as 2026-03-31 12:00:00.5; state another form, for"
                    " example --csv 'date=%d/%m/%Y %H:%M:%S'",
                )
        return moments

    def read_values(self, column: Column) -> list[Any]:
        """Return numbers (whole ones as such), Booleans and texts; None where nothing is."""
        return [self._to_value(cell) for cell in column.cells]

    def _refuse(self, column: Column, row: int, what: str) -> UsageError:
        cell = " ".join(str(column.cells[row]).split())
        return UsageError(
            f"{self.place}: '{column.name}' in {self.line} {column.lines[row]} is '{cell}': must be"
            f" {what}"
        )

    def _to_number(self, cell: Any) -> float:
        """Return a number, NaN where nothing is, infinity for what is none."""
        if is_missing(cell):
            return math.nan
        if isinstance(cell, str):
            return find_number(cell, self.form.get("decimal", "."))
        if isinstance(cell, np.timedelta64):
            return math.inf
        try:
            number = float(cell)
        except (TypeError, ValueError, OverflowError):
            return math.inf
        return number

    def _to_value(self, cell: Any) -> Any:
        """Return what a cell says; texts such as none and n/a are texts here."""
        if cell is None or cell != cell or not str(cell).strip():  # noqa: PLR0124  NaN
            return None
        if isinstance(cell, str):
            text, decimal = cell.strip(), self.form.get("decimal", ".")
            if text.lower() in _BOOLEANS:
                return text.lower() == "true"
            number = find_number(text, decimal)
            if not math.isfinite(number):
                return text
            return int(text) if re.fullmatch(r"[+-]?\d+", text) else number
        cell = cell.item() if hasattr(cell, "item") else cell
        if isinstance(cell, float) and cell.is_integer() and abs(cell) < 2**53:
            return int(cell)  # Excel has one kind of number
        cell = float(cell) if isinstance(cell, Decimal) else cell  # of a database
        return cell if is_number(cell) or isinstance(cell, bool) else str(cell)


def is_missing(cell: Any) -> bool:
    """Return whether nothing is in a cell."""
    if isinstance(cell, str):
        text = cell.strip().lower()
        return text in _MISSING or bool(_NAN.fullmatch(text))
    return cell is None or cell != cell  # noqa: PLR0124  not a number, not a time


def find_number(text: str, decimal: str) -> float:
    """Return the number that a text is, with 1 for true; infinity: it is none.

    Thousands may be grouped where this has one meaning only: ``1.234,5`` with a decimal comma,
    ``1'234`` with both. Fortran writes ``1D-3``, and some programs a minus of typography.
    """
    text = text.strip().replace("\u2212", "-")
    if _FORTRAN.fullmatch(text):
        text = text.lower().replace("d", "e")
    if _SPACED.fullmatch(text):
        text = re.sub(_BETWEEN, "", text)
    if _GROUPED[decimal].fullmatch(text):
        text = text.replace(_OTHER_SIGN[decimal], "")
    if decimal == ",":
        text = "?" if "." in text else text.replace(",", ".")
    try:
        return read_number(text)
    except ValueError:
        return _BOOLEANS.get(text.lower(), math.inf)


def find_moment(cell: Any, form: str | None = None) -> _Moment | None:
    """Return a moment, or a time of day of the day 0; None: the cell is none."""
    if isinstance(cell, timedelta | np.timedelta64):
        return 0, float(np.timedelta64(cell) / np.timedelta64(1, "s")), False
    text = cell.isoformat() if isinstance(cell, date | clock) else str(cell).strip()
    if form and isinstance(cell, str):
        try:
            text = datetime.strptime(text, form).isoformat()
        except ValueError:
            return None
    found = _MOMENT.fullmatch(text)
    if not text or not found:
        return None
    *days, hour, minute, second, zone = found.groups()
    year, month, day = days[:3] if days[0] else days[:2:-1]
    try:
        number = date(int(year), int(month), int(day)).toordinal() if year else 0
    except ValueError:
        return None
    since = 3600.0 * int(hour or 0) + 60.0 * int(minute or 0)
    if int(hour or 0) > 24 or int(minute or 0) > 59 or float((second or "0")[:2]) > 60.0:
        return None
    if zone and zone[0] in "+-":
        offset = 3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:])
        since -= offset if zone[0] == "+" else -offset
    return number, since + float((second or "0").replace(",", ".")), bool(zone)


def say_form(form: Mapping[str, Any]) -> str:
    """Say what was found or stated of a table, as far as this is no matter of course."""
    texts = [f"{name} {form[name]!r}" for name in ("sep", "decimal", "sheet") if name in form]
    for name, what in (("header", "names"), ("units", "units")):
        if name in form:
            line = form[name]
            texts.append(f"{what} from {f'line {line}' if isinstance(line, int) else line}")
    return f"{form['kind']}: {', '.join(texts)}" if texts else ""


def parse_form(text: str, option: str = "--csv") -> dict[str, str]:
    """Return what ``sep=;, decimal=,`` states. Raises UsageError naming the option."""
    form: dict[str, str] = {}
    names = "|".join(FORM)
    for part in re.split(rf",\s*(?=(?:{names})\s*=)", text.strip()):
        name, equals, value = part.partition("=")
        name, value = name.strip(), value if value.strip() == "" else value.strip()
        if not equals or name not in FORM:
            near = did_you_mean(name, FORM) or f": must be one of {', '.join(FORM)}"
            raise UsageError(f"{option} '{text}': has '{name}'{near}")
        value = _NAMED.get(value.lower(), value)
        wrong = {
            "sep": "" if len(value) == 1 else "one character, tab or space",
            "decimal": "" if value in (".", ",") else ". or ,",
            "header": "" if value.isdecimal() else "the number of a line",
            "units": "" if value.isdecimal() else "the number of a line",
        }.get(name, "" if value else "a text")
        if wrong:
            raise UsageError(f"{option} '{text}': {name} is '{value}': must be {wrong}")
        form[name] = value
    return form


def read_table(
    path: Path, form: Mapping[str, str] | None = None, *, is_list: bool = False
) -> Table:
    """Read a table from a file of any kind.

    Args:
        path: the file.
        form: what is stated of it, by the names of `FORM`; None: nothing can be, so that no message
            names ``--csv``.
        is_list: its first row has the names, its cells may be texts, and comments stand above them
            only. Otherwise it has numbers, and the names stand above the first row of these.

    Raises:
        UsageError: naming file, line or column, value, and what to do.
        DockloopError: a package is missing.
    """
    content, place = read_bytes(path, "table"), shown(path)
    can_state, form = form is not None, form or {}
    for begin, what in _OTHERS.items():
        if content.startswith(begin):
            raise UsageError(f"{place}: is {what}")
    if not content.strip():
        raise UsageError(f"{place}: is empty: must have a header line and rows of values")
    read = next((r for begin, r in _READERS.items() if content.startswith(begin)), None)
    if content.startswith(b"PK"):
        read = _read_excel if b"xl/workbook" in content else _read_npz
        if read is _read_npz and b"PK\5\6" in content and b".npy" not in content:
            raise UsageError(
                f"{place}: is an archive: unpack it, or save the table as .xlsx or CSV"
            )
    if read is None and path.suffix == ".mat":
        read = _read_mat  # of version 4: begins with numbers
    if read is None:
        return _read_text(content, place, form, is_list=is_list, can_state=can_state)
    try:
        return read(path, place, form, is_list)
    except UsageError:
        raise
    except DockloopError as error:
        raise DockloopError(f"{place}: {error}") from None
    except Exception as error:  # noqa: BLE001  damaged files: each package has errors of its own
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise UsageError(
            f"{place}: cannot be read ({reason}): write it again, or export it as CSV"
        ) from None


def from_frame(frame: Any, place: str) -> Table:
    """Return the table that a DataFrame is; its index counts if it has a name."""
    is_named = any(frame.index.names) and not {*frame.index.names} & {*frame.columns}
    frame = frame.reset_index() if is_named else frame
    frame = frame.astype(object).where(frame.notna(), None)
    names = [str(name) for name in frame.columns]
    lines = range(1, len(frame) + 1)
    cells = (frame.iloc[:, number].tolist() for number in range(len(names)))
    has_commas = all(map(_has_comma_unit, names))
    columns = [
        _make_column(n, c, lines, has_commas=has_commas) for n, c in zip(names, cells, strict=True)
    ]
    return Table(place, columns)


# ------------------------------------------------------------------------------ rows of cells


def _read_text(
    content: bytes, place: str, form: Mapping[str, str], *, is_list: bool, can_state: bool
) -> Table:
    """Read a table of text."""
    text, encoding = _decode(content, place, form.get("encoding"), can_state=can_state)
    found: dict[str, Any] = {"kind": "text", "encoding": encoding}
    comment = form.get("comment")
    lines: list[tuple[int, str]] = []
    comments: list[tuple[int, str]] = []
    stated = form.get("sep")
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        bare = line.strip().lstrip('"')
        if not bare:
            continue
        if not lines and (says := re.fullmatch(r"sep=(.)", bare.rstrip('"'))):
            stated = stated or says[1]  # of Excel and OMSimulator
        elif bare.startswith(comment or _COMMENTS) and not (is_list and lines):
            comments.append((number, line.strip().strip('"').lstrip("".join(_COMMENTS))))
        else:
            lines.append((number, line))
    lines = _leave_labview(place, lines)
    separator, decimal = _find_separator(lines, stated, form.get("decimal"))
    if not separator and not is_list:
        state = "; state the delimiter by --csv 'sep=;'" if can_state else ""
        raise UsageError(
            f"{place}: has no columns: must have at least two, with ; or , or a tab or blanks"
            f" between them{state}"
        )
    separator = separator or ","  # one column
    found |= {"sep": separator, "decimal": decimal}
    rows = _split_lines(place, lines, separator, can_state=can_state)
    above = [(number, _split(line, separator)) for number, line in comments]
    table = _from_rows(place, "line", rows, above, {**found, **form}, is_list=is_list)
    if "decimal" not in form:
        _check_decimal(table, can_state=can_state)
    return table


def _leave_labview(place: str, lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the lines of a table without the headers of a LabVIEW file (LVM) and its comments."""
    ends = [i for i, (_, line) in enumerate(lines, 1) if line.startswith("***End_of_Header***")]
    if not ends or ends[-1] == len(lines):
        return lines
    if len(ends) > 2:
        raise UsageError(f"{place}: has {len(ends) - 1} segments of LabVIEW: write each to a file")
    (number, names), *rows = lines[ends[-1] :]
    return [(number, names.rstrip().removesuffix("Comment") + "\n"), *rows]


def _check_decimal(table: Table, *, can_state: bool) -> None:
    """Refuse a column whose sign may mean thousands where no other cell says what it means.

    A decimal point is beyond doubt but between semicolons, which belong to decimal commas.
    """
    decimal = table.form.get("decimal", ".")
    is_known = (decimal == "." and table.form.get("sep") != ";") or any(
        decimal in cell
        and not _AMBIGUOUS.fullmatch(cell.strip())
        and math.isfinite(find_number(cell, decimal))
        for column in table.columns
        for cell in filter(_is_text, column.cells)
    )
    for column in table.columns:
        cells = enumerate(column.cells)
        signed = [i for i, cell in cells if _is_text(cell) and ("," in cell or "." in cell)]
        found = [_AMBIGUOUS.fullmatch(column.cells[i].strip()) for i in signed]
        signs = {each[1] for each in found if each}
        if not found or not all(found) or (is_known and signs == {decimal}):
            continue
        cell = column.cells[signed[0]].strip()
        whole, sign, part = re.split(r"([.,])", cell)
        state = f", or state --csv 'decimal={sign}' for the latter" if can_state else ""
        raise UsageError(
            f"{table.place}: '{column.name}' in {table.line} {column.lines[signed[0]]} is '{cell}':"
            f" may mean {whole}{part} or {float(f'{whole}.{part}')}: write it like this{state}"
        )


def _decode(content: bytes, place: str, stated: str | None, *, can_state: bool) -> tuple[str, str]:
    """Return a text and its encoding."""
    is_wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    guesses = ["utf-16"] if is_wide else ["utf-8-sig", "cp1252"]
    head = content[:1000].rstrip(b"\0")
    if not is_wide and 4 * head.count(0) > len(head):
        guesses = ["utf-16-be" if content[0] == 0 else "utf-16-le"]
    for encoding in [stated] if stated else guesses:
        try:
            text = content.decode(encoding)
        except LookupError:
            raise UsageError(f"--csv 'encoding={stated}': there is no such encoding") from None
        except UnicodeDecodeError:
            continue
        text = text.lstrip("\ufeff").rstrip("\0\x1a")  # marks again; ends of logs and of DOS files
        found = re.findall(r"[\0-\x08\x0e-\x1f]", text)
        if not found:
            return text, encoding.removesuffix("-sig")
        if 100 * len(found) < len(text):
            number = text.partition(found[0])[0].count("\n") + 1
            raise UsageError(f"{place}: line {number} has the character {found[0]!r}: remove it")
    state = "state another encoding by --csv 'encoding=NAME'" if can_state else "save it as UTF-8"
    raise UsageError(
        f"{place}: is no table: neither text in {stated or 'UTF-8 or Windows-1252'} nor"
        f" Excel, Parquet, NPZ, MAT or HDF5; {state}"
    )


def _split(line: str, separator: str) -> list[str]:
    """Return the cells of a line."""
    if separator != " ":
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    cells: list[str] = []
    for word in _WORD.findall(line):
        if cells and word[0] in "[(":  # the unit of a name
            cells[-1] += f" {word}"
        else:
            cells.append(word.strip('"'))
    return cells


def _split_lines(
    place: str, lines: list[tuple[int, str]], separator: str, *, can_state: bool
) -> list[_Row]:
    """Return the cells of all lines, with the number of the line at which they end."""
    if separator == " ":
        return [(number, _split(line, separator)) for number, line in lines]
    rows = []
    reader = csv.reader(
        (line for _, line in lines), delimiter=separator, skipinitialspace=True, strict=True
    )
    begin = 0
    try:
        for cells in reader:
            rows.append((lines[begin][0], list(cells)))
            begin = reader.line_num
    except csv.Error as error:
        state = ", or state the delimiter by --csv 'sep=;'" if can_state else ""
        raise UsageError(
            f"{place}: line {lines[min(begin, len(lines) - 1)][0]} cannot be split into cells"
            f" ({error}): close its quotes{state}"
        ) from None
    return rows


def _find_separator(
    lines: list[tuple[int, str]], separator: str | None, decimal: str | None
) -> tuple[str, str]:
    """Return delimiter (empty: none) and decimal sign: those with which most cells are values."""
    best: tuple[float, str, str] = (0.0, "", decimal or ".")
    sample = [line for _, line in lines[:_SAMPLE]]
    for sep in (separator,) if separator else _SEPARATORS:
        stronger = _SEPARATORS[: _SEPARATORS.index(sep)] if sep in _SEPARATORS[:4] else ()
        rows = [_split(line, sep) for line in sample]
        width = Counter(len(row) for row in rows if row).most_common(1)[0][0] if rows else 0
        if width < 2 and not separator:
            continue
        even = [row for row in rows if len(row) == width]
        cells = [cell for row in even for cell in row if not is_missing(cell)]
        for sign in (decimal,) if decimal else (".", ","):
            right = sum(_is_value(cell, sign) for cell in cells)
            wrong = sum(any(c in cell for c in stronger) for cell in cells)
            share = (right - wrong) / max(1, len(cells))
            score = len(even) / len(rows) * (0.01 + share)
            if score > best[0]:
                best = (score, sep, sign)
    return best[1:]


def _is_value(cell: Any, decimal: str, form: str | None = None) -> bool:
    """Return whether something is a number, a Boolean or a time."""
    if not isinstance(cell, str):
        return not is_missing(cell)
    return math.isfinite(find_number(cell, decimal)) or find_moment(cell, form) is not None


def _from_rows(
    place: str,
    line: str,
    rows: list[_Row],
    comments: list[_Row],
    form: dict[str, Any],
    *,
    is_list: bool,
) -> Table:
    """Return the table of rows: finds names and units above the values.

    Args:
        place: of the file, for messages.
        line: what a row is called.
        rows: those that are no comments, each with its number.
        comments: split like these.
        form: what is known of the table; what is found is added.
        is_list: as in `read_table`.
    """
    if not rows:
        raise UsageError(f"{place}: has no rows: must have a header line and rows of values")
    width = Counter(len(cells) for _, cells in rows).most_common(1)[0][0]
    if all(is_missing(cells[-1]) for _, cells in rows if len(cells) == width):
        width -= 1  # rows end with a delimiter
    rows = [(n, c[:width] if all(map(is_missing, c[width:])) else c) for n, c in rows]
    head, of_units, first = _find_heads(place, line, rows, width, form, is_list=is_list)
    last = rows[first][0] if first < len(rows) else math.inf
    above = [row for row in comments if row[0] < last and len(row[1]) == width]
    name_line = rows[head][0] if head is not None else above[0][0] if above else 0
    units: list[Any] | None = None
    if of_units is not None:
        form["units"], units = rows[of_units]
    elif above and above[-1][0] > name_line and _have_time(above[-1][1]):  # below the names
        form["units"], units = above.pop()
    if head is not None:
        form["header"], names = rows[head]
    else:
        form["header"] = "a comment" if above else "none: columns are 1, 2, ..."
        names = above[-1][1] if above else [str(i) for i in range(1, width + 1)]
    for number, cells in rows[first:]:
        if len(cells) != len(names):
            divided = f"; '{form['sep']}' divides the columns" if "sep" in form else ""
            raise UsageError(
                f"{place}: {line} {number} has {len(cells)} values: must have {len(names)}, as the"
                f" header{divided}"
            )
    if first >= len(rows):
        sign = " with a decimal comma" if form.get("decimal") == "," else ""
        raise UsageError(f"{place}: has no rows of values{sign} below its header")
    lines = [number for number, _ in rows[first:]]
    has_commas = all(_has_comma_unit(str(name)) for name in names if name)
    columns = []
    for i, name in enumerate(names):
        heading = "" if name is None else str(name)
        cells = [row[i] for _, row in rows[first:]]
        if heading.strip() or not all(map(is_missing, cells)):
            unit = _strip(str(units[i] or "")) if units and i < len(units) else None
            columns.append(_make_column(heading, cells, lines, unit, has_commas=has_commas))
    return Table(place, columns, line, form)


def _find_heads(
    place: str, line: str, rows: list[_Row], width: int, form: dict[str, Any], *, is_list: bool
) -> tuple[int | None, int | None, int]:
    """Return the indices of the row of names, of the row of units, and of the first values."""

    def count_values(cells: list[Any]) -> int:
        return sum(_is_value(c, form.get("decimal", "."), form.get("date")) for c in cells)

    def is_full(cells: list[Any]) -> bool:
        return len(cells) == width and 2 * sum(not is_missing(c) for c in cells) >= width

    def is_of_values(cells: list[Any]) -> bool:
        filled = sum(not is_missing(c) for c in cells)
        return len(cells) == width and 2 * count_values(cells) > filled

    def has_units(index: int) -> bool:
        return index < len(rows) and _are_units(rows[index][1])

    def find_stated(key: str) -> int | None:
        if key not in form:
            return None
        found = [i for i, (number, _) in enumerate(rows) if number == int(form[key])]
        if not found:
            raise UsageError(f"{place}: has no {line} {form[key]} with cells: state another {key}")
        return found[0]

    body = 0 if is_list else next((i for i, r in enumerate(rows) if is_of_values(r[1])), len(rows))
    above = rows if is_list else rows[:body]
    heads = [i for i, (_, c) in enumerate(above) if is_full(c) and (is_list or not count_values(c))]
    head, of_units = find_stated("header"), find_stated("units")
    if head is None and heads:
        is_below = len(heads) > 1 and has_units(heads[-1])
        head = heads[0] if is_list else heads[-2] if is_below else heads[-1]
    if of_units is None and head is not None and not is_list and has_units(head + 1):
        of_units = head + 1
    first = max((i + 1 for i in (head, of_units) if i is not None), default=0)
    if not is_list:  # a row of descriptions has no values
        has_value = (i for i in range(first, len(rows)) if count_values(rows[i][1]))
        first = next((i for i in has_value if head is not None or is_full(rows[i][1])), len(rows))
    return head, of_units, first


def _are_units(cells: list[Any]) -> bool:
    texts = [cell for cell in cells if not is_missing(cell)]
    are_units = all(isinstance(cell, str) and is_unit(_strip(cell)) for cell in texts)
    return are_units and not all(_is_value(cell, ".") for cell in texts)


def _have_time(cells: list[Any]) -> bool:
    """Return whether cells are units, one of them of time: "t F" are names."""
    return _are_units(cells) and any(find_factor(_strip(str(cell)), "s") for cell in cells)


def _strip(unit: str) -> str:
    return unit.strip().strip("[]()")


def _has_comma_unit(heading: str) -> bool:
    found = _HEADING.fullmatch(" ".join(heading.split()))
    return found is not None and found["comma"] is not None and is_unit(found["comma"])


def _make_column(
    heading: str,
    cells: Sequence[Any],
    lines: Sequence[int],
    unit: str | None = None,
    *,
    has_commas: bool = False,
) -> Column:
    """Return a column; its heading may have unit and accuracy, ``gap [mm] +-0.5``.

    Units behind a comma count if all headings have them: "Leg, A" is a name.
    """
    heading = " ".join(heading.split())
    found = _HEADING.fullmatch(heading) if unit is None else None
    if found and found["comma"] and not has_commas:
        found = None
    if found and found["name"] and not re.search(r"\S\[\d+\]\s*$", heading):
        unit = next(found[kind] for kind in _STATED if found[kind] is not None)
        return Column(heading, found["name"], unit.strip(), found["accuracy"], cells, lines)
    return Column(heading, heading, unit, None, cells, lines)


def _read_excel(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    """Read a sheet of an Excel file."""
    openpyxl = import_optional("openpyxl")
    book = openpyxl.load_workbook(io.BytesIO(path.read_bytes()), read_only=True, data_only=True)
    sheets = [each.title for each in book.worksheets]  # the others are charts
    sheet = form.get("sheet", sheets[0])
    if sheet not in sheets:
        near = did_you_mean(sheet, sheets)
        raise UsageError(f"{place}: has no sheet '{sheet}'{near}: has {', '.join(sheets)}")
    rows = [(i, list(cells)) for i, cells in enumerate(book[sheet].values, 1)]
    rows = [(i, cells) for i, cells in rows if not all(map(is_missing, cells))]
    leave_out = dropwhile if is_list else filterfalse
    rows = list(leave_out(lambda row: str(row[1][0] or "").startswith(_COMMENTS), rows))
    texts = [cell for _, cells in rows for cell in filter(_is_text, cells)]
    numbers = [sum(math.isfinite(find_number(text, sign)) for text in texts) for sign in ".,"]
    found = {"kind": "Excel", "sheet": sheet}
    found |= {"decimal": ","} if numbers[1] > numbers[0] else {}
    try:
        table = _from_rows(place, "row", rows, [], {**found, **form}, is_list=is_list)
    except UsageError as error:
        if len(sheets) == 1 or "sheet" in form:
            raise
        state = "put it first" if is_list else f"--csv 'sheet={sheets[1]}'"
        raise UsageError(f"{error}; is it on another sheet than '{sheet}'? then {state}") from None
    if "decimal" not in form:
        _check_decimal(table, can_state=not is_list)
    return table


def _is_text(cell: Any) -> bool:
    return isinstance(cell, str)


# -------------------------------------------------------------------------- columns by name


def _from_arrays(place: str, kind: str, arrays: Iterable[tuple[str, Any, str | None]]) -> Table:
    """Return the table of arrays by name: what is none of numbers or texts in a row is left out."""
    columns = []
    arrays = [
        (f"{name}.{each}" if each else name, values[each] if each else values, unit)
        for name, values, unit in arrays
        for each in getattr(getattr(values, "dtype", None), "names", None) or [""]
    ]
    named = {name: values for name, values, _ in arrays}
    if {"names", "units", "values"} <= named.keys():  # of `dockloop run`
        names, units = _list_texts(named["names"]), _list_texts(named["units"])
        arrays = list(zip(names, np.atleast_2d(named["values"]).T, units, strict=True))
    for name, values, unit in arrays:
        array = np.asarray(values)
        array = np.squeeze(array) if array.ndim > 1 else array
        if array.ndim == 1 and len(array) and array.dtype.kind in "biufUSOMm":
            is_text = array.dtype.kind in "USOMm"
            cells: Any = [_to_text(cell) for cell in array] if is_text else array
            columns.append(_make_column(name, cells, range(1, len(array) + 1), unit))
        elif array.ndim == 2 and array.dtype.kind in "biuf":
            for i, column in enumerate(array.T, 1):
                lines = range(1, len(column) + 1)
                columns.append(_make_column(f"{name}[{i}]", column, lines, unit))
    if not columns:
        raise UsageError(f"{place}: has no arrays of numbers: write each column as a vector")
    return Table(place, columns, form={"kind": kind}, has_order=False)


def _list_texts(cells: Any) -> list[str]:
    """Return texts; an empty one of a MAT file is an array without entries."""
    listed = cells if isinstance(cells, list) else np.ravel(cells)
    return [str(_to_text(cell)).strip() if np.size(cell) else "" for cell in listed]


def _to_text(cell: Any) -> Any:
    if isinstance(cell, bytes):
        return cell.decode(errors="replace")
    return str(cell) if isinstance(cell, np.datetime64) else cell


def _read_npz(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    """Read the arrays of a file of numpy."""
    with np.load(path) as arrays:
        return _from_arrays(place, "NPZ", [(name, arrays[name], None) for name in arrays.files])


def _read_parquet(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    """Read a Parquet file; the metadata of a column may have its unit."""
    table = import_optional("pyarrow.parquet", "pyarrow").read_table(path)
    types = import_optional("pyarrow.types", "pyarrow")
    columns = []
    for entry, column in zip(table.schema, table.columns, strict=True):
        unit = {**(entry.metadata or {})}.get(b"unit")
        kinds = (types.is_floating, types.is_integer, types.is_duration)
        is_plain = any(is_kind(entry.type) for is_kind in kinds)
        if types.is_temporal(entry.type) and not is_plain:
            column = column.cast("string")  # noqa: PLW2901
        cells = column.to_numpy() if is_plain and not is_list else column.to_pylist()
        lines, text = range(1, len(column) + 1), None if unit is None else unit.decode()
        columns.append(_make_column(entry.name, cells, lines, text))
    return Table(place, columns, form={"kind": "Parquet"})


def _read_hdf5(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    """Read the data sets of an HDF5 file.

    An attribute ``unit`` or ``units`` may have the unit; those of netCDF say what is stored.
    """
    arrays = []

    def visit(name: str, node: Any) -> None:
        if hasattr(node, "shape") and node.shape is not None:
            each = ((key.lower(), np.ravel(value)) for key, value in node.attrs.items())
            said = {key: value[0] for key, value in each if len(value)}
            unit = said.get("unit", said.get("units", said.get("unit_string")))
            values, blanks = node[()], [said[key] for key in _BLANKS if key in said]
            if node.dtype.kind in "iuf" and (
                blanks or {"scale_factor", "add_offset"} & said.keys()
            ):
                real = values * said.get("scale_factor", 1.0) + said.get("add_offset", 0.0)
                values = np.where(np.isin(values, blanks), np.nan, real)
            text = None if unit is None else str(_to_text(unit))
            arrays.append((name.replace("/", "."), values, text))

    with import_optional("h5py").File(path, "r") as file:
        file.visititems(visit)
    return _from_arrays(place, "HDF5", arrays)


def _read_mat(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    """Read the variables of a MAT file; members of structures have names with a point."""
    members = import_optional("pymatreader").read_mat(path)
    if {"Aclass", "name", "dataInfo", "data_2"} <= members.keys():
        return _from_arrays(place, "MAT", _list_trajectories(path))

    def walk(node: Mapping[str, Any], prefix: str) -> Iterable[tuple[str, Any, None]]:
        for name, value in node.items():
            if isinstance(value, Mapping):
                yield from walk(value, f"{prefix}{name}.")
            elif not name.startswith(("__", "#")):
                yield f"{prefix}{name}", value, None

    return _from_arrays(place, "MAT", list(walk(members, "")))


def _list_trajectories(path: Path) -> list[tuple[str, Any, None]]:
    """Return the variables of a result of Dymola, OpenModelica or OMSimulator, but constants."""
    mat = import_optional("scipy.io", "scipy").loadmat(path, chars_as_strings=False)
    is_transposed = "binTrans" in "".join(mat["Aclass"].ravel())
    name, info, data = (
        mat[each] if is_transposed else mat[each].T for each in ("name", "dataInfo", "data_2")
    )
    names = ["".join(letters).strip("\0 ") for letters in name.T]
    found = []
    for each, block, row in zip(names, *info[:2], strict=True):
        if block != 1:  # 0: the time, which is the first row
            found.append((each, np.sign(row) * data[abs(int(row)) - 1], None))
    return found


def _read_hdf5_or_mat(path: Path, place: str, form: Mapping[str, str], is_list: bool) -> Table:
    read = _read_mat if path.suffix == ".mat" else _read_hdf5
    return read(path, place, form, is_list)


_READERS: dict[bytes, Callable[[Path, str, Mapping[str, str], bool], Table]] = {
    b"PAR1": _read_parquet,
    b"\x89HDF": _read_hdf5_or_mat,
    b"MATLAB": _read_mat,  # 7.3 is HDF5 behind such a text
}
