"""The documentation page of an FMU: one HTML file with all that a new reader needs.

What a page says comes from the FMU's own modelDescription.xml, from the resolved scene and from the
check of its mechanism, so it cannot differ from the FMU it lies in. Figures are drawn by
``drawing.py`` into the page; nothing is loaded from elsewhere. The page prints on A4.
"""

import base64
import html
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from dockloop import drawing
from dockloop.core import list_choices, list_loads
from dockloop.licenses import PARTS
from dockloop.mechanism import split_loops

# Sections of the variable tables: title, and how the names in it begin.
_SECTIONS = (
    ("Chaser", r"(der\()?chaser\."),
    ("Target", r"(der\()?target\."),
    ("Gravity", r"gravity\["),
    ("Relative motion", r"(relative\.|gap$)"),
    ("Loads in the capture interface", r"capture\.(?!reason|seated)"),
    ("Contact, friction and latches", r"(contact\.|latch\[|friction\.|restitution)"),
    ("Phase and outcome", r"(phase$|captured$|capture\.|latched\[|outcome$|time_)"),
    ("Guide ring", r"ring\."),
    ("Legs", r"leg\["),
    ("Force elements", r"(element\[|failure\[)"),
    ("Sequence", r"(sequence\.|command$)"),
    ("Hard dock", r"(hard_dock\.|hook\[|hooks\.|faces\.|pushers\.|joint\.)"),
    ("Independent coordinates", r"(der\()?state\."),
    ("Cut forces and base", r"(loop\[|base\.)"),
    ("Energy and momentum", r"(energy\.|momentum\.)"),
    ("Coupling", r"coupling\."),
    ("Solver", r"(solver\.|accuracy|model\.)"),
    ("Others", r""),
)

_FRAMES = (
    ("N", "any frame of the host that does not rotate: inertial, or local to the orbit"),
    ("C, D", "bodies of chaser and target, origin at the centre of mass"),
    ("A", "active interface, fixed on the chaser: origin at the centre of its mating plane, +x out"
     " of the interface along the docking axis"),
    ("P", "passive interface, fixed on the target: origin at the centre of its mating plane, +x"
     " <em>into</em> the target. A and P coincide when docked"),
    ("B", "base of the mechanism, fixed on the chaser; the same as A unless the scene places it"
     " elsewhere"),
    ("G", "guide ring, the body that meets the target; docking axis +x"),
)  # fmt: skip

_CONVENTIONS = (
    "SI units throughout. Display units (mm, deg, t) are for tools that show them; values are"
    " always passed in the unit.",
    "Quaternions are (w, x, y, z) and turn body axes into reference axes:"
    " <code>x<sub>N</sub> = R(q) x<sub>C</sub></code>. A norm that differs from 1 by 1e-3 or more"
    " is refused.",
    "Positions and velocities of vehicles are in N, angular velocities and torques in body axes.",
    "Inertia is listed as xx yy zz xy xz yz about the centre of mass in body axes; the last three"
    " are the elements of the matrix (minus the products of inertia).",
    "Indices count from 1. A choice is an Integer counted from 1.",
    "A load <em>of the docking system</em> is what the vehicle feels. Capture loads act on the"
    " target: compression pushes it away, tension pulls it back. A leg force is positive when it"
    " pushes the ends of the leg apart. A gap is negative in contact.",
)

_STATUSES = (
    ("fmi2Warning", "a log line only: a parameter breaks a rule of thumb, or a loop comes near a"
     " singular pose, or the energy audit is off", "what the line says"),
    ("fmi2Discard", "<code>fmi2DoStep</code>: surfaces pressed to their cores or passed through,"
     " tolerance not met, more work than a step of this size may take (about half a second), energy"
     " made by steps that are too long for a method without error control, a loop that cannot be"
     " closed or would close another way, a pose that is not a unit quaternion",
     "repeat the step smaller, or correct the input: the instance is still at the start"
     " of the step"),
    ("fmi2Error", "<code>fmi2DoStep</code>: a leg that cannot reach its point, a loop in a singular"
     " pose, a value"
     " that is not finite", "<code>fmi2Reset</code>"),
    ("fmi2Error", "any other call: wrong state, unknown reference, value outside min and max,"
     " parameters that cannot be simulated, a step size that is not positive, a step that does not"
     " begin where the last one ended or that ends after the stopTime of"
     " <code>fmi2SetupExperiment</code>", "the call changed nothing; correct it"),
    ("fmi2Fatal", "never used", "&ndash;"),
)  # fmt: skip

