"""Velocities of staggered (C) grids, averaged to cell centres.

The components are on the faces of the cells.  Models number them differently:

    "after"   ROMS, NEMO, Veros   u[i] on the face after centre i:   its faces are u[i-1], u[i]
    "before"  MITgcm              u[i] on the face before centre i:  its faces are u[i], u[i+1]

These are positions in a file: in ROMS u(i) is before centre i, but a file begins with u(1) and with centre 0.  MOM6
writes one more face than centres with symmetric memory ("before"), and as many without ("after").

A centre gets the mean of its two faces.  A closed face beside water has no flow and counts as 0,
as in the models themselves; beyond the end of the file there is no face, and the other one is used alone.
"""

from __future__ import annotations

import re
import warnings
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from scipy import sparse

from floebmi.errors import InputError, warn
from floebmi.fields import Box, Field, File, role
from floebmi.places import Net, Place, Position, place_of

if TYPE_CHECKING:
    import xarray as xr

Stagger = Literal["auto", "none", "before", "after"]
Offsets = tuple[int, ...]  # the faces of centre c are c + offset
_OFFSETS: dict[str, Offsets] = {"before": (0, 1), "after": (-1, 0), "none": (0,)}
_CENTRE = r"rho|grid_t|_t$|glamt|xc|tlon|geolon$"
_NOT_CENTRE = r"psi|_[fuv]$|grid_[fuvw]|[_xy]g$|glam[fuv]"
_ON_FACES = ("vozocrtx", "sozocrtx")
_SAMPLE = 40


def is_staggered(u: Field, v: Field) -> bool:
    """True if the two components are at different points."""
    if u.dims != v.dims:
        return True
    if u.file is v.file:
        return _coordinates(u) != _coordinates(v)
    return any(
        not np.array_equal(one.values, other.values, equal_nan=True) for one, other in _shared(u, v)
    )


def _shared(u: Field, v: Field) -> list[tuple[xr.DataArray, xr.DataArray]]:
    """Coordinates along the horizontal dimensions that both components' files have under one name, of one shape or not."""
    one, other = u.file.data, v.file.data
    return [
        (one[name], other[name])
        for name, variable in one.variables.items()
        if role(str(name), variable) in ("lon", "lat", "x", "y")
        and variable.dims
        and set(variable.dims) <= set(u.dims)
        and name in other.variables
        and set(other[name].dims) == set(variable.dims)
    ]


def _refuse_turned(u: Field, v: Field) -> None:
    """Raise InputError for two files whose rows or columns run in opposite directions."""
    for one, other in _shared(u, v):
        if one.shape != other.transpose(*one.dims).shape or min(one.shape) < 3:
            continue
        for axis, dim in enumerate(one.dims):
            a, b = (
                np.diff(f.transpose(*one.dims).values.astype(float), axis=axis)
                for f in (one, other)
            )
            if np.nansum(np.sign(a * b)) < -0.5 * a.size:
                raise InputError(
                    f"{u.label} and {v.label}: {one.name} falls along {dim} in one and grows in the other: turn one of them"
                    " over, so that points of the same index are neighbours"
                )


def _coordinates(field: Field) -> set[str]:
    named = field.array.encoding.get("coordinates", field.array.attrs.get("coordinates", ""))
    data = field.file.data
    return {n for n in str(named).split() if n in data and role(n, data[n]) in ("lon", "lat")}


class Centres(NamedTuple):
    """The points to which both components are averaged.

    file, dims : the file that holds them, and their dimensions (rows, columns), () for a single point
    place : where they are
    u_offsets, v_offsets : faces of u beside a centre along columns, of v along rows; (0,): at the centre
    """

    file: File
    dims: tuple[str, ...]
    place: Place
    u_offsets: Offsets = (0,)
    v_offsets: Offsets = (0,)

    @property
    def staggered(self) -> bool:
        return len(self.u_offsets) > 1 or len(self.v_offsets) > 1


