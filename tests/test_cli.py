"""The command line from outside: help, examples, exit status, one-sentence errors."""

import argparse
import json
import math
import operator
import re
import shlex
import shutil
import subprocess
import sys
import time
import webbrowser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from conftest import SCENES
from dockloop import commands
from dockloop.base import paths
from dockloop.commands import arguments
from dockloop.live.server import LiveServer
from programs import run


def assert_refused(outcome, *words):
    """One sentence on standard error that holds `words`, exit status 2, no traceback."""
    assert outcome.status == 2, outcome
    assert outcome.err.count("\n") == 1, outcome.err
    assert "Traceback" not in outcome.err
    for word in words:
        assert word in outcome.err


@pytest.mark.parametrize("command", commands.COMMANDS)
def test_the_example_of_every_help_text_runs(dockloop, command, monkeypatch):
    text = dockloop.succeed(command, "--help")
    example = text.out.partition("example: dockloop ")[2]
    if command == "view":  # of the result of the run that the README begins with
        assert dockloop("run", "idss_25t_350t", "--stop", "3", "--no-plots").status == 0
    if command == "compare":  # data as the example says
        assert dockloop("run", "absorber_1d", "--no-plots").status == 0
        header = "time [s],relative.axial [mm],capture.compression [N]\n"
        Path("rig.csv").write_text(f"{header}0,0,1296\n0.5,-42,1700\n1.4,-72,1440\n")
    if command == "live":  # until the user ends it
        monkeypatch.setattr(LiveServer, "serve_forever", lambda _: None)
        monkeypatch.setattr(webbrowser, "open", lambda _: True)
    if command == "fit":  # the rig has other hardware
        more = ["--scene", "mechanism.set.contact.damping=9000", "--outputs=relative.axial"]
        dockloop.succeed("run", "absorber_1d", "--no-plots", "-o", "rig.csv", *more)
    if command == "import":  # a file of the user
        shutil.copy(paths.ROOT / "scripts" / "examples" / "stewart.sdf", "stewart.sdf")
    if (
        command == "host-check"
    ):  # the motion of a free vehicle until contact is that of a right host
        chosen = ["--outputs=chaser.position", "--outputs=chaser.velocity", "--outputs=chaser.at*"]
        chosen += ["--outputs=chaser.angular_velocity", "-o", "host.csv"]
        assert dockloop("run", "idss_25t_350t", "--stop", "1", "--no-plots", *chosen).status == 0
    outcome = dockloop.succeed(*shlex.split(example))
    assert outcome.out


def test_help_is_quick_and_needs_no_heavy_package():
    began = time.perf_counter()
    done = run(sys.executable, "-X", "importtime", "-m", "dockloop", "--help")
    assert done.returncode == 0
    assert time.perf_counter() - began < 5.0
    for package in ("fmpy", "matplotlib", "numpy", "jsonschema", "distributed", "pyarrow"):
        assert f" {package}\n" not in done.stderr


