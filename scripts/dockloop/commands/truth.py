"""``dockloop truth``: a reference solution with 32 digits."""

import json

from dockloop.base import paths
from dockloop.commands.arguments import Command, Options, file_path, finite
from dockloop.commands.console import write

EXAMPLE = "example: dockloop truth absorber_1d --output relative.axial --stop 1 --step 0.1 --check"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    command.add_run()
    text = "FMU variable to write (repeatable)"
    command.add_list("--output", "outputs", "NAME", text, required=True)
    text = "of the steps inside, relative (default: 1e-18)"
    command.add_option("--tolerance", "TOL", text, type=finite, default=1e-18)
    command.add_flag("--check", "run again with 1000 times the tolerance and state the differences")
    command.add_argument(
        "-o",
        "--file",
        type=file_path,
        metavar="FILE.json",
        help="default: build/results/SCENE/SCENE_truth.json",
    )


def run(options: Options) -> None:
    """Integrate with extended precision, write the document, say what it took."""
    from dockloop.base.files import MADE_BY, claim, write_text
    from dockloop.base.progress import ProgressBar
    from dockloop.runs.solution import FILE, make_solution
    from dockloop.scene.find import find_scene

    name = find_scene(options.scene).stem
    file = options.file or paths.RESULTS / "results" / name / f"{name}_truth.json"
    claim(file, FILE)
    solution = make_solution(
        options.scene,
        options.outputs,
        overrides=options.overrides,
        settings=options.set,
        stop=options.stop,
        step=options.step,
        tolerance=options.tolerance,
        check=options.check,
        progress=ProgressBar("truth"),
    )
    document = {MADE_BY: FILE.command, **solution}
    write_text(file, FILE, json.dumps(document, indent=1) + "\n")
    work = solution["work"]
    write(
        f"{paths.shown(file)}: {len(solution['time'])} time points,"
        f" {work['steps']:.0f} steps, {work['evaluations']:.0f} evaluations"
    )
    for output, difference in solution.get("check", {}).get("difference", {}).items():
        write(f"  {output}: {difference:.2g} from the run with 1000 times the tolerance")