# What the library loads at run time (tests/test_binary.py reads it from the binary).
_NATIVE_NEEDS = """\
binaries/linux64 was built for this machine. It needs the C and C++ runtime of the system:

  libc.so.6, libm.so.6            glibc 2.34 or newer
  libstdc++.so.6, libgcc_s.so.1   GCC 11 or newer

Debian 12, Ubuntu 22.04 and newer have them (packages libc6, libstdc++6, libgcc-s1).
"""
_PORTABLE_NEEDS = """\
The binaries hold all they need but the C library of the system:

  linux64, aarch64-linux     libc.so.6, libm.so.6, libpthread.so.0, libdl.so.2: glibc 2.17 or newer
                             (every Linux of the last ten years but those built on musl)
  win64                      Windows 10 or newer
  darwin64, aarch64-darwin   macOS 11 or newer
"""


def describe_needs(portable: bool) -> str:
    """Return documentation/externalDependencies.txt.

    Args:
        portable: whether the library for linux64 is one of scripts/platforms.
    """
    needs = _PORTABLE_NEEDS if portable else _NATIVE_NEEDS
    return f"{needs}\nNo files outside the FMU, no servers, no licence keys.\n"


_CAPABILITIES = {
    "needsExecutionTool": "another program is needed to run it",
    "canHandleVariableCommunicationStepSize": "the step may change from one call to the next",
    "canInterpolateInputs": "input derivatives are used within a step",
    "maxOutputDerivativeOrder": "derivatives of outputs that can be read",
    "canRunAsynchronuously": "steps run in the background",
    "canBeInstantiatedOnlyOncePerProcess": "false: as many instances as you like",
    "canNotUseMemoryManagementFunctions": "true: memory callbacks of the host are not used",
    "canGetAndSetFMUstate": "states can be saved and restored",
    "canSerializeFMUstate": "saved states can be written to a file",
    "providesDirectionalDerivative": "directional derivatives can be read",
    "completedIntegratorStepNotNeeded": "fmi2CompletedIntegratorStep need not be called",
}

_STYLE = """
:root { color-scheme: light; --ink: #1d2733; --soft: #55616e; --line: #d5dce4; --tint: #f4f7fa }
* { box-sizing: border-box }
body { font: .94rem/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: var(--ink);
  max-width: 62rem; margin: 0 auto; padding: 2.5rem 1.5rem 4rem; background: #fff }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .4rem }
h2 { font-size: 1.3rem; margin: 2.8rem 0 .8rem; padding-top: .8rem;
  border-top: 2px solid var(--ink) }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .5rem }
p, li { max-width: 46rem }
a { color: #1f5fa8 }
.lead { font-size: 1.1rem; color: var(--soft); margin: 0 0 1.2rem }
nav { background: var(--tint); border-radius: 8px; padding: .8rem 1.2rem; columns: 3 12rem }
nav a { display: block; text-decoration: none; line-height: 1.8; break-inside: avoid }
header { display: flex; gap: 1.5rem; align-items: center; margin-bottom: 1.5rem }
header img { width: 96px; height: 96px; flex: none }
table { border-collapse: collapse; width: 100%; margin: .6rem 0 1.2rem; font-size: .88rem;
  line-height: 1.4 }
th { text-align: left; font-weight: 600; border-bottom: 1.5px solid var(--ink);
  padding: .3rem .8rem .3rem 0; white-space: nowrap }
td { border-bottom: 1px solid var(--line); padding: .32rem .8rem .32rem 0; vertical-align: top }
td:last-child, th:last-child { padding-right: 0 }
table.s { width: auto } table.s th, table.s td { padding-right: 2.5rem }
table.v { table-layout: fixed } table.v td { overflow-wrap: anywhere }
table.v th:nth-last-child(5) { width: 7% }
table.v th:nth-last-child(4) { width: 12% } table.v th:nth-last-child(3) { width: 14% }
table.v th:nth-last-child(2) { width: 10% } table.v th:first-child { width: 28% }
code, pre { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace;
  font-size: .92em }
pre { background: var(--tint); border-left: 3px solid #2f6db5; border-radius: 4px;
  padding: .9rem 1.1rem; overflow-x: auto; line-height: 1.45; font-size: .85rem }
figure { margin: 1.2rem 0 1.6rem } figure svg { width: 100%; height: auto; display: block }
figcaption { color: var(--soft); font-size: .88rem; margin-top: .3rem }
i { color: var(--soft); font-style: normal }
.index { columns: 3 17rem; font-size: .78rem; list-style: none; padding: 0 }
.index li { break-inside: avoid; display: flex; justify-content: space-between; gap: .6rem;
  border-bottom: 1px solid var(--line); padding: .1rem .1rem }
.index span { color: var(--soft) }
@media print {
  @page { size: A4; margin: 16mm 14mm }
  html { font-size: 10.5px }
  body { padding: 0; max-width: none }
  p, li { max-width: none } nav { display: none } pre { overflow: visible }
  h2, h3 { break-after: avoid } table, figure, pre { break-inside: auto }
  tr, figure, pre { break-inside: avoid } thead { display: table-header-group }
  a { color: inherit; text-decoration: none }
}
"""


