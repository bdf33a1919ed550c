"""The option ``--mesh`` of ``dockloop view``, as an import writes it and the view reads it."""

import re
from typing import NamedTuple

import numpy as np

from dockloop.base.errors import UsageError

FORM = "NAME=FILE, perhaps with @SCALE or @x,y,z,qw,qx,qy,qz,SCALE"
_HERE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


class MeshOption(NamedTuple):
    """A file that draws a vehicle or a body.

    Attributes:
        name: of the vehicle or body.
        file: the mesh.
        pose: of the axes of the file in those of the body, a row of 7 numbers.
        scale: of lengths along the axes of the file.
    """

    name: str
    file: str
    pose: np.ndarray
    scale: np.ndarray

    def write(self) -> str:
        """Return the text."""
        scale = self.scale if np.ptp(self.scale) else self.scale[:1]
        is_moved = np.max(np.abs(self.pose - _HERE)) > 1e-12
        numbers = [*self.pose, *scale] if is_moved else [*scale]
        placed = ",".join(f"{round(number, 12) + 0.0:.12g}" for number in numbers)
        return f"{self.name}={self.file}" + (f"@{placed}" if numbers != [1.0] else "")


def read_mesh_option(text: str) -> MeshOption:
    """Return what a text says. Raises UsageError."""
    name, _, rest = text.partition("=")
    file, at, placed = rest.rpartition("@")
    if not at or not re.fullmatch(r"[-+.,\deE]+", placed):
        file, placed = rest, "1"
    try:
        numbers = [float(number) for number in placed.split(",")]
    except ValueError:
        numbers = []
    if not name or not file or len(numbers) not in (1, 3, 8, 10):
        raise UsageError(f"--mesh {text}: must be {FORM}; SCALE is one number, or three")
    pose, scale = (numbers[:7], numbers[7:]) if len(numbers) > 7 else (_HERE, numbers)
    length = float(np.linalg.norm(pose[3:]))
    if not (length and np.all(scale) and np.isfinite(numbers).all()):
        raise UsageError(f"--mesh {text}: quaternion and scale must be finite and not zero")
    row = np.array([*pose[:3], *np.array(pose[3:]) / length])
    return MeshOption(name, file, row, np.broadcast_to(scale, 3))
