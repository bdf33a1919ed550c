"""``dockloop variables``: what can be set and read."""

import json

from dockloop.commands.arguments import Command, Options
from dockloop.commands.console import write

EXAMPLE = "example: dockloop variables idss_25t_350t --match solver --match 'latch[1].*'"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    text = "only names with this text; with *, names that are like it as a whole (repeatable)"
    command.add_list("--match", "patterns", "TEXT", text)
    command.add_flag("--states", "with the states of model exchange and their rates")
    command.add_flag("--json", "print the list as JSON")


def run(options: Options) -> None:
    """List what can be set and read in the scene."""
    from dockloop.scene.catalogue import describe, list_entries, to_document

    entries = list_entries(
        options.scene, options.overrides, options.patterns, has_states=options.states
    )
    document = to_document(options.scene, entries)
    write(json.dumps(document, indent=2) if options.json else describe(entries))