def make_page(document: dict, description: str, report: dict, needs: str, icon: bytes) -> str:
    """Return the documentation page.

    Args:
        document: the resolved scene.
        description: text of modelDescription.xml.
        report: what ``dockloop check`` says of the mechanism.
        needs: what the binaries need of the system (describe_needs).
        icon: the icon of the FMU as SVG, which goes into the page.
    """
    root = ET.fromstring(description)
    sections = [
        ("start", "Quick start", _quick_start(document, root)),
        ("frames", "Frames", _frames(document)),
        ("conventions", "Conventions", _list(_CONVENTIONS)),
        ("connect", "How to connect it", _connect(document, root)),
        ("variables", "Inputs and outputs", _variables(root, parameters=False)),
        ("parameters", "Parameters", _parameters(root)),
        *([("phases", "Phases and outcomes", _phases())] if _has(root, "phase") else []),
        ("model", "The model of this scene", _model(document, report)),
        ("limits", "Limits", _limits(document)),
        ("refusals", "What is refused, and how", _refusals(root)),
        ("capabilities", "Capabilities", _capabilities(root, needs)),
        ("licences", "Licences", _licences()),
        ("index", "Index of all variables", _index(root)),
    ]
    contents = "\n".join(f'<a href="#{key}">{title}</a>' for key, title, _ in sections)
    body = "\n".join(f'<h2 id="{key}">{title}</h2>\n{text}' for key, title, text in sections)
    title = html.escape(document["title"])
    image = f"data:image/svg+xml;base64,{base64.b64encode(icon).decode()}"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{_STYLE}</style>
</head>
<body>
<header><img src="{image}" alt="two vehicles with a ring on legs between them"><div>
<h1>{title}</h1>
<p class="lead">{_lead(document, report)}</p>
</div></header>
<nav>
{contents}
</nav>
{body}
</body>
</html>
"""


def _lead(document: dict, report: dict) -> str:
    """Say in two sentences what the FMU is."""
    mechanism, has_target = document["mechanism"], "target" in document
    what = "The docking of two spacecraft" if has_target else "A docking mechanism"
    parts = ["equations of motion"]
    if loops := len(split_loops(report)["loops"]):
        parts.append(f"a mechanism with {loops} closed kinematic loop{'s' * (loops > 1)}")
    if has_target and mechanism.get("contact"):
        parts.append("contact")
    if has_target and mechanism.get("latches"):
        parts.append("latches")
    return (
        f"{what} as an FMI 2.0 FMU: {', '.join(parts)}, and the solver, in one library. Built by"
        f" dockloop from the scene <code>{html.escape(document['name'])}</code>."
    )


# ------------------------------------------------------------------- using it


def _quick_start(document: dict, root: ET.Element) -> str:
    """Return code that runs the FMU and shows some results."""
    wished = ("relative.axial", "capture.compression", "captured", "ring.position[1]")
    outputs = [name for name in (*wished, "chaser.position[1]") if _has(root, name)][:3]
    names = ", ".join(f'"{name}"' for name in outputs)
    code = f"""from fmpy import simulate_fmu

