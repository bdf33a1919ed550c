"""The study of the families of mechanisms: its small sample runs and has each section."""

import re
import subprocess
import sys

import pytest

from dockloop.base.paths import ROOT
from programs import run

STUDY = ROOT / "tests" / "studies" / "families.py"
SECTIONS = ("Cost", "Whole sequences", "Where they capture", "The brake", "What must come out")


@pytest.mark.long
def test_the_small_sample_of_the_study_has_each_section(tmp_path):
    page = tmp_path / "own.md"
    subprocess.run([sys.executable, STUDY, "--quick", "-o", page], check=True, timeout=600)
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE) == list(SECTIONS)
    assert not re.search(r"\b(nan|inf)\b", text)
    tables = re.findall(r"^\|(?:---\|)+\n\| (.*?) \|", text, flags=re.MULTILINE)
    assert len(tables) == len(SECTIONS) + 1  # two of costs
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (tmp_path / picture).stat().st_size > 1000


def test_a_sample_does_not_replace_the_page():
    refused = run(sys.executable, STUDY, "--quick")
    assert refused.returncode == 2
    assert "needs another page" in refused.stderr


def test_one_section_of_a_page_is_written_anew(tmp_path):
    page = tmp_path / "own.md"
    text = "# Head\n\n## Cost\n\nold cost\n\n## The brake\n\nold brake\n\n## Last\n\nkept\n"
    page.write_text(text)
    words = [sys.executable, STUDY, "--quick", "--only", "brake", "-o", page]
    subprocess.run(words, check=True, timeout=300)
    text = page.read_text(encoding="utf-8")
    assert "old cost" in text
    assert "kept" in text
    assert "old brake" not in text
    assert "--only brake" in text
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE) == ["Cost", "The brake", "Last"]
