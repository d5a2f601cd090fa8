"""What a scene will model and why, what it leaves out, and what it will cost; nothing is run for that."""

import re
from typing import TYPE_CHECKING

import numpy as np

from floebmi import calibration
from floebmi.boundaries import EDGES
from floebmi.contact import turns
from floebmi.floes import FIXED
from floebmi.forces import AirDrag, Coriolis, CoriolisField, GeostrophicTilt, OceanDrag, Tilt
from floebmi.running import duration_text
from floebmi.sampling import floe_weights, without_cell
from floebmi.scene_physics import EARTH_ROTATION

if TYPE_CHECKING:
    from floebmi.boundaries import Domain
    from floebmi.grid import Grid
    from floebmi.model import Model
    from floebmi.scene import Built, Scene, Schedule
    from floebmi.scene_physics import FluidTable

# Floe-steps per second of packaged scenes, exchanges and output included, on one core like those of
# docs/benchmarks.md; until it is measured here
SPEED = {"free drift": 60e6, "cohesive": 45e6, "frictional": 40e6}
DRAG_SLOWS = 0.7  # with drag of ocean and air
USUAL_DRAG = (1e-3, 1e-2)  # bulk coefficients that observations give [1]
OF_OCEAN = {  # what acts only where there are wet cells of the ocean
    OceanDrag: "ocean drag", CoriolisField: "Coriolis force", Tilt: "tilt", GeostrophicTilt: "tilt",
}  # fmt: skip


def explain(scene: "Scene", built: "Built") -> str:
    """A page of text for a person, from a scene and the model made of it."""
    model = built.model
    title = f"{scene.name}: {scene.title}" if scene.title else scene.name
    parts = [
        title,
        _columns("modelled", _modelled(scene, model)),
        f"left out, neither code nor memory: {', '.join(model.absent()) or 'nothing'}",
        _columns("size", _size(scene, model)),
    ]
    dials = _dials(scene)
    if dials:
        parts.append(_columns("dials, as floebmi tradeoff measured them", dials))
    lines = notes(model)
    if lines:
        parts.append("\n".join(f"note: {line}" for line in lines))
    return "\n\n".join(parts)


def notes(model: "Model") -> list[str]:
    """Lines on what a modeller may not expect: a coast that stops no floe; a Coriolis parameter of another planet; a drag
    coefficient, taken on the floes' area, that is unusual; floes over dry cells, without drag, tilt and a Coriolis force by
    cell; a grid that leaves a part of the domain out."""
    lines = []
    if model.contact is None and model.floes.land.any():
        lines.append("without [contact] the coast stops no floe: ice drifts over land")
    for force in model.forces:
        if isinstance(force, Coriolis) and abs(force.parameter) > 2 * EARTH_ROTATION:
            lines.append(
                f"a Coriolis parameter of {force.parameter:g} 1/s is beyond ±{2 * EARTH_ROTATION:.4g} 1/s, those of the "
                "Earth; a large one takes many sub-steps"
            )
        if not isinstance(force, OceanDrag | AirDrag):
            continue
        name, table = ("ocean", "ocean") if isinstance(force, OceanDrag) else ("air", "atmosphere")
        low, high = model.bulk_range(force)
        if high and (low < USUAL_DRAG[0] or high > USUAL_DRAG[1]):
            lines.append(
                f"{name} drag on these floes is that of C_d = {low:.2g} to {high:.2g} on their area, "
                f"outside {USUAL_DRAG[0]:g} to {USUAL_DRAG[1]:g}; [{table}] drag sets it"
            )
    grids: dict[int, tuple[Grid, list[str], list[str]]] = {}  # by nodes, which fluids may share
    for name, fluid, forces in (
        ("ocean", model.ocean, OF_OCEAN),
        ("air", model.atmosphere, {AirDrag: "air drag"}),
    ):
        read = [forces[type(force)] for force in model.forces if type(force) in forces]
        if fluid is None or not read:
            continue
        over, free = _over_dry_cells(fluid.grid, model)
        coast = model.floes.land.any()
        if over or not (coast or fluid.grid.wet.all()):
            lines.append(
                f"a floe over dry cells alone has no {' or '.join(read)} ({over} of {free} floes now)"
                + ("" if coast else "; no [coast] keeps floes off them")
            )
        _, names, lost = grids.setdefault(id(fluid.grid.node_x), (fluid.grid, [], []))
        names.append(name)
        lost += read
    for grid, names, lost in grids.values():
        out = _left_out(grid, model.domain)
        if out:
            lines.append(
                f"about {100 * out:.3g} % of the domain lies outside the cells of the {' and the '.join(names)}: floes have"
                f" no {' or '.join(lost)} there, and are in no field; a [grid] that covers [domain] has none"
                " of that"
            )
    return lines


