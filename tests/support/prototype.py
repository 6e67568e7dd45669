"""Shared by the tests against the multibody prototype: where they compare, with which parameters, and how."""

from dataclasses import replace

import numpy as np

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.parameters import Parameters
from ps_fmu.theory.transfer_matrices import Nominal, Practical
from support.multibody.linear import LinearModel
from support.multibody.multibody import Prototype

from .mechanics import PAPER, dynamics_at, pose_at, relative_error, rigid

S = 2j * np.pi * np.geomspace(0.05, 300.0, 30)  # rad/s
TABLE_1_DEG = np.array([[-9.0, -10.7, -14.5], [9.6, 9.8, 16.6]])  # roll, pitch, yaw, each alone


def random_orientations(count: int) -> list[tuple[float, float, float]]:
    """Roll, pitch, yaw in deg, from all over the workspace: within the stroke of the coarse legs."""
    drawn_deg = np.random.default_rng(1).uniform(*TABLE_1_DEG, (20 * count, 3))
    geometry = PAPER.manipulator.geometry
    displacement = inverse_kinematics(geometry, np.radians(drawn_deg)).coarse_displacement
    reached = np.all(np.abs(displacement) <= geometry.coarse_stroke[1], axis=1)
    return [tuple(rpy) for rpy in drawn_deg[reached][:count].tolist()]


def other_geometry(seed: int, bare: Parameters | None = None) -> Parameters:
    """The rigid system, or ``bare``, changed at random.

    Joints moved by up to 20 mm, masses, stiffness, damping by up to 30 %, inertias and centres of mass likewise.
    """
    random = np.random.default_rng([seed, 2])

    def scaled(value):
        return value * random.uniform(0.7, 1.3)

    def leg(this):
        parts = {
            name: replace(
                getattr(this, name), **{k: scaled(getattr(part, k)) for k in ("mass", "com_distance", "radial_inertia")}
            )
            for name, part in (("lower", this.lower), ("upper", this.upper))
        }
        joints = {
            name: getattr(this, name) + random.uniform(-0.02, 0.02, 3) for name in ("base_joint_B", "platform_joint_P")
        }
        springs = {k: scaled(getattr(this, k)) for k in ("stiffness", "damping") if hasattr(this, k)}
        return replace(this, **parts, **joints, **springs)

    def body(this, frame):
        com, inertia = f"com_{frame}", f"inertia_{frame}"
        spread = random.normal(size=(3, 3))
        size = 0.05 * np.trace(getattr(this, inertia))
        return replace(
            this,
            mass=scaled(this.mass),
            **{
                com: getattr(this, com) + random.uniform(-0.05, 0.05, 3),
                inertia: getattr(this, inertia) + size * spread @ spread.T / 9.0,
            },
        )

    bare = rigid() if bare is None else bare
    manipulator = bare.manipulator
    return replace(
        bare,
        manipulator=replace(
            manipulator,
            nominal_translation_B=manipulator.nominal_translation_B + random.uniform(-0.02, 0.02, 3),
            coarse_legs=tuple(map(leg, manipulator.coarse_legs)),
            fine_legs=tuple(map(leg, manipulator.fine_legs)),
        ),
        payload=body(bare.payload, "P"),
        bus=body(bare.bus, "B"),
    )


def errors(prototype: LinearModel, model: Nominal | Practical, s=S) -> dict[str, float]:
    """Relative errors of the plant's transfer matrices, the largest over the frequencies ``s``, rad/s."""
    pairs = {
        "G_P": (model.G_P, prototype.base_to_payload),
        "A": (model.A, prototype.force_to_payload),
        "B": (model.B, prototype.wrench_to_payload),
        "C": (model.C, prototype.force_to_base),
        "D": (model.D, prototype.wrench_to_base),
    }
    return {name: relative_error(ours(s), theirs(s)) for name, (ours, theirs) in pairs.items()}


def both(parameters: Parameters, rpy_deg, leg_radius: float = 0.0):
    """The prototype about rest at an orientation, and the plant there."""
    pose = pose_at(rpy_deg, parameters)
    return Prototype(parameters, leg_radius).linearise(pose), dynamics_at(pose, parameters)