result = simulate_fmu(
    "{document["name"]}.fmu",
    start_values={{"solver.rtol": {document["solver"].get("rtol", 1e-6):g}}},
    output=[{names}],
)
print(result[-1])  # time and outputs at the end"""
    driven = any(document.get(v, {}).get("motion") == "driven" for v in ("chaser", "target"))
    held = " Inputs keep their start values in it." if driven else ""
    experiment = root.find("DefaultExperiment")
    stop, step = (float(experiment.get(key)) for key in ("stopTime", "stepSize"))
    return f"""<p>With Python and <code>pip install fmpy</code>, in the folder of the FMU:</p>
<pre id="quick-start"><code>{html.escape(code)}</code></pre>
<p>This makes the default experiment: {stop:g} s in steps of {step:g} s.{held} The step may
have any size and may change: the FMU takes as many inner steps as its tolerance needs. The FMU
never ends a run from inside; after capture, rebound or a miss it goes on.</p>
<p>The whole scene is in <code>resources/model.json</code>. Parameters and start values can be set
before the initialisation ends, inputs at any communication point.</p>"""


def _frames(document: dict) -> str:
    """Return the frames with their figure."""
    has_target = "target" in document
    has_ring = bool(document["mechanism"].get("capture"))
    texts = dict(_FRAMES)
    if not has_target:
        del texts["P"], texts["C, D"]
        chaser = "body of the chaser, origin at the centre of mass"
        texts = {"N": texts.pop("N"), "C": chaser, **texts}
        texts["G"] = "ring, the body that would meet a target"
    if not has_ring:
        del texts["G"]
    rows = [(f"<strong>{name}</strong>", text) for name, text in texts.items()]
    figure = drawing.draw_frames(has_target, has_ring)
    caption = "Frames, schematic and drawn apart. Names of variables next to their arrows."
    return _figure(figure, caption) + _table(("frame", "where"), rows)


def _connect(document: dict, root: ET.Element) -> str:
    """Say which variable goes where, for the vehicles of this scene."""
    step = float(root.find("DefaultExperiment").get("stepSize"))
    parts = []
    for vehicle in ("chaser", "target"):
        if vehicle in document:
            parts.append(_connect_vehicle(vehicle, document[vehicle]["motion"], step))
    parts.append(
        "<h3>Gravity</h3><p><code>gravity[1..3]</code> is an acceleration in N that acts on every"
        " body inside, vehicles and mechanism alike. Set it here <em>or</em> leave it out on both"
        " sides; never include it in <code>force_ext</code> as well. In free fall around the same"
        " planet it can be left out: it moves everything alike.</p>"
        "<h3>Terminals</h3><p><code>terminalsAndIcons/terminalsAndIcons.xml</code> groups these"
        " variables: one terminal for each vehicle and one for gravity. Members are named as the"
        " variables without the vehicle in front (<code>position[1]</code>,"
        " <code>force_mean[3]</code>) and are matched by that name (rule <code>bus</code>), so a"
        " vehicle model may offer fewer.</p>"
    )
    return "\n".join(parts)


