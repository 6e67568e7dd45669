import io
import os
import shutil
import zipfile
from pathlib import Path

import pytest

import ps_fmu
from ps_fmu.product.files import ProductFiles
from ps_fmu.runs import built_fmus
from ps_fmu.runs.built_fmus import (
    ensure_built,
    find_built_folder,
    find_cache,
    find_newest_source,
    list_models,
    list_outdated,
    provide_fmus,
)
from ps_fmu.slavekit.pack import build
from ps_fmu.terminal import reason

TOYS = Path(__file__).parents[1] / "slavekit" / "models"
SYSTEM = """<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
version="1.0" name="one"><ssd:System name="one"><ssd:Elements>
<ssd:Component name="waves" source="resources/{}.fmu"/></ssd:Elements></ssd:System></ssd:SystemStructureDescription>"""


@pytest.fixture
def checkout(tmp_path):
    """A checkout whose sources were changed at 1000 s, and FMUs that were built at 2000 s."""
    for path in ("fmus/disturbance_source", "fmus/pointing_commander"):
        source = tmp_path / path / f"{path.removeprefix('fmus/')}.py"
        source.parent.mkdir(parents=True)
        source.write_text("")
        os.utime(source, (1000, 1000))
    folder = tmp_path / "build"
    folder.mkdir()
    for name in ("PointingCommander", "DisturbanceSource"):
        (folder / f"{name}.fmu").write_text("")
        os.utime(folder / f"{name}.fmu", (2000, 2000))
    return tmp_path


def test_each_folder_makes_an_fmu(checkout):
    assert list_models(checkout) == ["DisturbanceSource", "PointingCommander"]


def test_what_is_newer_than_its_sources_is_kept(checkout):
    assert find_newest_source(checkout) == 1000.0
    assert list_outdated(checkout / "build", checkout) == []
    assert ensure_built(checkout / "build", checkout) == []


def test_missing_and_old_fmus_are_named(checkout):
    (checkout / "build" / "PointingCommander.fmu").unlink()
    os.utime(checkout / "build" / "DisturbanceSource.fmu", (500, 500))
    assert list_outdated(checkout / "build", checkout) == ["DisturbanceSource", "PointingCommander"]


def test_the_package_s_own_file_is_in_each_fmu(checkout):
    package = checkout / "src" / "ps_fmu" / "__init__.py"
    package.parent.mkdir(parents=True)
    package.write_text("")
    os.utime(package, (3000, 3000))
    assert list_outdated(checkout / "build", checkout) == ["DisturbanceSource", "PointingCommander"]


def test_all_that_is_packed_is_watched(built_fmus, checkout):
    """Each room and module of the package that is in any FMU."""
    package, packed = Path(ps_fmu.__file__).parent, set()
    for path in built_fmus.glob("*.fmu"):
        with zipfile.ZipFile(path) as archive:
            inside = [name.split("/", 2)[2] for name in archive.namelist() if name.startswith("resources/ps_fmu_")]
            for name in archive.namelist():
                if "/modules_" in name:  # modules that need not be files
                    with zipfile.ZipFile(io.BytesIO(archive.read(name))) as modules:
                        inside += [one.partition("/")[2] for one in modules.namelist()] + modules.namelist()
        packed |= {name.partition("/")[0] for name in inside}
    rooms = packed & {path.name for path in package.iterdir()} - {"__pycache__", ""}
    assert {"mechanism", "numerics", "native"} <= rooms
    for room in rooms:
        source = checkout / "src" / "ps_fmu" / room / ("" if room.endswith(".py") else "library.py")
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text("")
        os.utime(source, (3000, 3000))
        assert list_outdated(checkout / "build", checkout) == ["DisturbanceSource", "PointingCommander"], room
        source.unlink()


