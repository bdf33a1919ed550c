"""``--report``: one HTML page about a run, a sweep, an envelope.

1. A page is self-contained: no address of another file or server but pages with the motion next to
   it, figures inside, no script; it holds outcome, loads next to rated ones, commands, settings;
   names of files are escaped. The timeline shows the recorded phases and latches.
2. Numbers of the page are those of the summary. Inputs are ranked by what they decide.
3. A page of something else is not replaced.
"""

import base64
import html
import json
import re

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.colors import to_rgba

import dockloop as dl
from dockloop.base.number import say_number
from dockloop.base.palette import LATCH_STATES, PHASES
from dockloop.sweeps.table import has_captured

SCENE = "idss_25t_350t"
SWEEP = """
title = "<b>friction & speed</b>"
scene = "idss_25t_350t"
cases = 24
[[vary]]
type = "uniform"
name = "initial.closing_speed"
range = [0.02, 0.1]
[[vary]]
type = "uniform"
name = "initial.roll_deg"
range = [0.0, 0.001]
[experiment]
stop = 6.0
step = 0.5
"""


def read_page(path):
    """Return a page and its text without tags; checks what holds for every page."""
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert "<script" not in page
    links = re.findall(r'(?:src|href)="([^"]{0,30})', page)
    assert links
    views = [link for link in links if not link.startswith("data:image/png;base64,")]
    for view in views:
        assert (
            (path.parent / view)
            .read_text()
            .startswith("<!doctype html>\n<!-- made by dockloop view")
        )
    for figure in re.findall(r"base64,([^\"]+)", page):
        assert base64.b64decode(figure).startswith(b"\x89PNG")
    text = re.sub(r"<[^>]+>", " ", re.sub(r"<style.*?</style>", "", page, flags=re.S))
    return page, html.unescape(text), views


def test_a_run_has_a_page(dockloop, tmp_path):
    summary = dockloop.read(
        *("run", SCENE, "--set", "friction.coefficient=0.2", "--scene", "solver.method=bdf"),
        *("--stop", "5", "--step", "0.1", "--report", "--json", "-o", str(tmp_path / "own.csv")),
        "--view",
    )
    page, text, views = read_page(tmp_path / "own_report.html")
    assert views == ["own_view.html"]
    heads = r"<h2>(Motion|Loads|Components|Timeline)</h2>\n[^<]*<div class=.figure.><img"
    assert re.findall(heads, page) == ["Motion", "Loads", "Components", "Timeline"]
    for words in (
        "captured at",
        "dockloop run idss_25t_350t --scene solver.method=bdf --set friction.coefficient=0.2",
        "closing at 0.1 m/s, 0.05 m across the docking axis",
        "free, 350000 kg",
    ):
        assert words in text, words
    assert re.search(r"solver\.method\s+bdf", text)
    for name, load in summary["peak_loads"].items():
        row = rf"{name}\s+{re.escape(format(load['value'], '.4g'))}\s+{load['unit']}"
        assert re.search(row + rf"\s+{load['rated']:g}\s+{load['ratio']:.1%}", text), name


def test_a_timeline_has_the_phases_and_latches_of_the_result():
    result = dl.run(SCENE, stop=4.0, step=0.05)
    t, axes = result["time"], result.plot()["timeline"].axes
    for axis, colours, outputs in (
        (axes[0], PHASES, ["phase"]),
        (axes[1], LATCH_STATES, [f"latch[{i}].state" for i in (3, 2, 1)]),
    ):
        numbers = {to_rgba(colour): i + 1 for i, colour in enumerate(colours)}
        shown = np.zeros((len(outputs), len(t)))
        for bars in axis.collections:
            for path in bars.get_paths():
                (left, low), (right, _) = path.vertices.min(axis=0), path.vertices.max(axis=0)
                inside = (t >= left) & (t < right)
                shown[round(low + 0.4), inside] = numbers[tuple(bars.get_facecolor()[0])]
        for row, output in zip(shown, outputs, strict=True):
            assert (row[:-1] == result[output][:-1]).all(), output
    assert len(set(result["phase"])) >= 3


