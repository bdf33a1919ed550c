"""Meshes for ``dockloop view``: STL, text or binary; OBJ, glTF and others through trimesh."""

import base64
import re
from pathlib import Path

import numpy as np

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.mesh_option import read_mesh_option
from dockloop.base.paths import check_file, read_bytes, shown
from dockloop.base.rotations import turn

_LONGEST = 1000.0  # m: what is longer is in millimetres
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_mesh(text: str) -> tuple[str, dict]:
    """Return the name of what a mesh draws, and its vertices and triangles, packed for a page.

    Args:
        text: the option, see `dockloop.base.mesh_option`; axes are those of the vehicle or body.

    Raises:
        UsageError: it is no such text, no mesh, or not in metres.
        DockloopError: trimesh is not installed.
    """
    option = read_mesh_option(text)
    path = Path(option.file)
    read = _read_corners if path.suffix.lower() == ".stl" else _read_by_trimesh
    corners = read(path)
    if corners is None or not len(corners) or not np.all(np.isfinite(corners)):
        raise UsageError(f"{shown(path)}: is no {path.suffix[1:].upper()} file with triangles")
    corners = option.pose[:3] + turn(option.pose[None, 3:], corners * option.scale)
    size = float(np.max(np.ptp(corners, axis=0)))
    if size > _LONGEST:
        raise UsageError(
            f"{shown(path)}: is {size:.4g} long: lengths must be in metres, at most"
            f" {_LONGEST:.0f}: scale it, millimetres by @0.001 behind its name"
        )
    points, triangles = np.unique(corners.astype("<f4"), axis=0, return_inverse=True)
    return option.name, {
        "points": base64.b64encode(points.tobytes()).decode(),
        "triangles": base64.b64encode(triangles.reshape(-1).astype("<u4").tobytes()).decode(),
    }


def _read_by_trimesh(path: Path) -> np.ndarray:
    """Return the corners of all triangles of a file that is no STL. Raises like `read_mesh`."""
    check_file(path, "mesh")
    try:
        import trimesh
    except ImportError:
        need = "it is not installed: pip install 'dockloop[meshes]', or give STL"
        raise DockloopError(f"{shown(path)}: is read by trimesh; {need}") from None
    try:
        return np.array(trimesh.load_mesh(path).triangles).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001  readers of many authors
        why = " ".join(str(error).split())
        raise UsageError(f"{shown(path)}: trimesh cannot read it: {why}") from None


def _read_corners(path: Path) -> np.ndarray | None:
    """Return the corners of all triangles, three rows each; None: it is no STL file."""
    content = read_bytes(path, "STL file")
    count = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + count * _TRIANGLE.itemsize and count:
        return np.frombuffer(content, _TRIANGLE, count, 84)["corners"].reshape(-1, 3)
    found = _VERTEX.findall(content)
    try:
        corners = np.array(found, dtype=float).astype(np.float32)
    except ValueError:
        return None
    return corners if content.lstrip().startswith(b"solid") and len(corners) % 3 == 0 else None
