"""Cells that become smaller where points differ: squares of a plane, cubes of a space.

Points have whole coordinates on the finest grid, from 0 to `Mesh.size` along every axis, so a point
is the same in every cell that has it. A cell is a corner and a width. Cells are split while points
in them differ, corners of smaller neighbours included, until their width is 1.
"""

import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

Point = tuple[int, ...]
Class = tuple[bool, ...]  # of a point: which criteria it meets


class Cell(NamedTuple):
    """A square or cube: its lowest corner and its width."""

    corner: Point
    width: int


class Bracket(NamedTuple):
    """An edge of the finest grid that crosses the boundary."""

    inside: Point
    outside: Point


class Mesh:
    """The cells of a box.

    Attributes:
        dimensions: 2 or 3.
        size: finest cells along an axis.
        cells: that are not split.
    """

    def __init__(self, dimensions: int, coarse: int, levels: int) -> None:
        """Begin with equal cells.

        Args:
            dimensions: 2 or 3.
            coarse: cells along an axis at the beginning.
            levels: how often a cell may be halved.
        """
        self.dimensions, self.size = dimensions, coarse << levels
        self._widths = [1 << level for level in range(levels, -1, -1)]
        width = self._widths[0]
        steps = range(0, self.size, width)
        self.cells = {Cell(c, width) for c in itertools.product(steps, repeat=dimensions)}

    def corners(self, cell: Cell) -> list[Point]:
        """Return the corners of a cell, the lowest first."""
        offsets = itertools.product((0, cell.width), repeat=self.dimensions)
        return [tuple(map(sum, zip(cell.corner, o, strict=True))) for o in offsets]

    def list_missing(self, known: Mapping[Point, Class]) -> list[Point]:
        """Return all corners that are not known, in order."""
        corners = {corner for cell in self.cells for corner in self.corners(cell)}
        return sorted(corners - known.keys())

    def split(self, known: Mapping[Point, Class]) -> bool:
        """Halve every cell in which known points differ; returns whether there was one."""
        mixed = {
            cell
            for point, met in known.items()
            for cell in self._find_cells(point)
            if cell.width > 1 and met != known[cell.corner]
        }
        for cell in mixed:
            self.cells.remove(cell)
            half = cell.width // 2
            for offset in itertools.product((0, half), repeat=self.dimensions):
                corner = tuple(map(sum, zip(cell.corner, offset, strict=True)))
                self.cells.add(Cell(corner, half))
        return bool(mixed)

    def draw_checks(self, known: Mapping[Point, Class], count: int, seed: int) -> list[Point]:
        """Return points at random in the cells that were not split to the end: are they right?

        Args:
            known: all corners.
            count: how many; fewer if there are not as many.
            seed: of the random numbers.
        """
        wide = sorted(cell for cell in self.cells if cell.width > 1)
        if not wide:
            return []
        random = np.random.default_rng(seed)
        volume = np.array([float(cell.width) ** self.dimensions for cell in wide])
        chosen: dict[Point, None] = {}
        for number in random.choice(len(wide), size=4 * count, p=volume / volume.sum()):
            cell = wide[number]
            inner = random.integers(0, cell.width + 1, size=self.dimensions)
            point = tuple(int(a + b) for a, b in zip(cell.corner, inner, strict=True))
            if point not in known and len(chosen) < count:
                chosen[point] = None
        return list(chosen)

    def predict(self, point: Point, known: Mapping[Point, Class]) -> Class:
        """Return the class of a point that is known, or of a cell whose corners agree."""
        return known[point] if point in known else known[next(self._find_cells(point)).corner]

    def _find_cells(self, point: Point) -> Iterator[Cell]:
        """Yield the cells that have a point, on their border too."""
        for width in self._widths:
            lowest = [{c // width * width, (c - 1) // width * width} for c in point]
            for corner in itertools.product(*lowest):
                if (cell := Cell(corner, width)) in self.cells:
                    yield cell

    def list_brackets(self, known: Mapping[Point, Class], number: int) -> list[Bracket]:
        """Return the edges of finest cells that cross the boundary of one criterion, in order."""
        brackets = set()
        for cell in self.cells:
            if cell.width > 1:
                continue
            for first, second in itertools.combinations(self.corners(cell), 2):
                is_edge = sum(a != b for a, b in zip(first, second, strict=True)) == 1
                if is_edge and known[first][number] != known[second][number]:
                    is_first = known[first][number]
                    brackets.add(Bracket(*((first, second) if is_first else (second, first))))
        return sorted(brackets)

    def measure(self, known: Mapping[Point, Class], number: int) -> tuple[float, float]:
        """Return the part of the box that meets a criterion, and half the part that is not sure."""
        met = unsure = 0.0
        for cell in self.cells:
            here = [known[corner][number] for corner in self.corners(cell)]
            part = (cell.width / self.size) ** self.dimensions
            if all(here):
                met += part
            elif any(here):
                unsure += part
        return met + 0.5 * unsure, 0.5 * unsure
