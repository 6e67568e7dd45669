"""READMEs as pages."""

from xml.etree.ElementTree import fromstring

from ps_fmu.fmu.documentation import page

README = """# Title & more

A paragraph with `a < b` and [a link](https://example.org/x).

| name | unit |
|------|------|
| `x` | m |

```python
x = "<b>"
```
"""


def test_a_page_has_the_structure_of_its_source():
    text = page(README, "A & B").decode()
    root = fromstring(text.replace("<!DOCTYPE html>\n", "").replace('<meta charset="utf-8">', ""))
    body = root.find("body")
    assert [element.tag for element in body] == ["h1", "p", "table", "pre"]
    assert root.findtext("head/title") == "A & B"
    assert "".join(body[1].itertext()) == "A paragraph with a < b and a link."
    assert ["".join(cell.itertext()) for cell in body[2].iter("td")] == ["x", "m"]
    assert "".join(body[3].itertext()) == 'x = "<b>"\n'
