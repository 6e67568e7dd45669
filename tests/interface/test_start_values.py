"""Start values from parameter sets and instruments, and back; files of instruments against the FMUs."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.ssp.ssd import validate_tree
from lxml import etree
from support.models import COMPONENTS, FMUS, MODELS

from ps_fmu.analyses.system import load_own_systems
from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.cli import main
from ps_fmu.cosim import Master, System, read_parameters, read_system
from ps_fmu.cosim.description import index_variables, read_descriptions, read_start
from ps_fmu.cosim.ssp.writing import real_values_xml
from ps_fmu.cosim.structure import Component
from ps_fmu.disturbance import default_settings
from ps_fmu.interface.agreement import APART
from ps_fmu.interface.instrument_file import BuildError, find_physics, import_slave
from ps_fmu.interface.picture import VIEWS, make_figure
from ps_fmu.interface.start_values import (
    build_plant_and_isolator,
    differences,
    list_departures,
    make_start_values,
    start_values,
)
from ps_fmu.mechanism.instrument import Instrument, read_instrument
from ps_fmu.mechanism.parameters import PAPER, load
from ps_fmu.mechanism.quantities import ParameterError, list_entries, take_values
from ps_fmu.theory.loop import loop_at, loop_of

SYSTEM = Path(__file__).parents[2] / "system"
EXAMPLE = SYSTEM / "parameters" / "telescope.toml"
WIRED = SYSTEM / "SystemStructure.ssd"


@pytest.fixture(scope="module")
def physics():
    return find_physics(FMUS)


@pytest.fixture(scope="module")
def system(built_fmus):
    wired = read_system(WIRED, built_fmus)
    return wired, read_descriptions(wired)


@pytest.fixture
def write(tmp_path, built_fmus):
    """Runs the command on a text; its exit code, and the path of the file that it writes."""

    def write(text, *options, system=WIRED):
        source, output = tmp_path / "mine.toml", tmp_path / "mine.ssv"
        source.write_text(text, encoding="utf-8")
        arguments = [str(source), "--output", str(output), "--system", str(system), "--fmus", str(built_fmus)]
        return main(["parameters", *arguments, *options]), output

    return write


def test_the_physics_of_the_fmus_is_what_they_start_with(physics, built_fmus):
    """Each slave that states a physics has all its scalars as parameters, with the values of paper.toml."""
    assert set(COMPONENTS.values()) <= set(physics) <= set(MODELS)
    for model, make in physics.items():
        variables = index_variables(read_model_description(built_fmus / f"{model}.fmu"))
        for entry in list_entries(make(load())):
            assert read_start(variables[entry.name]) == entry.value, f"{model} {entry.name}"


def test_what_knows_the_plant_states_its_physics(physics, built_fmus):
    """An FMU with parameters of the plant has them from the mechanism: ps-fmu parameters has to reach them."""

    def list_quantities(model):
        found = read_model_description(built_fmus / f"{model}.fmu").modelVariables
        return {(v.name, v.unit) for v in found if v.causality == "parameter" and v.type == "Real"}

    of_plant = list_quantities("ManipulatorPlant")
    assert {model: list_quantities(model) & of_plant for model in MODELS if model not in physics} == {
        model: set() for model in MODELS if model not in physics
    }


def test_the_paper_itself_changes_nothing(physics, system):
    values = make_start_values(read_instrument(PAPER), *system, physics)
    assert values == {}
    values = make_start_values(read_instrument(PAPER), *system, physics, everything=True)
    assert values["plant.payload.mass"].value == 14.89
    assert {name for name, entry in values.items() if entry.notes} == {f"isolator.payload.com.{axis}" for axis in "xyz"}


def test_one_value_reaches_every_fmu_that_knows_it(write, capsys):
    code, path = write('base = "paper"\n[payload]\nmass = 20.0\n[bus]\nbase = "OSM"\ncom_B = [0.1, 0.0, -2.0]')
    assert code == 0
    found = read_parameters(path)
    wheels = {f"disturbance.wheel_{i}.position.x": 0.1 for i in range(1, 5)}
    expected = {"plant.payload.mass": 20.0, "isolator.payload.mass": 20.0, "plant.bus.com.x": 0.1}
    assert dict(found) == expected | {"disturbance.bus.com.x": 0.1} | wheels
    assert found.entries()["plant.bus.com.x"].unit == "m"
    assert "8 values: 5 of disturbance, 0 of commander, 2 of plant, 1 of isolator" in capsys.readouterr().out


def test_modes_that_nobody_needs_are_zero(write):
    bus = "mass = 300.0\ncom_B = [0, 0, -2.0]\ninertia_B = [[90, 0, 0], [0, 90, 0], [0, 0, 80]]\n"
    code, path = write(f'base = "paper"\n[payload]\ntruss_modes = []\n[bus]\n{bus}')
    assert code == 0
    found = read_parameters(path)
    for i in range(1, 7):
        assert found[f"plant.bus.mode_{i}.frequency"] == 0.0
    assert found["plant.bus.mode_1.participation.tx"] == found["plant.payload.truss_mode_2.mass"] == 0.0
    assert not [name for name in found if "bus.mode_7" in name or "payload.mode_1" in name]  # unused as they start


def test_more_modes_than_the_fmu_holds_are_refused(write, capsys):
    one = "frequency = 1.0\ndamping_ratio = 0.0\nparticipation_B = [1, 0, 0, 0, 0, 0]\n"
    code, path = write('base = "paper"\n[bus]\nbase = "OSM"\n' + f"[[bus.modes]]\n{one}" * 17)
    assert (code, path.exists()) == (1, False)
    assert "mine.toml: bus.modes: 17 modes, but the FMU of the plant holds 16: leave out" in capsys.readouterr().err
    p = load()
    many = replace(p, payload=replace(p.payload, truss_modes=p.payload.truss_modes + p.payload.truss_modes[:1]))
    with pytest.raises(ParameterError, match=r"payload\.truss_modes: 3 modes, but the FMU of the plant holds 2"):
        many.fill_places()


def test_fewer_modes_are_not_filled_up_with_those_of_the_paper():
    p = load()
    found = differences(replace(p, bus=replace(p.bus, modes=p.bus.modes[:4])))
    assert {name for name in found if name.endswith("frequency")} == {f"plant.bus.mode_{i}.frequency" for i in (5, 6)}
    assert set(found.values()) == {0.0}


def test_values_of_single_fmus(write):
    code, path = write(
        'base = "paper"\n[start.disturbance]\nnoise.enabled = false\nrecording.path = "a.csv"\n'
        "wheel_2 = { enabled = true, spin_axis = [1, 0.5, 0], ramp_start = 3 }\n"
        "[start.commander]\ntarget = [0.1, 0, 0]\n[start.plant]\nfine_force = [1, 2, 3]\n"
    )
    assert code == 0
    expected = {
        "disturbance.noise.enabled": False, "disturbance.recording.path": "a.csv", "disturbance.wheel_2.enabled": True,
        "disturbance.wheel_2.spin_axis.x": 1.0, "disturbance.wheel_2.spin_axis.y": 0.5,
        "disturbance.wheel_2.spin_axis.z": 0.0, "disturbance.wheel_2.ramp_start": 3.0, "commander.target.roll": 0.1,
        "commander.target.pitch": 0.0, "commander.target.yaw": 0.0, "plant.fine_force_1": 1.0,
        "plant.fine_force_2": 2.0, "plant.fine_force_3": 3.0,
    }  # fmt: skip
    assert dict(read_parameters(path)) == expected


def test_what_is_set_apart_is_marked(write):
    text = 'base = "paper"\n[payload]\ncom_P = [0, 0, 0.2]\n[isolator]\nknown_com_P = [0, 0.001, 0.2]\n'
    _, path = write(text + "[start.isolator]\npayload.mass = 14.0\n")
    notes = {name: entry.notes for name, entry in read_parameters(path).entries().items() if entry.notes}
    assert notes == dict.fromkeys(["isolator.payload.mass", "isolator.payload.com.y"], frozenset({APART}))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[start.isolater]\ndelay = 1.0", "start.isolater: no such component; did you mean isolator?"),
        ("[start.isolator]\ndelai = 1.0", ".delai: the FMU has no such parameter or input; did you mean delay"),
        ("[start.isolator]\ndelay = -1.0", "start.isolator.delay: -1.0 is outside [0.0, inf]"),
        ("[start.isolator]\ndelay = '1 mm'", "start.isolator.delay: expected a number in s, or a text with another u"),
        ("[[wheel]]\nstifness = 1", "[[wheel]] 1.wheel_1.stifness: the FMU has no such parameter"),
        ("[[wheel]]\nstatic_imbalance = '0.3 g.cm2'", "[[wheel]] 1.wheel_1.static_imbalance: expected a number in kg."),
        ("[wheel]\nspeed = 1", "wheel: write each as [[wheel]], got {'speed': 1}"),
        ("[[wheel]]\n" * 5 + "scale = -1", "[[wheel]] 5.wheel_1.scale: -1 is outside [0.0, inf]"),
        ("[[tone]]\nfrequency = 0.0\n", "[[tone]] 1.tone_1.frequency: 0.0 is outside [0.0001, inf]"),
        ("[start.isolator]\ndelay = inf", "start.isolator.delay: expected a finite number, got inf"),
        ("[start.isolator]\nsaturated = true", "start.isolator.saturated: the FMU has no such parameter or input"),
        ("[start.isolator]\ndelay = [1.0]", "start.isolator.delay: the FMU has no such parameter or input"),
        ("[start.isolator.payload]\ncom = [1.0]", "payload.com: expected 3 values (payload.com.x, payload.com.y, payl"),
        ("[start.isolator]\nfilters.lowpass_order = 8", "isolator.filters.lowpass_order: expected an odd whole number"),
        ("[start]\nisolator = 3", "start.isolator: expected a table, got 3"),
        (f"[start.isolator]\n{'.'.join('a' * 60)} = 1", "expected a table"),
        ("[start.plant]\nbus.mode_1.participation = [200, 0, 0, 0, 0, 0]", "plant.bus.mode_1.participation: too large"),
    ],
)
def test_start_values_that_cannot_be_used(write, capsys, text, problem):
    code, path = write(f'base = "paper"\n{text}')
    assert (code, path.exists()) == (1, False)
    assert problem in capsys.readouterr().err


def test_any_number_of_wheels_and_sines_in_the_units_of_data_sheets(write, tmp_path):
    """Four and three have parameters; those beyond are as they would be there.  A file lies beside the instrument."""
    (tmp_path / "own.csv").write_text("order [1],force [g.cm]\n2,0.02\n")
    wheel = """[[wheel]]
