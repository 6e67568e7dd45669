from pathlib import Path

import pytest

from ps_fmu.product import files
from ps_fmu.product.files import ProductFiles, find_file, find_product, list_system_files

ROOT = Path(__file__).parents[2]


@pytest.fixture
def wheel(tmp_path):
    """The folder of the module as an installed wheel has it, where a folder fmus lies that is none of its business."""
    here = tmp_path / "lib" / "site-packages" / "ps_fmu" / "product"
    for folder in (here / "fmus", here / "system", tmp_path / "lib" / "fmus"):
        folder.mkdir(parents=True)
    return here


def test_the_tests_run_in_a_checkout():
    assert find_product() == ProductFiles(ROOT, in_checkout=True)
    assert (find_product().fmus, find_product().system) == (ROOT / "fmus", ROOT / "system")


def test_a_wheel_has_its_own_files(wheel):
    assert find_product(wheel) == ProductFiles(wheel, in_checkout=False)


def test_a_package_alone_does_not_take_what_lies_around_it(wheel):
    (wheel / "fmus").rmdir()
    with pytest.raises(FileNotFoundError, match=r"the FMUs' sources are not there: .*ps_fmu is neither installed"):
        find_product(wheel)


def test_what_the_user_has_goes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_file(Path("rigid.ssv")) == ROOT / "system" / "parameters" / "rigid.ssv"
    Path("rigid.ssv").write_text("")
    assert find_file(Path("rigid.ssv")) == Path("rigid.ssv")


@pytest.mark.parametrize("name", ["none.ssv", "/rigid.ssv", "../system/LineOfSight.ssd", "parameters", ""])
def test_what_is_no_file_of_the_product_stays_as_it_is(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert find_file(Path(name)) == Path(name)


def test_without_the_product_a_path_stays_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(files.find_product, "__defaults__", (tmp_path / "ps_fmu" / "product",))
    assert find_file(Path("rigid.ssv")) == Path("rigid.ssv")
    assert list_system_files() == []


def test_all_files_of_the_system_are_listed():
    listed = list_system_files()
    assert {"SystemStructure.ssd", "LineOfSight.ssd", "exact_payload.ssv"} < set(listed)
    assert all(find_file(Path(name)).is_relative_to(ROOT / "system") for name in listed)
