"""``dockloop import``: a mechanism from MJCF, URDF or SDF."""

from dockloop.commands.arguments import Command, Options, filled, finite
from dockloop.commands.console import write

EXAMPLE = "example: dockloop import stewart.sdf -o stewart.json --ring ring"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    text = "MJCF (needs dockloop[import]), URDF or SDF; its root element says which"
    command.add_argument("file", metavar="FILE", type=filled, help=text)
    command.add_output("FILE.json", "the mechanism; without, the report only")
    command.add_option("--base", "LINK", "the base (default: the world, or the root of the tree)")
    command.add_option("--ring", "LINK", "the capture body")
    text = "axis of base and ring that points at the other vehicle: x (default), y, z, =-z, ..."
    command.add_option("--forward", "AXIS", text, default="x")
    text = "cut this joint of a loop (repeatable; default: the shortest chains)"
    command.add_list("--cut", "cut", "NAME", text)
    text = "close loops that are open by at most this at the pose of the file [m] (default 0.01)"
    command.add_option("--assemble", "METRES", text, type=finite, default=0.01)


def run(options: Options) -> None:
    """Import the mechanism, write it, and say what became of each construct."""
    from dockloop.exchange.importing import describe, import_mechanism

    chosen = {key: getattr(options, key) for key in ("base", "ring", "cut", "assemble", "forward")}
    imported = import_mechanism(options.file, options.output, **chosen)
    write(describe(imported))
