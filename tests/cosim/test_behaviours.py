"""FMUs of others as in FMPy: events in steps, an early end, resources, all types, states with start values."""

import os
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from support import against_fmpy, archives, behaviours
from support.claims import verify_claim
from support.cosim import HEAD, Collect

from ps_fmu.cli import main
from ps_fmu.cosim import Master, SlaveError, read_system
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import Rate, Scheme

REFERENCE = "PS_FMU_REFERENCE_FMUS"
"""Names a folder with a build of the Reference FMUs (FMI 2.0, linux64)."""
PORTS = {
    "stair": '<ssd:Connector name="counter" kind="output"><ssc:Integer/></ssd:Connector>',
    "through": '<ssd:Connector name="whole_in" kind="input"><ssc:Integer/></ssd:Connector>',
}
STAIRS = [
    '<ssd:Connection startElement="stair" startConnector="counter" endElement="through" endConnector="whole_in"/>'
]


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return behaviours.build(tmp_path_factory.mktemp("behaviours"))


ENDS = {"decay": 10.0, "drop": 3.0, "oscillator": 20.0, "resource": 1.0, "stair": 9.0, "through": 2.0}


@pytest.mark.parametrize("isolate", [False, True])
def test_all_rows_equal_those_of_fmpy(fmus, isolate):
    found = list(against_fmpy.compare_all(sorted(fmus.glob("*.fmu")), isolate))
    assert {one.name: one.end for one in found if "->" not in one.name} == ENDS
    wired = {f"{name} -> through": end for name, end in ENDS.items() if name != "through"}
    assert {one.name: one.end for one in found if "->" in one.name} == wired
    verify_claim(
        "master.rows_of_fmpy",
        claim="Rows of any FMU, alone or behind another one, up to the step in which one ends the simulation",
        where="`ps-fmu run SYSTEM` or `FMU`, with and without `--isolate`: results.nc",
        reference="FMPy's simulate_fmu, six FMUs in C and all pairs of them, to the last bit",
        error=len([one for one in found if one.where]),
        bound=0,
        unit="systems that differ",
    )


@pytest.mark.skipif(REFERENCE not in os.environ, reason=f"{REFERENCE} names no folder with the Reference FMUs")
@pytest.mark.parametrize("isolate", [False, True])
def test_the_reference_fmus(isolate):
    found = list(against_fmpy.compare_all(sorted(Path(os.environ[REFERENCE]).glob("*.fmu")), isolate))
    assert [one.name for one in found][:6] == [
        "BouncingBall", "Dahlquist", "Feedthrough", "Resource", "Stair", "VanDerPol",
    ]  # fmt: skip
    assert [one for one in found if one.where] == []
    assert {one.end for one in found if "Stair" in one.name} == {9.0}


def test_a_difference_is_seen(fmus, tmp_path, monkeypatch):
    shutil.copy(fmus / "decay.fmu", tmp_path)
    really = against_fmpy.simulate_by_fmpy
    monkeypatch.setattr(against_fmpy, "simulate_by_fmpy", lambda *given: spoil(really(*given)))
    (found,) = against_fmpy.compare_all([tmp_path / "decay.fmu"])
    assert (found.difference, found.where) == (pytest.approx(1e-9), "decay.x")


def spoil(rows):
    rows["x"][7] += 1e-9
    return rows


def write(folder, names, wires=()):
    """A system of these models."""
    components = "".join(
        f'<ssd:Component name="{name}" source="{name}.fmu"><ssd:Connectors>{PORTS.get(name, "")}</ssd:Connectors>'
        "</ssd:Component>\n"
        for name in names
    )
    path = folder / "test.ssd"
    path.write_text(
        f"{HEAD}<ssd:Elements>{components}</ssd:Elements><ssd:Connections>{''.join(wires)}</ssd:Connections>"
        "</ssd:System></ssd:SystemStructureDescription>"
    )
    return path


def run(path, fmus, step, duration, isolation, scheme="jacobi"):
    collect = Collect()
    with Master(read_system(path, fmus), step, scheme, isolation=isolation) as master:
        master.initialise()
        master.run(duration, [collect])
        names = [column.name for column in master.columns]
        return collect.time, dict(zip(names, collect.values.T, strict=True)), master.ended


ENDED = [
    *(Scheme(order) for order in ("jacobi", "gauss-seidel", "iterated")),
    *(Scheme(order, error_estimate=True) for order in ("jacobi", "gauss-seidel", "iterated")),
    *(
        Scheme(order, rates={"stair": rate})
        for order in ("jacobi", "gauss-seidel", "iterated")
        for rate in (Rate(3), Rate(parts=4))
    ),
]


@pytest.mark.parametrize("isolation", [None, Isolation(), Isolation(frozenset({"stair"}))])
@pytest.mark.parametrize("names", [("decay", "stair", "through"), ("through", "stair", "decay")])
@pytest.mark.parametrize("scheme", ENDED, ids=str)
def test_the_step_that_ends_a_simulation_is_stored(fmus, tmp_path, isolation, scheme, names):
    """The stair says that it has reached the end of the step, 9 s: all others make that step, too."""
    time, rows, ended = run(write(tmp_path, names, STAIRS), fmus, 0.2, 12.0, isolation, scheme)
    assert (ended.component, ended.time, len(time)) == ("stair", pytest.approx(9.0), 46)
    assert rows["stair.counter"][-1] == 10
    assert rows["through.whole_out"][-1] == (rows["stair.counter"][-2] if scheme.order == "jacobi" else 10)
    np.testing.assert_allclose(rows["decay.x"], 0.9 ** np.round(time / 0.1), rtol=1e-12)
    if scheme.error_estimate:  # Euler's step of 0.1 s is in both
        assert rows["error_estimate.decay"][1:].tolist() == pytest.approx([0.0] * 45, abs=1e-12)


def test_two_that_end_in_one_step(fmus, tmp_path):
    shutil.copytree(fmus, tmp_path / "fmus")
    shutil.copy(fmus / "stair.fmu", tmp_path / "fmus" / "again.fmu")
    time, rows, ended = run(write(tmp_path, ("again", "stair", "decay")), tmp_path / "fmus", 0.2, 12.0, None)
    assert (ended.component, len(time)) == ("again", 46)
    assert rows["again.counter"][-1] == rows["stair.counter"][-1] == 10


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel", "iterated"])
@pytest.mark.parametrize(
    ("rates", "step", "last"),
    [
        ({"through": Rate(7)}, 0.2, 9.0), ({"stair": Rate(parts=4)}, 0.7, 8.4), ({"stair": Rate(4)}, 0.2, 9.4),
    ],
    ids=str,
)  # fmt: skip
def test_an_end_with_rates(fmus, tmp_path, order, rates, step, last):
    """The last row is that of a base step which all have made."""
    path = write(tmp_path, ("decay", "stair", "through"), STAIRS)
    time, rows, ended = run(path, fmus, step, 20 * step if step > 0.5 else 12.0, None, Scheme(order, rates=rates))
    assert time[-1] == ended.time == pytest.approx(last)
    np.testing.assert_allclose(rows["decay.x"], 0.9 ** np.round(time / 0.1), rtol=1e-12)


@pytest.mark.parametrize("isolation", [None, Isolation()])
@pytest.mark.parametrize(
    "scheme",
    [Scheme(), Scheme(error_estimate=True), Scheme("iterated"), Scheme(rates={"stair": Rate(parts=4)})],
    ids=str,
)
def test_an_end_inside_of_a_step_has_no_row(fmus, tmp_path, isolation, scheme):
    time, rows, ended = run(write(tmp_path, ("stair", "decay")), fmus, 0.7, 14.0, isolation, scheme)
    assert time[-1] == ended.time == pytest.approx(8.4)
    assert rows["stair.counter"][-1] == 9
    assert "last successful time 9 s" in str(ended)


def test_a_resource_that_is_not_there(fmus, tmp_path):
    archives.rewrite(fmus / "resource.fmu", tmp_path, archives.drop("resources/"))
    with pytest.raises(SlaveError, match=r"resource: fmi2EnterInitializationMode(?s:.*)cannot open .*/y\.txt"):
        run(write(tmp_path, ["resource"]), tmp_path, 0.1, 1.0, None)


def test_a_state_with_a_start_value(fmus, tmp_path, capsys):
    (tmp_path / "start.ssv").write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        'name="s"><ssv:Parameters><ssv:Parameter name="x"><ssv:Real value="0.5"/></ssv:Parameter>'
        '<ssv:Parameter name="k"><ssv:Real value="2"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    out = tmp_path / "out"
    arguments = ["run", fmus / "decay.fmu", "--parameters", tmp_path / "start.ssv", "--output", out, "--no-figures"]
    assert main(list(map(str, arguments))) == 0
    with netCDF4.Dataset(out / "results.nc") as file:
        found = np.array(file["run"]["decay.x"][:])
    np.testing.assert_allclose(found, 0.5 * 0.8 ** np.arange(101), rtol=1e-12)


@pytest.mark.parametrize("isolation", [None, Isolation()])
@pytest.mark.parametrize(
    ("stated", "given"), [("1e-07", 1e-7), ("0", -1.0), ("-1", -1.0), ("INF", -1.0), (None, -1.0)]
)
def test_the_tolerance_that_an_fmu_states_is_given_to_it(fmus, tmp_path, rewrite, isolation, stated, given):
    old = f' tolerance="{behaviours.TOLERANCE}"'
    fmu = rewrite(fmus / "decay.fmu", {old: "" if stated is None else f' tolerance="{stated}"'})
    system = read_system(write(tmp_path, ["decay"]), fmu.parent)
    with Master(system, 0.1, isolation=isolation) as master:
        master.initialise()
        assert master.get("decay.tolerance") == given
