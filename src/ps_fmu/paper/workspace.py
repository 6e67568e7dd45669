"""The workspace: all orientations that the coarse legs reach with the fine legs at their nominal length.

The coarse displacements fill a cube, the joint space.  Its image under forward kinematics with ``d_f = 0`` is the
workspace, and the image of its surface is the surface of the workspace, since the map is one to one where no pose is
singular.  The paper walks over that surface in steps of 2 mm (section 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.inverse_kinematics import reach_along
from ..mechanism.kinematics import ForwardPose, Geometry, condition_number, forward_kinematics, platform_jacobian
from ..mechanism.quantities import Array
from ..mechanism.rotations import roll_pitch_yaw, rotation_from_vector

STEP = 2e-3  # m, of the paper


@dataclass(frozen=True, eq=False)
class Sample:
    """Poses with the fine legs at nominal length; n of them."""

    coarse_displacement: Array
    """(n, 3), m."""
    pose: ForwardPose
    orientation: Array
    """(n, 3), roll, pitch and yaw, rad."""
    singular_values: Array
    """(n, 6), of J_lp with rotations as arc at the platform joints, largest first; without unit."""
    condition: Array
    """(n,), condition number of J_lp, see :func:`..mechanism.kinematics.condition_number`."""


def limits(sample: Sample) -> Array:
    """Smallest and largest roll, pitch and yaw of a sample, (3, 2), rad: Table 1."""
    return np.column_stack([sample.orientation.min(axis=0), sample.orientation.max(axis=0)])


def surface(geometry: Geometry, step: float = STEP) -> Array:
    """Coarse displacements all over the surface of the joint space, (n, 3), m.

    ``step``: distance of neighbours, m; the last of a row is nearer where the stroke is no multiple of it.
    """
    volume = grid(geometry, step)
    low, high = geometry.coarse_stroke
    return volume[np.any((volume == low) | (volume == high), axis=1)]


def grid(geometry: Geometry, step: float = STEP) -> Array:
    """Coarse displacements all over the joint space, (n, 3), m."""
    low, high = geometry.coarse_stroke
    count = max(int(np.ceil((high - low) / step - 1e-9)), 1)
    row = np.append(low + step * np.arange(count), high)
    return np.stack(np.meshgrid(row, row, row, indexing="ij"), axis=-1).reshape(-1, 3)


def sample(geometry: Geometry, coarse_displacement: Array) -> Sample:
    """Poses for coarse displacements (n, 3), m, at once.

    Raises
    ------
    ForwardKinematicsError: no pose for one of them.
    """
    lengths = geometry.nominal_lengths + np.pad(coarse_displacement, ((0, 0), (0, 3)))
    pose = forward_kinematics(geometry, lengths)
    J_lp = platform_jacobian(geometry, pose.translation_B, pose.R)
    scaled = J_lp / np.repeat([1.0, geometry.platform_radius], 3)
    singular_values = np.linalg.svd(scaled, compute_uv=False)
    return Sample(
        coarse_displacement, pose, pose.orientation, singular_values, condition_number(geometry, J_lp)
    )


def largest_cube(geometry: Geometry, across: int = 21) -> float:
    """Half the edge of the largest cube of roll, pitch and yaw about zero that is all within reach, rad.

    Rays go from zero to the points of a grid of ``across`` x ``across`` on each face.
    """
    row = np.linspace(-1.0, 1.0, across)
    points = np.stack(np.meshgrid(row, row, row, indexing="ij"), axis=-1).reshape(-1, 3)
    rays = points[np.abs(points).max(axis=1) == 1.0]
    return float(reach_along(geometry, lambda size: size[..., None] * rays, len(rays), np.radians(40.0)).min())


def cone(geometry: Geometry, azimuth: Array, twist: float = 0.0) -> Array:
    """Largest tilt of the boresight (z of P) towards each azimuth (n,) with a given twist, (n,), rad.

    The platform turns by ``twist`` about its boresight, then tilts about an axis in the x-y plane of B, so that the
    boresight leans towards ``azimuth`` (angle from x towards y of B).  -1 where the twist alone is out of reach.
    """
    axis_B = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
    turned = rotation_from_vector(np.array([0.0, 0.0, twist]))

    def orientation_at(tilt: Array) -> Array:
        return roll_pitch_yaw(rotation_from_vector(tilt[..., None] * axis_B) @ turned)

    return reach_along(geometry, orientation_at, len(azimuth), np.radians(40.0))


def smallest_tilt(geometry: Geometry, azimuth: Array) -> float:
    """Half-angle of the largest cone of boresights within reach without twist, rad.

    ``azimuth`` (n,), rad: a first look, ascending and evenly spaced.  Around the direction with the least tilt a second
    look is 40 times finer.  Each leg alone would allow a tilt that varies smoothly with the direction, and the least of
    them counts, so that the minimum is a smooth one: with a first look in steps of 1 deg the second finds it to
    3e-7 deg.
    """
    step = azimuth[1] - azimuth[0]
    about = azimuth[np.argmin(cone(geometry, azimuth))]
    return float(cone(geometry, about + np.linspace(-step, step, 81)).min())


def rim(geometry: Geometry, per_edge: int = 400) -> tuple[Array, Array]:
    """Boresights at the rim of what is within reach if the twist is free: azimuth and tilt, (6 per_edge,) each, rad.

    Turning about the boresight lengthens all three coarse legs or shortens all three.  So a boresight is within reach
    until one leg is at its upper stop while another is at its lower one, and no twist helps both.  The third leg is
    anywhere: these are six edges of the joint space, and they make one closed path, which is followed here.

    Raises
    ------
    ValueError: a geometry in which a twist lengthens some legs and shortens others.
    """
    if not _twist_moves_all_legs_alike(geometry):
        raise ValueError("the rim is only known where a twist about the boresight moves all coarse legs one way")
    low, high = geometry.coarse_stroke
    corners = np.where([[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1]], high, low)
    way = np.arange(per_edge)[:, None] / per_edge
    edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    displacement = np.concatenate([start + way * (end - start) for start, end in edges])
    x, y, z = sample(geometry, displacement).pose.R[..., :, 2].T
    return np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)


def _twist_moves_all_legs_alike(geometry: Geometry) -> bool:
    """Whether all coarse legs lengthen, or all shorten, when the platform turns about its boresight, at any pose."""
    pose = sample(geometry, grid(geometry, 2.0 * STEP)).pose
    # Twist of the platform (6) per rate of the coarse legs, with the fine ones at their nominal length.
    per_leg = np.linalg.inv(platform_jacobian(geometry, pose.translation_B, pose.R))[:, 3:, :3]
    rates = np.linalg.solve(per_leg, pose.R[:, :, 2:])
    return bool(np.all(rates > 0.0) or np.all(rates < 0.0))
