"""Times of the records of a file, in seconds after the start of the run.

Calendars are those of the file (also noleap, 360_day …): the start is read as a date of that calendar, and
from then on time is in seconds.  A run that names its calendar accepts files of no other, since dates would diverge at
the first 29 February.  Fields are interpolated linearly between records.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from floebmi.errors import InputError, check_word, in_line, warn
from floebmi.factors import DURATIONS
from floebmi.fields import Field, coordinate
from floebmi.quantities import is_number

if TYPE_CHECKING:
    import cftime
    import xarray as xr

    Date = str | float | datetime.datetime | np.datetime64 | cftime.datetime

BeyondSpan = Literal["error", "hold", "repeat"]
Calendar = Literal[
    "standard", "gregorian", "proleptic_gregorian", "noleap", "365_day", "all_leap", "366_day", "360_day",
    "julian",
]  # fmt: skip

# Names that mean the same calendar, for dates after 1582.
_ALIKE = {
    "gregorian": "standard",
    "proleptic_gregorian": "standard",
    "365_day": "noleap",
    "366_day": "all_leap",
}

# A date that cftime reads completely; in other forms it silently ignores parts that it does not know, such as an hour
# without minutes.
_DATE = re.compile(
    r"-?\d{4,}-\d{1,2}-\d{1,2}([T ]\d{1,2}:\d{1,2}(:\d{1,2}(\.\d+)?)?)?( ?(Z|UTC|[+-]\d\d(:?\d\d)?))?"
)
# The same for the reference date of a file's times, which may be of any year.
_REFERENCE = re.compile(
    r"[-+]?\d+-\d{1,2}-\d{1,2}([T ]\d{1,2}:\d{1,2}(:\d{1,2}(\.\d*)?)?)?( ?(Z|UTC|GMT|[+-]\d\d(:?\d\d)?))?",
    re.IGNORECASE,
)


class Clock:
    """Times of records, and the rule before the first and after the last.

    Parameters
    ----------
    field : the variable whose records these are
    start : the date of t = 0, e.g. "1979-01-16" or "2016-02-01T12:00"; default: the first record.  A number
        [s] if the file's times are durations, not dates.
    beyond_span : "error", "hold" (the first or last record), or "repeat" (the record after the last is the
        first again, after one more mean interval)
    calendar : CF calendar required of the file's dates; default: any

    Attributes
    ----------
    seconds : (n,) times of the records [s], or None for a field without time
    """

    def __init__(
        self,
        field: Field,
        start: Date | None = None,
        beyond_span: BeyondSpan = "error",
        calendar: Calendar | None = None,
    ) -> None:
        check_word("beyond_span", beyond_span, get_args(BeyondSpan))
        self.label = field.label
        self.beyond_span = beyond_span
        self.seconds: np.ndarray | None = None
        self._start = None
        self._dates = None
        if field.time is None:
            return
        found = coordinate(field.file, field.time)
        if found is None and field.array.sizes[field.time] == 1:
            return
        if found is None:
            raise InputError(
                f"{field.label}: its {field.time!r} has no times: one record of it holds always by"
                f" select = {{ {field.time} = 0 }}"
            )
        name, array = found
        where = f"{field.file.label}: {name}"
        self._dates = _middles(_dates(array, where), array, field, where)
        self._check_calendar(calendar, where)
        self._start = self._dates[0] if start is None else self._as_date(start, where)
        since = self._dates - self._start
        if self._dates.dtype.kind == "M":
            self.seconds = since / np.timedelta64(1, "s")
        elif self._dates.dtype.kind == "O":
            self.seconds = np.array([d.total_seconds() for d in since])
        else:
            self.seconds = since
        bad = np.flatnonzero(~(np.diff(self.seconds) > 0))
        if bad.size:
            k = int(bad[0]) + 1
            raise InputError(
                f"{where}[{k}] = {_text(self._dates[k])} does not come after"
                f" {_text(self._dates[k - 1])}: times must grow, each once: sort the records of the file"
            )

    def _check_calendar(self, wanted: Calendar | None, where: str) -> None:
        own = self.calendar
        if None not in (own, wanted) and not same_calendar(own, wanted):
            raise InputError(
                f"{where}: its dates are of the calendar {own!r}, but calendar = {wanted!r}: must be the same;"
                " leave calendar out to read the dates of each file in its own"
            )

    def _as_date(self, start: Date, where: str) -> object:
        """`start` as a date of the file's type."""
        kind = self._dates.dtype.kind
        if isinstance(start, (int, float)) != (kind == "f"):
            right = "a number of seconds" if kind == "f" else "a date such as '1979-01-16'"
            raise InputError(f"{where}: start = {start!r}: give {right}, as in the file")
        if kind == "f":
            return float(start)
        if isinstance(start, np.datetime64):
            start = start.astype("datetime64[us]").item()
        if kind == "M":
            return np.datetime64(date_of(start).isoformat(), "ns")
        try:
            return date_of(start, self._dates[0].calendar)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last time [s] for which there are data; None if at all times."""
        if self.seconds is None or self.seconds.size == 1 or self.beyond_span != "error":
            return None
        return float(self.seconds[0]), float(self.seconds[-1])

    @property
    def calendar(self) -> str | None:
        """CF calendar of the dates; None for a field without time, and for times that are not dates."""
        kind = None if self._dates is None else self._dates.dtype.kind
        return "standard" if kind == "M" else self._dates[0].calendar if kind == "O" else None

    @property
    def first_date(self) -> str | None:
        """The date of the first of several records; None for a single record, and for times that are not dates."""
        dated = self.seconds is not None and self.seconds.size > 1 and self._dates.dtype.kind != "f"
        return _text(self._dates[0]) if dated else None

    def bracket(self, t: float) -> tuple[int, int, float]:
        """The records before and after t [s], and the weight of the second.

        Raises
        ------
        InputError
            for what is no finite number, and outside the file's times, naming them, unless `beyond_span` allows it.
        """
        if not is_number(t):
            raise InputError(f"{self.label}: t = {in_line(t)}: must be a finite number of seconds")
        if self.seconds is None or self.seconds.size == 1:
            return 0, 0, 0.0
        first, last = self.seconds[0], self.seconds[-1]
        n = self.seconds.size
        if self.beyond_span == "repeat":
            interval = (last - first) / (n - 1)
            t = first + (t - first) % (last - first + interval)
            if t > last:
                return n - 1, 0, float((t - last) / interval)
        slack = 1e-9 * max(abs(first), abs(last), abs(t))
        if self.beyond_span == "error" and not first - slack <= t <= last + slack:
            raise InputError(
                f"{self.label}: t = {t:g} s{self._at(t)} is outside the file's times, {self}"
                " (start shifts them; beyond_span = 'hold' or 'repeat' goes on)"
            )
        t = min(max(t, first), last)
        k = min(int(np.searchsorted(self.seconds, t, side="right")) - 1, n - 2)
        return k, k + 1, float((t - self.seconds[k]) / (self.seconds[k + 1] - self.seconds[k]))

    def date(self, record: int) -> str:
        """The date of a record, as text."""
        return "its only record" if self._dates is None else _text(self._dates[record])

    def _at(self, t: float) -> str:
        if self._dates is None or self._dates.dtype.kind == "f":
            return ""
        if self._dates.dtype.kind == "M":
            return f" ({_text(self._start + np.timedelta64(round(t * 1e3), 'ms'))})"
        return f" ({_text(self._start + datetime.timedelta(seconds=t))})"

    def __str__(self) -> str:
        if self.seconds is None:
            return "without time"
        if self.seconds.size == 1:
            return f"one record, {self.date(0)}"
        text = (
            f"{self.date(0)} … {self.date(-1)}"
            f" (t = {self.seconds[0]:g} … {self.seconds[-1]:g} s, {self.seconds.size} records)"
        )
        return text if self.beyond_span == "error" else f"{text}, then {self.beyond_span}"


def same_calendar(one: str, other: str) -> bool:
    """Whether two names mean the same calendar."""
    return _ALIKE.get(one, one) == _ALIKE.get(other, other)


def date_of(start: Date, calendar: str = "standard", name: str = "start") -> cftime.datetime:
    """The date, in UTC and in this calendar, of a text such as '1979-01-16T18:00' or of a date in any calendar.

    name : of the key that gave it, for the error

    Raises
    ------
    InputError
        if it is not a date of this calendar.
    """
    import cftime

    text = text_of(start)
    try:
        if not isinstance(calendar, str) or not calendar:
            raise InputError(f"calendar = {in_line(calendar)}: must be a text, such as 'standard'")
        if not _DATE.fullmatch(text):
            raise ValueError
        return cftime.num2date(0.0, f"seconds since {text}", calendar)
    except ValueError:
        raise InputError(
            f"{name} = {start!r}: not a date of the calendar {calendar!r}; give one such as '1979-01-16' or"
            " '1979-01-16T18:00'"
        ) from None


def text_of(start: Date) -> str:
    """A date as text for `date_of`; str of a numpy date in hours would lack the minutes."""
    hours = isinstance(start, np.datetime64) and np.datetime_data(start)[0] == "h"
    return str(start.astype("datetime64[s]") if hours else start)


def refuse_other_start(
    start: Date | None, calendar: Calendar | None, told: Mapping[str, Any]
) -> None:
    """InputError if time 0 of a restart file has a date, and that of the scene differs or is missing.

    start, calendar : of the scene's [time], None where it has none
    told : attributes of the restart file; they have no start if its scene had none
    """
    if "start" not in told:
        return
    calendar = calendar or "standard"
    if not same_calendar(calendar, told["calendar"]):
        key, value, other = "calendar", calendar, told["calendar"]
    elif start is None or date_of(start, calendar) != date_of(told["start"], calendar):
        key, value, other = "start", start or "none", told["start"]
    else:
        return
    raise InputError(f"restart: [time] {key} = {value}, the restart's is {other}; must be the same")


def _dates(array: xr.DataArray, where: str) -> np.ndarray:
    """The times of a file (n,): datetime64, cftime dates, or durations as float seconds."""
    dates = np.atleast_1d(array.values)
    if not dates.size:
        raise InputError(f"{where}: no records")
    if dates.dtype.kind in "SUT" or any(isinstance(date, str | bytes) for date in dates.flat):
        raise InputError(
            f"{where}: its times are texts, such as {str(dates.flat[0])!r}: must be numbers with units ="
            " '<unit> since <date>'"
        )
    _check_reference(str(array.encoding.get("units", "")), dates, where)
    if dates.dtype.kind == "M":
        if np.isnat(dates).any():
            raise InputError(f"{where}[{int(np.isnat(dates).argmax())}] is not a time")
        return dates.astype("datetime64[ns]")
    if dates.dtype.kind == "O":
        return dates
    units = str(array.attrs.get("units", "")).lower().strip()
    if units not in DURATIONS:
        raise InputError(
            f"{where}: units = {units!r}: must be '<unit> since <date>', or s, min, h, days"
        )
    return dates.astype(float) * DURATIONS[units]


def _check_reference(units: str, dates: np.ndarray, where: str) -> None:
    """InputError for a reference date that was not read completely: cftime ignores what follows a form that it knows."""
    _, since, reference = units.partition(" since ")
    if not since or _REFERENCE.fullmatch(reference.strip()):
        return
    # In the standard calendar pandas reads all other forms except names of time zones.
    if dates.dtype.kind == "M" and not re.match(r"0*1-\d|.*[A-Za-z]{2,}$", reference.strip()):
        return
    raise InputError(
        f"{where}: units = {units!r}: of its date not all is understood; must be such as"
        " 'hours since 2016-02-01 06:00:00', in UTC"
    )


def _middles(dates: np.ndarray, array: xr.DataArray, field: Field, where: str) -> np.ndarray:
    """The times of records; for means over intervals stamped at one end, the midpoints of the intervals."""
    data, name = field.file.data, array.attrs.get("bounds", array.encoding.get("bounds"))
    mean = re.search(
        rf"\b(time|{re.escape(str(field.time))}): mean", str(field.array.attrs.get("cell_methods"))
    )
    if not mean or name not in data.variables or data[name].shape != (dates.size, 2):
        return dates
    ends = data[name].values
    if ends.dtype.kind != dates.dtype.kind or dates.dtype.kind not in "MO":
        return dates
    side = next((k for k in (0, 1) if (dates == ends[:, k]).all()), None)
    if side is None or (ends[:, 0] == ends[:, 1]).any():
        return dates
    warn(
        f"{where}: its times are the {('begins', 'ends')[side]} of the intervals that its fields are means of:"
        f" the middles are taken, by {name}"
    )
    return ends[:, 0] + (ends[:, 1] - ends[:, 0]) / 2


def _text(date: object) -> str:
    if isinstance(date, np.datetime64):
        text = str(np.datetime_as_string(date, unit="s"))
    elif hasattr(date, "isoformat"):
        text = date.isoformat()
    else:
        return f"{date:g} s"
    return text.removesuffix(":00").removesuffix("T00:00")
