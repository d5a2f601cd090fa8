"""The floes: one array per property; a floe's index is its number for the whole run.

Nothing moves here.  The model copies these arrays into its kernels and back at each advance, so
between advances they may be read and edited like any other array (`floes.u[3] = 0.1`).  A floe that
leaves the domain keeps its number and becomes inactive; new floes are appended.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from floebmi.arrays import all_finite, same_bits
from floebmi.errors import InputError, check_word, in_line
from floebmi.quantities import FARTHEST, check_flag, is_number, unmasked

FIXED_X = 1  # the floe keeps its velocity along x
FIXED_Y = 2
FIXED_ROTATION = 4
FIXED = FIXED_X | FIXED_Y | FIXED_ROTATION  # with zero velocity
DRIVEN = FIXED  # with the velocity that the floe was given
LAND = 8  # a piece of coast: no ice, no drag, no mass; always together with FIXED
COAST = FIXED | LAND

_TYPES: dict[str, type] = {
    **dict.fromkeys(("x", "y", "u", "v", "radius", "thickness"), np.float64),
    "active": np.bool_,
    "motion": np.int8,
}
_ROTATION_TYPES: dict[str, type] = {"angle": np.float64, "angular_velocity": np.float64}
_OWN_TYPES: dict[str, type] = {"friction": np.float64, "tensile_strength": np.float64}
_UNITS = {
    "x": "m",
    "y": "m",
    "u": "m/s",
    "v": "m/s",
    "radius": "m",
    "thickness": "m",
    "angle": "rad",
    "angular_velocity": "rad/s",
    "friction": "",
    "tensile_strength": "Pa",
}


class _Column:
    """A property of all floes; assignment writes into the existing array, to which there may be other references."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, floes: "Floes", owner: type | None = None) -> np.ndarray:
        if floes is None:
            return self  # type: ignore[return-value]
        return floes._columns[self.name][: len(floes)]

    def __set__(self, floes: "Floes", values: ArrayLike) -> None:
        if self.name not in floes._columns:
            why = (
                "these floes do not rotate; allow_rotation() first"
                if self.name in _ROTATION_TYPES
                else "all floes are alike; list a spread in the contact law"
            )
            raise InputError(f"floes.{self.name}: {why}")
        given = _motion_bits(values) if self.name == "motion" else _numbers(self.name, values)
        if given.shape not in ((), (len(floes),)):
            raise InputError(
                f"{self.name} has shape {given.shape}: must be one number or {len(floes)} values, one per floe"
            )
        floes._columns[self.name][: len(floes)] = given


class _OptionalColumn(_Column):
    """A property that exists only if the scene needs it; None otherwise."""

    def __get__(self, floes: "Floes", owner: type | None = None) -> np.ndarray | None:
        if floes is not None and self.name not in floes._columns:
            return None
        return super().__get__(floes, owner)