def test_a_new_folder_is_a_new_fmu(tmp_path):
    """Nothing else names it: it is found, built, and then up to date."""
    shutil.copytree(TOYS / "waves", tmp_path / "fmus" / "waves")
    assert ensure_built(tmp_path / "build", tmp_path) == ["Waves"]
    assert (tmp_path / "build" / "Waves.fmu").is_file()
    assert ensure_built(tmp_path / "build", tmp_path) == []


def test_compiled_modules_are_no_sources(checkout):
    cache = checkout / "fmus" / "__pycache__"
    cache.mkdir(parents=True)
    (cache / "a.pyc").write_text("")
    assert find_newest_source(checkout) == 1000.0


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package as a wheel installs it, with one FMU and a system that names it; the user's folders are new."""
    product = tmp_path / "site-packages" / "ps_fmu" / "product"
    shutil.copytree(TOYS / "waves", product / "fmus" / "waves")
    (product / "system").mkdir()
    (product / "system" / "one.ssd").write_text(SYSTEM.format("Waves"))
    monkeypatch.setattr(built_fmus, "find_product", lambda: ProductFiles(product, in_checkout=False))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return product


def test_an_installed_package_builds_once_into_the_cache(installed, tmp_path, capsys):
    folder = find_built_folder()
    assert folder.parent == tmp_path / "cache" / "ps_fmu"
    assert not folder.exists()
    provide_fmus(folder)
    assert capsys.readouterr().err == f"building Waves.fmu, once, into {folder}\n"
    (built,) = folder.iterdir()
    assert built.name == "Waves.fmu"
    assert folder.parent.stat().st_mode & 0o777 == 0o700
    os.utime(built, (500, 500))  # an age says nothing: the folder's name does
    provide_fmus(find_built_folder())
    assert (capsys.readouterr().err, built.stat().st_mtime) == ("", 500)


def test_only_the_fmus_of_the_system_are_built(installed, tmp_path):
    other = tmp_path / "other.ssd"
    other.write_text(SYSTEM.format("Others"))
    provide_fmus(find_built_folder(), other)
    provide_fmus(find_built_folder(), tmp_path / "an.ssp")  # has its own
    assert not find_built_folder().exists()
    provide_fmus(find_built_folder(), installed / "system" / "one.ssd")
    assert (find_built_folder() / "Waves.fmu").is_file()


def test_other_sources_have_another_folder(installed):
    before = find_built_folder()
    source = installed / "fmus" / "waves" / "waves.py"
    source.write_text(source.read_text() + "\n")
    changed = find_built_folder()
    assert changed != before
    (installed / "__pycache__").mkdir()
    (installed / "__pycache__" / "files.pyc").write_text("")
    assert find_built_folder() == changed
    source.rename(source.with_name("elsewhere.py"))
    assert find_built_folder() not in (before, changed)


def test_an_interrupted_build_leaves_no_fmu(installed, monkeypatch):
    def interrupted(fmu):
        raise KeyboardInterrupt

    monkeypatch.setattr(build, "check_trial", interrupted)
    with pytest.raises(KeyboardInterrupt):
        provide_fmus(find_built_folder())
    assert [path for path in find_cache().rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("stated", ["", "cache", "../cache"])
def test_a_cache_folder_that_is_not_absolute_is_ignored(monkeypatch, tmp_path, stated):
    """XDG Base Directory Specification: consider the path invalid and ignore it."""
    monkeypatch.setenv("XDG_CACHE_HOME", stated)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert find_cache() == tmp_path / ".cache" / "ps_fmu"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert find_cache() == tmp_path / ".cache" / "ps_fmu"


def test_a_cache_that_cannot_be_made_is_said_with_what_helps(installed, tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("")
    with pytest.raises(OSError) as refused:
        provide_fmus(find_built_folder())
    assert reason(refused.value).startswith(f"{tmp_path / 'cache' / 'ps_fmu'}: Not a directory\nSet XDG_CACHE_HOME to")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for a user whom the system does not know
    with pytest.raises(OSError, match=r"Could not determine home directory\. Set XDG_CACHE_HOME"):
        find_cache()
