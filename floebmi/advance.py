"""One exchange interval: pack the floes, list neighbours, take steps; renew the list as often as needed.

    look       pack the floes, with the list that the last exchange kept or a new one, and compute the contact forces
    run        let floes in and out; then take steps, and renew what expires when floes have moved too far
               (`_renew`: the limit on the step, the list, floes that enter and leave), until the time is reached
    finish     copy back floes and state, keep the list, book the gains and losses by walls, held floes, friction …

The result is a function of the state alone: floes, memory of contacts, walls, and where the list of
neighbours was made (kept.py).  So a run that is restarted at an exchange continues with the same bits.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from floebmi.boundaries import Domain, edge_of, leaving
from floebmi.columns import PAIR_BUFFER
from floebmi.contact import Contact, own, prepare
from floebmi.dynamics import (
    NEARLY,
    Laws,
    Marked,
    Step,
    Tally,
    Walls,
    strayed,
    touch_all,
    verlet,
)
from floebmi.errors import StabilityError
from floebmi.floes import Floes
from floebmi.forces import (
    FORCE_BUFFER,
    Force,
    add_fastest_rate,
    in_order,
    speed_bound,
)
from floebmi.kept import Kept, Marks
from floebmi.kernels import BLOCK
from floebmi.listing import Memory, list_neighbours
from floebmi.making import work_clock
from floebmi.pack import Packed, in_space, pack, pack_again, places, unpack
from floebmi.pairs import any_period, emptied
from floebmi.stable_step import Stiffest, paper_step, stable_step, stiffest
from floebmi.state import State
from floebmi.survey import Contacts, Survey, deepest, pressed, stock_of_each, survey, touching_pairs
from floebmi.taylor import taylor
from floebmi.threads import verlet_in_threads

DRAG_RESOLUTION = 1.0  # largest |J| Δt of the other forces in one sub-step
MOST_STEPS = 1e12  # in one exchange: they would take hours for a single floe


class Advance:
    """The packed floes with their list of neighbours: for diagnostics, or to run one exchange interval.

    `look` comes first.  `run` starts from its result, so diagnostics before a run cost nothing extra.

    The list holds all pairs that may touch before two floes have approached each other by its skin; the step follows
    from the pairs that may touch before two floes have approached by its closing (see listing.py).

    Attributes
    ----------
    packed : the floes in a kernel's order; order : their numbers in the tables of the forces
    pairs, listed : the list of pairs, and where and how widely it was made
    lists, walls : its tiles and short lists, and the floes near walls
    room, travelled : displacement at which the list becomes stale, and displacement so far [m]
    tested : pairs tested to make the list; None for a kept list, which was counted before
    near : whether the short lists are of the present positions
    before : `survey.Survey` of the floes now, at the start of the next steps
    at : table of each force, during a run
    held, lost, liveliest : sums of `dynamics.Tally` so far, and the highest kinetic energy [J]
    lag : of the other forces behind the floes, see `dynamics.time_to_push`
    """

    def __init__(
        self,
        floes: Floes,
        state: State,
        domain: Domain,
        contact: Contact | None,
        forces: tuple[Force, ...],
        step: Step,
        density: float,
        threads: int,
    ) -> None:
        self.threads = threads
        self.floes, self.state, self.domain, self.step = floes, state, domain, step
        self.contact = None if contact is None else prepare(contact)
        self.wall_law = None
        if len(state.walls) and contact is not None:
            self.wall_law = self.contact._replace(friction=None, bonds=None, failure=None)
        self.forces = forces
        self.density = density
        self.period = domain.period
        # only a pack without walls and edges may drift as a whole without a new list
        self.still = bool(len(state.walls)) or None in self.period
        self.held, self.lost, self.liveliest = np.zeros(3), np.zeros(5), 0.0
        self.lag = np.zeros(2)
        self.buffers = np.empty(PAIR_BUFFER), np.empty(FORCE_BUFFER)

    # ---- packing and the list ----------------------------------------------------------------------

    def look(self, kept: Kept | None) -> None:
        """Pack the floes, with a kept list or a new one, and compute the initial forces."""
        if kept is None:
            self._list_anew(self.state.memory)
        else:
            self._go_on(kept)
        self._touch()

    def _list_anew(self, old: Memory) -> None:
        """Pack the floes, and list their neighbours at the present positions; old : memory of the pairs so far."""
        begin = work_clock()
        self.packed = self._pack(*in_space(self.floes, self.domain.origin, self.state.remainder))
        self._list(self.state.walls.position.copy(), old)
        self.state.seconds.lists += work_clock() - begin
        self.room = self._half_skin()
        self._stiffest: Stiffest | None = None
        self.before: Survey | None = None
        self._mark(self.packed.first_x, self.packed.first_y)

    def _go_on(self, kept: Kept) -> None:
        """Pack the floes in the order of a kept list that is valid for them."""
        pairs, number = self.state.memory
        here = places(self.floes, number, self.domain.origin, self.state.remainder)
        if kept.packed is None:
            self.packed = self._pack(number, *here)
        else:
            self.packed = pack_again(kept.packed, self.floes, *here, self.state.previous)
        self.listed, self.pairs = kept.listed, pairs.copy()
        self.lists = kept.lists._replace(near=emptied(kept.lists.near, self.pairs))
        self._meet_walls()
        self.tested = None
        self.room, self._stiffest, self.before = kept.room, kept.stiffest, kept.survey
        self._mark(self.packed.first_x, self.packed.first_y, kept.travelled)
        if self._stiffest is None:  # it will be computed for the present positions
            self._mark_anew()

    def list_again(self, marks: Marks) -> None:
        """Rebuild the list of a restart file, if it has one, and keep it for the floes as they are now."""
        if not len(marks.way):
            return
        number, x, y, walls, (room, travelled), stiffest = marks
        self.packed = self._pack(number, x, y)
        self._list(walls, self.state.memory)
        self.room, self.travelled, self._stiffest = float(room), float(travelled), None
        self.before = None
        if len(stiffest):
            omega2, floe, damping = stiffest
            self._stiffest = Stiffest(float(omega2), int(floe), float(damping))
        self._keep()

    def _pack(self, number: np.ndarray, x: np.ndarray, y: np.ndarray) -> Packed:
        state = self.state
        return pack(self.floes, number, x, y, self.density, state.previous, self.domain.origin)

    def _list(self, positions: np.ndarray, old: Memory) -> None:
        """List the neighbours of the floes at their packed positions, with the walls at the given ones [m]."""
        self.tested: int | None
        self.listed, self.pairs, self.lists, self.tested = list_neighbours(
            self.packed, self.contact, self.period, self.state.walls, positions, old, len(self.floes)
        )  # fmt: skip
        self._meet_walls()

    def memory(self) -> Memory:
        """The memory of the pairs now."""
        return Memory(self.pairs, self.packed.number)

    def _keep(self) -> None:
        """Keep the list and its memory for the next exchange; these arrays must not be changed afterwards."""
        self.state.memory = self.memory()
        self.state.kept = Kept(
            self.listed, self.lists, self.room, self.travelled, self._stiffest, self.floes.copy(),
            self.packed, self.before,
        )  # fmt: skip

    @property
    def stiffest(self) -> Stiffest:
        """The limit on the step until floes have moved further; computed on demand."""
        if self._stiffest is None:
            begin = work_clock()
            walls = self.walls._replace(records=self.state.walls)
            self._stiffest = stiffest(
                self.contact, self.packed, self.pairs, self.period, walls, self.listed.closing
            )
            self.state.seconds.lists += work_clock() - begin
        return self._stiffest

    def _begin(self) -> None:
        """Prepare what steps need besides the list."""
        if self.before is None:
            self.before = Survey(*survey(self._of_any_scheme))
        self.liveliest = max(self.liveliest, self.before.energy)
        self.rate = self._rate_of_forces()
        if self.tested is not None:
            counters = self.state.counters
            counters.rebuilds += 1
            counters.tested += self.tested
            counters.listed += len(self.pairs.i)

    def _rate_of_forces(self) -> np.ndarray:
        """Bound on |J| of the other forces [1/s] for each block of floes, which sets their sub-steps."""
        p = self.packed
        n = len(p.number)
        if not self.forces or not n or self.step.scheme != "verlet":
            return np.zeros(n // BLOCK + 1)
        speed = speed_bound(self.forces, self.at, self.before.speed)
        rate = np.zeros((len(self.at[0]), BLOCK))
        for force, at in zip(self.forces, self.at, strict=True):
            add_fastest_rate(force, at, speed, self.before.spin, rate)
        rate = rate.reshape(-1)
        rate[n:] = 0.0
        if len(p.held):
            still = (p.inverse_x == 0.0) & (p.inverse_y == 0.0)
            rate[:n][still if p.inverse_spin is None else still & (p.inverse_spin == 0.0)] = 0.0
        return rate.reshape(-1, BLOCK).max(axis=1)

    def _mark(self, x: np.ndarray, y: np.ndarray, travelled: float = 0.0) -> None:
        """Measure displacements from positions x, y and from the present ones of the walls.

        travelled : displacement up to then, in earlier exchanges [m]
        """
        self.marked = Marked(x, y, self.state.walls["position"].copy(), travelled, self.still)
        self.travelled = travelled

    def _mark_anew(self) -> None:
        """Subtract the displacement so far from the room, and measure from the present positions on."""
        self.room -= self.travelled
        self._mark(self.packed.floes["x"].copy(), self.packed.floes["y"].copy())

    def _stray_on(self) -> bool:
        """Whether the list of pairs still has room; if so, it is kept, and only the limit on the step is renewed."""
        if self.room - self.travelled <= 0.5 * self.listed.closing:
            return False
        self._mark_anew()
        self._stiffest = None
        return True

    def _meet_walls(self) -> None:
        """Allocate the contacts between walls and the floes listed near them."""
        floe, number = self.listed.wall_floe, self.listed.wall_number
        dashpot = self.wall_law is not None and self.wall_law.dashpot is not None
        self.walls = Walls(
            self.state.walls if len(self.state.walls) else None, floe, number,
            np.zeros(len(floe)) if dashpot else None, *np.zeros((2, len(floe))),
        )  # fmt: skip

    @property
    def _of_any_scheme(self) -> Packed:
        """The packed floes without what only the paper's schemes read, for kernels that are compiled once for all schemes."""
        return self.packed._replace(previous=None)

    def _laws(self) -> Laws:
        # where nothing touches, no floe looks for others across a seam
        period = (None, None) if self.contact is None else self.period
        return Laws(self.contact, self.wall_law, *period)

    def _touch(self) -> None:
        """Compute the forces and short lists at the present positions; no time passes, so nothing is booked."""
        if len(self.pairs.i) or len(self.state.walls):  # else nothing can touch
            touch_all(
                self._laws(), self._of_any_scheme, self.lists, self.walls, self._tally(), self.buffers
            )  # fmt: skip
        self.near = True  # the short list is of the present positions

    def _tally(self) -> Tally:
        parts = len(self.lists.tiles.parts) - 1
        return Tally(np.zeros((parts, 3)), np.zeros((parts, 5)))

    def finish(self) -> None:
        """Copy everything back into the floes and the state, and book the gains and losses of the ice."""
        unpack(self.packed, self.floes, self.state.previous, self.state.remainder)
        self.domain.bring_back(self.floes.x, self.floes.y)
        self._keep()
        self._book()

    def _renew(self) -> None:
        """Let floes in and out, and rebuild the list unless it still holds."""
        unpack(self.packed, self.floes, self.state.previous, self.state.remainder)
        gone, new = self._come_and_go()
        if len(gone) or len(new) or not self._stray_on():
            self.domain.bring_back(self.floes.x, self.floes.y)
            self._list_with(gone, new)

    def _come_and_go(self) -> tuple[np.ndarray, np.ndarray]:
        """Deactivate floes beyond an inactive edge, and add new ones from the feeders; returns the numbers of both."""
        gone = leaving(self.floes, self.domain)
        self.floes.active[gone] = False
        added = [
            feeder.feed(self.floes, self.state.walls, self.state.rng)
            for feeder in self.state.feeders
        ]
        return gone, np.concatenate(added) if added else np.empty(0, np.int64)

    def _list_with(self, gone: np.ndarray, new: np.ndarray) -> None:
        """Rebuild the list without floes that have left, and with new ones; book both."""
        elastic = self.kept_energy() if len(gone) else 0.0
        if len(new):
            self.state.fit(len(self.floes))
            draw_own(self.floes, self.contact, self.state.rng)
        self._list_anew(self.memory())
        self._touch()
        self._reorder()
        self._begin()
        if len(gone):
            self._extrapolate_anew()
            stock = floe_stock(self.floes, self._among(gone), self.density)
            stock[3] -= self.kept_energy() - elastic
            self.state.ledger.book("outflow", *-stock)
        if len(new):
            stock = floe_stock(self.floes, self._among(new), self.density)
            self.state.ledger.book("inflow", *stock)

    def _reorder(self) -> None:
        """Bring the tables of the forces into the new order of the floes; those that have left come last."""
        place = np.full(len(self.floes), -1)
        place[self.order] = np.arange(len(self.order))
        left = np.flatnonzero(self._among(self.order) & ~self._among(self.packed.number))
        self.order = np.concatenate([self.packed.number, left])
        self.at = tuple(in_order(at, place[self.order]) for at in self.at)

    def _among(self, number: np.ndarray) -> np.ndarray:
        """Mask of the floes with these numbers, (n,) bool."""
        among = np.zeros(len(self.floes), bool)
        among[number] = True
        return among

    def _extrapolate_anew(self) -> None:
        """Let `taylor3` extrapolate from the present forces instead of those of the last step.

        The latter include contacts with floes that have since left; their end would act on one floe of the pair only.
        """
        previous, force, walls = self.packed.previous, self.packed.force, self.state.walls
        if previous is None:
            return
        for column, name in enumerate(("x", "y", "torque")[: 2 + self.floes.rotation]):
            previous[:, column] = force[name]
        walls.previous[:] = walls.force

    # ---- stepping ----------------------------------------------------------------------------------

    def longest_step(self) -> float:
        """The step that the scene asks for [s]; inf where nothing limits it."""
        if self.step.length is not None:
            return self.step.length
        if self.contact is not None and self.step.epsilon is not None:
            return paper_step(self.floes, self.contact, self.density, self.step.epsilon)
        return stable_step(self.stiffest, self.step)

    def run(self, duration: float, at: Sequence[np.ndarray], time: float) -> None:
        """Advance by `duration` seconds from `time`, exactly.

        at : table of each force, by block of the packed floes; its impulse and work are booked in it, or, if the list
            was rebuilt, in the tables that the attributes `at` and `order` then hold
        The floes must be unchanged since `look`; a second run needs another `look`.
        """
        self.at, self.order, self.time = tuple(at), self.packed.number, time
        self._begin()
        gone, new = self._come_and_go()
        if len(gone) or len(new):
            self._list_with(gone, new)
        done = 0.0
        while done < duration:
            if self._strayed_far():
                self._renew()
            done = self._some_steps(done, duration)
        self.finish()

    def seconds_per_step(
        self, at: Sequence[np.ndarray], steps: int, without: Literal["contacts", "forces"] | None
    ) -> float:
        """See `Model.seconds_per_step`; the caller must undo the changes made by the steps."""
        self.at, self.order, self.time = tuple(at), self.packed.number, math.nan
        self._begin()
        if self._strayed_far():
            self._renew()
        if without == "contacts":
            near, nobody = self.lists.near, np.zeros(0, np.int64)
            near = near._replace(parts=np.zeros_like(near.parts), counts=np.zeros_like(near.counts))
            self.lists = self.lists._replace(near=near)
            self.listed = self.listed._replace(wall_floe=nobody, wall_number=nobody)
            self._meet_walls()
        if without == "forces":
            self.lag[:] = -math.inf, math.inf  # always ahead
        begin = work_clock()
        taken = self._kernel(self.state.counters.last_step, steps)
        return (work_clock() - begin) / taken

    def _some_steps(self, done: float, duration: float) -> float:
        """Take steps until the time is reached or the list may be stale; returns the time reached [s]."""
        dt, steps = self._steps_for(duration - done, done)
        taken = 0
        self._check_pace(self.before, dt, done)  # drag on a floe too fast needs endless sub-steps
        if self.step.scheme == "verlet":
            part = DRAG_RESOLUTION / self.rate.max(initial=1e-300)
            self._refuse_too_many("sub-steps of drag or Coriolis", part, duration - done, done)
        while taken < steps:
            begin = work_clock()
            n = self._kernel(dt, steps - taken)
            self.state.seconds.steps += work_clock() - begin
            taken += n
            self._count(n, dt)
            self._check(Survey(*survey(self._of_any_scheme)), dt, done + taken * dt)
            self.travelled = strayed(self.packed.floes, self.walls.records, self.marked)
            if self._strayed_far():
                break
        reached = done + taken * dt
        return duration if abs(duration - reached) <= 1e-9 * dt else reached

    def _steps_for(self, rest: float, done: float) -> tuple[float, int]:
        """Length [s] and number of the steps for the rest of an exchange [s], of which `done` seconds are over."""
        dt = self.longest_step()
        told = self.step.length is not None or self.step.epsilon is not None
        if not told and self.contact is None:
            # nothing else limits the displacement at one velocity
            dt = min(dt, DRAG_RESOLUTION / self.rate.max(initial=1e-300))
        self._refuse_too_many("steps", dt, rest, done)
        if told:  # a shorter step ends the interval
            return min(dt, rest), max(1, int(rest / dt + 1e-9))
        steps = max(1, int(np.ceil(rest / dt - 1e-9)))
        return rest / steps, steps

    def _strayed_far(self) -> bool:
        """Whether floes have moved so far that the list or the limit on the step must be renewed."""
        return self.travelled > NEARLY * self._reach()

    def _refuse_too_many(self, what: str, length: float, rest: float, done: float) -> None:
        if not rest / MOST_STEPS <= length:
            raise StabilityError(
                f"{rest:g} s at t = {self.time + done:g} s would take {rest / length:.2g} {what} of {length:.3g} s, at"
                f" most {MOST_STEPS:g} are allowed: a velocity, a coefficient or a step is not what it should be"
            )

    def _reach(self) -> float:
        """Displacement of floes from their marks [m] at which the list or the limit on the step expires."""
        bounded = self.contact is not None and self.listed.closing > 0.0
        return min(self.room, 0.5 * self.listed.closing) if bounded else self.room

    def _half_skin(self) -> float:
        if self.packed.land.all():  # also where there are no floes
            return np.inf
        if self.contact is None:
            # the list only serves the edges: a floe may move a tenth of the domain beyond them
            return 0.05 * float(np.sqrt(self.domain.area))
        return 0.5 * self.listed.skin

    def _kernel(self, dt: float, steps: int) -> int:
        """Take up to `steps` steps, until the list may be stale; returns the number taken."""
        tally = self._tally()
        scene = self._laws(), self.forces, self.at, self.packed, self.lists, self.walls, tally
        room = self.travelled, self._reach()
        if self.step.scheme != "verlet":
            done = taylor(self.step.scheme == "taylor3", *scene, dt, steps, *room, self.buffers)
        else:
            parts = np.ceil(self.rate * (self.step.drag_every * dt / DRAG_RESOLUTION))
            substeps = np.maximum(1, parts).astype(np.int64)
            rest = dt, steps, substeps, self.marked, *room, self.step.drag_every, self.lag
            scene = *scene, self._first_kick(dt), self.before.speed * dt if self.near else np.inf
            if len(self.lists.tiles.chunks) == 2:
                done = verlet(*scene, *rest, self.buffers)
            else:
                done = verlet_in_threads(self.threads, *scene, *rest)
        self.held += tally.held.sum(axis=0)
        self.lost += tally.lost.sum(axis=0)
        self.near = False
        return done

    def _count(self, steps: int, dt: float) -> None:
        counters = self.state.counters
        counters.steps += steps
        counters.floe_steps += steps * len(self.packed.number)
        counters.pairs += steps * len(self.pairs.i)
        counters.shortest_step = min(counters.shortest_step, dt)
        counters.longest_step = max(counters.longest_step, dt)
        counters.last_step = dt

    def _check(self, seen: Survey, dt: float, done: float) -> None:
        """Stop, before any result is passed on, if the step no longer resolves the motion."""
        p = self.packed
        when = f"at t = {self.time + done:g} s with a step of {dt:g} s"
        if not seen.finite:
            with np.errstate(over="ignore"):
                moving = [p.floes["x"], p.floes["y"], p.floes["u"] ** 2 + p.floes["v"] ** 2]
            moving += [] if p.spinning is None else [p.spinning["omega"], p.angle]
            floe = p.number[np.argmax(~np.isfinite(moving).all(axis=0))]
            raise StabilityError(
                f"floe {floe}: position or velocity is no longer finite {when}; "
                f"a step of {0.5 * dt:g} s may hold"
            )
        self.liveliest = max(self.liveliest, seen.energy)
        before, self.before = self.before, seen
        if self.contact is not None:
            # a contact may have stopped the fastest floe
            self._check_pace(max(seen, before, key=lambda each: each.pace), dt, done)
            self._check_walls(when)
            if self.contact.failure is None:  # else floes raft, one over the other
                self._check_overlaps(when)

    def _check_pace(self, seen: Survey, dt: float, done: float) -> None:
        """Stop if a floe moves so far in a step that it may pass through another."""
        way = seen.pace * dt
        if self.contact is not None and way > 0.5:
            speed = seen.pace * self.packed.floes[seen.which]["r"]
            raise StabilityError(
                f"floe {self.packed.number[seen.which]}: moves {way:.2g} of its radius in one step "
                f"({speed:.3g} m/s), at most 0.5 is allowed, at t = {self.time + done:g} s with a step of {dt:g} s; "
                f"a step of {0.1 * dt / way:.2g} s would hold"
            )

    def _check_overlaps(self, when: str) -> None:
        p = self.packed
        pair, share = deepest(*any_period(self.period), p.floes, self.lists.near)
        if share > 1.0:
            one, other = p.number[[self.pairs.i[pair], self.pairs.j[pair]]]
            modulus = self.contact.elastic.youngs_modulus
            raise StabilityError(
                f"floes {one} and {other}: overlap by {share:.2g} of the smaller radius {when}; "
                f"the ice is too soft for this blow: a youngs_modulus of {10 * modulus:.2g} Pa, "
                f"now {modulus:.2g}, may hold"
            )

    def _check_walls(self, when: str) -> None:
        """Stop where the centre of a floe has passed a wall."""
        p, floe = self.packed, self.walls.floe
        if not len(floe):
            return
        walls = self.state.walls[self.walls.number]
        along_x = walls["axis"] == 0
        place = np.where(along_x, p.floes["x"][floe], p.floes["y"][floe])
        passed = walls["side"] * (walls["position"] - place)
        held = np.where(along_x, p.inverse_x[floe], p.inverse_y[floe]) == 0.0
        passed[held & (walls["inverse_mass"] == 0.0)] = 0.0  # the motion of both is prescribed
        if passed.max(initial=0.0) > 0.0:
            k = int(np.argmax(passed))
            raise StabilityError(
                f"floe {p.number[floe[k]]}: its centre is {passed[k]:.2g} m behind the wall in the "
                f"{edge_of(walls[k])} {when}; the wall goes too far, or the ice is too soft for the blow or the load: its "
                f"youngs_modulus is {self.contact.elastic.youngs_modulus:.2g} Pa"
            )

    # ---- books -------------------------------------------------------------------------------------

    def _touching(self) -> tuple[np.ndarray, np.ndarray]:
        """See `survey.touching_pairs`."""
        p, lists = self.packed, self.lists
        return touching_pairs(
            self.contact, *self.period, p.floes, p.friction, p.tensile_strength, lists.near, lists.pairs
        )  # fmt: skip

    def contacts(self) -> Contacts:
        """The pairs that exert forces on each other, and these forces."""
        p, pairs = self.packed, self.pairs
        touching, rows = self._touching()
        i, j = p.number[pairs.i[touching]], p.number[pairs.j[touching]]
        order = np.lexsort((np.maximum(i, j), np.minimum(i, j)))
        values = [column[order] for column in rows.T]
        values[0], values[1] = values[0] + p.origin_x, values[1] + p.origin_y
        self.domain.bring_back(values[0], values[1])  # of a floe at a seam, half may lie beyond it
        values[7] = values[7] > 0
        return Contacts(i[order], j[order], *values)

    def elastic_energy(self) -> float:
        """Energy stored in contacts, bonds and walls [J]."""
        p, walls = self.packed, self.state.walls
        _, rows = self._touching()
        energy = float(rows[:, -1].sum())
        floe, number = self.walls.floe, self.walls.number
        if len(floe):
            x, y, r, h = (p.floes[name][floe] for name in ("x", "y", "r", "h"))
            axis, side, position = (walls[name][number] for name in ("axis", "side", "position"))
            overlap = np.minimum(side * (np.where(axis == 0, x, y) - position) - r, 0.0)
            energy += 0.5 * self.contact.elastic.youngs_modulus * float((h * overlap**2).sum())
        return energy

    def kept_energy(self) -> float:
        """Elastic energy minus Δt²/8 Σ|F|²/m [J], the part that the scheme does not conserve (eq. kept-energy)."""
        press, _ = self._press()
        if not press:  # the square of the last step may overflow
            return self.elastic_energy()
        return self.elastic_energy() - 0.125 * self.state.counters.last_step**2 * press

    def _press(self) -> tuple[float, float]:
        """Σ|F|²/m [N²/kg] and the power Σ F·u [W] of the contact forces; 0 where the scheme conserves no energy."""
        keeps = self.step.scheme == "verlet" and self.contact is not None
        if not keeps or self.contact.dashpot is not None:
            return 0.0, 0.0
        return pressed(self.packed, self.walls.records)

    def _first_kick(self, dt: float) -> float:
        """Duration of the first half kick [s] of steps of dt; at the start of a run, adjusted to conserve its energy.

        (eq. first-kick); steps of a given length are left as they are.
        """
        if self.state.counters.steps or self.step.length is not None:
            return 0.5 * dt
        press, power = self._press()
        if press == 0.0:
            return 0.5 * dt
        left = power**2 + 0.25 * (press * dt) ** 2
        return 0.5 * dt + (math.copysign(math.sqrt(left), power) - power) / press

    def stock(self) -> np.ndarray:
        """Mass [kg], momentum x, y [N s] and energy [J] of the ice now."""
        stock = floe_stock(self.floes, self.floes.active, self.density)
        stock[3] += self.kept_energy()
        return stock

    def _book(self) -> None:
        ledger = self.state.ledger
        for wall in self.state.walls:
            along = {"x": wall.impulse} if wall.axis == 0 else {"y": wall.impulse}
            ledger.book("walls", energy=wall.work, **along)
            wall.impulse = wall.work = 0.0
        if len(self.packed.held) or self.packed.land.any() or self.held.any():
            x, y, work = self.held
            ledger.book("held floes and coast", x=x, y=y, energy=work)
        ledger.saw(self.liveliest)
        *lost, broken = self.lost
        accounts = "friction", "dashpots", "broken bonds", "compressive failure"
        for name, loss in zip(accounts, lost, strict=True):
            if loss:
                ledger.book(name, energy=-loss)
        self.state.counters.bonds_broken += int(round(broken))


def draw_own(floes: Floes, contact: Contact | None, rng: np.random.Generator) -> None:
    """Draw μ and σ_c of floes that have none yet, lognormal with the law's mean (eq. spread)."""
    for name, (mean, spread) in own(contact).items():
        values = getattr(floes, name)
        new = np.flatnonzero(np.isnan(values))
        width = np.sqrt(np.log1p(spread**2))
        values[new] = mean * np.exp(width * rng.standard_normal(len(new)) - 0.5 * width**2)


def floe_stock(floes: Floes, of: np.ndarray, density: float) -> np.ndarray:
    """Mass [kg], momentum x, y [N s] and kinetic energy [J] of the floes in the mask `of`, (n,) bool; land has none."""
    f, stock = floes, np.empty((4, len(floes)))
    columns = f.radius, f.thickness, f.u, f.v, f.angular_velocity
    stock_of_each(of & ~f.land, *columns, density, stock)
    # summed outside the kernel, whose rounding differs: opposite momenta then cancel to the last bit
    return stock.sum(axis=1)
