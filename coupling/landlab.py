"""Sea-ice floes as a Landlab component, on Landlab's cells and with Landlab's fields.

The exchange grid is Landlab's own: one polygonal cell per interior node, with Landlab's corners, so that the
sum over nodes of `area_of_cell` × area fraction equals the area of the floes to round-off, and the sum of
`area_of_cell` × stress equals the force that they exert on the water.  Values are at `node`; perimeter nodes have no cell, their outputs
are 0 and their inputs are not read.  Nodes whose status is "closed" are land, without water and drag.

Landlab models have water velocity on links, as one component along each link.  Map it to nodes before each step,
for instance with Landlab's own mapper,

    u, v = grid.map_link_vector_components_to_node(grid.at_link["surface_water__velocity"])

and do not keep references to the arrays: components may replace fields by new ones.  This component looks its inputs
up at each step.

An input field that the model's laws do not read must be zero: one that is not is refused rather than ignored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, get_args

import numpy as np
from landlab import (
    Component,
    FramedVoronoiGrid,
    HexModelGrid,
    RadialModelGrid,
    RasterModelGrid,
    VoronoiDelaunayGrid,
)
from landlab.data_record import DataRecord
from landlab.grid.base import ModelGrid

from coupling.books import Books
from coupling.connection import is_per_area
from coupling.ledger import Exchange
from floebmi.arrays import digest
from floebmi.boundaries import Domain, Edge, check_domain
from floebmi.coast import Coast, on_land
from floebmi.contact import Contact, frictional
from floebmi.errors import InputError, check_word
from floebmi.floes import Floes
from floebmi.forces import AirDrag, CoriolisField, Force, OceanDrag, Tilt
from floebmi.grid import Grid
from floebmi.gridding import area_budget
from floebmi.model import Model
from floebmi.packing import from_field, scatter
from floebmi.quantities import is_number, two_numbers
from floebmi.scene import read_scene
from floebmi.sizes import Sizes, UniformSize
from floebmi.variables import FLOE_VARIABLES, Variable, find, inputs, outputs

FRACTION, THICKNESS = find("area_fraction").csdms, find("thickness").csdms
_FLAT = (RasterModelGrid, HexModelGrid, RadialModelGrid, VoronoiDelaunayGrid, FramedVoronoiGrid)
_INPUTS, _OUTPUTS = inputs(), outputs()
_OF_FLOES = tuple(row for row in FLOE_VARIABLES if row.intent == "restart")


def cells_of(grid: ModelGrid) -> Grid:
    """The cells of a Landlab grid as an exchange grid, in Landlab's order; cells of closed nodes are dry.

    Parameters
    ----------
    grid : Raster, Hex, Radial, Voronoi or FramedVoronoi grid of Landlab

    Raises
    ------
    InputError
        (a ValueError) for networks and global grids, whose cells are not polygons in a plane, for grids without cells, and
        for a grid whose axes are stated to be in another unit than metres.
    """
    if not isinstance(grid, _FLAT):
        names = ", ".join(kind.__name__ for kind in _FLAT)
        raise InputError(f"{type(grid).__name__}: has no cells in a plane; must be one of {names}")
    if not grid.number_of_cells:
        raise InputError(
            f"{type(grid).__name__}: has no cells; must have nodes inside its perimeter"
        )
    for told in grid.axis_units:
        if told != "-" and not _is_in(told, "m"):  # "-": nobody told it
            raise InputError(
                f"{type(grid).__name__}: axis_units is {str(told)!r}; must be 'm', floes are counted in metres"
            )
    wet = grid.status_at_node[grid.node_at_cell] != grid.BC_NODE_IS_CLOSED
    return Grid.unstructured(grid.x_of_corner, grid.y_of_corner, grid.corners_at_cell, wet)


def _is_in(told: str, units: str) -> bool:
    """Whether the unit that a grid states ("?" if unknown, "-" for a dimensionless number) is this one."""
    if told in (units, "?", "") or (told == "-" and units == "1"):
        return True
    import cf_units

    try:
        return bool(cf_units.Unit(told) == cf_units.Unit(units))
    except ValueError:
        return False


def _info_of(row: Variable) -> dict[str, object]:
    text = f"{row.text}; {row.positive}" if row.positive else row.text
    return {
        "dtype": float,
        "intent": row.intent,
        "optional": False,
        "units": row.units,
        "mapping": "node",
        "doc": text[0].upper() + text[1:],
    }


class SeaIceFloes(Component):
    """Sea-ice floes as discrete elements that float on the water of other components.

    Floes drift with wind and water, collide, rub and jam (Damsgaard, Adcroft & Sergienko 2018,
    doi:10.1029/2018MS001299).  Water velocity, wind, sea-surface slope and Coriolis parameter are read at
    nodes; concentration, thickness, velocity, internal stress and the stress of the ice on the water are written there.

    Floes come from `floes`, from a scene file, from `concentration`, or, if none of these is given, from the fields
    `sea_ice__area_fraction` and `sea_ice__thickness` if the grid has them.  Without any of these there is no
    ice.  Input fields that the grid lacks are created, with zeros.

    Parameters
    ----------
    grid : ModelGrid
        Raster, Hex, Radial, Voronoi or FramedVoronoi.
    floes : Floes, optional
        The floes, in the coordinates of the grid.
    scene : path, optional
        A scene file or packaged scene, whose domain, floes, laws and walls are used on this grid's cells.
    concentration : float, optional
        Fraction of the domain to cover with floes at random places [1].
    thickness : float
        Thickness of floes made from `concentration` [m].
    sizes : (smallest, largest) or a size distribution, optional
        Radii [m] of floes made from a concentration or from fields.
    contact : Contact, optional
        Contact law; default: `floebmi.frictional()`.
    forces : sequence of forces, optional
        Default: drag of water and air, tilt and Coriolis, read from fields.
    edges : str
        What happens at the edges of the domain: "inactive" (floes leave), "closed" (a wall), or "periodic" (floes
        re-enter on the other side).  Looped sides of a raster are periodic in any case.
    domain : Domain, optional
        Domain to use instead of the box around the cells; must be periodic where the grid is looped.
    coast : Coast, optional
        Land that floes cannot cross; cells whose centre is on it are dry.
    seed : int
        Seed of the random places.
    rescue : path, optional
        File to which the state is saved if a step fails.

    Raises
    ------
    InputError
        (a ValueError) with a message of one line, for grids without cells, axes or fields stated to be in other units,
        more than one source of floes, arguments that would have no effect, and invalid numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from landlab import RasterModelGrid
    >>> from coupling.landlab import SeaIceFloes
    >>> from floebmi import Floes

    Two floes on a raster; a current along x takes them with it.

    >>> grid = RasterModelGrid((8, 12), xy_spacing=1000.0)
    >>> u = grid.add_zeros("sea_surface_water_flowing__x_component_of_velocity", at="node")
    >>> u += 0.5
    >>> floes = Floes(x=[2500.0, 4100.0], y=3000.0, radius=[800.0, 500.0], thickness=1.0)
    >>> ice = SeaIceFloes(grid, floes=floes)
    >>> for _ in range(6):
    ...     ice.run_one_step(600.0)
    ...

    Area is conserved, and the ice has gained the momentum that the water lost.

    >>> fraction = grid.at_node["sea_ice__area_fraction"][grid.node_at_cell]
    >>> bool(np.isclose((fraction * grid.area_of_cell).sum(), floes.area.sum(), rtol=1e-12))
    True
    >>> ice.area_outside < 1e-6
    True
    >>> bool(grid.at_node["sea_ice_flowing__x_component_of_velocity"].max() > 0.01)
    True
    >>> ice.ledger[-1].relative < 1e-12
    True

    The individual floes as a DataRecord; each is at the cell that contains its centre.

    >>> record = ice.data_record
    >>> record.dataset["element_id"].values.ravel().tolist()
    [22, 24]
    >>> record.dataset["sea_ice_floe__radius"].values.ravel().tolist()
    [800.0, 500.0]
    """

    _name = "SeaIceFloes"
    _unit_agnostic = False
    _cite_as = """
    @article{damsgaard2018application,
      title = {Application of Discrete-Element Methods to Approximate Sea Ice Dynamics},
      author = {Damsgaard, A. and Adcroft, A. and Sergienko, O.},
      journal = {Journal of Advances in Modeling Earth Systems},
      volume = {10}, number = {9}, pages = {2228--2244}, year = {2018},
      doi = {10.1029/2018MS001299}
    }
    """
    _info: ClassVar[dict[str, dict[str, object]]] = {
        row.csdms: _info_of(row) for row in (*_INPUTS, *_OUTPUTS)
    }

    def __init__(
        self,
        grid: ModelGrid,
        floes: Floes | None = None,
        scene: str | Path | None = None,
        concentration: float | None = None,
        thickness: float = 1.0,
        sizes: Sizes | Sequence[float] | None = None,
        contact: Contact | None = None,
        forces: Sequence[Force] | None = None,
        edges: Edge = "inactive",
        domain: Domain | None = None,
        coast: Coast | None = None,
        seed: int = 0,
        rescue: str | Path | None = None,
    ) -> None:
        cells = cells_of(grid)
        check_word("SeaIceFloes: edges", edges, get_args(Edge))
        _check_units(grid, "SeaIceFloes")
        for row in _INPUTS:
            if row.csdms not in grid.at_node:
                _refuse_elsewhere(grid, row.csdms)
        _refuse_integers(grid, "SeaIceFloes")
        given = {"floes": floes, "scene": scene, "concentration": concentration}
        sources = [name for name, value in given.items() if value is not None]
        if len(sources) > 1:
            raise InputError(f"SeaIceFloes: {' and '.join(sources)} are given: give one of them")
        if not isinstance(coast, Coast | None):
            raise InputError(f"SeaIceFloes: coast = {coast!r}: must be a Coast, or None")
        if not (concentration is not None or (is_number(thickness) and thickness == 1.0)):
            raise InputError(
                f"SeaIceFloes: thickness = {thickness!r} applies to floes made from a concentration: give one, or"
                " leave it out"
            )
        if floes is not None and sizes is not None:
            raise InputError(
                "SeaIceFloes: sizes is given beside floes, which have their own: leave it out"
            )
        if domain is not None and edges != "inactive":
            raise InputError("SeaIceFloes: edges is given beside a domain, which has its own")
        if scene is not None:
            laws = {
                "sizes": sizes, "contact": contact, "forces": forces, "domain": domain, "coast": coast,
                "edges": None if edges == "inactive" else edges, "seed": seed or None,
            }  # fmt: skip
            named = [name for name, value in laws.items() if value is not None]
            if named:
                raise InputError(f"SeaIceFloes: {named[0]} is given beside a scene: say it there")
            model = _of_scene(scene, cells)
            _check_looped(grid, cells, model.domain)
        else:
            domain = _box(grid, cells, edges) if domain is None else domain
            check_domain(domain)
            _check_looped(grid, cells, domain)
            if floes is None:
                floes = _made(grid, cells, domain, concentration, thickness, sizes, coast, seed)
            if coast is not None:
                floes = Floes.concatenate([floes, coast.floes])
                cells = _without(cells, coast.polygons, domain)
            model = Model(
                domain,
                floes,
                contact=frictional() if contact is None else contact,
                forces=(OceanDrag(), AirDrag(), CoriolisField(), Tilt())
                if forces is None
                else forces,
                grid=cells,
                seed=seed,
            )
        for row in (*_INPUTS, *_OUTPUTS):  # only once nothing is refused any more
            if row.csdms not in grid.at_node:
                grid.add_zeros(row.csdms, at="node", units=row.units)
        super().__init__(grid)
        self._model, self._rescue = model, rescue
        self._known_grid = _digest(grid)
        # far from the origin Landlab's own areas are off by a few digits; they are the host's
        self._stretch = cells.area / grid.area_of_cell
        self._books = Books(model)
        self._ledger: list[Exchange] = []
        self._show()
        self._shown = self._impulse()

    # ---- stepping ----------------------------------------------------------------------------------

    def run_one_step(self, dt: float) -> None:
        """Advance by `dt` ≥ 0 seconds as one exchange: read the inputs, move the ice, write the outputs.

        Raises
        ------
        InputError
            For an input that is not finite on a wet cell (naming field, node and time), a grid that has
            changed, or a negative `dt`.  The component is then as before the call, and its state is saved in `rescue`.
        """
        try:
            with self._books.unchanged_on_failure(self._rescue):
                self._step(dt)
        except Exception:
            self._show()  # of the state that was put back
            raise

    def _step(self, dt: float) -> None:
        if not (is_number(dt) and dt >= 0):
            raise InputError(f"run_one_step: dt = {dt!r}: must be a number of seconds, at least 0")
        if _digest(self._grid) != self._known_grid:
            raise InputError(
                "run_one_step: corners or boundary status of the grid have changed since"
                " SeaIceFloes was made; make a new one"
            )
        self._check_outputs("run_one_step")
        _check_units(self._grid, "run_one_step")
        self._take_inputs()
        self._books.open()
        self._model.advance(float(dt))
        self._show()
        shown = self._impulse()
        delivered = self._grid.area_of_cell @ (shown - self._shown)
        self._ledger.append(self._books.close(delivered, np.zeros(2)))
        self._shown = shown  # kept: another component may write there until the next step

    def _take_inputs(self) -> None:
        model = self._model
        for row in _INPUTS:
            if row.csdms not in self._grid.at_node:
                raise InputError(f"{row.csdms}: is not at the grid's nodes; SeaIceFloes reads it")
            values = self._grid.at_node[row.csdms][self._grid.node_at_cell]
            wrong = ~np.isfinite(values) & model.grid.wet
            if wrong.any():
                cell = int(np.argmax(wrong))
                raise InputError(
                    f"{row.csdms}: {values[cell]} at node {self._grid.node_at_cell[cell]} at"
                    f" t = {model.time:g} s: must be finite"
                )
            array = row.array_in(model)
            if array is not None:
                array[:] = np.where(model.grid.wet, values, 0.0)
            elif values[model.grid.wet].any():
                raise InputError(
                    f"{row.csdms} is not zero, but none of the forces of SeaIceFloes reads it; list the"
                    " force that does, or leave the field at 0"
                )

    def _check_outputs(self, what: str) -> None:
        """Raise InputError for an output field that is missing, or is of integers, which would truncate it."""
        for row in _OUTPUTS:
            if row.csdms not in self._grid.at_node:
                raise InputError(
                    f"{what}: {row.csdms} is not at the grid's nodes; SeaIceFloes writes it"
                )
        _refuse_integers(self._grid, what)

    def _show(self) -> None:
        fields, node = self._model.fields(), self._grid.node_at_cell
        for row in _OUTPUTS:
            if row.csdms not in self._grid.at_node:
                continue  # the step that found it missing has failed, and the other fields are restored
            array = self._grid.at_node[row.csdms]
            array[:] = 0.0
            if row.name in fields:  # a scene without wind has no stress of the air
                array[node] = fields[row.name] * (self._stretch if is_per_area(row.csdms) else 1.0)

    def _impulse(self) -> np.ndarray:
        """Impulse per area that the water has received since the start, from the fields: (cells, 2) [Pa s]."""
        names = (find("ocean_impulse_x").csdms, find("ocean_impulse_y").csdms)
        node = self._grid.node_at_cell
        return np.stack([self._grid.at_node[name][node] for name in names], axis=1)

    # ---- to look at --------------------------------------------------------------------------------

    @property
    def model(self) -> Model:
        """The underlying `Model`."""
        return self._model

    @property
    def ledger(self) -> list[Exchange]:
        """The momentum ledger on Landlab's cells, one line per step."""
        return self._ledger

    @property
    def area_outside(self) -> float:
        """Area of floes, or parts of floes, outside all cells [m²]."""
        return area_budget(self._model.grid, self._model.coverage()).outside

    @property
    def mass_outside(self) -> float:
        """Mass of the ice outside all cells [kg]."""
        model = self._model
        return float(model.ice_density * (model.coverage().outside @ model.floes.thickness))

    @property
    def data_record(self) -> DataRecord:
        """The floes as they are now, one item per floe, at the cell that contains its centre (-1: none)."""
        model, floes = self._model, self._model.floes
        ice = np.flatnonzero(~floes.land)
        cell = model.grid.locate(floes.x[ice], floes.y[ice])
        variables = {
            row.csdms: (["item_id", "time"], np.asarray(getattr(floes, row.name))[ice, np.newaxis])
            for row in _OF_FLOES
            if getattr(floes, row.name) is not None
        }
        return DataRecord(
            self._grid,
            dummy_elements={"cell": [-1]},
            time=[model.time],
            items={"grid_element": "cell", "element_id": cell[:, np.newaxis]},
            data_vars=variables,
            attrs={"time_units": "s"},
        )

    # ---- restart -----------------------------------------------------------------------------------

    def save_state(self, path: str | Path) -> None:
        """Save a restart file with all that `load_state` needs for a bit-identical continuation."""
        self._books.save(path)

    def load_state(self, path: str | Path) -> None:
        """Load a state that `save_state` or a failed step wrote, for the same grid and laws."""
        self._check_outputs("load_state")
        self._books.load(path)
        self._show()
        self._shown = self._impulse()