class Floes:
    """Circular floes of uniform thickness.

    Parameters
    ----------
    x, y : centres [m]
    radius, thickness : radius and thickness [m], greater than 0 and less than 1e9 m
    u, v : velocity [m/s]
    motion : which components of the motion are prescribed, as a sum of `FIXED_X` (1), `FIXED_Y` (2)
        and `FIXED_ROTATION` (4); 0: free.  `FIXED` (7) with zero velocity is a fixed floe, with a
        velocity a driven one; `COAST` (15) is a piece of land.
    rotation : whether the floes have an angle and an angular velocity
    angle, angular_velocity : [rad], [rad/s], counter-clockwise positive; only with `rotation=True`

    Each is one number for all floes or an array of shape (n,).

    Attributes
    ----------
    x, y, u, v, radius, thickness, active, motion : arrays of shape (n,)
    angle, angular_velocity : arrays of shape (n,), or None if the floes do not rotate
    friction, tensile_strength : each floe's own μ [1] and σ_c [Pa], shape (n,), if the contact law
        gives them a spread, else None; NaN for new floes until the model has drawn their values

    The arrays are views of storage that grows by doubling: after `add`, get them from the floes again.

    Raises
    ------
    InputError
        naming the floe and the value, for a value that is not finite or out of bounds.

    Examples
    --------
    >>> floes = Floes(x=[0.0, 25.0], y=0.0, radius=[10.0, 12.0], thickness=1.0)
    >>> floes
    Floes(n=2, radius 10 to 12 m, thickness 1 m, area 766.5 m²)
    >>> floes.add(x=50.0, y=0.0, radius=5.0, thickness=1.0, u=-0.1)
    array([2])
    >>> floes.mass(density=934.0).round(1)
    array([293424.8, 422531.6,  73356.2])
    """

    __slots__ = "_n", "_columns"  # so that a misspelled property is an error, not a new attribute

    x = _Column()
    y = _Column()
    u = _Column()
    v = _Column()
    radius = _Column()
    thickness = _Column()
    active = _Column()
    motion = _Column()
    angle = _OptionalColumn()
    angular_velocity = _OptionalColumn()
    friction = _OptionalColumn()
    tensile_strength = _OptionalColumn()

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        radius: ArrayLike,
        thickness: ArrayLike,
        u: ArrayLike = 0.0,
        v: ArrayLike = 0.0,
        motion: ArrayLike = 0,
        rotation: bool = False,
        angle: ArrayLike = 0.0,
        angular_velocity: ArrayLike = 0.0,
    ) -> None:
        check_flag("rotation", rotation)
        types = _TYPES | _ROTATION_TYPES if rotation else _TYPES
        self._n = 0
        self._columns = {name: np.empty(0, kind) for name, kind in types.items()}
        self.add(x, y, radius, thickness, u, v, motion, angle, angular_velocity)

    def __len__(self) -> int:
        return self._n

    def __repr__(self) -> str:
        if not len(self):
            return "Floes(n=0)"
        parts = [f"n={len(self)}"]
        for name in ("radius", "thickness"):
            low, high = getattr(self, name).min(), getattr(self, name).max()
            span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            parts.append(f"{name} {span} m")
        parts.append(f"area {self.area.sum():.4g} m²")
        for count, what in (
            (int(np.count_nonzero(self.motion)), "with prescribed motion"),
            (int(np.count_nonzero(~self.active)), "inactive"),
        ):
            if count:
                parts.append(f"{count} {what}")
        return f"Floes({', '.join(parts)})"

    @property
    def rotation(self) -> bool:
        """Whether the floes have an angle and an angular velocity."""
        return "angle" in self._columns

    @property
    def land(self) -> np.ndarray:
        """True for floes that are pieces of coast rather than ice, bool of shape (n,)."""
        return (self.motion & LAND) != 0

    @property
    def area(self) -> np.ndarray:
        """Areas π r² [m²], shape (n,)."""
        return np.pi * self.radius**2

    @property
    def volume(self) -> np.ndarray:
        """Volumes π r² h [m³], shape (n,)."""
        return self.area * self.thickness

    def mass(self, density: float) -> np.ndarray:
        """Masses ρ π r² h [kg], shape (n,), for ice of the given density [kg/m³]."""
        if not (is_number(density) and density > 0):
            raise InputError(f"density = {in_line(density)}: must be greater than 0 kg/m³")
        return density * self.volume

    def moment_of_inertia(self, density: float) -> np.ndarray:
        """Moments of inertia m r² / 2 about the floes' axes [kg m²], shape (n,), for ice of the given density [kg/m³]."""
        return 0.5 * self.mass(density) * self.radius**2

    def add(
        self,
        x: ArrayLike,
        y: ArrayLike,
        radius: ArrayLike,
        thickness: ArrayLike,
        u: ArrayLike = 0.0,
        v: ArrayLike = 0.0,
        motion: ArrayLike = 0,
        angle: ArrayLike = 0.0,
        angular_velocity: ArrayLike = 0.0,
    ) -> np.ndarray:
        """Append floes; parameters as for `Floes`.

        Returns
        -------
        The numbers of the new floes, shape (k,).

        Raises
        ------
        InputError
            as `Floes`; no floe is added then.
        """
        given = {
            "x": x, "y": y, "radius": radius, "thickness": thickness, "u": u, "v": v,
            "angle": angle, "angular_velocity": angular_velocity,
        }  # fmt: skip
        values = {name: _numbers(name, value) for name, value in given.items()}
        values["motion"] = _motion_bits(motion)
        k = _common_length(values)
        first = self._n
        for name, value in values.items():
            _check(name, value, first)
            if name not in self._columns and np.any(value):
                raise InputError(f"{name} is given for floes that do not rotate; set rotation=True")
        _check_coast(values, first)
        self._reserve(first + k)
        self._n += k
        for name, column in self._columns.items():
            column[first : first + k] = (
                np.nan if name in _OWN_TYPES else True if name == "active" else values[name]
            )
        return np.arange(first, first + k)

    def allow_rotation(self) -> None:
        """Give the floes an angle and an angular velocity, both zero, unless they have them already."""
        capacity = len(self._columns["x"])
        for name, kind in _ROTATION_TYPES.items():
            self._columns.setdefault(name, np.zeros(capacity, kind))

    def allow_own(self, name: str) -> None:
        """Give each floe its own "friction" or "tensile_strength" (NaN), unless the floes have it already."""
        check_word("name", name, _OWN_TYPES)
        capacity = len(self._columns["x"])
        self._columns.setdefault(name, np.full(capacity, np.nan, _OWN_TYPES[name]))

    def check(self) -> None:
        """Check that all values are finite and within bounds, for instance after editing the arrays.

        Raises
        ------
        InputError
            naming the first wrong floe and value.
        """
        _motion_bits(self.motion)
        for name in self._columns:
            _check(name, getattr(self, name), 0)
        _check_coast({name: getattr(self, name) for name in self._columns}, 0)

    def same(self, other: "Floes", names: Iterable[str] | None = None) -> bool:
        """Whether other floes have bit-identical values, floe by floe.

        names : names of the properties to compare (absent ones are ignored); default: all
        """
        if other is self:
            return True
        _check_kind(other)
        n, mine, others = self._n, self._columns, other._columns
        return (
            n == other._n
            and mine.keys() == others.keys()
            and all(
                same_bits(mine[name][:n], others[name][:n])
                for name in mine
                if names is None or name in names
            )
        )

    def copy(self) -> "Floes":
        """An independent copy, with the same numbers and values."""
        return self._some(slice(None))

    def columns(self) -> dict[str, np.ndarray]:
        """A copy of each property, by name."""
        return {name: getattr(self, name).copy() for name in self._columns}

    @classmethod
    def of_columns(cls, columns: Mapping[str, np.ndarray]) -> "Floes":
        """Floes with such properties as `columns` gives; InputError as `Floes`."""
        own = [name for name in _OWN_TYPES if name in columns]
        given = {name: values for name, values in columns.items() if name not in ("active", *own)}
        floes = cls(**given, rotation="angle" in columns)
        floes.active[:] = columns["active"].astype(bool)
        for name in own:
            floes.allow_own(name)
            setattr(floes, name, columns[name])
        return floes

    def _some(self, rows: slice | np.ndarray) -> "Floes":
        floes = Floes.__new__(Floes)
        floes._columns = {name: getattr(self, name)[rows].copy() for name in self._columns}
        floes._n = len(floes._columns["x"])
        return floes

    def go_back(self, earlier: "Floes") -> None:
        """Take over the values of an earlier copy, or of a restart file, in the same arrays if they are large enough."""
        _check_kind(earlier)
        self._columns = {name: self._columns[name] for name in earlier._columns}
        self._reserve(len(earlier))
        self._n = len(earlier)
        for name, column in self._columns.items():
            column[: self._n] = getattr(earlier, name)

    @staticmethod
    def concatenate(groups: Iterable["Floes"]) -> "Floes":
        """Join groups of floes into one, numbered in the order given; inactive floes stay inactive.

        The result rotates if any group does; floes of other groups get zero angle and angular velocity.  Likewise
        it has a friction or tensile strength per floe if any group has; it is NaN for floes of other groups.

        Raises
        ------
        InputError
            for anything that is not `Floes`, such as a `Coast` instead of its `floes`.
        """
        if not np.iterable(groups):
            raise InputError(f"groups = {in_line(groups)}: must be a list of Floes")
        groups = list(groups)
        for group in groups:
            check_floes(group)
        floes = Floes([], [], [], [], rotation=any(group.rotation for group in groups))
        for name in _OWN_TYPES:
            if any(getattr(group, name) is not None for group in groups):
                floes.allow_own(name)
        floes._reserve(sum(len(group) for group in groups))
        for group in groups:
            first, floes._n = floes._n, floes._n + len(group)
            for name, column in floes._columns.items():
                here = getattr(group, name)
                missing = np.nan if name in _OWN_TYPES else 0.0
                column[first : floes._n] = missing if here is None else here
        return floes

    def _reserve(self, n: int) -> None:
        capacity = len(self._columns["x"])
        if n <= capacity:
            return
        capacity = max(n, 2 * capacity)
        for name, column in self._columns.items():
            grown = np.zeros(capacity, column.dtype)
            grown[: self._n] = column[: self._n]
            self._columns[name] = grown