static_imbalance = "0.3 g.cm"
dynamic_imbalance = "2 g.cm2"
harmonics = "own.csv"
spin_axis = [0, 0, 1]
speed = "3000 rpm"
"""
    tones = "".join(f'[[tone]]\nfrequency = "{k} kHz"\nforce = [0, 0.1, 0]\n' for k in (0.1, 0.2, 0.3, 0.4))
    code, path = write(f'base = "paper"\n{6 * wheel}{tones}[start.isolator]\ndelay = "2 ms"')
    assert code == 0
    given = {name: value for name, value in read_parameters(path).items() if name.startswith("disturbance.")}
    assert read_parameters(path)["isolator.delay"] == 0.002
    settings = take_values(
        default_settings(load()), {name.removeprefix("disturbance."): value for name, value in given.items()}
    )
    found = {name: kind for name, _, kind in settings.list_disturbances()}
    for number in range(1, 7):
        each = found[f"wheel_{number}"]
        assert (each.enabled, each.harmonics) == (True, str(tmp_path / "own.csv"))
        assert each.static_imbalance == pytest.approx(3e-6, rel=1e-12)
        assert each.dynamic_imbalance == pytest.approx(2e-7, rel=1e-12)
        np.testing.assert_array_equal(each.spin_axis_B, [0.0, 0.0, 1.0])
        np.testing.assert_array_equal(each.position_B, load().bus.com_B)
        assert each.initial_speed == each.final_speed == pytest.approx(100.0 * np.pi, rel=1e-12)
    assert [found[f"tone_{k}"].frequency for k in (1, 2, 3, 4)] == pytest.approx([100.0, 200.0, 300.0, 400.0])
    assert found["tone_4"].force_B[1] == 0.1


def test_components_that_are_in_the_system_are_served(write, tmp_path):
    """Another name, a second one of a kind, one that is not there; nothing is listed anywhere else."""
    tree = ET.parse(WIRED)
    root = tree.getroot()
    elements, connections = root.find(".//{*}Elements"), root.find(".//{*}Connections")
    for component in elements:
        if component.get("name") == "isolator":
            component.set("name", "second")
        elif component.get("name") == "commander":
            gone = component
    elements.remove(gone)
    for connection in list(connections):
        connections.remove(connection)
    tree.write(tmp_path / "other.ssd")
    text = 'base = "paper"\n[payload]\nmass = 20.0\n[start.second]\ndelay = 0.1'
    code, path = write(text, system=tmp_path / "other.ssd")
    assert code == 0
    assert dict(read_parameters(path)) == {
        "plant.payload.mass": 20.0, "second.payload.mass": 20.0, "second.delay": 0.1
    }  # fmt: skip


def test_the_example_arrives_in_the_fmus(write, built_fmus):
    code, path = write(EXAMPLE.read_text(encoding="utf-8"))
    assert code == 0
    validate_tree(etree.parse(path).getroot(), "SystemStructureParameterValues.xsd")
    given = read_parameters(path)
    with Master(read_system(WIRED, built_fmus).with_parameters(given)) as master:
        master.initialise()
        assert {name: master.get(name) for name in given} == dict(given)
    p = read_instrument(EXAMPLE).parameters
    assert given["plant.bus.mode_4.participation.ry"] == p.bus.modes[3].participation_B[4]
    assert given["plant.payload.mode_2.line_of_sight_x"] == -4.1
    np.testing.assert_allclose(given["plant.bus.mass"], 85.0)


def test_commands_take_an_instrument_as_they_take_its_start_values(write, tmp_path, built_fmus, capsys):
    _, path = write('base = "paper"\n[payload]\nmass = 20.0\n[start.isolator]\ndelay = 0.002\n')
    source, found = path.with_suffix(".toml"), []
    for option, file in (("--instrument", source), ("--parameters", path)):
        output = tmp_path / f"{file.suffix[1:]}.ssp"
        assert main(["ssp", "--output", str(output), option, str(file), "--fmus", str(built_fmus)]) == 0
        given = {"instrument": file} if file is source else {"parameters": (file,)}
        (system,) = load_own_systems(AnalysisOptions(tmp_path, built_fmus, WIRED, **given))
        values = {c.name: {name: p.value for name, p in c.parameters.items()} for c in system.components}
        found.append((output.read_bytes(), values))
    assert found[0] == found[1]
    assert found[0][1]["isolator"]["payload.mass"] == 20.0
    source.write_text('base = "paper"\n[payload]\nmas = 20.0\n')
    for command in (["ssp", "--output", "x.ssp"], ["analyse", "stability", "--output", str(tmp_path / "out")]):
        assert main([*command, "--instrument", str(source), "--fmus", str(built_fmus)]) == 2
        assert "--instrument: " in (said := capsys.readouterr().err) and "payload.mas: unknown" in said


def test_the_picture_has_each_leg_where_its_joints_are(write, tmp_path, capsys):
    picture = tmp_path / "mine.svg"
    code, _ = write('base = "paper"\n', "--picture", str(picture))
    assert code == 0
    assert str(picture) in capsys.readouterr().out
    figure = make_figure(load())
    for axes, (_, right, up) in zip(figure.axes, VIEWS, strict=True):
        drawn = [1e-3 * np.column_stack(line.get_data()) for line in axes.lines if len(line.get_xdata()) == 2]
        legs = load().manipulator.coarse_legs + load().manipulator.fine_legs
        for ends, leg in zip(drawn, legs, strict=True):
            top = load().manipulator.nominal_translation_B + leg.platform_joint_P
            np.testing.assert_allclose(ends, [leg.base_joint_B[[right, up]], top[[right, up]]], atol=1e-12)
    names = {text.get_text() for text in figure.axes[1].texts}
    assert names >= {"c1", "c2", "c3", "f1", "f2", "f3", "B", "P"}
    assert write('base = "paper"\n', "--picture", "mine.doc")[0] == 2


def test_the_lines_of_the_page_run_and_print_what_it_shows(write, tmp_path, capsys):
    page = (SYSTEM.parent / "docs" / "instrument.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w*)\n(.*?)```", page, re.DOTALL)
    ((_, code),) = [block for block in blocks if "mmwrite" in block[1]]
    ((_, text),) = [block for block in blocks if "finite_elements]" in block[1]]
    subprocess.run([sys.executable, "-I", "-c", code], cwd=tmp_path, check=True)
    printed = ""
    for source in (text, EXAMPLE.read_text(encoding="utf-8")):
        assert write(source)[0] == 0
        printed += capsys.readouterr().out
    for first in ("payload.finite_elements:", "legs at the nominal pose"):
        ((_, shown),) = [block for block in blocks if block[1].startswith(first)]
        assert shown in printed


def test_a_slave_that_cannot_be_imported_is_named(tmp_path):
    for name, text in (("broken", "import nothing_of_this_name"), ("hollow", "")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / f"{name}.py").write_text(text)
        with pytest.raises(BuildError, match=rf"{name}\.py: "):
            import_slave(folder)


def test_a_physics_that_the_fmu_does_not_have_yet(system, physics):
    """Sources that are newer than the FMUs."""
    instrument = Instrument(load(), {}, {}, ())
    with pytest.raises(ParameterError, match=r"commander\.coarse_leg_1\.lower\.mass: .* build it again"):
        make_start_values(instrument, *system, {**physics, "PointingCommander": physics["FeedforwardIsolator"]})


def test_start_values_of_the_paper_are_those_of_the_fmus(built_fmus):
    descriptions = {name: read_model_description(built_fmus / f"{fmu}.fmu") for name, fmu in COMPONENTS.items()}
    starts = {
        f"{component}.{variable.name}": variable.start
        for component, description in descriptions.items()
        for variable in description.modelVariables
        if variable.causality == "parameter"
    }
    for name, value in start_values(load()).items():
        assert float(starts[name]) == value if isinstance(value, float) else starts[name] == str(value).lower(), name


def test_the_way_back(tmp_path):
    """Plant and isolator of the start values of another set are those of the set; nothing else is told apart."""
    p = load()
    legs = tuple(replace(leg, stiffness=1.3 * leg.stiffness) for leg in p.manipulator.fine_legs)
    other = replace(
        p,
        manipulator=replace(p.manipulator, fine_legs=legs),
        payload=replace(p.payload, mass=1.1 * p.payload.mass),
        filters=replace(p.filters, lowpass_order=7),
        known_com_P=p.payload.com_P,
    )
    system = System(
        tmp_path, tuple(Component(name, tmp_path, (), {}, 0) for name in COMPONENTS), ()
    ).with_parameters(differences(other))
    found = loop_of(*build_plant_and_isolator(system), (0.1, 0.0, 0.0), 0.02)
    expected = loop_at(other, (0.1, 0.0, 0.0), 0.02)
    s = 2j * np.pi * np.array([1.0, 5.0, 50.0])
    np.testing.assert_array_equal(found.transfer(s), expected.transfer(s))
    assert not np.allclose(found.transfer(s), loop_at(p, (0.1, 0.0, 0.0), 0.02).transfer(s))


def test_what_is_not_of_the_paper():
    given = start_values(load()) | {"commander.target.roll": 0.1, "isolator.enabled": False, "isolator.delay": 0.0}
    assert list_departures(given) == []
    assert list_departures(given | {"isolator.delay": 0.02, "plant.payload.mass": 1.0}) == [
        "plant.payload.mass",
        "isolator.delay",
    ]


def test_only_what_differs_is_said_and_read_back(tmp_path):
    p = load()
    assert differences(p) == {}
    other = replace(p, payload=replace(p.payload, com_P=p.payload.com_P + np.array([0.0, 1e-3, 0.0])))  # m
    assert differences(other) == {"plant.payload.com.y": p.payload.com_P[1] + 1e-3}
    told = replace(p, known_com_P=np.array([0.1, p.known_com_P[1], p.known_com_P[2]]))
    assert differences(told) == {"isolator.payload.com.x": 0.1}
    path = tmp_path / "other.ssv"
    path.write_bytes(real_values_xml(differences(other) | differences(told)))
    assert dict(read_parameters(path)) == differences(other) | differences(told)
