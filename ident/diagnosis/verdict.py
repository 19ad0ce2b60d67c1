"""What a diagnosis answers: the verdict, and why, in a sentence that states the errors."""

from __future__ import annotations

from ident.diagnosis.forces import ForceShare
from ident.diagnosis.holdout import FreeRunErrors
from ident.diagnosis.rounds import Round
from ident.diagnosis.selection import Step
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.trials import behind_gap
from ident.identifiability import FAINT
from ident.unexplained import UNEXPLAINED
from youbot_env.effects import get_effect


def decide(
    steps: list[Step],
    errors: FreeRunErrors,
    outside: bool,
    first: Round,
    last: Round,
    forces: dict[str, list[ForceShare]],
) -> tuple[str, str]:
    """Return verdict and reason.

    Args:
        steps: effects that were added.
        errors: on held-out windows, of base, of every step and of the last model.
        outside: whether a dependence explains more than the library does.
        first, last: the first and the last round.
        forces: what the forces at the measured motion say of each effect, for every log.
    """
    real = [step for step in steps if step.real]
    fall = f"{errors.what} {100 * errors.before:.3g} % to {100 * errors.after:.3g} %"
    signals = ", ".join(signal for signal, _ in last.dependences()) or "no signal that was tried"
    names = ", ".join(step.best.identifier for step in real)
    left, clear = errors.left, errors.clear
    if first.wheels_agree:  # how much rollers leave is not known so well where it was fitted
        left = max(last.excess / max(first.excess, 1e-300), left)
        clear = clear or last.excess > last.floor
    if not errors.bounded:
        return "cannot_say", (
            f"the simulation explains nothing of these logs ({fall}): what they hold does not "
            "determine the model; record a motion on all axes with starts, stops and reversals"
        )
    if errors.by_force and (not real or errors.before < FAINT):
        return "cannot_say", (
            "these logs hold no acceleration, and viscous friction leaves "
            f"{100 * errors.before:.2g} % of the drive's force, in which no effect shows: whatever "
            "resists at the speeds driven looks like it; record several speeds and directions, "
            "better `youbot record --motion calibration`"
        )
    if outside:
        return "outside_library", (
            f"the {errors.what}, {100 * errors.after:.3g} % beside {errors.excuse}, depends on "
            f"{signals}, as no effect explains"
        )
    told = bool(last.dependences())
    if not real and _unexplained(errors, last) > UNEXPLAINED:
        far = (
            f"the {errors.what}, {100 * errors.after:.3g} %, is far above the "
            f"{errors.excuse}, and no effect lowers it"
        )
        if told:
            return "outside_library", f"{far}; it depends on {signals}"
        if errors.rolling and not first.wheels_agree:
            return "cannot_say", (
                f"{far}; the wheels contradict each other, as other radii than assumed, slip and "
                "worn rollers make them; with a pose beside the wheels calibrate_kinematics.py "
                "tells which"
            )
        # Noise of the drive that all wheels share does not go with the motion; something that
        # swings by itself need not either.
        like = (
            "it is alike at all times, as noise of the drive or something that swings is"
            if last.steady
            else "it goes with the motion"
        )
        return "cannot_say", (
            f"{far}; it depends on no signal that was tried, and {like}; record the same motion "
            "twice, which shows what repeats"
        )
    if not real:
        background = "".join(
            f"; {s.best.identifier} is there, as on real rollers" for s in steps if s.background
        ) + "".join(f"; {s.best.identifier}, of the recording, is there" for s in steps
                    if s.recording)  # fmt: skip
        return "nothing_missing", (
            f"no effect removes {100 * SETTINGS.least_gain:.0f} % of the squared error where it "
            f"was not fitted; the {errors.what} is {100 * errors.after:.3g} %, beside "
            f"{errors.excuse}{background}"
        )
    if errors.remaining[-1] >= 1.0 or errors.after >= errors.before:
        return "cannot_say", (
            f"{names} fit, but not what was kept for the end ({fall}); record another motion"
        )
    if errors.drop_ci95[0] <= 0.0:
        low, high = (100 * share for share in errors.drop_ci95)
        return "cannot_say", (
            f"{names} fit, but the {fall} on what was kept for the end is no certain gain "
            f"({round(low)} to {round(high)} % of it); record a motion on all axes with starts, "
            "stops and reversals"
        )
    if left > SETTINGS.remainder and clear:
        return "outside_library", (
            f"{names} fit best, but leave {100 * left:.0f} % of what noise cannot explain "
            f"({fall}, beside {errors.excuse}); it depends on {signals}"
        )
    denied = _denied(real, forces)
    if denied and errors.beyond_noise > SETTINGS.worth_telling:
        return "outside_library", (
            f"{names} fit best, but {denied}, and {100 * errors.beyond_noise:.0f} % of the squared "
            f"error beyond noise is left ({fall}, beside {errors.excuse}): something else acts, "
            f"which depends on {signals}"
        )
    for step in real:
        for rival in get_effect(step.best.identifier).confusables:
            why = next(filter(None, (behind_gap(get_effect(rival), log) for log in last.logs)), "")
            if why:
                return "cannot_say", (
                    f"{names} fits, but {rival}, which looks alike, could not be tried: {why} "
                    f"({fall})"
                )
    rest = f", beside {errors.excuse}"
    if denied:
        rest += f"; {denied}: its law is not quite that"
    if clear and left > SETTINGS.worth_telling:
        rest += f"; {100 * left:.0f} % of what noise cannot explain is left"
        rest += f" and depends on {signals}" if told else ""
    doubtful = [step for step in real if len(step.group) > 1]
    if doubtful:
        return (
            "ambiguous",
            f"{', '.join(doubtful[0].group)} explain the log alike; {fall}{rest}",
        )
    return "named", f"{names}; {fall}{rest}"


def _unexplained(errors: FreeRunErrors, last: Round) -> float:
    """Squared error beyond rolling, in units of that of noise, where fitted and where not."""
    fitted = last.excess / last.noise
    return fitted if errors.by_force else max(fitted, errors.unexplained)


def _denied(steps: list[Step], forces: dict[str, list[ForceShare]]) -> str:
    """What the forces at the measured motion say against named effects, in words."""
    said = []
    for step in steps:
        against = [share for share in forces.get(step.best.identifier, ()) if share.denies]
        if against:
            worst = max(against, key=lambda share: abs(share.value - 1.0))
            said.append(
                f"the forces at the measured motion show {100 * worst.value:.0f} % of "
                f"{step.best.identifier}"
            )
    return ", ".join(said)
