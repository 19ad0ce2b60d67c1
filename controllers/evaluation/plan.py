"""Which controllers, models and motions are compared, split into jobs that run on their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from controllers import find
from controllers.evaluation.motions import FREQUENCIES, Motion
from controllers.evaluation.subjects import MODELS, NOMINAL

# The comparison of the paper, kinematic against dynamic control, is made on every motion; the
# others are measured on the first reference in the middle of the frequencies, unless asked for.
MAIN = ("kinematic", "computed_torque", "mpc")
ROLLER_REFERENCES = ("eight", "circle")
ROLLER_FREQUENCIES = (0.25, 0.5, 1.0, 2.0, 3.0)
OTHER_FREQUENCIES = (0.5, 1.0, 2.0, 3.0)


@dataclass(frozen=True)
class Block:
    """Every controller with every model on every motion, on one plant.

    Attributes:
        plant: ``analytic`` or ``rollers``.
        controllers, models, references, frequencies: what is combined.
    """

    plant: str
    controllers: tuple[str, ...]
    models: tuple[str, ...]
    references: tuple[str, ...]
    frequencies: tuple[float, ...]

    @property
    def motions(self) -> list[Motion]:
        """All references at all frequencies."""
        return [Motion(name, w) for name in self.references for w in self.frequencies]

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Controllers with the models they believe; one for those that use none."""
        for controller in self.controllers:
            models = self.models if find(controller).uses_model else (NOMINAL,)
            yield from ((controller, model) for model in models)


@dataclass(frozen=True)
class Job:
    """What one process does at a time: one robot, one controller, one model, some motions."""

    plant: str
    robot: int
    controller: str
    model: str
    motions: tuple[Motion, ...]


def make_jobs(blocks: list[Block], robots: dict[str, int]) -> list[Job]:
    """Jobs of all blocks for the first robots of each plant, the longest first."""
    jobs = [
        Job(block.plant, robot, controller, model, tuple(block.motions))
        for block in blocks
        for robot in range(robots[block.plant])
        for controller, model in block.pairs()
    ]
    return sorted(jobs, key=lambda job: -weight(job))


def weight(job: Job) -> float:
    """Length of a job, in simulated seconds of the analytic plant."""
    slow = 3.0 if job.plant == "rollers" else 1.0
    return slow * sum(motion.seconds for motion in job.motions)


def default_blocks(
    controllers: tuple[str, ...], references: tuple[str, ...], plants: tuple[str, ...]
) -> list[Block]:
    """The comparison that is made when nothing is asked for; under five minutes on two cores."""
    main = tuple(name for name in controllers if name in MAIN)
    others = tuple(name for name in controllers if name not in MAIN)
    blocks = []
    for plant in plants:
        rollers = plant == "rollers"
        frequencies = ROLLER_FREQUENCIES if rollers else FREQUENCIES
        followed = tuple(r for r in references if r in ROLLER_REFERENCES or not rollers)
        blocks.append(Block(plant, main, MODELS, followed, frequencies))
        blocks.append(Block(plant, others, MODELS, followed[:1], OTHER_FREQUENCIES))
    return blocks
