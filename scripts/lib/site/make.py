"""Makes the site: collects the pages, draws the gallery, lets Sphinx work, checks every link.

Pages stay where they are. They are copied with all that is around them, so that links between them
stay as they are, too. What has no page of its own is written here: gallery and reference.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from gallery import write_gallery
from links import find_faults
from reference import REFERENCE

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError, explain
from dockloop.base.files import scratch

HERE = Path(__file__).parent
SIGN = Path("made_by.txt"), "scripts/site\n"  # in the folder of a site


def main() -> int:
    """Make the site; return the exit status."""
    parser = argparse.ArgumentParser(description="Make the site of all pages.")
    parser.add_argument("-o", type=Path, metavar="FOLDER", required=True, dest="output")
    try:
        make_site(parser.parse_args().output.resolve())
    except (DockloopError, OSError) as error:
        failure = error if isinstance(error, DockloopError) else explain(error)
        print(f"error: {failure}", file=sys.stderr)
        return failure.exit_status
    return 0


def make_site(output: Path) -> None:
    """Make the site in a folder.

    Raises:
        UsageError: the folder holds something else.
        DockloopError: a page, a link or a docking is wrong.
    """
    claim_folder(output)
    with scratch() as work:
        source, made, extra = work / "source", work / "site", work / "extra"
        collect(paths.ROOT, source)
        for name, describe in REFERENCE.items():
            (source / f"{name}.md").write_text(describe(), encoding="utf-8")
        (source / "gallery.md").write_text(write_gallery(extra / "gallery"), encoding="utf-8")
        build(source, made, extra)
        faults = find_faults(made, (str(paths.ROOT), str(work)))
        if faults:
            raise DockloopError("the site is not right:\n" + "\n".join(faults))
        shutil.copy(made / "README.html", made / "index.html")
        (made / SIGN[0]).write_text(SIGN[1], encoding="utf-8")
        shutil.rmtree(output)
        shutil.move(made, output)


def claim_folder(output: Path) -> None:
    """Make the folder, or refuse one that is not a site of ours. Raises UsageError."""
    sign = output / SIGN[0]
    is_ours = sign.is_file() and sign.read_text(encoding="utf-8") == SIGN[1]
    if output.exists() and not is_ours and not (output.is_dir() and not any(output.iterdir())):
        raise UsageError(f"-o {output}: is there, and no site of scripts/site: choose another -o")
    output.mkdir(parents=True, exist_ok=True)


def collect(root: Path, source: Path) -> None:
    """Copy the folders that have pages, and the files next to them."""
    lists = tomllib.loads((HERE / "contents.toml").read_text(encoding="utf-8"))["list"]
    rooms = {page.partition("/")[0] for row in lists for page in row["pages"] if "/" in page}
    source.mkdir(parents=True)
    for entry in root.iterdir():
        if entry.name in rooms:
            unread = shutil.ignore_patterns("__pycache__", "*.egg-info")
            shutil.copytree(entry, source / entry.name, ignore=unread)
        elif entry.is_file():
            shutil.copy(entry, source)


def build(source: Path, made: Path, extra: Path) -> None:
    """Let Sphinx write the site; every warning is an error. Raises DockloopError."""
    words = ["-m", "sphinx", "-q", "-W", "--keep-going", "-c", str(HERE)]
    words += ["-D", f"html_extra_path={extra}", "-d", f"{source}-read", str(source), str(made)]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        found = done.stderr.replace(f"{source}{os.sep}", "").strip()
        raise DockloopError(f"the pages are not right:\n{found}")


if __name__ == "__main__":
    sys.exit(main())
