"""The version of the package; pages, tables and FMUs name it."""

__version__ = "0.1.0"
