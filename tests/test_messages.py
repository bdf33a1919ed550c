"""What a command says of a bad file, a bad disk, a missing package: one sentence, and no harm.

1. Every kind of bad file against every command that reads such a file.
2. Members and keys that are wrong are named as the user wrote them.
3. A full temporary folder, a full standard output, no matplotlib.
"""

import errno
import io
import json
import os
import random
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from conftest import SCENES
from dockloop.base import paths
from dockloop.base.errors import DockloopError
from dockloop.scene.mechanism import check_mechanism
from dockloop.sweeps.settings import parse_settings
from test_outputs import snapshot

GARBAGE = random.Random(1).randbytes(3000)
MODEL = "resources/model.json"

# ---------------------------------------------------------------- bad files

READERS = {
    ".toml": [
        ["run", "FILE", "--stop", "0.1"],
        ["build", "FILE"],
        ["ssp", "FILE"],
        ["truth", "FILE", "--output", "gap", "--stop", "0.1", "--step", "0.1"],
        ["linearise", "FILE", "--at", "0.1"],
        ["trade", "FILE", "--quick", "--methods", "explicit", "--stop", "0.1"],
        ["sweep", "FILE"],
        ["sweep", "of_scene.toml"],
    ],
    ".json": [
        ["check", "FILE"],
        ["check", "hexapod_bench", "--states", "FILE"],
        ["build", "of_mechanism.toml"],
        ["sweep", "of_mechanism_sweep.toml"],
    ],
    ".fmu": [["run", "FILE", "--stop", "0.1"]],
}
COMMANDS = [(suffix, order) for suffix, orders in READERS.items() for order in orders]


def nested(path):
    many = b"[" * 100_000
    path.write_bytes(b"a = " + many if path.suffix == ".toml" else many)


def folded(path):
    """As deep as the reader goes, and further than anything else does."""
    text = "[" * 400 + "]" * 400
    path.write_text(f"a = {text}" if path.suffix == ".toml" else f'{{"bodies": {text}}}')


def number(path):
    digits = "1" + "0" * 5000
    path.write_text(f"a = {digits}" if path.suffix == ".toml" else f'{{"a": {digits}}}')


BAD = {
    "empty": lambda path: path.write_bytes(b""),
    "garbage": lambda path: path.write_bytes(GARBAGE),
    "zeros": lambda path: path.write_bytes(bytes(100)),
    "broken UTF-8": lambda path: path.write_bytes(b'title = "\xff\xfe"\n'),
    "UTF-16": lambda path: path.write_text('title = "a"\n', encoding="utf-16"),
    "cut off": lambda path: path.write_text(
        '{"name": "a", "bod' if path.suffix != ".toml" else "["
    ),
    "list": lambda path: path.write_text("[1, 2]"),
    "text": lambda path: path.write_text('"text"'),
    "nested": nested,
    "folded": folded,
    "number": number,
    "folder": lambda path: path.mkdir(),
    "circle of links": lambda path: path.symlink_to(path.name),
    "link to nothing": lambda path: path.symlink_to("nothing"),
    "nothing": lambda path: None,
}
# Names that are hard to write down; no file has them, or a bad one.
NAMES = ["new\nline", "quotes'\"", "\u2028line", "blank name", "b" * 300, os.fsdecode(b"raw\xff")]


def write_companions(folder, name="bad"):
    """A scene, and sweeps, that lead to the bad file."""
    scene = (paths.SCENES / "absorber_1d.toml").read_text()
    sweep = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    quoted = json.dumps(name)
    (folder / "of_mechanism.toml").write_text(scene.replace('"absorber_1d"', quoted))
    for file, other in (("of_scene", f"{name}.toml"), ("of_mechanism_sweep", "of_mechanism.toml")):
        text = sweep.replace('"absorber_1d"', json.dumps(other))
        (folder / f"{file}.toml").write_text(text, encoding="utf-8", errors="replace")


