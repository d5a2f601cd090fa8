"""The model: floes, laws, and the fluids around them.

    floes = scatter(domain, PowerLaw(200, 1500), concentration=0.6, seed=1)
    model = Model(domain, floes, contact=frictional(), forces=[OceanDrag(), AirDrag()], grid=grid)
    model.atmosphere.u[:] = 10.0
    model.advance(600.0)

`advance` is one exchange interval: the fluids are sampled at the floes, the floes take as many steps as
their contacts need, and the impulse that each fluid gave to them is removed from the cells in which the fluid was
read.  A host, a forcing file and a constant wind all use the same arrays, so a coupled and a forced
run cannot differ.

What the scene does not list does not exist: a model without wind has no `atmosphere`, one whose
floes do not rotate has no angles.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from numbers import Integral
from typing import Any, Literal

import numpy as np

from floebmi import __version__
from floebmi.advance import Advance, draw_own
from floebmi.agreement import refuse_other_coast, refuse_unlike, scene_of
from floebmi.alone import alone, free, refuse_another
from floebmi.boundaries import (
    Domain,
    Feeder,
    Inflow,
    Wall,
    build_walls,
    check_reach,
    check_way_in,
    edge_of,
)
from floebmi.budgets import Ledger
from floebmi.contact import Contact, memories, own, turns
from floebmi.dynamics import Step, usual_fraction
from floebmi.errors import InputError, StabilityError, check_word, in_line, warn
from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, Floes
from floebmi.fluid import fluid_of, fluids_for, give_impulses_back, impulses_of_drag, sample
from floebmi.forces import (
    ACCOUNTS,
    AirDrag,
    Force,
    OceanDrag,
    at_floes,
    bulk_coefficient,
    by_block,
    given,
)
from floebmi.grid import Grid, check_grid
from floebmi.gridding import (
    cell_fields,
    divergence,
    internal_stress,
    maximum_shear,
    per_area,
    pressure,
)
from floebmi.kept import marks
from floebmi.listing import Memory
from floebmi.overlaps import refuse_over_walls, refuse_overlaps, told_outside
from floebmi.pairs import PairList
from floebmi.parts import (
    check_kinds,
    check_laws,
    check_numbers,
    listed_forces,
    refuse_strangers,
)
from floebmi.quantities import as_python, check, check_flag, check_table, is_number
from floebmi.sampling import (
    Coverage,
    Weights,
    check_images,
    coverage,
    floe_weights,
    shares,
)
from floebmi.state import Counters, Seconds, State
from floebmi.survey import Contacts
from floebmi.variables import PER_ICE_AREA

Out = Mapping[str, np.ndarray] | None
RESIDUAL_ALLOWED = 0.1  # largest relative energy residual; beyond it a run is stopped
STILL = 1e-6  # m/s: less energy than that of all ice at this speed is negligible
LAG_ALLOWED = 2.0  # Δt_c κ/(ρ_o Δz) of a host that uses the last stress (eq. lagged-stress)


class _Seen:
    """Results computed for the floes as they are at one moment, each once.

    floes : a copy of the floes at that moment, to detect changes
    advance : the floes packed, with their neighbours and contact forces
    contacts : the pairs that exert contact forces on each other
    """

    def __init__(
        self, floes: Floes, period: tuple[float | None, float | None], sampling: str
    ) -> None:
        self.floes, self._period, self._sampling = floes, period, sampling
        self.advance: Advance | None = None
        self.contacts: Contacts | None = None
        self._coverage: dict[Grid, Coverage] = {}
        self._weights: dict[Grid, Weights] = {}

    def coverage(self, grid: Grid) -> Coverage:
        """Exact areas of the floes in the cells of a grid; land has none."""
        f = self.floes
        if grid not in self._coverage:
            ice = f.active & ~f.land
            self._coverage[grid] = coverage(grid, f.x, f.y, f.radius, self._period, of=ice)
        return self._coverage[grid]

    def weights(self, grid: Grid) -> Weights:
        """Floe-grid weights on a grid."""
        f = self.floes
        if grid not in self._weights:
            if self._sampling == "overlap":
                weights = shares(self.coverage(grid), grid.wet)
            else:
                weights = floe_weights(grid, f.x, f.y, f.radius, self._sampling, self._period)
            self._weights[grid] = weights
        return self._weights[grid]


class Model:
    """Sea-ice floes that move under contact, drag and the other forces of a scene.

    Parameters
    ----------
    domain : the area of the floes, and the kinds of its edges
    floes : the ice, and the coast if there is one; the model works on these arrays in place
    contact : a contact law, or None for free drift
    forces : laws of drag and other forces; their order does not matter
    grid : exchange grid; needed with drag, tilt or a Coriolis field. Default: one cell on the domain
    walls, inflow : lists of `Wall`, which push the ice, and of `Inflow`, where new floes enter
    step : integration scheme and time step
    sampling : "overlap" (exact areas) or "centre" (the paper's bilinear; on curvilinear and unstructured
        grids the cell that holds the centre) for floe-grid weights
    ice_density : ρ_ice [kg/m³]
    draft_fraction : D/h [1]
    rotation : let floes rotate even without friction (by the torque of vorticity)
    seed : of all random numbers of the model: inflow, and friction and strength that differ among floes
    atmosphere_grid : grid of the wind, if it differs
    threads : number of threads for the steps of a large pack (50 000 floes or more); results are bitwise equal for any number

    Attributes
    ----------
    time : since the start [s]
    domain, floes, contact, forces, grid : as given
    ocean, atmosphere : `Fluid`, velocities that drive the ice and the impulse returned to the fluid; None where no force
        reads them

    Raises
    ------
    InputError
        one line, for any invalid input.
    """

    def __init__(
        self,
        domain: Domain,
        floes: Floes,
        contact: Contact | None = None,
        forces: Iterable[Force] = (),
        grid: Grid | None = None,
        walls: Sequence[Wall] = (),
        inflow: Sequence[Inflow] | Inflow = (),
        step: Step = Step(),
        sampling: str = "overlap",
        ice_density: float = 934.0,
        draft_fraction: float = 0.9,
        rotation: bool = False,
        seed: int = 0,
        atmosphere_grid: Grid | None = None,
        threads: int = 1,
    ) -> None:
        check_kinds(domain, floes, grid, walls, inflow, step, atmosphere_grid)
        forces = listed_forces(forces)
        check_laws(forces, contact, sampling, step)
        check_numbers(ice_density, draft_fraction, seed, threads)
        check_flag("rotation", rotation)
        self.domain, self.floes, self.contact, self.forces = domain, floes, contact, forces
        self.step, self.sampling = step, sampling
        self.walls = tuple(walls)
        self.inflow = (inflow,) if isinstance(inflow, Inflow) else tuple(inflow)
        self.ice_density, self.draft_fraction = float(ice_density), float(draft_fraction)
        self.seed, self.threads = seed, threads
        self.time = 0.0
        if step.fraction is None:
            self.step = step._replace(fraction=usual_fraction(step.scheme, contact))
        if rotation or turns(contact):
            floes.allow_rotation()
        # a stream separate from that of a pack of the same seed: else new floes would repeat its radii
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(0,))))
        refuse_strangers(floes, contact)
        for name in own(contact):
            floes.allow_own(name)
        draw_own(floes, contact, rng)
        floes.check()
        # as after every advance: in the first frame, too, no floe lies beyond a periodic edge
        floes.x[:], floes.y[:] = domain.brought_back(floes.x, floes.y)
        self.grid = Grid.uniform(domain.x, domain.y, shape=(1, 1)) if grid is None else grid
        self._make_fluids(atmosphere_grid or self.grid)
        self._state = self._first_state(rng)
        refuse_over_walls(self._state.walls, floes, domain, "at the start")
        if told := told_outside(floes, domain):
            warn(f"{told}: they leave with the first exchange")
        self._last_duration = 0.0
        self._warned_of_lag = False
        self._seen = self._see(floes.copy())
        self._left: _Seen | None = None  # as the last advance left the floes
        # the floes at the last time they were known to be free of edits that overlap; None if unknown
        self._accepted: Floes | None = self._seen.floes
        self._scene = scene_of(self)
        self._tables = self._allocate()  # of the forces at all floes
        self._at: tuple[np.ndarray, ...] = ()  # the same in an exchange, by block
        now = self._now()
        self._state.ledger.open(now.stock())
        # where bonds are listed, floes that touch are bonded from the start
        self._state.memory = now.memory()
        self._seen.advance = None
        self._built = True

    def _make_fluids(self, atmosphere_grid: Grid) -> None:
        """Make the fluids that the forces read, at rest."""
        self._fluids = fluids_for(self.forces, self.grid, atmosphere_grid, self.domain.period)
        self.ocean, self.atmosphere = self._fluids.get("ocean"), self._fluids.get("atmosphere")
        for grid in dict.fromkeys((self.grid, atmosphere_grid)):
            check_images(grid, self.domain.period)

    def _first_state(self, rng: np.random.Generator) -> State:
        """The state before the first step; InputError for floes, walls and inflows that do not fit together."""
        floes, domain, contact = self.floes, self.domain, self.contact
        modulus = 0.0 if contact is None else contact.elastic.youngs_modulus
        walls = build_walls(domain, self.walls, floes, self.ice_density, modulus)
        if contact is None and len(walls):
            raise InputError("walls and closed edges need a contact law: give contact")
        if contact is not None:
            refuse_overlaps(floes, domain, "at the start")
        none, start = np.zeros(0, np.uint32), np.zeros(len(floes) + 1, np.int64)
        nothing = PairList(start, none, none, **{name: np.zeros(0) for name in memories(contact)})
        state = State(
            walls,
            Memory(nothing, np.arange(len(floes))),
            None if self.step.scheme == "verlet" else np.zeros((len(floes), 3)),
            None if domain.origin == (0.0, 0.0) else np.zeros((len(floes), 2)),
            rng,
            tuple(Feeder(one, domain) for one in self.inflow),
        )
        for one in self.inflow:
            check_way_in(one, walls, domain)
        largest = max(
            [*floes.radius[floes.active & ~floes.land], *(i.sizes.range[1] for i in self.inflow)],
            default=np.inf,
        )
        for wall in self.walls:
            check_reach(wall, largest, domain)
        return state

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to replace parts of a model, which walls, tables and files rely on; `time` and array values may be set."""
        if "_built" in vars(self) and not name.startswith("_") and name != "time":
            raise AttributeError(
                f"model.{name}: cannot be set; build another model, or edit the arrays of this one"
            )
        if name == "time" and not is_number(value):
            raise InputError(f"model.time = {in_line(value)}: must be a finite number [s]")
        super().__setattr__(name, value)

    def _refuse_edits(self) -> None:
        """InputError for floes that an edit made invalid, or put onto each other or over a wall."""
        floes, domain, accepted, walls = self.floes, self.domain, self._accepted, self._state.walls
        floes.check()
        if accepted is None:
            # no larger overlap than a run may leave
            refuse_over_walls(walls, floes, domain, "after a restart", allowed=1.0)
            if self.contact is not None and self.contact.failure is None:
                refuse_overlaps(floes, domain, "after a restart", allowed=1.0, moved=True)
        elif not floes.same(accepted, ("x", "y", "radius", "active")):
            if self.contact is not None:
                refuse_overlaps(floes, domain, "after an edit", accepted)
            refuse_over_walls(walls, floes, domain, "after an edit", accepted)

    # ---- one exchange ------------------------------------------------------------------------------

    def _allocate(self) -> tuple[np.ndarray, ...]:
        """One table per force, with the floe properties that it needs."""
        f = self.floes
        draft = self.draft_fraction * f.thickness
        return tuple(
            at_floes(force, f.radius, f.thickness, draft, self.ice_density, f.rotation, f.land)
            for force in self.forces
        )

    def _known(self) -> _Seen:
        """The results for the floes as they are now; discarded when the floes change."""
        refuse_another(self, "model")
        draw_own(self.floes, self.contact, self._state.rng)  # for floes added by the user
        if not self._seen.floes.same(self.floes):
            self._seen = self._see(self.floes.copy())
        return self._seen

    def _see(self, floes: Floes) -> _Seen:
        """An empty set of results for the floes; floes : a copy of them."""
        return _Seen(floes, self.domain.period, self.sampling)

    def _now(self, seen: _Seen | None = None) -> Advance:
        """The packed floes with their contact forces, for diagnostics; nothing is counted.

        seen : result of `_known`, if just computed, so as not to compare all floes again
        """
        seen = seen or self._known()
        if seen.advance is None:
            self._state.fit(len(self.floes))
            now = self._advance()
            now.look(self._state.kept_for(seen.floes))
            seen.advance = now  # only once it is complete: Ctrl-C may come at any time
        return seen.advance

    def _advance(self) -> Advance:
        """An `Advance` from the present state, with nothing packed yet."""
        return Advance(
            self.floes, self._state, self.domain, self.contact, self.forces, self.step,
            self.ice_density, self.threads,
        )  # fmt: skip

    def advance(self, duration: float) -> None:
        """Advance the ice by `duration` seconds, exactly, as one exchange with the fluids.

        Several threads may each advance their own model; while one works on a model, calls from another are refused.

        Raises
        ------
        InputError
            for a duration that is negative or not finite, for a NaN in a wet cell of a fluid or a velocity of
            1000 m/s or more, for floes that an edit has put onto each other or over a wall, and while another thread
            advances this model.
        StabilityError
            if the step no longer resolves the motion: a floe moves more than half its radius in a step, overlaps another
            by more than the smaller radius or has its centre behind a wall, a number is no longer finite, more than 1e12
            steps would be needed, or the relative energy residual exceeds 0.1.

        After an error the model is as it was before.
        """
        if not (is_number(duration) and duration >= 0):
            raise InputError(f"advance: duration = {duration!r}; must be at least 0 s")
        duration = float(duration)
        if duration == 0:
            return
        with alone(self, "advance"):
            self._exchange(duration)
        self._warn_of_lag(duration)

    def _exchange(self, duration: float) -> None:
        """One exchange with the fluids, completely or not at all."""
        for name, fluid in self._fluids.items():
            fluid.refuse_not_finite(name, self.time)
        seen = self._known()
        count = len(self.floes)
        advance, weights = self._ready(seen)
        before = self._state.copy()
        seen.advance = None  # the steps use it up, even if they fail
        try:
            if seen is not self._left:
                self._book_edits(advance)
            advance.run(duration, self._at, self.time)
            self._at = advance.at
            self._book_forces()
            self._state.ledger.now = advance.stock()
            self._check_energy(self.time + duration)
            if len(self.floes) != count:
                self._tables = self._allocate()
            left = self._see(self._state.kept.floes)
            after = {
                "_left": left, "_seen": left, "_accepted": left.floes, "time": self.time + duration,
                "_last_duration": duration,
            }  # fmt: skip
            impulses = impulses_of_drag(self.forces, self._at, self._fluids, weights, advance.order)
            drag = self._ocean_drag(weights, advance.order)
        except BaseException:
            self.floes.go_back(seen.floes)
            self._state.go_back(before)
            raise
        # Ctrl-C interrupts before or after an exchange: it waits for compiled code, and there is little else from here on
        vars(self).update(after)
        if drag is not None:
            self.ocean._drag = drag
        give_impulses_back(impulses)

    def _ready(self, seen: _Seen) -> tuple[Advance, dict[Grid, Weights]]:
        """Prepare the steps: packed floes, the fluids sampled at them, and the weights of that, by grid."""
        if seen is not self._left:
            self._refuse_edits()
            self._tables = self._allocate()
        advance = self._now(seen)
        order = advance.packed.number
        self._at = tuple(by_block(table, order) for table in self._tables)
        weights = sample(
            self.forces, self._at, self._fluids, seen.weights, order, self.floes.rotation
        )
        return advance, weights

    def _check_energy(self, time: float) -> None:
        """Stop when the energy residual is large: the step does not resolve the motion."""
        ledger = self._state.ledger
        energy, longest = ledger.balance("energy"), self.counters.longest_step
        little = 0.5 * ledger.now[0] * STILL**2
        if energy.relative > RESIDUAL_ALLOWED and abs(energy.residual) > little:
            raise StabilityError(
                f"energy residual of {energy.residual:.3g} J at t = {time:g} s with steps of up to "
                f"{longest:.3g} s: {energy.relative:.2g} of the largest energy in the ledger, at most {RESIDUAL_ALLOWED:g} is "
                f"allowed; a step of {0.5 * longest:.2g} s may hold"
            )

    def _warn_of_lag(self, duration: float) -> None:
        """Warn once that a host which applies the last stress explicitly would oscillate (eq. lagged-stress)."""
        ocean, drag = self.ocean, [force for force in self.forces if isinstance(force, OceanDrag)]
        if not drag or ocean.layer_thickness is None or self._warned_of_lag:
            return
        rate = float(ocean.coefficient.max()) / (drag[0].density * ocean.layer_thickness)
        if duration * rate > LAG_ALLOWED:
            self._warned_of_lag = True
            warn(
                f"exchange of {duration:g} s at t = {self.time:g} s: drag on ice could turn a layer of "
                f"{ocean.layer_thickness:g} m {duration * rate:.2g} times, above {LAG_ALLOWED:g} a lagged "
                f"stress grows under ice at rest; exchange every {LAG_ALLOWED / rate:.3g} s, or take the "
                "linear drag coefficient implicitly"
            )

    def _book_edits(self, now: Advance) -> None:
        """Book edits of the floes between two exchanges in an account of their own."""
        ledger, stock = self._state.ledger, now.stock()
        change = stock - ledger.now
        if (np.abs(change) > 1e-11 * np.maximum(np.abs(stock), np.abs(ledger.now))).any():
            ledger.book("edits by the user", *change)

    def coverage(self, grid: Grid | None = None) -> Coverage:
        """Exact areas of the floes in the cells of a grid, now; land has none.

        grid : default: the exchange grid
        """
        grid = self.grid if grid is None else grid
        check_grid("grid", grid)
        return self._known().coverage(grid)

    def weights(self, grid: Grid) -> Weights:
        """Floe-grid weights at the present positions, on a grid."""
        check_grid("grid", grid)
        return self._known().weights(grid)

    def _ocean_drag(self, weights: dict[Grid, Weights], order: np.ndarray) -> tuple | None:
        """The data from which magnitude and coefficient of the ocean drag are computed on request; see `Fluid`."""
        for force, at in zip(self.forces, self._at, strict=True):
            if isinstance(force, OceanDrag):
                return weights[self.grid], order, at, self._state.kept.floes, self.ice_density
        return None

    def _book_forces(self) -> None:
        """Book the impulse and the work of each force in the ledger."""
        for force, at in zip(self.forces, self._at, strict=True):
            name = ACCOUNTS[type(force)]
            x, y, work = given(at)
            self._state.ledger.book(name, x=x, y=y, energy=work)

    def step_by(self, steps: int) -> None:
        """Advance by a number of the scene's own steps: for tests and teaching.  Raises as `advance` does."""
        if not (is_number(steps) and steps >= 0):
            raise InputError(f"step_by: steps = {in_line(steps)}: must be a number, at least 0")
        length = self.longest_step()
        if not np.isfinite(length):
            raise InputError("step_by: nothing sets a step here; use advance(seconds)")
        self.advance(steps * length)

    # ---- diagnostics -------------------------------------------------------------------------------

    @property
    def ledger(self) -> Ledger:
        """Budgets of mass, momentum and energy of the ice."""
        return self._state.ledger

    @property
    def counters(self) -> Counters:
        """Steps, floe-steps, lists made, pairs."""
        return self._state.counters

    @property
    def seconds(self) -> Seconds:
        """Wall-clock time [s] of steps and lists so far, in this process; the rest of `advance` is exchange."""
        return self._state.seconds

    def seconds_per_step(
        self, steps: int, without: Literal["contacts", "forces"] | None = None
    ) -> float:
        """Wall-clock time of a step from here [s], of the same length as the last; the model is left unchanged.

        steps : average over up to so many
        without : what to leave out: "contacts", as if no floe were near another one or a wall; "forces", all others, only
            with the scheme "verlet"; see `floebmi.timing`

        Raises
        ------
        InputError
            before the first step.
        """
        if not (isinstance(steps, Integral) and steps >= 1):
            raise InputError(f"steps = {in_line(steps)}: must be a whole number, at least 1")
        if without is not None:
            check_word("without", without, ("contacts", "forces"))
        if not self.counters.steps:
            raise InputError("seconds_per_step: no step was taken yet; advance the model first")
        with alone(self, "seconds_per_step"):
            seen = self._known()
            before = self._state.copy()
            advance, _ = self._ready(seen)
            seen.advance = None  # the steps use it up
            try:
                return advance.seconds_per_step(self._at, steps, without)
            finally:
                self.floes.go_back(seen.floes)
                self._state.go_back(before)

    @property
    def wall_edges(self) -> tuple[str, ...]:
        """The edge at which each wall stands: listed walls first, then closed edges."""
        return tuple(map(edge_of, self._state.walls))

    @property
    def wall_positions(self) -> np.ndarray:
        """Coordinates of the walls along their normals [m], in the order of `wall_edges`."""
        walls = self._state.walls
        return walls.position + np.array(self.domain.origin)[walls.axis]

    def wall_stress(self) -> np.ndarray:
        """Normal stress of the ice on each wall now [Pa], positive presses, over its length × mean thickness."""
        self._now()  # leaves the forces on the walls in their records
        walls, ice = self._state.walls, self.floes.active & ~self.floes.land
        if not ice.any():
            return np.zeros(len(walls))
        thickness = self.floes.volume[ice].sum() / self.floes.area[ice].sum()
        along = np.array([np.ptp((self.domain.y, self.domain.x)[int(w.axis)]) for w in walls])
        return 0.0 - walls.side * walls.force / (along * thickness)

    def longest_step(self) -> float:
        """The longest time step that contacts and the scene permit now [s]; inf where they set no limit."""
        return self._now().longest_step()

    def contacts(self) -> Contacts:
        """The pairs that exert contact forces on each other now, and these forces."""
        seen = self._known()
        if seen.contacts is None:
            seen.contacts = self._now(seen).contacts()
        return seen.contacts

    def fields(self) -> dict[str, np.ndarray]:
        """Gridded output by the short names of `variables.VARIABLES`, flat arrays of shape (grid.size,).

        State fields are present values; stresses of fluids are means over the last exchange (0 before the first).
        """
        return self.ice_fields() | self.internal_stress_fields() | self.fluid_stress_fields()

    def ice_fields(self, out: Out = None) -> dict[str, np.ndarray]:
        """The part of `fields` that is the state of the ice: area, thickness, velocity, floes.

        out : arrays to write into, by name; only these fields are returned. Default: new arrays for all fields
        """
        self._check_out(out)
        f, contacts = self.floes, self.contacts()
        partners = np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=len(f))
        return cell_fields(
            self.grid, self.coverage(), f.thickness, f.u, f.v, f.radius, self.ice_density, partners,
            out=out,
        )  # fmt: skip

    def internal_stress_fields(self, out: Out = None) -> dict[str, np.ndarray]:
        """The part of `fields` due to contact forces; `out` as for `ice_fields`."""
        self._check_out(out)
        f, now, contacts = self.floes, self._now(), self.contacts()
        stress = internal_stress(
            self.grid, f.x[contacts.i], f.y[contacts.i], contacts.dx, contacts.dy,
            contacts.fx, contacts.fy, self.domain.period,
        )  # fmt: skip
        net = np.zeros((2, len(f)))  # on the ice; the force on the coast is none on the ice
        net[:, now.packed.number] = now.packed.force["x"], now.packed.force["y"]
        net[:, f.land] = 0.0
        push = divergence(self.grid, self.weights(self.grid), *net)
        fields = {
            "internal_stress_xx": stress.xx,
            "internal_stress_xy": stress.xy,
            "internal_stress_yy": stress.yy,
            "internal_stress_divergence_x": push[0],
            "internal_stress_divergence_y": push[1],
            "internal_pressure": pressure(stress.xx, stress.yy),
            "maximum_shear": maximum_shear(stress.xx, stress.xy, stress.yy),
        }
        if out is None:
            return fields
        for name in fields.keys() & out.keys():
            out[name][:] = fields[name]
        return {name: out[name] for name in fields if name in out}

    def fluid_stress_fields(self, out: Out = None) -> dict[str, np.ndarray]:
        """The part of `fields` between ice and fluids, ice on ocean, air on ice; `out` as for `ice_fields`."""
        self._check_out(out)
        over = 1.0 / self._last_duration if self._last_duration else 0.0
        fields: dict[str, np.ndarray] = {}

        def write(name: str, grid: Grid, into: Callable[[np.ndarray], object]) -> None:
            if out is None or name in out:
                fields[name] = np.empty(grid.size) if out is None else out[name]
                into(fields[name])

        for what, fluid, sign in (("ocean", self.ocean, 1.0), ("air", self.atmosphere, -1.0)):
            if fluid is None:
                continue
            for name, x, y, time in (
                (f"{what}_stress", fluid.last_x, fluid.last_y, over),
                (f"{what}_impulse", fluid.impulse_x, fluid.impulse_y, 1.0),
            ):
                for axis, amount in (("x", x), ("y", y)):
                    write(
                        f"{name}_{axis}", fluid.grid,
                        partial(per_area, amount, sign * time, fluid.grid.area),
                    )  # fmt: skip
        ocean, grid = self.ocean, self.grid
        if ocean is not None:
            for name, last in zip(PER_ICE_AREA, (ocean.last_x, ocean.last_y), strict=True):
                write(name, grid, partial(self._per_ice_area, over, last))
            sizes = "ocean_stress_magnitude", "ocean_drag_coefficient"
            write(sizes[0], grid, lambda field: np.multiply(ocean.magnitude, over, out=field))
            write(sizes[1], grid, lambda field: np.copyto(field, ocean.coefficient))
        return fields

    def _check_out(self, out: Out) -> None:
        """InputError for arrays that fields cannot be written into; a kernel would write past the end of a short one."""
        check_table("out", out)
        for name, array in (out or {}).items():
            fluid = self.atmosphere if str(name).startswith("air_") else None
            size = (fluid or self).grid.size
            fits = isinstance(array, np.ndarray) and array.dtype == np.float64
            if not (fits and array.shape == (size,)):
                raise InputError(
                    f"out[{name!r}] = {in_line(array)}: must be an array of {size} float64, one a cell"
                )

    def _per_ice_area(self, over: float, amount: np.ndarray, field: np.ndarray) -> None:
        np.multiply(amount, over * self.over_ice_area(), out=field)

    def over_ice_area(self) -> np.ndarray:
        """Inverse of the area of ice in each cell now [m-2], 0 where there is none: (grid.size,)."""
        ice = self.coverage().in_cells
        return np.divide(1.0, ice, out=np.zeros(self.grid.size), where=ice > 0)

    # ---- copies and restart ------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, object]:
        """The content of a copy or a pickle; the neighbour list, whose arrays share memory, is replaced by its marks."""
        kept, s = self._state.kept_for(self._known().floes), self._state
        return vars(self) | {
            "_state": replace(s, memory=s.memory.by_number(len(self.floes)), kept=None),
            "_marks": marks(kept, s.memory.number),
            "_seen": None,
            "_left": None,
        }

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        listed = vars(self).pop("_marks")
        free(self)
        self._seen = self._see(self.floes.copy())
        self._advance().list_again(listed)

    def state(self) -> dict[str, object]:
        """The complete state for a restart, as arrays, numbers and text that the model will not change."""
        state: dict[str, object] = {
            "version": __version__,
            "scene": self._scene,
            "time": self.time,
            "last_duration": self._last_duration,
            **self._state.saved(self._known().floes),
        }
        state |= {f"floes_{name}": values for name, values in self.floes.columns().items()}
        for what, fluid in self._fluids.items():
            state |= {f"{what}_{name}": values.copy() for name, values in fluid.arrays().items()}
        return state

    def restore(self, state: dict[str, object]) -> None:
        """Restore the state of a model of the same scene; the run then continues with the same bits.

        Domain, grids with their dry cells, coast, and the kinds of laws, walls and inflows must be those of that model;
        drag, forcing, step (of the same kind of scheme) and threads may differ.  A different number of a contact law, of
        Coriolis, the density of the ice, the load of a wall or an inflow starts a branch of the run, with a warning.

        Raises
        ------
        InputError
            if the state does not fit this model, with table and key; the model is then unchanged.
        """
        if not isinstance(state, Mapping):
            raise InputError(
                f"state = {in_line(state)}: must be what `state` gives, or a restart file"
            )
        with alone(self, "restore"):
            branched = refuse_unlike(self.state(), state)
            names = [name.removeprefix("floes_") for name in state if name.startswith("floes_")]
            floes = Floes.of_columns({name: np.asarray(state[f"floes_{name}"]) for name in names})
            refuse_other_coast(self.floes, floes, self.domain)
            self._take_up(state, floes)
        if branched:
            warn(f"restart: goes on with {'; '.join(branched)}")

    def _take_up(self, state: Mapping[str, Any], floes: Floes) -> None:
        """Continue from a state that fits, with its floes."""
        if not floes.same(self.floes):  # else the floes are unchanged, and stay accepted
            self._accepted = None
        self.floes.go_back(floes)  # in place: references to the model's floes stay valid
        self.time = float(state["time"])
        self._last_duration = float(state["last_duration"])
        self._left, self._seen = None, self._see(floes.copy())
        for what, fluid in self._fluids.items():
            for name, values in fluid.arrays().items():
                values[:] = state[f"{what}_{name}"]
        self._advance().list_again(self._state.restore(state))

    # ---- in words ----------------------------------------------------------------------------------

    def absent(self) -> list[str]:
        """The parts that this model leaves out, with neither code nor memory."""
        c, listed = self.contact, {ACCOUNTS[type(force)] for force in self.forces}
        left_out = [
            ("contacts", c is None),
            ("friction", c is not None and c.friction is None),
            ("bonds", c is not None and c.bonds is None),
            ("dashpots", c is not None and c.dashpot is None),
            ("compressive failure", c is not None and c.failure is None),
            ("rotation", not self.floes.rotation),
            *((name, name not in listed) for name in dict.fromkeys(ACCOUNTS.values())),
            ("walls", not len(self._state.walls)),
            ("inflow", not self.inflow),
        ]
        return [name for name, missing in left_out if missing]

    def degrees_of_freedom(self) -> int:
        """Velocity components that the forces can change."""
        f = self.floes
        bits = f.motion[f.active].astype(int)
        axes = (FIXED_X, FIXED_Y, FIXED_ROTATION) if f.rotation else (FIXED_X, FIXED_Y)
        return sum(int(((bits & axis) == 0).sum()) for axis in axes)

    def __repr__(self) -> str:
        d = self.domain
        lines = [
            f"Model at t = {self.time:g} s",
            f"├─ domain: x {d.x[0]:g} … {d.x[1]:g} m, y {d.y[0]:g} … {d.y[1]:g} m; "
            f"west {d.west}, east {d.east}, south {d.south}, north {d.north}",
            f"├─ {self.floes!r}",
            f"├─ contact:{' none (free drift)' if self.contact is None else ''}",
        ]
        if self.contact is not None:
            lines += [f"│  ├─ {as_python(part)}" for part in self.contact if part is not None]
        lines.append(f"├─ forces:{'' if self.forces else ' none'}")
        for force in self.forces:
            fluid = fluid_of(force, self._fluids)
            lines.append(f"│  ├─ {force!r}" + (f" on {fluid.grid!r}" if fluid else ""))
            if isinstance(force, OceanDrag | AirDrag):
                low, high = self.bulk_range(force)
                lines.append(f"│  │    C_d of the floes' area: {low:.2g} … {high:.2g}")
        lines += [f"├─ {wall!r}" for wall in self.walls]
        lines += [f"├─ {inflow!r}" for inflow in self.inflow]
        lines.append(f"├─ {self.step!r}, sampling {self.sampling!r}")
        lines.append(f"└─ absent: {', '.join(self.absent()) or 'nothing'}")
        return "\n".join(lines)

    def bulk_range(self, drag: OceanDrag | AirDrag) -> tuple[float, float]:
        """Smallest and largest equivalent drag coefficient of the floes' area [1] (eq. ocean-drag)."""
        if not isinstance(drag, OceanDrag | AirDrag):
            raise InputError(f"drag = {in_line(drag)}: must be an OceanDrag or an AirDrag")
        check([drag])
        f = self.floes
        ice = f.active & ~f.land
        if not ice.any():
            return 0.0, 0.0
        share = self.draft_fraction
        side = f.thickness[ice] * (share if isinstance(drag, OceanDrag) else 1.0 - share)
        values = bulk_coefficient(drag, f.radius[ice], side)
        return float(values.min()), float(values.max())
