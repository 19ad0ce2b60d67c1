"""The robots that a policy meets while it learns, and the motions it follows."""

from __future__ import annotations

from youbot_env.envs.randomization import Independent, Posterior, Randomization
from youbot_env.model import Model
from youbot_env.references import Reference, SmoothRandom

# Speed, m/s, frequency, rad/s, and yaw rate, rad/s, of the motions: peaks of sums of sines, which
# are mostly far from their peaks, so the ranges are wider than those of the motions to follow.
MOTIONS = {"speed": (0.1, 0.8), "frequency": (0.3, 4.0), "yaw_rate": (0.0, 3.0)}
# What nobody has measured could lie here: masses by the data sheet within a third, friction by
# orders of magnitude, and dry friction and a late drive that no data sheet mentions.
WIDE = {
    "m0": ("scale", 0.75, 1.35),
    "I0": ("scale", 0.7, 3.0),
    "I1": ("scale", 0.5, 1.5),
    "a_x": ("uniform", -0.04, 0.04),
    "a_y": ("uniform", -0.04, 0.04),
    "mu1": ("uniform", 0.03, 0.2),
    "mu2": ("uniform", 0.001, 0.008),
    "wheel_coulomb_friction.fc": ("uniform", 0.0, 0.3),
    "actuator_delay.d": ("uniform", 0.0, 0.02),
}
WORLDS = ("nominal", "wide", "posterior")
# What each world starts from unless told otherwise.
MODELS = {"nominal": "nominal", "wide": "nominal", "posterior": "identified"}


def make_world(world: str, model: Model) -> tuple[Model, Randomization | None]:
    """Return what the environment needs: the robot in the middle, and how others are drawn.

    Args:
        world: ``nominal`` (the model itself), ``wide`` (``WIDE`` around it) or ``posterior`` (what
            the log left open: draws from the covariance of an identified model).
        model: in the middle.

    Raises:
        ValueError: an unknown world, or a posterior without covariance.
    """
    if world not in WORLDS:
        raise ValueError(f"unknown world {world!r}; choose one of {', '.join(WORLDS)}")
    if world == "nominal":
        return model, None
    if world == "posterior":
        if model.covariance is None:
            raise ValueError(
                f"model {model.name!r} has no covariance, so there is no posterior to draw from; "
                "give an identified one: youbot identify LOG --out MODEL"
            )
        return model, Posterior()
    have = {active.identifier for active in model.effects}
    drawn = {name.partition(".")[0] for name in WIDE if "." in name}
    return model.with_effects({name: None for name in sorted(drawn - have)}), Independent(WIDE)


def motions() -> Reference:
    """Smooth random motions, other ones in every episode."""
    return SmoothRandom(**MOTIONS)