def _made(
    grid: ModelGrid,
    cells: Grid,
    domain: Domain,
    concentration: float | None,
    thickness: float,
    sizes: Sizes | Sequence[float] | None,
    coast: Coast | None,
    seed: int,
) -> Floes:
    """Floes from a concentration, or from the grid's own fields if it has them."""
    fields = grid.at_node
    there = [name for name in (FRACTION, THICKNESS) if name in fields]
    if concentration is None and len(there) == 1:
        raise InputError(
            f"SeaIceFloes: the grid has {there[0]} alone; floes need {FRACTION} and {THICKNESS}"
        )
    if concentration is None and not there and sizes is not None:
        raise InputError(
            "SeaIceFloes: sizes is given, but nothing that asks for floes: neither a concentration nor the"
            f" fields {FRACTION} and {THICKNESS}"
        )
    if concentration is None and not (there and fields[FRACTION][grid.node_at_cell].any()):
        return Floes([], [], [], [])
    if sizes is None:
        raise InputError(
            "SeaIceFloes: sizes is missing: (smallest, largest) radius [m] of the floes that are"
            " made from a concentration"
        )
    if isinstance(sizes, Sequence | np.ndarray) and not hasattr(sizes, "_fields"):
        radii = two_numbers(sizes)
        if radii is None:
            raise InputError(f"SeaIceFloes: sizes = {sizes}: must be (smallest, largest) [m]")
        sizes = UniformSize(*radii)
    if concentration is not None:
        return scatter(domain, sizes, concentration, thickness=thickness, seed=seed, land=coast)
    at_cell = [fields[name][grid.node_at_cell] for name in (FRACTION, THICKNESS)]
    return from_field(cells, *at_cell, sizes, domain=domain, seed=seed, land=coast)


