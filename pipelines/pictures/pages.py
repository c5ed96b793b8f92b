"""HTML pages from templates: all values are escaped, except for files of the template's folder."""

from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup


def rendered(template: Path, **values: object) -> str:
    """Return the page of `template` with `values`; included templates are in the same folder.

    A template inserts a style sheet or script of this folder unchanged by `file("NAME")`.
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
