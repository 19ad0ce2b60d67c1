"""What diagnosis tries on top of a model: every effect of the library in every form it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import null_space

from ident.dead_reckoning import dead_reckoning, wheel_angles
from ident.diagnosis.settings import SETTINGS
from ident.identifiability_words import NEGLIGIBLE
from ident.kinematics.ripple import roller_phases
from ident.log import Log
from ident.regression import build_regression
from ident.restored import unknown_pose, unknown_wheel_angle
from youbot_env.backend import NUMPY
from youbot_env.dynamics import Theta
from youbot_env.effects import Effect, Parameter, Signals, effect_names, get_effect
from youbot_env.model import ActiveEffect, Model
from youbot_env.parameters import ImpossibleParameters


@dataclass(frozen=True)
class Trial:
    """One effect in one form, and the pairs of models whose difference is its trace.

    Attributes:
        identifier: the effect.
        per_wheel: whether its parameters differ between wheels.
        names: flat names of the parameters that are estimated.
        units: sizes of which the columns are the trace.
        pairs: (without, with) models of each column.
        mix: (columns, k) combinations that are estimated: contrasts keep their mean.
        linear: whether the trace is proportional to the size.
    """

    identifier: str
    per_wheel: bool
    names: tuple[str, ...]
    units: np.ndarray
    pairs: tuple[tuple[Model, Model], ...]
    mix: np.ndarray
    linear: bool

    @property
    def effect(self) -> Effect:
        """The law."""
        return get_effect(self.identifier)

    def on(self, model: Model) -> tuple[tuple[Model, Model], ...]:
        """The pairs on top of another log's model, whose own values may differ."""

        def moved(one: Model) -> Model:
            extra = tuple(a for a in one.effects if a.identifier == self.identifier)
            return replace(model, effects=(*model.effects, *extra)) if extra else model

        return tuple((moved(without), moved(other)) for without, other in self.pairs)

    def values(self, coefficients: np.ndarray) -> dict[str, float]:
        """Sizes (by flat name) that coefficients (k,) of the mixed columns stand for."""
        sizes = (self.mix @ coefficients) * self.units
        if self.effect.parameter_of(self.names[0]).profile_unit == "peak":
            sizes = self.units  # a limit is no size: its trace grows as it falls
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def start(self, coefficients: np.ndarray, base_values: np.ndarray) -> Model:
        """The model with the effect at the sizes found, moved into their bounds.

        Args:
            coefficients: (k,) of the mixed columns.
            base_values: (P,) of the model without the effect.
        """
        found = self.pairs[0][1].effects[-1].values | self.values(coefficients)
        for name, value in found.items():
            low, high = self.effect.parameter_of(name).bounds
            found[name] = float(np.clip(value, low, high))
        base = self.pairs[0][0]
        rest = tuple(a for a in base.effects if a.identifier != self.identifier)
        base = _if_possible(replace(base, effects=rest), base_values)
        kept = {a.identifier: a.values for a in base.effects}
        return base.with_effects({**kept, self.identifier: found})

    def possible(self, coefficients: np.ndarray, slack: float) -> bool:
        """Tell whether sizes lie within their bounds, give or take a share of their unit."""
        for name, value, unit in zip(
            self.names, self.values(coefficients).values(), self.units, strict=True
        ):
            low, high = self.effect.parameter_of(name).bounds
            if not low - slack * abs(unit) <= value <= high + slack * abs(unit):
                return False
        return True


def _if_possible(model: Model, values: np.ndarray) -> Model:
    """The model with other values, or as it is where they describe no possible robot."""
    try:
        return model.with_values(values).check()
    except ImpossibleParameters:
        return model


def trials(model: Model, logs: list[Log]) -> list[Trial]:
    """Everything worth trying on top of a model with logs like these; profiles suit the first."""
    orders = strongest_orders(logs[0], model)
    present = {active.identifier for active in model.effects}
    found = []
    for identifier in effect_names():
        effect = get_effect(identifier)
        known = identifier in present or any(identifier in log.recording for log in logs)
        if effect.only_beside and not present.intersection(effect.only_beside):
            continue
        if not known and effect.candidate and not any(map(effect_unreadable(effect), logs)):
            found += _forms(effect, model, logs[0], orders)
    return found


def untried(model: Model, logs: list[Log]) -> dict[str, str]:
    """Effects that logs like these cannot show, by name, with the reason and what to record."""
    present, found = {active.identifier for active in model.effects}, {}
    for identifier in effect_names():
        effect = get_effect(identifier)
        known = identifier in present or any(identifier in log.recording for log in logs)
        if known or not effect.candidate:
            continue
        for log in logs:
            why = effect_unreadable(effect)(log)
            if why:
                found[identifier] = why if len(logs) == 1 else f"{log.name}: {why}"
                break
    return found


