"""Trained policies on unseen seeds: against the kinematic controller, and on a hidden robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.names import FIRST_SEED

if TYPE_CHECKING:
    from controllers.rl_policy import Policy
    from controllers.training.exam import Mark
    from controllers.training.transfer import Transfer
    from youbot_env.envs.randomization import Randomization
    from youbot_env.model import Model

# For scale, beside the policies: controllers and what they believe.
OTHERS = (
    ("kinematic", "nominal"),
    ("computed_torque", "nominal"),
    ("computed_torque", "identified"),
)


def evaluate(
    policy: Annotated[
        list[str] | None,
        typer.Argument(metavar="[POLICY]...", help="Policy files; the shipped ones if left."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="The hidden robot; the one that drove the bundled logs if left."),
    ] = None,
    effect: effect_options.Effects = None,
    effects: effect_options.EffectsFile = None,
    seeds: Annotated[
        int, typer.Option(min=2, max=100_000, help="Unseen seeds of each motion.")
    ] = 100,
    seconds: Annotated[float, typer.Option(min=3, max=100, help="Length of a run, s.")] = 10.0,
    noise: Annotated[bool, typer.Option(help="Noise of the sensors in what is observed.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="The first of the seeds.")] = FIRST_SEED,
    json_file: console.Json = None,
    force: console.Force = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the page with its figures.")
    ] = None,
) -> None:
    """Compare trained policies on unseen seeds with other controllers, and on a hidden robot.

    First each policy drives multisine, eight and circle at 1 rad/s on robots like those of its
    training, beside the kinematic controller with equal seeds.  Then all drive the hidden
    robot, which no training has seen: what does it cost them?  Exit status 1: a policy does not
    beat the kinematic controller on every motion.
    """
    from controllers import make
    from controllers.rl_policy import Policy, find_policy, shipped_policies
    from controllers.training.exam import MOTIONS, examine
    from controllers.training.transfer import transfer
    from controllers.training.trial import Trial
    from ident.log import BUNDLED
    from youbot_env.model_file import load_model

    effect_options.load_effects(effects)
    page_file = None if report is None else report / "index.html"
    console.check_results(json_file, page_file, force=force)
    names = policy or shipped_policies()
    if not names:
        raise ValueError("no policy given and none shipped; train one: youbot train")
    labels = [find_policy(name).stem for name in names]
    if len(set(labels)) < len(labels):
        raise ValueError(f"policies {labels} share a name; rename one")
    policies = {label: Policy.load(name) for label, name in zip(labels, names, strict=True)}
    hidden = load_model(robot or BUNDLED.folder / "truth.yaml").with_effects(
        effect_options.parse_effects(effect)
    )

    trial = Trial(robots=seeds, seconds=seconds, noise=noise, seed=seed)
    exams: dict[str, list[Mark]] = {}
    losses: dict[str, Transfer] = {}
    rounds = 2 * len(policies) + len(OTHERS)
    with console.progress("driving", rounds, "rounds") as show:
        for label, one in policies.items():
            model, drawn = trained_on(one)
            controller = make(one.algorithm, load_model(model_of(one)), policy=one)
            exams[label] = examine(controller, model, drawn, trial)
            show(2 * len(losses) + 1)
            losses[label] = transfer(label, controller, model, hidden, drawn, trial)
            show(2 * len(losses))
        for number, (name, belief) in enumerate(OTHERS, start=1):
            model, label = load_model(belief), f"{name}, {Path(belief).stem}"
            rival = make(name, model)
            losses[label] = transfer(label, rival, model, hidden, trial=trial)
            show(2 * len(policies) + number)

    passed = {label: all(mark.passed for mark in marks) for label, marks in exams.items()}
    record = {
        "exam": {label: [mark.as_dict() for mark in marks] for label, marks in exams.items()},
        "beats_kinematic": passed,
        "hidden_robot": {
            "name": hidden.name, "values": dict(zip(hidden.names(), hidden.values(), strict=True)),
        },
        "transfer": {label: loss.as_dict() for label, loss in losses.items()},
        "worlds": compare_worlds(policies, losses),
        "training": {label: summary(one) for label, one in policies.items()},
        "motions": MOTIONS, "seeds": seeds, "seconds": seconds, "noise": noise,
        "provenance": console.provenance(seed),
    }  # fmt: skip
    console.write_json(json_file, record)
    if report is not None:
        from youbot_cli.policies_page import policies_page

        policies_page(record, policies, exams, losses).write(report)
    tell(exams, losses, record["worlds"])
    failed = [label for label, good in passed.items() if not good]
    if failed:
        raise console.CheckFailed(f"{', '.join(failed)}: no better than the kinematic controller")


def model_of(policy: Policy) -> str:
    """Name of the model in the middle of a policy's training; nominal where the file is silent."""
    from controllers.training.worlds import MODELS

    name = str(policy.training.get("model", "nominal"))
    return {Path(model).stem: model for model in MODELS.values()}.get(name, name)


