"""Programs that tests run in processes of their own: `run`, `call`, and a browser."""

import subprocess
from typing import Any

import pytest

from dockloop.view.browser import find_browser

needs_browser = pytest.mark.skipif(
    find_browser() is None, reason="Chromium or Chrome is not installed"
)


def run(*words: object, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run a program; what it says is kept as text."""
    order = list(map(str, words))
    return subprocess.run(order, capture_output=True, text=True, check=False, **more)


def call(*words: object, **more: Any) -> str:
    """Run a program that must not fail; return what it prints."""
    done = run(*words, **more)
    assert done.returncode == 0, f"{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout
