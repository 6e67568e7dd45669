"""C from the equations of the mechanism: ``make derive`` writes equations.h and equations.c in ``native/mechanism``.

A function is written operation by operation, in the order in which CasADi lists them.  What is used once stands where
it is used; all else is a constant of its own.  So the compiler sees plain arithmetic, whose bits it may not change.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from pathlib import Path

import casadi as ca

from ..native import FOLDER
from .equations import (
    MOTION,
    PARAMETERS,
    count,
    derive_accelerations,
    derive_change,
    derive_legs,
    derive_masses,
    derive_momentum,
)
from .output_equations import PLACE, derive_outputs, derive_outputs_change

#: Where what is made goes.
TARGET = FOLDER / "mechanism"

FUNCTIONS = (
    derive_legs, derive_accelerations, derive_change, derive_masses, derive_momentum, derive_outputs,
    derive_outputs_change,
)  # fmt: skip

STRUCTURES = (
    ("EquationsParameters", PARAMETERS, "p: parameters."),
    ("EquationsMotion", MOTION, "z: what moves, and what moves it; dz: its change along a direction."),
    ("EquationsPlace", PLACE, "place: what the outputs that are not linear depend on."),
)

_OPERATIONS = {
    ca.OP_ADD: "{} + {}", ca.OP_SUB: "{} - {}", ca.OP_MUL: "{} * {}", ca.OP_DIV: "{} / {}", ca.OP_NEG: "-{}",
    ca.OP_SQRT: "sqrt({})", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2.0 * {}", ca.OP_INV: "1.0 / {}",
}  # fmt: skip
_WIDEST = 90
_MADE = "/* Made by 'make derive' from mechanism/equations.py. */"


def write_header() -> str:
    """equations.h: the structures, and what each function takes and gives."""
    lines = [_MADE, "#ifndef EQUATIONS_H", "#define EQUATIONS_H"]
    for name, layout, text in STRUCTURES:
        lines += ["", f"/* {text} */", f"typedef struct {name} {{"]
        for field, shape, unit, meaning in layout:
            lines += _wrap(f"{meaning} ({unit})", "    ")
            lines.append(f"    double {field}[{count(shape)}];")
        lines.append(f"}} {name};")
    for derive in FUNCTIONS:
        f, text = derive(), " ".join(str(derive.__doc__).split())
        sizes = [f"{name} ({f.size1_in(i)})" for i, name in enumerate(f.name_in())]
        results = [f"{name} ({f.size1_out(i)})" for i, name in enumerate(f.name_out())]
        lines += ["", *_wrap(f"{text} From {', '.join(sizes)}: {', '.join(results)}."), _declare(f) + ";"]
    return "\n".join([*lines, "", "#endif", ""])


def write_source() -> str:
    """equations.c."""
    bodies = [_write_function(derive()) for derive in FUNCTIONS]
    return "\n\n".join([f'{_MADE}\n#include "equations.h"\n\n#include <math.h>', *bodies]) + "\n"


def write_all(folder: Path = TARGET) -> None:
    """Write both files into a folder."""
    (folder / "equations.h").write_text(write_header(), encoding="utf-8")
    (folder / "equations.c").write_text(write_source(), encoding="utf-8")


def _wrap(text: str, indent: str = "") -> list[str]:
    lines = textwrap.wrap(f"/* {text} */", 116 - len(indent))
    return [indent + lines[0], *(f"{indent}   {line}" for line in lines[1:])]


def _declare(f: ca.Function) -> str:
    arguments = [f"const double *{name}" for name in f.name_in()]
    arguments += [f"double *restrict {name}" for name in f.name_out()]
    text = f"void equations_{f.name()}({', '.join(arguments)})"
    return "\n    ".join(textwrap.wrap(text, 112, break_long_words=False))


def _write_function(f: ca.Function) -> str:
    names_in, names_out, n = f.name_in(), f.name_out(), f.n_instructions()
    kinds = [f.instruction_id(k) for k in range(n)]
    operands = _list_operands(f, kinds)
    uses = Counter(i for each in operands for i in each)
    uses.update(i for k, each in enumerate(operands) if kinds[k] == ca.OP_SQ for i in each)  # it is written twice
    texts: list[str] = []
    lines = [_declare(f), "{"]
    for k, (kind, taken) in enumerate(zip(kinds, operands, strict=True)):
        if kind == ca.OP_INPUT:
            which, at = f.instruction_input(k)
            texts.append(f"{names_in[which]}[{at}]")
        elif kind == ca.OP_CONST:
            texts.append(repr(float(f.instruction_constant(k))))
        elif kind == ca.OP_OUTPUT:
            which, at = f.instruction_output(k)
            texts.append("")
            lines.append(f"    {names_out[which]}[{at}] = {texts[taken[0]]};")
        else:
            value = _OPERATIONS[kind].format(*(texts[i] for i in taken))
            if uses[k] == 1 and len(value) < _WIDEST:
                texts.append(f"({value})")
            else:
                lines.append(f"    const double v{k} = {value};")
                texts.append(f"v{k}")
    return "\n".join([*lines, "}"])


def _list_operands(f: ca.Function, kinds: list[int]) -> list[list[int]]:
    """Of each instruction, those whose results it takes.  CasADi numbers registers, which it uses again."""
    registers: dict[int, int] = {}
    operands: list[list[int]] = []
    for k, kind in enumerate(kinds):
        operands.append([] if kind in (ca.OP_INPUT, ca.OP_CONST) else [registers[i] for i in f.instruction_input(k)])
        if kind != ca.OP_OUTPUT:
            registers[f.instruction_output(k)[0]] = k
    return operands


if __name__ == "__main__":
    write_all()
