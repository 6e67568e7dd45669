"""The mechanism, written once: what its bodies need in order to move, from which ``make derive`` makes C.

Everything is in axes of B; the platform's pose (t, R) and the inverse Jacobian J_pl at it are data.  Twelve rigid
accelerations are unknown: second derivatives of the six leg lengths (coarse legs: of the stretch of their rods), and
acceleration (inertial, of the origin of B) and angular acceleration of B.  By d'Alembert's principle each body gives
the forces that these need.  A leg is two slender parts on one line, as in :mod:`.dynamics`; its inertia acts at its
two ends.  Bus and payload are rigid bodies with modes.

**Modes.**  With their body held, ``m x'' + c x' + k x = 0``.  Their Lagrangian has what is linear in x: they carry
the momentum ``p x'`` (participation p, linear and angular), they shift the first moment of their body by ``p_t x`` and
its inertia by ``I' x`` (I' of a point mass; else zero).  So with acceleration A of the body's origin, angular velocity
w and angular acceleration w' of the body::

    m x'' = - k x - c x' - p . [A; w'] + w . I' w / 2

Modes are eliminated: what acts on the body is found from ``sum p x`` and such over its modes, which the functions get
as numbers, and from ``less = sum p p'/m`` and ``turning = sum p I'/m``, which are parameters.

The functions contain ``+ - * /`` and square roots only: they give the same bits on all processors.  Derivatives are
of the residual with accelerations held, and of implicit relations (``J_lp twist = rates``), so that nothing that was
solved for is differentiated.

CasADi writes the derivatives; it is needed by ``make derive`` and tests only.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

SX = ca.SX
EYE = SX.eye(3)
cross, dot, skew = ca.cross, ca.dot, ca.skew

#: Parameters of the rigid part: name, numbers, unit, text.  The struct Mechanism begins with them.
PARAMETERS = (
    ("base_joint", (6, 3), "m", "joints on the base, in B; coarse legs first"),
    ("platform_joint", (6, 3), "m", "joints on the platform, in P"),
    ("leg", (6, 5), "kg, kg, kg.m, kg.m, kg.m2", "mass of upper and lower part, their first moments along the leg "
     "from their own joints, second moment of both, radial inertias included"),
    ("payload", (10,), "kg, kg.m, kg.m2", "mass, first moment, inertia xx xy xz yy yz zz about the origin of P, in P"),
    ("payload_less", (6, 6), "kg, kg.m, kg.m2", "sum p p'/m of its modes"),
    ("payload_turning", (6, 6), "kg.m, kg.m2", "sum p I'/m of its modes"),
    ("bus", (10,), "kg, kg.m, kg.m2", "as payload, about the origin of B, in B"),
    ("bus_less", (6, 6), "kg, kg.m, kg.m2", "sum p p'/m of its modes"),
)  # fmt: skip

#: What the rigid part moves by: name, numbers, unit, text.
MOTION = (
    ("translation", (3,), "m", "origin of P, in B"),
    ("rotation", (3, 3), "1", "P to B"),
    ("rate", (6,), "m/s", "of the legs' lengths"),
    ("turn", (3,), "rad/s", "angular velocity of B, in B"),
    ("payload_shift", (3,), "kg.m", "sum p_t x of the payload's modes, in P"),
    ("payload_flow", (6,), "N.s, N.m.s", "sum p x'"),
    ("payload_change", (6,), "kg.m2", "sum I' x, xx xy xz yy yz zz"),
    ("payload_change_rate", (6,), "kg.m2/s", "sum I' x'"),
    ("bus_shift", (3,), "kg.m", "sum p_t x of the bus's modes, in B"),
    ("bus_flow", (6,), "N.s, N.m.s", "sum p x'"),
    ("leg_force", (6,), "N", "what acts along the legs' lengths"),
    ("base_wrench", (6,), "N, N.m", "on B at its origin, modes' springs and dampers included"),
    ("payload_wrench", (6,), "N, N.m", "on P at its origin, in P, modes' springs and dampers included"),
    ("given", (12,), "m/s2, rad/s2", "accelerations that are prescribed: of legs and base"),
)  # fmt: skip


def count(shape: tuple[int, ...]) -> int:
    """Numbers of an array."""
    return shape[0] * (shape[1] if len(shape) > 1 else 1)


def split(vector: SX, layout: Any) -> dict[str, SX]:
    """Parts of a flat vector by name; matrices were written row by row."""
    parts, at = {}, 0
    for name, shape, *_ in layout:
        part = vector[at : at + count(shape)]
        parts[name] = ca.reshape(part, shape[1], shape[0]).T if len(shape) > 1 else part
        at += count(shape)
    return parts


def symmetric(six: SX) -> SX:
    """(3, 3) from xx, xy, xz, yy, yz, zz."""
    return ca.vertcat(
        ca.horzcat(six[0], six[1], six[2]), ca.horzcat(six[1], six[3], six[4]), ca.horzcat(six[2], six[4], six[5])
    )


def half_square(w: SX) -> SX:
    """(6,) with which ``I . half_square(w)`` is ``w . I w / 2`` for I as xx, xy, xz, yy, yz, zz."""
    return ca.vertcat(w[0] * w[0] / 2, w[0] * w[1], w[0] * w[2], w[1] * w[1] / 2, w[1] * w[2], w[2] * w[2] / 2)


class Leg:
    """A leg at a pose."""

    def __init__(self, p: dict[str, SX], z: dict[str, SX], i: int) -> None:
        self.base = p["base_joint"][i, :].T
        self.arm = z["rotation"] @ p["platform_joint"][i, :].T
        vector = z["translation"] + self.arm - self.base
        self.length = ca.sqrt(dot(vector, vector))
        self.inverse = 1 / self.length
        self.n = vector * self.inverse
        self.upper, self.lower, self.first_u, self.first_l, self.second = (p["leg"][i, k] for k in range(5))
        turning = self.second * self.inverse * self.inverse
        # Of accelerations of its ends, what is at right angles to the leg counts more than their masses.
        self.uu = turning - 2 * self.first_u * self.inverse
        self.ul = (self.first_u + self.first_l) * self.inverse - turning
        self.ll = turning - 2 * self.first_l * self.inverse
        self.on_platform = ca.vertcat(self.n, cross(self.arm, self.n))
        self.on_base = ca.vertcat(self.n, cross(self.base, self.n))

    def across(self, x: SX) -> SX:
        """What of x is at right angles to the leg."""
        return x - self.n * dot(self.n, x)

    def find_ends(self, upper: SX, lower: SX) -> tuple[SX, SX]:
        """Forces at the ends by their accelerations; momenta by their velocities."""
        u, v = self.across(upper), self.across(lower)
        return self.upper * upper + self.uu * u + self.ul * v, self.lower * lower + self.ul * u + self.ll * v


class Body:
    """A rigid body with modes, in its own axes about its origin."""

    def __init__(self, ten: SX, less: SX, shift: SX, flow: SX, turning: SX, change: SX, change_rate: SX) -> None:
        self.mass, self.first, self.inertia = ten[0], ten[1:4] + shift, symmetric(ten[4:10] + change)
        self.less, self.flow, self.turning, self.change_rate = less, flow, turning, symmetric(change_rate)

    @property
    def matrix(self) -> SX:
        """(6, 6) mass matrix, modes eliminated."""
        moment = skew(self.first)
        whole = ca.vertcat(ca.horzcat(self.mass * EYE, -moment), ca.horzcat(moment, self.inertia))
        return whole - self.less

    def find_wrench(self, linear: SX, w: SX, angular: SX) -> SX:
        """Force and torque that the body needs for its accelerations while it turns with w."""
        moving, spinning = self.flow[:3], self.flow[3:]
        force = self.mass * linear + cross(angular, self.first) + cross(w, cross(w, self.first) + 2 * moving)
        torque = cross(self.first, linear) + self.inertia @ angular + self.change_rate @ w
        torque += cross(w, self.inertia @ w + spinning)
        by_modes = self.turning @ half_square(w) - self.less @ ca.vertcat(linear, angular)
        return ca.vertcat(force, torque) + by_modes

    def find_momentum(self, linear: SX, w: SX) -> SX:
        """Linear and angular momentum by velocities; modes' own included."""
        return ca.vertcat(
            self.mass * linear + cross(w, self.first), cross(self.first, linear) + self.inertia @ w
        ) + self.flow


