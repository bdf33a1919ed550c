"""The page of ``dockloop live``: what its server answers and refuses.

1. Values of the page are those of ``dockloop run`` with the exported command, bit for bit; so are
   those of the exported Python lines and scene file.
2. Only a page of this server is answered: token, host, origin, type, size and form of a request;
   no request reaches a file.
3. The newest request is computed; those before it end, also by `stop`. A refused setting is named.
4. The command prints the address first. Ctrl-C ends it at once, and nothing stays.

What the page does in a browser: test_live_browser.py.
"""

import _thread
import http.client
import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
import webbrowser
from argparse import Namespace
from contextlib import suppress

import numpy as np
import pytest

import dockloop as dl
from conftest import SCENES
from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError
from dockloop.commands import live
from dockloop.live.bench import (
    Bench,
    DroppedError,
    RefusedError,
    condense,
    describe_entries,
    find_range,
)
from dockloop.live.export import make_exports
from dockloop.live.server import LiveServer
from live_pages import LONG, SMALL, ask

DEFAULT = "idss_25t_350t"
RIG, MAGNETS = "rig/bench.toml", "magnets/magnets.toml"  # of the examples
SETTINGS = {
    "initial.closing_speed": "0.07",
    "mechanism.set.latches.range": "0.018",
    "friction.coefficient": "0.23",
}


def open_bench(scene):
    folder = paths.ROOT / "scripts" / "examples"
    return Bench(str(folder / scene) if scene.endswith(".toml") else scene)


def run(server, settings, **more):
    status, _, body = ask(server, body={"settings": settings, **more})
    return status, json.loads(body)


# ------------------------------------------------------------------- the same docking


@pytest.mark.usefixtures("native")  # the command runs an FMU, the page the core
@pytest.mark.parametrize(
    ("scene", "more"), [*((scene, {}) for scene in [*SCENES, RIG, MAGNETS]), (DEFAULT, SETTINGS)]
)
def test_the_page_has_the_bits_of_the_exported_command(dockloop, scene, more, tmp_path):
    bench = open_bench(scene)
    result = bench.compute(more)
    words = shlex.split(make_exports(bench, more)["command"])
    assert words[:3] == ["dockloop", "run", bench.reference]
    file = tmp_path / "own.npz"
    ran = dockloop.read(*words[1:], "--json", "--no-plots", "-o", file)
    assert np.array_equal(np.load(file)["values"], result.values, equal_nan=True)
    shown = json.loads(json.dumps(condense(result)))
    assert shown == {name: ran[name] for name in shown}


def test_python_lines_and_scene_file_give_the_same_docking(tmp_path, monkeypatch):
    bench = Bench(DEFAULT, ["experiment.stop=3"])
    expected = condense(bench.compute(SETTINGS))
    exports = make_exports(bench, SETTINGS)
    found = {}
    exec(exports["python"], found)
    assert condense(found["result"]) == expected
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(exports["scene"])
    note = exports["scene"].partition("\n")[0]
    assert note.endswith("dockloop run FILE.toml --set friction.coefficient=0.23")
    assert "# 0 = +y of A, turning towards +z" in exports["scene"]  # comments stay
    mine = dl.run("mine.toml", start_values={"friction.coefficient": 0.23})
    assert condense(mine) == expected


def test_keys_that_no_line_of_the_file_can_hold_are_exported_too(tmp_path, monkeypatch):
    bench = Bench(SMALL)
    settings = {"disturbance.1.vehicle": "chaser", "disturbance.1.force": "[5, 0, 0]"}
    settings |= {"disturbance.1.duration": "1"}
    expected = condense(bench.compute(settings))
    assert expected != condense(bench.compute({}))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(make_exports(bench, settings)["scene"])
    assert condense(dl.run("mine.toml")) == expected


def test_a_coarse_docking_is_near_the_refined_one():
    bench = Bench(DEFAULT)
    fine, coarse = (bench.compute({}, is_coarse=c) for c in (False, True))
    assert len(coarse.time) == 401 < len(fine.time) == 2001
    for name, peak in condense(fine)["peak_loads"].items():
        scale = max(p["value"] for p in condense(fine)["peak_loads"].values())
        assert abs(condense(coarse)["peak_loads"][name]["value"] - peak["value"]) < 0.01 * scale


