"""Draw the map of packages in `pipelines/__init__.py`: `python tools/draw_map.py`.

The levels are the layers of the import contract in pyproject.toml; the subject of a package is the
first line of its docstring.
"""

import ast
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "pipelines" / "__init__.py"
TITLE = "Packages, from the ground up; imports run down only (drawn by `tools/draw_map.py`):"
TITLES = ("level", "package", "subject")


def contract_layers() -> list[list[str]]:
    """Return the modules of each layer, from the stages to the errors."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (contract,) = (each for each in contracts if each.get("containers") == ["pipelines"])
    return [layer.split(" | ") for layer in contract["layers"]]


def subject(name: str) -> str:
    """Return the first line of the docstring of a module or package, without its full stop."""
    folder = PAGE.parent / name
    file = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0].removesuffix(".")


def draw_map() -> str:
    """Return the table of levels, packages and subjects, ground first."""
    packages = enumerate(reversed(contract_layers()[1:]), start=1)
    rows = [(str(level), name, subject(name)) for level, names in packages for name in names]
    widths = [max(map(len, column)) for column in zip(TITLES, *rows, strict=True)]
    rule = tuple("=" * width for width in widths)
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (rule, TITLES, rule, *rows, rule)
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the map to the end of the docstring of `pipelines/__init__.py`."""
    before, _, _ = PAGE.read_text(encoding="utf-8").partition(TITLE)
    PAGE.write_text(f'{before}{TITLE}\n\n{draw_map()}"""\n', encoding="utf-8")


if __name__ == "__main__":
    main()