def assert_said(outcome, before, folder):
    """One sentence, an exit status that fits, and what was there is as it was."""
    assert outcome.status in (1, 2), outcome
    assert outcome.err.count("\n") == 1, outcome.err
    assert outcome.err.startswith("dockloop"), outcome.err
    assert "defect" not in outcome.err
    assert "Traceback" not in outcome.err
    after = snapshot(folder)
    assert {name: after.get(name) for name in before} == before


def call(dockloop, order, file):
    return dockloop(*(file if word == "FILE" else word for word in order))


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize(("suffix", "order"), COMMANDS)
def test_a_bad_file_is_one_sentence(dockloop, tmp_path, suffix, order, kind):
    file = tmp_path / f"bad{suffix}"
    write_companions(tmp_path)
    BAD[kind](file)
    before = snapshot(tmp_path)
    outcome = call(dockloop, order, file.name)
    assert_said(outcome, before, tmp_path)
    assert "bad" in outcome.err


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("suffix", "order"), COMMANDS)
def test_a_file_of_an_odd_name_is_one_sentence(dockloop, tmp_path, suffix, order, name):
    write_companions(tmp_path, "bad" if "\udcff" in name else name)
    if len(name) < 200:
        (tmp_path / f"{name}{suffix}").write_text("?")
    before = snapshot(tmp_path)
    assert_said(call(dockloop, order, f"{name}{suffix}"), before, tmp_path)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        (["check", "FOLDER"], "a mechanism of your own is given by the path of its file"),
        (["build", "FOLDER"], "a scene of your own is given by its path, ending in .toml"),
        (["sweep", "FOLDER"], "a sweep of your own is given by its path, ending in .toml"),
        (["view", "FOLDER"], "no result file"),
        (["compare", "FOLDER", "FOLDER"], "no result file"),
    ],
)
@pytest.mark.parametrize("folder", [".", "own"])
def test_a_folder_is_called_a_folder(dockloop, tmp_path, order, expected, folder):
    (tmp_path / "own").mkdir()
    before = snapshot(tmp_path)
    outcome = dockloop(*(folder if word == "FOLDER" else word for word in order))
    assert_said(outcome, before, tmp_path)
    assert "is a folder" in outcome.err
    assert expected in outcome.err


def test_a_byte_order_mark_and_other_ends_of_lines_are_read_over(dockloop, tmp_path):
    mark = b"\xef\xbb\xbf"
    scene, mechanism = tmp_path / "own.toml", tmp_path / "own.json"
    text = (paths.SCENES / "absorber_1d.toml").read_text().replace('"absorber_1d"', '"own"')
    scene.write_bytes(mark + text.encode().replace(b"\n", b"\r\n"))
    content = (paths.MECHANISMS / "absorber_1d.json").read_bytes()
    mechanism.write_bytes(mark + content.replace(b"\n", b"\r\n"))
    assert dockloop("check", "own.json").status == 0
    dockloop.succeed("new", "copy", "--from", "own.toml")
    named = content.replace(b'"name": "absorber_1d"', b'"name": "copy"')
    assert (tmp_path / "copy.json").read_bytes() == named != content
    assert (tmp_path / "copy.toml").read_text() == text.replace('"own"', '"copy"')


@pytest.mark.usefixtures("permissions")
@pytest.mark.parametrize(("suffix", "order"), COMMANDS)
def test_a_file_that_may_not_be_read_is_one_sentence(dockloop, tmp_path, suffix, order):
    write_companions(tmp_path)
    file = tmp_path / f"bad{suffix}"
    file.write_text("?")
    before = snapshot(tmp_path)
    file.chmod(0)
    outcome = call(dockloop, order, file.name)
    file.chmod(0o644)
    assert_said(outcome, before, tmp_path)
    assert "cannot be read" in outcome.err


