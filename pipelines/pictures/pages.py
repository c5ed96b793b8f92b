"""HTML pages from templates: whatever a page is given is escaped, files of our own excepted."""

from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup


def rendered(template: Path, **values: object) -> str:
    """Return the page that `template` makes of `values`; its folder holds what it includes.

    A template may put in a style sheet or script of its folder as it is, by `file("NAME")`.
    """
    return _environment(template.parent).get_template(template.name).render(values)


@cache
def _environment(folder: Path) -> Environment:
    found = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        auto_reload=False,
    )
    found.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    found.globals["file"] = lambda name: Markup((folder / name).read_text(encoding="utf-8"))
    return found
