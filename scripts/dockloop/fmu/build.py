"""Builds an FMU: a zip file with the compiled library and the resolved scene.

Layout (FMI 2.0)::

    modelDescription.xml                what the FMU exports, from the core
    binaries/linux64/NAME.so            the compiled library, the same for every scene
    binaries/win64/NAME.dll             ... and whatever else scripts/platforms has built
    sources/                            what a compiler needs to make the library again
    resources/model.json                the resolved scene, all that the library reads
    resources/kernels/linux64/kernel.so fast code for its mechanism, used where it fits
    documentation/index.html            all that a stranger needs to know
    documentation/externalDependencies.txt
    documentation/licenses/             of the project and of every part of the library
    terminalsAndIcons/                  which variables belong together; the icon (FMI 2.0.4)
    model.png                           the icon

The same scene and library give the same bytes: entries are sorted and dated alike. The date is
1980-01-01 (the first that a zip file can hold) unless SOURCE_DATE_EPOCH says otherwise.

A *bare* FMU is one to run and throw away: the same model, binaries and resources, but nothing to
read or to compile, and not compressed. It is built in less than half the time.
"""

import datetime
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.files import Kind, check_suffix, claim, scratch, writing
from dockloop.base.number import read_whole
from dockloop.fmu.binaries import find_libraries
from dockloop.fmu.kernel import Kernel, make_kernel
from dockloop.fmu.licenses import read_licenses
from dockloop.fmu.page import describe_needs, make_page
from dockloop.fmu.sources import list_sources, source_entries
from dockloop.fmu.terminals import make_terminals
from dockloop.native.core import check, describe, to_json
from dockloop.scene.carried import MODEL, is_document, read_model
from dockloop.scene.find import find_scene
from dockloop.scene.placement import read_placed

_FIRST_ZIP_DATE = 315532800  # 1980-01-01T00:00:00Z, s since 1970
_LAST_ZIP_DATE = 4354819199  # 2107-12-31T23:59:59Z


FMU = Kind("FMU", "dockloop build", lambda path: bool(read_model(path)))
DOCUMENT = Kind("document", "dockloop build", is_document)


def build_fmu(
    reference: str,
    overrides: list[str] | tuple[str, ...] = (),
    output: Path | None = None,
    kernel: bool | None = None,
    report: Callable[[str], None] = lambda _: None,
    *,
    bare: bool = False,
    finish: Callable[[Path], None] | None = None,
) -> Path:
    """Build the FMU of a scene.

    Args:
        reference: name or path of the scene.
        overrides: ``KEY=VALUE`` texts that replace keys of the scene.
        output: the FMU to write; default ``build/fmu/SCENE.fmu`` below the current folder.
        kernel: with a kernel of the mechanism or without; None: with one where it can be made.
        report: receives in one line what became of the kernel.
        bare: only what is needed to run it.
        finish: what else is done to the FMU before it is put in its place.

    Returns:
        The FMU.

    Raises:
        UsageError: scene, mechanism, override or name of the file is bad.
        DockloopError: the compiled parts are missing, the file cannot be written, or there is no
            kernel though one is asked for.
    """
    source = find_scene(reference)
    document = read_placed(source, overrides)
    output = output or paths.RESULTS / "fmu" / f"{document['name']}.fmu"
    claim(output, FMU)
    check_suffix(output, ".fmu")
    if finish is None:
        write_fmu(document, source, output, kernel, report, bare=bare)
        return output
    with scratch() as folder:
        made = folder / f"{document['name']}.fmu"
        write_fmu(document, source, made, kernel, report, bare=bare)
        finish(made)
        with writing(output, FMU) as partial:
            shutil.copyfile(made, partial)
    return output


