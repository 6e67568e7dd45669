"""Rules that the package keeps and ruff does not know, read from its source: nothing is imported or run here."""

import ast
import graphlib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "ps_fmu"
MODULES = sorted(PACKAGE.rglob("*.py"))
SOURCES = MODULES + sorted((ROOT / "fmus").rglob("*.py")) + sorted((ROOT / "system").rglob("*.py"))
C_SOURCES = sorted(path for ending in ("c", "h") for path in PACKAGE.rglob(f"*.{ending}"))

# What each room may import of the others.
PHYSICS = {"mechanism", "control", "disturbance", "sensors", "actuators"}
MAY_IMPORT = {
    "native": set(),
    "numerics": {"native"},
    "mechanism": set(),
    "control": {"mechanism"},
    "disturbance": {"mechanism", "numerics"},
    "sensors": {"mechanism", "numerics"},
    "actuators": {"mechanism", "numerics"},
    "theory": PHYSICS,
    "slavekit": {"native", "numerics"},
    "reduction": {"native"},
    "product": set(),
    "interface": {*PHYSICS, "cosim", "slavekit", "product"},
    "cosim": {"native", "reduction", "slavekit"},
    "fmucheck": {"cosim", "native", "slavekit"},
    "pointing": set(),
    "results": {"pointing", "reduction", "slavekit"},
    "requirements": {"cosim", "pointing", "reduction", "results", "slavekit"},
    "runs": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "reduction", "results", "requirements", "slavekit",
        "product",
    },
    "scenarios": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "reduction", "results", "requirements", "runs",
    },
    "analyses": {"cosim", "results", "runs", "slavekit", "product"},
    "paper": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "results", "runs", "scenarios", "slavekit", "product",
        "analyses",
    },
    "studies": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "results", "requirements", "runs", "slavekit", "product"
    },
    "trades": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "requirements", "results", "runs", "analyses", "product",
    },
}


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


def part_of(path, level, module, names):
    """The parts of the package that a relative import in ``path`` reaches into."""
    package = path.relative_to(PACKAGE).parts[:-1]
    base = package[: len(package) - (level - 1)]
    full = [*base, *module.split(".")] if module else list(base)
    return {full[0]} if full else set(names)


def relative(path):
    """A path of the package as a text, from the package's folder on."""
    return path.relative_to(PACKAGE).as_posix()


def imported_files(path):
    """The other modules of the package that a module imports, by their files."""
    for level, module, names in imports(parse(path)):
        if level:
            base = path.parents[level - 1].joinpath(*module.split(".") if module else ())
            for name in names:
                places = base / f"{name}.py", base / name / "__init__.py", base.with_suffix(".py"), base / "__init__.py"
                yield next(place for place in places if place.is_file())


def test_imports_within_the_package_are_relative():
    """The build renames the package inside an FMU; an absolute import would find another copy."""
    absolute = {
        (relative(path), module) for path in MODULES for level, module, _ in imports(parse(path)) if level == 0
    }
    assert not [(path, module) for path, module in absolute if module.split(".")[0] == "ps_fmu"]


def test_imports_point_one_way():
    for path in MODULES:
        part = path.relative_to(PACKAGE).parts[0]
        if path.parent != PACKAGE:
            reached = {to for level, *rest in imports(parse(path)) if level for to in part_of(path, level, *rest)}
            assert reached & MAY_IMPORT.keys() <= MAY_IMPORT[part] | {part}, relative(path)


def test_no_files_import_each_other_in_a_circle():
    """Imports for typing count as well: who reads one file of a circle has to read them all."""
    arrows = {relative(path): {relative(other) for other in imported_files(path)} for path in MODULES}
    graphlib.TopologicalSorter(arrows).prepare()  # raises CycleError with the files of a circle


def test_files_are_short():
    assert not [path for path in SOURCES + C_SOURCES if len(path.read_text().splitlines()) > 400]


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
