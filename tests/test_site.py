"""The site of all pages (scripts/site) is whole, and opens from a disk.

1. It builds; a dead link, a dead anchor or a page without a place ends the build, with the place.
2. Every page of the repository has a page there, and every file that a page links to is there.
3. Links lead to files and headings that exist. Nothing is asked of another host, and no folder of
   this machine is named. (`find_faults` says so in the build; here is what it finds.)
4. Chromium opens pages without a message, and its search finds a page. Wide tables stay inside a
   narrow window.
5. Every public name of the package has its docstring there, every command its help; names of the
   default scene are listed.
6. Every shipped scene has a picture and a view; without Chromium the picture is a drawing.
7. Another folder is not replaced; an option that is not known is refused.
"""

import json
import re
import sys
import time

import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import DockloopError
from dockloop.commands import COMMANDS
from dockloop.view.browser import Browser, find_browser
from programs import call, run
from test_words import list_files

pytestmark = pytest.mark.long  # a minute: the dockings of the gallery, and all pages

PLACE = paths.ROOT / "scripts" / "lib" / "site"
MAKE = PLACE / "make.py"
SCENES = sorted(file.stem for file in paths.SCENES.glob("*.toml"))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, made once; index.html was there before, as an older site."""
    folder = tmp_path_factory.mktemp("site") / "made"
    folder.mkdir()
    call(sys.executable, MAKE, "-o", folder)
    return folder


@pytest.fixture
def make(monkeypatch):
    """The modules that make a site."""
    monkeypatch.syspath_prepend(str(PLACE))
    import make

    return make


def read(path):
    return path.read_text(encoding="utf-8")


def test_every_page_has_a_page(site):
    pages = [name for name in list_files() if name.endswith(".md")]
    assert len(pages) > 60
    missing = [name for name in pages if not (site / name).with_suffix(".html").is_file()]
    assert not missing, "give them a place in scripts/lib/site/contents.toml"
    assert read(site / "index.html") == read(site / "README.html")


def test_links_to_sources_lead_to_copies(site):
    copies = {path.name: path for path in (site / "_downloads").rglob("*") if path.is_file()}
    assert {"stewart.sdf", "docking.ipynb", "solver_methods.cpp"} <= set(copies)
    assert read(copies["stewart.sdf"]) == read(paths.ROOT / "scripts/examples/stewart.sdf")


def test_every_fault_of_a_site_is_found(make, tmp_path):
    (tmp_path / "good.html").write_text(
        '<h1 id="top">A</h1><a href="#top">b</a><a href="https://x.y">c</a><img src="data:,">'
    )
    (tmp_path / "bad.html").write_text(
        '<a href="gone.html">a</a><a href="good.html#gone">b</a><img src="https://x.y/z.png">'
        '<script src="//x.y/z.js"></script><img src="gone.png"><p>/home/machine/a ../home/machine'
    )
    (tmp_path / "bad.css").write_text("@import 'https://x.y/font.css'; a {background: url(//x.y)}")
    assert make.find_faults(tmp_path, ("/home/machine",)) == [
        "bad.html: 'gone.html' leads to no file",
        "bad.html: 'good.html#gone' leads to no heading",
        "bad.html: <img> asks https://x.y/z.png",
        "bad.html: <script> asks //x.y/z.js",
        "bad.html: 'gone.png' leads to no file",
        "bad.css: asks https://x.y/font.css",
        "bad.css: asks //x.y",
        "bad.html: speaks of /home/machine",
    ]


def test_a_dead_link_ends_the_build(make, tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    text = "# A\n\n[a](gone.md) [b](#gone) [c](README.md#a)\n\n![d](gone.png)\n"
    (source / "README.md").write_text(text)
    (tmp_path / "extra").mkdir()
    with pytest.raises(DockloopError) as failure:
        make.build(source, tmp_path / "made", tmp_path / "extra")
    message = str(failure.value)
    for wrong in ("'gone.md'", "'gone'", "image file not readable: gone.png"):
        assert re.search(rf"README.md:\d+: WARNING: .*{re.escape(wrong)}", message), message
    assert "README.md#a" not in message


def test_chromium_opens_pages_and_finds_words(site):
    if not find_browser():
        pytest.skip("needs Chromium")
    with Browser(390, 800) as browser:

        def wait(page, code):
            browser.call("Page.navigate", url=f"{site.resolve().as_uri()}/{page}")
            end = time.monotonic() + 60.0
            while not browser.run(code):
                assert time.monotonic() < end, (page, browser.messages)
                time.sleep(0.05)

        wait("search.html?q=drogue", "document.querySelectorAll('ul.search li').length > 3")
        links = browser.run("[...document.querySelectorAll('ul.search a')].map(a => a.href)")
        assert any("PROBE_DROGUE.html" in link for link in links)
        for page in ("index", "api", "modelDescription/FORMATS", "tests/validation/published"):
            wait(
                f"{page}.html",
                f"location.href.includes('{page}') && document.readyState == 'complete'",
            )
            assert browser.run("document.documentElement.scrollWidth") <= 390, page
        assert not browser.messages


def test_the_search_has_words_of_all_kinds_of_pages(site):
    index = json.loads(read(site / "searchindex.js").removeprefix("Search.setIndex(")[:-1])
    names = index["docnames"]

    def find(word):
        found = index["terms"][word]
        return {names[i] for i in (found if isinstance(found, list) else [found])}

    assert "scripts/tutorials/OWN_MECHANISM" in find("pawl")
    assert "modelDescription/HEXAPOD" in find("rotor")
    assert {"api", "commands"} <= find("worker")


def test_every_public_name_has_its_docstring(site):
    page = read(site / "api.html")
    for name in dl.__all__:
        assert f'id="dockloop.{name}"' in page
        first = getattr(dl, name).__doc__.split(":")[0].split(".")[0].split("`")[0].strip()
        assert " ".join(first.split()) in " ".join(page.split()), name
    page = read(site / "names.html")
    assert all(f">{name}<" in page for name in ("chaser.mass", "leg[1].length", "outcome"))
    page = read(site / "commands.html")
    assert all(f'id="dockloop-{name}"' in page for name in COMMANDS)


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_a_picture_and_a_view(site, scene):
    page = read(site / "gallery.html")
    picture = re.search(rf'<a href="gallery/{scene}.html"><img src="(gallery/{scene}.\w+)"', page)[
        1
    ]
    assert (site / picture).stat().st_size > 4_000
    view = read(site / "gallery" / f"{scene}.html")
    assert "made by dockloop view" in view
    assert "<script src=" not in view


@pytest.mark.parametrize("scene", ["absorber_1d", "probe_drogue"])
def test_without_chromium_there_are_drawings(make, monkeypatch, tmp_path, scene):
    import gallery

    monkeypatch.setattr(gallery, "find_browser", lambda: None)
    assert f'<img src="gallery/{scene}.svg"' in gallery.draw_scene(scene, tmp_path)
    assert read(tmp_path / f"{scene}.svg").startswith("<svg")


def test_another_folder_is_not_replaced(make, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(dl.UsageError, match="no site of scripts/site"):
        make.make_site(tmp_path)
    with pytest.raises(dl.UsageError, match="no site of scripts/site"):
        make.make_site(tmp_path / "mine.txt")
    assert read(tmp_path / "mine.txt") == "mine"


def test_a_site_is_replaced(site, make):
    make.claim_folder(site)


def test_bad_usage_is_refused():
    done = run(paths.ROOT / "scripts" / "site", "--fast")
    assert done.returncode == 2
    assert done.stderr == "error: scripts/site knows -o FOLDER and --help, not '--fast'\n"
