"""Rules that the package keeps and ruff does not know, read from its source: nothing is imported or run here."""

import ast
import graphlib
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "ps_fmu"
MODULES = sorted(PACKAGE.rglob("*.py"))


@cache
def parse(path):
    return ast.parse(path.read_text())


@cache
def imports(tree):
    """(level, module, names) of each import statement."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(0, alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found.append((node.level, node.module or "", tuple(alias.name for alias in node.names)))
    return found


def relative(path):
    """A path of the package as a text, from the package's folder on."""
    return path.relative_to(PACKAGE).as_posix()


def test_imports_within_the_package_are_relative():
    """The build renames the package inside an FMU; an absolute import would find another copy."""
    absolute = {
        (relative(path), module) for path in MODULES for level, module, _ in imports(parse(path)) if level == 0
    }
    assert not [(path, module) for path, module in absolute if module.split(".")[0] == "ps_fmu"]


def test_no_files_import_each_other_in_a_circle():
    """Imports for typing count as well: who reads one file of a circle has to read them all."""
    graph = grimp.build_graph("ps_fmu", cache_dir=None)
    arrows = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert len(arrows) > 300
    graphlib.TopologicalSorter(arrows).prepare()  # raises CycleError with the files of a circle


def test_python_is_started_without_the_current_directory():
    """With -I, which also leaves out PYTHONPATH and the packages of the user."""
    for path in MODULES:
        for node in ast.walk(parse(path)):
            starts = isinstance(node, ast.List) and node.elts and isinstance(node.elts[0], ast.Attribute)
            if starts and ast.unparse(node.elts[0]) == "sys.executable":
                assert ast.unparse(node.elts[1]) == "'-I'", f"{relative(path)}, line {node.lineno}"


def test_the_package_itself_imports_nothing():
    """Nor does it when it is asked for ``simulate``, but by the one call that no FMU packs; see test_simulation."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert [node.name for node in functions] == ["__dir__", "__getattr__"]
    assert list(imports(functions[1])) == [(0, "importlib", ("import_module",))]
    assert list(imports(tree)) == list(imports(functions[1]))


def test_the_versions_agree():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f'__version__ = "{project["version"]}"' in (PACKAGE / "__init__.py").read_text()
    assert f"version: {project['version']}\n" in (ROOT / "CITATION.cff").read_text()
