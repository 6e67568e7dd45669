"""ManipulatorPlant: payload, six legs and flexible bus, linearised about the pose of the coarse legs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_output_ports, make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.centre import N_CENTRE, STILL, Centre
from ps_fmu.mechanism.curvature import N_PATH, Curve, count_curve, find_curve, find_ends, places_on_path, stay
from ps_fmu.mechanism.linear_model import Place, Plant, PlantModel
from ps_fmu.mechanism.momentum import Balance, count_balance, find_displacements
from ps_fmu.mechanism.mounted import (
    LOCKED,
    N_MOTION,
    REACTION,
    HostedModel,
    promised_impulse,
    relative_momentum_taken,
    stand_in_bus,
)
from ps_fmu.mechanism.parameters import Bus, load
from ps_fmu.mechanism.quantities import ParameterError, take_values
from ps_fmu.mechanism.signals import N_EXTERNAL, N_INPUTS, OUTPUTS, RATE, TIME, count_states, servo_slices
from ps_fmu.mechanism.slews import (
    AT_REST,
    RENEWAL,
    Distances,
    Way,
    find_distances,
    find_growth,
    find_next_centre,
    is_at_rest,
    is_used_up,
    look_ahead,
    rest_at,
)
from ps_fmu.slavekit.author.elements import Clip, Element, Excess, Linear, Product, Ramp, Watch
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Plant.from_parameters(load())
MOST = DEFAULT.most_coordinates  # those of modes in unused places have zeros in the state, and cost nothing
INPUT: dict[str, Any] = {"causality": "input"}
MOTION: dict[str, Any] = {"causality": "input", "nominal": 1e-3}
MEMORY = {
    "centre": N_CENTRE,
    "curve": count_curve(MOST),
    "expected": N_PATH,  # what is on the path now
    "since": 2,  # time from the centre, s, and its square
    "begun": 7,  # when the linear model began: time, s, references of the coarse legs, m, and their rates, m/s
    **dict.fromkeys(("left", "over", "zero"), 1),  # of the way, s: time to its end, and how far that is too little
    "terms": 3 * N_PATH,
    **dict.fromkeys(("within", "excess", "warned", "last"), 3),  # of the coarse legs
    "balance": count_balance(MOST),
}
COARSE = slice(6, 9)  # on the path
PATH = slice(1, 1 + 3 * N_PATH)  # in the numbers of a Curve, after its half
LONG = 1e9  # s, longer than any way
SINCE = slice(TIME.start - N_EXTERNAL, TIME.stop - N_EXTERNAL)  # of the auxiliary inputs
MOTION_NAMES = ("prescribed_acceleration", "prescribed_angular_acceleration", "prescribed_angular_velocity")


class ManipulatorPlant(Slave):
    """Six-leg dynamics with payload truss modes, coarse-rod flexibility and bus modes."""

    model_description = "Pointing and stabilising manipulator with payload on a free flexible bus: linearised dynamics"
    physics: ClassVar[type] = Plant
    n_states: ClassVar[int] = count_states(MOST)
    n_auxiliary: ClassVar[int] = N_INPUTS - N_EXTERNAL  # inputs of the model that a slew makes, and its constant 1
    n_memory: ClassVar[int] = sum(MEMORY.values())

    ports: ClassVar[tuple[Port, ...]] = (
        # Nominal values: magnitudes under the default disturbance, and in a slew.
        *numbered("fine_force", 3, "N", "Force of a fine actuator, positive extends the leg", nominal=0.1, **INPUT),
        *vector(
            "base_force", "xyz", "N", "Disturbance force on the bus at the origin of B, in B", nominal=10.0, **INPUT
        ),
        *vector(
            "base_torque", "xyz", "N.m", "Disturbance torque on the bus about the origin of B, in B",
            nominal=10.0, **INPUT,
        ),
        *numbered(
            "added_fine_force", 3, "N", "Further force of a fine actuator, added to fine_force", nominal=0.1, **INPUT
        ),
        *vector(
            "payload_force", "xyz", "N", "Force on the payload at the origin of P, in P", nominal=0.1, **INPUT
        ),
        *vector(
            "payload_torque", "xyz", "N.m", "Torque on the payload about the origin of P, in P", nominal=0.1, **INPUT
        ),
        *vector(
            "prescribed_acceleration", "xyz", "m/s2",
            "With base = prescribed: acceleration of the origin of B, mean over the step, in B", **MOTION,
        ),
        *vector(
            "prescribed_angular_acceleration", "xyz", "rad/s2",
            "With base = prescribed: angular acceleration of B, mean over the step, in B", **MOTION,
        ),
        *vector(
            "prescribed_angular_velocity", "xyz", "rad/s",
            "With base = prescribed: angular velocity of B, mean over the step, in B", **MOTION,
        ),
        *numbered(
            "coarse_command", 3, "m", "Commanded displacement of a coarse actuator from its nominal length",
            display_unit="mm", nominal=0.01, **INPUT,
        ),
        *make_output_ports(OUTPUTS + REACTION),
        Port(
            "locked_mass", "output", "kg", "Mass of legs and payload, which a host adds to its hub", nominal=10.0,
        ),
        *make_output_ports(LOCKED),
        *make_parameter_ports(DEFAULT),
        *make_parameter_ports(STILL),
        Port(
            "base", "parameter", type="String", start="own",
            description="own: the FMU contains the bus; prescribed: inputs prescribed_... give the motion of the base",
        ),
        *make_parameter_ports(RENEWAL),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("fine_actuators", ("fine_force",), "Forces of the fine actuators"),
        Terminal("coarse_actuators", ("coarse_command",), "Commands of the coarse actuators"),
        Terminal("base_disturbance", ("base_force", "base_torque"), "Wrench that shakes the bus, at the origin of B"),
        Terminal(
            "measurements",
            ("base_acceleration", "base_angular_acceleration", "orientation"),
            "Accelerometers at the origin of B, and the nominal orientation of P",
        ),
        Terminal(
            "attitude",
            ("payload_attitude", "line_of_sight", "payload_rotation.x", "payload_rotation.y"),
            "Where the payload looks",
        ),
    )

    plant: Plant
    state: NDArray[np.float64]  # of the model: the first numbers of x
    model: PlantModel
    maps: HostedModel
    own_bus: Bus
    prescribed: bool
    before: list[Element]
    after: tuple[tuple[Distances, int] | None, list[Element]]  # and what the elements depend on
    warned_unused: tuple[str, ...] = ()  # what the last warning was about that something has no effect

    @refuse_parameters
    def configure(self) -> None:
        """Build the system from the parameters and put it at the commanded pose, undeformed."""
        self._build()
        command = self.plant.within_stroke(self.command)
        at_rest = Centre.at_rest(command, self.initial.unit_attitude)
        model = self.plant.linearise_about(at_rest)
        own_B = self.initial.initial_angular_velocity_B
        turn_B = self.view("prescribed_angular_velocity") if self.prescribed else own_B
        self.x[:] = 0.0
        self.state[:] = self.plant.initial_state(model, turn_B)
        if self.prescribed:
            self.state[promised_impulse(model.dynamics)] = 0.0
        self.memory[:] = 0.0
        if turn_B.any():
            model = self.plant.linearise_about(self.plant.turning_centre(model, self.state))
        self._take(model, stay(model))
        self.balance.begin(model, self.state, self.start_time)
        self.a[:-1], self.a[-1] = 0.0, 1.0
        self._warn_of_unused()
        self.request_event()

    def output_map(self) -> NDArray[np.float64]:
        """Outputs from [x; u; a] at the same instant."""
        return self._widen(self.maps.output_map())

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        return self._widen(self.maps.step_map(h), self.n_states - len(self.state))

    def split_map(self, h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """x at the end of a step, then y from it."""
        found = self.maps.split_map(h)
        return found and (self._widen(found[0], self.n_states - len(self.state)), self._widen(found[1]))

    def before_map(self, h: float) -> Sequence[Element]:
        """The reference of the coarse servos goes to the command, within the stroke and limited in rate."""
        return self._keep("before", (h, self.half > 0.0), self._list_before)

    def after_map(self, h: float) -> Sequence[Element]:
        """An event is due when the motion leaves the centre of the linear model, or comes to rest away from it."""
        distances = find_distances(self.model.centre, self.renewal)
        return self._keep("after", (h, self.half > 0.0, distances), self._list_after)

    def _keep(self, when: str, key: tuple[Any, ...], make: Callable[..., list[Element]]) -> list[Element]:
        """The same list as long as the key is: it is compiled once a slew, not at each centre, which saves 0.3 ms."""
        if when not in self.lists or self.lists[when][0] != key:
            self.lists[when] = (key, make(*key))
        return self.lists[when][1]

    def _list_before(self, h: float, moving: bool) -> list[Element]:
        low, high = self.plant.manipulator.coarse_stroke
        elements: list[Element] = [
            Linear(self.command, np.eye(3), self.within),
            Clip(self.within, low, high),
            Ramp(self.within, self.reference, self.a[:3], self.plant.servo.rate_limit),
            Excess(self.command, low, high, self.excess),
            Watch(self.excess, self.warned, 0.0),
        ]
        if moving:  # means over the step of the time from the centre and of its square
            start = np.append(self.places(self.since), self.places(self.a[-1:]))
            elements.append(Linear(start, [[1.0, 0.0, h / 2.0], [h, 1.0, h**2 / 3.0]], self.a[SINCE]))
        return elements

    def _list_after(self, h: float, moving: bool, distances: Distances) -> list[Element]:
        others = np.delete(np.arange(N_PATH), COARSE)
        allowed = np.repeat([distances.fine, distances.rotation, distances.coarse_speed], 3)
        now, expected = self.places(self.state)[places_on_path(self.model)], self.places(self.expected)
        return [
            *(self._list_time(h) if moving else ()),
            Watch(now[COARSE], expected[COARSE], distances.coarse, last=self.last, least=AT_REST),
            Watch(now[others], expected[others], allowed),
        ]

    def _list_time(self, h: float) -> list[Element]:
        """Time from the centre and its square after the step, and what is expected then; the way has an end."""
        one, since, half = (self.places(numbers) for numbers in (self.a[-1:], self.since, self.curve[:1]))
        means, powers = self.places(self.a[SINCE]), np.append(one, since)
        return [
            Linear(np.append(means, one), [[1.0, 0.0, h / 2.0], [h, 1.0, h**2 / 6.0]], since),
            Product(self.curve[PATH], np.tile(powers, N_PATH), self.terms),
            Linear(self.terms, np.kron(np.eye(N_PATH), np.ones(3)), self.expected),
            Linear(np.append(half, since[:1]), [[1.0, -1.0]], self.left),
            Excess(self.left, 0.5 * h, LONG, self.over),
            Watch(self.over, self.zero, 0.0),
        ]

    @refuse_parameters
    def event(self, t: float, h: float) -> bool:
        """The motion has left the centre of the linear model: make one about the next centre."""
        self._warn_of_unused()
        command = self.plant.within_stroke(self.command)
        self._warn_of_stroke(self.command - command)
        if self.prescribed:
            self.state[self.maps.rate_places] = self.view("prescribed_angular_velocity")
        if is_at_rest(self.model, self.state, command):
            self.state[:] = rest_at(self.model, self.state, command)
        u = np.concatenate([self.u[:N_EXTERNAL], self.a])
        u[TIME] = self.since
        growth = find_growth(t - self.begun[0], self.reference - self.begun[1:4], self.begun[4:], u[RATE], self.renewal)
        way = look_ahead(self.model, self.state, u, growth, self.renewal, h, self.prescribed)
        centre = find_next_centre(self.model, self.state, self.since[0], way, command, self.renewal, self.prescribed)
        if is_used_up(self.model, self.state, self.renewal, centre):
            self._replace_model(centre, way, u, t)
        return False

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild the model that the restored memory stands for."""
        self._build()
        curve = Curve.read(self.curve, self.plant.n_coordinates)
        self._take(self.plant.linearise_about(Centre.read(self.centre)), curve)
        self.remap()

    def _replace_model(self, centre: Centre, way: Way, u: NDArray[np.float64], t: float) -> None:
        moving = bool(centre.speeds.any())
        others = find_ends(self.model, centre, way) if moving and not self.prescribed else ()
        now = find_displacements(self.model, self.state)[None, :]
        model, ends, place = self.plant.linearise_on_way(centre, others, now)
        if self.prescribed:
            impulse = promised_impulse(self.model.dynamics)
            self.state[impulse] += relative_momentum_taken(self.model, model, self.state)
            curve = stay(model, way.half if moving else 0.0)
        else:
            self.state[:] = self.balance.settle(self.model, self.state, t, Place(place.pose[0], place.jacobians[0]))
            curve = find_curve(model, ends, way, u) if moving else stay(model)
            self.balance.go_on(self.state, t, -float(curve.half[0]))
        self.since[:] = -curve.half[0], curve.half[0] ** 2
        self.begun[:] = np.concatenate([[t], self.reference, u[RATE]])
        self._take(model, curve)
        self.remap()

    def _build(self) -> None:
        values = self.parameters()
        self.plant = take_values(DEFAULT, values)
        self.prescribed = self._read_base(str(values["base"]))
        self.own_bus = self.plant.bus
        if self.prescribed:
            self.plant = replace(self.plant, bus=stand_in_bus(self.plant.bus))
        self.initial = take_values(STILL, values)
        self.renewal = take_values(RENEWAL, values)
        self.command, self.motion = self.view("coarse_command"), self.u[N_EXTERNAL : N_EXTERNAL + N_MOTION]
        parts = dict(zip(MEMORY, np.split(self.memory, np.cumsum(list(MEMORY.values()))[:-1]), strict=True))
        self.centre, self.curve, self.expected = (parts[name] for name in ("centre", "curve", "expected"))
        n = self.plant.n_coordinates
        self.curve, balance = self.curve[: count_curve(n)], parts["balance"][: count_balance(n)]
        self.since, self.begun, self.terms = (parts[name] for name in ("since", "begun", "terms"))
        self.left, self.over, self.zero = (parts[name] for name in ("left", "over", "zero"))
        self.within, self.excess, self.warned, self.last = (
            parts[name] for name in ("within", "excess", "warned", "last")
        )
        self.balance = Balance(self.plant.system, balance)
        self.state = self.x[: self.plant.n_states]
        self.reference = self.state[servo_slices(self.plant.n_coordinates)[2]]
        self.lists: dict[str, tuple[tuple[Any, ...], list[Element]]] = {}

    def _take(self, model: PlantModel, curve: Curve) -> None:
        self.half, self.path = float(curve.half[0]), curve.path  # s
        self.model = model.curve(curve.added) if self.half > 0.0 else model
        self.maps = HostedModel(self.model, self.prescribed)
        model.centre.write(self.centre)
        curve.write(self.curve)
        if not self.half > 0.0:
            self.a[SINCE] = 0.0
            self.expected[:] = curve.path[:, 0]

    def _widen(self, matrix: NDArray[np.float64], rows: int = 0) -> NDArray[np.float64]:
        """Columns and ``rows`` of zeros for the states of unused places.

        And columns for the coarse command, which acts through the servos' reference.
        """
        n, n_command = len(self.state), len(self.command)
        at = n + N_EXTERNAL + N_MOTION
        behind, last = self.n_states + N_EXTERNAL + N_MOTION, matrix.shape[1] - at
        wide = np.zeros((len(matrix) + rows, behind + n_command + last))
        known = wide[: len(matrix)]
        known[:, :n], known[:, self.n_states : behind] = matrix[:, :n], matrix[:, n:at]
        known[:, behind + n_command :] = matrix[:, at:]
        return wide

    def _read_base(self, base: str) -> bool:
        if base not in ("own", "prescribed"):
            raise ParameterError("base", f"expected own or prescribed, got {base!r}")
        return base == "prescribed"

    def _warn_of_unused(self) -> None:
        """Name what is set and has no effect, each time that it is something else."""
        unused = self._list_unused()
        if unused != self.warned_unused:
            self.warned_unused = unused
            if unused:
                base = "prescribed" if self.prescribed else "own"
                self.warning(f"base = {base}: no effect of {', '.join(unused)}")

    def _list_unused(self) -> tuple[str, ...]:
        if not self.prescribed:
            return tuple(name for name in MOTION_NAMES if self.view(name).any()) if self.motion.any() else ()
        modes = [f"bus.mode_{i}.frequency" for i, mode in enumerate(self.own_bus.modes, 1) if mode.active]
        return (*(name for name in ("base_force", "base_torque") if self.view(name).any()), *modes)

    def _warn_of_stroke(self, excess: NDArray[np.float64]) -> None:
        """A command beyond the stroke, by ``excess`` (3,), m, is warned of once."""
        if excess.any() and not self.warned.any():
            worst = int(np.argmax(np.abs(excess)))
            self.warning(
                f"coarse_command_{worst + 1}: {self.command[worst]:.6g} m is outside the stroke "
                f"{self.plant.manipulator.coarse_stroke.tolist()} m; held at its end"
            )
        self.warned[:] = excess