def _connect_vehicle(vehicle: str, motion: str, step: float) -> str:
    """Say how one vehicle is connected."""
    v = f"<code>{vehicle}."
    if motion == "fixed":
        return (
            f"<h3>The {vehicle} does not move</h3><p>Its pose is a start value. {v}force</code> and"
            f" {v}torque</code> are the loads it must bear.</p>"
        )
    if motion == "free":
        return (
            f"<h3>The {vehicle} is integrated inside</h3><p>Its motion is an output whose start"
            " value is the initial condition. Thrusters, drag and whatever else acts from outside"
            f" goes to {v}force_ext[1..3]</code> (in N) and {v}torque_ext[1..3]</code> (about the"
            " centre of mass, body axes); they are held over a step. Without a connection they are"
            " zero.</p>"
        )
    other = (
        "so that inside a step, while the contact is stiff, the FMU moves the vehicle itself, with"
        " the stated mass, inertia and <code>force_ext</code>, <code>torque_ext</code>"
    )
    return (
        f"<h3>The {vehicle} is driven by the host</h3>"
        + _figure(
            drawing.draw_coupling(vehicle),
            f"One communication step, sequential: first the FMU, then the model of the {vehicle}.",
        )
        + f"""<ol>
<li>At t, set {v}position</code>, {v}velocity</code>, {v}attitude</code> and
{v}angular_velocity</code> from your vehicle model.</li>
<li>Call <code>fmi2DoStep(t, h)</code>.</li>
<li>Read {v}force_mean[1..3]</code> and {v}torque_mean[1..3]</code>: the constant loads that, held
over this step, give the vehicle exactly the linear and angular impulse it received.</li>
<li>Let your vehicle model make the same step under these loads. Go to 1 with t + h.</li>
</ol>
<p>Set {v}mass</code>, {v}inertia</code> and the interface to those of your vehicle, {other}. Do
not feed the loads of the FMU back through <code>force_ext</code>. {v}force</code> and
{v}torque</code> are the loads at the end of the step; samples of them miss impulses.</p>
<p>That is the sequential order, <code>coupling.mode</code> = 1. Where all models of a simulation
step at once with the values of t, as plain masters do, set <code>coupling.mode</code> = 2: then
{v}force_mean</code> and {v}torque_mean</code> are announced for the coming step, the first time
after initialisation, for a step of <code>coupling.expected_step</code>. Where your vehicle makes
its step before the FMU, set <code>coupling.mode</code> = 3: hold the announced loads, and set the
motion at t + h before <code>fmi2DoStep(t, h)</code>. Announce a change of step
beforehand in <code>coupling.next_step</code>.</p>
<p>Connect <code>gravity</code> if your frame falls, and set every other load on the vehicle in
{v}force_ext</code> and {v}torque_ext</code>. Then the step may be long: what the FMU cannot
predict of your vehicle is corrected at the next communication point, and impulse that your vehicle
is pending is kept in <code>coupling.pending_impulse</code>. With a wrong mass the coupling is of
first order in the step. A wrong mass, a wrong order and a missing gravity are reported in the log
(category <code>logStatusWarning</code>), with numbers. The default experiment has steps of
{step:g} s.</p>"""
    )


# ------------------------------------------------------------------- variables


def _has(root: ET.Element, name: str) -> bool:
    """Return whether the FMU has a variable."""
    return root.find(f"ModelVariables/ScalarVariable[@name='{name}']") is not None


def _by_section(root: ET.Element, parameters: bool) -> Iterable[tuple[str, list[ET.Element]]]:
    """Yield sections that are not empty, with their variables."""
    rest = [
        variable
        for variable in root.find("ModelVariables")
        if (variable.get("causality") == "parameter") == parameters
    ]
    for title, pattern in _SECTIONS:
        inside = [v for v in rest if re.match(pattern, v.get("name"))]
        if inside:
            yield title, inside
        rest = [v for v in rest if v not in inside]


def _variables(root: ET.Element, parameters: bool) -> str:
    """Return one table a section; a vector is one row."""
    columns = ("variable", "kind", "unit", "start", "range", "meaning")
    head = [column for column in columns if not (parameters and column == "kind")]
    parts = []
    for title, variables in _by_section(root, parameters):
        families: dict[str, list[ET.Element]] = {}
        for variable in variables:
            key = re.sub(r"\[\d+\]", "[]", variable.get("name")) + variable.get("causality", "")
            families.setdefault(key, []).append(variable)
        rows = []
        for family in families.values():
            row = _row(family)
            rows.append(row if not parameters else row[:1] + row[2:])
        parts.append(f"<h3>{title}</h3>" + _table(head, rows, "v"))
    return "\n".join(parts)


def _parameters(root: ET.Element) -> str:
    """Return the parameters."""
    return (
        "<p>Fixed: they can be set until the initialisation ends. Start values are those of the"
        " scene. The initial motion of a vehicle that is integrated inside is set through the start"
        " values of its position, velocity, attitude and angular velocity above.</p>"
        + _variables(root, parameters=True)
    )