def test_every_command_has_a_module_that_needs_no_heavy_package():
    files = (paths.ROOT / "scripts" / "dockloop" / "commands").glob("*.py")
    shared = {"__init__", "arguments", "console"}
    modules = {name.replace("-", "_") for name in commands.COMMANDS}
    assert {file.stem for file in files} == {*modules, *shared}
    program = (
        "import sys\n"
        "from dockloop.commands import COMMANDS, load_command\n"
        "for name in COMMANDS:\n"
        "    load_command(name)\n"
        "assert not {'fmpy', 'matplotlib', 'numpy', 'jsonschema', 'pyarrow'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("text", ["inf", "nan", "1e400", "", "1,5"])
def test_every_option_that_takes_a_number_refuses_what_is_none(text):
    parsers = {}
    for name in commands.COMMANDS:
        command = arguments.Command()
        commands.load_command(name).add_options(command)
        parsers |= {(name, action.dest): action.type for action in command._actions}
    texts = (None, arguments.filled, arguments.file_path)
    numbers = {place: parse for place, parse in parsers.items() if parse not in texts}
    assert {("run", "stop"), ("run", "max_gigabytes"), ("map", "limit")} < set(numbers)
    for parse in numbers.values():
        with pytest.raises(argparse.ArgumentTypeError, match=r"must be a (finite|whole) number"):
            parse(text)


def test_numbers_below_0_are_values_of_options():
    command = arguments.Command()
    command.add_option("--shift", "T", "", type=arguments.finite)
    command.add_range("x")
    options = command.parse_args(["--shift", "-1e-3", "--x", "speed", "-2E3", "-.5"])
    assert (options.shift, options.x) == (-1e-3, ["speed", "-2E3", "-.5"])


def test_every_option_with_a_value_refuses_an_empty_one():
    for name in commands.COMMANDS:
        command = arguments.Command()
        commands.load_command(name).add_options(command)
        for action in command._actions:
            if action.option_strings and action.nargs != 0 and not action.choices:
                with pytest.raises(argparse.ArgumentTypeError, match=r"is empty: must (be|have) a"):
                    action.type("")


def test_bad_usage_is_refused(dockloop):
    assert_refused(dockloop(), "COMMAND")
    assert_refused(dockloop("sail"), "sail")
    assert_refused(dockloop("run", "idss_25t_350t", "--stop", "soon"), "--stop")
    assert_refused(
        dockloop("run", "idss_25t_350t", "--stop", "1e400"),
        "--stop: is 1e400: must be a finite number",
    )
    assert_refused(dockloop("run", "idss_25t_350t", "--step", "-inf"), "--step: is -inf")
    assert_refused(
        dockloop("run", "idss_25t_350t", "--outputs", ""), "--outputs: is empty: must have a value"
    )
    assert_refused(dockloop("view", ""), "RESULT: is empty")
    assert_refused(dockloop("compare", "", ""), "RESULT: is empty")
    assert_refused(dockloop("sweep", "absorber_1d_speeds", "--rare", " "), "--rare: is empty")
    assert_refused(dockloop("run", "idss_25t_350t", "-o", "result.txt"), "result.txt", ".csv")
    assert_refused(dockloop("run", "no.fmu"), "no.fmu")
    assert_refused(dockloop("check", "apda", "--draw", "own.gif"), "--draw own.gif", ".svg")
    assert_refused(dockloop("check", "apda", "--draw", "/proc/own.svg"), "choose another --draw")
    assert_refused(dockloop("run", "no.fmu", "--scene", "chaser.mass=1"), "--set")


def test_unknown_names_are_refused_with_near_matches(dockloop):
    assert_refused(dockloop("build", "idss_25t"), "'idss_25t_350t'")
    assert_refused(dockloop("check", "idss_hexpod"), "'idss_hexapod'")
    assert_refused(dockloop("check", "idss_25t_350t"), "it is the name of a scene")
    assert_refused(dockloop("sweep", "idss_25t_350t"), "it is the name of a scene")
    assert_refused(dockloop("run", "idss_hexapod"), "it is the name of a mechanism")
    assert_refused(dockloop("run", paths.MECHANISMS / "apda.json"), "apda.json", ".toml")
    assert_refused(dockloop("sweep", paths.MECHANISMS / "apda.json"), "apda.json", ".toml")
    assert_refused(dockloop("build", SCENES[0], "--scene", "mechanism.name=nope"), "nope.json")
    assert_refused(dockloop("build", SCENES[0], "--scene", "chaser.mas=1"), "'chaser.mass'")


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        ("ring", ["initial.joints.ring", "free joint", "initial.capture_body"]),
        ("leg1_rod", ["initial.joints.leg1_rod", "a loop determines"]),
        ("leg9", ["initial.joints.leg9", "no body of that name"]),
    ],
)
def test_a_start_of_a_joint_that_cannot_have_one_is_refused_by_build(dockloop, joint, words):
    outcome = dockloop("build", "hexapod_bench", "--scene", f"initial.joints.{joint}.rate=1")
    assert_refused(
        outcome, f"--scene initial.joints.{joint}.rate=1: ", *words, "no joint of this mechanism"
    )


def test_a_start_of_a_joint_that_a_coupling_determines_is_refused_with_its_name(dockloop):
    outcome = dockloop("build", "apda", "--scene", "initial.joints.rod1_nut.rate=1")
    assert_refused(outcome, "initial.joints.rod1_nut: the coupling 'screw1' determines this joint")