def edit(fmu: bytes, **changed: bytes | None) -> bytes:
    """Return an FMU with other entries, those that are None left out; ``binaries``: all of them."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(fmu)) as old, zipfile.ZipFile(written, "w") as new:
        for name in old.namelist():
            group = "binaries" if name.startswith("binaries/") else name
            content = changed[group] if group in changed else old.read(name)
            if content is not None:
                new.writestr(name, content)
    return written.getvalue()


def put(name: str, content: bytes | None):
    return lambda fmu: edit(fmu, **{name: content})


def replace(pattern: bytes, text: bytes):
    """Put another description into an FMU."""

    def change(fmu):
        with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
            description = re.sub(pattern, text, archive.read("modelDescription.xml"))
        return edit(fmu, **{"modelDescription.xml": description})

    return change


def model(**changes):
    """Put another scene into an FMU."""

    def change(fmu):
        with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
            document = json.loads(archive.read(MODEL)) | changes
        return edit(fmu, **{MODEL: json.dumps(document).encode()})

    return change


def foreign(_):
    """An FMU of another tool."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr("modelDescription.xml", '<fmiModelDescription fmiVersion="2.0"/>')
    return written.getvalue()


SPOILT = {
    "first half": lambda fmu: fmu[: len(fmu) // 2],
    "second half": lambda fmu: fmu[len(fmu) // 2 :],
    "damaged in the middle": lambda fmu: fmu[:2000] + bytes(5000) + fmu[7000:],
    "damaged directory": lambda fmu: fmu[:-300] + GARBAGE[:278] + fmu[-22:],
    "of another tool": foreign,
    "no description": put("modelDescription.xml", None),
    "empty description": put("modelDescription.xml", b""),
    "garbage as description": put("modelDescription.xml", GARBAGE),
    "other description": put("modelDescription.xml", b"<a/>"),
    "no experiment": replace(rb"<DefaultExperiment[^>]*/>", b""),
    "no number as step": replace(rb'stepSize="[^"]*"', b'stepSize="x"'),
    "another type": replace(rb"<Integer", b"<Real"),
    "no scene": put(MODEL, None),
    "garbage as scene": put(MODEL, GARBAGE),
    "list as scene": put(MODEL, b"[]"),
    "deep scene": put(MODEL, b"[" * 100_000),
    "scene of another format": model(format="else"),
    "scene with a path as name": model(name="../../own"),
    "scene without vehicles": model(chaser=None),
    "no binary": put("binaries", None),
    "garbage as binary": put("binaries", GARBAGE),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_spoilt_fmu_is_one_sentence(dockloop, runs, tmp_path, kind):
    (tmp_path / "bad.fmu").write_bytes(SPOILT[kind](runs.fmu("absorber_1d").read_bytes()))
    before = snapshot(tmp_path)
    outcome = dockloop("run", "bad.fmu", "--stop", "0.1", "-o", "own.csv")
    assert_said(outcome, before, tmp_path)
    assert "bad.fmu" in outcome.err
    assert "/tmp" not in outcome.err.replace(str(tmp_path), "")
    assert Path.cwd() == tmp_path  # FMPy goes elsewhere to load a library


VALUES = {
    "date": ("mass = 25e3", "mass = 2024-01-01", "chaser.mass"),
    "number for a group": ("[chaser]", "chaser = 3\n[chase]", "chaser is 3"),
    "text for a group": ('[mechanism]\nname = "absorber_1d"', "", None),
    "huge whole number": ("approach_time = 0.0", f"roll_deg = 1{'0' * 400}", "initial.roll_deg"),
    "NUL": ('"absorber_1d"', '"a\\u0000b"', "mechanism.name"),
    "long name": ('"absorber_1d"', f'"{"a" * 300}"', "mechanism.name"),
    "line break": ('"absorber_1d"', '"a\\nb"', "mechanism.name"),
    "key with a line break": ('title = "', '"a\\nb" = 1\ntitle = "', "unknown member"),
    "set is a number": ('"absorber_1d"', '"absorber_1d"\nset = 4', "mechanism.set"),
    "set is a date": (
        '"absorber_1d"',
        '"absorber_1d"\nset = {"contact.stiffness" = 2024-01-01}',
        "mechanism.set.contact.stiffness",
    ),
    "infinite stop": ("stop = 5.0", "stop = inf", "experiment.stop"),
}


@pytest.mark.parametrize("name", VALUES)
def test_a_bad_value_in_a_scene_is_one_sentence(dockloop, tmp_path, name):
    old, new, word = VALUES[name]
    text = (paths.SCENES / "absorber_1d.toml").read_text()
    assert old in text
    text = text.replace(old, new)
    (tmp_path / "bad.toml").write_text(text if word else f'mechanism = "x"\n{text}')
    before = snapshot(tmp_path)
    outcome = dockloop("build", "bad.toml")
    assert_said(outcome, before, tmp_path)
    assert outcome.status == 2, outcome
    assert (word or "mechanism is") in outcome.err, outcome.err


@pytest.mark.parametrize(
    "override",
    [
        "chaser.mass=1\nfoo = 2",
        "chaser.mass=1979-01-01",
        "chaser.mass=" + "9" * 5000,
        "chaser.mass=" + "[" * 100_000,
        "mechanism.name=" + "a" * 5000,
        "mechanism.set.=1",
        "mechanism.set..=1",
        "mechanism.set.contact=1",
        "mechanism.set.bodies.\u00b2.mass=1",
        "mechanism.set.bodies." + "9" * 5000 + ".mass=1",
        "mechanism.set.gravity.1.x=1",
        "initial.joints.=1",
        "initial.joints.a=1",
        "initial.joints.a.b.c=1",
    ],
)
def test_a_bad_override_is_one_sentence(dockloop, tmp_path, override):
    before = snapshot(tmp_path)
    outcome = dockloop("build", "idss_25t_350t", "--scene", override)
    assert_said(outcome, before, tmp_path)
    assert outcome.status == 2, outcome


def test_an_override_below_a_value_of_the_file_is_refused(dockloop, tmp_path):
    (tmp_path / "own.toml").write_text("chaser = 3\n")
    outcome = dockloop("build", "own.toml", "--scene", "chaser.mass=1")
    assert outcome.status == 2, outcome
    assert "chaser of the scene is 3: must be a section" in outcome.err
    for option in ("initial.joints.a=1", "initial.joints.a.rate=1"):
        outcome = dockloop(
            "build", "idss_25t_350t", "--scene", "initial.joints.a=1", "--scene", option
        )
        assert outcome.status == 2, outcome


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "absorber_1d", "--stop", "1e308", "--step", "1e-3"],
        ["run", "absorber_1d", "--step", "1e-300"],
        ["truth", "absorber_1d", "--output", "gap", "--step", "0"],
        ["truth", "absorber_1d", "--output", "a\nb", "--stop", "0.1", "--step", "0.1"],
        ["linearise", "absorber_1d", "--at", "nan"],
        ["linearise", "absorber_1d", "--at", "a\nb"],
        ["linearise", "absorber_1d", "--at", "0.1", "-o", "own.csv"],
        ["linearise", "absorber_1d", "--at", "0.1", "--bode", "chaser.force_ext[1]", "a\nb"],
        ["trade", "absorber_1d", "--quick", "--stop", "nan"],
        ["trade", "absorber_1d", "--quick", "--stop", "inf"],
        ["sweep", "absorber_1d_speeds", "--workers", "many"],
        ["sweep", "absorber_1d_speeds", "--workers", "-1"],
        ["run", "a\nb"],
        ["sail\nx"],
        ["run", ""],
        ["run", "a" * 5000],
        ["check", "a" * 5000],
        ["sweep", "a" * 5000],
        ["check", "."],
        ["build", "absorber_1d", "-o", "own.zip"],
        ["ssp", "absorber_1d", "-o", "own"],
        ["map", "absorber_1d", "--x", "a", "1", "2", "--y", "b", "1", "2", "--limit", "0"],
        ["extremes", "--random", "1", "--limit", "inf"],
    ],
)
def test_bad_usage_is_one_sentence(dockloop, tmp_path, arguments):
    outcome = dockloop(*arguments)
    assert_said(outcome, {}, tmp_path)
    assert outcome.status == 2, outcome
    assert "_positive" not in outcome.err


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("friction.coefficient=-1", "'friction.coefficient' = -1 is below its minimum 0"),
        ("chaser.mass=-5", "'chaser.mass' = -5 is below its minimum 0 kg"),
        ("solver.method=99", "'solver.method' = 99 is above its maximum 13"),
    ],
)
def test_a_refused_value_is_named_without_functions_of_fmi(dockloop, tmp_path, setting, sentence):
    run = dockloop("run", "idss_25t_350t", "--set", setting, "--stop", "0.1")
    name, value = setting.split("=")
    assert (run.status, run.err.count("\n")) == (2, 1)
    assert run.err.startswith(f"dockloop: --set {setting}")
    assert run.err.endswith(f": {sentence}\n")
    vary = f'[[vary]]\ntype = "grid"\nname = "{name}"\nvalues = [{value}]\n'
    (tmp_path / "own.toml").write_text(f'scene = "idss_25t_350t"\n{vary}')
    sweep = dockloop("sweep", "own.toml", "--no-plots")
    assert (sweep.status, sweep.err.count("\n")) == (1, 1)
    assert f"{name} is {value}: must be" in sweep.err or sentence in sweep.err
    assert "fmi2" not in sweep.err


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("SOURCE_DATE_EPOCH", "yesterday", "SOURCE_DATE_EPOCH is 'yesterday'"),
        ("CC", '"cc', "CC is '\"cc'"),
    ],
)
def test_a_bad_setting_of_the_environment_is_named(dockloop, monkeypatch, name, value, words):
    monkeypatch.setenv(name, value)
    outcome = dockloop("build", "absorber_1d")
    assert outcome.status == 2, outcome
    assert words in outcome.err