def find_centres(
    files: list[File],
    u: Field,
    v: Field,
    stagger: Stagger,
    projection: str | None,
    position: Position,
    file_projection: str | None,
) -> Centres:
    """The points of the components, or the cell centres of a staggered grid.

    Centres are the rows of u with the columns of v if these have coordinates, else a separate longitude and latitude
    in any of the files, else the midpoints between u points.

    Raises
    ------
    InputError
        if no centres are found, or if it is not clear which faces belong to them.
    """
    options = (projection, position, file_projection)
    apart = bool(u.dims) and is_staggered(u, v)
    if apart and u.file is not v.file:
        _refuse_turned(u, v)
    if stagger == "none" or (stagger == "auto" and not apart):
        if u.shape != v.shape:
            raise InputError(f"{u.label} {u.shape} and {v.label} {v.shape}: their points differ")
        # Of two files that do not say where their points are, none tells whether they are the same points.
        others = files if u.file is v.file or stagger == "none" else ()
        place = place_of(u.file, u.array, u.dims, *options, others, files)
        if stagger == "auto" and u.name in _ON_FACES and isinstance(place, Net):
            warn(
                f"{u.label}, {v.name}: as NEMO writes them they lie on the faces of cells, but the file has one place for"
                " both, where they are taken: say stagger = 'after' if they are on faces, 'none' if not"
            )
        return Centres(u.file, u.dims, place)
    taken = [(u.file, u.dims), (v.file, v.dims)] if apart else []
    problem: InputError | None = None
    axes = [(file, u.array, (u.rows, v.columns)) for file in (u.file, *files)]
    for file, array, dims in [*axes, *_nets(files, u)]:
        if any(file is f and set(dims) == set(d) for f, d in taken):
            continue
        if not all(d in file.data.sizes for d in dims):
            continue
        try:
            place = place_of(file, array, dims, *options, files)
        except InputError as error:
            problem = problem or error
            continue
        return Centres(
            file, dims, place,
            _beside(u, place, stagger, 1, files), _beside(v, place, stagger, 0, files),
        )  # fmt: skip
    try:
        faces = place_of(u.file, u.array, u.dims, *options)
    except InputError as error:
        faces, problem = None, problem or error
    if not isinstance(faces, Net):
        raise InputError(
            f"{u.label}, {v.name}: a staggered grid, but its centres are not found"
            f"{f' ({problem})' if problem else ''}; give the file that has their longitude and latitude"
            " along with this one"
        )
    side = "after" if stagger == "auto" else stagger
    order = slice(None) if side == "after" else slice(None, None, -1)
    x, y = (_middles(a[:, order])[:, order] for a in (faces.x, faces.y))
    text = f"{faces.text}, centres between u points"
    place = Net(u.label, x, y, faces.plane, text, faces.falls)
    return Centres(u.file, u.dims, place, _OFFSETS[side], _OFFSETS[side])


def _nets(files: list[File], u: Field) -> list[tuple[File, xr.DataArray, tuple[str, str]]]:
    """2-D longitudes that could be those of the centres: the likely names first."""
    nets = [
        (f, f.data[name], tuple(str(d) for d in variable.dims[-2:]))
        for f in files
        for name, variable in f.data.variables.items()
        if role(str(name), variable) == "lon"
        and variable.ndim >= 2
        and np.abs(np.subtract(variable.shape[-2:], u.shape)).max() <= 1
        and not re.search(_NOT_CENTRE, str(name).lower())
    ]
    return sorted(nets, key=lambda net: not re.search(_CENTRE, str(net[1].name).lower()))


def _middles(u_points: np.ndarray) -> np.ndarray:
    """Centres from u points that come after them."""
    middle = (u_points[:, 1:] + u_points[:, :-1]) / 2
    return np.hstack([1.5 * u_points[:, :1] - 0.5 * u_points[:, 1:2], middle])


