"""The source tree: small folders, docstrings that name their subject, one definition per name."""

import ast
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TOPS = ("symgrasp_cli", "pipelines", "symgrasp", "tools", "benchmarks")
LARGEST_FOLDER = 12  # modules of a folder, its subfolders not counted
# The stages, whose listing is the workflow, and the settings, one file for each group of stages.
LONG_LISTS = {"pipelines", "pipelines/configs"}
QUESTIONS = ("What", "Where", "How", "Who", "Of")
# One role, one name: callers name the module with it, as in `symmetry_labels.read`.
ROLES = {
    "FORMAT_VERSION",
    "ROOT",
    "STAGE",
    "UNITS",
    "log",
    "main",
    "measure",
    "read",
    "replay",
    "run",
    "tables",
    "write",
    "write_frame",
}


@cache
def sources() -> dict[str, ast.Module]:
    """The parsed modules, by path from the root."""
    files = (file for top in TOPS for file in sorted((ROOT / top).rglob("*.py")))
    return {
        file.relative_to(ROOT).as_posix(): ast.parse(file.read_text(encoding="utf-8"))
        for file in files
    }


def public_names(module: ast.Module) -> set[str]:
    """Classes, functions and constants of a module without a leading underscore."""
    found = set()
    for node in module.body:
        match node:
            case ast.Assign(value=ast.Call(func=ast.Name(id="TypeVar"))):
                pass  # a type variable is private to its module
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                found.add(name)
            case ast.Assign(targets=[ast.Tuple(elts=targets)] | targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
    return {name for name in found if not name.startswith("_")}


def test_no_folder_of_the_package_holds_too_many_modules():
    modules = [file for file in (ROOT / "pipelines").rglob("*.py") if file.stem != "__init__"]
    counts = Counter(file.parent for file in modules)
    piles = {
        folder.relative_to(ROOT).as_posix()
        for folder, count in counts.items()
        if count > LARGEST_FOLDER
    }
    assert piles == LONG_LISTS


def test_no_docstring_of_a_module_begins_with_a_question():
    first = {file: (ast.get_docstring(module) or "").split() for file, module in sources().items()}
    assert [file for file, words in first.items() if words[:1] and words[0] in QUESTIONS] == []


def test_scripts_read_their_arguments_with_a_parser_that_knows_help():
    folders = (ROOT / "tools", ROOT / "examples")
    files = [file for folder in folders for file in folder.rglob("*.py")]
    assert [file.name for file in files if "sys.argv" in file.read_text(encoding="utf-8")] == []


def imported(modules: dict[str, ast.Module]) -> set[str]:
    """Names that any module imports from another one."""
    nodes = (node for module in modules.values() for node in ast.walk(module))
    return {name.name for node in nodes if isinstance(node, ast.ImportFrom) for name in node.names}


def test_a_public_name_is_defined_in_one_module_only():
    modules, homes = sources(), defaultdict(list)
    for file, module in modules.items():
        for name in public_names(module) - ROLES:
            homes[name].append(file)
    shared = imported(modules)  # a constant that no module imports may have the name of another
    twice = {
        name: files
        for name, files in sorted(homes.items())
        if len(files) > 1 and (name in shared or not name.isupper())
    }
    assert not twice


def test_paths_are_resolved_by_the_function_that_accepts_circular_links():
    calls = [
        f"{name}:{node.lineno}"
        for name, module in sources().items()
        if name.startswith("pipelines/")
        for node in ast.walk(module)
        if isinstance(node, ast.Attribute) and node.attr == "resolve"
    ]
    assert calls == [], "take pipelines.storage.files.real_path"


def test_scripts_with_an_interpreter_line_can_be_run():
    scripts = [path for path in (*ROOT.glob("tools/**/*"), ROOT / ".ci" / "run") if path.is_file()]
    marked = [path for path in scripts if path.read_bytes()[:2] == b"#!"]
    assert len(marked) >= 3
    assert not [path for path in marked if not path.stat().st_mode & 0o100]
