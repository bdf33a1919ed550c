"""Scenes around mechanisms that a test writes itself, and quaternions to compare their motion."""

import json
import math

import numpy as np

FIXED_BASE = """
[chaser]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]
"""
TIGHT = """
[solver]
rtol = 1e-11
atol_position = 1e-13
atol_velocity = 1e-13
atol_energy = 1e-10
"""


def write_scene(folder, mechanism, *sections, solver=TIGHT):
    """Write a mechanism and a scene that uses it; returns the scene file."""
    (folder / "own.json").write_text(json.dumps(mechanism))
    scene = folder / "reference.toml"
    scene.write_text(
        "\n".join(('title = "reference"', *sections, '[mechanism]\nname = "own"', solver))
    )
    return str(scene)


def capture_body_section(displacement, rotation_vector, velocity, angular_velocity):
    """Section [initial.capture_body] from four vectors."""
    lines = ["[initial.capture_body]"]
    for name, vector in (
        ("displacement", displacement),
        ("rotation_vector", rotation_vector),
        ("velocity", velocity),
        ("angular_velocity", angular_velocity),
    ):
        lines.append(f"{name} = [{', '.join(repr(float(x)) for x in vector)}]")
    return "\n".join(lines)


def quaternion_product(p, q):
    """Product of two quaternions (w, x, y, z)."""
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.array([w, *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def turn(q, v):
    """Turn a vector from body axes to reference axes by the quaternion q (w, x, y, z)."""
    return v + 2.0 * np.cross(q[1:], np.cross(q[1:], v) + q[0] * v)


def assert_quaternion(ours, theirs, tolerance):
    """Check that two quaternions are the same turn."""
    sign = math.copysign(1.0, np.dot(ours, theirs))
    assert np.max(np.abs(sign * np.asarray(ours) - theirs)) < tolerance