def _row(family: list[ET.Element]) -> tuple[str, ...]:
    """Return the cells of one row: variables that differ in their indices only."""
    first = family[0][0]
    unit = html.escape(first.get("unit", ""))
    if first.get("displayUnit"):
        unit += f" <i>({html.escape(first.get('displayUnit'))})</i>"
    kind = family[0].get("causality", "local")
    if first.tag != "Real":
        unit = f"<i>{first.tag}</i>"
    starts = list(dict.fromkeys(_number(v[0].get("start")) for v in family))
    if len(starts) > 1:
        starts = [_number(v[0].get("start")) for v in family]
    start = ", ".join(starts)
    low, high = _number(first.get("min")), _number(first.get("max"))
    limits = f"{low} &hellip; {high}" if low and high else f"&ge; {low}" if low else ""
    name = f"<code>{html.escape(_family_name(family))}</code>"
    kind = f"<i>{kind}</i>"
    return name, kind, unit, start, limits, html.escape(_family_text(family))


def _number(text: str | None) -> str:
    """Return a number as people want to read it."""
    if text is None or text in ("true", "false"):
        return text or ""
    if abs(float(text)) == math.pi:
        return ("\N{MINUS SIGN}" if float(text) < 0 else "") + "\N{GREEK SMALL LETTER PI}"
    number = re.sub(r"e([+-])0*", r"e\1", f"{float(text):.6g}").replace("e+", "e")
    return number.replace("-", "\N{MINUS SIGN}")


def _family_name(family: list[ET.Element]) -> str:
    """Return a name with ranges in place of indices: leg[1..6].force."""
    columns = zip(*(re.findall(r"\[(\d+)\]", v.get("name")) for v in family), strict=True)
    ranges = []
    for column in columns:
        numbers = [int(text) for text in column]
        low, high = min(numbers), max(numbers)
        ranges.append(f"[{low}..{high}]" if high > low else f"[{low}]")
    pieces = re.split(r"\[\d+\]", family[0].get("name"))
    return "".join(
        piece + extra for piece, extra in zip(pieces, [*ranges, ""], strict=True)
    )  # fmt: skip


def _family_text(family: list[ET.Element]) -> str:
    """Return the common description; what differs at its end is listed once."""
    texts = list(dict.fromkeys(v.get("description", "") for v in family))
    if len(texts) == 1:
        return texts[0]
    heads = {text.rpartition(", ")[0] for text in texts}
    if len(heads) == 1:
        return f"{heads.pop()} ({', '.join(text.rpartition(', ')[2] for text in texts)})"
    return texts[0]


def _index(root: ET.Element) -> str:
    """List every variable with its value reference."""
    items = "\n".join(
        f"<li><code>{html.escape(v.get('name'))}</code> <span>{v.get('valueReference')}</span></li>"
        for v in root.find("ModelVariables")
    )
    return f'<p>Names and value references.</p>\n<ul class="index">\n{items}\n</ul>'


# ------------------------------------------------------------------- the model


def _phases() -> str:
    """Return phases and outcomes with the figure of what follows what."""
    return (
        _figure(drawing.draw_phases(), "What leads from one phase to the next.")
        + _table(("phase", "name", "when"), list_choices("phase"), "s")
        + _table(("outcome", "name", "when"), list_choices("outcome"), "s")
        + "<p>An outcome is the verdict so far: it can change while the run goes on (a rebound may"
        " be followed by a capture).</p>"
    )


