"""Archives that nobody vouches for, as .fmu and as .ssp: refused, or unpacked to what they list and nothing else."""

import contextlib
import copy
import io
import os
import struct
import tempfile
import tracemalloc
import warnings
import zipfile
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.cosim import OSCILLATOR, ssd_text

from ps_fmu.cosim import CosimError, Master, SystemFileError, read_system
from ps_fmu.cosim.description import read_description
from ps_fmu.files.archive import check_archive, check_content, extract, read_member

SSV = (
    b'<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="a">'
    b'<ssv:Parameters>\n<ssv:Parameter name="mass.mass"><ssv:Real value="2"/></ssv:Parameter></ssv:Parameters>'
    b"</ssv:ParameterSet>"
)


def written(path, members, method=zipfile.ZIP_DEFLATED):
    """An archive with these names; a content may also be a ZipInfo, to be written as it is."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


def refusals(path, folder):
    """What all that opens archives says to this one; nothing may be unpacked."""
    for use in (check_archive, read_description, lambda p: extract(p, folder), read_system):
        with pytest.raises(SystemFileError) as caught:
            use(path)
        yield str(caught.value)
    assert not folder.exists()


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["a/./b"], "'a/./b' has another path that means the same"),
        (["a//b"], "'a//b' has another path"),
        (["./modelDescription.xml"], "another path"),
        (["a/b//"], "another path"),
        (["."], "another path"),
        (["./"], "another path"),
        (["a/..", "b"], "leaves the target folder"),
        (["a", "../escaped"], "leaves the target folder"),
        (["resources/../../escaped"], "leaves the target folder"),
        (["/tmp/escaped"], "not a relative path"),
        (["C:/escaped"], "not a relative path"),
        (["..\\escaped"], "not a relative path"),
        (["a", "a/b"], "'a' is a file and a folder"),
        (["a", "a/"], "'a' is a file and a folder"),
        (["a/b/c/d", "a/b"], "'a/b' is a file and a folder"),
        (["c:d"], "not a relative path"),
        (["\\\\server\\share"], "not a relative path"),
        (["//server/share"], "not a relative path"),
    ],
)
def test_names(tmp_path, names, reason):
    path = written(tmp_path / "a.ssp", [(name, "x") for name in names])
    for text in refusals(path, tmp_path / "inside"):
        assert reason in text
    assert list(tmp_path.iterdir()) == [path]


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.fmu")
    with pytest.raises(SystemFileError, match="no ordinary file"):
        check_archive(tmp_path / "a.fmu")


def test_a_second_name(tmp_path):
    """Info-ZIP's field for another name, which newer versions of Python unpack under."""
    info = zipfile.ZipInfo("harmless")
    other = b"..\\" * 3 + b"evil"
    info.extra = struct.pack("<HHBL", 0x7075, 5 + len(other), 1, zipfile.crc32(b"harmless")) + other
    path = written(tmp_path / "a.fmu", [(info, "x")])
    try:
        extract(path, tmp_path / "inside")
    except SystemFileError as error:
        assert "has a second name" in str(error)
    else:
        assert [file.name for file in (tmp_path / "inside").iterdir()] == ["harmless"]


def test_a_bomb_of_overlapping_members(tmp_path):
    """2.5 GB in 30 kB."""
    path = tmp_path / "bomb.ssp"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("0", bytes(10_000_000))
        for k in range(1, 250):
            again = copy.copy(archive.filelist[0])
            again.filename = again.orig_filename = str(k)
            archive.filelist.append(again)
            archive.NameToInfo[again.filename] = again
    assert path.stat().st_size < 40_000
    for text in refusals(path, tmp_path / "inside"):
        assert "would unpack to 2500000000 bytes in 250 files" in text


