"""The robots that are driven: what is true of them, and what is believed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from youbot_env.model import Model
from youbot_env.parameters import Parameters

NOMINAL, IDENTIFIED, INFORMED, ORACLE = "nominal", "identified", "identified + effects", "oracle"
MODELS = (NOMINAL, IDENTIFIED, INFORMED, ORACLE)
PLANTS = {"analytic": "YouBot-v0", "rollers": "YouBotRollers-v0"}
# Factors, drawn uniformly, between the centre of the population and each of its robots.
SPREAD = (0.85, 1.15)


@dataclass(frozen=True)
class Subject:
    """One robot of the comparison.

    Attributes:
        plant: ``analytic`` or ``rollers``.
        number: which robot of the population; the same on both plants.
        truth: what the plant is made from.  Only ``model`` and the plant read it.
        seed: of reference and sensor noise of every run of this robot, so that runs pair.
        beliefs: models by name: nominal, identified, identified + effects.
        half_widths: of the 95 % intervals of the last of them, by parameter.
    """

    plant: str
    number: int
    truth: Model = field(repr=False)
    seed: int
    beliefs: dict[str, Model] = field(default_factory=dict)
    half_widths: dict[str, float] = field(default_factory=dict)

    def model(self, name: str) -> Model:
        """What a controller of this robot believes; ``oracle`` is the only way to the truth.

        On the plant with real rollers even the oracle lacks something: no equation of the model
        describes contacts and finite rollers.
        """
        return replace(self.truth, name=ORACLE) if name == ORACLE else self.beliefs[name]


def draw_subjects(
    plant: str, count: int, centre: Model, effects: dict[str, float], seed: int
) -> list[Subject]:
    """Draw robots with hidden effects around a centre.

    Args:
        plant: a name of ``PLANTS``.
        count: number of robots; more leave the first ones as they are.
        centre: model in the middle of the population.
        effects: what is hidden, with the size in the middle of the population.
        seed: of parameters, sizes and runs.

    Raises:
        ValueError: an unknown plant.
    """
    if plant not in PLANTS:
        raise ValueError(f"unknown plant {plant!r}; known: {sorted(PLANTS)}")
    subjects = []
    for number, child in enumerate(np.random.SeedSequence(seed).spawn(count)):
        drawn, runs = child.spawn(2)
        rng = np.random.default_rng(drawn)
        truth = _draw(centre, effects, rng, f"robot {number}")
        subjects.append(Subject(plant, number, truth, int(runs.generate_state(1)[0])))
    return subjects


def _draw(centre: Model, effects: dict[str, float], rng: np.random.Generator, name: str) -> Model:
    """The first draw that describes a possible robot."""
    values = centre.parameters.as_dict()
    while True:
        factors = rng.uniform(*SPREAD, len(values) + len(effects))
        scaled = {k: v * f for (k, v), f in zip(values.items(), factors, strict=False)}
        parameters = Parameters(**scaled)
        sizes = zip(effects.items(), factors[len(values) :], strict=True)
        if not parameters.problems(centre.platform):
            robot = replace(centre, parameters=parameters, sources={}, provenance={})
            return robot.with_effects({k: size * f for (k, size), f in sizes}, name)