def check_floes(floes: object) -> None:
    """Raise InputError unless these are `Floes` whose values are finite and within bounds."""
    _check_kind(floes)
    floes.check()


def _check_kind(floes: object) -> None:
    if not isinstance(floes, Floes):
        raise InputError(f"floes = {in_line(floes)}: must be of the kind Floes")


def _numbers(name: str, value: ArrayLike) -> np.ndarray:
    try:
        array = unmasked(value)
    except (TypeError, ValueError):
        raise InputError(
            f"{name} = {in_line(value)}: must be a number or a row of numbers, without a unit"
        ) from None
    if array.ndim > 1:
        raise InputError(f"{name} has shape {array.shape}: must be a number or a row of numbers")
    return array


def _motion_bits(motion: ArrayLike) -> np.ndarray:
    bits = _numbers("motion", motion)
    ice = (bits >= 0) & (bits <= FIXED) & (bits == np.floor(bits))
    wrong = ~(ice | (bits == COAST))
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"floe {row}: motion = {np.atleast_1d(bits)[row]:g}; must be a sum of FIXED_X = 1, "
            "FIXED_Y = 2, FIXED_ROTATION = 4, or COAST = 15"
        )
    return bits.astype(np.int8)


def _common_length(values: dict[str, np.ndarray]) -> int:
    lengths = {name: len(value) for name, value in values.items() if value.ndim == 1}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputError(
            f"floes: different numbers of values ({told}); must be the same number of each"
        )
    return next(iter(lengths.values()), 1)


