"""``dockloop ssp``: the docking as an SSP package."""

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.paths import shown
from dockloop.commands.arguments import Command, Options, file_path
from dockloop.commands.console import write, write_found

EXAMPLE = "example: dockloop ssp idss_25t_350t --scene experiment.step=0.002 -o docking.ssp"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "scene", metavar="SCENE", nargs="?", help="name of a shipped scene, or a .toml file"
    )
    command.add_scene_keys()
    for vehicle in ("chaser", "target"):
        text = f"FMU of the {vehicle}, in place of a rigid body"
        command.add_option(f"--{vehicle}", "FILE.fmu", text, type=file_path)
    text = "their names for the variables of the docking: [chaser] position = 'r[*]', ..."
    command.add_option("--map", "FILE.toml", text, type=file_path)
    command.add_option("--check", "FILE.ssp", "judge a package instead", type=file_path)
    command.add_output("FILE.ssp", "default: build/ssp/SCENE.ssp")
    command.add_flag("--json", "print what --check found as JSON")


def run(options: Options) -> None:
    """Build the package and say where it is; or judge one."""
    from dockloop.fmu.ssp import build_ssp
    from dockloop.fmu.ssp_check import check_ssp, report_package

    vehicles = {v: getattr(options, v) for v in ("chaser", "target") if getattr(options, v)}
    if options.check:
        if options.scene or options.overrides or vehicles or options.map or options.output:
            raise UsageError("--check judges a package that is there: leave the others away")
        found = check_ssp(options.check)
        write_found(options, found, report_package)
        if found["faults"]:
            raise DockloopError(f"{shown(options.check)}: {found['faults'][0]}")
        return
    if not options.scene:
        raise UsageError("ssp needs a SCENE, or --check FILE.ssp")
    package = build_ssp(
        options.scene, options.overrides, options.output, vehicles=vehicles, names=options.map
    )
    write(f"{shown(package)} ({package.stat().st_size / 1e6:.1f} MB)")
    for fault in check_ssp(package)["faults"]:
        raise DockloopError(f"{shown(package)}: {fault}")
