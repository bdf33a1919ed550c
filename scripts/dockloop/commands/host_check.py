"""``dockloop host-check``: whether a host that integrates a vehicle is right."""

from dockloop.base.errors import DockloopError
from dockloop.commands.arguments import Command, Options, file_path
from dockloop.commands.console import write_found

EXAMPLE = "example: dockloop host-check host.csv idss_25t_350t --scene coupling.mode=parallel"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    text = (
        "log of reports (.csv; header: time,chaser.position[1],...; one row per communication"
        " point), or the FMU of a vehicle (.fmu)"
    )
    command.add_argument("source", type=file_path, metavar="HOST", help=text)
    command.add_scene()
    command.add_run()
    command.add_option("--vehicle", "NAME", "which vehicle an FMU is (default: chaser)")
    text = "names of columns or variables, as for 'ssp': [chaser] position = 'r[*]', ..."
    command.add_option("--map", "FILE.toml", text, type=file_path)
    command.add_flag("--json", "print the judgement as JSON")


def run(options: Options) -> None:
    """Judge the host; a mistake is a failure."""
    from dataclasses import asdict

    from dockloop.runs.host_judging import host_check, report_host
    from dockloop.sweeps.settings import parse_settings

    found = host_check(
        options.source,
        options.scene,
        parse_settings("--scene", options.overrides),
        parse_settings("--set", options.set),
        vehicle=options.vehicle,
        names=options.map,
        stop=options.stop,
        step=options.step,
    )
    checks = [check._asdict() | {"verdict": check.verdict} for check in found.checks]
    document = asdict(found) | {"checks": checks, "is_right": found.is_right}
    write_found(options, document, lambda _: report_host(found))
    if not found.is_right:
        raise DockloopError(found.sentence)
