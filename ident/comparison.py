"""Models against a measurement: how large the error is, and where it is.

Two errors: that of the equations (filtered forces) and that of the free run (velocities
simulated from the drive input alone).  Each is normalised by the signal's rms about its mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.free_run import WINDOW, FreeRun, free_run
from ident.log import Log
from ident.regression import AXES, Regression, build_regression
from youbot_env.model import Model

# Stretches of time from whose scatter the intervals are taken.
STRETCHES = 24
DRAWS = 400
QUARTERS = ("first", "second", "third", "last")
HEADINGS = ("0", "90", "180", "270")


@dataclass(frozen=True)
class Regime:
    """A kind of moment, and its part in the squared equation error.

    Attributes:
        name: in words, e.g. ``wheels reversing``.
        share_of_error, share_of_time: of the whole record.
        ci95: interval of ``share_of_error`` from resampled stretches of time.
    """

    name: str
    share_of_error: float
    share_of_time: float
    ci95: tuple[float, float]

    @property
    def excess(self) -> float:
        """How much more error than time: above one the error gathers here."""
        return self.share_of_error / self.share_of_time

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "regime": self.name,
            "share_of_error": self.share_of_error,
            "share_of_time": self.share_of_time,
            "ci95": list(self.ci95),
        }


@dataclass(frozen=True)
class Comparison:
    """One model against one log.

    Attributes:
        model: the model.
        run: its free run.
        equation: (4,) normalised equation error of X, Y, yaw and all.
        where: regimes, those with most error for their time first.
    """

    model: Model
    run: FreeRun
    equation: np.ndarray
    where: tuple[Regime, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return what ``compare.py --json`` writes for one model."""
        vx, vy, yaw = (float(v) for v in self.run.rmse)
        names = (*AXES, "nrmse")
        return {
            "model": self.model.name,
            "free_run": {"vx": vx, "vy": vy, "yaw_rate": yaw, "nrmse": self.run.nrmse},
            "equation": dict(zip(names, self.equation.tolist(), strict=True)),
            "where": [regime.as_dict() for regime in self.where],
        }


def compare(
    log: Log, models: list[Model], window: float = WINDOW, seed: int = 0
) -> list[Comparison]:
    """Compare models with a log.

    Args:
        log: measured record.
        models: any number of models on the log's platform.
        window: length of the free runs, s.
        seed: of the resampling behind the intervals.
    """
    found = []
    for model in models:
        regression = build_regression(log, model)
        values = dict(zip(model.names(), model.values(), strict=True))
        residual = regression.residual(np.array([values[name] for name in regression.names]))
        spread = regression.y.std(axis=0)
        by_axis = np.sqrt(np.mean(residual**2, axis=0)) / spread
        total = np.sqrt(np.mean(residual**2) / np.mean(spread**2))
        squared = (residual / np.sqrt(np.mean(spread**2))) ** 2
        where = locate(log, regression, squared, np.random.default_rng(seed))
        found.append(
            Comparison(model, free_run(log, model, window), np.append(by_axis, total), where)
        )
    return found


def locate(
    log: Log, regression: Regression, squared: np.ndarray, rng: np.random.Generator
) -> tuple[Regime, ...]:
    """Split squared errors (N, 3) over regimes and rank those by error for their time."""
    total, count = squared.sum(axis=1), len(squared)
    stretch = (np.arange(count) * STRETCHES) // count
    drawn = rng.integers(0, STRETCHES, (DRAWS, STRETCHES))
    energy = np.bincount(stretch, total, STRETCHES)[drawn].sum(axis=1)
    regimes = []
    for name, mask in _regimes(log, regression):
        time_share = float(mask.mean())
        if not 0.02 < time_share < 0.98:
            continue
        inside = np.bincount(stretch, total * mask, STRETCHES)
        shares = inside[drawn].sum(axis=1) / energy
        low, high = np.quantile(shares, [0.025, 0.975])
        regimes.append(
            Regime(name, float(inside.sum() / total.sum()), time_share, (float(low), float(high)))
        )
    for axis, part in zip(AXES, squared.sum(axis=0), strict=True):
        inside = np.bincount(stretch, squared[:, AXES.index(axis)], STRETCHES)
        shares = inside[drawn].sum(axis=1) / energy
        low, high = np.quantile(shares, [0.025, 0.975])
        regimes.append(
            Regime(f"axis {axis}", float(part / total.sum()), 1 / 3, (float(low), float(high)))
        )
    return tuple(sorted(regimes, key=lambda regime: -regime.excess))


def _regimes(log: Log, regression: Regression):
    """Masks (N,) over the rows of the regression, by name."""

    def at(values: np.ndarray) -> np.ndarray:
        return np.interp(regression.time, log.time, values)

    v = np.stack([at(column) for column in log.velocity().T], axis=1)
    lever, wheels = log.platform.lever, v @ log.platform.jacobian_array.T
    speed = np.linalg.norm(v * (1.0, 1.0, lever), axis=1)
    yield from _thirds("speed", speed)
    slow = 0.1 * np.sqrt(np.mean(wheels**2))
    yield "a wheel near standstill", np.any(np.abs(wheels) < slow, axis=1)
    yield "forward", v[:, 0] > np.abs(v[:, 1])
    yield "backward", -v[:, 0] > np.abs(v[:, 1])
    yield "to the left", v[:, 1] > np.abs(v[:, 0])
    yield "to the right", -v[:, 1] > np.abs(v[:, 0])
    yield "turning left", v[:, 2] > 0.3 * np.abs(v[:, 2]).max()
    yield "turning right", -v[:, 2] > 0.3 * np.abs(v[:, 2]).max()
    yield from _thirds("torque", np.linalg.norm([at(u) for u in log.command.T], axis=0))
    part = np.arange(len(v)) * 4 // len(v)
    for k, name in enumerate(QUARTERS):
        yield f"{name} quarter of the time", part == k
    if log.pose is not None:
        heading = np.mod(np.round(at(log.pose[:, 2]) / (np.pi / 2)), 4)
        for k, name in enumerate(HEADINGS):
            yield f"heading near {name} deg", heading == k
        away = np.hypot(*(at(c) - np.median(c) for c in log.pose[:, :2].T))
        yield from _thirds("distance from the middle of the path", away)


def _thirds(name: str, values: np.ndarray):
    low, high = np.quantile(values, [1 / 3, 2 / 3])
    yield f"low {name}", values <= low
    yield f"high {name}", values > high
