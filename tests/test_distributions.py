"""Probabilities and the recursion of filters agree with scipy.stats and scipy.signal."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ident.distributions import (
    false_discoveries,
    fisher_above,
    rank_correlation_chance,
    student_above,
    student_quantile,
)
from ident.filters import recursion

FREEDOMS = (1, 2.5, 7, 39, 1e4)


@pytest.mark.parametrize("freedom", FREEDOMS)
def test_student(freedom):
    p = np.array([1e-12, 0.001, 0.025, 0.5, 0.8, 0.975, 1 - 1e-9])
    assert student_quantile(p, freedom) == pytest.approx(stats.t.ppf(p, freedom), rel=1e-12)
    assert -student_quantile(p, freedom) == pytest.approx(stats.t.isf(p, freedom), rel=1e-12)
    value = np.array([-np.inf, -40.0, -1.3, 0.0, 0.2, 3.0, 60.0, np.inf])
    assert student_above(value, freedom) == pytest.approx(stats.t.sf(value, freedom), rel=1e-12)


@pytest.mark.parametrize("over", [1, 2, 3.7, 12])
@pytest.mark.parametrize("under", FREEDOMS)
def test_fisher(over, under):
    ratio = np.array([-1e-15, 0.0, 1e-6, 0.3, 1.0, 4.0, 90.0, 1e6])
    expected = stats.f.sf(ratio, over, under)
    assert fisher_above(ratio, over, under) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dependent", [False, True])
def test_false_discoveries(dependent):
    rng, method = np.random.default_rng(0), "by" if dependent else "bh"
    for count in (1, 2, 17):
        chances = rng.random(count) ** 3
        chances[-1] = chances[0]  # ties
        expected = stats.false_discovery_control(chances, method=method)
        assert false_discoveries(chances.tolist(), dependent) == pytest.approx(expected, rel=1e-12)
    assert len(false_discoveries([])) == 0


def test_rank_correlation():
    rng = np.random.default_rng(1)
    for slope in (0.0, 0.3, -2.0):
        a = rng.normal(size=30)
        for b in (slope * a + rng.normal(size=30), np.round(slope * a + rng.normal(size=30))):
            expected = stats.spearmanr(a, b).pvalue
            assert rank_correlation_chance(a, b) == pytest.approx(expected, rel=1e-9)
    assert rank_correlation_chance(a, a**3) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(rank_correlation_chance(a, np.ones(30)))


@pytest.mark.parametrize("shape", [(1,), (200,), (200, 3), (200, 2, 3), (0, 3)])
def test_recursion_is_scipys_filter(shape):
    rng = np.random.default_rng(2)
    drive, start = rng.normal(size=shape), rng.normal(size=shape[1:])
    found = recursion(drive, 0.9, start)
    assert found.shape == (len(drive) + 1, *shape[1:])
    assert np.array_equal(found[0], start)
    if len(drive):
        expected = lfilter([1.0], [1.0, -0.9], drive, axis=0, zi=0.9 * start[None])[0]
        assert np.allclose(found[1:], expected, rtol=1e-13, atol=0.0)
    varying = recursion(drive, np.full(len(drive), 0.9), start)
    assert np.allclose(found, varying, rtol=1e-9, atol=1e-12)