def _model(document: dict, report: dict) -> str:
    """State the facts of this scene."""
    mechanism = document["mechanism"]
    vehicles = [
        f"{vehicle}: {document[vehicle]['motion']}"
        + (
            f", {document[vehicle]['mass']:g} kg"
            if "mass" in document[vehicle] and document[vehicle]["motion"] != "fixed"
            else ""
        )
        for vehicle in ("chaser", "target")
        if vehicle in document
    ]
    moving = sum(
        document.get(v, {}).get("motion", "fixed") != "fixed" for v in ("chaser", "target")
    )
    freedoms = f"{report['degrees_of_freedom']} of the mechanism"
    if moving:
        freedoms += f", 6 of {'each vehicle' if moving > 1 else 'the vehicle that moves'}"
    found = split_loops(report)
    closures = sorted({loop.get("closure", "") for loop in found["loops"]} - {""})
    loops = f"{len(found['loops'])}" + (f" ({', '.join(closures)})" if closures else "")
    rows = [
        ("vehicles", "; ".join(vehicles)),
        ("mechanism", f"<code>{html.escape(mechanism['name'])}</code>, {report['mass']:g} kg"),
        ("moving bodies of the mechanism", str(report["bodies"])),
        ("closed loops", loops),
        ("couplings: screws, gears", str(len(found["couplings"]))),
        ("degrees of freedom", freedoms),
        ("bodies with independent coordinates", ", ".join(report["independent"]) or "none"),
    ]  # fmt: skip
    modes = [mode["frequency_rad_s"] for mode in report.get("modes", [])]
    if modes:
        rows.append(
            ("vibration about home, base at rest: magnitudes of eigenvalues",
             f"{min(modes):.3g} to {max(modes):.3g} rad/s")
        )  # fmt: skip
    contact = mechanism.get("contact", {}).get("type")
    surfaces = {
        "guide_ring": "guide rings with petals",
        "surfaces": "cores of the mechanism file",
        "absorber": "a spring-damper on the axis",
    }
    if contact and "target" in document:
        rows.append(("contact", surfaces.get(contact, contact)))
    if mechanism.get("latches"):
        latches = mechanism["latches"]
        rows.append(("latches", str(len(latches.get("list") or latches["azimuth"]))))
    text = _table((), rows, "s")
    text += (
        "<p>Loops are cut and eliminated: only the independent coordinates are integrated, by the"
        " method of <code>solver.method</code>. There are no multipliers and nothing drifts"
        " apart.</p><p><code>model.level</code> chooses how much of the mechanism is modelled: 3"
        " every body, 2 legs without mass, 1 locked at its start pose (then the legs show what"
        " their springs would exert, and cut forces are zero).</p>"
    )
    figure = drawing.draw_legs(mechanism, report["home_q"])
    if figure:
        caption = "Legs at home, to scale: squares at the root, circles at the closing body."
        if contact == "guide_ring" and "azimuth" in mechanism.get("latches", {}):
            caption += " Petals in red, hooks of the latches in yellow."
        text += _figure(figure, caption) + _leg_table(mechanism, report["home_q"])
    return text


def _leg_table(mechanism: dict, home_q: list[float]) -> str:
    """Return the ends of the legs."""
    rows = []
    numbers = {leg["name"]: i for i, leg in enumerate(mechanism.get("legs", []), start=1)}
    for name, root, end in drawing.find_legs(mechanism, home_q):
        points = (", ".join(_number(f"{1e3 * x:.1f}") for x in point) for point in (root, end))
        length = 1e3 * float(sum((end - root) ** 2)) ** 0.5
        label = f"leg[{numbers[name]}]" if name in numbers else name
        rows.append((label, *points, f"{length:.1f}"))
    head = ("leg", "root, mm in B", "closing end, mm in B", "distance at home, mm")
    return _table(head, rows)