def test_a_bomb_that_lies_about_its_size(tmp_path):
    path = written(tmp_path / "a.fmu", [("modelDescription.xml", bytes(10_000_000))])
    raw = path.read_bytes()
    path.write_bytes(raw.replace(struct.pack("<I", 10_000_000), struct.pack("<I", 10)))
    with pytest.raises(SystemFileError, match="cannot be read"):
        read_member(path, "modelDescription.xml", 100)
    with pytest.raises(SystemFileError, match="cannot be unpacked"):
        extract(path, tmp_path / "inside")
    assert sum(file.stat().st_size for file in (tmp_path / "inside").rglob("*")) <= 10
    with pytest.raises(SystemFileError, match="damaged"):
        check_content(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_no_more_is_inflated_than_a_member_claims(tmp_path, method):
    """Also where the checksum is that of what is claimed."""
    size, claimed = 30_000_000, bytes(2000)
    path = written(tmp_path / "a.fmu", [("modelDescription.xml", bytes(size))], method)
    raw = path.read_bytes().replace(struct.pack("<I", size), struct.pack("<I", len(claimed)))
    path.write_bytes(raw.replace(struct.pack("<I", zlib.crc32(bytes(size))), struct.pack("<I", zlib.crc32(claimed))))
    tracemalloc.start()
    try:
        for use in (lambda: read_member(path, "modelDescription.xml", 5000), lambda: extract(path, tmp_path / "in")):
            with contextlib.suppress(SystemFileError):
                check_archive(path)
                use()
        assert tracemalloc.get_traced_memory()[1] < size / 5
    finally:
        tracemalloc.stop()


def test_a_folder_may_be_entered_twice(tmp_path):
    """As CMake writes archives."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile says that the name is there already
        path = written(tmp_path / "a.fmu", [("extra/", b""), ("extra/a", b"1"), ("extra/", b"")])
    assert check_archive(path) == ["extra/", "extra/a"]
    extract(path, tmp_path / "inside")
    assert (tmp_path / "inside" / "extra" / "a").read_bytes() == b"1"


def test_too_many_members(tmp_path, monkeypatch):
    monkeypatch.setattr("ps_fmu.files.archive.MAXIMUM_MEMBERS", 3)
    path = written(tmp_path / "a.ssp", [(str(k), "") for k in range(4)])
    for text in refusals(path, tmp_path / "inside"):
        assert "in 4 files; at most" in text


def test_paths_that_the_system_does_not_take(tmp_path):
    for name in ("x" * 300, "x" + "/x" * 3000):
        path = written(tmp_path / "long.fmu", [(name, "x")])
        for refuse in (check_archive, lambda path: extract(path, tmp_path / "inside")):
            with pytest.raises(SystemFileError, match="is too long"):
                refuse(path)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"SystemStructure.ssd": b"<a>"}, r"/a\.ssp/SystemStructure\.ssd, line 1: is not well-formed"),
        ({"resources/ToyMass.fmu": None}, r"no FMU .*/a\.ssp/resources/ToyMass\.fmu; build it"),
        ({"resources/ToyMass.fmu": b"no archive"}, r"/a\.ssp/resources/ToyMass\.fmu: is not a readable ZIP archive"),
        ({"mass.ssv": b"<a/>"}, r"/a\.ssp/mass\.ssv, line 1: is not a parameter set"),
        ({"mass.ssv": SSV.replace(b"mass.mass", b"mass.miss")}, r"mass\.miss \(.*/a\.ssp/mass\.ssv, line 2\): there"),
    ],
)
def test_errors_in_an_ssp_name_the_archive_and_the_member(toys, tmp_path, changed, text):
    binding = '<ssd:ParameterBindings><ssd:ParameterBinding source="mass.ssv"/></ssd:ParameterBindings>'
    members = {"SystemStructure.ssd": ssd_text(*OSCILLATOR, binding).encode(), "mass.ssv": SSV}
    members |= {f"resources/{name}.fmu": (toys / f"{name}.fmu").read_bytes() for name in ("ToyMass", "ToySpring")}
    path = written(tmp_path / "a.ssp", [(name, data) for name, data in (members | changed).items() if data is not None])
    with pytest.raises(CosimError, match=text) as raised:
        Master(read_system(path), 0.01)
    assert f"{tempfile.gettempdir()}/ssp_" not in str(raised.value)


def test_a_refused_ssp_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    good = ssd_text(*OSCILLATOR).encode()
    for members in (
        [("SystemStructure.ssd", good[:200])],
        [("SystemStructure.ssd", good)],  # no FMUs
        [("SystemStructure.ssd", good), ("../x", b"")],
        [("resources/ToyMass.fmu", b"")],
        [("SystemStructure.ssd/x", good)],
        [("SystemStructure.ssd", good), ("resources/ToyMass.fmu/x", b""), ("resources/ToySpring.fmu", b"")],
    ):
        with pytest.raises(SystemFileError):
            read_system(written(tmp_path / "a.ssp", members))
        assert list((tmp_path / "temporary").iterdir()) == []


# --- Damage -------------------------------------------------------------------------------


def sample(method):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("modelDescription.xml", "<a/>" * 50)
        archive.writestr("resources/ä", "b" * 100)
        archive.writestr("folder/", "")
        with archive.open("large", "w", force_zip64=True) as member:
            member.write(b"abc" * 10)
    return buffer.getvalue()


SAMPLES = [sample(m) for m in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)]
EDITS = st.lists(
    st.tuples(
        st.floats(0.0, 1.0, exclude_max=True),
        st.sampled_from((0, 1, 1, 2, 4, 8)),
        st.one_of(st.sampled_from((b"\0", b"\xff", b"\0\0\0\x80", b"\xff\xff\xff\xff")), st.binary(max_size=8)),
    ),
    min_size=1,
    max_size=4,
)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@settings(max_examples=300)
@given(st.sampled_from(SAMPLES), EDITS, st.one_of(st.none(), st.floats(0.0, 1.0)))
def test_damage_is_an_error_of_ours_or_does_not_matter(tmp_path_factory, content, edits, cut):
    raw = bytearray(content)
    for share, n, new in edits:
        place = int(share * len(raw))
        raw[place : place + n] = new
    folder = Path(tempfile.mkdtemp(dir=tmp_path_factory.getbasetemp()))
    path = folder / "a.ssp"
    path.write_bytes(raw if cut is None else raw[: int(cut * len(raw))])
    for use in (read_description, read_system, check_content):
        with contextlib.suppress(SystemFileError):
            use(path)
    try:
        names = check_archive(path)
        extract(path, folder / "inside")
    except SystemFileError:
        return
    inside = folder / "inside"
    unpacked = {file.relative_to(inside).as_posix() for file in inside.rglob("*") if file.is_file()}
    assert unpacked == {name for name in names if not name.endswith("/")}
