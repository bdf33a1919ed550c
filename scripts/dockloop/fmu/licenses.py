"""Licences of all that is inside the compiled library, as the FMU carries them.

Texts lie in ``modelDescription/licenses``; ``license.txt`` of the FMU is the project's own licence
followed by the list of the parts. A part that is added to the library is added here too.
"""

from typing import NamedTuple

from dockloop.base import paths

FOLDER = paths.MODELS / "licenses"


class Part(NamedTuple):
    """A part of the library, and the file that holds its licence."""

    name: str
    used: str
    license: str
    file: str


PARTS = (
    Part("dockloop", "the model and the FMI interface", "BSD-3-Clause", "license.txt"),
    Part("SUNDIALS", "integration of the equations of motion", "BSD-3-Clause", "sundials.txt"),
    Part("Eigen", "vectors and matrices", "MPL-2.0, part BSD-3-Clause", "eigen.txt"),
    Part("JSON for Modern C++", "reading the scene", "MIT", "nlohmann_json.txt"),
    Part("FMI headers", "declarations of the interface", "BSD-2-Clause", "fmi_headers.txt"),
    Part(
        "GCC runtime",
        "C++ standard library",
        "GPL-3.0-or-later with GCC-exception-3.1",
        "gcc_runtime.txt",
    ),
    Part(
        "LLVM runtime",
        "C++ standard library of portable binaries",
        "Apache-2.0 with LLVM-exception",
        "llvm_runtime.txt",
    ),
    Part(
        "mingw-w64 runtime",
        "C library of the Windows binary",
        "ZPL-2.1 and others",
        "mingw_runtime.txt",
    ),
)


def read_licenses() -> dict[str, bytes]:
    """Return the files of the folder ``documentation/licenses``."""
    own = (paths.ROOT / "LICENSE").read_text(encoding="utf-8").rstrip()
    listed = "\n".join(
        f"{part.name:20} {part.license:40} {part.file}" for part in PARTS if part is not PARTS[0]
    )
    overall = f"{own}\n\n{'-' * 80}\n\nParts of others inside the library:\n\n{listed}\n"
    texts = {part.file: (FOLDER / part.file).read_bytes() for part in PARTS[1:]}
    return {PARTS[0].file: overall.encode(), **texts}
