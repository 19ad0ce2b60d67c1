"""Kinematic calibration of a platform from wheel speeds and an independently measured pose."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.kinematics.drift import Drift, measure_drift
from ident.kinematics.fit import Fit, fit
from ident.kinematics.records import contradicting, one_record
from ident.kinematics.ripple import Ripple, without_ripple
from ident.kinematics.wheels import (
    BASE,
    RADIUS,
    RIPPLE,
    ROLLER,
    effect_values,
    mean_odometry,
    steeper,
)
from ident.kinematics.windows import Windows, cut_windows
from ident.kinematics.words import (
    GAINS,
    gain_table,
    mount_table,
    parameter_table,
    remarks,
    undetermined_words,
)
from ident.log import Log
from ident.pooling import as_list
from ident.results import Quantity, Shown, quantity_columns
from ident.threads import one_thread
from youbot_env.model import Model
from youbot_env.platform import Platform

# Long enough for the motion to stand out of the noise of the pose, short enough that neither noise
# of the wheels nor slip adds up.
WINDOW = 2.0
DRIFTS = ("before", "after", "followed", "test_before", "test_after", "test_followed")


@dataclass(frozen=True, repr=False)
class KinematicCalibration(Shown):
    """What wheels and pose say about the kinematics of a platform.

    Attributes:
        log: name of the log; test: of the held-out log, or None.
        nominal: the platform it started from.
        finite_rollers: whether the ripple of finite rollers was taken out of the wheel speeds, so
            that parameters mean what is wrong beyond it.
        parameters: wheel_radius (common) and wheel_radius_<wheel> m, base_error (relative error of
            L and of the wheels' places), lever (L) m, roller_angle_error rad (positive: steeper).
        gains: forward, sideways and yaw: motion over what nominal odometry says, on average over
            the roller phases.
        mount: offset_x, offset_y m of the tracked point in the body frame, offset_yaw rad of its
            heading, delay s of the pose after the wheels.
        undetermined: what this motion cannot tell, in words; empty when it tells everything.
        remarks: what a reader of the numbers must know.
        ripple: what the wheels say about finite rollers; None where they cannot say.
        odometry: (3, n) W of calibrated odometry ``v = W phi'``, averaged over the roller phases.
        drifts: of nominal odometry (``before``), of W (``after``), and of odometry that follows the
            phase of every roller (``followed``), on the log and on the held-out log (``test_``);
            all with the same mount.  None where there is no such odometry or log.
        fit: the estimate behind the numbers.
        left_out: logs that were not used, by name, with the reason.
    """

    log: str
    test: str | None
    nominal: Platform
    finite_rollers: bool
    parameters: dict[str, Quantity]
    gains: dict[str, Quantity]
    mount: dict[str, Quantity]
    undetermined: tuple[str, ...]
    remarks: tuple[str, ...]
    ripple: Ripple | None
    odometry: np.ndarray
    drifts: dict[str, Drift | None]
    fit: Fit
    left_out: dict[str, str] = field(default_factory=dict)

    def headline(self) -> str:
        """See the base class."""
        left = f"; not told by this motion: {'; '.join(self.undetermined)}" * bool(
            self.undetermined
        )
        before, after = (self.drifts.get(name) for name in ("before", "after"))
        way = (
            f": odometry off by {1e3 * before.position_per_metre:.3g} mm/m before, "
            f"{1e3 * after.position_per_metre:.3g} mm/m after"
            if before and after
            else ""
        )
        return f"{self.log} on {self.nominal.name}{way}{left}"

    def table(self) -> dict[str, list[Any]]:
        """See the base class."""
        return quantity_columns(self.parameters | self.gains | self.mount)

    def plot(self):
        """Motion over what nominal odometry says, by axis, with 95 % intervals."""
        from ident.report.gains import gains_figure

        return gains_figure.on_canvas(self.gains)

    def effects(self) -> dict[str, dict[str, float]]:
        """The result as effects on the nominal platform, by identifier and flat name."""
        return effect_values(self.nominal, self.fit.values.tolist()) | self._ripple()

    def platform(self) -> Platform:
        """The platform with calibrated common radius, places and roller angles.

        Differences between radii are left to the effect ``wheel_radius_error``, and finite rollers,
        where they were taken out, to ``roller_ripple``; see ``model``.
        """
        base, steep = self.fit.values[len(self.nominal.wheels) :][:2].tolist()
        wheels = tuple(
            replace(
                wheel,
                x=wheel.x * (1.0 + base),
                y=wheel.y * (1.0 + base),
                roller_angle=wheel.roller_angle + sign * steep,
            )
            for wheel, sign in zip(self.nominal.wheels, steeper(self.nominal).tolist(), strict=True)
        )
        radius = self.parameters["wheel_radius"].value
        return replace(self.nominal, wheels=wheels, wheel_radius=radius)

    def model(self, model: Model) -> Model:
        """A model with the calibrated platform and effects for what a platform cannot hold.

        The parameters stay as they are: identify them again with this platform, since masses and
        frictions scale with the radius.
        """
        radii = 1.0 + self.fit.values[: len(self.nominal.wheels)]
        unequal = (radii / radii.mean() - 1.0).tolist()
        pairs = zip(self.nominal.wheel_names, unequal, strict=True)
        kept = tuple(a for a in model.effects if a.identifier not in (BASE, ROLLER, RIPPLE))
        added: dict[str, Any] = {RADIUS: {f"e_{wheel}": e for wheel, e in pairs}, **self._ripple()}
        return replace(model, platform=self.platform(), effects=kept).with_effects(added)

    def _ripple(self) -> dict[str, dict[str, float]]:
        return {RIPPLE: {"size": self.ripple.size}} if self.finite_rollers and self.ripple else {}

    def as_dict(self) -> dict[str, Any]:
        """Return what ``calibrate_kinematics.py --json`` writes."""
        tables = {"parameters": self.parameters, "gains": self.gains, "mount": self.mount}
        surplus, ripple = self.fit.surplus, None
        if self.ripple is not None:
            ripple = {
                name: getattr(self.ripple, name) for name in ("size", "ci95", "p_value", "seen")
            }
            ripple["phases"] = self.ripple.phases.tolist()
        return {
            "log": self.log,
            "test": self.test,
            "finite_rollers": self.finite_rollers,
            **{k: {n: q.as_dict() for n, q in v.items()} for k, v in tables.items()},
            "undetermined": list(self.undetermined),
            "remarks": list(self.remarks),
            "left_out": self.left_out,
            "sufficient": {
                "p_value": surplus.p_value,
                "largest_missing": surplus.size,
                "rank": surplus.rank,
                "widening": surplus.widening,
            },
            "roller_ripple": ripple,
            "noise": dict(zip(("position", "yaw", "contradiction"), self.fit.noise, strict=True)),
            "odometry_matrix": self.odometry.tolist(),
            "odometry": {k: None if d is None else d.as_dict() for k, d in self.drifts.items()},
            "effects": self.effects(),
        }


@one_thread
def calibrate_kinematics(
    log: Log | Sequence[Log],
    platform: Platform | None = None,
    test: Log | Sequence[Log] | None = None,
    finite_rollers: bool | None = None,
    window: float = WINDOW,
) -> KinematicCalibration:
    """Estimate radii, base, roller angle, mount and delay of the pose sensor from logs.

    Odometry over short windows is fitted to the measured pose, each window with a start of its own;
    where there are more than three wheels, what they say against each other counts as well.

    Args:
        log: with wheel speeds and a pose that was not computed from them; of several, each may
            have a pose frame of its own, and one that is of no use is left out.
        platform: nominal wheel table; the log's if left.
        test: logs that are only used to measure the drift.
        finite_rollers: take the ripple of finite rollers out of the wheel speeds first; where it is
            seen, if left.  Without, values are those of the ideal rollers that come nearest.
        window: length of a window, s.

    Raises:
        ValueError: channels are missing, the log is too short, pose and wheels do not belong
            together, or finite rollers are asked for and not seen.

    Warns:
        UserWarning: this motion leaves values undetermined.
    """
    given, tests = as_list(log), as_list(test)
    platform = platform or given[0].platform
    log, left = one_record(given, platform, window)
    estimate, log, ripple, finite, contrary = _agreeing(log, platform, finite_rollers, window)
    left |= contrary
    undetermined = undetermined_words(estimate, log, platform)
    if undetermined:
        warnings.warn(f"log {log.name!r}: " + "; ".join(undetermined), stacklevel=2)
    values = estimate.values[: len(platform.wheels) + 2]
    # Without ripple nothing is asked of the rollers, which may be too thin for six.
    odometry, slope = estimate.rolling.odometry, estimate.rolling.odometry_slope
    if finite and ripple:
        odometry, slope = mean_odometry(platform, values, ripple.size)
    gains = gain_table(estimate, platform, odometry, slope)
    measured = np.array([gains[axis].value for axis in GAINS])
    matrices = (odometry, estimate.rolling.odometry if finite else None)
    drifts = _drifts(log, platform, matrices, estimate.mount)
    test = None
    if tests:
        test, unused = one_record(tests, platform, window)
        left |= unused
        judged = _drifts(test, platform, matrices, estimate.mount)
        drifts |= {f"test_{name}": drift for name, drift in judged.items()}
    return KinematicCalibration(
        log.name,
        test.name if test else None,
        platform,
        finite,
        parameter_table(estimate, platform),
        gains,
        mount_table(estimate),
        undetermined,
        remarks(estimate, platform, ripple, measured, finite),
        ripple,
        odometry,
        dict.fromkeys(DRIFTS) | drifts,
        estimate,
        left,
    )


def _agreeing(
    log: Log, platform: Platform, finite_rollers: bool | None, window: float
) -> tuple[Fit, Log, Ripple | None, bool, dict[str, str]]:
    """The fit to those runs of a record that belong together, and why the others do not.

    One whose pose is wrong bends the fit to all, so that each is tried by itself where that fails.
    """
    left: dict[str, str] = {}
    while True:
        ideal, ripple = without_ripple(log, platform)
        seen = ripple is not None and ripple.seen
        if finite_rollers and not seen:
            raise ValueError(f"log {log.name!r} shows no ripple of finite rollers to take out")
        finite = seen and finite_rollers is not False
        windows = cut_windows(ideal if finite else log, window)
        try:
            estimate = fit(windows, platform)
            found = contradicting(windows, estimate, log) if len(log.runs) > 1 else {}
        except ValueError:
            found = _failing(windows, platform, log) if len(log.runs) > 1 else {}
            if not found or len(found) == len(log.runs):
                raise
        if not found or len(found) == len(log.runs):
            return estimate, log, ripple, finite, left
        left |= found
        log = log.without_runs(set(found))


def _failing(windows: Windows, platform: Platform, log: Log) -> dict[str, str]:
    """Runs that cannot be calibrated by themselves, by name, with the reason."""
    found = {}
    for number in np.unique(windows.run):
        try:
            fit(windows.of_run(number), platform)
        except ValueError as error:
            found[log.run_name(number)] = str(error)
    return found


def _drifts(
    log: Log, platform: Platform, matrices: tuple, mount: np.ndarray
) -> dict[str, Drift | None]:
    """Drift of nominal odometry, of a W for all phases, and of one for ideal rollers."""
    average, exact = matrices
    nominal, followed = np.linalg.pinv(platform.jacobian_array), None
    if exact is not None:
        ideal, ripple = without_ripple(log, platform)
        if ripple is not None and ripple.seen:
            followed = measure_drift(ideal, exact, mount)
    before, after = (measure_drift(log, matrix, mount) for matrix in (nominal, average))
    return {"before": before, "after": after, "followed": followed}
