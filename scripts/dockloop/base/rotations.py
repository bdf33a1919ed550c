"""Turns, quaternions (w, x, y, z), poses, directions, symmetric matrices from their components.

Poses are rows of 7 numbers, position and quaternion.
"""

from collections.abc import Sequence

import numpy as np


def turn(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return a vector, or one vector per row, turned by unit quaternions (rows w, x, y, z)."""
    w, u = quaternions[:, :1], quaternions[:, 1:]
    cross = np.cross(u, vectors)
    return vectors + 2.0 * (w * cross + np.cross(u, cross))


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return products of quaternions, row by row."""
    w = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    return np.hstack([w, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])])


def conjugate(a: np.ndarray) -> np.ndarray:
    """Return the inverse turns of unit quaternions."""
    return a * np.array([1.0, -1.0, -1.0, -1.0])


def join_poses(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return poses b, given in axes of a, in the axes in which a is given; one row fits all."""
    return np.hstack([a[:, :3] + turn(a[:, 3:], b[:, :3]), multiply(a[:, 3:], b[:, 3:])])


def invert_poses(a: np.ndarray) -> np.ndarray:
    """Return the poses, in axes of a, of the axes in which a is given."""
    back = conjugate(a[:, 3:])
    return np.hstack([turn(back, -a[:, :3]), back])


def find_matrix(quaternion: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the matrix, shape (3, 3), of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def find_across(axis: np.ndarray) -> np.ndarray:
    """Return two unit vectors, the rows, across a unit vector and each other."""
    return np.linalg.svd(axis[None])[2][1:]


def make_symmetric(components: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the matrix, shape (3, 3), with these components xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
