"""The docking of a live page to take home: the command, the Python lines, the scene file."""

import copy
import shlex
import tomllib
from collections.abc import Mapping
from typing import Any

from dockloop.live.bench import Bench
from dockloop.scene.copies import set_key
from dockloop.scene.find import find_scene, read_toml
from dockloop.scene.resolve import PATHS, apply_override, split_key
from dockloop.scene.values import as_setting, list_settings, to_text


def make_command(bench: Bench, settings: Mapping[str, str]) -> str:
    """Return the command that runs the docking of these settings with the same bits."""
    overrides, starts = bench.split(settings)
    words = list_settings("--scene", overrides) + list_settings("--set", starts)
    return shlex.join(["dockloop", "run", bench.reference, *words, *bench.options])


def make_exports(bench: Bench, settings: Mapping[str, str]) -> dict[str, str]:
    """Return ``command``, ``report``, ``film``, ``python`` and ``scene``, each as a text.

    Raises:
        UsageError: a setting is refused, or no key of a scene.
    """
    overrides, starts = bench.split(settings)
    lines = [f"    {bench.reference!r},"]
    for word, values in (("overrides", overrides), ("start_values", starts)):
        lines += [f"    {word}={values!r},"] if values else []
    command = make_command(bench, settings)
    return {
        "command": command,
        "report": f"{command} --report --view",
        "film": f"{command} -o live.csv\ndockloop view live.csv --film -o live.mp4",
        "python": "\n".join(["import dockloop as dl", "", "result = dl.run(", *lines, ")", ""]),
        "scene": _write_scene(bench, overrides, starts),
    }


def _write_scene(bench: Bench, overrides: dict[str, Any], starts: dict[str, Any]) -> str:
    """Return the scene file with its comments; if a key cannot be set in it so, without them."""
    scene, text = read_toml(find_scene(bench.reference))
    wanted = copy.deepcopy(scene)
    for name, value in overrides.items():
        apply_override(wanted, as_setting(name, value))
        *sections, member = split_key(name)
        is_path = name.startswith(PATHS)
        text = set_key(text, ".".join(sections), to_text(member) if is_path else member, value)
    try:
        is_right = tomllib.loads(text) == wanted
    except tomllib.TOMLDecodeError:
        is_right = False
    if not is_right:
        text = "".join(f"{to_text(k)} = {to_text(v)}\n" for k, v in wanted.items())
    if starts:
        more = shlex.join(list_settings("--set", starts))
        text = f"# Start values are not in this file: dockloop run FILE.toml {more}\n{text}"
    return text