def test_a_file_that_is_no_fmu_is_refused(dockloop, tmp_path):
    (tmp_path / "text.fmu").write_text("not a zip file")
    assert_refused(dockloop("run", "text.fmu"), "text.fmu", "not a zip file")


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ("friction.coeficient=0.2", "'friction.coefficient'"),
        ("friction.coefficient=a", "finite number"),
        ("friction.coefficient=nan", "finite number"),
        ("friction.model=1.5", "whole number"),
        ("friction.model", "NAME=VALUE"),
        ("relative.axial=1", "computed"),
        ("chaser.mass=-1", "mass"),
        ("friction.model=7", "friction"),
    ],
)
def test_a_bad_start_value_is_refused(dockloop, runs, setting, word):
    fmu = runs.fmu("idss_25t_350t")
    assert_refused(dockloop("run", fmu, "--set", setting), word)


def spoil(change):
    """Return the default mechanism with one change."""
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    change(mechanism)
    return mechanism


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m["bodies"].clear(), ["ring"]),
        (lambda m: m["bodies"][0].update(mass=-40.0), ["bodies[1].mass", "-40"]),
        (lambda m: m["bodies"][0].update(parent="hull"), ["hull"]),
        (lambda m: m["legs"][2].update(closing="rng"), ["rng"]),
        (lambda m: m["legs"][2].update(root_point=[0, 0]), ["legs[3].root_point"]),
        (
            lambda m: m["legs"][2].update(
                closing_point=list(map(operator.sub, m["legs"][2]["root_point"], find_home(m)))
            ),
            ["leg3", "length"],
        ),
        (lambda m: m["capture"].update(body="rign"), ["rign"]),
        (lambda m: m.update(lags=[]), ["lags", "'legs'"]),
    ],
)
def test_a_bad_mechanism_is_refused_by_check_and_by_build(dockloop, tmp_path, change, words):
    mechanism = spoil(change)
    (tmp_path / "bad.json").write_text(json.dumps(mechanism))
    scene = (paths.SCENES / "idss_25t_350t.toml").read_text().replace('"idss_hexapod"', '"bad"')
    (tmp_path / "own.toml").write_text(scene)
    assert_refused(dockloop("check", "bad.json"), *words)
    assert_refused(dockloop("build", "own.toml"), *words)


def test_a_loop_that_cannot_close_is_refused(dockloop, tmp_path):
    mechanism = {
        "name": "open",
        "bodies": [
            {
                "name": name,
                "parent": parent,
                "joint": {"type": "revolute", "axis": [0, 0, 1], "position": [x, 0, 0]},
                "mass": 1.0,
                "com": [0, 0, 0],
                "inertia": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            }
            for name, parent, x in (
                ("crank", "base", 0),
                ("rocker", "base", 9),  # too far away for links of 1 m
                ("rod", "rocker", 1),
            )
        ],
        "loops": [
            {
                "name": "fourbar",
                "root": "base",
                "first": "rocker",
                "terminal": "rod",
                "closing": "crank",
                "cut": {
                    "type": "R1_planar",
                    "point_on_terminal": [1, 0, 0],
                    "point_on_closing": [1, 0, 0],
                    "plane_axes_in_root": [[1, 0, 0], [0, 1, 0]],
                },
                "dependent": ["rocker", "rod"],
            }
        ],
    }
    (tmp_path / "open.json").write_text(json.dumps(mechanism))
    assert_refused(dockloop("check", "open.json"), "open.json", "fourbar")


@pytest.mark.parametrize("mechanism", ["idss_hexapod", "hexapod_bench"])
def test_check_reports_a_sound_mechanism_in_words_and_as_json(dockloop, mechanism):
    text = dockloop.succeed("check", mechanism)
    assert "leg6" in text.out
    report = dockloop.read("check", mechanism, "--json")
    assert report["name"] == mechanism
    assert len(report["loops"]) == 6
    assert all(abs(loop["gap"]) < 1e-12 for loop in report["loops"])


def test_screws_are_couplings_and_no_closed_loops(dockloop):
    words = dockloop("check", "hexapod").out
    loops, couplings = re.search(
        r"\nclosed loops\n(.*)\ncouplings\n(.*?)\n\S", words, re.S
    ).groups()
    assert (len(loops.splitlines()), len(couplings.splitlines())) == (7, 7)  # with their heads
    assert "screw" not in loops