def test_a_solution_that_was_kept_but_is_damaged_is_named(dockloop, tmp_path):
    order = ["trade", "absorber_1d", "--quick", "--methods", "explicit", "--stop", "0.1"]
    assert dockloop(*order).status == 0
    (kept,) = (tmp_path / "build" / "truth").iterdir()
    for content in (b"", GARBAGE, b"[]", b'{"time": [0.0]}'):
        kept.write_bytes(content)
        before = snapshot(tmp_path)
        outcome = dockloop(*order)
        assert_said(outcome, before, tmp_path)
        assert f"{kept.name}: is no reference solution that can be read: delete it" in outcome.err


# ---------------------------------------------------------------- whose fault it is


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            ["contact.law.stifness=1"],
            "mechanism.set.contact.law.stifness cannot be set in MECHANISM: contact.law has an"
            " unknown member 'stifness' (did you mean 'stiffness'",
        ),
        (
            ["contact.law.toe=0.1", "bodies.ring.mass=-1"],
            "mechanism.set.bodies.ring.mass cannot be set in MECHANISM: bodies[1].mass is -1",
        ),
        (
            ["bodies.ring.joint={type = 'revolute'}"],
            "mechanism.set.bodies.ring.joint cannot be set in MECHANISM: bodies[1].joint lacks the"
            " member 'axis'",
        ),
        (
            ["bodies.ring.joint.type=revolute"],
            "mechanism.set.bodies.ring.joint.type cannot be set in MECHANISM: bodies[1].joint lacks"
            " the member 'axis'",
        ),
        (["bodies.rng.mass=1"], "mechanism.set.bodies.rng.mass cannot be set in MECHANISM: bodies"),
    ],
)
@pytest.mark.parametrize("in_file", [True, False])
def test_what_is_set_in_a_mechanism_is_blamed_on_the_scene_or_the_option(
    dockloop, tmp_path, keys, words, in_file
):
    text = (paths.SCENES / "idss_25t_350t.toml").read_text()
    options = [f"--scene=mechanism.set.{key}" for key in keys]
    if in_file:
        pairs = (key.partition("=") for key in keys)
        options = []
        inner = ", ".join(f'"{k}" = {v if v != "revolute" else repr(v)}' for k, _, v in pairs)
        named = 'name = "idss_hexapod"'
        assert text.count(named) == 1
        text = text.replace(named, f"{named}\nset = {{{inner}}}")
    (tmp_path / "own.toml").write_text(text)
    outcome = dockloop("build", "own.toml", *options)
    assert outcome.status == 2, outcome
    mechanism = str(paths.MECHANISMS / "idss_hexapod.json")
    setter = "own.toml" if in_file else f"--scene mechanism.set.{keys[-1]}"
    assert outcome.err.startswith(f"dockloop: {setter}: {words.replace('MECHANISM', mechanism)}")


