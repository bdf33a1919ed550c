"""The version of the package, which pages, tables and FMUs name, and of what it runs with."""

import platform

__version__ = "0.1.0"


def list_versions(*packages: str) -> dict[str, str | None]:
    """Return versions of dockloop, Python and these packages; None: it is not installed."""
    from importlib.metadata import PackageNotFoundError, version

    versions: dict[str, str | None] = {
        "dockloop": __version__,
        "python": platform.python_version(),
    }
    for package in packages:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return versions