@pytest.mark.parametrize("mechanism", [file.stem for file in sorted(paths.MECHANISMS.glob("*"))])
def test_tables_of_check_fit_a_page_and_lose_nothing(dockloop, mechanism):
    text = dockloop("check", mechanism).out
    report = dockloop.read("check", mechanism, "--json")
    assert max(map(len, text.splitlines())) <= 100
    assert re.search(r"^ *quantity +unit +value$", text, re.MULTILINE)
    assert re.search(rf"mass +kg +{report['mass']:.4g}\n", text)
    words = " ".join(text.split())
    for loop in report["loops"]:
        assert f"{loop['name']} {loop.get('block', '')}" in words
    for row in report["effects"]:
        rates = [part["rate"] for part in row["elements"] + row["legs"] or row["joints"]]
        assert all(f"{rate:.4g}" in words for rate in rates)


def check(dockloop, folder, mechanism):
    """Return the report on a mechanism, in words and as JSON."""
    (folder / "own.json").write_text(json.dumps(mechanism))
    words, report = dockloop("check", "own.json"), dockloop("check", "own.json", "--json")
    assert words.status == 0, words.err
    return words.out, json.loads(report.out)


def loosen(mechanism):
    """Give the default mechanism petals that leave more seated play than its latches reach."""
    mechanism["contact"].update(petal_base_radius=0.585, petal_base_half_angle_deg=28)


def test_check_warns_where_seated_strikers_stand_next_to_the_window_of_the_latches(
    dockloop, tmp_path
):
    text, report = check(dockloop, tmp_path, spoil(loosen))
    play = report["seated_play"]
    assert play["roll_deg"] == pytest.approx([-2.4935, 2.4935], abs=1e-3)
    assert play["lateral_mm"] == pytest.approx([20.01, 23.54], abs=0.01)
    assert play["striker_offset_mm"] == pytest.approx(39.01, abs=0.02)
    (warning,) = report["warnings"]
    for part in ("seated", "39.01 mm", "latches.window is 25 mm", "less play"):
        assert part in warning
    assert f"warning: {warning}" in " ".join(text.split())
    assert re.search(r"seated play, roll +deg +-2.493 to 2.493\n", text)
    assert re.search(r"seated play, lateral +mm +20.01 to 23.54 by direction\n", text)


def test_check_warns_where_seated_strikers_stand_before_their_hooks(dockloop, tmp_path):
    def lower(mechanism):
        mechanism["contact"]["core_x"] = -0.006

    _, report = check(dockloop, tmp_path, spoil(lower))
    (warning,) = report["warnings"]
    for part in ("seated", "8 mm before its hook", "latches.catch is 4 mm"):
        assert part in warning


@pytest.mark.parametrize("degrees", [60, 120])
def test_check_warns_of_a_ring_whose_petals_meet_petals(dockloop, tmp_path, degrees):
    """The ring is turned on its joint, its leg ends are turned back: legs are as they were."""

    def turn(mechanism):
        angle = math.radians(degrees)
        c, s = math.cos(angle), math.sin(angle)
        mechanism["bodies"][0]["joint"]["rotation"] = [[1, 0, 0], [0, c, -s], [0, s, c]]
        for leg in mechanism["legs"]:
            x, y, z = leg["closing_point"]
            leg["closing_point"] = [x, c * y + s * z, c * z - s * y]

    _, report = check(dockloop, tmp_path, spoil(turn))
    (warning,) = report["warnings"]
    assert warning.startswith(f"at home the ring is turned by {degrees} deg about x")


def test_check_says_seated_play_of_the_default_and_finds_nothing_wrong(dockloop, tmp_path):
    text, report = check(dockloop, tmp_path, spoil(lambda m: None))
    assert report["seated_play"]["striker_offset_mm"] < report["seated_play"]["latch_window_mm"]
    assert report["warnings"] == []
    assert "seated play" in text


@pytest.mark.parametrize("without", ["contact", "latches"])
def test_check_says_nothing_of_seated_play_without_rings_or_latches(dockloop, tmp_path, without):
    text, report = check(dockloop, tmp_path, spoil(lambda m: m.pop(without)))
    assert "seated" not in text
    assert "seated_play" not in report


