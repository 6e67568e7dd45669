import base64
from html.parser import HTMLParser

import pytest

from ps_fmu.results.report import Picture, Report
from ps_fmu.results.summary import FmuFile
from ps_fmu.results.tables import Table

HOSTILE = '<script>alert("&")</script>'


class Reader(HTMLParser):
    """Collects the tags in order, checks that they nest, and keeps the text and the attributes."""

    VOID = ("meta", "img")

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.texts, self.attributes = [], [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def read(report):
    reader = Reader()
    reader.feed(report.html())
    reader.close()
    assert reader.open == []
    return reader


def test_everything_is_shown(tmp_path):
    picture = tmp_path / "a.png"
    picture.write_bytes(b"\x89PNG picture")
    reader = read(
        Report(
            title="Isolation",
            text=["What was run."],
            tables=[Table("Result", ["axis", "RMS (rad)"], [["x", "1.65e-05"], ["y", "5.02e-06"]])],
            pictures=[Picture(picture, "Jitter of the payload")],
            parameters={"plant.payload.mass": 61.4},
            fmus=[FmuFile("ManipulatorPlant", "ab" * 32)],
            versions={"numpy": "2.4.6"},
            warnings=["commander.target.roll is not connected"],
        )
    )
    assert set(reader.texts) >= {
        "Isolation", "What was run.", "Result", "1.65e-05", "Jitter of the payload", "plant.payload.mass", "61.4",
        "ManipulatorPlant", "ab" * 32, "2.4.6", "commander.target.roll is not connected",
    }  # fmt: skip
    embedded = dict(reader.attributes)["src"]
    assert base64.b64decode(embedded.removeprefix("data:image/png;base64,")) == b"\x89PNG picture"
    assert reader.tags.count("table") == 4


def test_hostile_texts_stay_texts(tmp_path):
    picture = tmp_path / "a.png"
    picture.write_bytes(b"")
    reader = read(
        Report(
            title=HOSTILE,
            text=[HOSTILE],
            tables=[Table(HOSTILE, [HOSTILE], [[HOSTILE]])],
            pictures=[Picture(picture, HOSTILE)],
            parameters={HOSTILE: HOSTILE},
            fmus=[FmuFile(HOSTILE, HOSTILE)],
            versions={HOSTILE: HOSTILE},
            warnings=[HOSTILE],
        )
    )
    assert "script" not in reader.tags
    assert reader.texts.count(HOSTILE) == 14
    assert ("alt", HOSTILE) in reader.attributes


def test_the_file_is_utf8_and_fetches_nothing(tmp_path):
    Report(title="\N{MICRO SIGN}rad").write(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "\N{MICRO SIGN}rad" in page and "http://" not in page and "https://" not in page


def test_a_missing_picture_leaves_no_report(tmp_path):
    with pytest.raises(FileNotFoundError):
        Report(title="a", pictures=[Picture(tmp_path / "none.png", "")]).write(tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