def make_bodies(p: dict[str, SX], z: dict[str, SX], *, whole: bool = False) -> tuple[Body, Body]:
    """Payload and bus; ``whole``: modes are not eliminated."""
    none, six = SX.zeros(6, 6), SX.zeros(6)
    of_payload = z["payload_shift"], z["payload_flow"]
    payload = Body(p["payload"], none if whole else p["payload_less"], *of_payload, p["payload_turning"],
                   z["payload_change"], z["payload_change_rate"])  # fmt: skip
    bus = Body(p["bus"], none if whole else p["bus_less"], z["bus_shift"], z["bus_flow"], none, six, six)
    return payload, bus


def transport(wrench: SX, t: SX) -> SX:
    """A wrench at the origin of P as at that of B."""
    return ca.vertcat(wrench[:3], wrench[3:] + cross(t, wrench[:3]))


def rotate(R: SX, six: SX) -> SX:
    """Both vectors of a twist or wrench."""
    return ca.vertcat(R @ six[:3], R @ six[3:])


class Inverse:
    """Inverse dynamics: what accelerations need.

    ``twist`` and ``relative``: velocity and acceleration of the platform relative to B; ``rates_left`` and
    ``relative_left`` are zero where they belong to the rates and accelerations ``legs`` of the legs.
    """

    def __init__(self, p: dict[str, SX], z: dict[str, SX], twist: SX, relative: SX, legs: SX, base: SX) -> None:
        t, R, w = z["translation"], z["rotation"], z["turn"]
        payload, bus = make_bodies(p, z)
        moving, spinning = twist[:3], twist[3:]
        linear, angular = base[:3], base[3:]
        W = w + spinning
        A = linear + cross(angular, t) + cross(w, cross(w, t)) + 2 * cross(w, moving) + relative[:3]
        dW = angular + relative[3:] + cross(w, spinning)
        in_P = R.T @ A, R.T @ W, R.T @ dW
        self.body, self.spin = ca.vertcat(in_P[0], in_P[2]), half_square(in_P[1])
        above = rotate(R, payload.find_wrench(*in_P) - z["payload_wrench"])
        below = bus.find_wrench(linear, w, angular) - z["base_wrench"]
        rates_left, relative_left, J = [], [], []
        for i in range(6):
            leg = Leg(p, z, i)
            velocity, centripetal = moving + cross(spinning, leg.arm), cross(spinning, cross(spinning, leg.arm))
            rate = dot(leg.n, velocity)
            swing = (velocity - leg.n * rate) * leg.inverse
            bend = dot(leg.n, centripetal) + leg.length * dot(swing, swing)
            rates_left.append(z["rate"][i] - rate)
            relative_left.append(legs[i] - bend - dot(leg.on_platform, relative))
            swing += cross(w, leg.n)  # in inertial space
            apart = 2 * z["rate"][i] * leg.inverse * swing
            inward = apart + leg.n * dot(swing, swing)
            pull = leg.second * leg.inverse * apart
            upper = A + cross(dW, leg.arm) + cross(W, cross(W, leg.arm))
            lower = linear + cross(angular, leg.base) + cross(w, cross(w, leg.base))
            force_u, force_l = leg.find_ends(upper, lower)
            force_u += leg.first_u * inward - pull
            force_l += pull - leg.first_l * inward
            above += ca.vertcat(force_u, cross(leg.arm, force_u))
            below += ca.vertcat(force_l, cross(leg.base, force_l))
            J.append(leg.on_platform.T)
        self.rates_left, self.relative_left = ca.vertcat(*rates_left), ca.vertcat(*relative_left)
        self.J_lp = ca.vertcat(*J)
        self.platform, self.base = above, transport(above, t) + below


