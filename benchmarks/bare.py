"""What physics that a scene does not list costs: `python -m benchmarks.bare [--floes 10000]`.

A kernel written by hand has the cohesive law and nothing else: springs, bonds, the impulses at the end of steps in which
contacts open or close, and the energy lost with broken bonds.  No rotation, friction, dashpot, failure, healing, beam,
walls, coast, held floes or fluids.  Package and hand-written kernel take turns on the same pack and neighbour list.  They
must end with the same positions; the ratio of their times is what the package's other physics costs where it is absent.
"""

import argparse
import math
import time

import numpy as np

import floebmi as fb
from benchmarks.limit import SLOW, pack
from benchmarks.options import run, whole
from floebmi.advance import Advance
from floebmi.columns import DU, DV, DX, DY, FX, FY, H_I, H_J, LANES, R_I, R_J, gather, scatter
from floebmi.dynamics import verlet
from floebmi.kernels import BLOCK, in_place
from floebmi.pairs import BONDS

BLOW_N = 4 * BLOCK  # row of the buffer


@in_place
def shorten(side, floes, reach, margin, i, j, begin, end, near_i, near_j, slot, first):
    """List the pairs of a tile that may touch in the next steps; returns how many."""
    n = 0
    for p in range(begin, end):
        a, b = i[np.uintp(p)], j[np.uintp(p)]
        one, other = floes[a], floes[b]
        dx, dy = other.x - one.x, other.y - one.y
        dx, dy = dx - side * np.rint(dx / side), dy - side * np.rint(dy / side)
        far = (one.r + other.r) * reach + margin
        q = np.uintp(first + n)
        slot[q], near_i[q], near_j[q] = p, a, b
        n += not dx * dx + dy * dy >= far * far
    last = first + max(n - 1, 0)
    for q in range(first + n, first + n + LANES):
        near_i[q], near_j[q] = near_i[last], near_j[last]
    return n


@in_place
def glide(floes, force, begin, end, kicked, dt):
    """Kick and drift; returns the largest speed²."""
    fastest = 0.0
    for k in range(begin, end):
        floe, f = floes[np.uintp(k)], force[np.uintp(k)]
        floe.u += kicked * floe.w * f.x
        floe.v += kicked * floe.w * f.y
        f.x = f.y = 0.0
        floe.x += dt * floe.u
        floe.y += dt * floe.v
        fastest = max(fastest, floe.u * floe.u + floe.v * floe.v)
    return fastest


@in_place
def bonds_and_springs(
    side, youngs_modulus, tensile_strength, floes, force, near_i, near_j, near_bonded, begin, end, dt,
    lost, blows, buffer,
):  # fmt: skip
    """Add the forces of the near pairs of a tile; returns how many blows they note."""
    noted, loss = 0, 0.0
    for first in range(begin, end, BLOCK):
        n, struck = min(BLOCK, end - first), 0.0
        for k in range(0, n, LANES):
            gather(floes, near_i, near_j, first, buffer, k)
        for k in range(n):
            dx, dy = buffer[DX + k], buffer[DY + k]
            dx, dy = dx - side * np.rint(dx / side), dy - side * np.rint(dy / side)
            r_i, r_j = buffer[R_I + k], buffer[R_J + k]
            distance = np.sqrt(dx * dx + dy * dy)
            over = 1.0 / distance
            nx, ny = dx * over, dy * over
            gap = distance - (r_i + r_j)
            opening = buffer[DU + k] * nx + buffer[DV + k] * ny
            k_n = youngs_modulus * min(buffer[H_I + k], buffer[H_J + k])
            mean_radius = 2.0 * r_i * r_j / (r_i + r_j)
            bonded = near_bonded[np.uintp(first + k)]
            holds = youngs_modulus * gap < tensile_strength * mean_radius
            touching = gap < 0.0 or (bonded > 0.0 and holds)
            near_bonded[np.uintp(first + k)] = 1.0 if touching else 0.0
            f = -k_n * gap if touching else 0.0
            breaks, gap_before = bonded > 0.0 and not touching, gap - opening * dt
            since = gap / opening if opening != 0.0 else 0.0
            meeting = min(since, dt) if opening < 0.0 else dt
            parting = max(dt - since, 0.0) if opening > 0.0 else 0.0
            part = meeting if gap < 0.0 else parting
            part = dt if bonded > 0.0 and not (breaks and gap_before < 0.0) else part
            before = -k_n * gap_before
            before = before if bonded > 0.0 else max(before, 0.0)
            blow = -0.5 * (dt - part) * (f if touching else before)
            loss += 0.5 * k_n * max(gap_before, 0.0) * gap if breaks else 0.0
            buffer[FX + k], buffer[FY + k], buffer[BLOW_N + k] = -f * nx, -f * ny, blow
            struck += abs(blow)
        for k in range(n, n + (-n) % LANES):
            buffer[FX + k] = buffer[FY + k] = 0.0
        for k in range(0, n, LANES):
            scatter(force, near_i, near_j, first, buffer, k)
        if struck > 0.0:
            for k in range(n):
                if buffer[BLOW_N + k] != 0.0:
                    note(side, near_i[first + k], near_j[first + k], k, blows[noted], buffer)
                    noted += 1
    lost[0] += loss
    return noted


