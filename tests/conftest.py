"""Shared by the Python tests: the command line in this process, FMUs and runs made once.

The C++ parts must be compiled (scripts/test does that); tests never build them. Tests may run in
several processes (pytest -n, of pytest-xdist), which share their FMUs.
"""

import fcntl
import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

# Threads of numpy's linear algebra wait for each other on small matrices, on busy cores for long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dockloop as dl
from dockloop import cli
from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from dockloop.native.compiled import add_comparison
from dockloop.result.recording import Result

if TYPE_CHECKING:
    from mishaps import Cluster

LONGEST = (
    *("test_binary", "test_ssp", "test_random_mechanisms", "test_extremes", "test_coupling"),
    *("test_sweep", "test_sweep_journal", "test_sweep_tables", "test_examples", "test_fmu"),
    *("test_cli", "test_kernel", "test_saved_states"),
)
FMUS = "DOCKLOOP_TEST_FMUS"  # environment variable with the folder of all FMUs
NATIVE = "DOCKLOOP_BUILD"  # where it is set, FMUs hold the library of that folder
SCENES = sorted(file.stem for file in paths.SCENES.glob("*.toml"))


class Outcome(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


class Runs:
    """Builds FMUs and runs dockings, each combination once per test session.

    An FMU is built once for all processes, a docking is run once in each that asks for it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def fmu(self, scene: str, *overrides: str) -> Path:
        """Return the bare FMU of a scene with overrides: all that a run needs."""
        return self._build(scene, overrides, bare=True)

    def complete_fmu(self, scene: str, *overrides: str) -> Path:
        """Return the FMU as users get it, with documentation and sources."""
        return self._build(scene, overrides, bare=False)

    def comparing_fmu(self, scene: str, *overrides: str) -> Path:
        """Return a bare FMU with the library that carries the methods for comparison too."""
        return self._build(scene, overrides, bare=True, finish=add_comparison)

    def _build(
        self,
        scene: str,
        overrides: tuple[str, ...],
        *,
        bare: bool,
        finish: Callable[[Path], None] | None = None,
    ) -> Path:
        kind = (scene, overrides, bare, finish is not None, os.environ.get(NATIVE))
        key = hashlib.sha256(repr(kind).encode()).hexdigest()[:16]
        fmu = self._folder / key / f"{Path(scene).stem}.fmu"
        fmu.parent.mkdir(exist_ok=True)
        with (fmu.parent / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another process may build the same one
            if not fmu.exists():
                build_fmu(scene, overrides, fmu, bare=bare, finish=finish)
            return fmu

    def run(
        self,
        scene: str,
        *overrides: str,
        settings: tuple[str, ...] = (),
        stop: float | None = None,
        step: float | None = None,
    ) -> Result:
        """Return the recording of one docking."""
        return self._run(self.fmu(scene, *overrides), settings, stop, step)

    @functools.cache
    def _run(self, fmu: Path, *how: Any) -> Result:
        return run_fmu(fmu, *how)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest: at the end no process is left alone with it."""
    items.sort(key=lambda item: (*LONGEST, item.path.stem).index(item.path.stem))


def pytest_configure(config: pytest.Config) -> None:
    """Make the folder of all FMUs, once for all processes."""
    if not hasattr(config, "workerinput"):  # what processes of pytest-xdist have
        folder = tempfile.TemporaryDirectory(prefix="dockloop-test-")
        config.add_cleanup(folder.cleanup)
        os.environ[FMUS] = folder.name


@pytest.fixture(scope="session")
def runs() -> Runs:
    """FMUs and recordings shared by all tests."""
    return Runs(Path(os.environ[FMUS]))


@pytest.fixture(scope="module")
def native() -> Iterator[None]:
    """FMUs hold the library that was compiled with the core: another compiler rounds otherwise.

    Those that a test builds, and those of the processes that it starts.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(NATIVE, str(paths.COMPILED))
        yield


@pytest.fixture(scope="session")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The default docking with an imported mechanism, as in modelDescription/IMPORT.md."""
    mine = dl.import_mechanism(paths.ROOT / "scripts/examples/stewart.sdf", ring="ring").document
    shipped = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    mine |= {member: shipped[member] for member in ("contact", "latches", "limits")}
    folder = tmp_path_factory.mktemp("imported")
    (folder / "stewart.json").write_text(json.dumps(mine))
    scene = (paths.SCENES / "idss_25t_350t.toml").read_text()
    (folder / "first.toml").write_text(scene.replace('"idss_hexapod"', '"stewart"'))
    return folder / "first.toml"


@pytest.fixture
def permissions(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Skip a test where permissions of files do not bind this process, as those of root."""
    folder = tmp_path_factory.mktemp("closed")
    folder.chmod(0o500)
    try:
        (folder / "file").touch()
    except PermissionError:
        return
    pytest.skip("this process may read and write everything")


@pytest.fixture
def own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


class CommandLine:
    """The command line in this process."""

    def __init__(self, capsys: pytest.CaptureFixture) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: object) -> Outcome:
        """Call a command."""
        try:
            status = cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
        return Outcome(status, *self._capsys.readouterr())

    def succeed(self, *arguments: object) -> Outcome:
        """Call a command that must not fail."""
        outcome = self(*arguments)
        assert outcome.status == 0, outcome
        return outcome

    def read(self, *arguments: object) -> Any:
        """Return what a command prints as JSON."""
        return json.loads(self.succeed(*arguments).out)


@pytest.fixture
def dockloop(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, own_folder: Path
) -> CommandLine:
    """Call the command line in an empty folder; results go there too."""
    monkeypatch.setattr(paths, "BUILD", own_folder / "build")
    return CommandLine(capsys)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator["Cluster"]:
    """Two worker processes of a scheduler that sweeps reach by its address."""
    from mishaps import Cluster

    two = Cluster(tmp_path_factory.mktemp("cluster"))
    yield two
    two.close()


@pytest.fixture(scope="module")
def reference(cluster: "Cluster", tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The sweep SHORT and its table from two workers."""
    from small_sweeps import SHORT, run_table, write

    folder = tmp_path_factory.mktemp("reference")
    path = write(folder, SHORT)
    return path, run_table(path, folder / "mine.parquet", scheduler=cluster.scheduler_address)


@pytest.fixture(scope="module")
def server():
    """Serve the live page of a light scene."""
    from live_pages import SMALL, serve

    with serve(SMALL) as made:
        yield made
