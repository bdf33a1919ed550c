"""`export_mechanism`: a mechanism as MJCF, so that MuJoCo runs and draws the same."""

import itertools
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.files import Kind, check_suffix, read_head, write_text
from dockloop.exchange.constructs import LEFT_OUT, MAPPED, REFUSED
from dockloop.native import core
from dockloop.scene.find import read_mechanism
from dockloop.scene.mechanism import check_mechanism, find_mechanism
from dockloop.scene.patterns import expand_patterns

_SIGN = "written by 'dockloop export'"
_KIND = Kind("MJCF", "dockloop export", lambda path: _SIGN.encode() in read_head(path))
_HARD = {"solref": "0.002 1", "solimp": "0.9999 0.9999 0.001"}  # equalities near rigid
_ARM = 0.1  # m between the two points that hold the axis of a revolute cut
_SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_WRITTEN = {"comment", "name", "gravity", "bodies", "loops", "couplings", "forces", "home_q"}
_WRITTEN |= {"legs", "leg_defaults"}  # as bodies and loops


def export_mechanism(mechanism: str | Path, output: str | Path) -> list[str]:
    """Write a mechanism as MJCF. Coordinates keep their names and zeros; key ``home`` is the home.

    Args:
        mechanism: name of a shipped mechanism, or path of a file.
        output: file to write, ``NAME.xml``; one that is no such export is kept.

    Returns:
        What was mapped, guessed and left out.

    Raises:
        UsageError: a part cannot be written.
    """
    check_suffix(Path(output), ".xml")
    home = check_mechanism(mechanism)["home_q"]
    path = find_mechanism(str(mechanism))
    document = read_mechanism(path)
    expand_patterns(document, path)
    expanded = core.expand(document, path)
    expanded["forces"] = [*document.get("forces", []), *expanded["forces"]]
    document |= expanded
    if not document["bodies"]:
        raise UsageError(f"{path.name}: has no bodies to export")
    writer = _Writer(path.name, document)
    text = writer.write(home)
    write_text(Path(output), _KIND, text)
    return writer.report


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