def _of_scene(scene: str | Path, cells: Grid) -> Model:
    """The model of a scene, on other cells."""
    read = read_scene(scene)
    own = read.build()
    model, water = own.model, own.model.ocean
    tilted = (
        water is not None
        and water.tilt_x is not None
        and (water.tilt_x.any() or water.tilt_y.any())
    )
    turned = water is not None and water.coriolis is not None and water.coriolis.any()
    for name, driven, instead in (
        ("ocean", read.ocean and (read.ocean.velocity or read.ocean.file), "leave them out"),
        (
            "atmosphere",
            read.atmosphere and (read.atmosphere.velocity or read.atmosphere.file),
            "leave them out",
        ),
        ("tilt", tilted, "leave them out"),
        ("coriolis", turned, "give parameter = 0, or leave field out"),
    ):
        if driven:
            raise InputError(
                f"{read.file}: [{name}] has numbers of its own; here they come from the grid's fields: {instead}"
            )
    made = Model(
        model.domain, model.floes, model.contact, model.forces, _without(cells, own.land, model.domain), model.walls,
        model.inflow, model.step, model.sampling, model.ice_density, model.draft_fraction,
        model.floes.rotation, model.seed, threads=model.threads,
    )  # fmt: skip
    if water is not None:
        made.ocean.layer_thickness = water.layer_thickness
    return made


