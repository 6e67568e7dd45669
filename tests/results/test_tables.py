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
    assert max(map(len, table.fit_text(40).splitlines())) <= 40
    assert " ".join(table.fit_text(40).split()).count("words") == 1
    assert table.fit_text(10) is None
    assert Table("Empty", ["a", "bc"], []).fit_text(10) == Table("Empty", ["a", "bc"], []).to_text() == "a  bc\n-----"


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
