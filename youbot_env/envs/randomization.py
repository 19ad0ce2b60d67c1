"""Domain randomization: the true robot of an episode, drawn anew at every reset."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from youbot_env.arguments import check_names
from youbot_env.backend import FLOAT, Ops, weighted_sum
from youbot_env.dynamics import Theta
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import ImpossibleParameters, Parameters

TRIES = 200


class Randomization:
    """Draws a model around a given one.

    A subclass states how many random numbers a robot takes and makes its values from them, by a
    function over components; then many robots are drawn at once.  One that overrides ``propose``
    instead works as well, one robot after the other.
    """

    def draws(self, model: Model) -> int | None:
        """How many numbers ``values`` takes for a robot; None where only ``propose`` is known."""
        return None

    def values(self, model: Model, numbers, ops: Ops) -> list:
        """Values in the order of ``model.names()``, components, from numbers drawn in [0, 1)."""
        raise NotImplementedError

    def propose(self, model: Model, rng: np.random.Generator) -> Model:
        """Return one draw, possible or not."""
        count = self.draws(model)
        if count is None:
            raise NotImplementedError
        return model.with_values(self.values(model, rng.random(count).tolist(), FLOAT))

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
        raise ImpossibleParameters(
            f"randomization found no possible robot in {TRIES} draws, the last had: "
            f"{'; '.join(problems)}; narrow it"
        )

    def drawn_together(self, model: Model) -> bool:
        """Whether ``candidate`` says all of how a robot is drawn."""
        kind, base = type(self), Randomization
        own = kind.propose is not base.propose or kind.draw is not base.draw
        return not own and self.draws(model) is not None

    def candidate(self, model: Model, numbers, ops: Ops) -> tuple[list, Any]:
        """What ``draw`` does once, over components: values, and whether they are possible."""
        values = self.values(model, numbers, ops)
        parameters = Parameters.from_theta(Theta(*values[:7]), model.platform)
        rules = parameters.rules(model.platform, ops).values()
        return values, reduce(operator.and_, rules)


def _normal(numbers, ops: Ops) -> list:
    """Standard normal numbers from twice as many uniform ones, by Box and Muller."""
    pairs = zip(numbers[0::2], numbers[1::2], strict=True)
    return [ops.sqrt(-2.0 * ops.log(1.0 - a)) * ops.cos(2.0 * math.pi * b) for a, b in pairs]


def _bounded(name: str, value, ops: Ops):
    """The value of an effect's parameter (``effect.parameter``) within its bounds."""
    group, _, key = name.rpartition(".")
    if not group:
        return value
    low, high = get_effect(group).parameter_of(key).bounds
    return ops.minimum(ops.maximum(value, low), high)


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

    def values(self, model: Model, numbers, ops: Ops) -> list:
        """See the base class."""
        parameters = model.parameters.as_dict()
        effects = {f"{e.identifier}.{k}": v for e in model.effects for k, v in e.values.items()}
        known: dict[str, Any] = parameters | effects
        at = 0
        for name, (kind, a, b) in self.spec.items():
            if name not in known:
                raise ValueError(f"randomization of {name!r}: the model has {[*known]}")
            a, b = float(a), float(b)
            if kind == "normal":
                (share,) = _normal(numbers[at : at + 2], ops)
                drawn, at = a + b * share, at + 2
            else:
                drawn, at = a + (b - a) * numbers[at], at + 1
                drawn = drawn * known[name] if kind == "scale" else drawn
            known[name] = _bounded(name, drawn, ops)
        theta = Parameters(*(known[name] for name in parameters)).theta(model.platform)
        return [*theta, *(known[name] for name in effects)]


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

    def values(self, model: Model, numbers, ops: Ops) -> list:
        """See the base class; the model's covariance is over ``Model.names()``."""
        if model.covariance is None:
            raise ValueError(
                f"model {model.name!r} has no covariance; identify it (youbot identify) first"
            )
        covariance = np.array(model.covariance, float) * self.widen**2
        mean = model.values()
        if covariance.shape != (len(mean),) * 2:
            raise ValueError(
                f"model {model.name!r}: covariance is {covariance.shape}, it has {len(mean)} values"
            )
        squares, axes = np.linalg.eigh(covariance)
        root = (axes * np.sqrt(np.maximum(squares, 0.0))).tolist()
        normal = _normal(numbers, ops)
        drawn = [m + weighted_sum(row, normal) for m, row in zip(mean, root, strict=True)]
        return [
            _bounded(name, value, ops) for name, value in zip(model.names(), drawn, strict=True)
        ]