def _without(cells: Grid, land: list[np.ndarray], domain: Domain) -> Grid:
    """The grid with cells dry whose centre is on land."""
    return cells.with_wet(cells.wet & ~on_land(land, cells.x, cells.y, domain)) if land else cells


def _box(grid: ModelGrid, cells: Grid, edges: str) -> Domain:
    """The box around the cells, but not beyond the nodes: rim cells of a Voronoi grid can extend very far."""
    west, east, south, north = cells.bounds
    x, y = grid.x_of_node, grid.y_of_node
    along_x, along_y = ("periodic" if looped else edges for looped in _looped(grid))
    return Domain(
        (max(west, float(x.min())), min(east, float(x.max()))),
        (max(south, float(y.min())), min(north, float(y.max()))),
        along_x, along_x, along_y, along_y,
    )  # fmt: skip


def _looped(grid: ModelGrid) -> tuple[bool, bool]:
    """Whether the west and east sides, and the south and north sides, are periodic images of each other.

    Landlab links a looped node to the first one inside the other side, so the cells make up one period.
    """
    looped = grid.status_at_node == grid.BC_NODE_IS_LOOPED
    if not looped.any():
        return False, False
    if isinstance(grid, RasterModelGrid):
        rows = looped.reshape(grid.shape)
        sides = rows[1:-1, [0, -1]], rows[[0, -1], 1:-1]
        if not rows[1:-1, 1:-1].any() and all(side.all() or not side.any() for side in sides):
            return bool(sides[0].any()), bool(sides[1].any())
    raise InputError(
        f"{type(grid).__name__}: has looped nodes that are not two whole sides of a raster; use set_looped_boundaries"
    )