def _over_dry_cells(grid: "Grid", model: "Model") -> tuple[int, int]:
    """Number of free floes that touch cells of a grid but none that is wet, and of all free floes."""
    f = model.floes
    x, y, radius = (a[f.active & (f.motion == 0)] for a in (f.x, f.y, f.radius))
    if grid.wet.all():
        return 0, x.size
    seen = floe_weights(grid, x, y, radius, model.sampling, model.domain.period)
    return int(np.count_nonzero(without_cell(seen) & (grid.locate(x, y) >= 0))), x.size


def _left_out(grid: "Grid", domain: "Domain") -> float:
    """Share of the domain without a cell of the grid, wet or dry: of 100 × 100 places in it."""
    share = (np.arange(100) + 0.5) / 100
    x, y = np.meshgrid(*(low + share * (high - low) for low, high in (domain.x, domain.y)))
    east, north = ((0.0,) if length is None else (-length, 0.0, length) for length in domain.period)
    held = [grid.locate(x.ravel() + dx, y.ravel() + dy) >= 0 for dx in east for dy in north]
    return 1.0 - float(np.any(held, axis=0).mean())


def _dials(scene: "Scene") -> list[tuple[str, str]]:
    """What each setting would change, if that is stored beside the scene."""
    from floebmi.tradeoff_result import AS_IT_IS, result

    data = result(scene)
    if data is None:
        return []
    of, base = data.attrs["of"], float(data.cost_per_day.sel(setting=""))
    errors = data.error.sel(quantity=of)
    order = data.setting.values[np.argsort(data.cost_per_day.values)]
    return [
        (
            str(s) or AS_IT_IS,
            f"{base / float(data.cost_per_day.sel(setting=s)):.3g} × the speed, "
            f"error of {of} {float(errors.sel(setting=s)):.2g}",
        )
        for s in order
        if s != data.attrs["reference"] and np.isfinite(errors.sel(setting=s))
    ]