def _beside(field: Field, place: Place, stagger: Stagger, axis: int, files: list[File]) -> Offsets:
    """The faces of a component beside a centre, along the component's axis (0 rows, 1 columns).

    Decided by sizes, else by the positions of the points, else by the names of the dimensions.
    """
    dim, (own, other) = field.dims[axis].lower(), ("vu", "uv")[axis]
    if re.search(_dimension_of(other), dim):
        raise InputError(
            f"{field.label}: by the names of its dimensions ({', '.join(field.dims)}) it is {other}, but is given as {own}:"
            " give first u, along the rows, then v"
        )
    faces, centre = field.shape[axis], place.shape[axis]
    if field.shape[1 - axis] != place.shape[1 - axis] or abs(faces - centre) > 1:
        raise InputError(
            f"{field.label}: {field.shape[0]} × {field.shape[1]} points do not fit"
            f" {place.shape[0]} × {place.shape[1]} cell centres"
        )
    if stagger != "auto":
        return _OFFSETS[stagger]
    if faces != centre:
        return _OFFSETS["after" if faces < centre else "before"]
    shift = _shift(field, place, axis, files)
    if shift is not None:
        return _OFFSETS["none" if abs(shift) < 0.25 else "before" if shift < 0 else "after"]
    if re.search(_dimension_of(own), dim):
        return _OFFSETS["after"]
    if re.search(r"^[xy]_?g$|^[ij]_g$", dim):  # MITgcm, also as xmitgcm writes it
        return _OFFSETS["before"]
    raise InputError(
        f"{field.label}: a staggered grid, but not on which side of the centres its points are; say"
        " stagger = 'before' (MITgcm), 'after' (ROMS, NEMO, Veros) or 'none'"
    )


def _dimension_of(component: str) -> str:
    """Pattern of the names that ROMS and NEMO (XIOS) give the dimensions of a component's points."""
    return rf"^(xi|eta)_{component}$|grid_{component}(_inner)?$"


def _shift(field: Field, place: Place, axis: int, files: list[File]) -> float | None:
    """How far the points lie from the centres of the same index, in cells; None if not known."""
    try:
        with warnings.catch_warnings(action="ignore"):  # the user was warned of the centres
            own = place_of(field.file, field.array, field.dims, place.plane, others=files)
    except InputError:
        return None
    row, column = (np.unique(np.linspace(0, n - 1, _SAMPLE).astype(int)) for n in own.shape)
    whole = Box(slice(0, own.shape[0]), slice(0, own.shape[1]))
    x, y = (a[np.ix_(row, column)].ravel() for a in own.xy(whole))
    around = place.corners(x, y)
    index = np.sum((around.row, around.column)[axis] * around.weight, axis=1)
    at = np.meshgrid(row, column, indexing="ij")[axis].ravel()
    shift = (index - at)[np.isfinite(index)]
    return float(np.median(shift)) if shift.size else None


def mean_of_faces(
    n_faces: int, centre: slice, beside: Offsets, periodic: bool
) -> tuple[sparse.csr_matrix, slice]:
    """The matrix (centres × faces) along one axis, and the faces that it needs.

    With `beside` = (0,) it is the identity: points that are at the centres already.
    """
    face = np.arange(centre.start, centre.stop)[:, None] + np.array(beside)
    if periodic:
        face = face % n_faces
    there = (face >= 0) & (face < n_faces)
    weight = there / np.maximum(there.sum(axis=1, keepdims=True), 1)
    row, k = np.nonzero(there)
    used = slice(int(face[there].min()), int(face[there].max()) + 1)
    matrix = sparse.csr_matrix(
        (weight[row, k], (row, face[row, k] - used.start)),
        shape=(len(face), used.stop - used.start),
    )
    return matrix, used


def open_faces(mean: sparse.csr_matrix, water: np.ndarray) -> np.ndarray:
    """A face is open if every centre beside it is water: bool (faces,) from `water` (centres,)."""
    return ((mean != 0).T @ (~water.ravel()).astype(float)) == 0
