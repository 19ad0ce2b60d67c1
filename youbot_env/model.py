"""A model of a robot: platform, parameters and effects, with where the numbers come from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from youbot_env.dynamics import Theta
from youbot_env.effects import Effect, get_effect
from youbot_env.parameters import Parameters
from youbot_env.platform import Platform


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with values for its parameters.

    Attributes:
        effect: the law.
        values: parameters by flat name, in the order the effect states them.
    """

    effect: Effect
    values: dict[str, float]

    @property
    def identifier(self) -> str:
        """Public name of the effect."""
        return self.effect.identifier


@dataclass(frozen=True)
class Model:
    """What somebody believes about a robot: nominal, identified, or (in a simulator) true.

    Attributes:
        platform: wheel table and radii.
        parameters: the seven physical parameters.
        effects: effects beyond them, in the order in which they were added.
        name: shown in tables; a model file's stem by default.
        sources: where each parameter comes from, by name.
        standard_errors: by name, in the parameter's unit; absent where unknown.
        covariance: covariance of ``names()`` as nested lists, or None.
        provenance: log hash, command, versions, date.
    """

    platform: Platform
    parameters: Parameters
    effects: tuple[ActiveEffect, ...] = ()
    name: str = "model"
    sources: dict[str, str] = field(default_factory=dict)
    standard_errors: dict[str, float] = field(default_factory=dict)
    covariance: list[list[float]] | None = None
    provenance: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        seen = [active.identifier for active in self.effects]
        if len(set(seen)) != len(seen):
            raise ValueError(f"model {self.name!r} lists an effect twice: {seen}")

    def with_effects(self, effects: dict[str, Any], name: str | None = None) -> Model:
        """Return a copy with effects added or replaced.

        Args:
            effects: identifier to values: a mapping of parameters, one number for the first
                parameter, or None for the typical size.
            name: name of the copy.
        """
        kept = [active for active in self.effects if active.identifier not in effects]
        added = []
        for identifier, values in effects.items():
            effect = get_effect(identifier)
            added.append(ActiveEffect(effect, effect.complete(values, self.platform)))
        return replace(self, effects=(*kept, *added), name=name or self.name)

    def names(self) -> tuple[str, ...]:
        """Flat names of all values: the seven of theta, then ``effect.parameter``."""
        flat = [f"{a.identifier}.{name}" for a in self.effects for name in a.values]
        return (*self.parameters.theta(self.platform)._fields, *flat)

    def values(self) -> tuple[float, ...]:
        """Values in the order of ``names()``."""
        flat = [value for active in self.effects for value in active.values.values()]
        return (*self.parameters.theta(self.platform), *flat)

    def with_values(self, values, name: str | None = None) -> Model:
        """Return a copy with other values in the order of ``names()``; nothing is checked."""
        values, at, effects = [float(v) for v in values], 7, []
        for active in self.effects:
            size = len(active.values)
            chosen = dict(zip(active.values, values[at : at + size], strict=True))
            effects.append(ActiveEffect(active.effect, chosen))
            at += size
        parameters = Parameters.from_theta(Theta(*values[:7]), self.platform)
        return replace(self, parameters=parameters, effects=tuple(effects), name=name or self.name)

    def check(self) -> Model:
        """Return self when physically possible, else raise ``ImpossibleParameters``."""
        self.parameters.check(self.platform)
        return self
