"""Free-run errors on the windows that nothing was fitted to or chosen by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.contradiction import wheels_agree
from ident.diagnosis.refit import Refits, without
from ident.diagnosis.selection import Step, with_steps
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import VERIFY, Part
from ident.drive_noise import NO_NOISE, LastingNoise, lasting_noise
from ident.free_run import free_run
from ident.kinematics.ripple import ripple_share
from ident.kinematics.wheels import RIPPLE
from ident.noise_floor import velocity_floor
from ident.output_error import OutputError
from ident.sensitivity import Linearised, window_length
from youbot_env.model import Model

# The effect that rollers of an unknown make are told from.


@dataclass(frozen=True)
class FreeRunErrors:
    """Errors of body velocities as shares of their rms, along the way of adding effects.

    Of logs that are judged by force they are shares of the drive's force that are not explained.

    Attributes:
        names: of the effect that each model has more than the one before; empty for the base.
        nrmse: of each model.
        axes: (models, 3) rms errors, m/s, m/s, rad/s.
        white: what white noise of the sensors and of the drive leaves.
        lasting: what noise of the drive that lasts leaves.
        unsure: what the uncertainty of the final model's values leaves.
        rolling: what real rollers and slip may leave besides, as far as the wheels contradict each
            other.
        drop_ci95: interval of the share by which the last is smaller than the first.
        windows: number of windows behind it.
        by_force: whether forces at the measured motion are judged, not free runs.
        drive_noise: noise of the drive that lasts.
    """

    names: tuple[str, ...]
    nrmse: tuple[float, ...]
    axes: np.ndarray
    white: float
    lasting: float
    unsure: float
    rolling: float
    drop_ci95: tuple[float, float]
    windows: int
    by_force: bool = False
    drive_noise: LastingNoise = NO_NOISE

    @property
    def what(self) -> str:
        """What the errors are of, in words."""
        return "error of the forces at the measured motion" if self.by_force else "free-run error"

    @property
    def before(self) -> float:
        """Error of the base model."""
        return self.nrmse[0]

    @property
    def after(self) -> float:
        """Error of the final model."""
        return self.nrmse[-1]

    @property
    def bounded(self) -> bool:
        """Whether the final model leaves less than all of the motion, or of the drive's force."""
        return bool(np.isfinite(self.nrmse).all() and self.after < SETTINGS.whole_error)

    @property
    def drops(self) -> dict[str, float]:
        """Share by which each effect lowered the error when it was added."""
        pairs = zip(self.names[1:], self.nrmse[1:], self.nrmse, strict=False)
        return {name: 1.0 - now / before for name, now, before in pairs}

    @property
    def remaining(self) -> np.ndarray:
        """(models,) errors by axis in units of the base's, rms over the axes.

        An axis that no model explains does not hide here what happens on the others.
        """
        if self.by_force:
            return np.array(self.nrmse) / self.nrmse[0]
        return np.sqrt(np.mean((self.axes / self.axes[0]) ** 2, axis=1))

    @property
    def left(self) -> float:
        """Share of the squared error beyond noise and rolling that the final model leaves."""
        return self._excess(-1) / max(self._excess(0), 1e-300)

    @property
    def beyond_noise(self) -> float:
        """Share of the squared error beyond noise alone that the final model leaves."""
        before, after = (max(e**2 - self.floor**2, 0.0) for e in (self.before, self.after))
        return after / max(before, 1e-300)

    @property
    def unexplained(self) -> float:
        """Squared error that the final model leaves beyond rolling, in units of that of noise."""
        return max(self.after**2 - self._excused, 0.0) / max(self.floor, 1e-300) ** 2

    @property
    def clear(self) -> bool:
        """Whether what the final model leaves is clearly more than noise and rolling."""
        sure = (
            SETTINGS.clear_excess * self._excused
            + (SETTINGS.noise_scatter - SETTINGS.clear_excess) * self.lasting**2
        )
        return self._excess(-1) > sure

    @property
    def account(self) -> dict[str, float]:
        """Shares of the base's squared error: effects, noise, parameters, rolling, remainder."""
        squares = np.array(self.nrmse) ** 2
        shares = dict(zip(self.names[1:], (squares[:-1] - squares[1:]).tolist(), strict=True))
        left = float(squares[-1])
        excuses = (("white noise", self.white), ("lasting noise of the drive", self.lasting),
                   ("parameters", self.unsure), ("rolling", self.rolling))  # fmt: skip
        for name, size in excuses:
            shares[name] = min(size**2, left)
            left -= shares[name]
        shares["remainder"] = left
        return {name: share / float(squares[0]) for name, share in shares.items()}

    @property
    def floor(self) -> float:
        """What noise leaves."""
        return float(np.hypot(self.white, self.lasting))

    @property
    def excuse(self) -> str:
        """What noise and rolling leave, in words."""
        said = f"{100 * self.floor:.3g} % of noise"
        if self.lasting > self.white:
            said += f" (of the drive, {self.drive_noise})"
        if self.unsure > SETTINGS.clear_excess * self.floor:
            said += f", {100 * self.unsure:.2g} % of parameters that are not known better"
        return said + (f" and the {100 * self.rolling:.2g} % of rolling" if self.rolling else "")

    @property
    def _excused(self) -> float:
        return self.floor**2 + self.unsure**2 + self.rolling**2

    def _excess(self, number: int) -> float:
        return max(self.nrmse[number] ** 2 - self._excused, 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "before": self.before,
            "after": self.after,
            "noise_floor": self.floor,
            "drive_noise": {
                "nrmse": self.lasting,
                "size": self.drive_noise.size,
                "time": self.drive_noise.time,
            },
            "parameters": self.unsure,
            "rolling": self.rolling,
            "account": self.account,
            "drop_ci95": list(self.drop_ci95),
            "steps": [
                {"added": name or None, "nrmse": error}
                | dict(zip(("vx", "vy", "yaw_rate"), axes.tolist(), strict=True))
                for name, error, axes in zip(self.names, self.nrmse, self.axes, strict=True)
            ],
        }


