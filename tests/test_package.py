"""Rules that the package keeps, read from its source: nothing is imported or run here."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "ps_fmu"
MODULES = sorted(PACKAGE.rglob("*.py"))
SOURCES = MODULES + sorted((ROOT / "fmus").rglob("*.py")) + sorted((ROOT / "system").rglob("*.py"))
C_SOURCES = sorted(path for ending in ("c", "h") for path in PACKAGE.rglob(f"*.{ending}"))

# What each room may import of the others.
PHYSICS = {"mechanism", "control", "disturbance", "sensors", "actuators"}
MAY_IMPORT = {
    "numerics": set(),
    "mechanism": set(),
    "control": {"mechanism"},
    "disturbance": {"mechanism", "numerics"},
    "sensors": {"mechanism", "numerics"},
    "actuators": {"mechanism", "numerics"},
    "theory": PHYSICS,
    "slavekit": set(),
    "reduction": {"slavekit"},
    "product": set(),
    "interface": {*PHYSICS, "cosim", "slavekit", "product"},
    "cosim": {"reduction", "slavekit"},
    "fmucheck": {"cosim", "slavekit"},
    "pointing": set(),
    "results": {"pointing", "reduction", "slavekit"},
    "requirements": {"cosim", "pointing", "reduction", "results", "slavekit"},
    "runs": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "reduction", "results", "requirements", "slavekit",
        "product",
    },
    "paper": {*PHYSICS, "theory", "interface", "cosim", "pointing", "results", "runs", "slavekit", "product"},
    "studies": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "results", "requirements", "runs", "slavekit", "product"
    },
    "trades": {
        *PHYSICS, "theory", "interface", "cosim", "pointing", "requirements", "results", "runs", "paper", "product",
    },
}

# The calls of FMI 2.0: the standard says what they do.
FMI_CALLS = {
    *(f"{verb}_{type_}" for verb in ("get", "set") for type_ in ("real", "integer", "boolean", "string")),
    *("setup_experiment", "enter_initialization_mode", "exit_initialization_mode", "do_step", "terminate"),
}


def named(paths):
    return pytest.mark.parametrize("path", paths, ids=lambda path: str(path.relative_to(ROOT)))


def public_definitions(body, prefix=""):
    """Public functions and classes of a body and the public methods of the classes, setters left out."""
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.name[0] != "_":
            if any(isinstance(mark, ast.Attribute) and mark.attr == "setter" for mark in node.decorator_list):
                continue
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from public_definitions(node.body, f"{node.name}.")


def imports(tree):
    """(level, module, names) of each import statement."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or "", tuple(alias.name for alias in node.names)


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
    for level, module, names in imports(ast.parse(path.read_text())):
        if level:
            base = path.parents[level - 1].joinpath(*module.split(".") if module else ())
            for name in names:
                places = base / f"{name}.py", base / name / "__init__.py", base.with_suffix(".py"), base / "__init__.py"
                yield next(place for place in places if place.is_file())


@named(MODULES)
def test_what_is_public_is_documented(path):
    tree = ast.parse(path.read_text())
    missing = [name for name, node in public_definitions(tree.body) if not ast.get_docstring(node)]
    missing = [name for name in missing if name.split(".")[-1] not in FMI_CALLS]
    assert ast.get_docstring(tree), "the module has no docstring"
    assert not missing


@named(MODULES)
def test_imports_within_the_package_are_relative(path):
    """The build renames the package inside an FMU; an absolute import would find another copy."""
    absolute = [module for level, module, _ in imports(ast.parse(path.read_text())) if level == 0]
    assert not [module for module in absolute if module.split(".")[0] == "ps_fmu"]


@named([path for path in MODULES if path.parent != PACKAGE])
def test_imports_point_one_way(path):
    part = path.relative_to(PACKAGE).parts[0]
    reached = set()
    for level, module, names in imports(ast.parse(path.read_text())):
        if level:
            reached |= part_of(path, level, module, names)
    assert reached & MAY_IMPORT.keys() <= MAY_IMPORT[part] | {part}


def test_no_files_import_each_other_in_a_circle():
    """Imports for typing count as well: who reads one file of a circle has to read them all."""
    arrows = {relative(path): {relative(other) for other in imported_files(path)} for path in MODULES}
    graphlib.TopologicalSorter(arrows).prepare()  # raises CycleError with the files of a circle


@named(SOURCES + C_SOURCES)
def test_files_are_short(path):
    assert len(path.read_text().splitlines()) <= 400


@named(SOURCES)
def test_nothing_runs_code_from_data(path):
    tree = ast.parse(path.read_text())
    modules = {module.split(".")[0] for _, module, _ in imports(tree)}
    assert not modules & {"pickle", "marshal", "shelve", "dill"}
    calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    called = {function.id for function in calls if isinstance(function, ast.Name)}
    assert not called & {"eval", "exec"}


@named(MODULES)
def test_python_is_started_without_the_current_directory(path):
    """With -I, which also leaves out PYTHONPATH and the packages of the user."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.List) and node.elts and ast.unparse(node.elts[0]) == "sys.executable":
            assert ast.unparse(node.elts[1]) == "'-I'", f"line {node.lineno}"


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
