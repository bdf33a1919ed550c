"""Shared by the Python tests: the command line in this process, FMUs and runs made once.

The C++ parts must be compiled (scripts/test does that); tests never build them.
"""

import functools
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

# Threads of numpy's linear algebra wait for each other on small matrices, on busy cores for long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dockloop import cli, paths
from dockloop.fmu import build_fmu
from dockloop.simulate import Recording, run_fmu

SCENES = sorted(file.stem for file in paths.SCENES.glob("*.toml"))


class Outcome(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


class Runs:
    """Builds FMUs and runs dockings, each combination once per test session."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._count = 0

    @functools.cache
    def fmu(self, scene: str, *overrides: str) -> Path:
        """Return the FMU of a scene with overrides."""
        self._count += 1
        return build_fmu(scene, overrides, self._folder / str(self._count) / f"{scene}.fmu")

    @functools.cache
    def run(
        self,
        scene: str,
        *overrides: str,
        settings: tuple[str, ...] = (),
        stop: float | None = None,
        step: float | None = None,
    ) -> Recording:
        """Return the recording of one docking."""
        return run_fmu(self.fmu(scene, *overrides), settings, stop, step)


@pytest.fixture(scope="session")
def runs() -> Iterator[Runs]:
    """FMUs and recordings shared by all tests."""
    with tempfile.TemporaryDirectory(prefix="dockloop-test-") as folder:
        yield Runs(Path(folder))


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
def dockloop(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[..., Outcome]:
    """Call the command line in an empty folder; results go there too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(paths, "BUILD", tmp_path / "build")

    def call(*arguments: str) -> Outcome:
        try:
            status = cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
        return Outcome(status, *capsys.readouterr())

    return call