def test_sliders_have_the_ranges_of_their_quantities():
    entries = Bench(DEFAULT).entries
    assert find_range(entries["chaser.mass"]) == (2500.0, 250000.0, True)
    assert find_range(entries["contact.friction_coefficient"]) == (0.0, 2.0, False)
    assert find_range(entries["initial.lateral_direction_deg"]) == (-180.0, 180.0, False)
    assert find_range(entries["initial.roll_rate_deg_s"]) == (-0.1, 0.1, False)
    assert find_range(entries["solver.method"]) is None
    assert find_range(entries["chaser.inertia"]) is None


def test_defaults_follow_from_settings():
    found = Bench(DEFAULT).find_defaults({"mechanism.set.contact.law.stiffness": "6e6"})
    assert found["contact.stiffness"] == "6000000"
    assert found["chaser.mass"] == "25000"
    assert "mechanism.set.contact.law.stiffness" not in found


def test_a_slider_can_be_moved():
    for scene, contact in ((SMALL, set()), (DEFAULT, {"contact.stiffness"})):
        bench = Bench(scene, ["experiment.stop=0.1"])
        shown = list_sliders(bench)
        assert shown.keys() & {"contact.stiffness"} == contact
        for name, row in shown.items():
            bench.compute({name: row["default"]}, is_coarse=True)


def list_sliders(bench):
    return {row["name"]: row for row in describe_entries(bench) if row["heading"]}


FAMILIES = [DEFAULT, "hexapod", "apda", "probe_drogue", "gripper", "stewart", SMALL, RIG, MAGNETS]
KINDS = {  # of sliders that matter, and the families without them
    r".*(stiffness|stages\.1\.2|table factor)": (),
    r".*(damping|slope|linear|restitution)": (RIG,),
    r".*(friction_coefficient|forward)": (SMALL, RIG),
    r"chaser\.mass": (RIG,),  # on a fixed base
}

# What acts in other dockings only: of what is zero, at a stop, a limit, more travel, a later step.
ELSEWHERE = r"direction|latches\.window|: (stop|drive limit|brake|motor)|stage 2"


@pytest.fixture(scope="module", params=FAMILIES)
def family(request):
    """A scene of each family, and one with an imported mechanism."""
    if request.param != "stewart":
        return request.param, open_bench(request.param)
    return request.param, Bench(str(request.getfixturevalue("imported")))


def test_the_quantities_that_matter_have_sliders(family):
    name, bench = family
    shown = [f"{row['name']} {row['label']}" for row in list_sliders(bench).values()]
    for kind, lacking in KINDS.items():
        assert any(re.match(kind, text) for text in shown) == (name not in lacking), kind
    laws = [row for name, row in list_sliders(bench).items() if ".laws." in name]
    assert all(re.match(r"[\w*]+: [a-z]+ \w", row["label"]) for row in laws)
    assert len(shown) < 45


@pytest.mark.long
def test_a_slider_that_is_moved_changes_the_docking(family):
    _, bench = family
    before = bench.compute({}, is_coarse=True)
    others = [k for k, name in enumerate(before.names) if not name.startswith("solver.")]
    sliders = list_sliders(bench)

    def is_moved(name, part):
        low, high, is_log = sliders[name]["range"]
        value = low * (high / low) ** part if is_log else low + (high - low) * part
        with suppress(DockloopError):
            after = bench.compute({name: repr(value)}, is_coarse=True)
            return not np.array_equal(after.values[:, others], before.values[:, others])
        return False

    for name, row in sliders.items():
        if not re.search(ELSEWHERE, f"{name} {row['label']}"):
            assert is_moved(name, 0.75) or is_moved(name, 0.1), name


