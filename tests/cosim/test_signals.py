"""Inputs of a run over time: read from CSV, held or interpolated, and recorded as they were given."""

import re
import shutil

import numpy as np
import pytest
from support.cosim import Collect
from support.faults import write
from support.relays import description, make_relay, port, relay, system, wire

from ps_fmu.cosim import Master, SystemFileError, UsageError, read_system
from ps_fmu.cosim.signals import read_signals

H = 0.1
CSV = "time,u,n,b,a.level_in\n0,0,1,true,5\n0.2,2,1,true,5\n0.2,10,3,0,6\n0.4,14,3,1,7\n"


@pytest.fixture
def folder(toys, tmp_path):
    (tmp_path / "resources").mkdir()
    plain = shutil.copy(toys / "ToyRelay.fmu", tmp_path / "resources")
    make_relay(plain, tmp_path / "resources" / "Milli.fmu", {"real_in": "mm", "real_out": "mm"})
    inside = system(
        relay("a") + relay("m", source="Milli.fmu"),
        wire("u", "a/real_in") + wire("u", "m/real_in") + wire("n", "a/whole_in") + wire("b", "a/flag_in")
        + wire("v", "m/level_in") + wire("t", "m/text_in"),
        port("u", "input", '<ssc:Real unit="m"/>') + port("n", "input", "<ssc:Integer/>")
        + port("b", "input", "<ssc:Boolean/>") + port("v", "input") + port("t", "input", "<ssc:String/>"),
    )  # fmt: skip
    (tmp_path / "SystemStructure.ssd").write_text(description(inside))
    return tmp_path


def signals(folder, text):
    (folder / "in.csv").write_text(text)
    return read_signals(folder / "in.csv")


@pytest.mark.parametrize("block_rows", [1000, 2])
@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_inputs_follow_the_file(folder, collect, block_rows, scheme):
    inputs = signals(folder, CSV)
    with Master(read_system(folder), H, scheme, inputs=inputs, block_rows=block_rows) as master:
        master.initialise()
        master.run(6 * H, [collect])
        rows = dict(zip((column.name for column in master.columns), collect.values.T, strict=True))
    # Real and continuous: linear, and of two rows at one time the later counts; after the last row it stays.
    assert rows["u"] == pytest.approx([0.0, 1.0, 10.0, 12.0, 14.0, 14.0, 14.0], abs=1e-12)
    assert rows["n"].tolist() == [1, 1, 3, 3, 3, 3, 3]
    assert rows["b"].tolist() == [1, 1, 0, 0, 1, 1, 1]
    assert rows["a.level_in"].tolist() == [5, 5, 6, 6, 7, 7, 7]  # discrete: held
    # An FMU sees the value at the beginning of its step; row 0 is after the initialisation.
    for name, column in (("u", "a.real_out"), ("n", "a.whole_out"), ("b", "a.flag_out"), ("a.level_in", "a.level_out")):
        assert rows[column].tolist() == [rows[name][0], *rows[name][:-1]]
    assert rows["m.real_out"] == pytest.approx(1000.0 * rows["a.real_out"], rel=1e-15)


def test_an_input_may_be_of_one_row_or_begin_late(folder, collect):
    with Master(read_system(folder), H, inputs=signals(folder, "time,v\n0.15,4\n")) as master:
        master.initialise()
        master.run(3 * H, [collect])
        assert collect.values[:, [c.name for c in master.columns].index("m.level_out")].tolist() == [4.0] * 4


def test_what_a_fault_makes_of_an_input_is_recorded_beside_what_the_file_gives(folder, collect, tmp_path):
    faults = write(tmp_path, {"time": 0.0, "model": "a", "variable": "level_in", "action": "bias", "value": 2})
    inputs = signals(folder, "time,a.level_in\n0,3\n")
    with Master(read_system(folder), H, inputs=inputs, faults=faults) as master:
        names = [column.name for column in master.columns]
        master.initialise()
        master.run(3 * H, [collect])
        assert master.get("a.level_in") == 5
    assert len(set(names)) == len(names)
    rows = dict(zip(names, collect.values.T, strict=True))
    assert rows["a.level_in"].tolist() == [3.0, 5.0, 5.0, 5.0]  # row 0 is before the first step
    assert rows["a.level_in (input of the run)"].tolist() == [3.0] * 4


@pytest.mark.parametrize("begin", ["before", "after", "event"])
def test_a_value_that_is_set_takes_the_place_of_the_file(folder, collect, begin):
    events = [(H, "m.level_in", 9)] if begin == "event" else []
    with Master(read_system(folder), H, inputs=signals(folder, "time,v\n0,3\n1,5\n")) as master:
        if begin == "before":
            master.set("m.level_in", 9)
        master.initialise()
        if begin == "after":
            master.set("m.level_in", 9)
        master.run(4 * H, [collect], events)
        seen = collect.values[:, [c.name for c in master.columns].index("m.level_out")].tolist()
    assert seen == {"before": [9.0] * 5, "after": [3.0] + [9.0] * 4, "event": [3.0, 3.0, 9.0, 9.0, 9.0]}[begin]


