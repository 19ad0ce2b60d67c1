"""Models against a measurement: errors of the equations and of the free run.

Two errors: that of the equations (filtered forces) and that of the free run (velocities
simulated from the drive input alone).  Each is given in physical units and as a share of the
signal's rms about its mean.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np

from ident.comparison.moments import Moments
from ident.comparison.ripple import Harmonic, harmonics
from ident.comparison.shares import DRAWS, Regime, locate
from ident.comparison.stretches import LEAST_WINDOWS, Stretch, window_errors, worst_stretches
from ident.free_run import WINDOW, FreeRun, free_run
from ident.instruments import without_instruments
from ident.log import Log
from ident.pooling import as_list, as_one
from ident.recording import find_recordings
from ident.recording_words import Instrument
from ident.regression import AXES, Regression, build_regression
from ident.results import Shown
from ident.threads import one_thread
from youbot_env.arguments import several
from youbot_env.model import Model
from youbot_env.model_file import load_model

VELOCITIES = ("vx", "vy", "yaw_rate")
UNITS = ("m/s", "m/s", "rad/s")
# Units of the equations' two forces and moment, by what drives the wheels.  The factor from volts
# to torque is not known to a log.
FORCE_UNITS = {"torque": ("N", "N", "N m"), "voltage": ("V/m", "V/m", "V")}


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """One model against one log.

    Attributes:
        model: the model.
        log: what it is compared with; states what was found of its recording.
        recording: how its rows came to be.
        run: its free run.
        run_ci95: interval of ``run.nrmse`` over the windows; None where there are too few.
        regression: the rows of the equations.
        residual: (N, 3) what they leave, in N m as the rows are.
        moments: what the log shows at these rows.
        equation: (4,) normalised equation error of X, Y, yaw and all.
        where: regimes; those where the error gathers first.
        ripple: harmonics of the wheel angles in the residual.
        worst: windows of the free run with most error.
    """

    model: Model
    log: Log
    run: FreeRun
    run_ci95: tuple[float, float] | None
    regression: Regression
    residual: np.ndarray
    moments: Moments
    equation: np.ndarray
    where: tuple[Regime, ...]
    ripple: tuple[Harmonic, ...]
    worst: tuple[Stretch, ...]
    recording: tuple[Instrument, ...] = ()

    @property
    def run_nrmse(self) -> np.ndarray:
        """(3,) free-run errors as shares of each velocity's rms about its mean."""
        return self.run.rmse / np.maximum(self.run.measured.std(axis=0), 1e-12)

    @property
    def force_residual(self) -> np.ndarray:
        """(N, 3) what the equations leave of F_X, F_Y, N, and M_O, N m (see ``force_units``)."""
        lever = self.regression.lever
        return self.residual / (lever, lever, 1.0)

    @property
    def force_rmse(self) -> np.ndarray:
        """(3,) rms of ``force_residual``."""
        return np.sqrt(np.mean(self.force_residual**2, axis=0))

    @property
    def force_units(self) -> tuple[str, str, str]:
        """Units of ``force_residual``."""
        return FORCE_UNITS[self.log.drive]

    def headline(self) -> str:
        """See the base class."""
        return Comparisons([self]).headline()

    def table(self) -> dict[str, list[Any]]:
        """Where the error gathers."""
        return {
            name: [one[name] for one in map(Regime.as_dict, self.where)]
            for name in (self.where[0].as_dict() if self.where else ())
        }

    def plot(self):
        """Measured and simulated velocities."""
        return Comparisons([self]).plot()

    def as_dict(self) -> dict[str, Any]:
        """Return what ``youbot compare --json`` writes for one model."""
        return {
            "model": self.model.name,
            "free_run": _named(VELOCITIES, self.run.rmse) | {"nrmse": self.run.nrmse},
            "equation": _named((*AXES, "nrmse"), self.equation),
            "where": [regime.as_dict() for regime in self.where],
            "free_run_nrmse": _named(VELOCITIES, self.run_nrmse),
            "free_run_ci95": None if self.run_ci95 is None else list(self.run_ci95),
            "equation_rms": _named(AXES, self.force_rmse)
            | {"units": dict(zip(AXES, self.force_units, strict=True))},
            "recording": [one.as_dict() for one in self.recording],
            "harmonics": [harmonic.as_dict() for harmonic in self.ripple],
            "worst": [stretch.as_dict() for stretch in self.worst],
        }


