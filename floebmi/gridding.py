"""Gridded fields of the floes, for hosts and files, without losses.

All fields start from the exact area of each disc in each cell (`coverage`).  Extensive quantities
are distributed by area; means have matching weights: thickness by ice area,
velocity by mass, radius and coordination number by floes.  The part outside the grid is also
accounted for:

    Σ_k π r_k² = Σ_wet A c + Σ_wet A (overlap) + Σ_dry ice area + Σ_k outside_k    (eq. area-budget)

Dry cells keep the ice that lies on them (a coast is made of floes); the writer masks them.

Internal stress.  A contact exerts the force f on floe i; the branch d leads from the centre of i to
that of j.  Spread evenly along its branch, it gives a stress that is negative in compression,

    σ(x) = Σ_contacts f ⊗ d ∫₀¹ δ(x − x_i − s d) ds                            (eq. internal-stress)

whose mean over a cell needs only the length of each branch in the cell; Σ_c σ A is exactly the
virial Σ f ⊗ d.  Integrating the divergence along the branch leaves its two ends,

    ∇·σ = Σ_contacts f [δ(x − x_i) − δ(x − x_j)] = Σ_floes F_k δ(x − x_k)    (eq. stress-divergence)

F_k being the net contact force on floe k.  So the divergence needs no differences between cells: it
is the net contact force, distributed with the same weights as every other force, on any kind of grid,
and its sum over the grid is the sum of the F_k to round-off.  (Differences of σ between cells of a
few floes would be noise of order σ / cell size, whereas the net force on a floe at rest is a small
residual.)

I. Goldhirsch, Granular Matter 12, 239 (2010), doi:10.1007/s10035-010-0181-z.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from floebmi.errors import InputError
from floebmi.geometry import cut
from floebmi.grid import Grid, bin_of
from floebmi.kernels import BLOCK, in_place, jit
from floebmi.sampling import Coverage, Period, Weights, images, scatter


class AreaBudget(NamedTuple):
    """Budget of the area of the floes [m²]; the parts add up to Σ π r² (eq. area-budget).

    wet : in wet cells, as in the area fraction
    overlap : in wet cells, beyond an area fraction of 1
    dry : in dry cells
    outside : outside the grid
    """

    wet: float
    overlap: float
    dry: float
    outside: float


class InternalStress(NamedTuple):
    """Internal stress, summed over the thickness; negative in compression.

    xx, xy, yy : (size,) [N/m]
    xy is the symmetric part, ½ (f_x d_y + f_y d_x); the antisymmetric part is the couple of friction,
    which the rotation of the floes takes up.
    outside : (3,) virial xx, xy, yy of the parts of branches outside the grid [N m]
    """

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    outside: np.ndarray


def area_budget(grid: Grid, coverage: Coverage) -> AreaBudget:
    """Budget of the area of the floes: wet cells, overlap, dry cells, outside the grid [m²]."""
    _check_grid(grid, coverage.size)
    ice = coverage.in_cells
    shown = np.minimum(ice, grid.area)
    return AreaBudget(
        wet=float(shown[grid.wet].sum()),
        overlap=float((ice - shown)[grid.wet].sum()),
        dry=float(ice[~grid.wet].sum()),
        outside=float(coverage.outside.sum()),
    )


@in_place
def give_back(start, cell, amount, over, number, fluids):
    """Distribute the impulse of fluids on the floes over the cells, reversed, with the weights of the sampling.

    start, cell, amount, over : see `sampling.Weights`
    fluids : for each a tuple of impulse_x, impulse_y on the floes `number` [N s], (blocks, BLOCK);
        last_x, last_y, filled with the fluid's impulse in each cell [N s]; total_x, total_y, to which it is added;
        and lost (2,), to which any impulse without a cell is added.  Floes that entered since have no weights yet.
    """
    for q in range(len(fluids)):
        _, _, last_x, last_y, _, _, _ = fluids[q]
        for c in range(last_x.size):
            last_x[c] = last_y[c] = 0.0
    for k in range(number.size):
        floe, block, lane = np.uintp(number[k]), np.uintp(k // BLOCK), np.uintp(k % BLOCK)
        if floe >= over.size:
            continue
        first, last = np.uintp(start[floe]), np.uintp(start[floe + np.uintp(1)])
        for q in range(len(fluids)):
            impulse_x, impulse_y, last_x, last_y, _, _, lost = fluids[q]
            x, y = impulse_x[block, lane], impulse_y[block, lane]
            if first == last:
                lost[0] -= x
                lost[1] -= y
            x *= over[floe]
            y *= over[floe]
            for e in range(first, last):
                c = np.uintp(cell[e])  # unsigned: no wrap-around of negative indices
                last_x[c] -= amount[e] * x
                last_y[c] -= amount[e] * y
    for q in range(len(fluids)):
        _, _, last_x, last_y, total_x, total_y, _ = fluids[q]
        for c in range(last_x.size):
            total_x[c] += last_x[c]
            total_y[c] += last_y[c]


@in_place
def per_area(amount, over, cell_area, out):
    """Fill `out` with the amount in each cell, times `over`, per cell area."""
    for c in range(amount.size):
        out[c] = amount[c] * (over / cell_area[c])


@in_place
def sizes_of_drag(
    start, cell, amount, over, number, impulse_x, impulse_y, fluid_u, fluid_v, rate, u, v, mass, cell_area,
    magnitude, slope,
):  # fmt: skip
    """Fill magnitude and slope with Σ |impulse| [N s/m²] and Σ K |Δu| [kg m-2 s-1] per cell area.

    fluid_u, fluid_v, rate : velocity of the fluid [m/s] and K/m [1/m] at these floes, (blocks, BLOCK)
    u, v, mass : velocity [m/s] and m [kg] of each floe, by its number; the others as for `give_back`
    """
    for c in range(cell_area.size):
        magnitude[c] = slope[c] = 0.0
    for k in range(number.size):
        floe, block, lane = np.uintp(number[k]), np.uintp(k // BLOCK), np.uintp(k % BLOCK)
        if floe >= over.size:
            continue
        x, y = impulse_x[block, lane], impulse_y[block, lane]
        size = np.sqrt(x * x + y * y)
        du, dv = fluid_u[block, lane] - u[floe], fluid_v[block, lane] - v[floe]
        coefficient = np.sqrt(du * du + dv * dv) * rate[block, lane] * mass[floe]
        for e in range(np.uintp(start[floe]), np.uintp(start[floe + np.uintp(1)])):
            c, w = np.uintp(cell[e]), over[floe] * amount[e]
            magnitude[c] += w * size
            slope[c] += w * coefficient
    for c in range(cell_area.size):
        magnitude[c] /= cell_area[c]
        slope[c] /= cell_area[c]


STATE = (
    "area_fraction", "overlap_fraction", "porosity", "thickness", "mass_per_area", "ice_velocity_x",
    "ice_velocity_y", "floe_count", "mean_radius", "coordination_number",
)  # fmt: skip


@jit
def _cell_fields(start, cell, area, h, u, v, r, contacts, cell_area, density, fill, out):
    """Fill the fields of STATE, in that order; their arrays first hold sums over floes."""
    fraction, overlap, porosity, thickness, mass, along_x, along_y, count, radius, partners = out
    for c in range(cell_area.size):
        fraction[c] = thickness[c] = along_x[c] = along_y[c] = 0.0
        count[c] = radius[c] = partners[c] = 0.0
    for k in range(start.size - 1):
        number = 1.0 / (np.pi * r[k] * r[k])
        for e in range(start[k], start[k + 1]):
            c, volume, share = cell[e], area[e] * h[k], area[e] * number
            fraction[c] += area[e]
            thickness[c] += volume
            along_x[c] += volume * u[k]
            along_y[c] += volume * v[k]
            count[c] += share
            radius[c] += share * r[k]
            partners[c] += share * contacts[k]
    for c in range(cell_area.size):
        ice, volume = fraction[c], thickness[c]
        covered = ice / cell_area[c]
        fraction[c] = min(covered, 1.0)
        overlap[c] = covered - fraction[c]
        mass[c] = density * volume / cell_area[c]
        some = ice > 0.0
        porosity[c] = 1.0 - fraction[c] if some else fill
        thickness[c] = volume / ice if some else fill
        along_x[c] = along_x[c] / volume if some else fill
        along_y[c] = along_y[c] / volume if some else fill
        radius[c] = radius[c] / count[c] if some else fill
        partners[c] = partners[c] / count[c] if some else fill


def cell_fields(
    grid: Grid,
    coverage: Coverage,
    thickness: np.ndarray | float,
    u: np.ndarray | float,
    v: np.ndarray | float,
    radius: np.ndarray | float,
    density: float,
    coordination: np.ndarray | float = 0.0,
    fill: float = 0.0,
    out: Mapping[str, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Gridded fields of the floes, one value per cell.

    Parameters
    ----------
    coverage : of the same floes on this grid
    thickness, u, v, radius : (n,) floe thickness [m], velocity [m/s], radius [m]
    density : of ice [kg/m³]
    coordination : (n,) number of contacts of each floe [1]
    fill : value of means where there is no ice: 0 in memory, NaN in files
    out : arrays to write into, by name; new ones for the others

    Returns
    -------
    dict of (size,) arrays, by the names of `floebmi.variables`:
    area_fraction [1] at most 1; overlap_fraction [1] excess over 1; porosity [1] 1 − area_fraction
    where there is ice; thickness [m] mean over the ice; mass_per_area [kg/m²] of the cell;
    ice_velocity_x, ice_velocity_y [m/s] mean by mass;
    floe_count [1] sum of the area shares of floes, so that the sum over the grid is the number of
    floes in it; mean_radius [m] and coordination_number [1], means weighted by these shares.

    Raises
    ------
    InputError
        for arrays of the wrong size.
    """
    _check_grid(grid, coverage.size)
    n = coverage.start.size - 1
    per_floe = {
        "thickness": thickness, "u": u, "v": v, "radius": radius, "coordination": coordination
    }  # fmt: skip
    arrays = [_per_floe(name, values, n) for name, values in per_floe.items()]
    wanted = {} if out is None else out
    fields = {name: wanted[name] if name in wanted else np.empty(grid.size) for name in STATE}
    _cell_fields(
        coverage.start, coverage.cell, coverage.area, *arrays, grid.area, density, fill,
        tuple(fields.values()),
    )  # fmt: skip
    return fields