def _check_looped(grid: ModelGrid, cells: Grid, domain: Domain) -> None:
    """Raise InputError if the grid is looped where the domain is not periodic, or the periods differ."""
    own = _box(grid, cells, "inactive")
    for axis, wanted, length in zip("xy", own.period, domain.period, strict=True):
        if wanted is not None and (length is None or not math.isclose(length, wanted)):
            raise InputError(
                f"SeaIceFloes: the grid is looped along {axis}, but domain.{axis} = {getattr(domain, axis)} is not"
                f" periodic over {wanted:g} m; make it so, or leave the domain out"
            )


def _check_units(grid: ModelGrid, what: str) -> None:
    """Raise InputError for a field that the grid states to be in another unit than this component uses."""
    told = grid.at_node.units
    for row in (*_INPUTS, *_OUTPUTS):
        if row.csdms in grid.at_node and not _is_in(told[row.csdms], row.units):
            raise InputError(
                f"{what}: {row.csdms} is in {told[row.csdms]!r}; must be in {row.units!r}, nothing is converted here"
            )


def _refuse_integers(grid: ModelGrid, what: str) -> None:
    """Raise InputError for an output field of integers, which would truncate it."""
    for row in _OUTPUTS:
        if row.csdms in grid.at_node and grid.at_node[row.csdms].dtype.kind != "f":
            raise InputError(
                f"{what}: {row.csdms} has dtype {grid.at_node[row.csdms].dtype}: must be float, it is written in place"
            )


def _refuse_elsewhere(grid: ModelGrid, name: str) -> None:
    """Raise InputError for an input field that exists, but not at nodes: it would not be read."""
    for element in sorted(grid.groups - {"node"}):
        if grid.has_field(name, at=element):
            raise InputError(f"{name}: is at {element}; must be at node, where it is read")


def _digest(grid: ModelGrid) -> str:
    return digest(grid.x_of_corner, grid.y_of_corner, grid.corners_at_cell, grid.status_at_node)
