"""Wiring checks against the FMUs, and the orders that follow from the connections."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.cosim import Master, WiringError, read_system
from ps_fmu.cosim.graph import find_strong_groups

H = 0.01


def problems(system, **options):
    with pytest.raises(WiringError) as caught:
        Master(system, H, **options)
    return caught.value.problems


def test_a_connection_may_be_written_backwards(make_system):
    """The kinds of the connectors say which way a value goes (SSP 1.0, section 5.3.2)."""
    system = make_system({"mass": "ToyMass", "spring": "ToySpring"}, ["spring.position -> mass.position"])
    (connection,) = Master(system, H).wiring.connections
    assert (str(connection.source), str(connection.target)) == ("mass.position", "spring.position")


def test_a_connection_whose_kinds_are_exchanged(make_system):
    system = make_system({"mass": "ToyMass", "spring": "ToySpring"}, ["spring.position -> mass.position"])
    text = system.path.read_text().replace('"position" kind="output"', '"position" kind="KIND"')
    text = text.replace('"position" kind="input"', '"position" kind="output"').replace("KIND", "input")
    system.path.write_text(text)
    found = problems(read_system(system.path, system.components[0].source.parent))
    assert "connection spring.position -> mass.position: is written backwards: swap start and end" in found[-1]
    assert found[-1].startswith("line 24:")


def test_two_sources_for_one_input(make_system):
    components = {"a": "ToyGain", "b": "ToyGain", "c": "ToyGain"}
    (problem,) = problems(make_system(components, ["a.y -> c.u", "b.y -> c.u"]))
    assert "input c.u already has the source a.y" in problem


def test_ends_of_the_wrong_causality(make_system):
    system = make_system({"a": "ToyGain", "b": "ToyGain"}, ["a.y -> b.y", "a.u -> b.u"])
    first, second = problems(system)
    assert "from output to output" in first
    assert "from input to input" in second


def test_types_must_be_equal(make_system):
    (problem,) = problems(make_system({"a": "ToyCounter", "b": "ToyGain"}, ["a.count -> b.u"]))
    assert "the types differ, Integer and Real" in problem


def test_units_must_be_equal(make_system, rewrite, toys):
    units = '<UnitDefinitions><Unit name="N"/><Unit name="mN"/></UnitDefinitions><LogCategories>'
    name = '<ScalarVariable name="force" valueReference="{}" causality="{}">\n\t\t\t<Real'
    for fmu, place, unit in (("ToyMass", (0, "input"), "N"), ("ToySpring", (4, "output"), "mN")):
        variable = name.format(*place)
        rewrite(toys / f"{fmu}.fmu", {"<LogCategories>": units, variable: f'{variable} unit="{unit}"'})
    folder = rewrite(toys / "ToyGain.fmu", {}).parent
    components = {"mass": "ToyMass", "spring": "ToySpring"}
    (problem,) = problems(make_system(components, ["spring.force -> mass.force"], folder))
    assert "the units differ, 'mN' and 'N'" in problem
    # The description of the system may not contradict the FMU either.
    path = make_system(components, [], folder).path
    path.write_text(path.read_text().replace("<ssc:Real/>", '<ssc:Real unit="kN"/>'))
    first, second = problems(read_system(path, folder))
    assert "connector mass.force: is declared in 'kN', in the FMU its unit is 'N'" in first
    assert "spring.force" in second


def test_connectors_must_agree_with_the_fmu(make_system):
    system = make_system({"mass": "ToyMass"}, [])
    text = system.path.read_text()
    text = text.replace('"force" kind="input"', '"force" kind="output"')
    text = text.replace('"position" kind="output"><ssc:Real/>', '"position" kind="output"><ssc:Boolean/>')
    text = text.replace('"velocity"', '"velocitie"')
    system.path.write_text(text)
    causality, kind, name = problems(read_system(system.path, system.components[0].source.parent))
    assert "connector mass.force: is declared output, in the FMU it is input" in causality
    assert "connector mass.position: is declared Boolean, in the FMU it is Real" in kind
    assert "connector mass.velocitie: there is no such variable in ToyMass.fmu; did you mean velocity?" in name


def test_an_fmu_that_can_be_instantiated_only_once(make_system, rewrite, toys):
    flag = 'canBeInstantiatedOnlyOncePerProcess="'
    fmu = rewrite(toys / "ToyGain.fmu", {f'{flag}false"': f'{flag}true"'})
    (problem,) = problems(make_system({"a": "ToyGain", "b": "ToyGain"}, [], fmu.parent))
    assert "components 'a' and 'b' both need ToyGain.fmu" in problem


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("a.gian", 1.0, "there is no such variable in ToyGain.fmu; did you mean gain?"),
        ("a.y", 1.0, "causality is output"),
        ("a.gain", "2", "a.gain (given by the caller): expected a value of type Real, got '2' (str)"),
        ("a.gain", True, "got True (bool)"),
        ("a.gain", float("inf"), "finite"),
    ],
)
def test_parameters_are_checked_before_anything_is_loaded(make_system, name, value, reason):
    (problem,) = problems(make_system({"a": "ToyGain"}, []).with_parameters({name: value}))
    assert reason in problem


def test_all_problems_are_listed_at_once(make_system):
    system = make_system({"a": "ToyGain", "ab": "ToyGain"}, ["a.u -> ab.u", "a.y -> ab.u", "a.y -> ab.y"])
    assert len(problems(system.with_parameters({"a.gain": "x"}))) == 4


def test_unconnected_inputs_are_reported_with_their_start_values(make_system):
    system = make_system({"counter": "ToyCounter", "a": "ToyGain"}, ["counter.half -> a.u"])
    open_inputs = Master(system.with_parameters({"counter.increment": 7}), H).open_inputs
    assert [(str(i.port), i.type, i.start) for i in open_inputs] == [
        ("counter.enabled", "Boolean", "true"),
        ("counter.increment", "Integer", "7"),
    ]


def test_gauss_seidel_order_follows_the_signals(make_system):
    chain = make_system(
        {"last": "ToyGain", "loop": "ToyGain", "back": "ToyGain", "first": "ToyGain"},
        ["first.y -> loop.u", "loop.y -> back.u", "loop.y -> last.u"],
    )
    assert Master(chain, H, "gauss-seidel").wiring.stepping == ("first", "loop", "last", "back")


@given(st.integers(1, 7).flatmap(lambda n: st.tuples(st.just(n), st.sets(st.tuples(*[st.integers(0, n - 1)] * 2)))))
def test_strong_groups_are_ordered_and_complete(case):
    """Against the definition: in a group everything reaches everything, and no later group leads back."""
    n, edges = case
    reach = {(i, i) for i in range(n)} | edges
    while new := {(a, d) for (a, b), (c, d) in itertools.product(reach, reach) if b == c} - reach:
        reach |= new
    groups = find_strong_groups(range(n), sorted(edges))
    assert sorted(itertools.chain.from_iterable(groups)) == list(range(n))
    place = {node: number for number, group in enumerate(groups) for node in group}
    for a, b in itertools.product(range(n), repeat=2):
        assert (place[a] == place[b]) == ((a, b) in reach and (b, a) in reach)
        if (a, b) in reach:
            assert place[a] <= place[b]


def test_a_system_without_connections_has_no_order(make_system):
    wiring = Master(make_system({"a": "ToyGain"}, []), H).wiring
    assert (wiring.order, wiring.loops, wiring.stepping) == ((), (), ("a",))
