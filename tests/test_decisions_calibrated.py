"""Every statistical decision of a diagnosis on drawn data: how often chance alone passes.

The draws are seeded; bounds are what a binomial count at the stated rate stays within.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from ident.diagnosis.holdout import FreeRunErrors
from ident.diagnosis.minimum_detectable import minimum_detectable
from ident.diagnosis.partial_regression import Reduced, wild_p_values
from ident.diagnosis.refit import Candidate, ranked
from ident.diagnosis.score_table import score, summed
from ident.diagnosis.screening import Shortlist, gain_of
from ident.diagnosis.splits import FIT, SELECT
from ident.estimators import Estimate, durbin_wu_hausman, instrumental_variables, least_squares
from ident.regression import Regression
from youbot_env.effects import get_effect

STRETCHES = 40


def scores_of(rng, families, forms, wide=1):
    """Scores (stretches, wide) of things that explain nothing; forms of one family look alike."""
    found, names = [], []
    for family in range(families):
        common = rng.standard_normal((STRETCHES, wide))
        for _ in range(forms):
            found.append(common + 0.5 * rng.standard_normal((STRETCHES, wide)))
            names.append(f"effect {family}")
    return found, np.array(names)


def test_where_nothing_is_hidden_one_log_in_twenty_names_an_effect():
    """20 effects of two forms each: without control over effects two logs in three would."""
    rng, named, runs = np.random.default_rng(0), 0, 200
    for _ in range(runs):
        named += wild_p_values(*scores_of(rng, 20, 2))[1].min() < 0.05
    assert 0.01 * runs <= named <= 0.10 * runs


def test_forms_of_one_effect_together_have_the_chance_of_one():
    rng, passed, runs = np.random.default_rng(1), 0, 300
    for _ in range(runs):
        scores, names = scores_of(rng, 1, 6, wide=2)
        scores = [one + rng.standard_normal(one.shape) for one in scores]
        passed += wild_p_values(scores, names)[0].min() < 0.05
    assert 0.02 * runs <= passed <= 0.09 * runs


def test_a_real_effect_passes_and_few_stretches_prove_nothing():
    rng = np.random.default_rng(2)
    scores, names = scores_of(rng, 20, 1)
    scores[7] = scores[7] + 1.5
    within, adjusted = wild_p_values(scores, names)
    assert np.argmin(within) == 7
    assert adjusted[7] < 0.05
    assert np.sort(adjusted)[1] > 0.05
    assert np.all(adjusted >= within)
    white = rng.standard_normal((6, 2)) + 3.0
    few, enough = (wild_p_values([white[:k]], np.array(["any"]))[0][0] for k in (5, 6))
    assert few == 1.0  # three stretches for each coefficient
    assert enough < 0.2


def test_what_has_no_name_is_judged_by_itself():
    rng = np.random.default_rng(3)
    scores, names = scores_of(rng, 10, 1)
    scores[0], names[0] = scores[0] + 0.7, ""
    within, adjusted = wild_p_values(scores, names)
    assert adjusted[0] == within[0] < 0.05


def refined(name, values, count, loss):
    active = SimpleNamespace(identifier=name, values=values)
    held = SimpleNamespace(model=SimpleNamespace(effects=[active]))
    return Candidate(name, 0, held, (), loss, count)


def order_of(losses, counts, before, role=None):
    names = (("quadratic_drag", {"c": 60.0}), ("yaw_scrub_friction", {"ts": 2.0}))
    found = [
        refined(*name, count, loss) for name, count, loss in zip(names, counts, losses, strict=True)
    ]
    role = np.full(len(before), FIT) if role is None else role
    return [c.count for c in ranked(found, list(losses), role, before, np.arange(len(before)))]


def test_a_spare_parameter_comes_first_as_rarely_as_schwarz_promises():
    """Of eight independent errors in each of 20 windows: chi2 above log(160), one time in forty."""
    rng, spare, real, runs = np.random.default_rng(4), 0, 0, 400
    for k in range(2 * runs):
        error, column = rng.standard_normal((2, 20, 8))
        size = 0.35 if k >= runs else 0.0  # a t value of about 4.4
        error = error + size * column
        left = error - column * np.sum(column * error) / np.sum(column**2)
        losses = np.mean(error**2, axis=1), np.mean(left**2, axis=1)
        first = order_of(losses, (1, 2), losses[0])[0]
        spare += first == 2 and k < runs
        real += first == 2 and k >= runs
    assert 0.005 * runs <= spare <= 0.05 * runs
    assert real > 0.9 * runs


def test_an_equal_rival_stays_in_the_group_and_a_worse_one_leaves_it():
    rng, together, apart, runs = np.random.default_rng(5), 0, 0, 300
    for _ in range(runs):
        losses = 0.5 * rng.chisquare(8, (2, 20)) / 8
        together += len(order_of(losses, (1, 3), np.ones(20))) == 2
        losses[1] = losses[1] + 0.5
        apart += len(order_of(losses, (1, 3), np.ones(20))) == 1
    assert 0.86 * runs <= together <= 0.97 * runs  # a one-sided five per cent, either way round
    assert apart > 0.95 * runs


def test_windows_for_choosing_speak_before_the_fitted_ones():
    role = np.repeat([FIT, SELECT], 10)
    rng = np.random.default_rng(6)
    noise = 0.01 * rng.standard_normal((2, 20))
    fits = np.where(role == FIT, 0.1, 0.9), np.where(role == FIT, 0.3, 0.2)
    got = order_of(np.array(fits) + noise, (1, 3), np.ones(20), role)
    assert got == [3]


def test_a_law_at_its_bound_may_stand_for_the_simpler_one():
    """Presliding over no turn at all is plain dry friction, which then comes first."""
    rng = np.random.default_rng(10)
    loss = 0.5 * rng.chisquare(8, 20) / 8
    bend = get_effect("presliding_friction").parameter_of("bend").bounds[0]
    special, plain, other = (
        refined(name, values, count, loss + more)
        for name, values, count, more in (
            ("presliding_friction", {"fc": 0.2, "bend": bend}, 2, 0.0),
            ("wheel_coulomb_friction", {"fc": 0.2}, 1, 0.2),
            ("quadratic_drag", {"c": 60.0}, 1, 0.3),
        )
    )
    before, role = np.ones(20), np.full(20, FIT)

    def group(*found):
        losses = [one.loss for one in found]
        return [c.identifier for c in ranked(list(found), losses, role, before, np.arange(20))]

    assert group(special, plain, other) == ["wheel_coulomb_friction", "presliding_friction"]
    inside = refined("presliding_friction", {"fc": 0.2, "bend": 0.05}, 2, loss)
    assert group(inside, plain, other) == ["presliding_friction"]


def test_laws_that_make_the_drive_late_are_hard_to_tell_apart():
    """Each smooths the noise of the drive in its own way, up to 30 % of what it explains."""
    names = {
        "actuator_delay": {"d": 0.02},
        "actuator_lag": {"T": 0.02},
        "quadratic_drag": {"c": 60},
    }
    loss = np.full(20, 0.5) + 1e-3 * np.random.default_rng(11).standard_normal(20)
    found = [
        refined(name, values, 1, loss + more)
        for (name, values), more in zip(names.items(), (0.0, 0.1, 0.1), strict=True)
    ]

    def group(more=0.0):
        losses = [found[0].loss, found[1].loss + more, found[2].loss]
        kept = ranked(found, losses, np.full(20, FIT), np.ones(20), np.arange(20))
        return {c.identifier for c in kept}

    assert group() == {"actuator_delay", "actuator_lag"}
    assert group(more=0.1) == {"actuator_delay"}  # more than 0.3 of what is explained, 0.5


def judged(explained, gain, error=1.0, origin=1.0, agree=True, time=False):
    trial = SimpleNamespace(effect=SimpleNamespace(needs_time=time, background=False))
    evidence = SimpleNamespace(trials=(trial,), explained=lambda k: explained, gain=lambda k: gain)
    found = Shortlist(evidence, np.array([gain]), np.array([0.01]), error, 0.0, origin, agree)
    return found, evidence


def test_an_effect_must_remove_more_than_real_rollers_feign():
    """Rollers with nothing hidden feign up to 4 % of the squared error; an effect has 8 %."""
    shortlist, _ = judged(0.1, 0.08)
    assert not shortlist.enough(0.04)
    assert shortlist.enough(0.08)
    # Where the wheels contradict each other it is a share of all that there was.
    rolling, _ = judged(0.1, 0.08, error=0.5, origin=1.0, agree=False)
    assert not rolling.enough(0.08)
    assert rolling.enough(0.16)
    grown, _ = judged(0.1, 0.08, error=2.0, origin=1.0, agree=False)
    assert grown.enough(0.08)
    assert not grown.enough(0.04)


def test_what_changes_with_time_is_judged_where_it_was_fitted():
    for explained, time, wanted in ((0.3, True, 0.3), (0.3, False, 0.1), (0.15, True, 0.1)):
        assert gain_of(judged(explained, 0.1, time=time)[1], 0) == wanted


def test_a_smallest_size_is_detected_four_times_in_five():
    """One parameter with a standard error of 0.5, 30 stretches, ten things tried."""
    effect, error = get_effect("wheel_coulomb_friction"), 0.01
    trial = SimpleNamespace(
        identifier=effect.identifier, effect=effect, names=("fc",), mix=np.eye(1), units=np.ones(1)
    )

    def shown(strength, value=0.03):
        evidence = SimpleNamespace(
            trials=(trial,),
            scores=np.zeros((30, 1)),
            coefficients=lambda k: np.array([value]),
            scatter=lambda k: np.array([[error**2]]),
            strength=lambda k, size: strength,
        )
        found = SimpleNamespace(
            table=evidence, gains=np.zeros(10), p=np.full(10, 0.2), trial=lambda k: trial
        )
        return minimum_detectable(found)[0]

    one = shown(strength=1e6)
    sure = stats.t.ppf(0.975, 29) * error
    np.testing.assert_allclose(one.ci95, (0.03 - sure, 0.03 + sure))
    threshold = stats.t.isf(0.05 / 2 / 10, 29)
    chance = stats.norm.sf(threshold - one.smallest / error)
    assert chance == pytest.approx(0.8, abs=1e-6)
    assert one.power == pytest.approx(stats.norm.sf(threshold - 0.2 / error), abs=1e-6)
    # Where the size must be larger to remove six per cent of the error, that decides:
    # x^2 s / (1 + x^2 s) = 0.06 of an error of one.
    hidden = shown(strength=0.5)
    assert hidden.smallest**2 * 0.5 / (1 + hidden.smallest**2 * 0.5) == pytest.approx(0.06)
    assert shown(strength=0.0).smallest is None


def test_hausman_is_silent_without_noise_and_speaks_with_it():
    """Rows with noise in their columns bias least squares; instruments know nothing of it."""
    rng, biased, false, runs = np.random.default_rng(7), 0, 0, 60
    for k in range(2 * runs):
        known = rng.standard_normal((1200, 3, 4))
        true = known + rng.standard_normal(known.shape)
        y = true.sum(axis=2) + rng.standard_normal(true.shape[:2])
        seen = true + (0.3 * rng.standard_normal(true.shape) if k >= runs else 0.0)
        time = 0.01 * np.arange(len(y))
        rows = Regression(tuple("abcd"), seen, y, time, np.zeros(len(y), int), 1.0)
        p = durbin_wu_hausman(least_squares(rows), instrumental_variables(rows, known))
        false += p < 0.05 and k < runs
        biased += p < 0.05 and k >= runs
    assert false <= 0.1 * runs
    assert biased > 0.9 * runs


def test_hausman_is_fishers_law_of_the_values_and_the_spare_stretches():
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, -0.02], [0.0, -0.02, 0.01]])
    plain, robust = (
        Estimate("any", tuple("abc"), np.array(v), covariance, 12, np.zeros((3, 0)), np.ones(3))
        for v in ((1.0, 2.0, 3.0), (1.3, 1.6, 3.1))
    )
    gap = np.array([0.3, -0.4, 0.1])
    statistic = gap @ np.linalg.solve(covariance, gap)
    wanted = stats.f.sf(statistic / 3, 3, 12 - 3)
    assert durbin_wu_hausman(plain, robust) == pytest.approx(wanted, rel=1e-6)


def test_reduced_tables_are_least_squares():
    """Fit on some rows, judge on others: the same as with the rows themselves."""
    rng, base = np.random.default_rng(8), 3
    fit, judge = rng.standard_normal((50, 8)), rng.standard_normal((40, 8))
    table = Reduced.of(fit.T @ fit, judge.T @ judge, base)

    def both(columns):
        columns = [*range(base), *[base + c for c in columns]]
        b = np.linalg.lstsq(fit[:, columns], fit[:, -1], rcond=None)[0]
        return b, np.sum((judge[:, -1] - judge[:, columns] @ b) ** 2)

    assert table.before == pytest.approx(both([])[1])
    for mine in ([0], [1, 3], [0, 1, 2, 3]):
        b, loss = both(mine)
        np.testing.assert_allclose(table.solve(np.array(mine)), b[base:])
        assert table.loss(np.array(mine)) == pytest.approx(loss)
    beside = table.beyond(np.array([2]))
    b, loss = both([1, 2])
    np.testing.assert_allclose(beside.solve(np.array([1])), b[base : base + 1])
    assert beside.loss(np.array([1])) == pytest.approx(loss)
    held = table.solve(np.array([0]), ends=(0.5, 0.6))
    assert 0.5 <= held[0] <= 0.6
    shrunk = table.solve(np.array([1]), ridge=50.0)
    assert abs(shrunk[0]) < abs(table.solve(np.array([1]))[0])


def test_scores_are_what_columns_say_of_the_error_beyond_the_base():
    rng, base = np.random.default_rng(9), 2
    rows, share = rng.standard_normal((6, 5, 4)), rng.standard_normal((2, 2))
    got = score(rows, share, base)
    for k in range(6):
        left = rows[k, :, base:] - rows[k, :, :base] @ share
        np.testing.assert_allclose(got[k], left[:, :-1].T @ left[:, -1])
    together = summed(got, np.array([0, 0, 1, 1, 1, 2]))
    np.testing.assert_allclose(together, [got[:2].sum(0), got[2:5].sum(0), got[5]])


def errors(nrmse, **kw):
    axes = np.outer(nrmse, (1.0, 2.0, 4.0))
    given = {"white": 0.03, "lasting": 0.04, "unsure": 0.0, "rolling": 0.0} | kw
    names = ("", "first", "second")[: len(nrmse)]
    return FreeRunErrors(names, tuple(nrmse), axes, **given, drop_ci95=(0.1, 0.2), windows=10)


def test_shares_of_an_error_add_up_to_it():
    found = errors((0.5, 0.3, 0.1), unsure=0.06, rolling=0.02)
    assert found.floor == pytest.approx(0.05)
    assert found.drops == pytest.approx({"first": 0.4, "second": 2 / 3})
    shares = found.account
    squares = {
        "first": 0.16,
        "second": 0.08,
        "white noise": 0.0009,
        "lasting noise of the drive": 0.0016,
        "parameters": 0.0036,
        "rolling": 0.0004,
        "remainder": 0.0035,
    }
    assert shares == pytest.approx({name: s / 0.25 for name, s in squares.items()})
    assert sum(shares.values()) == pytest.approx(1.0)
    assert found.left == pytest.approx((0.01 - 0.0065) / (0.25 - 0.0065))
    assert found.beyond_noise == pytest.approx((0.01 - 0.0025) / (0.25 - 0.0025))
    assert found.unexplained == pytest.approx((0.01 - 0.0065) / 0.0025)
    np.testing.assert_allclose(found.remaining, (1.0, 0.6, 0.2))
    assert found.bounded
    assert not errors((0.5, 1.0)).bounded
    assert errors((0.5, 0.2)).clear
    assert not errors((0.5, 0.051)).clear