def test_equal_parts_have_one_slider():
    bench = Bench("gripper", ["experiment.stop=0.5"])
    name = "mechanism.set.forces.finger*.laws.1.limit"
    shown = list_sliders(bench)
    assert (shown[name]["label"], shown[name]["unit"]) == ("finger*: drive limit", "N m")
    spring = shown["mechanism.set.forces.palm.laws.1.stages.1.2"]
    assert (spring["label"], spring["unit"]) == ("palm: spring stage 1", "N/m")
    assert "mechanism.set.forces.finger1.laws.1.limit" not in shown
    each = {name.replace("*", str(k)): "20" for k in (1, 2, 3)}
    assert condense(bench.compute({name: "20"})) == condense(bench.compute(each))
    assert name not in Bench("gripper", ["mechanism.set.forces.finger1.laws.1.limit=20"]).entries


def test_what_cannot_act_has_no_slider_and_is_said():
    bench = open_bench(MAGNETS)
    assert not any(name.startswith("initial.") for name in list_sliders(bench))
    result = bench.compute({"initial.lateral_offset": "0.8", "initial.roll_deg": "3"})
    said = "initial.lateral_offset and initial.roll_deg have no effect while initial.at is not"
    assert [text for text in result.warnings if said in text]
    assert bench.compute({"target.position.2": "0.005"}).warnings == []


# ------------------------------------------------------------------- which requests are answered


def test_the_page_itself(server):
    status, headers, body = ask(server, "GET", f"/{server.token}/", Origin=None)
    assert status == 200
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "unsafe-inline'; img" in headers["Content-Security-Policy"]  # of styles alone
    assert b"initial.closing_speed" in body
    assert server.token.encode() not in body


def test_the_address_of_the_browser_holds_once(server):
    path = server.first_url.removeprefix(f"http://{server.host}")
    assert server.token not in path
    status, headers, _ = ask(server, "GET", path, Origin=None)
    assert (status, headers["Location"]) == (303, server.url)
    assert ask(server, "GET", path, Origin=None)[0] == 403


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (403, {"Origin": "http://evil.example"}),
        (403, {"Origin": "null"}),
        (403, {"Origin": None}),
        (403, {"Origin": "http://localhost"}),
        (403, {"Sec_Fetch_Site": "cross-site"}),
        (403, {"Sec_Fetch_Site": "same-site"}),
        (421, {"Host": "evil.example"}),  # DNS rebinding
        (421, {"Host": None}),
        (415, {"Content_Type": "text/plain"}),  # what a form of another page can send
        (411, {"Content_Length": None}),
        (411, {"Content_Length": "-5"}),
        (411, {"Transfer_Encoding": "chunked"}),
        (413, {"Content_Length": "100001"}),
    ],
)
def test_a_foreign_request_is_refused(server, status, headers):
    found, _, body = ask(server, **headers)
    assert found == status
    assert set(json.loads(body)) == {"error"}
    assert server.token.encode() not in body


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("token", ["", "x", "../", "%2e%2e"])
def test_no_request_without_the_token(server, method, token):
    assert ask(server, method, f"/{token}/")[0] == 403
    assert ask(server, method, f"/{server.token[:-1]}/")[0] == 403
    assert ask(server, method, f"/{server.token}x/")[0] == 403


@pytest.mark.parametrize(
    "path",
    ["../../etc/passwd", "..%2f..%2fetc%2fpasswd", "web/live.js", "live.js", "run", "?run", "%00"],
)
def test_no_path_leads_to_a_file(server, path):
    status, _, body = ask(server, "GET", f"/{server.token}/{path}", Origin=None)
    assert status in (403, 404)
    assert len(body) < 200


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'{"other": 1}',
        b'{"settings": []}',
        b'{"settings": {"a": 1}}',
        b'{"settings": {"a": ""}}',
        b'{"settings": {}, "coarse": 1}',
        b'{"settings": {"a": "' + b"1" * 2001 + b'"}}',
        b"[" * 50_000,
        b"\xff\xfe",
    ],
)
def test_a_request_that_is_no_request_is_refused(server, body):
    assert ask(server, body=body)[0] == 400


@pytest.mark.parametrize("name", ["errors", "export", "stop"])
def test_only_a_run_is_coarse(server, name):
    status, _, body = ask(server, path=f"/{server.token}/{name}", body={"coarse": True})
    assert (status, json.loads(body)) == (400, {"error": f"'{name}' takes no members but settings"})