def find_mass(p: dict[str, SX], z: dict[str, SX], J_pl: SX, payload: Body, bus: Body) -> tuple[SX, SX]:
    """(12, 12) mass of legs' lengths and base; (6, 6) of legs and payload as one body on the base."""
    t, R = z["translation"], z["rotation"]
    legs = [Leg(p, z, i) for i in range(6)]
    turn = ca.diagcat(R, R)
    own = turn @ payload.matrix @ turn.T
    pp, pb, bb = mirror(own), SX.zeros(6, 6), SX.zeros(6, 6)

    def two_points(weight: SX, a: SX, b: SX) -> SX:
        return weight * ca.vertcat(
            ca.horzcat(EYE, -skew(b)), ca.horzcat(skew(a), dot(a, b) * EYE - b @ a.T)
        )

    for leg in legs:
        pp += two_points(leg.upper + leg.uu, leg.arm, leg.arm)
        pb += two_points(leg.ul, leg.arm, leg.base)
        bb += two_points(leg.lower + leg.ll, leg.base, leg.base)
    along = [ca.vertcat(*(getattr(leg, name) for leg in legs)) for name in ("uu", "ul", "ll")]
    J_lb = ca.vertcat(*(leg.on_base.T for leg in legs))
    T = ca.vertcat(ca.horzcat(EYE, -skew(t)), ca.horzcat(SX.zeros(3, 3), EYE))
    # The legs' own directions: J_lp J_pl is the identity, J_lp T is J_lb, and uu + 2 ul + ll is zero.
    of_legs = J_pl.T @ pp @ J_pl - ca.diag(along[0])
    with_base = J_pl.T @ (pp @ T + pb) - ca.diag(along[0] + along[1]) @ J_lb
    locked = T.T @ pp @ T + T.T @ pb + pb.T @ T + bb
    locked = mirror(locked)
    M = ca.vertcat(ca.horzcat(mirror(of_legs), with_base), ca.horzcat(with_base.T, locked + bus.matrix))
    return M, locked


