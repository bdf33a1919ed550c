"""Short sweeps of dockings and how tests write and run them."""

from pathlib import Path

from dockloop.sweeps import table
from dockloop.sweeps.run import run_sweep
from dockloop.sweeps.sampling import read_sweep

UNIFORM = 'type = "uniform"\nname = "chaser.mass"\nrange = [10.0, 20.0]'
SPEED = 'type = "uniform"\nname = "initial.closing_speed"\nrange = [0.05, 0.1]'
NORMAL = 'type = "normal"\nname = "chaser.mass"\nmean = 10.0\ndeviation = 2.0\nrange = [9.0, 14.0]'

DISC = (
    'type = "disc"\nmagnitude = "initial.lateral_offset"\n'
    'direction = "initial.lateral_direction_deg"\nrange = [0.1, 0.3]'
)
OFFSETS = DISC.replace("0.1, 0.3", "0.0, 0.1")

NAMED = """type = "cases"
name = "variant"
[vary.cases."as it is"]
[vary.cases."heavy"]
"chaser.mass" = 30e3
"initial.closing_speed" = 0.05
"""

# Twelve short dockings with adaptive steps.
SHORT = f"""
scene = "idss_25t_350t"
seed = 7
cases = 12
[set]
"initial.approach_time" = 0.1
[[vary]]
{OFFSETS}
[[vary]]
{SPEED}
[[vary]]
type = "uniform"
name = "friction.coefficient"
range = [0.0, 0.3]
[experiment]
stop = 1.5
step = 0.25
"""

MANY = f"""
scene = "absorber_1d"
cases = {{cases}}
[[vary]]
type = "grid"
name = "target.mass"
values = [3e5, 3.5e5, 4e5, 4.5e5]
[[vary]]
{SPEED}
[[vary]]
type = "uniform"
name = "chaser.mass"
range = [10e3, 30e3]
[experiment]
stop = 0.01
step = 0.01
"""


def write(folder: Path, text: str, name: str = "mine") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def vary(text: str, cases: int = 1, more: str = "") -> str:
    """Return a sweep of the absorber in which one thing varies."""
    return f'scene = "absorber_1d"\ncases = {cases}\n{more}\n[[vary]]\n{text}\n'


def run_table(path: Path, output: Path, **options) -> Path:
    """Run a sweep and write its table, without the command line."""
    read = read_sweep(str(path))
    ran = run_sweep(read, output, **options)
    table.write_table(read, ran["planner"], ran["results"], None, output)
    return output
