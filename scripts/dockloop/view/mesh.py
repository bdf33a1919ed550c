"""Triangles of STL files, text or binary, for the vehicles of ``dockloop view``."""

import base64
import re
from pathlib import Path

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.paths import read_bytes, shown

_LONGEST = 1000.0  # m: what is longer is in millimetres
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_mesh(path: Path) -> dict:
    """Return vertices and triangles of an STL file, packed for a page.

    Args:
        path: the file, lengths in metres, axes and origin of the vehicle's body frame.

    Raises:
        UsageError: it is no STL file, or is not in metres.
    """
    corners = _read_corners(read_bytes(path, "STL file"))
    if corners is None or not len(corners) or not np.all(np.isfinite(corners)):
        raise UsageError(f"{shown(path)}: is no STL file with triangles")
    length = float(np.max(np.ptp(corners, axis=0)))
    if length > _LONGEST:
        raise UsageError(
            f"{shown(path)}: is {length:.4g} long: lengths must be in metres, at most"
            f" {_LONGEST:.0f}: scale it"
        )
    points, triangles = np.unique(corners, axis=0, return_inverse=True)
    return {
        "points": base64.b64encode(points.astype("<f4").tobytes()).decode(),
        "triangles": base64.b64encode(triangles.reshape(-1).astype("<u4").tobytes()).decode(),
    }


def _read_corners(content: bytes) -> np.ndarray | None:
    """Return the corners of all triangles, three rows each; None: it is no STL file."""
    count = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + count * _TRIANGLE.itemsize and count:
        return np.frombuffer(content, _TRIANGLE, count, 84)["corners"].reshape(-1, 3)
    found = _VERTEX.findall(content)
    try:
        corners = np.array(found, dtype=float).astype(np.float32)
    except ValueError:
        return None
    return corners if content.lstrip().startswith(b"solid") and len(corners) % 3 == 0 else None