@in_place
def note(side, i, j, k, one, buffer):
    dx, dy = buffer[DX + k], buffer[DY + k]
    dx, dy = dx - side * np.rint(dx / side), dy - side * np.rint(dy / side)
    distance = np.sqrt(dx * dx + dy * dy)
    one.i, one.j, one.nx, one.ny = i, j, dx / distance, dy / distance
    one.opening = buffer[DU + k] * one.nx + buffer[DV + k] * one.ny
    one.normal = buffer[BLOW_N + k]


@in_place
def strike(floes, force, blows, noted, dt, lost):
    """Apply the blows of a tile, which do the work that the step left out, as the package does."""
    for q in range(noted):
        one = blows[q]
        a, b, f, g = floes[one.i], floes[one.j], force[one.i], force[one.j]
        du = b.u - a.u + 0.5 * dt * (b.w * g.x - a.w * f.x)
        dv = b.v - a.v + 0.5 * dt * (b.w * g.y - a.w * f.y)
        ahead, w = du * one.nx + dv * one.ny, a.w + b.w
        left = ahead * ahead + 2.0 * w * one.normal * one.opening
        size = (math.copysign(np.sqrt(max(left, 0.0)), one.opening) - ahead) / w
        lost[0] -= max(-left, 0.0) / (2.0 * w)
        a.u -= a.w * size * one.nx
        a.v -= a.w * size * one.ny
        b.u += b.w * size * one.nx
        b.v += b.w * size * one.ny


@in_place
def steps_by_hand(
    side, youngs_modulus, tensile_strength, floes, force, i, j, bonded, near_i, near_j, near_bonded,
    slot, counts, bounds, parts, blows, reach, skin, dt, steps, lost, buffer,
):  # fmt: skip
    """`dynamics.verlet` for cohesive floes alone in a periodic square."""
    tiles, way, since, kicked = parts.size - 1, 0.0, np.inf, 0.5 * dt
    for _ in range(steps):
        anew = since + 2.0 * way > 0.5 * skin
        fastest = 0.0
        if anew:
            for tile in range(tiles):
                first = parts[tile] + LANES * tile
                for q in range(first, first + counts[tile]):
                    bonded[slot[q]] = near_bonded[q]
            for tile in range(bounds.size - 1):
                fastest = max(
                    fastest, glide(floes, force, bounds[tile], bounds[tile + 1], kicked, dt)
                )
            for tile in range(tiles):
                first = parts[tile] + LANES * tile
                counts[tile] = shorten(
                    side, floes, reach, skin + 2.0 * way, i, j, parts[tile], parts[tile + 1],
                    near_i, near_j, slot, first,
                )  # fmt: skip
                for q in range(first, first + counts[tile]):
                    near_bonded[q] = bonded[slot[q]]
        noted = 0
        for tile in range(tiles + 1):
            if tile < bounds.size - 1 and not anew:
                fastest = max(
                    fastest, glide(floes, force, bounds[tile], bounds[tile + 1], kicked, dt)
                )
            before, noted = noted, 0
            if tile < tiles:
                first = parts[tile] + LANES * tile
                noted = bonds_and_springs(
                    side, youngs_modulus, tensile_strength, floes, force, near_i, near_j, near_bonded,
                    first, first + counts[tile], dt, lost, blows[tile % 2], buffer,
                )  # fmt: skip
            if tile > 0:
                strike(floes, force, blows[(tile - 1) % 2], before, dt, lost)
        way = dt * np.sqrt(fastest)
        since, kicked = (0.0 if anew else since + way), dt
    for k in range(floes.size):
        floes[k].u += 0.5 * dt * floes[k].w * force[k].x
        floes[k].v += 0.5 * dt * floes[k].w * force[k].y