def test_check_warns_of_rings_that_cannot_seat(dockloop, tmp_path):
    wide = spoil(lambda m: m["contact"].update(petal_base_half_angle_deg=32))
    _, report = check(dockloop, tmp_path, wide)
    assert "the rings cannot seat" in report["warnings"][0]


def test_check_lists_every_eigenvalue_of_the_default(dockloop, tmp_path):
    """Twelve, whether rounding splits a double one into a pair or not."""
    text, report = check(dockloop, tmp_path, spoil(lambda m: None))
    count = sum(2 if mode["motion"] == "oscillates" else 1 for mode in report["modes"])
    assert count == 12
    assert all("damping_ratio" not in m for m in report["modes"] if m["motion"] != "oscillates")
    assert "dies out without oscillation" in text


def slide(name, **members):
    """Return a body of 2 kg on a slide."""
    joint = {"type": "prismatic", "axis": [1, 0, 0]}
    return {"name": name, "parent": "base", "joint": joint, "mass": 2, **members}


def test_check_says_that_a_motion_is_unstable_and_how_fast_it_grows(dockloop, tmp_path):
    rod = {"name": "rod", "parent": "base", "mass": 3, "com": [0, 0, 0.4]}
    rod["joint"] = {"type": "revolute", "axis": [1, 0, 0]}
    pendulum = {"name": "own", "gravity": [0, 0, -10], "bodies": [rod]}
    text, report = check(dockloop, tmp_path, pendulum)
    assert {m["motion"] for m in report["modes"]} == {
        "dies out without oscillation",
        "unstable, grows with 5 1/s",
    }
    assert "-1" not in text.partition("vibration")[2]


def test_check_has_one_line_for_free_motions(dockloop, tmp_path):
    text, report = check(dockloop, tmp_path, {"name": "own", "bodies": [slide("a"), slide("b")]})
    assert [mode["frequency_rad_s"] for mode in report["modes"]] == [0.0] * 4
    (row,) = re.findall(r"free, no force opposes it (.*)", " ".join(text.split()))
    assert row == "(4 eigenvalues; a motion that nothing brakes has 2)"


def test_check_gives_no_range_to_what_only_a_coupling_follows(dockloop, tmp_path):
    """Nothing can end it: there was a row "-0 ... 0" of a search as long as no loop."""
    screw = {"name": "screw", "dependent": "nut", "terms": [{"joint": "slide", "ratio": 3}]}
    nut = {"name": "nut", "parent": "slide", "joint": {"type": "revolute", "axis": [1, 0, 0]}}
    mechanism = {"name": "own", "bodies": [slide("slide"), nut], "couplings": [screw]}
    mechanism["bodies"][1]["inertia"] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    text, report = check(dockloop, tmp_path, mechanism)
    assert report["ranges"] == []
    assert "-0" not in text


def test_check_states_the_end_stops_of_a_coordinate_that_moves_no_loop(dockloop, tmp_path):
    stop = {"type": "stop", "lower": -0.1, "upper": 0.2, "stiffness": 1e5, "toe": 1e-3}
    element = {"name": "one", "along": [{"joint": "slide"}], "laws": [stop]}
    _, report = check(
        dockloop, tmp_path, {"name": "own", "bodies": [slide("slide")], "forces": [element]}
    )
    (row,) = report["ranges"]
    ends = [row[f"{side}_stop"]["at"] for side in ("lower", "upper")]
    assert ends == pytest.approx([-0.1, 0.2], abs=1e-9)


def test_check_lets_engaged_bristle_brakes_stick(dockloop, tmp_path):
    """Stuck: a spring of level over presliding; sliding would show the weak spring alone."""
    laws = [
        {"type": "spring", "stages": [[0, 4000]]},
        {"type": "brake", "forward": 400, "presliding": 1e-4},
    ]
    along = [{"joint": "slide"}]
    elements = [
        {"name": "one", "along": along, "laws": laws},
        {"name": "other", "along": along, "laws": [{"type": "spring", "stages": [[0, 1000]]}]},
    ]
    mechanism = {"name": "own", "bodies": [slide("slide")], "forces": elements}
    _, report = check(dockloop, tmp_path, mechanism)
    (mode,) = report["modes"]
    assert mode["frequency_rad_s"] == pytest.approx(math.sqrt((400 / 1e-4 + 5000) / 2), rel=1e-6)