def test_a_fault_of_the_mechanism_itself_is_blamed_on_its_file(dockloop, tmp_path):
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    mechanism["bodies"][0]["mass"] = -1
    (tmp_path / "idss_hexapod.json").write_text(json.dumps(mechanism))
    text = (paths.SCENES / "idss_25t_350t.toml").read_text()
    (tmp_path / "own.toml").write_text(text)
    outcome = dockloop("build", "own.toml", "--scene", "mechanism.set.contact.law.stifness=1")
    assert outcome.err.startswith("dockloop: idss_hexapod.json: bodies[1].mass is -1"), outcome


def test_a_misspelt_member_is_named_as_it_was_written(dockloop, tmp_path):
    text = (paths.SCENES / "absorber_1d.toml").read_text()
    (tmp_path / "own.toml").write_text(text.replace("mass = 25e3", "mas = 25e3"))
    outcome = dockloop("build", "own.toml")
    assert outcome.err == (
        "dockloop: own.toml: chaser has an unknown member 'mas' (did you mean 'mass'?)\n"
    )
    (tmp_path / "own.toml").write_text(text.replace("mass = 25e3", ""))
    outcome = dockloop("build", "own.toml")
    assert outcome.err == "dockloop: own.toml: chaser lacks the member 'mass'\n"
    (tmp_path / "own.toml").write_text(text.replace("mass = 25e3", "weight = 25e3"))
    assert "own.toml: chaser" in dockloop("build", "own.toml").err


