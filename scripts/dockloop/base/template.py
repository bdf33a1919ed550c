"""Pages from templates of Jinja2: the only place that fills one."""

from importlib.resources import files
from typing import Any

from dockloop.base.version import __version__


def fill(room: str, name: str, **values: Any) -> str:
    """Return the text of a template of a room; it escapes the values, and knows `version`."""
    import jinja2

    environment = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["g"] = "{:g}".format
    template = files(f"dockloop.{room}").joinpath(name).read_text(encoding="utf-8")
    return environment.from_string(template).render(values, version=__version__)