def _check(name: str, values: np.ndarray, first: int) -> None:
    unit = _UNITS.get(name)
    if unit is None:
        return
    is_size, is_own = name in ("radius", "thickness"), name in _OWN_TYPES
    below = FARTHEST if is_size else np.inf
    low = values <= 0 if is_size else values < 0 if is_own else np.False_
    if all_finite(values, below) and not low.any():
        return
    row = int(np.flatnonzero(~(np.abs(values) < below) | low)[0])  # NaN is wrong, too
    value = float(values.flat[row])
    if not np.isfinite(value):
        right = "a finite number"
    elif value >= FARTHEST:
        right = f"less than {FARTHEST:g} m"
    else:
        right = "at least 0" if is_own else "greater than 0"
    given = f"{value!r} {unit}".strip()
    raise InputError(f"floe {first + row}: {name} = {given}; must be {right}")


def _check_coast(values: Mapping[str, np.ndarray], first: int) -> None:
    land = (values["motion"] & LAND) != 0
    if not land.any():
        return
    for name in ("u", "v", "angular_velocity"):
        moves = land & (values.get(name, 0.0) != 0.0)
        if moves.any():
            row = int(np.flatnonzero(moves)[0])
            value = float(np.broadcast_to(values[name], moves.shape).flat[row])
            raise InputError(
                f"floe {first + row}: {name} = {value!r} {_UNITS[name]}: a piece of coast stands still; must be 0"
            )


def without_small(floes: Floes, radius: float) -> Floes:
    """The floes of at least this radius [m], all thickened by one factor so that the volume is conserved.

    The smallest floe limits the time step of all.  Area and concentration decrease.

    Raises
    ------
    InputError
        if no floe is that large.
    """
    keep = floes.radius >= radius
    if keep.all():
        return floes
    if not keep.any():
        raise InputError(
            f"smallest = {radius:g} m: leaves no floe; must be at most {floes.radius.max():.4g} m"
        )
    kept = floes._some(keep)
    kept.thickness *= floes.volume.sum() / kept.volume.sum()
    return kept