def build_document(reference: str, overrides: list[str] | tuple[str, ...], output: Path) -> None:
    """Write the resolved scene alone, as an FMU would carry it: for programs in C++.

    Args:
        reference: name or path of the scene.
        overrides: as for `build_fmu`.
        output: the file.

    Raises:
        UsageError: scene, mechanism, override or name of the file is bad.
        DockloopError: the compiled parts are missing, or the file cannot be written.
    """
    source = find_scene(reference)
    document = read_placed(source, overrides)
    claim(output, DOCUMENT)
    with writing(output, DOCUMENT) as partial:
        partial.write_bytes(to_json(document).encode())


def write_fmu(
    document: dict,
    source: Path,
    output: Path,
    kernel: bool | None = None,
    report: Callable[[str], None] = lambda _: None,
    *,
    bare: bool = False,
) -> None:
    """Write the FMU of a resolved document whose vehicles are placed.

    Args:
        document: all that the FMU will read.
        source: the scene file, for messages.
        output: the FMU.
        kernel: as for `build_fmu`.
        report: as for `build_fmu`.
        bare: as for `build_fmu`.
    """
    libraries = find_libraries()
    if not libraries:
        raise DockloopError(
            f"{paths.shown(paths.LIBRARY)} is not there: build it with scripts/demo, scripts/test"
            " or 'cmake --preset release && cmake --build --preset release'"
        )
    date = find_date().strftime("%Y-%m-%dT%H:%M:%SZ")
    description = describe(document, source, date)
    made = Kernel("none: not wanted") if kernel is False else make_kernel(document, bool(kernel))
    if kernel and not made.entries:
        raise DockloopError(f"{paths.shown(source)}: kernel: {made.note}")
    report(f"kernel: {made.note}")
    name = document["name"]
    sources = {} if bare else source_entries(name)
    entries = {
        "modelDescription.xml": list_sources(description, sources).encode(),
        **{
            f"binaries/{platform}/{name}{library.suffix}": library.read_bytes()
            for platform, library in libraries.items()
        },
        MODEL: to_json(document).encode(),
        **made.entries,
    }
    if not bare:
        portable = libraries.get("linux64") != paths.LIBRARY
        report_on_mechanism = check(document["mechanism"], source)
        entries |= _companions(document, description, report_on_mechanism, portable) | sources
    write_zip(output, FMU, entries, compress=not bare)


def find_date() -> datetime.datetime:
    """Return the date of everything built: SOURCE_DATE_EPOCH, or the first of a zip file."""
    given = os.environ.get("SOURCE_DATE_EPOCH", str(_FIRST_ZIP_DATE))
    try:
        stamp = min(max(read_whole(given), _FIRST_ZIP_DATE), _LAST_ZIP_DATE)
    except ValueError:
        raise UsageError(
            f"SOURCE_DATE_EPOCH is '{given}': must be a whole number of seconds since 1970"
        ) from None
    return datetime.datetime.fromtimestamp(stamp, datetime.UTC)


def write_zip(
    output: Path, kind: Kind, entries: dict[str, bytes], *, compress: bool = True
) -> None:
    """Write a zip file whose bytes depend on its content only; replaces `output` at once.

    FMUs inside are compressed already and stored as they are.
    """
    date = find_date().timetuple()[:6]
    with writing(output, kind) as partial, zipfile.ZipFile(partial, "w") as archive:
        for name, content in entries.items():
            squeeze = compress and not name.endswith(".fmu")
            info = zipfile.ZipInfo(name, date)
            info.compress_type = zipfile.ZIP_DEFLATED if squeeze else zipfile.ZIP_STORED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, content)


def _companions(document: dict, description: str, report: dict, portable: bool) -> dict[str, bytes]:
    """Return what makes an FMU friendly: page, licences, terminals, icons."""
    terminals = make_terminals(description)
    needs = describe_needs(portable)
    page = make_page(document, description, report, needs, terminals["icon.svg"])
    return {
        "model.png": terminals["icon.png"],
        "documentation/index.html": page.encode(),
        "documentation/externalDependencies.txt": needs.encode(),
        **{f"documentation/licenses/{name}": text for name, text in read_licenses().items()},
        **{f"terminalsAndIcons/{name}": content for name, content in terminals.items()},
    }
