"""The page of ``dockloop live`` in Chromium.

Sliders, undo, link, refusals, the kept docking, the strip, the map, what is taken home, keys, 390
px. Requests that no page makes: test_live.py.
"""

import json
import re
import shlex
import time

import pytest

from dockloop.live.bench import Bench, condense, find_range
from dockloop.live.export import make_exports
from dockloop.view import browser as chromium
from live_pages import LONG, REFINED, SMALL, Online, list_own_options, serve
from programs import needs_browser

DEFAULT = "idss_25t_350t"


@pytest.fixture(scope="module")
def online():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chromium, "_OPTIONS", list_own_options())
        yield Online


@pytest.fixture(scope="module")
def window(online, server):
    with online(1280, 800) as opened:
        opened.open(server.url)
        yield opened


ROW = "[...document.querySelectorAll('.setting')].find((e) => e.dataset.name === '{}')"


def drag(window, name, position):
    """Move a slider as its user does: some places, then the last."""
    places = (
        f"[500, {position}].forEach((k) => {{ s.value = k; s.dispatchEvent(new Event('input')); }})"
    )
    window.run(
        f"(() => {{ const s = {ROW.format(name)}.querySelector('[type=range]'); {places};"
        " s.dispatchEvent(new Event('change')); })()"
    )


@pytest.mark.long
@needs_browser
def test_a_slider_computes_the_docking_anew_and_refines_it(window):
    window.run("live.change('initial.closing_speed', '0.1')")
    drag(window, "initial.closing_speed", 250)
    window.wait(f"{REFINED} && live.settings.length === 1")
    ((name, text),) = window.run("live.settings")
    assert name == "initial.closing_speed"
    expected = condense(Bench(SMALL).compute({name: text}))
    assert window.run("live.summary") == json.loads(json.dumps(expected))
    assert window.run("dockloop.data.events.find((e) => e.key === 'contact').time") == 0.0
    assert "compression" in window.read("figures")
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
def test_undo_redo_reset_and_the_link(window, server):
    window.run("document.getElementById('reset').click()")
    window.wait("live.settings.length === 0")
    drag(window, "chaser.mass", 300)
    window.wait(REFINED)
    changed = window.run("live.settings")
    link = window.run("location.href")
    assert link.startswith(f"{server.url}#")
    window.run("document.getElementById('undo').click()")
    assert window.run("live.settings") == []
    window.run("document.getElementById('redo').click()")
    assert window.run("live.settings") == changed
    window.run("document.getElementById('reset').click()")
    assert window.run("live.settings") == []
    assert window.run("location.hash") == ""
    for key, code, expected in (("z", "KeyZ", changed), ("y", "KeyY", [])):
        hit(window, key, code, ord(key) - 32, modifiers=2)
        assert window.run("live.settings") == expected
    for _ in range(2):
        window.run("document.getElementById('undo').click()")
    assert window.run("live.settings") == []
    window.run(f"location.hash = {link.partition('#')[2]!r}")
    window.wait(f"live.settings.length === 1 && {REFINED}")
    assert window.run("live.settings") == changed
    assert window.run("document.getElementById('redo').disabled")  # what followed another state


@pytest.mark.long
@needs_browser
def test_a_refusal_stands_at_the_field_and_goes_again(window):
    window.run("live.change('chaser.mass', '-1')")
    row = ROW.format("chaser.mass")
    window.wait(f"{row}.querySelector('.why').textContent")
    assert "must be greater than 0" in window.run(f"{row}.querySelector('.why').textContent")
    assert window.run(f"{row}.querySelector('[type=text]').getAttribute('aria-invalid')") == "true"
    window.run("live.change('chaser.mass', '')")
    window.wait(REFINED)
    assert window.run("document.querySelectorAll('[aria-invalid]').length") == 0


@pytest.mark.long
@needs_browser
def test_every_name_is_found_and_can_be_set(window):
    find = "document.getElementById('find')"
    window.run(f"{find}.value = 'relative tolerance'; {find}.dispatchEvent(new Event('input'))")
    assert "solver.rtol" in window.read("found")
    hits = "[...document.querySelectorAll('#found button')]"
    window.run(f"{hits}.find((e) => e.textContent.startsWith('solver.rtol = 1e-')).click()")
    assert window.run(f"Boolean({ROW.format('solver.rtol')})")


