"""Scenes that the extremes need, built as unpacked FMUs in a temporary folder.

The mechanisms with exact motions, the host that steps an FMU and the dense solution in absolute
coordinates are modules of this package, which tests use too: one of each in the project.
"""

import json
import math
from pathlib import Path

import numpy as np
from fmpy.fmi1 import FMICallException

from dockloop.base.errors import UsageError
from dockloop.fmu.binaries import find_libraries
from dockloop.native import core
from dockloop.scene.find import find_scene
from dockloop.scene.placement import read_placed
from extreme_cases.fmi_host import OK, Host
from extreme_cases.own_mechanism import FIXED_BASE, capture_body_section, write_scene

__all__ = ["FIXED_BASE", "OK", "Host", "Workshop", "capture_body_section", "hexapod", "solver"]

DATE = "1980-01-01T00:00:00Z"
# Joint circles of the free-floating hexapod [deg]: base and ring end of each leg.
BASE_ANGLES = (-2.5, 2.5, 117.5, 122.5, 237.5, 242.5)
TOP_ANGLES = (310.0, 50.0, 70.0, 170.0, 190.0, 290.0)
OUTPUTS = '[outputs]\ngroups = ["ring", "states", "loops", "energy", "solver"]'


def solver(rtol):
    """Section [solver] of a scene; absolute tolerances ten times tighter than the relative one."""
    atol = rtol / 10
    return (
        f"[solver]\nrtol = {rtol!r}\natol_position = {atol!r}\natol_velocity = {atol!r}\n"
        f"atol_energy = {max(atol, 1e-12)!r}"
    )


class Workshop:
    """Makes FMUs and evaluates mechanisms in one temporary folder."""

    def __init__(self, folder):
        self._folder = Path(folder)
        self._count = 0

    def _new(self):
        self._count += 1
        folder = self._folder / f"{self._count}.unpacked"
        folder.mkdir()
        return folder

    def shipped(self, scene, *overrides):
        """Unpacked FMU of a shipped scene."""
        return self._build(find_scene(scene), overrides)

    def own(self, mechanism, *sections, rtol=1e-11, overrides=()):
        """Unpacked FMU of a mechanism that was made in code, or of none."""
        folder = self._new()
        write_scene(folder, mechanism or {}, *sections, solver=solver(rtol))
        source = folder / "reference.toml"
        if mechanism is None:
            source.write_text(source.read_text().replace('[mechanism]\nname = "own"', ""))
        return self._build(source, overrides)

    def _build(self, source, overrides):
        """As `build_fmu` does, without what an FMU holds for people and without the zip file."""
        document = read_placed(source, overrides)
        folder = self._new()
        model = folder / "resources" / "model.json"
        model.parent.mkdir()
        model.write_text(core.to_json(document))
        description = core.describe(document, source, DATE)
        (folder / "modelDescription.xml").write_text(description)
        for platform, library in find_libraries().items():
            binary = folder / "binaries" / platform / f"{document['name']}{library.suffix}"
            binary.parent.mkdir(parents=True)
            binary.symlink_to(library.resolve())
        return folder

    def check(self, document):
        """Report of ``dockloop check``."""
        return core.check(document, Path("document.json"))

    def evaluate(self, document):
        """Figures of ``dockloop check --states`` for a document with mechanism and states."""
        file = self._new() / "document.json"
        file.write_text(json.dumps(document))
        return core.evaluate(document, file, document, file), file


def move(fmu, times, *, settings=None, names=(), start_time=0.0):
    """Values of outputs at given times, one row each.

    Raises:
        UsageError: the FMU refuses, with its reason.
        RuntimeError: it refuses a step and has changed an output nevertheless, or it does not make
            a step of a thousandth of the size with the bits of a run that was never refused.
    """
    with Host(fmu, start_time=start_time) as host:
        _start(host, settings)
        rows = [host.get(*names)]
        for t in times:
            size = t + start_time - host.time
            if host.step_status(size) != OK:
                reason = host.last_line
                if not np.array_equal(host.get(*names), rows[-1]):
                    raise RuntimeError(f"changed by a refused step ({reason})")
                if len(rows) == 1 and size > 1e-6:
                    _compare_after_refusal(host, fmu, settings, size / 1000)
                raise UsageError(reason)
            rows.append(host.get(*names))
    return np.array(rows)


def _start(host, settings):
    """Set start values and leave initialization mode; raises UsageError where that is refused."""
    try:
        if settings:
            references = [host.reference[name] for name in settings]
            host.slave.setReal(references, [float(value) for value in settings.values()])
        host.start()
    except FMICallException as error:
        raise UsageError(host.lines[-1][2] if host.lines else str(error)) from None


def _compare_after_refusal(host, fmu, settings, size):
    """A host whose first step was refused makes a small one as if it had not been."""
    with Host(fmu, start_time=host.start_time) as fresh:
        _start(fresh, settings)
        status = host.step_status(size), fresh.step_status(size)
        if status[0] != status[1] or host.everything() != fresh.everything():
            raise RuntimeError(f"step of {size:g} s after a refused one: {status}, other bits")


def circle(radius, degrees):
    """Point on a circle around z."""
    angle = math.radians(degrees)
    return [radius * math.cos(angle), radius * math.sin(angle), 0.0]


HEXAPOD_ENDS = (
    [circle(3.0, angle) for angle in BASE_ANGLES],
    [circle(1.0, angle) for angle in TOP_ANGLES],
)


def hexapod(stiffness=2000.0, damping=40.0, leg=1.0):
    """The free-floating hexapod: ring of 30 kg, legs of 4 and 3 kg times `leg`."""
    return {
        "name": "floating_hexapod",
        "bodies": [
            {
                "name": "ring",
                "parent": "base",
                "joint": {"type": "free", "position": [0, 0, 2]},
                "mass": 30,
                "inertia": np.diag([8.0, 9.0, 15.0]).tolist(),
            }
        ],
        "leg_defaults": {
            "type": "R2P1R3",
            "closing": "ring",
            "reference_axis": [0, 0, 1],
            "cylinder": {
                "mass": 4 * leg, "com": 0.6, "inertia_transverse": 0.5 * leg, "inertia_axial": 0,
            },
            "rod": {
                "mass": 3 * leg, "com": 0.5, "inertia_transverse": 0.4 * leg, "inertia_axial": 0,
            },
            "stiffness": stiffness,
            "damping": damping,
        },
        "legs": [
            {"name": f"leg{i}", "root_point": low, "closing_point": high}
            for i, (low, high) in enumerate(zip(*HEXAPOD_ENDS, strict=True), 1)
        ],
        "capture": {"body": "ring"},
    }  # fmt: skip
