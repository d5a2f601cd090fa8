"""The most that dials which floebmi does not have could gain: `python -m benchmarks.dials`.

Four dials are measured on three scenes: a step of its own for each floe (multirate), holding floes that are at rest
(sleeping), long steps while no contact is possible, and single precision in contacts.  The gains are upper bounds: they
count the arithmetic saved as if managing it cost nothing.  For comparison stands a dial that floebmi has, and which leaves
little for long steps to gain: drag that acts only every few steps.
"""

import argparse
import time
from typing import NamedTuple

import numba
import numpy as np

import floebmi as fb
from floebmi.floes import FIXED
from floebmi.neighbours import find_pairs
from floebmi.pairs import wrap

WINDOW = 50  # steps after which floes are looked at
STILL = 1e-4, 1e-6  # of its radius that a floe at rest moves in a window, at most
AHEAD = 10  # steps of a contact-free floe that one long step could stand for
SELDOM = 16  # steps after which drag acts


def dilute() -> fb.Model:
    """2000 floes at a concentration of 0.4 that drift past each other, ten minutes after the start."""
    model = _scattered(0.4, ("periodic",) * 4, fb.PowerLaw(10.0, 20.0, -1.8), 2000, 0.3)
    model.advance(600.0)
    return model


def jammed() -> fb.Model:
    """2000 floes that the wind has blown against a closed edge, an hour later."""
    edges = "closed", "closed", "periodic", "periodic"
    model = _scattered(0.7, edges, fb.PowerLaw(10.0, 20.0, -1.8), 2000, 0.0)
    model.atmosphere.u[:] = 10.0
    model.advance(3600.0)
    return model


def wide() -> fb.Model:
    """4000 floes of 20 m to 2 km at a concentration of 0.75, five minutes after the start."""
    model = _scattered(0.75, ("periodic",) * 4, fb.PowerLaw(20.0, 2000.0, -1.8), 4000, 0.3)
    model.advance(300.0)
    return model


def _scattered(
    concentration: float, edges: tuple[str, ...], sizes: fb.PowerLaw, n: int, speed: float
) -> fb.Model:
    side = float(np.sqrt(n * sizes.mean_area() / concentration))
    domain = fb.Domain((0.0, side), (0.0, side), *edges)
    floes = fb.scatter(domain, sizes, concentration=concentration, seed=1)
    floes.u[:], floes.v[:] = np.random.default_rng(0).normal(0.0, speed, (2, len(floes)))
    drag = fb.OceanDrag(1000.0, 0.0, 5.5e-3), fb.AirDrag(1.3, 0.0, 1.2e-3)
    return fb.Model(domain, floes, fb.frictional(), drag)


class Pairs(NamedTuple):
    """Near pairs: their branch vector [m], gap [m] and its rate [m/s]."""

    i: np.ndarray
    j: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    gap: np.ndarray
    rate: np.ndarray


def near(model: fb.Model, reach: float) -> Pairs:
    """Pairs whose gap is less than twice `reach` [m]."""
    f, period = model.floes, model.domain.period
    _, i, j, _ = find_pairs(f.x, f.y, f.radius + reach, period)
    dx, dy = wrap(period[0], f.x[j] - f.x[i]), wrap(period[1], f.y[j] - f.y[i])
    distance = np.hypot(dx, dy)
    rate = ((f.u[j] - f.u[i]) * dx + (f.v[j] - f.v[i]) * dy) / distance
    return Pairs(i, j, dx, dy, distance - f.radius[i] - f.radius[j], rate)


def multirate(model: fb.Model) -> tuple[float, float]:
    """Floe-steps with one step for all, over those with a step of 2^k times it for each floe; the same for pairs evaluated."""
    f, law = model.floes, model.contact
    mass, modulus = f.mass(model.ice_density), law.elastic.youngs_modulus
    pairs = near(model, 0.5 * 0.3 * f.radius.min())
    k = modulus * np.minimum(f.thickness[pairs.i], f.thickness[pairs.j])
    total = np.zeros(len(f))
    for one, other in ((pairs.i, pairs.j), (pairs.j, pairs.i)):
        # eq. stable-step, its eigenvalue by the trace of the normal part and the rotation of a sticking pair
        share = (1.0 + np.sqrt(mass[one] / mass[other])) * k / mass[one]
        np.add.at(total, one, 2.0 * share)
    omega2 = np.maximum(total, 6.0 * modulus * f.thickness / mass)
    level = np.floor(0.5 * np.log2(omega2.max() / omega2))
    slower = np.minimum(level[pairs.i], level[pairs.j])
    each = len(pairs.i) / (0.5**slower).sum() if len(pairs.i) else np.inf
    return len(f) / (0.5**level).sum(), each