@pytest.mark.long
@needs_browser
def test_strip(window):
    start_again(window)
    drag(window, "initial.closing_speed", 250)
    window.wait("live.cells.filter(Boolean).length === 33")
    cells = window.run("live.cells")
    whole = condense(Bench(SMALL).compute({"initial.closing_speed": "1"}, is_coarse=True))
    assert cells[32]["outcome"] == whole["outcome"]
    click(window, 0.99, 0.5)
    assert window.run("live.settings") == [["initial.closing_speed", "1"]]
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
def test_a_kept_docking_is_compared_with_the_error_of_each_figure(window):
    start_again(window)
    base = Bench(SMALL)
    loose = {"solver.rtol": "1e-5"}
    window.run("live.change('solver.rtol', '1e-5'); live.commit()")
    window.wait(REFINED)
    click_button(window, "keep")
    assert "..." in window.read("figures")
    speed = base.entries["initial.closing_speed"].default
    for change, is_within in ((1e-9, True), (1e-2, False)):
        settings = loose | {"initial.closing_speed": repr(speed * (1.0 + change))}
        for name, text in settings.items():
            window.run(f"live.change({name!r}, {text!r})")
        window.run("live.commit()")
        window.wait(f"{REFINED} && live.settings.length === 2")
        window.wait("!document.getElementById('figures').textContent.includes('...')")
        (x, e), (kept, its) = (
            (own, abs(own - tight))
            for own, tight in (
                (read_peak(condense(base.compute(one))), read_peak(base.estimate(one)["tighter"]))
                for one in (settings, loose)
            )
        )
        now, other, said = window.run(
            "[...[...document.querySelectorAll('#figures tbody tr')].find((row) =>"
            " row.firstChild.firstChild.data === 'compression').querySelectorAll('td')]"
            ".map((cell) => [...cell.childNodes].map((node) => node.textContent))"
        )
        assert float(now[1].removeprefix("± ")) == pytest.approx(e, rel=0.06)
        assert float(other[1].removeprefix("± ")) == pytest.approx(its, rel=0.06)
        assert is_within == (abs(x - kept) <= e + its)
        assert said[1] == ("within error" if is_within else "")
    assert "error of the kept one: about" in window.run("document.getElementById('figures').title")
    click_button(window, "forget")
    assert "kept" not in window.read("figures")
    start_again(window)
    groups = '["relative", "capture", "phase"]'
    window.run(f"live.change('outputs.groups', '{groups}'); live.commit()")
    window.wait(f"{REFINED} && live.settings.length === 1")
    click_button(window, "keep")
    window.wait("document.getElementById('figures').textContent.includes('not known')")
    assert "needs the outputs 'solver'" in window.run("document.getElementById('figures').title")
    click_button(window, "forget")
    start_again(window)
    assert window.find_bad() == []


def read_peak(summary):
    return summary["peak_loads"]["compression"]["value"]


def start_again(window):
    """Reset all settings and wait until the docking is the first one."""
    click_button(window, "reset")
    window.wait(f"live.settings.length === 0 && {REFINED}")


def hit(window, key, code, virtual, **more):
    """Press a key and let it go."""
    more |= {"key": key, "code": code, "windowsVirtualKeyCode": virtual}
    for kind in ("keyDown", "keyUp"):
        window.call("Input.dispatchKeyEvent", type=kind, **more)


def click_button(window, name):
    window.run(f"document.getElementById({name!r}).click()")


def click(window, right, up):
    """Click into the strip or the map, at parts of its size."""
    window.run(
        "(() => { const sheet = document.querySelector('.setting canvas');"
        " const b = sheet.getBoundingClientRect();"
        f" const place = {{ clientX: b.left + {right} * b.width,"
        f" clientY: b.bottom - {up} * b.height }};"
        " sheet.dispatchEvent(new MouseEvent('click', place)); })()"
    )


def press(window, key):
    window.run(
        "document.querySelector('.setting canvas').dispatchEvent("
        f"new KeyboardEvent('keydown', {{ key: {key!r}, bubbles: true, cancelable: true }}))"
    )


