"""Cases of a validation: what they measure, the bound that each number must satisfy, and how the results are told and saved."""

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from floebmi.errors import InputError, StabilityError
from floebmi.files import attributes_of, check_target, in_one_go, path_of


class Measure(NamedTuple):
    """A measured number, and the bound that it must satisfy; without a relation it is only reported."""

    what: str
    value: float
    relation: str = ""
    bound: float = math.nan

    @property
    def passed(self) -> bool:
        if self.relation == "≤":
            return bool(self.value <= self.bound)
        if self.relation == "≥":
            return bool(self.value >= self.bound)
        return bool(self.relation == "" or self.value == self.bound)

    @property
    def mark(self) -> str:
        return f"{self.relation} {self.bound:.4g}" if self.relation else "told"


def fact(what: str, holds: bool) -> Measure:
    """A measure of what must be so."""
    return Measure(f"{what} (1: yes)", float(holds), "=", 1.0)


@dataclasses.dataclass(frozen=True)
class Case:
    """A validation case: number, short name, title, source of its pass mark, and the function that measures."""

    number: int
    name: str
    title: str
    source: str
    measure: Callable[[bool], Iterator[Measure]]

    def run(self, long: bool = False) -> list[Measure]:
        """Measure; a case that stops before its end counts as failed, with the reason."""
        measures: list[Measure] = []
        try:
            measures.extend(self.measure(long))
        except (InputError, StabilityError) as error:
            measures.append(Measure(f"stopped: {error}", math.nan, "=", 0.0))
        return measures


Results = Mapping[Case, Sequence[Measure]]


def table(results: Results) -> str:
    """The measures of some cases as text: case, what, measured, pass mark, verdict, source."""
    rows = []
    for case, measures in results.items():
        head, source = f"{case.number:>2} {case.name}", case.source
        for m in measures:
            verdict = "" if not m.relation else "pass" if m.passed else "FAIL"
            rows.append((head, m.what, f"{m.value:.4g}", m.mark, verdict, source))
            head = source = ""
    rows.insert(0, ("case", "what", "measured", "pass mark", "", "source"))
    widths = [min(max(len(row[k]) for row in rows), 64) for k in range(5)]
    return "\n".join(
        f"{head:<{widths[0]}}  {what:<{widths[1]}}  {value:>{widths[2]}}  {mark:<{widths[3]}}  "
        f"{verdict:<{widths[4]}}  {source}".rstrip()
        for head, what, value, mark, verdict, source in rows
    )


def save(results: Results, path: str | Path) -> None:
    """Write the measures of some cases as JSON, with the version and the time."""
    cases = {
        case.name: {
            "number": case.number,
            "title": case.title,
            "source": case.source,
            "passed": all(m.passed for m in measures),
            "measures": [
                {"what": m.what, "value": float(m.value) if math.isfinite(m.value) else str(m.value),
                 "mark": m.mark, "passed": m.passed}
                for m in measures
            ],
        }
        for case, measures in results.items()
    }  # fmt: skip
    made = attributes_of("measures of the model at its extremes")
    content = {**{name: made[name] for name in ("title", "source", "history")}, "cases": cases}
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    path = path_of("path", path)
    check_target(path, overwrite=True)
    with in_one_go(path) as part:
        part.write_text(text, encoding="utf-8")