def mirror(matrix: SX) -> SX:
    """A symmetric matrix by what is on and below its diagonal, so that nothing is found twice."""
    lower = ca.tril(ca.densify(matrix))
    return lower + ca.tril(lower, False).T


def eliminate(M: SX, right: SX, mask: SX) -> tuple[SX, SX, SX]:
    """Solve with ``M = L D L'`` written out: the solution, L below the diagonal, 1 / D; zero where the mask is."""
    n = mask.numel()
    L: list[list[Any]] = [[0] * n for _ in range(n)]
    D, inverse = [SX(0)] * n, [SX(0)] * n
    for j in range(n):
        scaled = [L[j][k] * D[k] for k in range(j)]
        D[j] = M[j, j] - sum((L[j][k] * scaled[k] for k in range(j)), SX(0))
        inverse[j] = mask[j] / D[j]
        for i in range(j + 1, n):
            L[i][j] = (M[i, j] - sum((L[i][k] * scaled[k] for k in range(j)), SX(0))) * inverse[j]
    return substitute(L, inverse, right), pack(lambda i, j: L[i][j], n, strict=True), ca.vertcat(*inverse)


def substitute(L: list[list[Any]], inverse: list[SX], right: SX) -> SX:
    """Forward, divide, back."""
    n = len(inverse)
    y: list[SX] = []
    for i in range(n):
        y.append(right[i] - sum((L[i][k] * y[k] for k in range(i)), SX(0)))
    x = [y[i] * inverse[i] for i in range(n)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum((L[k][i] * x[k] for k in range(i + 1, n)), SX(0))
    return ca.vertcat(*x)


def pack(entry: Any, n: int, *, strict: bool = False) -> SX:
    """Rows of a lower triangle one after the other."""
    return ca.vertcat(*(entry(i, j) for i in range(n) for j in range(i if strict else i + 1)))


def find_bend(p: dict[str, SX], z: dict[str, SX], twist: SX) -> SX:
    """(6,) second derivatives of the legs' lengths while the twist of the platform relative to B stays."""
    inverse = Inverse(p, z, twist, SX.zeros(6), SX.zeros(6), SX.zeros(6))
    return -inverse.relative_left


def make_symbols() -> tuple[SX, SX, SX, dict[str, SX], dict[str, SX]]:
    """Parameters, motion and J_pl (row by row) as flat symbols, and the first two by name."""
    p, z = (SX.sym(name, sum(count(each[1]) for each in layout)) for name, layout in (("p", PARAMETERS), ("z", MOTION)))
    return p, z, SX.sym("J_pl", 36), split(p, PARAMETERS), split(z, MOTION)


def square(flat: SX, n: int = 6) -> SX:
    """(n, n) from a matrix that was written row by row."""
    return ca.reshape(flat, n, n).T


def flat(matrix: SX) -> SX:
    """A matrix row by row."""
    return ca.vec(matrix.T)


def derive_accelerations() -> ca.Function:
    """All accelerations, and what their derivatives take."""
    p, z, J, P, Z = make_symbols()
    mask = SX.sym("mask", 12)
    J_pl, given = square(J), Z["given"]
    twist = J_pl @ Z["rate"]
    relative = J_pl @ (given[:6] - find_bend(P, Z, twist))
    inverse = Inverse(P, Z, twist, relative, given[:6], given[6:])
    missing = ca.vertcat(J_pl.T @ inverse.platform - Z["leg_force"], inverse.base)
    M, _ = find_mass(P, Z, J_pl, *make_bodies(P, Z))
    found, L, divisors = eliminate(M, -missing, mask)
    held = [(1 - mask[i]) * dot(M[i, :].T, found) + (1 - mask[i]) * missing[i] for i in range(3)]  # rigid rods
    along = Z["leg_force"] + ca.vertcat(*held, SX.zeros(3))
    more, R = J_pl @ found[:6], Z["rotation"]
    moved = ca.vertcat(found[6:9] + cross(found[9:], Z["translation"]), found[9:]) + more
    outputs = {
        "accelerations": given + found, "body": inverse.body + rotate(R.T, moved),
        "spin": half_square(R.T @ (Z["turn"] + twist[3:])), "reaction": missing[6:] + M[6:, :] @ found,
        "kept": ca.vertcat(twist, relative + more, along), "lower": L, "divisors": divisors,
        "base_rows": flat(M[6:, :]),
    }  # fmt: skip
    return make("accelerations", {"p": p, "z": z, "J_pl": J, "mask": mask}, outputs)


def derive_change() -> ca.Function:
    """Derivative of the residual along a direction dz, accelerations held."""
    p, z, J, P, Z = make_symbols()
    dz, kept, accelerations = SX.sym("dz", z.numel()), SX.sym("kept", 18), SX.sym("accelerations", 12)
    twist, relative, along = kept[:6], kept[6:12], kept[12:]
    d_given, J_pl = split(dz, MOTION)["given"], square(J)
    inverse = Inverse(P, Z, twist, relative, accelerations[:6], accelerations[6:])
    d_twist = J_pl @ ca.jtimes(inverse.rates_left, z, dz)
    at, changes = ca.vertcat(z, kept[:6], accelerations), ca.vertcat(dz, d_twist, d_given)
    d_relative = J_pl @ ca.jtimes(inverse.relative_left, at, changes)
    at, changes = ca.vertcat(z, kept, accelerations), ca.vertcat(dz, d_twist, d_relative, SX.zeros(6), d_given)
    pulled = inverse.platform - inverse.J_lp.T @ along
    every = ca.vertcat(pulled, inverse.base, inverse.body, inverse.spin)
    changed = ca.jtimes(every, at, changes)
    d_legs = J_pl.T @ changed[:6] - split(dz, MOTION)["leg_force"]
    outputs = {"residual": ca.vertcat(d_legs, changed[6:12]), "body": changed[12:18], "spin": changed[18:]}
    inputs = {"p": p, "z": z, "J_pl": J, "kept": kept, "accelerations": accelerations, "dz": dz}
    return make("change", inputs, outputs)


def derive_masses() -> ca.Function:
    """Mass of legs' lengths and base, with all modes held; and of legs and payload as one body on the base."""
    p, z, J, P, Z = make_symbols()
    M, locked = find_mass(P, Z, square(J), *make_bodies(P, Z, whole=True))
    return make("masses", {"p": p, "z": z, "J_pl": J}, {"M": flat(M), "locked": flat(locked)})


def derive_momentum() -> ca.Function:
    """Linear and angular momentum of all bodies about the origin of B, mass and first moment."""
    p, z, J, P, Z = make_symbols()
    velocity = SX.sym("velocity", 3)
    t, R, w, twist = Z["translation"], Z["rotation"], Z["turn"], square(J) @ Z["rate"]
    payload, bus = make_bodies(P, Z, whole=True)
    linear, angular = velocity + cross(w, t) + twist[:3], w + twist[3:]
    above = rotate(R, payload.find_momentum(R.T @ linear, R.T @ angular))
    below = bus.find_momentum(velocity, w)
    mass, first = payload.mass + bus.mass, payload.mass * t + R @ payload.first + bus.first
    for i in range(6):
        leg = Leg(P, Z, i)
        upper, lower = leg.find_ends(linear + cross(angular, leg.arm), velocity + cross(w, leg.base))
        # The legs get longer as their parts move apart along them: that carries no momentum of its own.
        above += ca.vertcat(upper, cross(leg.arm, upper))
        below += ca.vertcat(lower, cross(leg.base, lower))
        mass += leg.upper + leg.lower
        first += leg.upper * (t + leg.arm) + leg.lower * leg.base + (leg.first_l - leg.first_u) * leg.n
    outputs = {"momentum": transport(above, t) + below, "mass": ca.vertcat(mass, first)}
    return make("momentum", {"p": p, "z": z, "J_pl": J, "velocity": velocity}, outputs)


def derive_legs() -> ca.Function:
    """Lengths of the legs, J_lp of eq (6), and its inverse by blocks, which divides by the divisor."""
    p, z, _, P, Z = make_symbols()
    legs = [Leg(P, Z, i) for i in range(6)]
    J_lp = ca.vertcat(*(leg.on_platform.T for leg in legs))
    first, divisor = invert3(J_lp[:3, :3])
    by_first, to_first = J_lp[3:, :3] @ first, first @ J_lp[:3, 3:]
    last, _ = invert3(J_lp[3:, 3:] - by_first @ J_lp[:3, 3:])
    right = -to_first @ last
    left = ca.vertcat(first - right @ by_first, -last @ by_first)
    outputs = {
        "lengths": ca.vertcat(*(leg.length for leg in legs)), "J_lp": flat(J_lp),
        "J_pl": flat(ca.horzcat(left, ca.vertcat(right, last))), "divisor": divisor,
    }  # fmt: skip
    return make("legs", {"p": p, "z": z}, outputs)


def invert3(matrix: SX) -> tuple[SX, SX]:
    """Inverse (3, 3) by cofactors, and the determinant."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    determinant = dot(a, cross(b, c))
    return ca.horzcat(cross(b, c), cross(c, a), cross(a, b)).T * (1 / determinant), determinant


def make(name: str, inputs: dict[str, SX], outputs: dict[str, SX]) -> ca.Function:
    """A function with common expressions once."""
    return ca.Function(name, list(inputs.values()), ca.cse(list(outputs.values())), list(inputs), list(outputs))
