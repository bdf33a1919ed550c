"""The package for C++, as users have it: installed, found by CMake, linked by the example.

1. What is installed is one header of the standard library alone, one archive, and the files of
   CMake; nothing names a folder of this machine, and the archive shows no names but its own.
2. The example compiles without warnings and prints the numbers of ``dl.Docking``, bit for bit.
3. ``dockloop build SCENE -o FILE.json`` writes what an FMU holds, and replaces only such files.
4. A file, a variable or a value that is wrong is one sentence.
"""

import json
import re
import zipfile
from pathlib import Path

import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.version import __version__
from dockloop.fmu.build import build_document
from dockloop.scene.carried import MODEL
from programs import call, run
from test_cli import assert_refused

EXAMPLE = paths.ROOT / "scripts" / "examples" / "cpp"
SCENE = "idss_25t_350t"
STRICT = "-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror"

needs_release = pytest.mark.skipif(
    paths.COMPILED.name != "release", reason="the package is that of a release build"
)


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The prefix of the installed package, which has been moved."""
    folder = tmp_path_factory.mktemp("cpp")
    call("cmake", "--install", paths.COMPILED, "--prefix", folder / "first", cwd=folder)
    return (folder / "first").rename(folder / "prefix")


@pytest.fixture(scope="module")
def program(installed) -> Path:
    """The example, compiled as a user does it."""
    build = installed.parent / "build"
    options = [f"-DCMAKE_PREFIX_PATH={installed}", f"-DCMAKE_CXX_FLAGS={STRICT}"]
    call("cmake", "-S", EXAMPLE, "-B", build, *options, cwd=installed.parent)
    call("cmake", "--build", build, cwd=installed.parent)
    return build / "docking_program"


@pytest.fixture(scope="module")
def document(tmp_path_factory) -> Path:
    """The scene as `dockloop build` writes it."""
    file = tmp_path_factory.mktemp("document") / f"{SCENE}.json"
    build_document(SCENE, (), file)
    return file


@needs_release
def test_the_installed_files_are_those_of_the_package(installed):
    files = {str(f.relative_to(installed)): f for f in installed.rglob("*") if f.is_file()}
    kinds = {re.sub(r"^share/doc/dockloop/.*", "share/doc", name) for name in files}
    cmake = "lib/cmake/dockloop/dockloopConfig"
    assert kinds == {
        "include/dockloop/docking.hpp",
        "lib/libdockloop.a",
        *(f"{cmake}{end}.cmake" for end in ("", "-release", "Version")),
        "share/doc",
    }
    for file in files.values():
        content = file.read_bytes()
        assert str(paths.ROOT).encode() not in content, file
        assert str(installed.parent).encode() not in content, file
    assert f'"{__version__}"' in files[f"{cmake}Version.cmake"].read_text()
    header = files["include/dockloop/docking.hpp"].read_text()
    assert all("/" not in name for name in re.findall(r"#include <(.*)>", header))
    assert not re.search(r"#include \"|#define", header)


@needs_release
def test_the_archive_shows_only_the_names_of_its_header(installed):
    archive = installed / "lib" / "libdockloop.a"
    lines = call("nm", "-g", "-C", archive, cwd=installed).splitlines()
    names = [line.split(maxsplit=1) for line in lines if " " in line]
    defined = [rest[2:] for first, rest in names if re.fullmatch(r"[0-9a-f]{16}", first)]
    own = r"((typeinfo|typeinfo name|vtable) for )?dockloop::(Docking|UsageError|StepError)\b"
    assert len(defined) > 20
    assert [name for name in defined if not re.match(own, name)] == []
    needed = {rest for first, rest in names if first == "U"}
    assert not [name for name in needed if re.search("dockloop|SUN|CVode|N_V|Eigen", name)]


@needs_release
def test_the_example_has_the_bits_of_python(program, document):
    setting = ("friction.coefficient", "0.2")
    printed = call(program, document, *setting, cwd=document.parent)
    docking = dl.Docking(SCENE)
    docking.set(setting[0], float(setting[1]))
    while not docking.get("captured"):
        docking.step(0.01)
    captured = docking.time
    while docking.time < captured + 0.5:
        docking.step(0.01)
    peak = docking.get("capture.peak.compression")
    found = [float(number) for number in re.findall(r"(\S+) (?:s|N)\b", printed)]
    assert printed.startswith("captured after ")
    assert found == [captured, peak, peak]
    assert peak > 1000.0


@needs_release
@pytest.mark.parametrize("setting", [("chaser.mass", -1.0), ("phase", 2.0)])
def test_a_refused_value_has_the_sentence_of_python(program, document, setting):
    with pytest.raises(dl.UsageError) as refused:
        dl.Docking(SCENE).set(*setting)
    done = run(program, document, *setting, cwd=document.parent)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"docking_program: {refused.value}\n"


@needs_release
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "usage: FILE.json [NAME VALUE]"),
        (["no.json"], "no.json: no such file: 'dockloop build SCENE -o FILE.json' writes"),
        (["it.fmu"], "it.fmu: is an FMU or another zip file: 'dockloop build"),
        (["own.json"], "own.json: document has format ''; this build reads dockloop-scene/1"),
        (["torn.json"], "torn.json: not a JSON document: "),
        (["DOCUMENT", "chaser.mas", "1"], "there is no variable 'chaser.mas': 'dockloop variables"),
    ],
)
def test_what_is_wrong_is_one_sentence(program, document, tmp_path, words, sentence):
    (tmp_path / "own.json").write_text("{}")
    (tmp_path / "torn.json").write_bytes(document.read_bytes()[:-9])
    (tmp_path / "it.fmu").write_bytes(b"PK")
    words = [document if word == "DOCUMENT" else word for word in words]
    done = run(program, *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"docking_program: {sentence}")
    assert done.stderr.count("\n") == 1


def test_the_document_is_that_of_the_fmu(runs, document):
    with zipfile.ZipFile(runs.fmu(SCENE)) as fmu:
        assert document.read_bytes() == fmu.read(MODEL)


def test_a_document_replaces_only_a_document(dockloop, tmp_path):
    for _ in range(2):
        built = dockloop("build", "absorber_1d", "--scene", "chaser.mass=900", "-o", "mine.json")
        assert (built.status, built.out) == (0, "mine.json\n")
    assert json.loads(Path("mine.json").read_text())["chaser"]["mass"] == 900.0
    for text in ("{}", "no JSON", ""):
        Path("own.json").write_text(text)
        assert_refused(dockloop("build", "absorber_1d", "-o", "own.json"), "choose another -o")
        assert Path("own.json").read_text() == text
    refused = dockloop("build", "absorber_1d", "--reference", "-o", "mine.json")
    assert_refused(refused, "mine.json", "--reference", "FMU")
    assert_refused(dockloop("build", "absorber_1d", "-o", "own.txt"), "must end in .fmu")
