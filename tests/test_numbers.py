"""What a number is: one rule for texts, one for Python, wherever a number is asked.

The oracle of texts is the grammar of JSON, with a plus, leading zeros and a bare point.
"""

import json
import math
import re

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.histories import read_data
from dockloop.base.number import is_number, read_number, read_whole
from dockloop.result.recording import Result
from dockloop.scene.resolve import parse_value

SCENE = "absorber_1d"
SPEED = "initial.closing_speed"
TEXTS = ["0.1", "-2", "1e3", "2.5E-2", " 7 ", "+1", "007", ".5", "3."]
NO_TEXTS = [
    "1_0.0",
    "1_0",
    "0x10",
    "inf",
    "-Infinity",
    "nan",
    "1e400",
    "",
    "1;5",
    "1e",
    ".",
    "\u0661",
]
MISSING = ["nan", ""]  # in a table: not measured
NUMBERS = [1, 0.25, np.float32(0.25), np.float64(0.25), np.int64(1)]
NO_NUMBERS = ["0.25", True, np.True_, None, [0.25], "", 10**400, math.nan, math.inf]


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_that_is_a_number_has_the_value_of_json(text):
    sign, digits = re.fullmatch(r"\s*([+-]?)0*(\S+)\s*", text).groups()
    plain = re.sub(r"^\.", "0.", re.sub(r"\.$", ".0", digits))
    expected = json.loads(plain) * (-1 if sign == "-" else 1)
    assert read_number(text) == parse_value(text) == expected
    if isinstance(expected, int):
        assert read_whole(text) == expected
        assert isinstance(parse_value(text), int)
    else:
        with pytest.raises(ValueError, match=text):
            read_whole(text)


@pytest.mark.parametrize("text", NO_TEXTS)
def test_another_text_is_refused_by_options_settings_keys_and_tables(dockloop, tmp_path, text):
    (tmp_path / "ranges.csv").write_text(f'time [s],relative.axial [m]\n0,0\n0.1,"{text}"\n')
    if text in MISSING:
        data = read_data(tmp_path / "ranges.csv", ["time", "relative.axial"], ["s", "m"])
        assert np.isnan(data["relative.axial"]).tolist() == [False, True]
    else:
        refused = r"'relative\.axial' in line 3 is '.*must be a finite"
        with pytest.raises(dl.UsageError, match=refused):
            read_data(tmp_path / "ranges.csv", ["time", "relative.axial"], ["s", "m"])
    for words in (
        [f"--stop={text}"],
        ["--set", f"chaser.mass={text}"],
        ["--scene", f"{SPEED}={text}"],
        [f"--accuracy={text}"],
    ):
        outcome = dockloop("run", SCENE, "--no-plots", "-o", tmp_path / "own.csv", *words)
        assert (outcome.status, outcome.out) == (2, ""), words
        assert re.search(r"must (be|have) (a|finite)", outcome.err), outcome.err
    for command in (
        ["trade", SCENE, "--quick", "--apply", text],
        ["trade", SCENE, "--quick", "--tolerances", f"1e-3,{text}"],
        ["envelope", SCENE, "--x", SPEED, "0", text, "--y", "chaser.mass", "1", "2"],
        ["sweep", f"{SCENE}_speeds", "--accuracy", text],
    ):
        assert dockloop(*command).status == 2, command


def sweep(**members):
    vary = {"type": "uniform", "name": SPEED, "range": [0.05, 0.1]}
    settings = {
        "title": "",
        "scene": SCENE,
        "vary": [vary],
        "cases": 1,
        "experiment": {"stop": 0.5},
    }
    return lambda value: dl.sweep({**settings, **{n: f(value) for n, f in members.items()}})


def envelope(**more):
    def find(value):
        given = {name: make(value) for name, make in more.items()}
        return dl.envelope(
            SCENE,
            **{"x": (SPEED, 0.05, 0.1), "y": ("chaser.mass", 1e4, 2e4), "stop": 0.5, **given},
            criteria="captured",
            coarse=2,
            tolerance=0.25,
            checks=0,
        )

    return find


