"""Search for the motion: sines on three axes within the limits, many starts, seeded."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ident.design.criterion import Criterion
from ident.design.limits import Limits
from ident.design.noise import Information, NoiseModel
from youbot_env.backend import NUMPY
from youbot_env.model import Model
from youbot_env.references import Fourier
from youbot_env.references.designed import fourier_values

# Samples a period of the highest sine during the search, and for the final check.
COARSE, FINE = 12, 100
# Iterations of every start, and of the best few that are carried on.
FIRST, LAST, KEPT = 40, 200, 2
STEP = 1e-6
# Periods that are tried, in periods of the natural one.
STRETCHES = (0.65, 0.8, 1.0)


@dataclass(frozen=True)
class Plan:
    """Where one search starts.

    Attributes:
        period: of the motion, s.
        seed: of the first coefficients.
    """

    period: float
    seed: np.random.SeedSequence


@dataclass(frozen=True)
class Candidate:
    """Result of one search.

    Attributes:
        plan: where it started.
        coefficients: (3 (2 N - 1),) of the velocities, in the search's units.
        motion: the reference.
        information: in one sample of it.
        use: (K, 4 + n) squared shares of the limits over a period.
        value: of the criterion for one sample.
    """

    plan: Plan
    coefficients: np.ndarray
    motion: Fourier
    information: Information
    use: np.ndarray
    value: float


class Search:
    """Minimise a criterion over the coefficients of a plan.

    The velocity of each axis is ``sum_k a_k sin(k w t) + b_k cos(k w t)``; the last b is such that
    the robot is at rest at the start of every period.

    Args:
        criterion: what is made small.
        model: robot for which noise, torques and intervals are expected.
        limits: what the motion keeps to.
        harmonics: N, sines an axis.
        noise: of the sensors.
    """

    def __init__(
        self,
        criterion: Criterion,
        model: Model,
        limits: Limits,
        harmonics: int,
        noise: NoiseModel,
    ):
        self.criterion, self.model, self.limits, self.noise = criterion, model, limits, noise
        self.harmonics = harmonics
        silent = ((0.0,) * harmonics,) * 3
        self._shape = Fourier(amplitudes=silent, phases=silent)
        first = (limits.speed, limits.speed, limits.yaw_rate)
        self.units = np.repeat(first, 2 * harmonics - 1) / math.sqrt(harmonics)

    def start(self, plan: Plan) -> np.ndarray:
        """Random coefficients, scaled to touch the limits."""
        drawn = np.random.default_rng(plan.seed).normal(size=len(self.units))
        use = self._motion(drawn[None], plan)[1]
        return drawn / math.sqrt(max(use.max(), 1.0))

    def improve(self, plan: Plan, start: np.ndarray, iterations: int) -> Candidate:
        """Follow sequential quadratic programs from a start."""
        last: dict[str, np.ndarray] = {}

        def evaluated(x: np.ndarray) -> dict[str, np.ndarray]:
            if not np.array_equal(last.get("x"), x):
                moved = np.vstack([x, x + STEP * np.eye(len(x))])
                value, room = self._evaluate(moved, plan)
                last.update(x=x.copy(), value=value[0], room=room[0])
                last.update(slope=(value[1:] - value[0]) / STEP, bend=(room[1:] - room[0]).T / STEP)
            return last

        result = minimize(
            lambda x: evaluated(x)["value"],
            start,
            jac=lambda x: evaluated(x)["slope"],
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda x: evaluated(x)["room"],
                "jac": lambda x: evaluated(x)["bend"],
            },
            options={"maxiter": iterations, "ftol": 1e-5},
        )
        return self.finish(plan, result.x if np.isfinite(result.x).all() else start)

    def finish(self, plan: Plan, x: np.ndarray) -> Candidate:
        """The motion of coefficients x, shrunk until a fine grid keeps the limits."""
        while True:
            columns, use = self._motion(x[None], plan, FINE)
            if use.max() <= 1.0:
                break
            x = x * min(0.999, 0.3 + 0.7 / math.sqrt(use.max()))
        amplitudes, phases = (part[0] for part in self._sines(x[None], plan))
        motion = Fourier(
            speed=self.limits.speed * math.sqrt(use[..., 0].max()),
            frequency=2 * math.pi / plan.period,
            amplitudes=tuple(map(tuple, amplitudes.tolist())),
            phases=tuple(map(tuple, phases.tolist())),
            purpose=self.criterion.name,
        )
        information = self.noise.information(columns[0], plan.period / columns.shape[1])
        value = float(self.criterion.value(information.covariance(1.0)))
        return Candidate(plan, x, motion, information, use[0], value)

    def _evaluate(self, x: np.ndarray, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Criterion (B,) and room left under the limits (B, C) for coefficients (B, D)."""
        columns, use = self._motion(x, plan)
        dt = plan.period / columns.shape[1]
        covariance = self.noise.information(columns, dt).covariance(1.0)
        return self.criterion.value(covariance), 1.0 - use.reshape(len(x), -1)

    def _motion(self, x: np.ndarray, plan: Plan, density: int = COARSE) -> tuple:
        count = density * self.harmonics
        time = np.arange(count) * plan.period / count
        amplitudes, phases = self._sines(x, plan)
        frequency = 2 * math.pi / plan.period
        values = fourier_values(amplitudes, phases, frequency)
        return self.limits.evaluate(self._shape.evaluate(values, time, NUMPY), self.model)

    def _sines(self, x: np.ndarray, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes and phases (B, 3, N) of the pose for coefficients (B, D) of the velocity."""
        rows = (x * self.units).reshape(len(x), 3, -1)
        w = 2 * math.pi / plan.period
        a, b = rows[..., : self.harmonics], rows[..., self.harmonics :]
        b = np.concatenate([b, -b.sum(axis=-1, keepdims=True)], axis=-1)
        each = np.arange(1, self.harmonics + 1) * w
        return np.hypot(a, b) / each, np.arctan2(-a, b)


def plans(limits: Limits, harmonics: int, seconds: float, starts: int, seed: int) -> list[Plan]:
    """Starts of different period; a whole number of periods fills the time."""
    # At speed / acceleration a sine is at both limits; the highest sine lies above that.
    natural = 2 * math.pi * harmonics * limits.speed / limits.acceleration
    made = []
    for number, child in enumerate(np.random.SeedSequence(seed).spawn(starts)):
        wanted = STRETCHES[number % len(STRETCHES)] * natural
        made.append(Plan(seconds / max(1, round(seconds / wanted)), child))
    return made


def search_motion(
    search: Search, starts: list[Plan], progress: Callable[[float], None] | None = None
) -> list[Candidate]:
    """Improve all starts a little and the best of them to the end.

    Args:
        search: the problem.
        starts: where to begin.
        progress: called with the share of the work done.

    Returns:
        All candidates, the best first.
    """
    kept = min(KEPT, len(starts))
    work, done = len(starts) * FIRST + kept * LAST, 0
    found: list[Candidate] = []

    def advance(steps: int) -> None:
        nonlocal done
        done += steps
        if progress is not None:
            progress(done / work)

    for plan in starts:
        found.append(search.improve(plan, search.start(plan), FIRST))
        advance(FIRST)
    found.sort(key=lambda c: c.value)
    for number, candidate in enumerate(found[:kept]):
        further = search.improve(candidate.plan, candidate.coefficients, LAST)
        found[number] = min(candidate, further, key=lambda c: c.value)
        advance(LAST)
    return sorted(found, key=lambda c: c.value)