@pytest.mark.long
@needs_browser
def test_map_over_two_quantities(window):
    start_again(window)
    drag(window, "initial.closing_speed", 250)
    window.wait(f"{REFINED} && live.cells.length")
    second = "document.querySelector('.second select')"
    window.run(f"{second}.value = 'chaser.mass'; {second}.dispatchEvent(new Event('change'))")
    window.wait("live.cells.length === 33 * 17 && live.cells.filter(Boolean).length >= 20")
    cells = window.run("live.cells")  # four corners come first
    assert all(cells[at] for at in (0, 32, 16 * 33, 17 * 33 - 1))
    click(window, 0.99, 0.01)
    speed = find_range(Bench(SMALL).entries["initial.closing_speed"])[1]
    mass = find_range(Bench(SMALL).entries["chaser.mass"])[0]
    expected = {"initial.closing_speed": speed, "chaser.mass": mass}
    assert {k: float(v) for k, v in window.run("live.settings")} == pytest.approx(expected)
    window.wait(REFINED)
    corner = condense(Bench(SMALL).compute(dict(window.run("live.settings")), is_coarse=True))
    assert cells[32]["outcome"] == corner["outcome"]
    window.wait("live.cells.filter(Boolean).length > 25")  # goes on with the same cells
    for key in ("ArrowUp", "ArrowUp", "ArrowLeft"):
        press(window, key)
    said = "document.querySelector('.setting output.words').textContent"
    assert window.run(said).startswith("chaser.mass ")
    assert ", closing_speed 0." in window.run(said)
    press(window, "Enter")
    first, then = window.run("[live.settings.length, live.cells.length]")
    assert (first, then) == (2, 33 * 17)
    chosen = dict(window.run("live.settings"))
    assert float(chosen["initial.closing_speed"]) < speed
    assert float(chosen["chaser.mass"]) > mass
    window.run(f"{second}.value = ''; {second}.dispatchEvent(new Event('change'))")
    window.wait(f"{REFINED} && live.cells.length && live.cells.length <= 33")
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
def test_the_layout_does_not_jump(window):
    places = "['space', 'slider', 'curves', 'settings'].map((id) => {"
    places += " const b = document.getElementById(id).getBoundingClientRect();"
    places += " return [b.left, b.top, b.width]; })"
    window.wait(REFINED)
    before = window.run(places)
    for position in (100, 400, 900):
        drag(window, "initial.closing_speed", position)
        window.wait(REFINED)
        window.settle()
        assert window.run(places) == before


@pytest.mark.long
@needs_browser
def test_a_default_follows_and_can_be_set(window):
    window.run("document.getElementById('reset').click()")
    window.run("live.change('chaser.mass', '25000')")
    assert window.run("live.settings") == [["chaser.mass", "25000"]]
    window.run("live.change('chaser.mass', '')")
    assert window.run("live.settings") == []
    window.run("live.change('contact.stiffness', '')")  # the row of a name that was found
    window.run("live.change('mechanism.set.contact.stiffness', '30000'); live.commit()")
    window.wait(f"{ROW.format('contact.stiffness')}.querySelector('[type=text]').value === '30000'")
    assert len(window.run("live.settings")) == 1
    spans = f"{ROW.format('mechanism.set.contact.stiffness')}.querySelector('label span')"
    assert window.run(f"{spans}.textContent") == "mechanism.set.contact.stiffness"


@pytest.mark.long
@needs_browser
def test_the_docking_that_is_shown_is_taken_home(window):
    window.run("document.getElementById('reset').click()")
    window.run("live.change('initial.closing_speed', '0.07'); live.commit()")
    window.wait(REFINED)
    window.run("live.change('chaser.mass', '-1'); live.commit()")
    window.wait("document.getElementById('status').textContent.startsWith('refused')")
    window.run("document.getElementById('text').value = ''")
    window.run("document.querySelector('#home [data-text=command]').click()")
    text = "document.getElementById('text').value"
    window.wait(text)
    words = shlex.split(window.run(text))
    assert words[:3] == ["dockloop", "run", SMALL]
    assert words[3:] == ["--scene", "initial.closing_speed=0.07", "--no-kernel"]
    window.run("document.getElementById('link').click()")
    assert "chaser" not in window.run(text)
    assert "0.07" in window.run(text)


TEXT = "document.getElementById('text').value"
SAVED = """(() => {
  window.saved = [];
  window.make = window.make || URL.createObjectURL;
  URL.createObjectURL = (blob) => { saved.push(blob); return make(blob); };
  HTMLAnchorElement.prototype.click = function () { saved.push(this.download); };
})()"""


