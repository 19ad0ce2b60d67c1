"""Domain randomization: the true robot of an episode, drawn anew at every reset."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from youbot_env.arguments import check_names
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import ImpossibleParameters, Parameters

TRIES = 200


class Randomization:
    """Draws a model around a given one."""

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

    def propose(self, model: Model, rng: np.random.Generator) -> Model:
        """Return one draw, possible or not."""
        raise NotImplementedError


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

    def propose(self, model: Model, rng: np.random.Generator) -> Model:
        """See the base class."""
        parameters = model.parameters.as_dict()
        effects = {active.identifier: dict(active.values) for active in model.effects}
        for name, (kind, a, b) in self.spec.items():
            group, _, key = name.rpartition(".")
            values = effects.get(group) if group else parameters
            if values is None or key not in values:
                known = [*parameters, *(f"{e}.{k}" for e, v in effects.items() for k in v)]
                raise ValueError(f"randomization of {name!r}: the model has {known}")
            if kind == "normal":
                values[key] = float(rng.normal(a, b))
            else:
                values[key] = float(rng.uniform(a, b)) * (values[key] if kind == "scale" else 1.0)
            if group:
                low, high = get_effect(group).parameter_of(key).bounds
                values[key] = float(np.clip(values[key], low, high))
        return replace(model, parameters=Parameters(**parameters)).with_effects(effects)


@dataclass(frozen=True)
class Posterior(Randomization):
    """Draws from the covariance that an identified model carries (normal distribution).

    Attributes:
        widen: factor on all standard deviations.
    """

    widen: float = 1.0

    def propose(self, model: Model, rng: np.random.Generator) -> Model:
        """See the base class; the model's covariance is over ``Model.names()``."""
        if model.covariance is None:
            raise ValueError(
                f"model {model.name!r} has no covariance; identify it (youbot identify) first"
            )
        covariance = np.array(model.covariance, float) * self.widen**2
        values = np.array(model.values())
        if covariance.shape != (values.size, values.size):
            raise ValueError(
                f"model {model.name!r}: covariance is {covariance.shape}, it has {values.size} "
                "values"
            )
        drawn = rng.multivariate_normal(values, covariance, method="eigh")
        for at, name in enumerate(model.names()):
            group, _, key = name.rpartition(".")
            if group:
                drawn[at] = np.clip(drawn[at], *get_effect(group).parameter_of(key).bounds)
        return model.with_values(drawn)