def effect_unreadable(effect: Effect) -> Callable[[Log], str]:
    """Tell why a log holds nothing that an effect could be judged by; empty where it does."""

    def reason(log: Log) -> str:
        if not effect.seen_by_wheels:
            return "only a pose beside the wheels shows it; use calibrate_kinematics.py"
        if effect.channel and getattr(log, effect.channel) is None:
            return f"the log has no {effect.channel.replace('_', ' ')}; record one"
        if log.window is not None and effect.lessens_drive():
            return (
                "without acceleration a weaker drive explains any friction away; record starts and "
                "stops"
            )
        if effect.needs_time and log.runs:
            return "what came between the runs is not known; record one run of 60 s or more"
        return not_moved(effect, log) or behind_gap(effect, log)

    return reason


def not_moved(effect: Effect, log: Log) -> str:
    """Tell which motion, that a force on the body answers to, a log hardly holds; empty if none.

    A robot that drives straight turns by its noise only, of which a law makes anything.
    """
    if effect.link != "body" or not effect.acts("body") or effect.needs_pose or effect.needs_time:
        return ""
    platform = log.platform
    level = np.mean((log.velocity() * (1.0, 1.0, platform.lever)) ** 2, axis=0)
    p = effect.arrange(effect.complete(None, platform), platform)
    theta = Theta(*(1.0,) * len(Theta._fields))
    still = (0.0,) * len(platform.wheels)

    def answers(v: tuple) -> bool:
        s = Signals(platform, platform.geometry, theta, 0.0, v, (0.0,) * 3, still, still)
        return bool(np.any(np.abs(effect.body(p, s, NUMPY)) > 0))

    if level[2] < NEGLIGIBLE * level.sum() and not answers((0.3, 0.2, 0.0)):
        return "the robot hardly turns; record a spin on the spot"
    if level[:2].sum() < NEGLIGIBLE * level.sum() and not answers((0.0, 0.0, 0.5)):
        return "the robot only turns; record straight runs"
    return ""


def behind_gap(effect: Effect, log: Log) -> str:
    """Tell what a gap in a log keeps an effect from being judged by; empty where none does."""
    if effect.needs_pose and unknown_pose(log):
        return "the heading is unknown behind a gap; log a pose"
    if effect.needs_wheel_angle and unknown_wheel_angle(log):
        return "the wheels' angles are unknown behind a gap; record without gaps"
    return ""


def _forms(effect: Effect, model: Model, log: Log, orders: tuple) -> Iterator[Trial]:
    linear = [p for p in effect.parameters if p.linear]
    curved = [p for p in effect.parameters if not p.linear]
    if linear:
        for fixed in _profiles(curved, log, orders):
            zero = dict.fromkeys((p.name for p in linear), 0.0) | fixed
            if not any(p.contrast for p in linear):
                yield _linear_form(effect, model, zero, linear, False)
            if any(p.per_wheel for p in linear):
                yield _linear_form(effect, model, zero, linear, True)
        return
    if curved[0].per_wheel:
        yield _wheel_form(effect, model, curved[0])
        return
    for values in _profiles(curved, log, orders):
        size = values[curved[0].name]
        other = model.with_effects({effect.identifier: values})
        yield Trial(
            effect.identifier, False, (curved[0].name,), np.array([size]), ((model, other),),
            np.eye(1), False,
        )  # fmt: skip


def _linear_form(
    effect: Effect, model: Model, zero: dict, linear: list[Parameter], per_wheel: bool
) -> Trial:
    """Columns of the law at one unit of each parameter, the others at zero."""
    without = model.with_effects({effect.identifier: zero})
    names, units, pairs, fixed = [], [], [], []
    wheels = model.platform.wheel_names
    for parameter in linear:
        split = per_wheel and parameter.per_wheel
        mine = [f"{parameter.name}_{w}" for w in wheels] if split else [parameter.name]
        if parameter.contrast:
            fixed.append((len(names), len(mine)))
        for name in mine:
            unit = parameter.default or 1.0
            values = {**zero, name: unit}
            if split:
                values |= {other: 0.0 for other in mine if other != name}
            names.append(name)
            units.append(unit)
            pairs.append((without, model.with_effects({effect.identifier: values})))
    mix = np.eye(len(names))
    if fixed:
        rows = np.zeros((len(fixed), len(names)))
        for row, (begin, count) in zip(rows, fixed, strict=True):
            row[begin : begin + count] = 1.0
        mix = null_space(rows)
    return Trial(effect.identifier, per_wheel, tuple(names), np.array(units), tuple(pairs), mix,
                 True)  # fmt: skip


def _wheel_form(effect: Effect, model: Model, parameter: Parameter) -> Trial:
    """A law that is nearly linear in an error of each wheel."""
    names = tuple(f"{parameter.name}_{wheel}" for wheel in model.platform.wheel_names)
    pairs = tuple(
        (model, model.with_effects({effect.identifier: {name: parameter.default}}))
        for name in names
    )
    return Trial(effect.identifier, True, names, np.full(len(names), parameter.default), pairs,
                 np.eye(len(names)), True)  # fmt: skip


def _profiles(curved: list[Parameter], log: Log, orders: tuple) -> Iterator[dict[str, float]]:
    """Values of the nonlinear parameters: each over its profile, the others at their first.

    Those that are crossed take all values with all.
    """
    if not curved:
        yield {}
        return
    for parameter in curved:
        if parameter.profile_unit == "roller_phase":
            phases = roller_phases(log)
            if phases is not None:  # the wheels themselves tell where their rollers are
                names = (f"{parameter.name}_{wheel}" for wheel in log.platform.wheel_names)
                others = {p.name: p.profile[0] for p in curved if p is not parameter}
                yield others | dict(zip(names, phases.tolist(), strict=True))
                return
    grids = {p.name: profile(p, log, orders) for p in curved}
    if any(p.crossed for p in curved):
        yield from (dict(zip(grids, sizes, strict=True)) for sizes in product(*grids.values()))
        return
    first = {name: sizes[0] for name, sizes in grids.items()}
    tried = set()
    for name, sizes in grids.items():
        for size in sizes:
            values = first | {name: size}
            if tuple(values.values()) not in tried:
                tried.add(tuple(values.values()))
                yield values


def profile(parameter: Parameter, log: Log, orders: tuple = ()) -> list[float]:
    """Sizes of one nonlinear parameter that are tried."""
    unit = {
        "default": parameter.default,
        "command": float(np.sqrt(np.mean(log.command**2))),
        "peak": float(np.abs(log.command).max()),
        "duration": log.duration,
        "order": 1.0,
        "roller_phase": 1.0,
    }
    if parameter.profile_unit == "reach":
        place = dead_reckoning(log) if log.pose is None else log.pose
        unit["reach"] = float(np.abs(place[:, :2]).max())
    low, high = parameter.bounds
    # A typical size of zero has no multiples; its profile is in the parameter's own unit.
    sizes = [share * (unit[parameter.profile_unit] or 1.0) for share in parameter.profile]
    if parameter.profile_unit == "order":
        sizes = [parameter.default, *orders]
    return [size for size in sizes if low <= size <= high] or [parameter.default]


def brackets(active: ActiveEffect, log: Log) -> dict[str, tuple[float, float]]:
    """Between which sizes that were tried the best lies, where a law has no derivative."""
    found = {}
    for parameter in active.effect.parameters:
        if parameter.smooth or parameter.linear:
            continue
        if parameter.name not in active.values:  # one for each wheel, as the wheels told
            continue
        value, sizes = active.values[parameter.name], np.array(profile(parameter, log))
        below, above = sizes[sizes < value - 1e-9], sizes[sizes > value + 1e-9]
        low = below.max() if len(below) else value
        high = above.min() if len(above) else value
        if low < high:
            found[parameter.name] = (float(low), float(high))
    return found


def strongest_orders(log: Log, model: Model, count: int = 3) -> tuple[float, ...]:
    """Orders of the largest peaks in the spectrum over wheel angles of the residual torques.

    The residual is that of the filtered equations; the sum of its values over each small range of
    an angle is transformed once, whatever the order.
    """
    if log.wheel_velocity is None or len(log.pieces()) > 1:
        return ()
    regression = build_regression(log, model)
    known = dict(zip(model.names(), model.values(), strict=True))
    residual = regression.residual(np.array([known[name] for name in regression.names]))
    residual = residual / (regression.lever, regression.lever, 1.0)
    torque = residual @ np.linalg.pinv(log.platform.jacobian_array)
    angle = wheel_angles(log)[np.searchsorted(log.time, regression.time)]
    power = np.zeros(SETTINGS.transform_length // 2 + 1)
    for wheel in range(angle.shape[1]):
        bins = ((angle[:, wheel] - angle[:, wheel].min()) / SETTINGS.angle_bin).astype(int)
        if bins.max() >= SETTINGS.transform_length:
            bins %= SETTINGS.transform_length
        held = np.bincount(
            bins, torque[:, wheel] - torque[:, wheel].mean(), SETTINGS.transform_length
        )
        power += np.abs(np.fft.rfft(held)) ** 2
    order = 2 * np.pi * np.fft.rfftfreq(SETTINGS.transform_length, SETTINGS.angle_bin)
    inside = (order > SETTINGS.lowest_order) & (order < SETTINGS.highest_order)
    order, power = order[inside], power[inside]
    peaks = 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] > power[2:]))
    best = peaks[np.argsort(-power[peaks])[:count]]
    return tuple(order[best].tolist())
