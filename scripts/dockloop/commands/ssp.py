"""``dockloop ssp``: the docking as an SSP package."""

from dockloop.arguments import Command, Options
from dockloop.console import write
from dockloop.paths import shown

EXAMPLE = "example: dockloop ssp idss_25t_350t --scene experiment.step=0.002 -o docking.ssp"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    command.add_output("FILE.ssp", "default: build/ssp/SCENE.ssp")


def run(options: Options) -> None:
    """Build the package and say where it is."""
    from dockloop.ssp import build_ssp

    package = build_ssp(options.scene, options.overrides, options.output)
    write(f"{shown(package)} ({package.stat().st_size / 1e6:.1f} MB)")