def test_null_as_closure_is_as_if_left_out(dockloop, tmp_path):
    given = paths.ROOT / "tests" / "data" / "crank_nested.json"
    document = json.loads(given.read_text())
    plain = json.loads(json.dumps(document))
    for loop in document["mechanism"]["loops"]:
        loop["closure"] = None
    for loop in plain["mechanism"]["loops"]:
        loop.pop("closure", None)
    for name, content in (("null", document), ("plain", plain)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    null, without = tmp_path / "null.json", tmp_path / "plain.json"
    assert check_mechanism(str(null)) == check_mechanism(str(without))
    assert check_mechanism(str(null), null) == check_mechanism(str(without), without)
    scene = '[chaser]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n[mechanism]\nname = "null"\n'
    (tmp_path / "own.toml").write_text(scene)
    dockloop.succeed("build", "own.toml", "--no-kernel", "-o", "own.fmu")
    document["mechanism"]["bodies"][0]["mass"] = None  # a mass of an unknown body
    null.write_text(json.dumps(document))
    refused = dockloop("check", "null.json")
    assert refused.status == 2, refused
    assert "bodies[1].mass is null: must be a number" in refused.err


FREE = {"type": "free"}
AXLE = {"type": "revolute", "axis": [0, 0, 1]}
SLIDE = {"type": "prismatic", "axis": [0, 0, 1]}
MASS, INERTIA = "give the bodies they move a mass: nothing that moves with 'a'", "'a' has a moment"


@pytest.mark.parametrize(
    ("joint", "members", "present", "absent"),
    [
        (FREE, {"mass": 30}, [INERTIA], [MASS]),
        (AXLE, {"mass": 5}, [INERTIA], [MASS]),
        (FREE, {"mass": 5, "com": [0.1, 0, 0]}, [INERTIA], [MASS]),  # a point mass turns freely
        (SLIDE, {"mass": 0}, [MASS], [INERTIA]),
        (FREE, {"mass": 0}, [MASS, INERTIA], []),
    ],
)
def test_what_lacks_is_named_mass_or_inertia(joint, members, present, absent):
    body = {"name": "a", "parent": "base", "joint": joint, **members}
    with pytest.raises(DockloopError, match="not positive definite") as refused:
        check_mechanism({"name": "mine", "bodies": [body]})
    assert all(words in str(refused.value) for words in present), refused.value
    assert not any(words in str(refused.value) for words in absent), refused.value


def test_a_mass_away_from_the_axis_is_an_inertia():
    body = {"name": "a", "parent": "base", "joint": AXLE, "mass": 5, "com": [0.1, 0, 0]}
    assert check_mechanism({"name": "mine", "bodies": [body]})["degrees_of_freedom"] == 1


def test_a_name_that_is_cut_short_is_completed(dockloop, runs):
    fmu = str(runs.fmu("idss_25t_350t"))
    assert "did you mean 'friction.coefficient'" in dockloop("run", fmu, "--set", "friction=1").err
    refused = dockloop("run", "absorber_1d", "--scene", "friction=0.2").err
    assert "did you mean 'contact.friction_coefficient'" in refused
    refused = dockloop("run", fmu, "--set", "frction.coeficient=1").err
    assert "did you mean 'friction.coefficient'" in refused


# ---------------------------------------------------------------- disks and packages


TEMPORARY = {
    "run": ["run", "absorber_1d", "--stop", "0.1"],
    "run an FMU": ["run", "FMU", "--stop", "0.1"],
    "trade": ["trade", "absorber_1d", "--quick"],
    "ssp": ["ssp", "idss_25t_350t"],
    "build": ["build", "absorber_1d", "--reference"],
}


@pytest.mark.parametrize("command", TEMPORARY)
def test_a_full_temporary_folder_is_named(dockloop, runs, tmp_path, monkeypatch, command):
    """As tmpfs says it: writing fails, without the name of the file."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    order = [runs.fmu("absorber_1d") if word == "FMU" else word for word in TEMPORARY[command]]

    def fail(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for place in ("zipfile.ZipFile.extractall", "zipfile.ZipFile.writestr"):
        if command == "run an FMU" and place.endswith("writestr"):
            continue
        if command == "ssp" and place.endswith("extractall"):
            continue
        with monkeypatch.context() as full:
            full.setattr(place, fail)
            outcome = dockloop(*order)
        assert outcome.status == 1, outcome
        assert outcome.err == (
            f"dockloop: no space is left in {temporary} for temporary files: free some, or let"
            " TMPDIR name another folder\n"
        )
        assert not list(temporary.iterdir())


def test_a_temporary_folder_that_cannot_be_had_is_named(dockloop, monkeypatch):
    def fail(*_, **__):
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("tempfile.mkdtemp", fail)
    outcome = dockloop("run", "absorber_1d", "--stop", "0.1")
    assert outcome.status == 1, outcome
    assert "no temporary folder can be made (No usable" in outcome.err
    assert "TMPDIR" in outcome.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_standard_output_that_is_full_is_reported():
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "dockloop", "check", "hexapod_bench"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (
        1,
        "dockloop: standard output cannot be written (no space is left on the disk)\n",
    )


@pytest.mark.parametrize(
    ("order", "files"),
    [
        (
            ["run", SCENES[0], "--stop", "0.1", "-o", "own.csv"],
            ["own.csv", "own_summary.json"],
        ),
        (["sweep", "absorber_1d_speeds", "-o", "own.parquet"], ["own.parquet", "own_summary.json"]),
        (
            ["trade", "absorber_1d", "--quick", "--methods", "explicit", "-o", "own"],
            ["own/trade.csv", "own/trade.md"],
        ),
    ],
)
def test_without_matplotlib_only_figures_are_missing(dockloop, tmp_path, monkeypatch, order, files):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    reported = dockloop.succeed(*order, "--json")
    assert reported.err.count("\n") == 1, reported.err
    assert "no figures are drawn" in reported.err
    assert "pip install matplotlib" in reported.err
    assert json.loads(reported.out)["files"] == files
    for file in files:
        assert (tmp_path / file).stat().st_size > 0, file
    assert not list(tmp_path.rglob("*.png"))
    if "trade" in order:
        assert ".png" not in (tmp_path / "own" / "trade.md").read_text()


AXES = "--x initial.closing_speed 0.05 0.1 --y chaser.mass 1e3 2e4"


@pytest.mark.parametrize(
    ("order", "sentence"),
    [
        (
            "linearise hexapod --at capture --scene chaser.mass=-1",
            "--scene chaser.mass=-1: chaser.mass is -1",
        ),
        (
            "linearise hexapod --at capture --set chaser.mass=-1",
            "--set: 'chaser.mass' = -1 is below its min",
        ),
        ("review absorber_1d --scene chaser.mass=-1", "--scene chaser.mass=-1: chaser.mass is -1"),
        ("run absorber_1d --accuracy 7", "--accuracy 7: 'accuracy' = 7 is above its maximum 1"),
        (
            "run hexapod --set chaser.inertia[4]=1e6",
            "--set chaser.inertia[4]=1e6: chaser.inertia (xx yy zz xy xz yz) is ",
        ),
        *(
            (
                f"{command} --scene chaser.inertia=[1,1,9,0,0,0]",
                "--scene chaser.inertia=[1,1,9,0,0,0]: chaser.inertia has the principal moments",
            )
            for command in (
                "run absorber_1d",
                "trade absorber_1d --quick --methods explicit",
            )
        ),
        (
            "linearise hexapod --at capture --scene chaser.inertia=[1,1,9,0,0,0]",
            "--scene chaser.inertia=[1, 1, 9, 0, 0, 0]: chaser.inertia has the principal moments",
        ),
        *(
            (f"{command} absorber_1d {axes} --set target.{text}", f"--set target.{text}: target.")
            for command, axes in (
                ("envelope", f"{AXES} --criterion captured"),
                ("map", "--x solver.rtol 1e-6 1e-3 --y experiment.step 1e-3 1e-2"),
                ("fit", "rig.csv --vary chaser.mass 1e3 2e3"),
                ("review", ""),
            )
            for text in ("mass=-1", "inertia=[1,1,9,0,0,0]")
            if (command, text) != ("review", "mass=-1")
        ),
        (
            f"envelope absorber_1d {AXES} --criterion captured --set foo=1",
            "--set foo=1: is neither a key of the scene nor a variable of its FMU",
        ),
        (
            f"envelope absorber_1d {AXES} --criterion captured --accuracy 7",
            "--accuracy 7: 'accuracy' = 7 is above its maximum 1",
        ),
        (
            "fit absorber_1d rig.csv --vary chaser.mas 1e3 2e3",
            "--vary chaser.mas 1000 2000: is neither a key of the scene",
        ),
        (
            "ssp absorber_1d --scene chaser.motion=fixed",
            "--scene chaser.motion=fixed: scene 'absorber_1d': conditions at first contact need",
        ),
        (
            "ssp absorber_1d --scene chaser.motion=recorded",
            "--scene chaser.motion=recorded: chaser.motion is",
        ),
    ],
)
def test_messages_begin_with_the_option_as_it_was_typed(dockloop, tmp_path, order, sentence):
    (tmp_path / "rig.csv").write_text("time,capture.compression\n0,0\n1,20\n2,0\n")
    outcome = dockloop(*order.split())
    assert outcome.status == 2, outcome
    assert outcome.err.startswith(f"dockloop: {sentence}"), outcome


def test_a_start_value_that_a_later_one_replaces_is_not_looked_at(dockloop):
    settings = ("--set", "chaser.mass=-4", "--set", "chaser.mass=2e3")
    assert dockloop("run", "absorber_1d", *settings, "--stop", "0.1", "--no-plots").status == 0


def test_the_last_setting_of_a_name_holds_and_is_named():
    settings = parse_settings("--set", ["a=1", "b=2", "a=3", "a=1"])
    assert settings == {"a": 1, "b": 2}
    assert settings.given_by == {"a": "--set a=1", "b": "--set b=2"}
