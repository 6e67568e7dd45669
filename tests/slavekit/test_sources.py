"""Which files an FMU carries, and the other names in them."""

from pathlib import Path, PurePosixPath

import pytest

from ps_fmu.slavekit.pack.sources import BuildError, collect_modules, rename_imports

NAMES = {"ps_fmu": "ps_fmu_12", "pythonfmu": "ps_fmu_12.pythonfmu"}


@pytest.fixture
def packages(tmp_path: Path) -> dict[str, Path]:
    files = {
        "script.py": "from pkg.a import thing\nimport json\n",
        "pkg/__init__.py": "",
        "pkg/a.py": "from . import b\nfrom .sub.c import x\n",
        "pkg/b.py": "def late():\n    from .late import y\n    return y\n",
        "pkg/late.py": "from other import z\n",
        "pkg/unused.py": "",
        "pkg/data.toml": "a = 1\n",
        "pkg/sub/__init__.py": "from .. import d\n",
        "pkg/sub/c.py": "x = 1\n",
        "pkg/sub/table.csv": "1\n",
        "pkg/sub/README.md": "text\n",
        "pkg/d.py": "",
        "other/__init__.py": "from .heavy import *\n",
        "other/heavy.py": "",
        "other/z.py": "",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return {"pkg": tmp_path / "pkg", "other": tmp_path / "other"}


def test_only_what_is_imported_is_carried(packages):
    files = collect_modules(packages["pkg"].parent / "script.py", packages, hollow=("other",))
    assert sorted(map(str, files)) == [
        "other/__init__.py",
        "other/z.py",
        "pkg/__init__.py",
        "pkg/a.py",
        "pkg/b.py",
        "pkg/d.py",
        "pkg/data.toml",
        "pkg/late.py",
        "pkg/sub/__init__.py",
        "pkg/sub/c.py",
        "pkg/sub/table.csv",
    ]
    assert files[PurePosixPath("other/__init__.py")] == b""
    assert files[PurePosixPath("pkg/data.toml")] == b"a = 1\n"


def test_a_package_that_lists_its_modules_is_carried_whole(packages):
    (packages["pkg"] / "sub" / "__init__.py").write_text("import pkgutil\nKINDS = pkgutil.iter_modules(__path__)\n")
    (packages["pkg"] / "sub" / "kind.py").write_text("from .. import unused\n")
    files = collect_modules(packages["pkg"].parent / "script.py", packages)
    assert PurePosixPath("pkg/sub/kind.py") in files
    assert PurePosixPath("pkg/unused.py") in files


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("from ps_fmu.slavekit.author.slave import Slave\n", "from ps_fmu_12.slavekit.author.slave import Slave\n"),
        ("from ps_fmu import fmu, manipulator as m\n", "from ps_fmu_12 import fmu, manipulator as m\n"),
        ("from pythonfmu.enums import E\n", "from ps_fmu_12.pythonfmu.enums import E\n"),
        ("from ps_fmu.a import (\n    ps_fmu,\n    b,\n)\n", "from ps_fmu_12.a import (\n    ps_fmu,\n    b,\n)\n"),
        ("from \\\n    ps_fmu.a import b\n", "from \\\n    ps_fmu_12.a import b\n"),
        ("é = 1; from ps_fmu.a import b\n", "é = 1; from ps_fmu_12.a import b\n"),
        ("def f():\n    from ps_fmu import a; from ps_fmu import b\n", None),
        ("from ps_fmu_tools import a\nfrom .ps_fmu import b\n", "from ps_fmu_tools import a\nfrom .ps_fmu import b\n"),
        (
            "'''ps_fmu is a package'''\nx = 'of ps_fmu'  # ps_fmu\n",
            "'''ps_fmu is a package'''\nx = 'of ps_fmu'  # ps_fmu\n",
        ),
    ],
)
def test_imports_are_renamed_and_nothing_else(source, expected):
    if expected is None:
        expected = source.replace("from ps_fmu ", "from ps_fmu_12 ")
    assert rename_imports(source.encode(), "x.py", NAMES).decode() == expected


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("\nimport ps_fmu.slavekit\n", "x.py:2: 'import ps_fmu.slavekit'"),
        ("import pythonfmu as p\n", "x.py:1: 'import pythonfmu'"),
        ("import_module('ps_fmu.slavekit.author.slave')\n", "x.py:1: 'ps_fmu.slavekit.author.slave' looks like"),
        ("__import__('pythonfmu')\n", "x.py:1: 'pythonfmu' looks like"),
    ],
)
def test_what_cannot_be_renamed_is_told(source, problem):
    with pytest.raises(BuildError) as error:
        rename_imports(source.encode(), "x.py", NAMES)
    assert problem in str(error.value)
