"""Which wrong parameter or missing effect costs the most tracking error, one at a time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from controllers import make
from controllers.evaluation.motions import Motion
from controllers.evaluation.run import drive, make_env, measure
from controllers.evaluation.statistics import Figure, mean
from controllers.evaluation.subjects import ORACLE, Subject
from youbot_env.model import ActiveEffect, Model
from youbot_env.simulation import Sensors

CONTROLLER = "computed_torque"
MOTIONS = (Motion("eight", 1.0), Motion("circle", 2.0))
# The observer of disturbances would make up for a part of every error, for slow ones most; here
# the model alone is to answer.
SETTINGS = {"disturbance_time": math.inf}
BASE, LEFT_OUT, PERCENT, INTERVAL = "true model", "left out", "20 %", "95 % half width"
SHARE = 0.2


class Change(NamedTuple):
    """One way to be wrong: a parameter off by something, or an effect that is not there."""

    name: str
    kind: str
    sign: int = 0


@dataclass(frozen=True)
class Cost:
    """What one way to be wrong costs.

    Attributes:
        name: parameter (``m0``, ``wheel_coulomb_friction.fc``) or effect.
        kind: ``20 %``, ``95 % half width`` or ``left out``.
        error: rms distance of the wheels from where they should be, m, from position and heading
            error; of the worse of both signs.
        added: what it adds to the true model's, m.
    """

    name: str
    kind: str
    error: Figure
    added: Figure

    def as_dict(self) -> dict:
        """Return what JSON shows."""
        figures = {"error": self.error.as_dict(), "added": self.added.as_dict()}
        return {"name": self.name, "kind": self.kind} | figures


def changes(model: Model) -> list[Change]:
    """All ways to be wrong about a robot, the true model first."""
    effects = [f"{a.identifier}.{name}" for a in model.effects for name in a.values]
    off = [
        Change(name, kind, sign)
        for name in (*model.parameters.as_dict(), *effects)
        for kind in (PERCENT, INTERVAL)
        for sign in (-1, 1)
    ]
    missing = [Change(active.identifier, LEFT_OUT) for active in model.effects]
    return [Change("", BASE), *off, *missing]


def believed(subject: Subject, change: Change) -> Model:
    """The true model with one thing wrong.

    Raises:
        KeyError: the identification gave the parameter no interval.
    """
    model = subject.model(ORACLE)
    if change.kind == BASE:
        return model
    if change.kind == LEFT_OUT:
        kept = tuple(a for a in model.effects if a.identifier != change.name)
        return replace(model, effects=kept)
    identifier, _, flat = change.name.rpartition(".")
    values = _values(model, identifier)
    size = SHARE * abs(values[flat]) if change.kind == PERCENT else subject.half_widths[change.name]
    values[flat] += change.sign * size
    if not identifier:
        return replace(model, parameters=replace(model.parameters, **values))
    effects = [ActiveEffect(a.effect, values if a.identifier == identifier else a.values)
               for a in model.effects]  # fmt: skip
    return replace(model, effects=tuple(effects))


def _values(model: Model, identifier: str) -> dict[str, float]:
    if not identifier:
        return model.parameters.as_dict()
    return next(dict(a.values) for a in model.effects if a.identifier == identifier)


def errors(subject: Subject, sensors: Sensors | None = None) -> dict[Change, float]:
    """Rms error of the wheels, m, mean over ``MOTIONS``, for every way to be wrong about a robot.

    Parameters without an interval are left out of ``95 % half width``.
    """
    wheels = subject.truth.platform.wheels
    lever, found = float(np.mean([math.hypot(w.x, w.y) for w in wheels])), {}
    for change in changes(subject.truth):
        if change.kind == INTERVAL and change.name not in subject.half_widths:
            continue
        controller = make(CONTROLLER, believed(subject, change), **SETTINGS)
        env = make_env(subject, controller, sensors)
        rms = []
        for motion in MOTIONS:
            trace = drive(controller, env, motion, subject.seed)
            limit, dt = controller.settings.torque_limit, controller.settings.dt
            figures = measure(trace, dt, limit, motion.speed)
            rms.append(math.hypot(figures["position"], lever * figures["heading"]))
        env.close()
        found[change] = float(np.mean(rms))
    return found


def costs(by_robot: Iterable[dict[Change, float]]) -> list[Cost]:
    """Costs over robots, the dearest first."""
    by_robot = list(by_robot)
    base = np.array([errors[Change("", BASE)] for errors in by_robot])
    found = []
    for name, kind in dict.fromkeys((c.name, c.kind) for c in by_robot[0] if c.kind != BASE):
        signs = [c for c in by_robot[0] if (c.name, c.kind) == (name, kind)]
        rows = [max(e[c] for c in signs) for e in by_robot if all(c in e for c in signs)]
        kept = np.array([all(c in e for c in signs) for e in by_robot])
        error = np.array(rows)
        found.append(Cost(name, kind, mean(error), mean(error - base[kept])))
    return sorted(found, key=lambda cost: -cost.added.value)
