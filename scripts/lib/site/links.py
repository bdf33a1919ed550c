"""What is wrong with a site of files: links to nothing, other hosts, places on this machine."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LINKS = ("href", "src", "poster", "data", "srcset")
TEXTS = {".html", ".css", ".js", ".svg", ".txt", ".json"}


class Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, text: str) -> None:
        """Read the page."""
        super().__init__()
        self.anchors: set[str] = {""}
        self.links: list[tuple[str, str]] = []  # tag, link
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what a tag links to, and its name."""
        for name, value in attrs:
            if name == "id" or (name == "name" and tag == "a"):
                self.anchors.add(value or "")
            elif name in LINKS and value:
                self.links.append((tag, value))


def find_faults(site: Path, machine: tuple[str, ...]) -> list[str]:
    """Return one sentence for each fault.

    Args:
        site: the folder with all files of the site.
        machine: folders of this machine, of which no file may speak.
    """
    pages = {p: Page(p.read_text(encoding="utf-8")) for p in sorted(site.rglob("*.html"))}
    faults = []
    for path, page in pages.items():
        name = path.relative_to(site)
        faults += [f"{name}: {fault}" for fault in _find_dead(path, page, pages)]
    for path in sorted(site.rglob("*")):
        if path.suffix in TEXTS:
            text = path.read_text(encoding="utf-8")
            name = path.relative_to(site)
            faults += [
                f"{name}: speaks of {place}"
                for place in machine
                if re.search(rf"(?<![\w.]){re.escape(place)}\b", text)  # and not of ../src
            ]
            if path.suffix == ".css":
                hosts = re.findall(r"(?:url\(|@import )\W*((?:https?:)?//[^\s)\"']+)", text)
                faults += [f"{name}: asks {host}" for host in hosts]
    return faults


def _find_dead(path: Path, page: Page, pages: dict[Path, Page]) -> Iterator[str]:
    """Yield what is wrong with the links of a page."""
    for tag, link in page.links:
        parts = urlsplit(link)
        if parts.scheme == "data" or (tag == "a" and parts.scheme in ("http", "https")):
            continue  # within the page; where a reader may go
        if parts.scheme or parts.netloc:
            yield f"<{tag}> asks {link}"
            continue
        file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        if not file.is_file():
            yield f"'{link}' leads to no file"
        elif file in pages and unquote(parts.fragment) not in pages[file].anchors:
            yield f"'{link}' leads to no heading"