def test_dots_mark_the_true_peaks_of_the_summary():
    result = dl.run(SCENE, stop=6.0, step=0.05)
    drawn = {}
    for axis in result.plot()["loads"].axes:
        dots = [line for line in axis.lines if line.get_marker() == "o"]
        loads = [line for line in axis.lines if "peak" in str(line.get_label())]
        names = [line.get_label().partition(",")[0] for line in loads]
        drawn |= {n: float(dot.get_ydata()[0]) for n, dot in zip(names, dots, strict=True)}
    peaks = {name: load["value"] for name, load in result.summary["peak_loads"].items()}
    assert drawn == peaks
    assert any(peak > 1.1 * result[f"capture.{name}"].max() for name, peak in peaks.items())


def test_a_sweep_has_a_page_with_ranked_cases_and_inputs(dockloop, tmp_path):
    (tmp_path / "mine.toml").write_text(SWEEP)
    table = tmp_path / "own.parquet"
    summary = dockloop.read(
        "sweep", str(tmp_path / "mine.toml"), "--report", "--json", "-o", str(table)
    )
    page, text, views = read_page(tmp_path / "own_report.html")
    assert views == [f"own_worst{i}.html" for i in (1, 2, 3)]
    first = (tmp_path / views[0]).read_text()
    assert json.dumps(summary["worst"]["command"]).replace("<", "\\u003c") in first
    assert "&lt;b&gt;friction &amp; speed" in page
    assert re.search(rf"captured\s+{summary['captured']['fraction']:.1%} \(95 %", text)
    assert summary["worst"]["command"] in text
    worst = [float(v) for v in re.findall(r"load_ratio ([\d.e+-]+)[ ,\w]*\s+dockloop run", text)]
    assert worst[:10] == sorted(worst[:10], reverse=True)
    assert worst[0] == pytest.approx(summary["worst"]["value"], rel=1e-3)
    decides = text[text.index("What decides about capture.peak.load_ratio") :]
    assert decides.index("initial.closing_speed") < decides.index("initial.roll_deg")
    row = r"initial\.closing_speed\s+(\d\S+)\s+\S+ to \S+\s+(\S+)"
    share, rank = re.search(row, decides).groups()
    assert float(share) > 0.5
    assert float(rank) > 0.9
    assert re.search(r"A Gaussian process through 24 cases predicts \d+% of the variance", decides)
    assert re.search(r"What decides about capture\s+Too few cases", text)
    assert summary["units"]["initial.closing_speed"] == "m/s"
    assert "but varied: initial.closing_speed, initial.roll_deg" in text
    assert re.findall(r"experiment\.(stop|step)\s+(\S+)", text) == [
        ("stop", "6.0"),
        ("step", "0.5"),
    ]
    (tmp_path / "own_report.html").write_text("<html>mine</html>")
    refused = dockloop("sweep", str(tmp_path / "mine.toml"), "--report", "-o", str(table))
    assert refused.status == 2
    assert "own_report.html: is a file of something else" in refused.err


def test_an_envelope_has_a_page(dockloop, tmp_path):
    summary = dockloop.read(
        *("envelope", SCENE, "--x", "initial.lateral_offset", "0", "0.2"),
        *("--y", "initial.closing_speed", "0.01", "0.1", "--criterion", "captured"),
        *("--stop", "5", "--step", "0.5", "--tolerance", "0.125", "--coarse", "4", "--check", "2"),
        *("--report", "--json", "-o", str(tmp_path / "own")),
    )
    _, text, _ = read_page(tmp_path / "own" / "report.html")
    (criterion,) = summary["criteria"]
    assert f"{criterion['met']:.1%} +- {criterion['unsure']:.1%}" in text
    assert criterion["unmet_example"]["command"] in text
    assert f"{summary['dockings']} dockings; a grid of the same resolution has 25" in text
    assert re.search(r"experiment\.stop\s+5\.0", text)
    assert re.search(r"initial\.lateral_offset\s+0 to 0\.2 m\s+0\.025 m", text)


def test_numbers_of_loads_have_no_exponent():
    numbers = {15260.0: "15260", 9999.7: "10000", 0.5724: "0.5724", 3.2e-6: "3.2e-06"}
    assert {number: say_number(number) for number in numbers} == numbers


def test_a_docked_case_counts_as_captured():
    """A sequence releases its latches when it has docked; cases that did not run are left out."""
    table = pa.table({"outcome": ["captured", "docked", "undocked", "miss", None]})
    assert has_captured(table).tolist()[:4] == [1.0, 1.0, 1.0, 0.0]
    assert np.isnan(has_captured(table)[4])
