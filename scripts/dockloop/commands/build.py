"""``dockloop build``: the FMU of a scene, or its document for programs in C++."""

from dockloop.base.errors import UsageError
from dockloop.base.paths import shown
from dockloop.commands.arguments import Command, Options
from dockloop.commands.console import write

EXAMPLE = "example: dockloop build idss_25t_350t --scene initial.closing_speed=0.05 -o slow.fmu"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    text = "default: build/fmu/SCENE.fmu; FILE.json: the scene alone, for programs in C++"
    command.add_output("FILE.fmu", text)
    text = "run the default experiment and put its result into the FMU (folder extra)"
    command.add_flag("--reference", text)
    command.add_kernel()


def run(options: Options) -> None:
    """Build the FMU and say where it is."""
    from dockloop.fmu.build import build_document, build_fmu
    from dockloop.fmu.reference import add_reference

    if options.output and options.output.suffix == ".json":
        if options.reference or options.kernel:
            raise UsageError(f"-o {shown(options.output)}: --reference and --kernel need an FMU")
        build_document(options.scene, options.overrides, options.output)
        write(shown(options.output))
        return
    notes: list[str] = []  # issued when the FMU is there
    finish = add_reference if options.reference else None
    fmu = build_fmu(
        options.scene,
        options.overrides,
        options.output,
        options.kernel,
        notes.append,
        finish=finish,
    )
    write("\n".join([*notes, f"{shown(fmu)} ({fmu.stat().st_size / 1e6:.1f} MB)"]))