class Pack:
    """A cohesive pack on one neighbour list, to be stepped from the same state again and again."""

    def __init__(self, model: fb.Model) -> None:
        self.now: Advance = model._now()
        self.dt = model.step.length
        self.floes, self.force = self.now.packed.floes, self.now.packed.force
        self.changed = self.floes, self.force, self.now.lists.near.list_block
        self.start = [array.copy() for array in self.changed]

    def again(self) -> None:
        """Back to the start, the short list empty."""
        for array, start in zip(self.changed, self.start, strict=True):
            array[:] = start
        self.now.lists.near.counts[:] = 0

    def package(self, steps: int) -> float:
        """Take steps as `Model.advance` does; returns the energy lost with broken bonds [J]."""
        now, tally = self.now, self.now._tally()
        none = np.zeros(1, np.int64)
        verlet(
            now._laws(), (), (), now.packed, now.lists, now.walls, tally, 0.5 * self.dt, np.inf,
            self.dt, steps, none, now.marked, 0.0, np.inf, 1, now.lag, now.buffers,
        )  # fmt: skip
        return float(tally.lost[:, BONDS].sum())

    def hand(self, steps: int, strength: float = 1.0) -> float:
        """The same with the kernel written by hand; strength : of its bonds, over that of the package's."""
        now, lost = self.now, np.zeros(1)
        law, lists, near = now.contact, now.lists, now.lists.near
        steps_by_hand(
            now.period[0], law.elastic.youngs_modulus, strength * law.bonds.tensile_strength,
            self.floes, self.force, near.list_i, near.list_j, near.list_block[0], near.i, near.j,
            near.block[0], near.slot, near.counts, now.lists.tiles.bounds, near.parts, lists.blows,
            1.0 + lists.gap, lists.skin, self.dt, steps, lost, now.buffers[0],
        )  # fmt: skip
        return float(lost[0])


def ready(floes: int, speed: float) -> Pack:
    """A dense pack that has come into contact."""
    model = pack("cohesive", floes, speed)
    model.advance(200 * model.step.length)
    return Pack(model)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=whole, default=10_000)
    parser.add_argument("--steps", type=whole, default=300, help="of a repeat")
    parser.add_argument("--repeats", type=whole, default=15)
    options = parser.parse_args()
    stepped = ready(options.floes, SLOW)
    places, spent = {}, {"package": [], "hand": []}
    for _ in range(options.repeats + 1):  # the first compiles
        for name, took in spent.items():
            stepped.again()
            begin = time.perf_counter()
            getattr(stepped, name)(options.steps)
            took.append(time.perf_counter() - begin)
            places[name] = stepped.floes.copy()
    apart = max(np.abs(places["package"][c] - places["hand"][c]).max() for c in ("x", "y"))
    package, hand = (np.array(took[1:]) for took in spent.values())
    each, ratio = 1e9 / options.steps / len(places["hand"]), package / hand
    print(
        f"{len(places['hand'])} floes, {options.steps} steps in turn: {each * np.median(package):.1f} ns a floe-step, "
        f"by hand {each * np.median(hand):.1f}; ratio {np.median(ratio):.3f} "
        f"({ratio.min():.3f} … {ratio.max():.3f}); places at the end differ by {apart:.1g} m"
    )


if __name__ == "__main__":
    run(main)