@pytest.mark.long
@needs_browser
@pytest.mark.parametrize("what", ["command", "report", "film", "python", "scene", "PNG"])
def test_all_that_is_taken_home(window, what):
    start_again(window)
    window.run(f"{SAVED}; {TEXT} = ''")
    chosen = "#picture" if what == "PNG" else f"[data-text={what}]"
    window.run(f"document.querySelector('#home {chosen}').click()")
    if what == "PNG":
        window.wait("saved.length === 2")
        assert window.run("saved[1]") == f"{SMALL}.png"
        bytes_ = "saved[0].arrayBuffer().then((a) => [...new Uint8Array(a).slice(0, 4)])"
        assert bytes(window.run(bytes_)) == b"\x89PNG"
    else:
        window.wait(TEXT)
        expected = make_exports(Bench(SMALL), {})[what]
        assert window.run(TEXT) == expected
        if what == "scene":
            assert window.run("saved[1]") == f"{SMALL}_live.toml"
            assert window.run("saved[0].text()") == expected
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
@pytest.mark.parametrize("how", ["button", "escape"])
def test_a_long_docking_is_stopped_in_the_page(window, how):
    start_again(window)
    stop = "document.getElementById('stop')"
    for name, text in (LONG | {"solver.step": "1e-6"}).items():
        window.run(f"live.change({name!r}, {text!r})")
    window.run("live.commit()")
    window.wait(f"!{stop}.disabled")
    began = time.monotonic()
    if how == "button":
        click_button(window, "stop")
    else:
        hit(window, "Escape", "Escape", 27)
    assert window.read("status") == "stopped"
    assert window.run(f"{stop}.disabled")
    start_again(window)  # the server computes the next one
    assert time.monotonic() - began < 20.0
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
def test_keys_of_the_panel(window):
    start_again(window)
    window.run("document.activeElement.blur()")  # a field takes the letter
    hit(window, "/", "Slash", 191, text="/")
    assert window.run("document.activeElement.id") == "find"
    assert window.run("document.activeElement.value") == ""
    slider = f"{ROW.format('chaser.mass')}.querySelector('[type=range]')"
    window.run(f"{slider}.focus()")
    before = window.run(f"{slider}.valueAsNumber")
    for key, virtual, places in (("PageUp", 33, 100), ("PageDown", 34, 0), ("ArrowRight", 39, 1)):
        hit(window, key, key, virtual)
        assert window.run(f"{slider}.valueAsNumber") == before + places
        window.wait(REFINED)
    ((name, _),) = window.run("live.settings")
    assert name == "chaser.mass"
    assert window.find_bad() == []


@pytest.mark.long
@needs_browser
def test_the_live_page_is_usable_at_390_px(online, server):
    with online(390, 844, 2.0) as small:
        small.open(server.url)
        small.settle()
        assert small.run("document.documentElement.scrollWidth") == 390
        boxes = "[...document.querySelectorAll('#live button, #live input')]"
        boxes += ".map((e) => e.getBoundingClientRect()).filter((b) => b.height)"
        assert small.run(f"Math.min(...{boxes}.map((b) => b.height))") >= 28
        assert small.run(f"Math.max(...{boxes}.map((b) => b.right))") <= 390
        sizes = "[...document.querySelectorAll('body *')].filter((e) => e.textContent.trim())"
        sizes += ".map((e) => parseFloat(getComputedStyle(e).fontSize))"
        assert small.run(f"Math.min(...{sizes})") >= 11


@pytest.mark.long
@needs_browser
def test_a_kept_docking_leaves_the_part_of_rated_loads(online):
    with serve(DEFAULT) as other:
        for width in (1280, 390):
            with online(width, 844) as page:
                page.open(other.url)
                click_button(page, "keep")
                found = "[...document.querySelectorAll('#figures th small')]"
                texts = page.run(f"{found}.map((e) => e.textContent)")
                assert len(texts) == 5
                assert all(re.fullmatch(r"[\d.]+ % of rated", text) for text in texts)
                assert page.run(f"{found}.every((e) => e.scrollWidth <= e.clientWidth)")


@pytest.mark.long
@needs_browser
def test_a_picture_is_half_as_fine_while_a_slow_program_draws_and_the_docking_moves(window):
    start_again(window)
    size = "document.getElementById('space').width"
    full = window.run(size)
    window.run("window.real = performance.now; let t = 0; performance.now = () => (t += 1000)")
    try:
        for is_moving, width in ((False, full), (True, full // 2), (False, full)):
            window.run(f"dockloop.load(dockloop.data, {str(is_moving).lower()})")
            window.settle()
            assert window.run(size) == width
        window.run("performance.now = () => 0")
        for is_moving in (False, True):
            window.run(f"dockloop.load(dockloop.data, {str(is_moving).lower()})")
            window.settle()
            assert window.run(size) == full
    finally:
        window.run("performance.now = window.real; dockloop.load(dockloop.data)")


@pytest.mark.long
@needs_browser
def test_a_request_that_was_overtaken_is_asked_again(window):
    start_again(window)
    window.run(
        "window.real = fetch; let first = true; window.fetch = (...words) => {"
        " if (!first) return window.real(...words); first = false;"
        " return Promise.resolve({ status: 409, json: async () => ({ error: 'newer' }) }); }"
    )
    try:
        drag(window, "initial.closing_speed", 300)
        window.wait(REFINED)
        shown = dict(window.run("live.settings"))
        assert window.run("live.summary") == json.loads(
            json.dumps(condense(Bench(SMALL).compute(shown)))
        )
    finally:
        window.run("window.fetch = window.real")