def test_a_reset_gives_the_same_rows(folder, collect):
    again = Collect()
    with Master(read_system(folder), H, inputs=signals(folder, CSV)) as master:
        for observer in (collect, again):
            master.initialise()
            master.run(5 * H, [observer])
            master.reset()
    assert np.array_equal(collect.values, again.values)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("", 1, "expected a head such as time,input_1,input_2 with different names: the file is empty"),
        ("t,u\n0,1\n", 1, "expected a head such as time,input_1,input_2 with different names: the first column is"),
        ("time,u,u\n0,1,1\n", 1, "'u' occurs twice"),
        ("time;u\n0;1\n", 1, "the columns are not separated by commas"),
        ("time\n0\n", 1, "there is no input"),
        ("time,u,\n0,1,1\n", 1, "column 3 has no name"),
        ("time,u\n", 1, "expected rows below the head"),
        ("time,u\n0,1\n\n1,2,3\n", 4, "expected 2 values, got 3"),
        ("time,u\n0,1\n1,2\n0.5,3\n", 4, "does not decrease, got '0.5'"),
        ("time,u\nnow,1\n", 2, "got 'now'"),
        ("time,u\n0,1\n1,nan\n", 3, "input 'u': expected a value of type Real, got 'nan'"),
        ("time,n\n0,1\n1,2.5\n", 3, "input 'n': expected a value of type Integer, got '2.5'"),
        ("time,n\n0,3000000000\n", 2, "of type Integer, got '3000000000'"),
        ("time,u\n0,1e308\n1,-1e308\n", 3, "expected smaller steps than from 1e+308 at 0 s to -1e+308 at 1 s"),
        ("time,u\n-1e308,1\n1e308,2\n", 3, "which cannot be interpolated"),
        ("time,b\n0,2\n", 2, "input 'b': expected a value of type Boolean, got '2'"),
    ],
)
def test_files_that_are_refused(folder, text, line, reason):
    with pytest.raises(SystemFileError, match=re.escape(reason)) as caught:
        Master(read_system(folder), H, inputs=signals(folder, text))
    assert caught.value.line == line
    assert str(caught.value).startswith(f"{folder / 'in.csv'}, line {line}: ")


def test_two_inputs_for_one_variable_are_refused(folder):
    with pytest.raises(UsageError, match=r"in\.csv, line 1: 'u' and 'm\.real_in' both feed m\.real_in: leave one out"):
        Master(read_system(folder), H, inputs=signals(folder, "time,u,m.real_in\n0,1,2\n"))


def test_items_of_an_enumeration_have_names(folder, collect):
    make_relay(folder / "resources" / "ToyRelay.fmu", folder / "resources" / "E.fmu", items=[("red", 1), ("blue", 3)])
    (folder / "SystemStructure.ssd").write_text(description(system(relay("e", source="E.fmu"))))
    with Master(read_system(folder), H, inputs=signals(folder, "time,e.whole_in\n0,red\n0.1,blue\n0.2,1\n")) as master:
        master.initialise()
        master.run(3 * H, [collect])
        place = [column.name for column in master.columns].index("e.whole_in")
    assert collect.values[:, place].tolist() == [1, 3, 1, 1]
    with pytest.raises(SystemFileError, match=r"line 2: input 'e\.whole_in': expected .* Enumeration, got 'x'"):
        Master(read_system(folder), H, inputs=signals(folder, "time,e.whole_in\n0,x\n"))


def test_a_value_that_no_input_can_have_is_named(folder):
    inputs = signals(folder, "time,u\n0,1e307\n")  # m, and mm in one of the two
    with (
        Master(read_system(folder), H, inputs=inputs) as master,
        pytest.raises(UsageError, match=r"^m\.real_in at t = 0 s: expected a finite number, got inf"),
    ):
        master.initialise()


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("w", "there is no such input in the system"),
        ("a.level_inn", "no such input in the system; did you mean a.level_in"),
        ("a.real_in", "the variable is connected"),
        ("a.gain", "the variable is not an input, its causality is parameter"),
        ("t", "Strings cannot be read"),
    ],
)
def test_names_that_are_refused(folder, name, reason):
    if name == "a.real_in":  # fed by another component
        text = (folder / "SystemStructure.ssd").read_text()
        text = text.replace(wire("u", "a/real_in"), wire("m/real_out", "a/real_in"))
        (folder / "SystemStructure.ssd").write_text(text)
    with pytest.raises(UsageError, match=re.escape(reason)) as caught:
        Master(read_system(folder), H, inputs=signals(folder, f"time,{name}\n0,1\n"))
    assert str(caught.value).startswith(f"{folder / 'in.csv'}, line 1: input {name!r}: ")
