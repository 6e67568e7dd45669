"""Modes of a payload or bus from its finite-element model: from a table of modes, or from its matrices.

**Matrices** (``[payload.finite_elements]``, ``[bus.finite_elements]``): mass ``M`` and stiffness ``K`` of the free
structure, (n, n), for displacements in m and rotations in rad of any nodes, or for the boundary and the modal
coordinates of a model that is reduced already.  The boundary is what the platform P (or the base B) holds: the rows of
its nodes are translations x, y, z and then rotations x, y, z.  The platform is rigid, and moves the boundary by ``T``
(rows, 6).  With i the other rows (R. R. Craig, M. C. C. Bampton, AIAA J. 6(7), 1968)::

    K_ii phi = w^2 M_ii phi,   phi' M_ii phi = 1         modes with the boundary held
    R = [T; -K_ii^-1 K_ib T]                             motion with the platform; rigid, as the structure is free
    p = R' M [0; phi],   R' M R                          participation; mass, centre of mass and inertia

The body has all its mass in ``R' M R``, so modes that are left out move with the platform as if they were rigid.  The
line of sight S (2, n), rad per unit of each row, gives a mode the sensitivity ``S [0; phi]``.

**Modes** (``[[payload.modes]]``, ``[[bus.modes]]``): participation ``p = R' M phi`` of any mode shape with the boundary
held, its modal mass ``phi' M phi`` (1, if it is left out), and the point that ``p`` is about (the origin).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .dynamics import rigid_body_mass
from .modes import MOST_BUS_MODES, MOST_PAYLOAD_MODES, move_participation
from .parameters import build, refuse_unknown
from .quantities import LARGEST, Array, Checked, ParameterError, check_whole, freeze, quantity
from .rotations import skew

Table = dict[str, Any]

LARGEST_MODEL = 2000  # rows; the modes of so many take 10 s
LONGEST_MATRIX = 200_000_000  # bytes of a file
MOST_PLACES = {"P": MOST_PAYLOAD_MODES, "B": MOST_BUS_MODES}
BODIES = {"P": ("payload", "platform"), "B": ("bus", "base")}
_SYMMETRIC = 1e-6  # of the largest number, how far a matrix may be from symmetric
_SINGULAR = 1e-13  # smallest eigenvalue of a stiffness with ones on its diagonal
_GROUNDED = 1e-3  # of the lowest frequency: what stiffness may hold the free structure
_RIGID = 1e-3  # of mass or size: how far the mass of the whole may be from that of a rigid body
_SAME = 0.01  # of mass, inertia or sensitivity: what two statements of one quantity may differ by
_SHOWN = 0.01  # smallest share of mass or inertia that a mode is listed with
_AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class StatedMode(Checked):
    """A mode as a finite-element program states it."""

    frequency: float = quantity("Hz", "Natural frequency with the boundary held", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio", at_least=0.0)
    participation: Array = quantity("", "Momentum per modal rate: linear, then angular", shape=(6,))
    modal_mass: float = quantity("", "phi' M phi of the mode shape", above=0.0, default=1.0)
    point: Array = quantity("m", "What the angular momentum is about", shape=(3,), default=(0.0, 0.0, 0.0))
    line_of_sight: Array = quantity("", "Turn about x and y of P per modal coordinate", shape=(2,), default=(0.0, 0.0))


def _complete_modes(items: Any, frame: str, where: str) -> Any:
    """Tables of modes with modal mass one about the origin of the frame ``P`` or ``B``, for :func:`.parameters.build`.

    Raises ParameterError, naming the entry behind ``where``.
    """
    if not isinstance(items, list):
        return items  # refused where the body is built
    keys = ["frequency", "damping_ratio", f"participation_{frame}", "modal_mass", f"point_{frame}"]
    keys += ["line_of_sight"] * (frame == "P")
    return [_complete_mode(item, frame, keys, f"{where}[{i}]") for i, item in enumerate(items, 1)]


def _complete_mode(item: Any, frame: str, keys: list[str], where: str) -> Any:
    if not isinstance(item, dict):
        return item
    refuse_unknown(item, keys, where)
    mode = build(StatedMode, {key.removesuffix(f"_{frame}"): value for key, value in item.items()}, where)
    size = np.sqrt(mode.modal_mass)  # one where it is left out: the numbers stay as they are
    participation = move_participation(mode.participation, -mode.point) / size
    return _list_entries(frame, mode.frequency, mode.damping_ratio, participation, mode.line_of_sight / size)


def _list_entries(frame: str, frequency: float, damping: float, participation: Array, turn: Array) -> Table:
    entries: Table = {"frequency": float(frequency), "damping_ratio": damping, f"participation_{frame}": participation}
    if frame == "P":
        entries |= {"line_of_sight_x": float(turn[0]), "line_of_sight_y": float(turn[1])}
    return entries


class BoundaryNode(NamedTuple):
    """A node that the platform or the base holds."""

    point: Array  # (3,) m, in its frame
    rows: Array  # (3,) or (6,) of the matrices, from 0: translations, rotations


@dataclass(frozen=True, eq=False)
class Structure:
    """What a finite-element model comes to."""

    mass: float  # kg
    com: Array  # (3,) m
    inertia: Array  # (3, 3) kg.m2, about the centre of mass
    frequencies: Array  # (k,) Hz, with the boundary held, lowest first
    participations: Array  # (k, 6) sqrt(kg), sqrt(kg).m, about the origin
    turns: Array  # (k, 2) of the line of sight about x and y, rad/(sqrt(kg).m)

    @property
    def shares(self) -> Array:
        """(k, 6) effective mass of each mode over the mass; about the centre of mass over the inertia."""
        about_com = np.array([move_participation(p, self.com) for p in self.participations]).reshape(-1, 6)
        whole = np.concatenate([np.full(3, self.mass), np.diag(self.inertia)])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(whole > 0.0, about_com**2 / whole, 0.0)


def reduce_structure(
    mass: Array, stiffness: Array, boundary: Sequence[BoundaryNode], axes: Array, line_of_sight: Array | None = None
) -> Structure:
    """Modes with the boundary held, and the rigid body, of a free structure.

    Parameters
    ----------
    mass, stiffness: (n, n).
    boundary: its nodes.
    axes: (3, 3) the axes x, y, z of the boundary rows, one in each row, in the frame.
    line_of_sight: (2, n) turn of the line of sight about x and y, rad per unit of each row.

    Raises
    ------
    ParameterError: no such structure; the text begins with ``mass``, ``stiffness``, ``boundary`` or ``line_of_sight``.
    """
    from scipy import linalg

    M, K = _symmetric(mass, "mass"), _symmetric(stiffness, "stiffness")
    if K.shape != M.shape:
        raise ParameterError("stiffness", f"has {len(K)} rows, the mass {len(M)}: expected one row for one coordinate")
    b, T = _move_boundary(boundary, axes, len(M))
    i = np.setdiff1d(np.arange(len(M)), b)
    if not i.size:
        raise ParameterError("boundary", "holds all rows: nothing is left that could vibrate")
    stiff = np.diag(K)[i]
    if not stiff.min() > 0.0:
        raise ParameterError("stiffness", f"row {i[np.argmin(stiff)] + 1} has no stiffness on its diagonal")
    scale = 1.0 / np.sqrt(stiff)
    K_ii, M_ii = (scale[:, None] * matrix[np.ix_(i, i)] * scale for matrix in (K, M))
    if not np.linalg.eigvalsh(K_ii)[0] > _SINGULAR:
        raise ParameterError(
            "stiffness", "with the boundary held something moves freely: not positive definite; look for rows that "
            "nothing holds, or for nodes that the boundary lacks",
        )  # fmt: skip
    squares, shapes = linalg.eigh(M_ii, K_ii)  # 1 / w^2: rows without mass have no mode
    if squares[0] < -1e-9 * squares[-1]:
        raise ParameterError("mass", "must be positive semi-definite: some motion has a negative energy")
    used = np.flatnonzero(squares > 1e-14 * squares[-1])[::-1]
    squares, phi = squares[used], scale[:, None] * shapes[:, used] / np.sqrt(squares[used])
    R = np.zeros((len(M), 6))
    R[b] = T
    R[i] = -scale[:, None] * np.linalg.solve(K_ii, scale[:, None] * (K[np.ix_(i, b)] @ T))
    whole, frequencies = R.T @ M @ R, 1.0 / (2.0 * np.pi * np.sqrt(squares))
    _check_free(R.T @ K @ R, whole, frequencies[0])
    body, com, inertia = _find_body(whole)
    participations = (R.T @ M[:, i] @ phi).T
    turns = np.zeros((len(phi.T), 2))
    if line_of_sight is not None:
        _check_line_of_sight(line_of_sight, R)
        turns = (line_of_sight[:, i] @ phi).T
    signs = np.sign(participations[np.arange(len(turns)), np.abs(participations).argmax(axis=1)])[:, None]
    signs[signs == 0.0] = 1.0
    return Structure(body, com, inertia, frequencies, signs * participations, signs * turns)


def _symmetric(matrix: Array, name: str) -> Array:
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ParameterError(name, f"expected as many rows as columns, got shape {matrix.shape}")
    apart = np.abs(matrix - matrix.T)
    if not apart.max() <= _SYMMETRIC * np.abs(matrix).max():
        row, column = np.unravel_index(apart.argmax(), apart.shape)
        raise ParameterError(
            name, f"must be symmetric: row {row + 1}, column {column + 1} is {matrix[row, column]:g}, "
            f"row {column + 1}, column {row + 1} is {matrix[column, row]:g}",
        )  # fmt: skip
    return np.asarray(0.5 * (matrix + matrix.T))


def _move_boundary(boundary: Sequence[BoundaryNode], axes: Array, n: int) -> tuple[Array, Array]:
    """Rows of the boundary, and their motion (rows, 6) with the frame."""
    motions = []
    for node in boundary:
        turning = np.block([[axes, -axes @ skew(node.point)], [np.zeros((3, 3)), axes]])
        motions.append(turning[: len(node.rows)])
    rows, T = np.concatenate([node.rows for node in boundary]), np.vstack(motions)
    if rows.max() >= n or len(np.unique(rows)) < len(rows):
        raise ParameterError("boundary", f"rows: expected different ones from 1 to {n}, got {(rows + 1).tolist()}")
    if np.linalg.matrix_rank(T) < 6:
        raise ParameterError("boundary", "does not hold the body: one node with rotations or three nodes not in a line")
    return rows, T


def _check_free(ground: Array, whole: Array, lowest: float) -> None:
    """No stiffness acts on the six motions as a rigid body."""
    size = 1.0 / np.sqrt(np.diag(whole) + 1e-9 * np.diag(whole).max())
    square = np.linalg.eigvalsh(size[:, None] * ground * size)
    frequency = np.sqrt(max(square[-1], 0.0)) / (2.0 * np.pi)
    if frequency > _GROUNDED * lowest:
        raise ParameterError(
            "stiffness", f"the free structure is held with {frequency:.3g} Hz (lowest mode {lowest:.3g} Hz), and has "
            "not six motions as a rigid body: look for a support, a wrong point of the boundary, or its axes",
        )  # fmt: skip


def _find_body(whole: Array) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of a mass matrix (6, 6)."""
    mass, moment = float(np.trace(whole[:3, :3]) / 3.0), whole[3:, :3]
    if not mass > 0.0:
        raise ParameterError("mass", f"the structure has the mass {mass:g} kg")
    size = np.sqrt(np.trace(whole[3:, 3:]) / mass)
    wrong = np.abs(whole[:3, :3] - mass * np.eye(3)).max() / mass, np.abs(moment + moment.T).max() / (mass * size)
    if max(wrong) > _RIGID:
        raise ParameterError(
            "mass", "is not that of a rigid body where all moves with the boundary (in x, y, z: "
            f"{', '.join(f'{value:.4g}' for value in np.diag(whole)[:3])} kg): expected kg, kg.m and kg.m2, and "
            "boundary rows in the order translations x, y, z, rotations x, y, z",
        )  # fmt: skip
    com = 0.5 * np.array([moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]]) / mass
    return mass, com, whole[3:, 3:] + mass * skew(com) @ skew(com)