@jit
def _insert(cuts, begin, end, t):
    """Insert t into the sorted cuts[begin:end + 1]; the array doubles when it is full."""
    if end == cuts.size:
        longer = np.empty(2 * end + 64)
        for e in range(end):
            longer[e] = cuts[e]
        cuts = longer
    while end > begin and cuts[end - 1] > t:
        cuts[end] = cuts[end - 1]
        end -= 1
    cuts[end] = t
    return cuts


@jit
def _cut_branches(
    origin, scale, bin_start, bin_cell, low, box, raster, corner_x, corner_y,
    x, y, dx, dy, start, cuts,
):  # fmt: skip
    """Positions at which branches cross cell edges, sorted from 0 to 1: fills start, returns cuts."""
    m = start[0]
    for k in range(x.size):
        px, py = x[k], y[k]
        west, east = min(px, px + dx[k]), max(px, px + dx[k])
        south, north = min(py, py + dy[k]), max(py, py + dy[k])
        by0 = bin_of(south, origin[1], scale[1], raster[1])
        by1 = bin_of(north, origin[1], scale[1], raster[1])
        bx0 = bin_of(west, origin[0], scale[0], raster[0])
        bx1 = bin_of(east, origin[0], scale[0], raster[0])
        cuts = _insert(cuts, start[k], m, 0.0)
        cuts = _insert(cuts, start[k], m + 1, 1.0)
        m += 2
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                b = by * raster[0] + bx
                for e in range(bin_start[b], bin_start[b + 1]):
                    c = bin_cell[e]
                    # A cell reaches several bins; it counts in the first one visited.
                    if bx != max(bx0, low[c, 0]) or by != max(by0, low[c, 1]):
                        continue
                    if box[c, 0] > east or box[c, 1] < west:
                        continue
                    if box[c, 2] > north or box[c, 3] < south:
                        continue
                    last = corner_x.shape[1] - 1
                    for corner in range(corner_x.shape[1]):
                        t = cut(
                            px, py, dx[k], dy[k],
                            corner_x[c, last], corner_y[c, last],
                            corner_x[c, corner], corner_y[c, corner],
                        )  # fmt: skip
                        if t > 0.0:
                            cuts = _insert(cuts, start[k], m, t)
                            m += 1
                        last = corner
        start[k + 1] = m
    return cuts


