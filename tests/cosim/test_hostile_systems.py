"""Systems that are nested or repeated without measure: refused by name, in time and space that have a bound."""

import io
import os
import shutil
import zipfile

import pytest
from support.relays import description, port, relay, system

from ps_fmu.cosim import SystemFileError, read_system
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.cosim.signals import read_signals
from ps_fmu.cosim.ssp import sources
from ps_fmu.files.plain import read_bytes
from ps_fmu.requirements.requirement import read_requirements
from ps_fmu.studies.study import read_study


@pytest.fixture
def folder(toys, tmp_path):
    (tmp_path / "resources").mkdir()
    shutil.copy(toys / "ToyRelay.fmu", tmp_path / "resources")
    return tmp_path


def nest(inside, count=40):
    for number in range(count):
        inside = system(f'<ssd:System name="s{number}">{inside}</ssd:System>')
    return inside


@pytest.mark.parametrize("text", ["&#10;ps-fmu: done", "&#9;", "&#x85;", "&#x9b;31m"])
def test_names_that_forge_lines_or_drive_the_terminal(folder, text):
    (folder / "a.ssd").write_text(description(system(relay(f"r{text}"))))
    with pytest.raises(SystemFileError, match=r"component 'r\\.*': control characters and line breaks"):
        read_system(folder / "a.ssd")


def test_systems_nested_through_many_files(folder):
    for k in range(18):
        deeper = f'<ssd:Component name="c" type="application/x-ssp-definition" source="{k + 1}.ssd"/>'
        (folder / f"{k}.ssd").write_text(description(nest(system(deeper if k < 17 else relay("r")))))
    with pytest.raises(SystemFileError, match="more than 100 systems lie in one another"):
        read_system(folder / "0.ssd")
    assert len(read_system(folder / "16.ssd").components) == 1  # 82 deep


def test_connectors_that_references_multiply(folder, monkeypatch):
    monkeypatch.setattr("ps_fmu.cosim.ssp.ssd.MOST_CONNECTORS", 1000)
    wide = f'<ssd:System name="w" id="w">{system(relay("r"), "", "".join(port(f"p{k}", "input") for k in range(90)))}'
    (folder / "a.ssd").write_text(description(system(
        f'{wide}</ssd:System>{"".join(f"""<ssd:Component name="c{k}" source="#w"/>""" for k in range(20))}'
    )))  # fmt: skip
    with pytest.raises(SystemFileError, match="more than 1000 connectors"):
        read_system(folder / "a.ssd")


def make_nested(folder, names):
    """An archive with archives, each with a component and 100 kB of zeros."""
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SystemStructure.ssd", description(system(relay("r"))))
        archive.write(folder / "resources" / "ToyRelay.fmu", "resources/ToyRelay.fmu")
        archive.writestr("zeros", bytes(100_000))
    with zipfile.ZipFile(folder / "outer.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", description(system("".join(
            f'<ssd:Component name="c{k}" type="application/x-ssp-package" source="{name}"/>'
            for k, name in enumerate(names)
        ))))  # fmt: skip
        for name in set(names):
            archive.writestr(name, inner.getvalue())
    return folder / "outer.ssp"


def test_an_archive_in_an_archive_is_unpacked_once(folder):
    found = read_system(make_nested(folder, ["in.ssp"] * 5))
    assert len(found.components) == 5
    assert len({component.source for component in found.components}) == 1


def test_archives_in_archives_have_one_bound(folder, monkeypatch):
    path = make_nested(folder, [f"{k}.ssp" for k in range(30)])
    monkeypatch.setattr(sources, "MAXIMUM_BYTES", path.stat().st_size + 1_000_000)
    with pytest.raises(SystemFileError, match="archives of the system unpack to more"):
        read_system(path)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_of_inputs_end_as_files_do(tmp_path, end):
    path = tmp_path / "in.csv"
    path.write_bytes(f"time,u\u2028v{end}0,1{end}1,2{end}".encode())
    assert list(read_signals(path)["u\u2028v"].texts) == ["1", "2"]


@pytest.mark.parametrize("read", [read_signals, read_faults, read_requirements, read_study])
def test_pipes_and_devices_are_refused(tmp_path, read):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    keep_open = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)  # whoever reads it all the same finds a text, and no end
    os.write(keep_open, b"?")
    link = tmp_path / "link"
    link.symlink_to("/dev/null")
    try:
        for path in (link, pipe):  # the device first: it ends at once
            with pytest.raises(ValueError, match="is a folder, pipe or device"):
                read(path)
    finally:
        os.close(keep_open)


def test_no_more_is_read_than_asked_for(tmp_path):
    (tmp_path / "four").write_bytes(b"1234")
    assert read_bytes(tmp_path / "four", 4) == b"1234"
    with pytest.raises(SystemFileError, match="at most 3 are read"):
        read_bytes(tmp_path / "four", 3)
