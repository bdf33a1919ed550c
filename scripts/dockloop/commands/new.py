"""``dockloop new``: copies a scene and its mechanism."""

from pathlib import Path

from dockloop.commands.arguments import Command, Options
from dockloop.commands.console import write

EXAMPLE = "example: dockloop new my_docking --from apda"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("name", metavar="NAME", help="of the copies NAME.toml and NAME.json")
    text = "a shipped scene or a file (default: idss_25t_350t)"
    command.add_option("--from", "SCENE", text, dest="scene", default="idss_25t_350t")
    command.add_output("FOLDER", "default: this folder", Path())


def run(options: Options) -> None:
    """Copy both files and say where they are."""
    from dockloop.scene.copies import copy_scene, describe

    write(describe(copy_scene(options.scene, options.name, options.output)))
