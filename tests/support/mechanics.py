"""Shared by the tests of the mechanics: poses, the rigid system of the multibody reference, the reference itself."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import lambertw

from ps_fmu.control.feedforward import Controller
from ps_fmu.mechanism.dynamics import Dynamics, Pose, assemble
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import PlantModel
from ps_fmu.mechanism.parameters import Parameters, load
from ps_fmu.mechanism.rotations import rotation_matrix
from ps_fmu.theory.loop import (
    BASE_ACCELERATION,
    BASE_WRENCH,
    FINE_FORCES,
    OUTPUT_NAMES,
    controller_system,
    plant_system,
)
from ps_fmu.theory.transfer_matrices import Nominal

REFERENCE = Path(__file__).parents[1] / "data" / "multibody-reference.json"
PAPER = load()
ORIENTATIONS_DEG = [(0.0, 0.0, 0.0), (8.5, 0.0, 0.0), (0.0, -7.0, 0.0), (0.0, 0.0, 14.0)]


def pose_at(rpy_deg: tuple[float, float, float], parameters: Parameters = PAPER) -> Pose:
    orientation = np.radians(rpy_deg)
    found = inverse_kinematics(parameters.manipulator.geometry, orientation)
    return Pose(found.translation_B, rotation_matrix(orientation))


def rigid(parameters: Parameters = PAPER) -> Parameters:
    """The same without bus modes, truss modes and rod flexibility."""
    rods = replace(parameters.manipulator.coarse_rods, axial_stiffness=0.0)
    return replace(
        parameters,
        manipulator=replace(parameters.manipulator, coarse_rods=rods),
        payload=replace(parameters.payload, truss_modes=()),
        bus=replace(parameters.bus, modes=()),
    )


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


def dynamics_at(pose: Pose, parameters: Parameters = PAPER) -> Dynamics:
    return assemble(parameters.manipulator, parameters.payload, parameters.bus, pose)


def to_rotation_matrix(q: NDArray) -> NDArray:
    """The rotation matrix of a unit quaternion, scalar first, (..., 4) to (..., 3, 3)."""
    return Rotation.from_quat(np.reshape(q, (-1, 4)), scalar_first=True).as_matrix().reshape(*np.shape(q)[:-1], 3, 3)


def reference_cases() -> list[dict]:
    return json.loads(REFERENCE.read_text())["cases"]


def reference_pose(case: dict) -> Pose:
    return Pose(np.array(case["platform_translation_m"]), rotation_matrix(np.radians(case["orientation_rpy_deg"])))


def complex_array(pair: list) -> NDArray[np.complex128]:
    real, imaginary = np.array(pair)
    return real + 1j * imaginary


def relative_error(value: NDArray, reference: NDArray) -> float:
    """Largest difference over frequencies, each against the largest element of the reference matrix there."""
    return float((np.abs(value - reference).max(axis=(-2, -1)) / np.abs(reference).max(axis=(-2, -1))).max())


def fixed_base(nominal: Nominal, s: NDArray) -> NDArray:
    """Fine force to payload rotation as if the base did not move, (..., 3, 3), eq (46)."""
    return nominal.dynamics.jacobians.J_theta_f @ np.linalg.inv(nominal.U(s)[0])


def closed_loop(model: PlantModel, controller: Controller):
    """Plant and isolator together: from base wrench (6) to the plant's outputs, in continuous time without delay."""
    from control import interconnect, ss  # 1 s to import

    plant, isolator = plant_system(model), controller_system(controller)
    # The wrench comes from outside under its own name; everything else is matched by name.
    return ss(
        interconnect(
            [plant, isolator],
            connections=[[f"isolator.{name}", f"plant.{name}"] for name in BASE_ACCELERATION]
            + [[f"plant.{name}", f"isolator.{name}"] for name in FINE_FORCES],
            inplist=[f"plant.{name}" for name in BASE_WRENCH],
            inputs=BASE_WRENCH,
            outlist=[f"plant.{name}" for name in OUTPUT_NAMES],
            outputs=OUTPUT_NAMES,
            name="closed_loop",
        )
    )


def restitution(damping: float, speed: float) -> float:
    """Speed after a contact over ``speed`` before it (m/s), for a free body; ``damping`` in s/m.

    The equation in the text of :mod:`ps_fmu.actuators.stops`, solved by Lambert's function:
    ``D w = 1 + W_0(-(1 + D v) exp(-1 - D v))``.
    """
    rate = damping * speed
    if rate == 0.0:
        return 1.0
    return float((1.0 + lambertw(-(1.0 + rate) * np.exp(-1.0 - rate)).real) / rate)