class _Writer:
    """Writes one document; the report says what was made of it."""

    def __init__(self, file: str, document: dict[str, Any]) -> None:
        self.file, self.document = file, document
        self.report: list[str] = []
        self.order: list[str] = []  # joints, as MuJoCo numbers them
        self.home_of: dict[str, tuple[Element, np.ndarray, np.ndarray]] = {}
        self.bodies = {body["name"]: body for body in document["bodies"]}
        self.joints: dict[str, Element] = {}
        self.root = Element("mujoco", {"model": document.get("name", "mechanism")})

    def write(self, home: list[float]) -> str:
        """Return the text. Raises UsageError."""
        flags = {"angle": "radian", "balanceinertia": "false", "boundinertia": "1e-12"}
        flags["boundmass"] = "1e-12"  # of rotors that have an inertia only
        SubElement(self.root, "compiler", flags)
        gravity = _words(self.document.get("gravity", (0, 0, 0)))
        SubElement(self.root, "option", {"gravity": gravity, "timestep": "5e-4"})
        world = SubElement(self.root, "worldbody")
        self.home_of["base"] = (world, np.eye(3), np.zeros(3))
        self._hang("base", world)
        self.tendons = Element("tendon")
        self.equalities = Element("equality")
        for loop in self.document["loops"]:
            self._cut(loop)
        for coupling in self.document["couplings"]:
            self._couple(coupling)
        for force in self.document["forces"]:
            self._push(force)
        self.root.extend(part for part in (self.tendons, self.equalities) if len(part))
        self._keep_home(home)
        self.report += [
            f"{LEFT_OUT}: member '{name}'"
            for name, value in self.document.items()
            if value and name not in _WRITTEN
        ]
        self.report.insert(0, f"{MAPPED}: {len(self.bodies)} bodies and joints")
        indent(self.root)
        return f"<!-- {_SIGN} -->\n{tostring(self.root, encoding='unicode')}\n"

    def _hang(self, parent: str, above: Element) -> None:
        """Write the bodies on a parent; a body without mass becomes a joint of the one on it."""
        for body in (b for b in self.document["bodies"] if b["parent"] == parent):
            chain = [body]
            while not (chain[-1].get("mass") or np.any(chain[-1].get("inertia", 0.0))):
                on_it = [b for b in self.document["bodies"] if b["parent"] == chain[-1]["name"]]
                if len(on_it) != 1:
                    raise UsageError(
                        f"{self.file}: body '{chain[-1]['name']}' has no mass and carries"
                        f" {len(on_it)} bodies: MuJoCo needs a mass there"
                    )
                chain += on_it
            self._write_chain(chain, above)

    def _write_chain(self, chain: list[dict], above: Element) -> None:
        poses = [_read_pose(body["joint"]) for body in chain]
        rotation, origin = np.eye(3), np.zeros(3)
        frames = []
        for turn, step in poses:
            rotation, origin = rotation @ turn, origin + rotation @ step
            frames.append((rotation, origin))
        last = chain[-1]
        axes = _words(rotation.T[:2])
        element = SubElement(above, "body", {"name": last["name"], "pos": _words(origin)})
        element.set("xyaxes", axes)
        for body, (turn, at) in zip(chain, frames, strict=True):
            self._write_joint(element, body, rotation.T @ turn, rotation.T @ (at - origin))
            self.home_of[body["name"]] = (element, rotation.T @ turn, rotation.T @ (at - origin))
        inertia = np.array(last.get("inertia", np.zeros((3, 3))), float)
        numbers = {
            "pos": _words(last.get("com", (0, 0, 0))),
            "mass": repr(float(last.get("mass", 0.0))),
        }
        small, middle, large = np.linalg.eigvalsh(inertia)
        if large > (small + middle) * (1.0 + 1e-9):
            self.report.append(
                f"{REFUSED}: MuJoCo refuses the inertia of '{last['name']}', which no body has: its"
                f" principal moment of {large:g} kg m2 is above the sum of the others"
                f" ({small + middle:g} kg m2); correct it in the mechanism"
            )
        six = _words([inertia[i] for i in _SIX])
        SubElement(element, "inertial", {**numbers, "fullinertia": six})
        self._hang(last["name"], element)
        for body in chain[:-1]:
            del self.home_of[body["name"]]  # nothing can be fixed to what has no mass

    def _write_joint(self, element: Element, body: dict, turn: np.ndarray, at: np.ndarray) -> None:
        joint, name = body["joint"], body["name"]
        self.order.append(name)
        if joint["type"] == "free":
            SubElement(element, "freejoint", {"name": name})
            return
        kind = "slide" if joint["type"] == "prismatic" else "hinge"
        axis = _words(turn @ np.array(joint["axis"], float))
        made = SubElement(element, "joint", {"name": name, "type": kind, "axis": axis})
        made.set("pos", _words(at))
        self.joints[name] = made

    def _add_site(self, name: str, body: str, point: Any) -> None:
        if body not in self.home_of:
            raise UsageError(f"{self.file}: a loop ends at body '{body}', which has no mass")
        SubElement(self.home_of[body][0], "site", {"name": name, "pos": _words(point)})

    def _cut(self, loop: dict) -> None:
        cut, name = loop["cut"], loop["name"]
        if cut["type"] == "R2":
            raise UsageError(f"{self.file}: loop '{name}' has the cut R2, which MJCF cannot say")
        count = 2 if cut["type"] == "R1" else 1
        for i in range(count):
            for end in ("terminal", "closing"):
                point = np.array(cut[f"point_on_{end}"], float)
                if i:
                    point += _ARM * np.array(cut[f"axis_on_{end}"], float)
                self._add_site(f"{name}_{end}{i or ''}", loop[end], point)
            sites = {
                f"site{k}": f"{name}_{e}{i or ''}" for k, e in enumerate(("terminal", "closing"), 1)
            }
            SubElement(self.equalities, "connect", {"name": f"{name}{i or ''}", **sites, **_HARD})
        self.report.append(f"{MAPPED}: loop '{name}' ({cut['type']}): connect")

    def _couple(self, coupling: dict) -> None:
        terms, name = coupling["terms"], coupling["name"]
        offset = coupling.get("offset", 0.0)
        if coupling.get("rate"):
            self.report.append(f"{LEFT_OUT}: rate of coupling '{name}'")
        if len(terms) == 1:
            polynomial = _words([offset, terms[0]["ratio"], 0, 0, 0])
            ends = {"joint1": coupling["dependent"], "joint2": terms[0]["joint"]}
            numbers = {"polycoef": polynomial, **_HARD}
            SubElement(self.equalities, "joint", {"name": name, **ends, **numbers})
        else:
            leads = {term["joint"]: -term["ratio"] for term in terms}
            tendon = self._add_tendon(name, {coupling["dependent"]: 1.0, **leads}).get("name", "")
            numbers = {"polycoef": _words([offset, 0, 0, 0, 0]), **_HARD}
            SubElement(self.equalities, "tendon", {"name": name, "tendon1": tendon, **numbers})
        self.report.append(f"{MAPPED}: coupling '{name}'")

    def _add_tendon(self, name: str, terms: dict[str, float]) -> Element:
        taken = {each.get("name") for each in self.tendons}
        names = (f"{name}{number or ''}" for number in itertools.count())
        free = next(each for each in names if each not in taken)
        tendon = SubElement(self.tendons, "fixed", {"name": free})
        for joint, ratio in terms.items():
            SubElement(tendon, "joint", {"joint": joint, "coef": repr(float(ratio))})
        return tendon

    def _push(self, force: dict) -> None:
        """Write spring and damper of an element, as a tendon along its coordinate."""
        if force.get("type") == "joint_spring_damper":
            stiffness, rest = force["stiffness"], force.get("rest", 0.0)
            along = [{"joint": force["joint"]}]
            name = f"{force['joint']}_spring"
            preload = force.get("preload", 0.0)
            laws = [{"type": "damper", "linear": force["damping"]}]
            if stiffness:
                rest += preload / stiffness
                laws.append({"type": "spring", "stages": [[0.0, stiffness]], "rest": rest})
            elif preload:
                laws.append({"type": "constant"})
        else:
            along, laws, name = force["along"], force["laws"], f"{force['name']}_force"
        springs = [law for law in laws if law["type"] == "spring" and _is_linear(law)]
        dampers = [law for law in laws if law["type"] == "damper" and _is_linear(law)]
        for law in laws:
            if not _is_linear(law):
                self.report.append(f"{LEFT_OUT}: law '{law['type']}' of '{name}'")
        if not springs and not dampers:
            return
        tendon = self._add_tendon(name, {t["joint"]: t.get("ratio", 1.0) for t in along})
        # Springs and dampers side by side are one of each.
        stiffness = [float(law["stages"][0][1]) for law in springs]
        if whole := sum(stiffness):
            rests = (k * law.get("rest", 0.0) for k, law in zip(stiffness, springs, strict=True))
            tendon.set("stiffness", repr(whole))
            tendon.set("springlength", repr(float(sum(rests) / whole)))
        if dampers:
            tendon.set("damping", repr(float(sum(law["linear"] for law in dampers))))
        kinds = ["spring"] * bool(springs) + ["damper"] * bool(dampers)
        self.report.append(f"{MAPPED}: {', '.join(kinds)} of '{name}': a tendon")

    def _keep_home(self, home: list[float]) -> None:
        """Write the home pose as a key frame, in the order of MuJoCo's coordinates."""
        parts, at = {}, 0
        for name, body in self.bodies.items():
            count = 7 if body["joint"]["type"] == "free" else 1
            parts[name] = np.array(home[at : at + count])
            if count == 7:  # MuJoCo counts from the world, here from where the joint is
                rotation, origin = _read_pose(body["joint"])
                if body["parent"] != "base" or not np.allclose(rotation, np.eye(3)):
                    self.report.append(f"{LEFT_OUT}: home pose: '{name}' is turned")
                    return
                parts[name][:3] += origin
            at += count
        pose = _words(np.concatenate([parts[name] for name in self.order]))
        frames = SubElement(self.root, "keyframe")
        SubElement(frames, "key", {"name": "home", "qpos": pose})


def _read_pose(joint: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position of a joint in its parent."""
    rotation = np.array(joint.get("rotation", np.eye(3)), float)
    return rotation, np.array(joint.get("position", (0, 0, 0)), float)


def _is_linear(law: dict) -> bool:
    """Return whether a law is a spring of one stage or a damper without further numbers."""
    members = set(law) - {"comment"}
    if law["type"] == "spring":
        return members <= {"type", "stages", "rest"} and len(law["stages"]) == 1
    return law["type"] == "damper" and members == {"type", "linear"}


def describe(report: list[str], output: Path) -> str:
    """Say what was mapped and left out, and where it is."""
    return "\n".join([*report, f"{output} written"])