def test_a_coordinate_that_moves_no_mass_names_its_body(dockloop, tmp_path):
    bodies = [slide("light") | {"mass": 0}]
    (tmp_path / "own.json").write_text(json.dumps({"name": "own", "bodies": bodies}))
    outcome = dockloop("check", "own.json")
    assert outcome.status == 2
    assert "nothing that moves with 'light' has one" in outcome.err
    assert outcome.err.count("\n") == 1


def find_home(mechanism):
    """Return where the ring stands in the base at home; both have the same axes there."""
    return mechanism["bodies"][0]["joint"]["position"]


def test_check_says_where_end_stops_begin_and_what_ends_a_coordinate(dockloop, tmp_path):
    text, report = check(dockloop, tmp_path, spoil(lambda m: None))
    (row,) = (row for row in report["ranges"] if row["coordinate"] == "ring.x")
    mechanism = spoil(lambda m: None)
    stops, leg = mechanism["leg_defaults"]["stops"], mechanism["legs"][0]
    ends = zip(find_home(mechanism), leg["closing_point"], leg["root_point"], strict=True)
    along, *across = (home + closing - root for home, closing, root in ends)
    for side, length, sign in (("lower", "min_length", -1), ("upper", "max_length", 1)):
        # Along x all legs change alike, until they are as short or as long as their stops.
        begins = math.sqrt(stops[length] ** 2 - across[0] ** 2 - across[1] ** 2) - along
        assert row[f"{side}_stop"]["at"] == pytest.approx(begins, abs=1e-9)
        assert row[f"{side}_stop"]["joint"].startswith("leg")
        assert row[f"{side}_end"] == "no loop ends it"
        assert sign * row[side] > sign * begins
        assert re.search(rf"ring.x +{side} +{begins:.4g} +m +stop of leg", text)
    assert "begins; no loop ends it up to" in " ".join(text.split())


def test_check_says_what_each_coordinate_moves(dockloop):
    """A differential: an axial push moves the drive alone, a lateral one all but the drive."""
    report = dockloop.read("check", "apda", "--json")
    effects = {row["coordinate"]: row for row in report["effects"]}
    axial, lateral = (
        {part["name"]: part["rate"] for part in effects[name]["elements"]}
        for name in ("ring.x", "ring.z")
    )
    ring = effects["ring.x"]["joints"]
    rods = {part["name"]: part["rate"] for part in ring if part["name"].endswith("_rod")}
    assert len(rods) == 6
    assert axial == {"drive": pytest.approx(rods["rod1_rod"], rel=1e-12)}
    assert max(abs(rate) for rate in lateral.values()) == pytest.approx(0.419, abs=5e-4)
    assert "drive" not in lateral
    text = dockloop("check", "apda").out
    assert "1 m of ring.x     drive 0.8913" in text
    assert "difference2 and difference3 0.2096" in text


def test_check_counts_no_rate_of_a_drive_as_an_effect(dockloop, tmp_path):
    nut = {"name": "nut", "parent": "base", "joint": {"type": "revolute", "axis": [1, 0, 0]}}
    nut["inertia"] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    screw = {"name": "screw", "dependent": "nut", "terms": [{"joint": "slide", "ratio": 3}]}
    mechanism = {
        "name": "own",
        "bodies": [slide("slide"), nut],
        "couplings": [{**screw, "rate": 5}],
    }
    text, report = check(dockloop, tmp_path, mechanism)
    assert report["effects"][0]["joints"] == [{"name": "nut", "rate": 3.0}]
    assert "1 m of slide  nut 3" in text