def free_run_errors(
    fits: Refits, chain: list[tuple[str, Model]], simulation: Linearised
) -> FreeRunErrors:
    """Simulate the held-out windows of all logs with every model of a chain.

    Args:
        fits: the logs.
        chain: names and models.
        simulation: of a log with held-out windows with the last model.
    """
    parts = [part for part in fits.parts if part.windows(VERIFY).any()]
    squared = np.array([_squared(fits.parts, fits.models(model)) for _, model in chain])
    by_force, spread = parts[0].log.window is not None, _spread(parts, chain[0][1])
    by_window = np.mean(squared / spread**2, axis=2)
    drawn = np.random.default_rng(0).integers(
        0, by_window.shape[1], (SETTINGS.holdout_draws, by_window.shape[1])
    )
    means = by_window[:, drawn].mean(axis=2)
    low, high = np.quantile(1.0 - np.sqrt(means[-1] / means[0]), [0.025, 0.975])
    names, errors = [name for name, _ in chain], by_window.mean(axis=1)
    at = names.index(RIPPLE) if RIPPLE in names else 0
    least = SETTINGS.ripple_explained
    rippled = at > 0 and (
        errors[at] < least * errors[at - 1] or ripple_share(simulation.log) > 1.0 - least
    )
    return FreeRunErrors(
        tuple(names),
        tuple(np.sqrt(errors).tolist()),
        np.sqrt(squared.mean(axis=1)),
        *velocity_floor(simulation, spread, rippled),
        (float(low), float(high)),
        by_window.shape[1],
        by_force,
        lasting_noise(simulation.log),
    )


def confirmed(
    fits: Refits, base: OutputError, steps: list[Step], simulation: Linearised
) -> list[Step]:
    """Leave out steps without which the error on held-out windows is hardly larger.

    A few windows can only refuse what makes them worse.  Where rollers may feign an effect it must
    remove a part of the whole error, as when it was chosen.
    """
    feigned = not wheels_agree(simulation.log)
    while len(steps) > 1:
        full = with_steps(base.model, steps)
        models = [without(full, step.best.identifier) for step in steps] + [full]
        chain = [("", base.model)] + [("", fits.of(model)[0].model) for model in models]
        errors = free_run_errors(fits, chain, simulation)
        least = SETTINGS.least_gain if errors.windows >= SETTINGS.fewest_windows else 0.0
        left, without_it = errors.remaining[-1] ** 2, errors.remaining[1:-1] ** 2
        gain = 1.0 - left / without_it
        if feigned:
            real = np.array([not step.background for step in steps])
            gain *= np.where(real, np.minimum(without_it, 1.0), 1.0)
        idlest = int(np.argmin(gain))
        if gain[idlest] > least:
            break
        steps = [step for k, step in enumerate(steps) if k != idlest]
    return steps


def held_out_error(
    parts: list[Part], models: tuple[Model, ...], base: Model
) -> tuple[float, np.ndarray]:
    """Error of models that need not be refined, in the units of ``free_run_errors``.

    Args:
        parts: the logs.
        models: the model of each.
        base: the first model of the chain they are compared with.

    Returns:
        The error, and (3,) rms errors, m/s, m/s, rad/s.
    """
    squared = _squared(parts, models).mean(axis=0)
    spread = _spread([part for part in parts if part.windows(VERIFY).any()], base)
    return float(np.sqrt(np.mean(squared / spread**2))), np.sqrt(squared)


def _spread(parts: list[Part], base: Model) -> np.ndarray:
    """(3,) what errors are shares of: rms of the motion, or of what the drive would make."""
    if parts[0].log.window is not None:
        spread = _by_drive(parts, base)
    else:
        spread = np.concatenate([p.log.velocity() for p in parts]).std(axis=0)
    return np.maximum(spread, 1e-9)


def _by_drive(parts: list[Part], model: Model) -> np.ndarray:
    """(3,) velocities that the drive alone would give a robot in a window, m/s, m/s, rad/s.

    Rms over the axes, so that errors in units of them are shares of the force of the drive.
    """
    lever, inertia = model.platform.lever, model.parameters
    wrench = np.concatenate([p.log.command @ p.log.platform.jacobian_array for p in parts])
    force = np.sqrt(np.mean(np.sum((wrench / (1.0, 1.0, lever)) ** 2, axis=1)) / 3)
    return window_length(parts[0].log) * force / (inertia.m0, inertia.m0, inertia.I0 / lever)


def _squared(parts: list[Part], models: tuple[Model, ...]) -> np.ndarray:
    """(W, 3) mean squared errors of the held-out windows."""
    found = []
    for part, model in zip(parts, models, strict=True):
        if not part.windows(VERIFY).any():
            continue
        run = free_run(part.log, model, window_length(part.log))
        error = np.nan_to_num((run.simulated - run.measured) ** 2, nan=1e6, posinf=1e6)
        found.append(error.reshape(len(part.role), -1, 3).mean(axis=1)[part.windows(VERIFY)])
    return np.concatenate(found)
