"""The studies of sweeps and boundaries: their small samples run and have each section."""

import re
import subprocess
import sys

import pytest

from dockloop.base.paths import ROOT
from programs import run

STUDIES = ROOT / "tests" / "studies"
SAMPLES = {  # study: options, what the page must have
    "many_dockings.py": (
        ("--cases", "16"),
        (r"\| cases done \| 16 \|", r"disk is full \| 1?\d \|", r"are identical: SHA-256"),
    ),
    "boundaries.py": (
        ("--quick",),
        (
            *(r"wrong side of the closed form \| 0 \|", r"0 differ"),
            *(r"(?s)Answer: .*Answer: ", r"!\[.*\]\(figures/boundaries\.png\)"),
        ),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", SAMPLES)
def test_the_small_sample_of_a_study_has_each_section(tmp_path, name):
    options, wanted = SAMPLES[name]
    page = tmp_path / "own.md"
    subprocess.run([sys.executable, STUDIES / name, *options, "-o", page], check=True, timeout=600)
    text = page.read_text(encoding="utf-8")
    for pattern in wanted:
        assert re.search(pattern, text), pattern
    assert not re.search(r"\b(nan|inf)\b", text)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_does_not_replace_the_page(name):
    refused = run(sys.executable, STUDIES / name, *SAMPLES[name][0])
    assert refused.returncode == 2
    assert re.search(r"needs? another page", refused.stderr)
