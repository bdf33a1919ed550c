"""The reference: commands, names of a scene, functions of Python, as the program knows them."""

import io
import os
import re
from contextlib import redirect_stdout, suppress

import dockloop as dl
from dockloop import cli
from dockloop.commands import COMMANDS
from dockloop.scene.catalogue import list_entries, to_document

WIDTH = "92"  # characters of the help of a command
SCENE = "idss_25t_350t"
NAMES = f"""# Names of the default scene

What `dockloop variables {SCENE}` lists: every key, number, parameter, input and output.
Of several alike, `leg[1]` to `leg[6]`, the first is here. [Names](scripts/README.md#names) says how
they are set. An FMU has the list of its own scene in `documentation/index.html`.
"""


def describe_commands() -> str:
    """Return the page with the help of every command."""
    os.environ["COLUMNS"] = WIDTH
    text = "# All commands\n\nThe text of `--help`. [Commands](scripts/README.md) explains them.\n"
    for name in COMMANDS:
        with redirect_stdout(io.StringIO()) as out, suppress(SystemExit):
            cli.main([name, "--help"])
        text += f"\n## dockloop {name}\n\n```text\n{out.getvalue()}```\n"
    return text


def describe_names() -> str:
    """Return the page with what can be set and read in the default scene."""
    text, kind = NAMES, ""
    for row in to_document(SCENE, list_entries(SCENE))["variables"]:
        if re.search(r"\[(?!1\])\d+\]", row["name"]):
            continue
        if row["kind"] != kind:
            kind = row["kind"]
            text += f"\n## {kind.capitalize()}s\n\n| name | default | meaning |\n|---|---|---|\n"
        default = "" if row["default"] is None else f"`{row['default']}` "
        values = ", ".join(row["choices"]) or row["range"]
        meaning = "; ".join(filter(None, (values, row["meaning"]))).replace("|", "\\|")
        text += f"| `{row['name']}` | {default}{row['unit'].removeprefix('1')} | {meaning} |\n"
    return text


def describe_functions() -> str:
    """Return the page with the docstrings of what `import dockloop` offers."""
    text = "# Python\n\nWhat `import dockloop as dl` offers, with every argument."
    text += " [Python](scripts/README.md#python) has examples.\n"
    for heading, kind in (("Functions", "function"), ("Classes", "class")):
        text += f"\n## {heading}\n"
        for name in dl.__all__:
            if isinstance(getattr(dl, name), type) == (kind == "class"):
                text += f"\n```{{eval-rst}}\n.. auto{kind}:: dockloop.{name}\n```\n"
    return text


REFERENCE = {"commands": describe_commands, "names": describe_names, "api": describe_functions}
