"""Fits of the paper's experiments recover what synthetic samples were made with, and say how sure they are."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from floebmi.errors import InputError
from floebmi.experiments.statistics import fit_line, fit_survival, survival, timescale

HOUR = 3600.0


def straits(T, n, end, rng, start=HOUR):
    """Jam times of n straits that jam at random after `start`, seen until `end`."""
    jam = start + rng.exponential(T, n)
    return np.where(jam < end, jam, np.nan), np.full(n, start), np.full(n, end)


def test_likelihood_recovers_the_timescale_of_a_large_sample():
    found = timescale(*straits(5 * HOUR, 20000, 1e9, np.random.default_rng(1)))
    assert found.value == pytest.approx(5 * HOUR, rel=0.02)
    assert found.low < 5 * HOUR < found.high


@pytest.mark.parametrize("T", [2 * HOUR, 10 * HOUR, 40 * HOUR])  # 40 h: a day ends before most jams
def test_the_interval_of_the_likelihood_covers_the_truth_as_often_as_it_says(T):
    rng = np.random.default_rng(2)
    inside = [
        found.low <= T <= found.high
        for found in (timescale(*straits(T, 20, 24 * HOUR, rng)) for _ in range(2000))
    ]
    assert 0.94 <= np.mean(inside) <= 0.985


def test_a_fit_that_forgets_the_runs_without_a_jam_is_far_too_short():
    jam, start, end = straits(40 * HOUR, 20000, 24 * HOUR, np.random.default_rng(3))
    censored = timescale(jam, start, end).value
    forgetful = np.nanmean(jam - start)
    assert censored == pytest.approx(40 * HOUR, rel=0.05)
    assert forgetful < 0.3 * 40 * HOUR


def test_the_interval_has_two_more_degrees_of_freedom_at_its_low_end_where_runs_were_cut_short():
    """20 s that all runs flowed, two jams: quantiles of chi² with 4 and 6 degrees of freedom, from a table."""
    all_jam = timescale([8.0, 12.0], [0.0, 0.0], [50.0, 50.0])
    assert all_jam == pytest.approx((10.0, 40 / 11.1433, 40 / 0.484419), rel=1e-5)
    two_cut = timescale([4.0, 6.0, np.nan, np.nan], np.zeros(4), [50.0, 50.0, 5.0, 5.0])
    assert two_cut == pytest.approx((10.0, 40 / 14.4494, 40 / 0.484419), rel=1e-5)


def test_without_a_jam_the_timescale_is_infinite_with_a_lower_bound():
    found = timescale([np.nan] * 20, [HOUR] * 20, [25 * HOUR] * 20)
    assert found.value == np.inf and found.high == np.inf
    assert found.low == pytest.approx(20 * 24 * HOUR / -np.log(0.05))  # e^(−total/low) = 5 %


def test_a_strait_that_no_floe_has_left_says_nothing():
    jam, start, end = [3 * HOUR, np.nan], [HOUR, np.nan], [4 * HOUR, 24 * HOUR]
    assert timescale(jam, start, end).value == pytest.approx(2 * HOUR)


def test_the_fit_of_the_paper_recovers_the_timescale_when_all_jam():
    jam, _, _ = straits(5 * HOUR, 2000, 1e9, np.random.default_rng(4))
    found = fit_survival(jam)
    assert found.value == pytest.approx(5 * HOUR, rel=0.05)
    assert found.start == jam.min()
    assert 0 < found.deviation < 0.05 * found.value


def test_the_deviation_of_the_fit_is_that_of_a_fit_of_the_timescale_itself():
    jam = HOUR + np.array([500.0, 900.0, 1500.0, 2500.0, 4200.0, np.nan])
    fit = fit_survival(jam)
    since, share = jam[:5] - jam[0], 1 - np.arange(1, 6) / 6
    found, covariance = curve_fit(lambda t, T: np.exp(-t / T), since, share, p0=[2000.0])
    expected = found[0], np.sqrt(covariance[0, 0]), HOUR + 500.0
    assert fit == pytest.approx(expected, rel=1e-4)


def test_two_jams_are_too_few_for_a_fit():
    assert np.isnan(fit_survival([HOUR, 2 * HOUR, np.nan]).value)


def test_survival_falls_by_one_run_at_each_jam_and_stays_above_zero_if_some_flow_on():
    times, share = survival([3.0, np.nan, 1.0, 2.0])
    assert times.tolist() == [1.0, 2.0, 3.0]
    assert share.tolist() == [0.75, 0.5, 0.25]


def test_a_run_that_jams_before_it_can_is_refused():
    with pytest.raises(InputError, match="before it can"):
        timescale([HOUR], [2 * HOUR], [3 * HOUR])
    with pytest.raises(InputError, match="before it can"):
        timescale([HOUR], [np.nan], [3 * HOUR])


def test_runs_that_never_could_jam_say_nothing_of_the_interval():
    some = timescale([8.0, 12.0], [0.0, 0.0], [50.0, 50.0])
    assert timescale([8.0, 12.0, np.nan], [0.0, 0.0, np.nan], [50.0] * 3) == some


def test_jams_under_a_mask_are_none():
    masked = np.ma.masked_array([3.0, 1.0, 2.0], [False, True, False])
    assert survival(masked)[0].tolist() == [2.0, 3.0]
    assert timescale(masked, [0.0] * 3, [5.0] * 3).value == 10.0 / 2


@pytest.mark.parametrize(
    "fit",
    [
        lambda: timescale([1.0, 2.0], [0.0], [3.0, 3.0]),
        lambda: timescale([1.0], [0.0], [3.0], confidence=None),
        lambda: timescale([np.nan], [0.0], [np.inf]),
        lambda: fit_line([1.0, 2.0, 3.0], [1.0, 2.0]),
        lambda: fit_line([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], confidence=95),
        lambda: survival("abc"),
    ],
)
def test_what_no_fit_can_be_made_of_is_refused(fit):
    with pytest.raises(InputError):
        fit()


def test_the_line_recovers_friction_and_cohesion_and_covers_them_as_often_as_it_says():
    rng = np.random.default_rng(5)
    N = np.repeat([5e3, 10e3, 20e3, 40e3, 80e3], 3)
    inside = []
    for _ in range(1000):
        fit = fit_line(N, 1e3 + 0.25 * N + rng.normal(0, 500.0, N.size))
        inside.append(
            (
                fit.friction_low < 0.25 < fit.friction_high,
                fit.cohesion_low < 1e3 < fit.cohesion_high,
            )
        )
    assert np.abs(np.mean(inside, axis=0) - 0.95).max() < 0.025


def test_the_line_through_one_normal_stress_is_not_a_number():
    assert np.isnan(fit_line([5e3] * 4, [1.0, 2.0, 3.0, 4.0]).friction)