def trained_on(policy: Policy) -> tuple[Model, Randomization | None]:
    """The robots on which a policy was trained."""
    from controllers.training.worlds import make_world
    from youbot_env.model_file import load_model

    return make_world(str(policy.training.get("world", "nominal")), load_model(model_of(policy)))


def compare_worlds(policies: dict[str, Policy], losses: dict[str, Transfer]) -> dict:
    """Which training of PPO is best on the hidden robot, and how sure that is."""
    from controllers.training.transfer import saved

    by_world = {
        str(one.training.get("world")): losses[label]
        for label, one in policies.items()
        if one.algorithm == "ppo"
    }
    if len(by_world) < 2:
        return {}
    best = min(by_world, key=lambda world: by_world[world].hidden.mean())
    others = [world for world in by_world if world != best]
    return {
        "best_on_hidden": best,
        "saved_m": {w: saved(by_world[w], by_world[best]).as_dict() for w in others},
        "least_degradation": min(by_world, key=lambda w: by_world[w].degradation.value),
    }


def summary(policy: Policy) -> dict:
    """How a policy came about, in short."""
    record = policy.training
    keys = ("world", "model", "steps", "wall_seconds", "last_session", "learning_curve")
    history = record.get("provenance", {})
    return {key: record.get(key) for key in keys} | {
        "command": history.get("command"), "seed": history.get("seed"),
    }  # fmt: skip


def tell(exams: dict[str, list[Mark]], losses: dict[str, Transfer], worlds: dict) -> None:
    """Print what was found."""
    rows = [
        (
            label, mark.trial.motion, f"{1e3 * mark.policy.position.mean():.2f}",
            f"{1e3 * mark.kinematic.position.mean():.2f}",
            f"{mark.times.value:.1f} ({mark.times.low:.1f} ... {mark.times.high:.1f})",
            f"{100 * mark.wins:.0f}",
        )
        for label, marks in exams.items()
        for mark in marks
    ]  # fmt: skip
    headings = ("policy", "motion", "policy mm", "kinematic mm", "times better (95 %)", "won %")
    console.table("On robots of the training: settled position error at 1 rad/s", headings, rows)
    rows = [
        (
            label, f"{1e3 * loss.known.mean():.2f}", f"{1e3 * loss.hidden.mean():.2f}",
            f"{1e3 * loss.degradation.value:.2f} ({1e3 * loss.degradation.low:.2f} ... "
            f"{1e3 * loss.degradation.high:.2f})",
        )
        for label, loss in losses.items()
    ]  # fmt: skip
    headings = ("controller", "known robots mm", "hidden robot mm", "lost by it mm (95 %)")
    console.table("\nOn the hidden robot: the same, rms over the motions", headings, rows)
    for world, gain in worlds.get("saved_m", {}).items():
        low, high = (1e3 * end for end in gain["ci95"])
        console.out.print(
            f"\nPPO trained on {worlds['best_on_hidden']} robots: {1e3 * gain['value']:.2f} mm "
            f"({low:.2f} ... {high:.2f}) less on the hidden robot than trained on {world} ones"
        )
    if worlds:
        console.out.print(
            f"\nAgainst the robots of its own training, the one trained on "
            f"{worlds['least_degradation']} robots loses least.  Intervals are over runs of one "
            "hidden robot and one training each."
        )


def start() -> None:
    """Run the command line."""
    console.run(evaluate, "--json docs/benchmarks/training_policies.json")