PLACES = {
    "value": lambda value: dl.Docking(SCENE).set("chaser.mass", value),
    "vector": lambda value: dl.Docking(SCENE).set("chaser.force_ext", [value, 0.0, 0.0]),
    "override": lambda value: dl.Scene(SCENE, {SPEED: value}),
    "start value": lambda value: dl.run(SCENE, start_values={"chaser.mass": value}, stop=0.1),
    "stop": lambda value: dl.run(SCENE, stop=value or 0),
    "step": lambda value: dl.run(SCENE, stop=1.0, step=value or 0),
    "h": lambda value: dl.Docking(SCENE).step(value),
    "times": lambda value: dl.Docking(SCENE).record([0.0, value]),
    "set of a sweep": sweep(set=lambda value: {"chaser.mass": value}),
    "experiment of a sweep": sweep(experiment=lambda value: {"stop": value}),
    "range": envelope(x=lambda value: (SPEED, 0.05, value)),
    "start value of an envelope": envelope(start_values=lambda value: {"target.mass": value}),
    "stop of an envelope": envelope(stop=lambda value: value or 0),
}


def test_numbers_in_lists_and_groups_of_a_setting_follow_the_same_grammar(dockloop):
    assert parse_value("[.5, 007, +1, 3., true, 'a, 1_0]']") == [0.5, 7, 1, 3.0, True, "a, 1_0]"]
    assert parse_value("[[1, 2_0], {a_1 = 1_0}, 0x10]") == [[1, "2_0"], {"a_1": "1_0"}, "0x10"]
    outcome = dockloop("variables", SCENE, "--scene", "chaser.inertia=[1, 1_0, 1, 0, 0, 0]")
    assert outcome.status == 2
    assert 'chaser.inertia[2] is "1_0": must be a number' in outcome.err


def test_what_a_mask_hides_is_no_number():
    """Of the same kind as strides that are ignored, in coupling libraries."""
    docking = dl.Docking(SCENE)
    docking.set("chaser.force_ext", np.arange(12.0)[5:2:-1])
    assert docking.get("chaser.force_ext").tolist() == [5.0, 4.0, 3.0]
    with pytest.raises(dl.UsageError, match=r"masked_array(.|\n)*must be a number"):
        docking.set("chaser.force_ext", np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0]))


@pytest.mark.parametrize("place", PLACES)
def test_python_takes_numbers_of_python_and_numpy_and_refuses_all_else(place):
    for value in NUMBERS:
        assert is_number(value)
        PLACES[place](value)
    for value in NO_NUMBERS:
        with pytest.raises(dl.UsageError, match=r"must |is not a finite number") as refusal:
            PLACES[place](value)
        assert len(str(refusal.value).splitlines()) == 1


def test_named_values_are_no_numbers_of_text():
    assert isinstance(dl.run(SCENE, stop=0.1, accuracy="real-time"), Result)
    with pytest.raises(dl.UsageError, match="'accuracy' is '1e-3': must be a number or real-time"):
        dl.run(SCENE, stop=0.1, accuracy="1e-3")
    with pytest.raises(dl.UsageError, match=r"^accuracy '1e-3': must be a number above 0"):
        dl.sweep(f"{SCENE}_speeds", accuracy="1e-3")
    for given, words in {"tolerances": "tolerances '1e-3'", "steps": "steps '1e-3'"}.items():
        with pytest.raises(dl.UsageError, match=f"^{words}: must be a finite number"):
            dl.trade(SCENE, **{given: ["1e-3"]})
    for workers, words in {"2": "whole", True: "whole", 0: "at least 1"}.items():
        with pytest.raises(dl.UsageError, match=f"^workers .*{words}"):
            dl.sweep(f"{SCENE}_speeds", workers=workers)