class Rest(NamedTuple):
    """Share of floe-steps at rest, and the error of the displacements if these floes are held."""

    share: float
    error: float


def sleeping(model: fb.Model, still: float, windows: int = 20) -> Rest:
    """Hold floes for the next window that moved less than `still` of their radius and kept their contacts."""
    state, held_back = model.state(), model.floes.motion.copy()
    step = WINDOW * model.longest_step()
    ways, share = [], 0.0
    for hold in (False, True):
        model.restore(state)
        model.floes.motion[:] = held_back
        floes = model.floes
        start = floes.x.copy(), floes.y.copy()
        before, touched = start, _partners(model)
        for _ in range(windows):
            model.advance(step)
            floes.motion[:] = held_back
            moved = np.hypot(
                *(_shift(model, a, b) for a, b in zip(before, (floes.x, floes.y), strict=True))
            )
            now = _partners(model)
            rests = (moved < still * floes.radius) & (now == touched)
            before, touched = (floes.x.copy(), floes.y.copy()), now
            if hold:
                floes.motion[rests] |= FIXED
                floes.u[rests] = floes.v[rests] = floes.angular_velocity[rests] = 0.0
            else:
                share += rests.mean() / windows
        ends = zip(start, (floes.x, floes.y), strict=True)
        ways.append([_shift(model, old, new) for old, new in ends])
        floes.motion[:] = held_back
    model.restore(state)
    free, held = np.array(ways)
    return Rest(share, float(np.linalg.norm(held - free) / np.linalg.norm(free)))