def test_a_setting_names_no_file(server, tmp_path):
    (tmp_path / "other.json").write_text('{"secret": 1}')
    for key in ("mechanism.name", "mech*.name"):
        status, answer = run(server, {key: f"{tmp_path}/other"})
        assert (status, answer["name"]) == (422, key)
        assert "must be without /" in answer["error"]
        assert "secret" not in answer["error"]
    hidden = "mechanism.name"
    for key in (f'{hidden}="{tmp_path}/other" #', f"{hidden}='x'#", f"{hidden}\n", "a\\b", "a/b"):
        for path in ("run", "export"):
            body = {"settings": {key: "1"}}
            status, _, text = ask(server, path=f"/{server.token}/{path}", body=body)
            assert (status, json.loads(text)["name"]) == (422, key)
            assert "is no name: must be of letters" in json.loads(text)["error"]


def test_a_port_that_is_taken_is_refused(server):
    with pytest.raises(UsageError, match=r"--port \d+: cannot be taken .*name another port"):
        LiveServer(Bench(SMALL), server.server_address[1])


@pytest.mark.parametrize("port", [-1, 65536, 70000])
def test_a_port_that_is_none_is_refused_before_a_docking(port):
    with pytest.raises(UsageError, match=f"--port {port}: must be 0 to 65535"):
        LiveServer(None, port)


# ------------------------------------------------------------------- refused, newest, stop


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("chaser.mass", "-1", "must be greater than 0"),
        ("friction.coefficient", "3", "above its maximum 2"),
        ("mechanism.set.latches.range", "0", "must be greater than 0"),
        ("initial.pitch_yaw_deg", "45", "must be less than 30"),
        ("no.such", "1", "a scene has no key 'no.such'"),
        ("solver.method", "bdff", "did you mean 'bdf'?"),
        ("experiment.stop", "1e6", "a page has at most 100000"),
    ],
)
def test_a_refused_setting_is_named_with_the_sentence_of_the_core(name, text, words):
    bench = Bench(DEFAULT, ["experiment.stop=0.1"])
    with pytest.raises(RefusedError, match=re.escape(words)) as caught:
        bench.compute({"initial.closing_speed": "0.08", name: text})
    assert caught.value.name == name
    assert len(bench.compute({}).time) == 11  # the scene before still works


def test_a_boolean_is_no_number():
    bench = Bench(SMALL)
    bench.compute({"chaser.mass_includes_mechanism": "1"})
    with pytest.raises(RefusedError):
        bench.compute({"chaser.mass_includes_mechanism": "true"})


def start_long(bench, what="compute"):
    """Begin a docking that takes minutes, in a thread; returns the thread and what became of it."""
    ends = []

    def work():
        try:
            getattr(bench, what)(LONG)
            ends.append("done")
        except DroppedError:
            ends.append("dropped")

    thread = threading.Thread(target=work)
    thread.start()
    time.sleep(0.5)
    assert thread.is_alive()
    return thread, ends


def test_the_newest_request_ends_those_before():
    bench = Bench(DEFAULT)
    first, ends = start_long(bench)
    second, more = start_long(bench)
    began = time.monotonic()
    assert len(bench.compute({"experiment.stop": "0.1"}).time) == 11
    assert time.monotonic() - began < 5.0
    for thread in (first, second):
        thread.join(5.0)
    assert (ends, more) == (["dropped"], ["dropped"])


@pytest.mark.parametrize("what", ["compute", "estimate"])
def test_stop_ends_what_is_computed(what):
    bench = Bench(DEFAULT)
    thread, ends = start_long(bench, what)
    bench.stop()
    thread.join(5.0)
    assert ends == ["dropped"]
    assert len(bench.compute({"experiment.stop": "0.1"}).time) == 11