def _check_line_of_sight(line_of_sight: Array, R: Array) -> None:
    if line_of_sight.shape != (2, len(R)):
        raise ParameterError("line_of_sight", f"expected shape (2, {len(R)}), got {line_of_sight.shape}")
    found = line_of_sight @ R
    expected = np.eye(6)[3:5]
    if not np.abs(found - expected).max() <= _SAME:
        raise ParameterError(
            "line_of_sight", "a rigid turn must turn it by as much, and a shift by nothing; motions x, y, z, rx, ry, "
            f"rz of 1 m and 1 rad turn it about x by {_list_numbers(found[0])} and about y by "
            f"{_list_numbers(found[1])} rad, expected {_list_numbers(expected[0])} and {_list_numbers(expected[1])}",
        )  # fmt: skip


def _list_numbers(values: Array) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"


# ---- files ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Model(Checked):
    """The table ``finite_elements`` of a file."""

    mass: str = quantity("", "File of the mass matrix")
    stiffness: str = quantity("", "File of the stiffness matrix")
    damping_ratio: float = quantity("1", "Damping ratio of all its modes", at_least=0.0)
    boundary: Any = quantity("", "Nodes that the platform or the base holds")
    line_of_sight: str = quantity("", "File of the line of sight", default="")
    axes: Array = quantity("1", "Axes of the boundary rows", shape=(3, 3), default=((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    highest_frequency: float = quantity("Hz", "Highest frequency of a mode that is kept", above=0.0, default=1e9)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("mass", "stiffness", "line_of_sight"):
            if not isinstance(getattr(self, name), str):
                raise ParameterError(name, f"expected the path of a file, got {getattr(self, name)!r}")
        if not np.allclose(self.axes @ self.axes.T, np.eye(3), atol=1e-6) or np.linalg.det(self.axes) < 0.0:
            raise ParameterError("axes", f"expected right-handed axes at right angles, got {self.axes.tolist()}")


def read_structure(table: Any, frame: str, folder: Path, where: str) -> tuple[Structure, float, float]:
    """The structure of a table ``finite_elements``, damping ratio and highest frequency (Hz) of its modes.

    Parameters
    ----------
    frame: ``P`` or ``B``.
    folder: what paths begin at.
    where: name of the table for errors.

    Raises
    ------
    ParameterError: an entry, a file or the structure cannot be used.
    """
    if isinstance(table, dict):
        known = ("mass", "stiffness", "damping_ratio", "boundary", f"axes_{frame}", "highest_frequency")
        refuse_unknown(table, (*known, *(["line_of_sight"] if frame == "P" else [])), where)
        table = {key.removesuffix(f"_{frame}"): value for key, value in table.items()}
    model: Model = build(Model, table, where)
    try:
        mass, stiffness = (read_matrix(folder / getattr(model, name), name) for name in ("mass", "stiffness"))
        sight = read_matrix(folder / model.line_of_sight, "line_of_sight") if model.line_of_sight else None
        boundary = _read_boundary(model.boundary, frame)
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            structure = reduce_structure(mass, stiffness, boundary, model.axes, sight)
    except ParameterError as error:
        raise ParameterError(f"{where}.{error.name}", error.problem) from None
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise ParameterError(f"{where}.mass", f"and stiffness cannot be reduced: {error}") from error
    return structure, model.damping_ratio, model.highest_frequency


def read_matrix(path: Path, name: str) -> Array:
    """A matrix from a Matrix Market file (``.mtx``) or a numpy file (``.npy``).

    Raises ParameterError, naming ``name``: no such file, too large, or no real matrix.
    """
    from scipy import io

    try:
        if not path.is_file():
            raise FileNotFoundError(0, "there is no such file")
        if path.stat().st_size > LONGEST_MATRIX:
            raise ValueError(f"has more than {LONGEST_MATRIX} bytes")
        if path.suffix == ".npy":
            found = np.load(path, mmap_mode="r", allow_pickle=False)  # a file shorter than its head says is refused
            _check_size(found.shape)
        elif path.suffix == ".mtx":
            rows, columns, entries, _, field, _ = io.mminfo(path)
            _check_size((rows, columns))
            if entries > rows * columns:
                raise ValueError(f"states {entries} entries, more than it has places")
            if field not in ("real", "integer", "double", "unsigned-integer"):
                raise ValueError(f"holds {field} numbers, expected real ones")
            found = io.mmread(path)
            found = found if isinstance(found, np.ndarray) else found.toarray()
        else:
            raise ValueError("expected a Matrix Market file (.mtx) or a numpy file (.npy)")
        matrix = np.array(found, dtype=np.float64)
        if (wild := np.argwhere(~(np.abs(matrix) <= LARGEST))).size:
            row, column = wild[0]
            raise ValueError(f"row {row + 1}, column {column + 1} is {matrix[row, column]}: expected up to {LARGEST:g}")
        return matrix
    except (OSError, ValueError, OverflowError, TypeError, MemoryError, EOFError) as error:
        raise ParameterError(name, f"{path}: {error.strerror if isinstance(error, OSError) else error}") from error


def _check_size(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or not 0 < max(shape) <= LARGEST_MODEL:
        raise ValueError(
            f"has shape {shape}, expected a matrix of at most {LARGEST_MODEL} rows: have the finite-element program "
            "reduce it to its boundary and modes (Craig-Bampton)"
        )


def _read_boundary(items: Any, frame: str) -> list[BoundaryNode]:
    point, nodes = f"point_{frame}", []
    if not isinstance(items, list) or not items or not all(isinstance(item, dict) for item in items):
        raise ParameterError("boundary", f"expected tables with {point} and rows")
    for number, item in enumerate(items, 1):
        where = f"boundary[{number}]"
        refuse_unknown(item, (point, "rows"), where)
        for key in (point, "rows"):
            if key not in item:
                raise ParameterError(f"{where}.{key}", "missing")
        rows = item["rows"]
        if not isinstance(rows, list) or len(rows) not in (3, 6):
            raise ParameterError(f"{where}.rows", f"expected three translations, or three and three rotations: {rows}")
        numbers = [check_whole(row, f"{where}.rows", at_least=1) - 1 for row in rows]
        nodes.append(BoundaryNode(freeze(item[point], (3,), f"{where}.{point}"), np.array(numbers)))
    return nodes


# ---- into an instrument --------------------------------------------------------------------------------------------


def put_modes(own: Table, frame: str, folder: Path, where: str) -> list[str]:
    """Put modes as :mod:`.parameters` has them in place of the ``modes`` and ``finite_elements`` of a body's table.

    Mass, centre of mass and inertia that the table does not give are those of the model.  The difference between them
    and the model is rigid.

    Parameters
    ----------
    own: the table; it is changed.
    frame, folder, where: as for :func:`read_structure`; ``where`` names the table.

    Returns
    -------
    Lines that say what the model comes to.

    Raises
    ------
    ParameterError: a mode or the model cannot be used, or it has more mass than the body.
    """
    if "modes" in own:
        own["modes"] = _complete_modes(own["modes"], frame, f"{where}.modes")
    if "finite_elements" not in own:
        return []
    found, damping, highest = read_structure(own.pop("finite_elements"), frame, folder, f"{where}.finite_elements")
    for key, value in (("mass", found.mass), (f"com_{frame}", found.com), (f"inertia_{frame}", found.inertia)):
        own.setdefault(key, value)
    others = own.get("modes", [])
    places = MOST_PLACES[frame] - len(others if isinstance(others, list) else [])
    chosen, left = _choose_modes(found, highest, max(places, 0))
    modes = [
        _list_entries(frame, found.frequencies[k], damping, found.participations[k], found.turns[k]) for k in chosen
    ]
    own["modes"] = [*(others if isinstance(others, list) else [others]), *modes]
    return [*_compare_bodies(own, found, frame, where), *_list_shares(found, chosen, left, BODIES[frame][1])]


def _choose_modes(found: Structure, highest: float, places: int) -> tuple[list[int], list[int]]:
    """The modes with the largest shares of mass or inertia, lowest frequency first, and the others."""
    largest = found.shares.max(axis=1)
    below = [k for k in range(len(largest)) if found.frequencies[k] <= highest]
    chosen = sorted(sorted(below, key=lambda k: -largest[k])[:places])
    return chosen, [k for k in range(len(largest)) if k not in chosen]


def _compare_bodies(own: Table, found: Structure, frame: str, where: str) -> list[str]:
    """Lines on the masses.  Raises ParameterError where the model has what the body has not."""
    try:
        stated = (
            float(own["mass"]), freeze(own[f"com_{frame}"], (3,), f"{where}.com"),
            freeze(own[f"inertia_{frame}"], (3, 3), f"{where}.inertia"),
        )  # fmt: skip
    except (TypeError, ValueError) as error:
        raise error if isinstance(error, ParameterError) else ParameterError(f"{where}.mass", str(error)) from error
    model = rigid_body_mass(found.mass, found.com, found.inertia)
    size = 1.0 / np.sqrt(np.diag(model) + 1e-9 * np.diag(model).max())
    rest = size[:, None] * (rigid_body_mass(*stated) - model) * size
    if not np.linalg.eigvalsh(rest)[0] >= -_SAME:
        raise ParameterError(
            f"{where}.mass", "mass, centre of mass and inertia must contain those of finite_elements: given are "
            f"{_name_body(*stated)}; the model has {_name_body(found.mass, found.com, found.inertia)}",
        )  # fmt: skip
    more = stated[0] - found.mass
    lines = [f"{where}.finite_elements: {_name_body(found.mass, found.com, found.inertia)}"]
    return [*lines, f"  {more:.4g} kg more of the {where} are rigid"] if more > _SAME * found.mass else lines


def _name_body(mass: float, com: Array, inertia: Array) -> str:
    return f"{mass:.4g} kg at {_list_numbers(com)} m, {_list_numbers(np.diag(inertia))} kg.m2"


def _list_shares(found: Structure, chosen: Sequence[int], left: Sequence[int], held: str) -> list[str]:
    shares = found.shares
    lines = [f"modes with the {held} held, and their shares of mass and inertia:"]
    for k in chosen:
        named = [f"{axis} {100.0 * s:.0f} %" for axis, s in zip(_AXES, shares[k], strict=True) if s >= _SHOWN]
        lines.append(f"  {found.frequencies[k]:10.2f} Hz  {', '.join(named) or f'below {100.0 * _SHOWN:.0f} %'}")
    if left:
        worst = 100.0 * shares[list(left)].sum(axis=0)
        most = int(worst.argmax())
        lines.append(f"  {len(left)} modes are left out; with {worst[most]:.2g} % of {_AXES[most]} they are rigid")
    return lines