def _shift(model: fb.Model, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Displacement of each floe along an axis; none of these scenes moves a floe by half its domain."""
    side = model.domain.x[1] - model.domain.x[0]
    return (new - old + 0.5 * side) % side - 0.5 * side


def _partners(model: fb.Model) -> np.ndarray:
    """A number for each floe that changes with the set of those it touches."""
    contacts, found = model.contacts(), np.zeros(len(model.floes))
    np.add.at(found, contacts.i, np.sqrt(2.0 + contacts.j))
    np.add.at(found, contacts.j, np.sqrt(2.0 + contacts.i))
    return np.round(found, 6)


class Free(NamedTuple):
    """Without contact for AHEAD steps: mean share of the floes, and share of the time in which that holds for all."""

    floes: float
    time: float


def without_contact(model: fb.Model, windows: int = 20) -> Free:
    """Predict contacts from the gaps and the rates at which they close; afterwards the state is as before."""
    state, dt, floes, all_free = model.state(), model.longest_step(), 0.0, 0
    for _ in range(windows):
        f = model.floes
        fastest = float(np.hypot(f.u, f.v).max())
        pairs = near(model, AHEAD * dt * fastest)
        soon = pairs.gap < -pairs.rate * AHEAD * dt
        busy = np.zeros(len(f), bool)
        busy[pairs.i[soon]] = busy[pairs.j[soon]] = True
        floes += 1.0 - busy.mean()
        all_free += not busy.any()
        model.advance(WINDOW * dt)
    model.restore(state)
    return Free(floes / windows, all_free / windows)


class Seldom(NamedTuple):
    """How many times as fast steps are with drag every SELDOM of them, and the error of the displacements after 1000."""

    gain: float
    error: float


def seldom(model: fb.Model, windows: int = 4) -> Seldom:
    """Two runs in turn, window by window, from the same floes."""
    runs = []
    for every in (1, SELDOM):
        step = model.step._replace(drag_every=every)
        run = fb.Model(model.domain, model.floes.copy(), model.contact, model.forces, step=step)
        run.atmosphere.u[:] = model.atmosphere.u
        run.advance(WINDOW * model.longest_step())  # compiles
        runs.append(run)
    before, best = [(run.floes.x.copy(), run.floes.y.copy()) for run in runs], [np.inf, np.inf]
    for _ in range(windows):
        for k, run in enumerate(runs):
            begin, steps = time.perf_counter(), run.counters.steps
            run.advance(5 * WINDOW * model.longest_step())
            took = (time.perf_counter() - begin) / (run.counters.steps - steps)
            best[k] = min(best[k], took)
    each, rare = (
        np.array([_shift(model, x, run.floes.x), _shift(model, y, run.floes.y)])
        for (x, y), run in zip(before, runs, strict=True)
    )
    return Seldom(best[0] / best[1], float(np.linalg.norm(rare - each) / np.linalg.norm(each)))


def single(model: fb.Model) -> tuple[float, float]:
    """Error of contact forces from relative positions in single precision; how many times as fast they are."""
    pairs, f = near(model, 0.5 * 0.3 * model.floes.radius.min()), model.floes
    arguments, forces, best = [], [], [np.inf, np.inf]
    for kind in (np.float64, np.float32):
        floes = np.stack([f.radius, f.thickness], axis=1).astype(kind)
        branch = np.stack([pairs.dx, pairs.dy], axis=1).astype(kind)  # as from places within cells
        buffer, force = np.empty((6, 64), kind), np.zeros((len(f), 2), kind)
        arguments.append((floes, branch, pairs.i, pairs.j, kind(0.0), buffer, force))
        forces.append(_push(*arguments[-1]).astype(float))
    for _ in range(200):
        for k in (0, 1):
            begin = time.perf_counter()
            _push(*arguments[k])
            best[k] = min(best[k], time.perf_counter() - begin)
    exact, rounded = forces
    size = np.sqrt((exact**2).sum())
    error = np.sqrt(((exact - rounded) ** 2).sum()) / size if size else np.nan
    return float(error), best[0] / best[1]


@numba.njit(fastmath={"contract", "reassoc", "arcp", "nsz"}, error_model="numpy")
def _push(floes, branch, i, j, nothing, buffer, force):
    """Elastic forces for E = 1 Pa, in blocks as in the pair kernel."""
    force[:] = nothing
    for first in range(0, i.size, 64):
        n = min(64, i.size - first)
        for k in range(n):
            one, other = floes[i[first + k]], floes[j[first + k]]
            buffer[0, k], buffer[1, k] = branch[first + k]
            buffer[2, k] = one[0] + other[0]
            buffer[3, k] = min(one[1], other[1])
        for k in range(n):
            dx, dy = buffer[0, k], buffer[1, k]
            distance = np.sqrt(dx * dx + dy * dy)
            size = buffer[3, k] * max(buffer[2, k] - distance, nothing) / distance
            buffer[4, k], buffer[5, k] = size * dx, size * dy
        for k in range(n):
            one, other = i[first + k], j[first + k]
            force[one, 0] -= buffer[4, k]
            force[one, 1] -= buffer[5, k]
            force[other, 0] += buffer[4, k]
            force[other, 1] += buffer[5, k]
    return force


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    columns = (
        "scene", "floes", "contacts", "multirate: floes", "pairs",
        *(name for still in STILL for name in (f"at rest, {still:g} r", "gain", "error of ways")),
        "free floes", "gain", "free time", "gain", "drag seldom: gain", "error of ways", "single: error of force", "gain",
    )  # fmt: skip
    print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
    for build in (dilute, jammed, wide):
        model = build()
        floes, pairs = multirate(model)
        rests, free = [sleeping(model, still) for still in STILL], without_contact(model)
        error, faster = single(model)
        rare = seldom(model)

        def gain(share: float, left: float = 0.0) -> str:
            return f"{1.0 / max(1.0 - share * (1.0 - left), 1e-9):.2f}"

        cells = (
            build.__name__, f"{len(model.floes)}", f"{len(model.contacts().i)}", f"{floes:.2f}", f"{pairs:.2f}",
            *(c for r in rests for c in (f"{r.share:.2f}", gain(r.share), f"{r.error:.1g}")),
            f"{free.floes:.2f}", gain(free.floes, 1.0 / AHEAD), f"{free.time:.2f}",
            gain(free.time, 1.0 / AHEAD), f"{rare.gain:.2f}", f"{rare.error:.1g}", f"{error:.1g}", f"{faster:.2f}",
        )  # fmt: skip
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
