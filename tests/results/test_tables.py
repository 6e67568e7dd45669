import pytest

from ps_fmu.results.tables import Table

TABLE = Table("Jitter", ["axis", "RMS (rad)"], [["x", "1.65e-05"], ["y", "5e-06"]])


def test_text():
    assert TABLE.to_text().splitlines() == [
        "axis  RMS (rad)",
        "---------------",
        "x      1.65e-05",
        "y         5e-06",
    ]


def test_text_in_a_narrow_terminal():
    text = "three short words that fill more than one line of a terminal, and some"
    table = Table("Words", ["a", "b"], [["x", text]])
    assert max(map(len, table.to_text(40).splitlines())) <= 40
    assert " ".join(table.to_text(40).split()).count("words") == 1
    assert table.fits(40)
    assert not table.fits(10)
    assert Table("Empty", ["a", "bc"], []).to_text(10) == "a  bc\n-----"


def test_names_of_signals_are_broken_behind_their_dots():
    table = Table("Names", ["a", "b"], [["plant.payload_rotation.x", "word " * 30]])
    assert {"plant.", "payload_rotation.x"} <= {line.split("  ")[0] for line in table.to_text(42).splitlines()}


def test_a_note_stands_below_its_row():
    table = Table("Notes", ["a", "b"], [["x", "1"], ["y", "2"]], notes=["", "run <longer> " * 12])
    lines = table.to_text().splitlines()
    assert [line[:4] for line in lines] == ["a  b", "----", "x  1", "y  2", "    ", "    "]
    assert max(map(len, lines)) <= 100
    assert table.to_html().count('<tr class="note"><td colspan="2">run &lt;longer&gt;') == 1
    assert table.to_markdown().count("| run <longer>") == 1
    with pytest.raises(ValueError, match="expected 2 notes, got 1"):
        Table("Notes", ["a"], [["x"], ["y"]], notes=["one"])


def test_markdown():
    table = Table("Other", ("a", "b"), [("1", "2|3")])
    assert table.to_markdown() == "**Other**\n\n| a | b |\n| --- | --- |\n| 1 | 2\\|3 |"


def test_html_is_escaped_and_wide_columns_are_words():
    table = Table("<Caption>", ("a", "b"), [("1", "a text of more than a few words"), ("2", "-")])
    assert "&lt;Caption&gt;" in table.to_html()
    assert '<td>1</td><td class="words">a text of more than a few words</td>' in table.to_html()


def test_every_row_has_an_entry_in_each_column():
    with pytest.raises(ValueError, match="table 'Result': every row must have 2 entries"):
        Table("Result", ["a", "b"], [["1"]])
