"""READMEs as pages."""

from xml.etree.ElementTree import fromstring

from ps_fmu.fmu.documentation import page

README = """# Title & more

A paragraph with `a < b`, **strong**, *slanted* words and
[a link](https://example.org/x). 2 * 3 * 4 stays.

## List
- one
  goes on
- two

1. first
2. second

| name | unit |
|------|:----:|
| `x` | m |
| y | N |

```python
# no heading
x = "<b>"
```
Last.
"""


def test_a_page_has_the_structure_of_its_source():
    text = page(README, "A & B").decode()
    root = fromstring(text.replace("<!DOCTYPE html>\n", "").replace('<meta charset="utf-8">', ""))
    body = root.find("body")
    assert [element.tag for element in body] == ["h1", "p", "h2", "ul", "ol", "table", "pre", "p"]
    assert root.findtext("head/title") == "A & B"
    assert "".join(body[0].itertext()) == "Title & more"
    assert [element.tag for element in body[1]] == ["code", "strong", "em", "a"]
    assert body[1].find("a").get("href") == "https://example.org/x"
    assert "".join(body[1].itertext()).endswith("2 * 3 * 4 stays.")
    assert [item.text for item in body[3]] == ["one goes on", "two"]
    assert [["".join(cell.itertext()) for cell in row] for row in body[5]] == [["name", "unit"], ["x", "m"], ["y", "N"]]
    assert [cell.tag for row in body[5] for cell in row] == ["th"] * 2 + ["td"] * 4
    assert body[6].text == '# no heading\nx = "<b>"\n'