def _columns(head: str, rows: list[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return "\n".join([f"{head}:", *(f"  {name:<{width}}  {text}" for name, text in rows)])


def _modelled(scene: "Scene", model: "Model") -> list[tuple[str, str]]:
    """Each piece of physics, and what in the scene asks for it."""
    floes, contact, domain = model.floes, model.contact, model.domain
    free = int(np.count_nonzero(floes.active & (floes.motion == 0)))
    held = int(np.count_nonzero(floes.active & (floes.motion != 0)))
    text = f"{free} free" + (f", {held} of prescribed motion" if held else "")
    if len(floes):
        text += f"; radius {_span(floes.radius)} m, thickness {_span(floes.thickness)} m"
    each = ", ".join(f"{edge} {getattr(domain, edge)}" for edge in EDGES)
    alike = len({getattr(domain, edge) for edge in EDGES}) == 1
    rows = [("floes", text), ("edges", f"all {domain.west}" if alike else each)]
    if contact is not None:
        rows += [
            (type(part).__name__, f"{_numbers(part)}; [contact] asks for it")
            for part in contact
            if part is not None
        ]
    if floes.rotation:
        why = (
            "friction turns floes" if contact and contact.friction
            else "bonds that bend turn floes" if turns(contact)
            else "[ice] rotation asks for it"
        )  # fmt: skip
        rows.append(("rotation", f"because {why}"))
    for force in model.forces:
        name = type(force).__name__
        text = f"{_numbers(force)}; [{table_of_force(type(force))}] asks for it"
        if isinstance(force, OceanDrag | AirDrag):
            ocean = isinstance(force, OceanDrag)
            text += "; " + _drives(scene.ocean if ocean else scene.atmosphere)
        rows.append((name, text))
    if scene.coast is not None:
        rows.append(("coast", f"{int(floes.land.sum())} fixed floes line the shore; [coast]"))
    rows += [("wall", f"{wall.edge}; [[walls]]") for wall in model.walls]
    rows += [("inflow", f"{inflow.edge}, {inflow.sizes}; [inflow]") for inflow in model.inflow]
    if model.ocean is not None or model.atmosphere is not None:
        rows.append(("exchange grid", repr(model.grid)))
    return rows


def table_of_force(kind: type) -> str:
    """The table of a scene that asks for a force: its own name, but that of the fluid for drag."""
    others = {
        OceanDrag: "ocean", AirDrag: "atmosphere", CoriolisField: "coriolis", GeostrophicTilt: "tilt"
    }  # fmt: skip
    return others.get(kind) or re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__).lower()


def _drives(table: "FluidTable") -> str:
    if table.file is not None:
        return f"velocity from {table.file}"
    if table.velocity is not None:
        return f"velocity {table.velocity} m/s"
    return "at rest, or set by a host"


def _size(scene: "Scene", model: "Model") -> list[tuple[str, str]]:
    """Degrees of freedom, step, memory, cost."""
    floes = model.floes
    moving = int(np.count_nonzero(floes.active & ~floes.land & (floes.motion != FIXED)))
    freedom = f"{model.degrees_of_freedom()} velocity components of {moving} floes"
    rows = [("degrees of freedom", freedom)]
    model.longest_step()  # which makes the arrays that the steps work on
    held = sum(array.nbytes for array in arrays_of(model).values())
    rows.append(("memory", f"about {held / 1e6:.3g} MB for arrays at the start"))
    if scene.time.duration is None:
        return [*rows, ("step", _step_text(model, np.inf))]
    schedule = scene.schedule()
    rows.append(("step", _step_text(model, schedule.exchange)))
    intervals = (
        f"{duration_text(schedule.duration)}, exchange every {duration_text(schedule.exchange)}, "
        f"a frame every {duration_text(schedule.every)}"
    )
    return [*rows, ("duration", intervals), ("cost", _cost_text(model, schedule))]


def arrays_of(*things: object) -> dict[int, np.ndarray]:
    """Each array that can be reached from things of this package, by its id; a view counts as the array that it views."""
    seen: set[int] = set()
    found, left = {}, list(things)
    while left:
        thing = left.pop()
        while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
            thing = thing.base
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            found[id(thing)] = thing
        elif isinstance(thing, tuple | list):
            left += thing
        elif isinstance(thing, dict):
            left += thing.values()
        elif type(thing).__module__.startswith("floebmi"):  # floes and fluids have slots
            names = getattr(thing, "__slots__", None) or getattr(thing, "__dict__", ())
            left += [getattr(thing, name) for name in names]
    return found


def _cost_text(model: "Model", schedule: "Schedule") -> str:
    steps = schedule.duration / min(model.longest_step(), schedule.exchange)
    floes = int(np.count_nonzero(model.floes.active))
    exchanges = np.ceil(schedule.duration / schedule.exchange)
    cells = sum(fluid.grid.size for fluid in (model.ocean, model.atmosphere) if fluid is not None)
    cost = calibration.stored(model)
    if cost is not None:
        seconds, how = cost.of(steps, exchanges, floes, cells), "as measured on this machine"
    else:
        speed = _speed(model)
        seconds = steps * floes / speed
        how = (
            f"if this machine does {speed / 1e6:.0f} million floe-steps/s: --calibrate measures it"
        )
    return (
        f"{steps:.3g} steps of {floes} floes, {exchanges:.0f} exchanges: about {duration_text(seconds)} {how}; "
        "start, forcing from files and output come on top, and some 20 s once to compile"
    )


def _step_text(model: "Model", exchange: float) -> str:
    step, longest = model.step, model.longest_step()
    if step.length is not None:
        return f"{longest:.4g} s, as [step] length says ({step.scheme})"
    if not np.isfinite(longest) or longest >= exchange:
        return f"one per exchange, or more where drag acts faster: nothing stiff limits it ({step.scheme})"
    if step.epsilon is not None:
        return f"{longest:.4g} s: Eq. 4 with ε = {step.epsilon:g} ({step.scheme})"
    floes = model.floes
    ice = np.flatnonzero(floes.active & ~floes.land & (floes.motion != FIXED))
    smallest = ice[np.argmin(floes.radius[ice])]
    return (
        f"{longest:.4g} s at the start: {step.fraction:g} of the stability limit 2/ω_max, from the stiffness "
        f"of the contacts; the smallest floe (r = {floes.radius[smallest]:.4g} m) counts most ({step.scheme})"
    )


def _speed(model: "Model") -> float:
    contact = model.contact
    kind = "free drift" if contact is None else "frictional" if contact.friction else "cohesive"
    return SPEED[kind] * (DRAG_SLOWS if model.forces else 1.0)


def _span(values: np.ndarray) -> str:
    low, high = values.min(), values.max()
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _numbers(law: tuple) -> str:
    parts = [
        f"{name} ({_numbers(value)})" if hasattr(value, "_asdict") else f"{name} {value:.4g}"
        for name, value in law._asdict().items()
        if value is not None
    ]
    return ", ".join(parts) or "its field"