@pytest.mark.parametrize(
    ("mechanism", "words"),
    [
        ("apda", ["pair1_sum - 1 drive", "cut R3 at ring (loop rod6)", "element tilt1: spring"]),
        ("probe_drogue", ["independent; turns about", "element probe: "]),
        ("idss_hexapod", ["independent; free", "leg6"]),
        ("absorber_1d", ["bodies"]),
    ],
)
def test_check_draws_a_mechanism(dockloop, tmp_path, mechanism, words):
    dockloop.succeed("check", mechanism, "--draw", "own.svg")
    sheet = (tmp_path / "own.svg").read_text()
    texts = [text for text in ElementTree.fromstring(sheet).itertext() if text.strip()]
    for word in words:
        assert any(word in text for text in texts)
    names = [body["name"] for body in read_shipped(mechanism).get("bodies", [])]
    assert all(texts.count(name) == 1 for name in names if name != mechanism)
    assert dockloop("check", mechanism, "--draw", "own.svg").status == 0  # its own, once more


def test_check_draws_the_hulls_of_a_scene(dockloop, tmp_path):
    scene = (paths.SCENES / "idss_25t_350t.toml").read_text()
    hull = "\n[chaser.hull]\nfrom = [-3.0, 0, 0]\nto = [1.5, 0, 0]\nradius = 2.2\n"
    (tmp_path / "own.toml").write_text(scene + hull)
    dockloop.succeed("check", "own.toml", "--draw", "own.svg")
    sheet = (tmp_path / "own.svg").read_text()
    assert "hull of the chaser" in sheet
    assert "hull of the target" not in sheet
    assert "leg6" in sheet
    assert_refused(dockloop("check", "own.toml", "--states", "own.toml"), "--states", "a mechanism")


def read_shipped(name):
    return json.loads((paths.MECHANISMS / f"{name}.json").read_text())


def test_check_draws_over_no_file_of_another_kind(dockloop, tmp_path):
    (tmp_path / "own.svg").write_text("<svg/>")
    refused = dockloop("check", "apda", "--draw", "own.svg")
    assert refused.status != 0
    assert "own.svg" in refused.err
    assert (tmp_path / "own.svg").read_text() == "<svg/>"


def make_rotor(name, *moments):
    inertia = [[m if i == j else 0 for j in range(3)] for i, m in enumerate(moments)]
    return slide(name, inertia=inertia)


def test_check_warns_of_moments_of_inertia_that_no_body_has(dockloop, tmp_path):
    bodies = [
        make_rotor("sound", 1, 2, 3),  # a plate: on the edge of what there is
        make_rotor("rounded", 1, 2, 3 + 2e-9),
        make_rotor("slip", 1e6, 1e3, 132e3),
        make_rotor("wheel1", 0, 0, 2e-3),
        make_rotor("wheel2", 0, 2e-3, 0),
        make_rotor("off", 1, 2, 3 + 2e-8),
        make_rotor("none", 0, 0, 0),
    ]
    text, report = check(dockloop, tmp_path, {"name": "own", "bodies": bodies})
    warnings = report["warnings"]
    assert len(warnings) == 3
    for names, moments in (
        ("'slip'", "1000, 1.32e+05, 1e+06 kg m2"),
        ("'wheel1', 'wheel2'", "0, 0, 0.002 kg m2"),
        ("'off'", "1, 2, 3 kg m2"),
    ):
        (warning,) = (w for w in warnings if f"inertia of {names}:" in w)
        assert moments in warning
        assert f"warning: {warning}" in " ".join(text.split())


def test_a_sweep_is_no_scene_and_a_scene_no_sweep(dockloop):
    sweep, scene = paths.SWEEPS / "absorber_1d_speeds.toml", paths.SCENES / "absorber_1d.toml"
    assert_refused(dockloop("run", sweep), "absorber_1d_speeds.toml", "'dockloop sweep' runs it")
    assert_refused(dockloop("sweep", scene), "absorber_1d.toml", "'dockloop run' runs it")


def test_the_first_mechanism_of_the_page_can_be_checked(dockloop, tmp_path):
    page = (paths.MODELS / "README.md").read_text(encoding="utf-8")
    (tmp_path / "lever.json").write_text(page.partition("```json\n")[2].partition("```")[0])
    outcome = dockloop.succeed("check", "lever.json")
    for words in ("bodies +3", "degrees of freedom +1", "independent +lever", "oscillates"):
        assert re.search(words, outcome.out), words


