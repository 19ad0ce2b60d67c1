"""Domain randomization: the true robot of an episode, drawn anew at every reset."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from youbot_env.arguments import check_names
from youbot_env.dynamics import Theta
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import ImpossibleParameters, Parameters

TRIES = 200
# Draws numbers in [0, 1) for some robots: (how many each, which robots) -> (how many, robots).
Numbers = Callable[[int, np.ndarray], np.ndarray]


class Randomization:
    """Draws a model around a given one.

    A subclass states how many random numbers a robot takes and makes its values from them; then
    many robots are drawn at once.  One that overrides ``propose`` instead works as well, one robot
    after the other.
    """

    def draws(self, model: Model) -> int | None:
        """How many numbers ``values`` takes for a robot; None where only ``propose`` is known."""
        return None

    def values(self, model: Model, numbers: np.ndarray) -> np.ndarray:
        """Values (V, n) in the order of ``model.names()`` from numbers (K, n) drawn in [0, 1)."""
        raise NotImplementedError

    def propose(self, model: Model, rng: np.random.Generator) -> Model:
        """Return one draw, possible or not."""
        count = self.draws(model)
        if count is None:
            raise NotImplementedError
        return model.with_values(self.values(model, rng.random((count, 1)))[:, 0])

    def draw(self, model: Model, rng: np.random.Generator) -> Model:
        """Return a possible robot; impossible draws are drawn again.

        Raises:
            ImpossibleParameters: no possible robot in 200 draws.
        """
        for _ in range(TRIES):
            candidate = self.propose(model, rng)
            problems = candidate.parameters.problems(candidate.platform)
            if not problems:
                return candidate
        raise _too_wide(problems)

    def draw_many(self, model: Model, numbers: Numbers, count: int) -> np.ndarray | None:
        """Values (V, n) of possible robots, each as ``draw`` gives it with its generator.

        Args:
            model: the robot drawn around.
            numbers: draws from the generators of the robots.
            count: n.

        Returns:
            None where only ``propose`` is known.

        Raises:
            ImpossibleParameters: see ``draw``.
        """
        each, kind = self.draws(model), type(self)
        own = kind.propose is not Randomization.propose or kind.draw is not Randomization.draw
        if each is None or own:
            return None
        left, result = np.arange(count), np.empty((len(model.names()), count))
        for _ in range(TRIES):
            result[:, left] = self.values(model, numbers(each, left))
            parameters = Parameters.from_theta(Theta(*result[:7, left]), model.platform)
            wrong = np.logical_or.reduce(list(parameters.violations(model.platform).values()))
            if not wrong.any():
                return result
            left = left[wrong]
        last = model.with_values(result[:, left[0]])
        raise _too_wide(last.parameters.problems(model.platform))


def _too_wide(problems: list[str]) -> ImpossibleParameters:
    return ImpossibleParameters(
        f"randomization found no possible robot in {TRIES} draws, the last had: "
        f"{'; '.join(problems)}; narrow it"
    )


def _normal(numbers: np.ndarray) -> np.ndarray:
    """Standard normal numbers (K, n) from uniform ones (2 K, n), by Box and Muller."""
    length = np.sqrt(-2.0 * np.log1p(-numbers[0::2]))
    return length * np.cos(2.0 * math.pi * numbers[1::2])


@dataclass(frozen=True)
class Independent(Randomization):
    """Each named value drawn by itself.

    Attributes:
        spec: name to a triple (kind, a, b): ``("uniform", low, high)`` or ``("normal", mean,
            standard deviation)`` in the parameter's own unit, or ``("scale", low, high)``, a factor
            drawn uniformly on the model's value.  Names are those of ``Parameters`` (m0, a_x, ...)
            and ``effect.parameter`` of effects that the model has.
    """

    spec: dict[str, tuple[str, float, float]]

    def __post_init__(self) -> None:
        for name, entry in check_names("spec", self.spec, "{name: (kind, a, b)}").items():
            whole = isinstance(entry, tuple | list) and len(entry) == 3
            kind, *ends = entry if whole else ("",)
            numbers = all(isinstance(end, int | float | np.number) for end in ends)
            if (
                kind not in ("uniform", "normal", "scale")
                or not np.isfinite(ends if numbers else np.nan).all()
            ):
                raise ValueError(
                    f"randomization of {name}: {entry!r}; give ('uniform', low, high), "
                    "('normal', mean, deviation) or ('scale', low, high)"
                )

    def draws(self, model: Model) -> int:
        """See the base class."""
        return sum(2 if kind == "normal" else 1 for kind, _, _ in self.spec.values())

    def values(self, model: Model, numbers: np.ndarray) -> np.ndarray:
        """See the base class."""
        parameters = model.parameters.as_dict()
        effects = {f"{e.identifier}.{k}": v for e in model.effects for k, v in e.values.items()}
        known, at = parameters | effects, 0
        for name, (kind, a, b) in self.spec.items():
            if name not in known:
                raise ValueError(f"randomization of {name!r}: the model has {[*known]}")
            if kind == "normal":
                drawn = a + b * _normal(numbers[at : at + 2])[0]
            else:
                drawn = a + (b - a) * numbers[at]
                drawn = drawn * known[name] if kind == "scale" else drawn
            at += 2 if kind == "normal" else 1
            group, _, key = name.rpartition(".")
            if group:
                drawn = np.clip(drawn, *get_effect(group).parameter_of(key).bounds)
            known[name] = drawn
        theta = Parameters(*(known[name] for name in parameters)).theta(model.platform)
        rows = (*theta, *(known[name] for name in effects))
        return np.array([np.broadcast_to(row, numbers.shape[1:]) for row in rows])


@dataclass(frozen=True)
class Posterior(Randomization):
    """Draws from the covariance that an identified model carries (normal distribution).

    Attributes:
        widen: factor on all standard deviations.
    """

    widen: float = 1.0

    def draws(self, model: Model) -> int:
        """See the base class."""
        return 2 * len(model.names())

    def values(self, model: Model, numbers: np.ndarray) -> np.ndarray:
        """See the base class; the model's covariance is over ``Model.names()``."""
        if model.covariance is None:
            raise ValueError(
                f"model {model.name!r} has no covariance; identify it (youbot identify) first"
            )
        covariance = np.array(model.covariance, float) * self.widen**2
        mean = np.array(model.values())
        if covariance.shape != (mean.size, mean.size):
            raise ValueError(
                f"model {model.name!r}: covariance is {covariance.shape}, it has {mean.size} values"
            )
        squares, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(squares, 0.0))
        drawn = mean[:, None] + root @ _normal(numbers)
        for at, name in enumerate(model.names()):
            group, _, key = name.rpartition(".")
            if group:
                drawn[at] = np.clip(drawn[at], *get_effect(group).parameter_of(key).bounds)
        return drawn