def branch_shares(
    grid: Grid, x: np.ndarray, y: np.ndarray, dx: np.ndarray, dy: np.ndarray, period: Period
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of the length of each branch in the cells that it crosses: branch, cell, share.

    A piece between two cuts belongs to the cell that contains its midpoint, so a piece along an edge
    counts once, and all pieces add up to the branch; pieces outside the grid are left out.
    """
    half_x, half_y = 0.5 * dx, 0.5 * dy
    branch, image_x, image_y = images(
        grid, x + half_x, y + half_y, np.abs(half_x), np.abs(half_y), period
    )
    dx, dy = dx[branch], dy[branch]
    image_x, image_y = image_x - 0.5 * dx, image_y - 0.5 * dy
    start = np.zeros(branch.size + 1, np.int64)
    cuts = _cut_branches(
        *grid.bins, grid.corner_x, grid.corner_y, image_x, image_y, dx, dy,
        start, np.empty(8 * branch.size),
    )  # fmt: skip
    begin, end = cuts[: start[-1] - 1], cuts[1 : start[-1]]
    piece = np.flatnonzero(end > begin)  # each branch restarts its cuts at 0
    image = np.searchsorted(start, piece, side="right") - 1
    middle = 0.5 * (begin[piece] + end[piece])
    cell = grid.locate(image_x[image] + middle * dx[image], image_y[image] + middle * dy[image])
    share = end[piece] - begin[piece]
    inside = cell >= 0
    return branch[image[inside]], cell[inside], share[inside]


def internal_stress(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    dx: np.ndarray,
    dy: np.ndarray,
    fx: np.ndarray,
    fy: np.ndarray,
    period: Period = (None, None),
) -> InternalStress:
    """Stress of contact forces, distributed along the branches over the cells that they cross.

    Parameters
    ----------
    x, y : (contacts,) start of the branches: the *centre of floe i* [m]
    dx, dy : (contacts,) branch: centre of j − centre of i [m]; at a wall, contact point − centre
    fx, fy : (contacts,) contact force on floe i [N]; it points away from j in compression
    period : lengths (Lx, Ly) of a periodic domain [m], None where not periodic

    Returns
    -------
    InternalStress : Σ_c σ A + outside = Σ f ⊗ d (symmetric part), exactly (eq. internal-stress)

    Raises
    ------
    InputError
        for arrays of different sizes, values that are not finite, a period shorter than the grid.
    """
    names = ("x", "y", "dx", "dy", "fx", "fy")
    arrays = [np.ascontiguousarray(a, np.float64) for a in (x, y, dx, dy, fx, fy)]
    for name, values in zip(names, arrays, strict=True):
        if values.shape != arrays[0].shape or values.ndim != 1:
            raise InputError(f"{name} has shape {values.shape}: must be {arrays[0].shape}, as x")
        for k in np.flatnonzero(~np.isfinite(values)):
            raise InputError(f"contact {k}: {name} = {values[k]}: must be finite")
    x, y, dx, dy, fx, fy = arrays
    contact, cell, share = branch_shares(grid, x, y, dx, dy, period)
    outside_share = 1.0 - np.bincount(contact, weights=share, minlength=x.size)
    stress, outside = [], []
    for virial in (fx * dx, 0.5 * (fx * dy + fy * dx), fy * dy):
        spread = np.bincount(cell, weights=share * virial[contact], minlength=grid.size)
        stress.append(spread / grid.area)
        outside.append(float((outside_share * virial).sum()))
    return InternalStress(*stress, np.array(outside))


def divergence(
    grid: Grid, weights: Weights, force_x: np.ndarray, force_y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Divergence of the internal stress: force on the ice per cell area (eq. stress-divergence).

    Some hosts need it instead of the ice-ocean stress; it must never be added to that.

    Parameters
    ----------
    weights : of the floes on this grid, as for all other forces
    force_x, force_y : (n,) net contact force on each floe, walls included [N]

    Returns
    -------
    (size,), (size,) [N/m²], positive accelerates the ice along +x, +y; Σ_c A div = Σ force over the
    floes whose row of weights is not empty

    Raises
    ------
    InputError
        for arrays of the wrong size.
    """
    _check_grid(grid, weights.size)
    force = np.zeros((grid.size, 2))
    scatter(weights, np.stack([force_x, force_y], axis=1), force)
    return force[:, 0] / grid.area, force[:, 1] / grid.area


def pressure(xx: np.ndarray, yy: np.ndarray) -> np.ndarray:
    """Internal pressure −(σ_xx + σ_yy)/2 [N/m], positive in compression."""
    return -0.5 * (xx + yy)


def maximum_shear(xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> np.ndarray:
    """Largest shear stress over all directions, √(((σ_xx − σ_yy)/2)² + σ_xy²) [N/m]."""
    half = 0.5 * (xx - yy)
    return np.sqrt(half * half + xy * xy)


def _per_floe(name: str, values: np.ndarray | float, n: int) -> np.ndarray:
    array = np.asarray(values, np.float64)
    if array.ndim and array.shape != (n,):
        raise InputError(f"{name} has shape {array.shape}: must be ({n},), one per floe")
    # no view that must not be written to, for which the kernel would be compiled anew
    return np.ascontiguousarray(array) if array.ndim else np.full(n, array)


def _check_grid(grid: Grid, size: int) -> None:
    if size != grid.size:
        raise InputError(f"grid has {grid.size} cells, the shares of the floes are for {size}")