def test_check_evaluates_given_states(dockloop, tmp_path):
    report = dockloop.read("check", "hexapod_bench", "--json")
    state = {"q": report["home_q"], "v_independent": [0.0] * 6, "tau": [0.0] * 24}
    (tmp_path / "states.json").write_text(json.dumps({"states": [state]}))
    (result,) = dockloop.read("check", "hexapod_bench", "--states", "states.json")
    for name in ("v", "a", "loop_force", "base_force", "base_moment", "reduced_inertia"):
        assert name in result
    (tmp_path / "states.json").write_text('{"states": [{"q": [], "q": []}]}')
    outcome = dockloop("check", "hexapod_bench", "--states", "states.json")
    assert outcome.status == 2
    assert "states.json: is not JSON (the member states[1].q is there twice)" in outcome.err


def test_run_writes_summary_result_and_plots_next_to_the_result(dockloop, runs, tmp_path):
    fmu = runs.fmu("idss_25t_350t")
    result = tmp_path / "out" / "first.csv"
    summary = dockloop.read("run", fmu, "--stop", "3", "--step", "0.1", "-o", result, "--json")
    assert summary["communication_steps"] == 30
    assert summary == json.loads((tmp_path / "out" / "first_summary.json").read_text())
    for name in summary["files"]:
        assert (tmp_path / name).stat().st_size > 100
    assert {f"out/first_{n}.png" for n in ("motion", "ring", "loads", "legs", "energy")} <= set(
        summary["files"]
    )
    header, *rows = result.read_text().splitlines()
    assert header.startswith("time,chaser.position[1],")
    assert len(rows) == 31


def test_run_writes_full_precision_to_npz(dockloop, runs, tmp_path):
    import numpy as np

    fmu = runs.fmu("idss_25t_350t")
    outcome = dockloop.succeed("run", fmu, "--stop", "0.1", "-o", "a.npz", "--no-plots")
    assert "not captured" in outcome.out or "no contact" in outcome.out
    with np.load(tmp_path / "a.npz") as data:
        assert data["values"].shape == (11, len(data["names"]))


def test_a_scene_key_given_as_a_variable_is_refused_with_the_remedy(dockloop, runs):
    fmu = runs.fmu("absorber_1d")
    outcome = dockloop("run", fmu, "--set", "chaser.motion=driven")
    assert outcome.status == 2
    assert "build with --scene chaser.motion=driven" in outcome.err


def test_conditions_at_first_contact_that_no_approach_leads_to_are_refused(dockloop):
    """The surfaces would part there: half a second before, they would be in each other."""
    conditions = {
        "approach_time": 0.5,
        "closing_speed": 0.05091,
        "lateral_offset": 0.08533,
        "lateral_direction_deg": 166.117,
        "lateral_speed": 0.03512,
        "lateral_speed_direction_deg": 358.687,
        "pitch_yaw_deg": 3.4194,
        "pitch_yaw_direction_deg": 53.836,
        "pitch_yaw_rate_deg_s": 0.11489,
        "pitch_yaw_rate_direction_deg": 296.286,
        "roll_deg": -2.5763,
        "roll_rate_deg_s": 0.14496,
    }
    keys = [f"--scene=initial.{name}={value}" for name, value in conditions.items()]
    refused = dockloop("build", "idss_25t_350t", *keys)
    assert refused.status == 2, refused
    assert "no free motion of 0.5 s leads to these conditions" in refused.err
    assert "initial.approach_time" in refused.err
    status, _, err = dockloop("build", "idss_25t_350t", *keys, "--scene=initial.approach_time=0")
    assert status == 0, err


def test_a_run_says_how_many_names_a_star_has_set(dockloop):
    command = ("run", "absorber_1d", "--stop", "0.1", "--no-plots", "-o", "own.csv", "--json")
    summary = dockloop.read(*command, "--set", "*.mass=700")
    assert [summary["parameters"][f"{v}.mass"] for v in ("chaser", "target")] == [700.0, 700.0]
    assert "*.mass=700: 2 names set" in summary["notes"]
    refused = dockloop(*command, "--set", "*.mas=700").err
    assert "no name that can be set is like '*.mas' (did you mean" in refused
    refused = dockloop("run", "hexapod", "--set", "element[*].law[1].stiffness=1").err
    assert "'element[*].law[*].stage[*].stiffness'" in refused  # a pattern, not one of its names
