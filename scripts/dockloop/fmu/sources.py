"""The folder ``sources/`` of an FMU: all that a compiler needs to make its library again.

The folder is an include root by itself: sources and headers of this project as below ``src/`` and
``fmu/``, those of Eigen, nlohmann-json and SUNDIALS as in ``build/deps/source`` (collected there by
``scripts/platforms``), and the FMI headers. ``buildDescription.xml`` and ``modelDescription.xml``
list what to compile for importers, ``CMakeLists.txt`` does it for people.
"""

import re
from xml.sax.saxutils import quoteattr

from dockloop.base import paths

_NOT_IN_THE_FMU = {"api", "check", "codegen", "compare", "python"}
_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")


def source_entries(name: str) -> dict[str, bytes]:
    """Return the entries of an FMU below ``sources/``.

    Args:
        name: the model identifier.

    Returns:
        Content by path in the FMU; nothing when the sources of the outside packages are not there.
    """
    outside = paths.OUTSIDE
    if not outside.exists():
        return {}
    files = {file.name: file for file in (paths.ROOT / "fmu").glob("*.[ch]pp")}
    files |= {header: paths.ROOT / "fmu" / "fmi2" / header for header in _HEADERS}
    files["exports.map"] = paths.ROOT / "fmu" / "exports.map"
    files["CMakeLists.txt"] = paths.ROOT / "fmu" / "sources.cmake"
    for root, pattern in ((paths.ROOT / "src", "*/*.[ch]pp"), (outside, "**/*")):
        for file in root.glob(pattern):
            place = file.relative_to(root)
            if file.is_file() and place.parts[0] not in _NOT_IN_THE_FMU:
                files[place.as_posix()] = file
    entries = {f"sources/{place}": file.read_bytes() for place, file in sorted(files.items())}
    units = [place for place in sorted(files) if place.endswith((".c", ".cpp"))]
    entries["sources/buildDescription.xml"] = _build_description(name, units).encode()
    return entries


def list_sources(description: str, entries: dict[str, bytes]) -> str:
    """Return modelDescription.xml with the files to compile, for importers that look there only.

    Args:
        description: modelDescription.xml.
        entries: the entries of the FMU.

    Returns:
        The same text when there are no sources.
    """
    units = [name.removeprefix("sources/") for name in entries if name.endswith((".c", ".cpp"))]
    if not units:
        return description
    files = "".join(f"<File name={quoteattr(unit)}/>" for unit in units)
    return re.sub(
        r"<(CoSimulation|ModelExchange)( [^>]*)/>",
        rf"<\1\2><SourceFiles>{files}</SourceFiles></\1>",
        description,
    )


def _build_description(name: str, units: list[str]) -> str:
    """Return buildDescription.xml, whose format FMI 2.0.4 took over from FMI 3.0."""
    lines = [f"      <SourceFile name={quoteattr(unit)}/>" for unit in units]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<fmiBuildDescription fmiVersion="3.0">',
            f"  <BuildConfiguration modelIdentifier={quoteattr(name)}>",
            '    <SourceFileSet language="C++17">',
            *lines,
            "    </SourceFileSet>",
            "  </BuildConfiguration>",
            "</fmiBuildDescription>\n",
        ]
    )