def test_errors_are_those_of_the_second_run_of_the_command(server):
    settings = {"initial.closing_speed": "0.2"}
    body = {"settings": settings}
    status, _, text = ask(server, path=f"/{server.token}/errors", body=body)
    assert status == 200
    answer = json.loads(text)
    start = {"initial.closing_speed": 0.2}
    result = dl.run(SMALL, start, estimate_error=True)
    assert answer["sentence"] == result.error_estimate["sentence"]
    used = dict(result.error_estimate["second_run"])
    del used["evaluations"]
    tighter = json.loads(json.dumps(condense(dl.run(SMALL, start, used))))
    assert answer["tighter"] == tighter
    own = condense(result)["peak_loads"]["compression"]["value"]
    assert 0.0 < abs(own - tighter["peak_loads"]["compression"]["value"]) < 1e-6 * own


def test_errors_that_cannot_be_had_have_a_sentence(server):
    for settings, name, words in (
        ({"outputs.groups": '["relative", "capture", "phase"]'}, "outputs.groups", "'solver'"),
        ({"chaser.mass": "-1"}, "chaser.mass", "must be greater than 0"),
    ):
        path, body = f"/{server.token}/errors", {"settings": settings}
        status, _, text = ask(server, path=path, body=body)
        answer = json.loads(text)
        assert (status, answer["name"]) == (422, name)
        assert words in answer["error"]


def test_a_docking_at_a_boundary_has_no_errors(monkeypatch):
    estimate = {"error": None, "figures": {}, "sentence": "the outcome depends on the last digits"}

    def find(run, repeat):
        repeat({"accuracy": 0.0})
        return estimate

    monkeypatch.setattr("dockloop.live.bench.estimate_error", find)
    answer = Bench(SMALL).estimate({})
    assert answer == {"sentence": estimate["sentence"], "tighter": None}


def test_a_dropped_request_and_a_refused_one_have_their_status(server):
    assert run(server, {"chaser.mass": "-1"})[0] == 422
    status, answer = run(server, {"initial.closing_speed": "0.05"}, brief=True)
    assert status == 200
    assert set(answer) == {"summary"}
    assert ask(server, path=f"/{server.token}/stop")[0] == 200


def test_memory_stays_flat_over_many_changes(server):
    def change(count):
        for k in range(count):
            settings = {"initial.closing_speed": f"{0.05 + 1e-4 * k}", "experiment.stop": "0.5"}
            assert run(server, settings)[0] == 200

    change(10)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        change(30)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 300_000  # a recording has 66 kB, its page 35 kB


# ------------------------------------------------------------------- the command


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_prints_the_address_and_ends_at_once(tmp_path, number):
    own = tmp_path / "tmp"
    own.mkdir()
    # Where tests run in the background, Ctrl-C is ignored, and that is inherited.
    command = (shutil.which("env"), "--default-signal=INT")
    program = subprocess.Popen(
        [*command, sys.executable, "-m", "dockloop", "live", SMALL, "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={"TMPDIR": str(own), "PATH": "", "HOME": str(own)},
    )
    with program:
        url = program.stdout.readline().strip()
        found = re.fullmatch(r"http://(127\.0\.0\.1):(\d+)/([\w-]{43})/", url)
        assert found, url
        connection = http.client.HTTPConnection(found[1], int(found[2]), timeout=60)
        connection.request("GET", f"/{found[3]}/")
        assert connection.getresponse().read()  # the connection stays open
        program.send_signal(number)
        try:
            _, err = program.communicate(timeout=20)  # half a second on a quiet machine
        finally:
            program.kill()
        connection.close()
    assert program.returncode == 130
    assert err == "dockloop: interrupted\n"
    assert list(own.iterdir()) == []
    assert [path.name for path in tmp_path.iterdir()] == ["tmp"]
    again = LiveServer(Bench(SMALL), int(found[2]))  # the port is free
    again.server_close()


def test_the_browser_opens_while_the_server_serves(monkeypatch):
    seen = []

    def browse(url):
        try:
            host, key = re.fullmatch(r"http://([^/]+)(/.*)", url).groups()
            connection = http.client.HTTPConnection(host, timeout=10)
            connection.request("GET", key)
            seen.append(connection.getresponse().status)
            connection.close()
        finally:
            _thread.interrupt_main()
        return True

    monkeypatch.setattr(webbrowser, "open", browse)
    # Where tests run in the background, Ctrl-C is ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            live.run(Namespace(scene=SMALL, overrides=[], port=0, no_browser=False))
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [303]
