"""Builds an FMU: a zip file with the compiled library and the resolved scene.

Layout (FMI 2.0)::

    modelDescription.xml                what the FMU exports, from dockloop-core
    binaries/linux64/NAME.so            the compiled library, the same for every scene
    resources/model.json                the resolved scene, all that the library reads
    documentation/index.html            frames and variables for people
    documentation/licenses/license.txt

The same scene and library give the same bytes: entries are sorted and dated alike. The date is
1980-01-01 (the first that a zip file can hold) unless SOURCE_DATE_EPOCH says otherwise.
"""

import datetime
import html
import json
import os
import sys
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

from dockloop import paths
from dockloop.core import run_core
from dockloop.errors import DockloopError
from dockloop.scene import find_scene, resolve_scene

_FIRST_ZIP_DATE = 315532800  # 1980-01-01T00:00:00Z, s since 1970

_FRAMES = """
<table>
<tr><th>frame</th><th>where</th></tr>
<tr><td>N</td><td>any non-rotating frame the host uses</td></tr>
<tr><td>C, D</td><td>bodies of chaser and target, origin at the centre of mass</td></tr>
<tr><td>A</td><td>active interface on the chaser, +x out of it along the docking axis</td></tr>
<tr><td>P</td><td>passive interface on the target, +x into the target: A and P coincide when
docked</td></tr>
<tr><td>B</td><td>base of the mechanism, fixed on the chaser (here equal to A)</td></tr>
<tr><td>G</td><td>guide ring</td></tr>
</table>
<p>Quaternions are (w, x, y, z), body axes to reference axes. Angular velocities are in body axes,
positions and velocities of vehicles in N.</p>
"""


def build_fmu(
    reference: str, overrides: list[str] | tuple[str, ...] = (), output: Path | None = None
) -> Path:
    """Build the FMU of a scene.

    Args:
        reference: name or path of the scene.
        overrides: ``KEY=VALUE`` texts that replace keys of the scene.
        output: the FMU to write; default ``build/fmu/SCENE.fmu`` of the project.

    Returns:
        The FMU.

    Raises:
        UsageError: scene, mechanism or override is bad.
        DockloopError: the compiled parts are missing, or the file cannot be written.
    """
    source = find_scene(reference)
    document = resolve_scene(source, overrides)
    if not paths.LIBRARY.exists():
        raise DockloopError(
            f"{paths.shown(paths.LIBRARY)} is not there: build it with scripts/demo, scripts/test"
            " or 'cmake --preset release && cmake --build --preset release'"
        )
    stamp = int(os.environ.get("SOURCE_DATE_EPOCH", _FIRST_ZIP_DATE))
    date = datetime.datetime.fromtimestamp(max(stamp, _FIRST_ZIP_DATE), datetime.UTC)

    with tempfile.TemporaryDirectory(prefix="dockloop-") as folder:
        model = Path(folder) / "model.json"
        model.write_text(_to_json(document))
        if document["initial"]["at"] == "first_contact":
            placed = json.loads(run_core("place", model, source=source))
            if not placed["touches"]:
                print(
                    f"dockloop: warning: {paths.shown(source)}: with these conditions the capture"
                    " surfaces never touch; the mating planes meet at the stated time instead",
                    file=sys.stderr,
                )
            for vehicle in ("chaser", "target"):
                document[vehicle] |= placed[vehicle]
            model.write_text(_to_json(document))
        description = run_core(
            "describe", model, "--date", date.strftime("%Y-%m-%dT%H:%M:%SZ"), source=source
        )

    name = document["name"]
    entries = {
        "modelDescription.xml": description.encode(),
        f"binaries/linux64/{name}.so": paths.LIBRARY.read_bytes(),
        "resources/model.json": _to_json(document).encode(),
        "documentation/index.html": _documentation(document, description).encode(),
        "documentation/licenses/license.txt": (paths.ROOT / "LICENSE").read_bytes(),
    }
    output = output or paths.BUILD / "fmu" / f"{name}.fmu"
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        _write_zip(output, entries, date)
    except OSError as error:
        raise DockloopError(f"{output}: cannot be written ({error.strerror})") from None
    return output


def _to_json(document: dict) -> str:
    """Return a document as JSON text, one top-level member per line."""
    lines = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in document.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _write_zip(output: Path, entries: dict[str, bytes], date: datetime.datetime) -> None:
    """Write a zip file whose bytes depend on its content only; replaces `output` at once."""
    partial = output.with_suffix(".partial")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            info = zipfile.ZipInfo(name, date.timetuple()[:6])
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            archive.writestr(info, content)
    partial.replace(output)


def _documentation(document: dict, description: str) -> str:
    """Return a page that tells a stranger what the FMU is and what its variables mean."""
    root = ET.fromstring(description)
    rows = []
    for variable in root.iter("ScalarVariable"):
        kind = variable[0]
        cells = (
            variable.get("name"),
            variable.get("causality", "local"),
            kind.tag,
            kind.get("unit", ""),
            kind.get("start", ""),
            variable.get("description", ""),
        )
        rows.append("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in cells) + "</tr>")
    head = ("variable", "causality", "type", "unit", "start", "meaning")
    table = "<tr>" + "".join(f"<th>{text}</th>" for text in head) + "</tr>\n" + "\n".join(rows)
    title = html.escape(document["title"])
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body {{ font-family: sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em }}
td, th {{ text-align: left; padding: 0.1em 0.8em 0.1em 0; vertical-align: top }}</style></head>
<body>
<h1>{title}</h1>
<p>Docking of two spacecraft as an FMI 2.0 co-simulation FMU, built by dockloop from the scene
<code>{document["name"]}</code>. The FMU never ends a run: after capture or rebound it goes on.
The whole scene is in <code>resources/model.json</code>.</p>
<h2>Frames</h2>{_FRAMES}
<h2>Variables</h2><table>
{table}
</table></body></html>
"""
