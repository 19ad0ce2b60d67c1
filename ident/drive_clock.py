"""The clock of the drive: by how much its rows act ahead of being held from their own time on.

It is fitted by output error with the robot, and with what else turns phases beside it.
"""

from __future__ import annotations

import numpy as np

from ident.contradiction import wheels_agree
from ident.decimate import SEARCHED, decimated
from ident.instruments import (
    HOLD,
    OFFSET,
    SHIFT,
    hold_of,
    lead_of,
    stated,
    stating,
    with_instruments,
    without_instruments,
)
from ident.kept import kept
from ident.log import Log
from ident.noise import noisier_speeds
from ident.noise_floor import noise_floor
from ident.output_error import OutputError, refine
from ident.parameter_space import FreeValues
from ident.residuals import ScaledFit
from youbot_env import dynamics
from youbot_env.effects import get_effect
from youbot_env.measurement import HELD, HOLDS, SAMPLED
from youbot_env.model import Model

# A fit of the lead looks at this much of a log, s; its precision is far below CLOSE by then.
ENOUGH = 120.0
# Of what a model leaves unexplained this share may lie along the trace of a lead, where the wheels
# agree with each other and where they do not: leads of simulated robots with effects that no
# nuisance stands for (payload, sag, a patch of floor; slip, real rollers) were wrong by as much.
ALIGNED = (0.1, 0.3)
# Free-run errors remember each other for about this time, s.
MEMORY = 0.3
# A step of a robot that lowers the squares by less than this share leaves it where it is, before
# its clock is looked for.
ROUGHLY = 1e-3
# Effects that are fitted beside a lead so that it need not stand for them; those with a value for
# each wheel even where one would do.
NUISANCES = (
    "wheel_coulomb_friction",
    "roller_coulomb_friction",
    "floor_slope",
    "torque_gain",
    "torque_offset",
    "wheel_radius_error",
)
EACH_WHEEL = ("torque_offset",)
WEAK = 1e-6
# Least standard error of a lead, s: what rows stand for is known no better.  Leads of 13 ideal
# robots recorded in other ways were off by 0.8 ms rms where fits said 0.5 ms.
LEAST_ERROR = 6e-4


def leads(logs: list[Log], model: Model) -> list[tuple[float, float]]:
    """Time by which every log's rows act ahead of held ones, and its standard error, s."""
    return kept(
        "clocks",
        (logs, model),
        lambda: _leads(logs, model),
        pack=lambda found: found,
        unpack=lambda known: [tuple(one) for one in known],
    )


def _leads(logs: list[Log], model: Model) -> list[tuple[float, float]]:
    sparse = [sparsely(exciting(log)) for log in logs]
    plain = with_instruments(without_instruments(model), sparse)
    try:
        # First the robot with the clocks that rows usually have: from a robot that is far from true
        # a slow motion leads to clocks of 50 ms, where it is as well explained and wrong.  Most of
        # the way is that of its seven parameters, which cost a third of what all together do.
        usual = [_usual_clock(log, plain, raw) for log, raw in zip(sparse, logs, strict=True)]
        roughly = {"tolerance": ROUGHLY, "smooth": True, "intervals": False}
        robot = refine(usual, plain, **roughly).model
        first = refine(usual, _with_nuisances(robot), **roughly)
        fit = refine(sparse, first.model, smooth=True, draws=1)
    except ValueError:  # no window is contiguous: the recording stays what it usually is
        return [(lead_of(SAMPLED, log.dt), 0.0) for log in logs]
    found = []
    for number, log in enumerate(logs):
        ahead, error = lead(fit, number)
        pull = _pull_of_loops(fit, number, log)
        if error > 0:  # else it is stated
            error = float(np.sqrt(error**2 + pull**2 + LEAST_ERROR**2))
        found.append((ahead - pull, error))
    return found


def lead(fit: OutputError, number: int) -> tuple[float, float]:
    """Time by which a log's rows act ahead of held ones, and its standard error, s.

    Besides the scatter between windows the error holds what the model leaves unexplained, a share
    of which may lie along the trace of the lead.
    """
    model, at = fit.models[number], fit.scopes.names.index(SHIFT)
    sim = fit.simulations[number]
    ahead = model.values()[at] + lead_of(hold_of(sim.raw, model), sim.raw.dt)
    if SHIFT in stated(model, sim.raw):
        return ahead, 0.0
    ahead -= _flattened(model, sim.raw.dt)
    scaled = ScaledFit.at([sim.raw], [model], None)
    free = FreeValues.of(model, None, None, [set(stated(model, sim.raw))])
    columns = scaled.columns(free) @ free.directions[free.moving]
    place = fit.scopes.index[number, at]
    trace = scaled.columns(free)[:, np.flatnonzero(free.moving).searchsorted(at)]
    others = columns[:, free.directions[at] == 0]
    scale = np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    alone = trace - others @ (np.linalg.lstsq(others / scale, trace, rcond=WEAK)[0] / scale)
    floor = noise_floor(sim).of(scaled.weights[0])
    left = max(2 * scaled.cost - len(scaled.error) * floor, 0.0)
    share = ALIGNED[0 if wheels_agree(sim.log) else 1]
    size = max(float(np.linalg.norm(alone)), 1e-300)
    # Few windows may agree by chance; errors that remember each other for a while set a limit.
    memory = np.sqrt(max(MEMORY / sim.log.dt, 1.0)) * np.sqrt(2 * scaled.cost / len(scaled.error))
    scatter = max(float(np.sqrt(fit.covariance[place, place])), memory / size)
    return ahead, float(np.hypot(scatter, share * np.sqrt(left) / size))


def sparsely(log: Log) -> Log:
    """The log, or means over 20 ms where it is denser; these act as held torques do."""
    thin = decimated(log, SEARCHED)
    return log if thin is log else stating(thin, HOLD, kind=float(HOLDS.index(HELD)))


def exciting(log: Log) -> Log:
    """The log, or where it is long the stretch of ``ENOUGH`` seconds in which it moves most."""
    if log.duration <= ENOUGH:
        return log
    speed = np.abs(np.gradient(log.velocity(), log.time, axis=0)) / log.velocity().std(axis=0)
    total = np.concatenate([[0.0], np.cumsum(speed.sum(axis=1) * np.gradient(log.time))])
    ends = np.searchsorted(log.time, log.time + ENOUGH)
    inside = log.time + ENOUGH <= log.time[-1]
    start = int(np.argmax(np.where(inside, total[np.minimum(ends, len(log.time))] - total[:-1], 0)))
    return log.part(log.time[start], log.time[start] + ENOUGH)


def _usual_clock(sparse: Log, model: Model, raw: Log) -> Log:
    """A log that states the clock of sampled rows, if it states none."""
    if OFFSET in sparse.recording:
        return sparse
    return stating(
        sparse, OFFSET, d=lead_of(SAMPLED, raw.dt) - lead_of(hold_of(sparse, model), raw.dt)
    )


def _pull_of_loops(fit: OutputError, number: int, log: Log) -> float:
    """How far the noise that wheel loops answer to may pull a lead, s.

    As much noise once more, in speeds and in torques as the loops answer to it, pulls as far again:
    back where rows show instants, hardly where they are held and the robot felt it.  Which they do
    is not known by then, so all of what is taken back stays in the error.
    """
    model = fit.models[number]
    if SHIFT in stated(model, log):
        return 0.0
    at = model.names().index(SHIFT)
    free = FreeValues.of(model, None, None, [set(stated(model, log))])
    steps = [
        ScaledFit.at([sparsely(one)], [model], None, smooth=True).step(free, 0.0)[0][at]
        for one in (exciting(log), *noisier_speeds(exciting(log)))
    ]
    return float(np.mean(steps[1:]) - steps[0])


def _with_nuisances(model: Model) -> Model:
    """The model with common effects that it does not have, at nothing, to be fitted beside it.

    A lead is the slope of a phase, and any friction or force that is missing turns phases: on its
    own the robot's seven parameters make up for that by leads of up to 60 ms.
    """
    present = {active.identifier for active in model.effects}
    added = {}
    for name in NUISANCES:
        if name not in present:
            effect = get_effect(name)
            split = any(p.per_wheel and p.contrast for p in effect.parameters) or name in EACH_WHEEL
            added[name] = dict.fromkeys(effect.parameter_names(model.platform, split), 0.0)
    return model.with_effects(added)


def _flattened(model: Model, dt: float) -> float:
    """Lead that a fit makes up because torques are held through a row, s.

    Of a torque that rises within a row more comes late, when less of it has faded by the row's end,
    than of its mean: to first order as if it came earlier by dt^2 / 12 times the rate of fading.
    """
    inertia = dynamics.prepare(model.platform.geometry, model.parameters.theta(model.platform))
    units = np.eye(3).tolist()
    rates = [-dynamics.acceleration(inertia, tuple(e), (0.0,) * 3)[k] for k, e in enumerate(units)]
    return float(np.mean(rates)) * dt**2 / 12