class Comparisons(Shown, list):
    """What ``compare`` returns: a list of a ``Comparison`` of every model, as they were given."""

    def headline(self) -> str:
        """See the base class."""
        best = min(self, key=lambda one: one.run.nrmse)
        error = f"free-run error {100 * best.run.nrmse:.3g} %"
        rank = " is the best of these" if len(self) > 1 else ""
        return f"{best.log.name}: {best.model.name}{rank}, {error}"

    def table(self) -> dict[str, list[Any]]:
        """A row for each model."""
        ends = [one.run_ci95 or (None, None) for one in self]
        errors = np.array([one.run.rmse for one in self]).T.tolist()
        return {
            "model": [one.model.name for one in self],
            "free-run error": [one.run.nrmse for one in self],
            "low": [low for low, _ in ends],
            "high": [high for _, high in ends],
            **{f"{name} {unit}": column
               for name, unit, column in zip(VELOCITIES, UNITS, errors, strict=True)},
            "equation error": [float(one.equation[3]) for one in self],
        }  # fmt: skip

    def plot(self):
        """Measured velocities and those that each model simulates."""
        from ident.comparison.standing import rank
        from ident.report.compare import colored
        from ident.report.motion import velocities_figure

        drawn = [(one.model.name, color, one.run) for color, one in colored(rank(self))]
        return velocities_figure.on_canvas(drawn)

    def as_dict(self) -> dict[str, Any]:
        """See the base class."""
        return {"models": [one.as_dict() for one in self]}

    def __repr__(self) -> str:
        return Shown.__repr__(self) if self else "Comparisons: none"


@one_thread
def compare(
    log: Log | Sequence[Log],
    models: str | PathLike | Model | Iterable[str | PathLike | Model],
    window: float = WINDOW,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Comparisons:
    """Compare models with logs.

    Args:
        log: measured record with a drive input; several count as runs of one record.
        models: a model, its file or name, or any number of these, on the log's platform.
        window: length of the free runs, s.
        seed: of the resampling behind the intervals; the same draws for every model.
        progress: called with the number of models done.

    Raises:
        ValueError: a model on another platform, or a log without drive input or too short.
    """
    log = as_one(as_list(log))
    models = [load_model(model) for model in several(models, str, PathLike, Model)]
    if not models:
        raise ValueError("models is empty; give at least one model, its file or its name")
    models, found = [without_instruments(model) for model in models], Comparisons()
    for model in models:
        check_platform(log, model)
    # The recording is found once, beside the model that knows most: it is the same for all.
    most = max(models, key=lambda model: len(model.effects))
    late = any(active.effect.late for model in models for active in model.effects)
    record = find_recordings([log], most, signed=not late)[0]
    for number, model in enumerate(models, start=1):
        one = _compare(record.log, model, window, seed)
        found.append(replace(one, recording=record.instruments))
        if progress is not None:
            progress(number)
    return found


def check_platform(log: Log, model: Model) -> None:
    """Refuse a model on another platform: the log's velocities would not be those it speaks of.

    Raises:
        ValueError: wheel table or radii differ from those the log was read with.
    """
    if model.platform.geometry != log.platform.geometry:
        raise ValueError(
            f"model {model.name!r} stands on platform {model.platform.name!r} with another wheel "
            f"table or radii than the one log {log.name!r} was read with "
            f"({log.platform.name!r}); compare models of one platform, or each with a log read "
            "for its own"
        )


def _compare(log: Log, model: Model, window: float, seed: int) -> Comparison:
    shares, windows = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    regression = build_regression(log, model)
    values = dict(zip(model.names(), model.values(), strict=True))
    residual = regression.residual(np.array([values[name] for name in regression.names]))
    spread = regression.y.std(axis=0)
    by_axis = np.sqrt(np.mean(residual**2, axis=0)) / spread
    total = np.sqrt(np.mean(residual**2) / np.mean(spread**2))
    moments, run = Moments.of(log, regression), free_run(log, model, window)
    return Comparison(
        model,
        log,
        run,
        _interval(window_errors(run), windows),
        regression,
        residual,
        moments,
        np.append(by_axis, total),
        locate(moments, regression, residual, shares),
        harmonics(log, model, regression, residual),
        worst_stretches(log, run),
    )


def _interval(squared: np.ndarray, rng: np.random.Generator) -> tuple[float, float] | None:
    """Interval of the root of the mean of windows' squared errors (W,)."""
    if len(squared) < LEAST_WINDOWS:
        return None
    drawn = squared[rng.integers(0, len(squared), (DRAWS, len(squared)))]
    low, high = np.quantile(np.sqrt(drawn.mean(axis=1)), [0.025, 0.975])
    return float(low), float(high)


def _named(names: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}
