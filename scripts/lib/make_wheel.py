"""Packs the compiled package into a wheel: for machines without a compiler.

``scripts/platforms wheel`` calls it. The files are those that ``pip install .`` installs
(CMakeLists.txt), but nothing is compiled:

* The native wheel takes compiled files from ``build/release``. Its module belongs to one version of
  Python: the one in ``.venv``.
* The wheel of a platform takes them from ``build/platforms/PLATFORM``. Its module has the stable
  ABI: it serves Python 3.12 and all later versions.

For Linux auditwheel finds the platform tag, from the symbols that the compiled files need. For
macOS and Windows the target of the compiler says the tag (CMakePresets.json).
"""

import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

from dockloop.base import paths
from dockloop.fmu import binaries
from dockloop.native.core import load_core

WHEELS = paths.BUILD / "wheels"
_EXTRAS = ("tables", "sweep")  # the others are of use in a clone only
_PYTHON = f"cp{sys.version_info.major}{sys.version_info.minor}"
NATIVE = "native"
_PROCESSORS = {("macos", "aarch64"): "arm64", ("windows", "x86_64"): "amd64"}  # names in tags


def lay_out(site: Path, platform: str = NATIVE) -> None:
    """Put the package into a folder as CMakeLists.txt and pyproject.toml install it."""
    package = site / "dockloop"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(paths.ROOT / "scripts" / "dockloop", package, ignore=ignored)
    no_trades = shutil.ignore_patterns("trade")
    shutil.copytree(paths.MODELS, package / "data" / "modelDescription", ignore=no_trades)
    shutil.copy(paths.ROOT / "LICENSE", package / "data")
    for file, folder in _list_compiled(platform).items():
        (package / folder).mkdir(parents=True, exist_ok=True)
        shutil.copy(file, package / folder)


def _list_compiled(platform: str) -> dict[Path, str]:
    """Return the compiled files of a platform, and the folder in the package for each."""
    if platform == NATIVE:
        module = Path(load_core().__file__ or "")
        return {module: ".", paths.LIBRARY: "data/bin", paths.GENERATOR: "data/bin"}
    library = binaries.portable_library(platform)
    files = {find_module(platform): ".", library: f"data/platforms/{platform}"}
    generator = library.with_name(paths.GENERATOR.name)
    return files | ({generator: "data/bin"} if generator.exists() else {})


def find_module(platform: str) -> Path:
    """Return where the module with the stable ABI is."""
    suffix = ".pyd" if platform == "win64" else ".abi3.so"
    return binaries.portable_library(platform).with_name(f"_core{suffix}")


def write_wheel(folder: Path = WHEELS, platform: str = NATIVE) -> Path:
    """Write the wheel of this machine, or of a platform, into a folder; returns the file."""
    folder.mkdir(parents=True, exist_ok=True)
    python = f"{_PYTHON}-{_PYTHON}" if platform == NATIVE else "cp312-abi3"
    with tempfile.TemporaryDirectory() as place:
        site = Path(place) / "site"
        lay_out(site, platform)
        system, processor, version = _read_target(platform)
        if system == "linux":
            tag = _find_platform(_pack(site, Path(place), f"{python}-linux_{processor}"))
        else:
            tag = f"{'win' if system == 'windows' else f'macosx_{version}'}_{processor}"
        return _pack(site, folder, f"{python}-{tag}")


def _read_target(platform: str) -> tuple[str, str, str]:
    """Return system, processor and oldest version of the system, as platform tags name them."""
    presets = json.loads((paths.ROOT / "CMakePresets.json").read_text(encoding="utf-8"))
    targets = {
        preset["name"]: preset.get("cacheVariables", {}).get("DOCKLOOP_TARGET", "")
        for preset in presets["configurePresets"]
    }
    found = re.match(r"(\w+)-([a-z]+)[^.]*(?:\.([\d.]+))?", targets.get(platform, ""))
    if not found:
        return "linux", "x86_64", ""
    processor, system, version = found.groups()
    processor = _PROCESSORS.get((system, processor), processor)
    return system, processor, (version or "").replace(".", "_")


def _find_platform(wheel: Path) -> str:
    """Return the platform tag that auditwheel finds for a wheel."""
    command = [sys.executable, "-m", "auditwheel", "show", str(wheel)]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.search(r'platform\s+tag:\s+"(\w+)"', text)
    if not found:
        raise SystemExit(f"scripts/platforms: auditwheel finds no platform tag:\n{text}")
    return found[1]


def _pack(site: Path, folder: Path, tag: str) -> Path:
    """Write a wheel of the files below `site`; equal files give equal bytes."""
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stem = f"dockloop-{project['version']}"
    scripts = "".join(f"{name} = {value}\n" for name, value in project["scripts"].items())
    info = {
        "METADATA": _describe(project),
        "WHEEL": f"Wheel-Version: 1.0\nGenerator: dockloop\nRoot-Is-Purelib: false\nTag: {tag}\n",
        "entry_points.txt": f"[console_scripts]\n{scripts}",
    }
    files = {file.relative_to(site).as_posix(): file for file in site.rglob("*") if file.is_file()}
    record = []
    wheel = folder / f"{stem}-{tag}.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:

        def add(name: str, content: bytes, mode: int) -> None:
            entry = zipfile.ZipInfo(name)
            entry.external_attr = (0o100000 | mode) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            record.append(f"{name},sha256={digest.decode()},{len(content)}\n")

        for name in sorted(files):
            add(
                name,
                files[name].read_bytes(),
                0o755 if files[name].stat().st_mode & 0o100 else 0o644,
            )
        for name, text in info.items():
            add(f"{stem}.dist-info/{name}", text.encode(), 0o644)
        name = f"{stem}.dist-info/RECORD"
        add(name, "".join([*record, f"{name},,\n"]).encode(), 0o644)
    return wheel


def _describe(project: dict) -> str:
    """Return the metadata of the wheel."""
    lines = ["Metadata-Version: 2.1"]
    for key in ("name", "version"):
        lines.append(f"{key.capitalize()}: {project[key]}")
    lines.append(f"Summary: {project['description']}")
    lines.append(f"License: {project['license']['text']}")
    lines.append(f"Requires-Python: {project['requires-python']}")
    lines += [f"Requires-Dist: {need}" for need in project["dependencies"]]
    for extra in _EXTRAS:
        lines.append(f"Provides-Extra: {extra}")
        needs = project["optional-dependencies"][extra]
        lines += [f"Requires-Dist: {need}; extra == '{extra}'" for need in needs]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        made = write_wheel(WHEELS, name)
        print(f"{paths.shown(made)} ({made.stat().st_size / 1e6:.1f} MB)")