def _limits(document: dict) -> str:
    """Return rated loads and the limits of validity."""
    mechanism = document["mechanism"]
    rated, text = mechanism.get("limits"), ""
    if rated:
        rows = [(name, f"{rated[name]:g}", unit)
                for name, unit in list_loads().items() if name in rated]  # fmt: skip
        text += "<h3>Rated loads of the capture interface</h3>"
        text += _table(("load", "rated", "unit"), rows, "s")
        text += (
            "<p>The largest ratio of a load to its rated value is <code>capture.load_ratio</code>"
            " in scenes that export the group <code>capture</code>. Exceeding it changes nothing:"
            " the model does not break.</p>"
        )
    items = []
    contact = mechanism.get("contact", {})
    if "target" in document and contact.get("type") == "guide_ring":
        rounding = 1e3 * min(contact["ring_rounding"], contact["petal_rounding"])
        items += [
            f"Contact depth: surfaces are rounded (smallest radius {rounding:g} mm). A state"
            " deeper than 0.98 of the roundings of a pair is refused.",
            "Relative tilt below 30 deg; nothing behind the ring is modelled.",
        ]
    if "target" in document and "interface" not in mechanism:
        items.append("No hooks, no hard docking: the mechanism has no <code>interface</code>.")
    if legs := mechanism.get("legs"):
        first = next(iter(drawing.list_legs(mechanism)), {})
        has_cranks = "pin" in first or any("crank_joint" in leg for leg in legs)
        where = (
            "its crank and its rod are in line, seen along the crank axis"
            if has_cranks
            else "it lies along the first axis of its universal joint or has no length"
        )
        items.append(
            f"Singular poses: each of the {len(legs)} legs loses its grip where {where};"
            " near such a pose the log warns, and a step into it is refused."
        )
        if stops := first.get("stops"):
            items.append(
                f"End stops of the legs at {1e3 * stops['min_length']:g} mm and"
                f" {1e3 * stops['max_length']:g} mm{' of pin travel' * has_cranks}."
            )
    items.append(
        "Bodies are rigid. Very stiff parts and small tolerances together cost many steps:"
        " <code>solver.method</code> 6 (bdf) may take fewer."
    )
    return text + "<h3>Validity</h3>" + _list(items)


def _refusals(root: ET.Element) -> str:
    """Return statuses and log categories."""
    statuses = [(f"<code>{status}</code>", *rest) for status, *rest in _STATUSES]
    categories = [
        (f"<code>{html.escape(c.get('name'))}</code>", html.escape(c.get("description", "")))
        for c in root.iterfind("LogCategories/Category")
    ]
    return (
        "<p>A refusal is one sentence in the log that names variable, value and limit, and leaves"
        " the instance as it was.</p>"
        + _table(("status", "when", "what to do"), statuses)
        + "<h3>Log categories</h3><p>Warnings and errors are always logged;"
        " <code>loggingOn</code> adds <code>logEvents</code>, and"
        " <code>fmi2SetDebugLogging</code> chooses.</p>"
        + _table(("category", "what"), categories, "s")
    )


def _capabilities(root: ET.Element, needs: str) -> str:
    """Return the capability flags of each kind of FMU inside."""
    text = ""
    for kind in ("CoSimulation", "ModelExchange"):
        element = root.find(kind)
        if element is None:
            continue
        rows = [
            (f"<code>{html.escape(flag)}</code>", html.escape(value), _CAPABILITIES.get(flag, ""))
            for flag, value in element.attrib.items()
            if flag != "modelIdentifier"
        ]
        text += f"<h3>{re.sub('(?=[ES])', ' ', kind).strip().capitalize()}</h3>"
        text += _table(("flag", "value", "meaning"), rows)
    return text + (
        f"<h3>What it needs</h3><pre>{html.escape(needs)}</pre>"
        "<p>One instance is used by one thread at a time; different instances may run in different"
        " threads of one process.</p>"
    )


def _licences() -> str:
    """List what is inside the library and under which licence."""
    rows = [
        (html.escape(part.name), html.escape(part.used), html.escape(part.license),
         f'<a href="licenses/{part.file}">{part.file}</a>')
        for part in PARTS
    ]  # fmt: skip
    return _table(("part", "what it does here", "licence", "text"), rows)


# ------------------------------------------------------------------- HTML


def _table(head: Iterable[str], rows: Iterable[Iterable[object]], kind: str = "") -> str:
    """Return a table; cells are HTML. `kind` is a class of the style sheet."""
    top = "".join(f"<th>{text}</th>" for text in head)
    top = f"<thead><tr>{top}</tr></thead>" if top else ""
    body = "\n".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    style = f' class="{kind}"' if kind else ""
    return f"<table{style}>{top}<tbody>\n{body}\n</tbody></table>\n"


def _list(items: Iterable[str]) -> str:
    """Return a list; items are HTML."""
    return "<ul>\n" + "\n".join(f"<li>{item}</li>" for item in items) + "\n</ul>\n"


def _figure(svg: str, caption: str) -> str:
    """Return a figure with its caption."""
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"
