"""How soon does a strait jam, and how strong is a pack: fits with their uncertainty.

Jamming is treated as random: while ice flows, it jams with a constant probability per unit time, 1/T.  The
fraction of straits that still flow is then P_s(t) = exp(−(t − t₀)/T) (eq. survival).  T is estimated in two ways: as in
the paper, by a least-squares fit (Levenberg-Marquardt) of this curve to the fractions, with t₀ the first jam; and
by maximum likelihood, which also uses the runs that ended before they jammed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.errors import InputError
from floebmi.quantities import is_number, unmasked


class Timescale(NamedTuple):
    """Mean time T until a strait jams [s], with its confidence interval; T = inf if none jammed."""

    value: float
    low: float
    high: float


class SurvivalFit(NamedTuple):
    """T [s] of P_s = exp(−(t − t₀)/T), its standard deviation from the fit, and t₀, the first jam [s]."""

    value: float
    deviation: float
    start: float


class Line(NamedTuple):
    """τ = C + μ_u N: cohesion C [Pa] and friction μ_u [1], each with its confidence interval."""

    cohesion: float
    cohesion_low: float
    cohesion_high: float
    friction: float
    friction_low: float
    friction_high: float


def survival(jam_time: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Times of the jams in order [s], and the fraction of all runs that still flow after each.

    jam_time : time of the jam of each run [s], NaN for one that did not jam
    """
    times = unmasked(jam_time).ravel()
    jammed = np.sort(times[np.isfinite(times)])
    return jammed, 1.0 - np.arange(1, len(jammed) + 1) / max(len(times), 1)


def fit_survival(jam_time: ArrayLike) -> SurvivalFit:
    """T as in the paper: a Levenberg-Marquardt fit of P_s at the times of the jams, t₀ the first of them (eq. survival).

    With fewer than three jams there is nothing to fit: T and its standard deviation are NaN.  Runs that do not
    jam count only in the fractions, so P_s does not reach 0.  Leave out runs in which no floe ever left: they never flowed.
    """
    from scipy.optimize import curve_fit

    times, share = survival(jam_time)
    if len(times) < 3:
        return SurvivalFit(np.nan, np.nan, times[0] if len(times) else np.nan)
    since = times - times[0]
    scale = since.mean()
    if not scale > 0:
        return SurvivalFit(0.0, 0.0, times[0])
    # in the logarithm of T over the mean time, so that T stays positive
    found, covariance = curve_fit(
        lambda t, log_t: np.exp(-t / np.exp(log_t)), since / scale, share, p0=[0.0], method="lm"
    )
    value = float(scale * np.exp(found[0]))
    return SurvivalFit(value, float(value * np.sqrt(covariance[0, 0])), float(times[0]))


def timescale(
    jam_time: ArrayLike, start: ArrayLike, end: ArrayLike, confidence: float = 0.95
) -> Timescale:
    """T by maximum likelihood: the total time for which all runs flowed, over the number of jams (eq. survival).

    Parameters
    ----------
    jam_time : time of the jam of each run [s], NaN where it did not jam
    start : earliest time at which each run could have jammed, when the first floe reached the outlet [s]; NaN: never,
        and the run is not used
    end : end of each run [s]; a run without a jam flowed until then
    confidence : confidence level of the interval [1], from χ²; exact if runs stop at the k-th jam, approximate if
        they stop at a fixed time

    Returns
    -------
    Timescale.  Without a jam T and the upper bound are infinite, and the lower bound is one-sided.

    Raises
    ------
    InputError
        for different numbers of times, a confidence that is not between 0 and 1, and a run that jams or ends before its
        `start`.

    References
    ----------
    J. F. Lawless (2003), Statistical models and methods for lifetime data, section 4.1.
    """
    from scipy.stats import chi2

    jam, begin, stop = _of_each_run(jam_time=jam_time, start=start, end=end)
    _check_confidence(confidence)
    could = np.isfinite(begin)
    jammed = np.isfinite(jam)
    flowed = (np.where(jammed, jam, stop) - begin)[could]
    if (flowed < 0).any() or (jammed & ~could).any():
        raise InputError("timescale: a run jams or ends before it can; must be start <= jam, end")
    if not np.isfinite(flowed).all():
        raise InputError("timescale: end of a run that did not jam: must be finite")
    total, k = float(flowed.sum()), int(jammed.sum())
    if k == 0:
        low = total / -np.log(1.0 - confidence) if total > 0 else 0.0
        return Timescale(np.inf, float(low), np.inf)
    tail = 0.5 * (1.0 - confidence)
    # the time was cut for some: up to one more jam may have been on its way
    more = 2 * k + (0 if jammed[could].all() else 2)
    low = 2 * total / chi2.ppf(1.0 - tail, more)
    return Timescale(total / k, float(low), float(2 * total / chi2.ppf(tail, 2 * k)))


def fit_line(normal_stress: ArrayLike, shear_stress: ArrayLike, confidence: float = 0.95) -> Line:
    """τ = C + μ_u N by least squares, with intervals from Student's t (eq. bulk-friction).

    normal_stress, shear_stress : stresses of each run [Pa]; runs with a NaN are left out.  With fewer than three
        runs, or only one normal stress, all results are NaN.

    Raises
    ------
    InputError
        for different numbers of stresses, and a confidence that is not between 0 and 1.
    """
    from scipy.stats import linregress, t

    x, y = _of_each_run(normal_stress=normal_stress, shear_stress=shear_stress)
    _check_confidence(confidence)
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < 3 or np.ptp(x) == 0:
        return Line(*[np.nan] * 6)
    fit = linregress(x, y)
    wide = t.ppf(0.5 + 0.5 * confidence, len(x) - 2)
    c, dc, m, dm = (float(v) for v in (fit.intercept, wide * fit.intercept_stderr, fit.slope, wide * fit.stderr))  # fmt: skip
    return Line(c, c - dc, c + dc, m, m - dm, m + dm)


def _of_each_run(**values: ArrayLike) -> list[np.ndarray]:
    """Arrays with one value for each run, flat."""
    rows = [unmasked(one).ravel() for one in values.values()]
    if len({row.size for row in rows}) > 1:
        told = ", ".join(f"{row.size} of {name}" for name, row in zip(values, rows, strict=True))
        raise InputError(f"{told}: must be one for each run")
    return rows


def _check_confidence(confidence: float) -> None:
    if not (is_number(confidence) and 0 < confidence < 1):
        raise InputError(f"confidence = {confidence!r}: must be between 0 and 1")
