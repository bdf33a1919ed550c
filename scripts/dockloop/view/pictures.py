"""Stills (PNG) and films (MP4) of a page, drawn by Chromium without a display."""

import json
import shutil
import struct
import subprocess
import zlib
from pathlib import Path

from dockloop.base.errors import DockloopError
from dockloop.base.files import Kind, figure_kind, read_head, scratch, writing
from dockloop.base.progress import ProgressBar
from dockloop.view.browser import Browser
from dockloop.view.page import COMMAND

_RATE = 25  # pictures per second of a film
_PNG_START = 33  # bytes of a PNG before whatever follows its header


def _is_film(path: Path) -> bool:
    head = read_head(path)
    return head[4:8] == b"ftyp" and f"made by {COMMAND}".encode() in head


STILL = figure_kind(COMMAND)
FILM = Kind("film", COMMAND, _is_film)


def write_stills(
    page: Path, shots: dict[Path, float | str], camera: str, size: tuple[int, int]
) -> None:
    """Write pictures of a page.

    Args:
        page: the page.
        shots: time [s] or event by the file to write.
        camera: a choice of ``--camera``.
        size: width and height in pixels.

    Raises:
        DockloopError: there is no Chromium, or it fails.
    """
    with Browser(*size) as browser:
        _prepare(browser, page)
        for file, moment in shots.items():
            _show(browser, moment, camera)
            picture = _sign(browser.take_picture())
            with writing(file, STILL) as partial:
                partial.write_bytes(picture)


def write_film(
    page: Path,
    path: Path,
    span: tuple[float, float],
    *,
    speed: float,
    camera: str,
    size: tuple[int, int],
) -> int:
    """Write a film of a page with ffmpeg.

    Args:
        page: the page.
        path: the file, ``.mp4``.
        span: begin and end [s].
        speed: seconds of the docking in one of the film.
        camera: a choice of ``--camera``.
        size: width and height in pixels; odd ones are made even.

    Returns:
        The number of pictures.

    Raises:
        DockloopError: Chromium or ffmpeg is missing or fails.
    """
    ffmpeg = shutil.which("ffmpeg")
    if not ffmpeg:
        raise DockloopError("films need ffmpeg: install it (apt-get install ffmpeg)")
    begin, end = span
    count = max(1, round((end - begin) / speed * _RATE)) + 1
    even = (size[0] - size[0] % 2, size[1] - size[1] % 2)
    progress = ProgressBar("film")
    with Browser(*even) as browser, scratch() as folder:
        _prepare(browser, page)
        for i in range(count):
            moment = begin + (end - begin) * i / (count - 1)
            if i == 0:
                _show(browser, moment, camera)
            else:
                browser.run(f"dockloop.show({moment!r})")
            (folder / f"{i:06d}.png").write_bytes(browser.take_picture())
            progress((i + 1) / count)
        with writing(path, FILM) as partial:
            words = [
                *(ffmpeg, "-loglevel", "error", "-y", "-framerate", str(_RATE)),
                *("-i", str(folder / "%06d.png"), "-pix_fmt", "yuv420p", "-movflags", "+faststart"),
                *("-metadata", f"comment=made by {COMMAND}", "-f", "mp4", str(partial)),
            ]
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            if done.returncode:
                why = done.stderr.strip().splitlines()
                raise DockloopError(f"ffmpeg: {why[-1] if why else 'failed without a message'}")
    return count


def _prepare(browser: Browser, page: Path) -> None:
    """Open a page and leave nothing but the motion in the window."""
    browser.open(page)
    if not browser.run("dockloop.draws()"):
        raise DockloopError("Chromium draws no WebGL 2 here: pictures cannot be made")
    browser.run("dockloop.setPicture(true)")
    browser.settle()


def _show(browser: Browser, moment: float | str, camera: str) -> None:
    """Show a moment as a camera sees it."""
    browser.run(f"dockloop.show({json.dumps(moment)})")
    browser.run(f"dockloop.setCamera({json.dumps(camera)})")
    browser.settle()


def _sign(picture: bytes) -> bytes:
    """Return a PNG with the text that names the command."""
    inside = b"tEXtSoftware\0" + COMMAND.encode()
    chunk = struct.pack(">I", len(inside) - 4) + inside + struct.pack(">I", zlib.crc32(inside))
    return picture[:_PNG_START] + chunk + picture[_PNG_START:]
