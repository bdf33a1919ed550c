"""Time histories that a sweep keeps: a Parquet file next to its table, read as results of runs.

The file has one row group per case: its number, the time, and the chosen outputs at every
communication point. Cases that were not done have none.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base.errors import UsageError, names_arguments
from dockloop.base.files import Kind, writing
from dockloop.base.paths import as_path, check_file, shown
from dockloop.base.progress import import_optional
from dockloop.result.recording import Result
from dockloop.runs.outcome import Result as Outcome
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.table import COMMAND, read_table_metadata

_SCENE = "dockloop.histories"  # name and title of the scene, in the metadata


HISTORIES = Kind("histories", COMMAND, lambda path: _SCENE in read_table_metadata(path))


def find_histories(output: Path) -> Path:
    """Return where the histories next to the table of a sweep are."""
    return output.with_name(f"{output.stem}_histories.parquet")


def write_histories(planner: Planner, results: Sequence[Outcome], path: Path) -> None:
    """Write the histories of the cases that were done, one after the other.

    Args:
        planner: of the sweep.
        results: one per case.
        path: the file.
    """
    import pyarrow
    from pyarrow import parquet

    units = {name: planner.variables[name].unit for name in planner.histories}
    fields = [
        pyarrow.field("case", pyarrow.int64(), metadata={"unit": ""}),
        *(
            pyarrow.field(name, pyarrow.float64(), metadata={"unit": unit})
            for name, unit in {"time": "s", **units}.items()
        ),
    ]
    scene = {"name": planner.base["name"], "title": planner.base["title"]}
    schema = pyarrow.schema(fields, metadata={_SCENE: json.dumps(scene)})
    with writing(path, HISTORIES) as partial, parquet.ParquetWriter(partial, schema) as writer:
        for case, result in enumerate(results, 1):
            if not result.histories:
                continue
            columns = [pyarrow.array(column, pyarrow.float64()) for column in result.histories]
            number = pyarrow.array(np.full(len(columns[0]), case), pyarrow.int64())
            table = pyarrow.Table.from_arrays([number, *columns], schema=schema)
            writer.write_table(table, row_group_size=len(number))


if TYPE_CHECKING:
    _Base = Mapping[int, Result]
else:

    class _Base(Mapping, dict):
        """A mapping that JSON writes, as an empty one: pandas does so with attributes of tables."""


class Histories(_Base):
    """Histories of a sweep by the number of the case, each a `Result` of the chosen outputs.

    A file of a table that has them in ``attrs``, as by ``table.to_parquet``, does not hold them.
    """

    def __init__(self, source: Path | bytes) -> None:
        """Open a file, or what is in it."""
        import pyarrow
        from pyarrow import parquet

        self._source = source
        is_file = isinstance(source, Path)
        self._file = parquet.ParquetFile(source if is_file else pyarrow.BufferReader(source))
        metadata = self._file.metadata
        self._groups = {
            metadata.row_group(group).column(0).statistics.min: group
            for group in range(metadata.num_row_groups)
        }

    def __deepcopy__(self, memo: dict[int, Any]) -> "Histories":
        """Return the same: nothing can be changed, and pandas copies attributes of tables."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return Histories, (self._source,)

    def __repr__(self) -> str:
        return f"Histories(cases {list(self)})"

    def __eq__(self, other: object) -> bool:
        """Return whether the same cases have the same histories; two cases are in memory."""
        if not isinstance(other, Mapping):
            return NotImplemented
        return self.keys() == other.keys() and all(self[case] == other[case] for case in self)

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        """Return the number of cases that have histories."""
        return len(self._groups)

    def __iter__(self) -> Iterator[int]:
        """Yield the numbers of these cases."""
        return iter(self._groups)

    def __getitem__(self, case: int) -> Result:
        """Read the histories of a case. Raises KeyError: it has none."""
        table = self._file.read_row_group(self._groups[case]).drop_columns(["case"])
        units = [field.metadata[b"unit"].decode() for field in table.schema]
        values = np.column_stack([column.to_numpy() for column in table.columns])
        scene = json.loads(table.schema.metadata[_SCENE.encode()])
        return Result(scene, table.column_names, units, values)


@names_arguments
def read_histories(path: str | Path) -> Histories:
    """Open the time histories of a sweep; one case at a time is in memory.

    ::

        histories = dl.read_histories("own_histories.parquet")
        print(max(result["capture.tension"].max() for result in histories.values()))

    Args:
        path: the file ``TABLE_histories.parquet`` of a sweep with the key ``histories``.

    Returns:
        A `Result` of the chosen outputs by the number of the case. Cases that are not done have
        none.

    Raises:
        UsageError: the file is no such file.
        DockloopError: a package is missing.
    """
    import_optional("pyarrow")
    file = as_path("read_histories: path", path)
    check_file(file, "histories")
    try:
        if not HISTORIES.is_own(file):
            raise ValueError("it has no such metadata")
        return Histories(file)
    except (OSError, ValueError) as error:
        raise UsageError(f"{shown(file)}: has no histories of 'dockloop sweep' ({error})") from None
