"""What a picture of the live page costs, pictures a second, and the memory of its server.

Parts are processor time: other programs may run meanwhile. Pictures a second need an idle
machine. Written to tests/validation/live_page.md. Linux and Chromium are needed.

    .venv/bin/python tests/studies/live_page.py                     # some minutes
    .venv/bin/python tests/studies/live_page.py --changes 1000
"""

import json
import os
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.live.bench import COARSE, Bench, make_page
from dockloop.live.export import make_command
from dockloop.view import browser as chromium
from live_pages import Online, ask, list_own_options, serve
from page import Table, make_parser, write_page

SCENES = ("idss_25t_350t", "hexapod", "apda", "absorber_1d")
SMALL = "absorber_1d"
PICTURES = 30
NEXT = """(async () => {
  const settings = { 'initial.closing_speed': '%s' };
  const headers = { 'Content-Type': 'application/json' };
  const body = JSON.stringify({ settings, coarse: true });
  const answer = await fetch('run', { method: 'POST', headers, body });
  dockloop.load(await answer.json(), true);
})()"""
DRAG = """(async () => {
  const first = live.pictures.length, began = performance.now();
  for (let k = 0; performance.now() < began + 5000; k++) {
    live.change('initial.closing_speed', String(%g * (0.95 + 0.001 * (k %% 100))));
    await new Promise((resume) => setTimeout(resume, 16));
  }
  return live.pictures.slice(first);
})()"""
PARTS = ("core", "points", "set-up", "page", "JSON", "curves", "space")


def list_speeds(bench: Bench) -> list[str]:
    """Return closing speeds of pictures, near that of the scene [m/s]."""
    middle = float(bench.entries["initial.closing_speed"].default)
    return [f"{middle * (1.0 + 1e-3 * k):.6g}" for k in range(-3, PICTURES)]


def time_server(scene: str) -> Counter[str]:
    """Return the processor time of a picture in the server [ms]; three more warm up."""
    bench, spent = Bench(scene), Counter()
    for k, speed in enumerate(list_speeds(bench)):
        settings = {"initial.closing_speed": speed}
        marks = [time.process_time()]
        result = bench.compute(settings, is_coarse=True)
        marks.append(time.process_time())
        page = make_page(result, make_command(bench, settings))
        marks.append(time.process_time())
        json.dumps(page, allow_nan=False).encode()
        marks.append(time.process_time())
        ends, points = (time_core(scene, speed, t) for t in (result.time[[0, -1]], result.time))
        run, made, sent = np.diff(marks)
        parts = (ends, points - ends, run - points, made, sent)
        if k >= 3:
            spent.update(dict(zip(PARTS, (1e3 * part / PICTURES for part in parts), strict=False)))
    return spent


def time_core(scene: str, speed: str, times: np.ndarray) -> float:
    """Return the processor time of the steps of a docking and of the outputs at `times` [s]."""
    docking = dl.Docking(scene, {"initial.closing_speed": float(speed)})
    docking.set("accuracy", COARSE)
    began = time.process_time()
    docking.record(times)
    return time.process_time() - began


def read_processes(root: int) -> Counter[str]:
    """Return the processor time [s] of a browser by kind of process."""
    spent: Counter[str] = Counter()
    seen = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            numbers = (folder / "stat").read_text().rpartition(")")[2].split()
            words = (folder / "cmdline").read_text()
        except OSError:  # it has just ended
            continue
        kind = words.partition("--type=")[2].partition("\0")[0].partition(" ")[0]
        seen[int(folder.name)] = int(numbers[1]), kind, int(numbers[11]) + int(numbers[12])
    for process, (_, kind, ticks) in seen.items():
        above = process
        while above in seen and above != root:
            above = seen[above][0]
        if above == root:
            spent[kind] += ticks / os.sysconf("SC_CLK_TCK")
    return spent


def time_browser(scene: str) -> Counter[str]:
    """Return the processor time of a picture in a window of 1280 by 800 [ms]."""
    chromium._OPTIONS = list_own_options()
    with serve(scene) as server, Online(1280, 800) as window:
        window.open(server.url)
        window.settle()
        window.run("dockloop.load(dockloop.data)")  # it is timed
        for k, speed in enumerate(list_speeds(server.bench)):
            if k == 3:
                before = read_processes(window._process.pid)
            window.run(NEXT % speed)
            window.settle()
        spent = read_processes(window._process.pid) - before
    parts = {"space": spent.pop("gpu-process"), "curves": sum(spent.values())}
    return Counter({name: 1e3 * part / PICTURES for name, part in parts.items()})


def drag_slider(scene: str) -> list[float]:
    """Return the waits from slider to picture [ms] while it moves for 5 s, 60 times a second."""
    chromium._OPTIONS = list_own_options()
    with serve(scene) as server, Online(1280, 800) as window:
        window.open(server.url)
        window.settle()
        speed = float(server.bench.entries["initial.closing_speed"].default)
        window.run(DRAG % speed)  # warms up: a program that draws slowly is known after it
        time.sleep(2.0)  # refined meanwhile
        return window.run(DRAG % speed)


def read_memory() -> float:
    """Return what this process holds in memory [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def watch_memory(changes: int) -> Table:
    """Return the memory of a server with one light scene over many changes."""
    table = Table("changes", "memory [MB]", "processor [s]")
    began, wanted = time.process_time(), {100, 1000, changes // 2, changes}
    with serve(SMALL) as server:
        for k in range(1, changes + 1):
            settings = {"initial.closing_speed": f"{0.05 + 1e-5 * k:.5f}"}
            settings |= {"chaser.mass": str(1000 + k % 500)}
            status, *_ = ask(server, body={"settings": settings, "coarse": True})
            assert status == 200
            if k in wanted:
                table.add(k, f"{read_memory():.1f}", f"{time.process_time() - began:.0f}")
    return table


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, ROOT / "tests" / "validation" / "live_page.md")
    parser.add_argument("--changes", type=int, default=10_000, metavar="N")
    options = parser.parse_args()
    memory = watch_memory(options.changes)
    table = Table("scene", *PARTS, "in all")
    drags = Table("scene", "pictures a second", "wait from slider to picture, median, longest [ms]")
    for scene in SCENES:
        spent, waits = time_server(scene) + time_browser(scene), drag_slider(scene)
        table.add(f"`{scene}`", *(f"{spent[p]:.1f}" for p in PARTS), f"{spent.total():.0f}")
        seen = f"{np.median(waits):.0f}, {max(waits):.0f}"
        drags.add(f"`{scene}`", f"{len(waits) / 5.0:.1f}", seen)
    write_page(
        options.output,
        "The live page: cost of a picture, pictures a second, and memory",
        " ".join(["tests/studies/live_page.py", *sys.argv[1:]]),
        "## A picture while a slider moves",
        f"Processor time [ms], mean of {PICTURES} pictures at `accuracy` {COARSE:g}. `core`: steps"
        " of the docking. `points`: its outputs at some 400 points. `set-up`: scene, start values."
        " `page`: poses, figures, events. `curves`: script, layout and curves in Chromium, its"
        " other processes too. `space`: drawing in three dimensions by software, which graphics"
        " hardware does otherwise. The server computes the next picture while one is drawn.",
        table,
        "## Pictures a second while a slider moves",
        f"The slider moves for 5 s; {os.cpu_count()} cores, which server and Chromium share.",
        drags,
        "## Memory of the server",
        f"Dockings of `{SMALL}`, one process for the server and its client.",
        memory,
    )


if __name__ == "__main__":
    main()
