"""Train a policy by reinforcement learning, and tell whether it beats the kinematic controller."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from youbot_cli import console, effect_options

CHECKPOINT = "checkpoint.pt"  # as controllers.training.checkpoint, which imports torch
ALGORITHMS = ("ppo", "sac", "residual")


def train(
    algorithm: Annotated[
        str, typer.Option(help="ppo, sac, or residual: PPO on top of computed torque.")
    ] = "ppo",
    world: Annotated[
        str,
        typer.Option(
            help="Robots to learn on: nominal, wide (whatever nobody has measured is drawn) or "
            "posterior (what the log of an identified model left open is drawn)."
        ),
    ] = "nominal",
    model: Annotated[
        str | None,
        typer.Option(help="The robot in their middle; nominal, or identified."),
    ] = None,
    effects: effect_options.EffectsFile = None,
    steps: Annotated[
        int | None,
        typer.Option(min=1, max=10**9, help="Control periods; what the recipe says if left."),
    ] = None,
    copies: Annotated[
        int | None,
        typer.Option(min=1, max=65_536, help="Robots side by side; the recipe's if left."),
    ] = None,
    noise: Annotated[bool, typer.Option(help="Noise of the sensors in what is observed.")] = True,
    seeds: Annotated[
        int, typer.Option(min=2, max=100_000, help="Unseen seeds of the final exam.")
    ] = 100,
    seconds: Annotated[float, typer.Option(min=3, max=100, help="Length of its runs, s.")] = 10.0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Policy; runs/train/... if left.")
    ] = None,
    onnx: Annotated[
        Path | None, typer.Option(metavar="FILE.onnx", help="Write the policy as ONNX, too.")
    ] = None,
    checkpoints: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Keep the state of the run here.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from --checkpoints.")] = False,
    tensorboard: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write curves for TensorBoard.")
    ] = None,
    seed: console.Seed = 0,
    json_file: console.Json = None,
    force: console.Force = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the page with the learning curve.")
    ] = None,
) -> None:
    """Train a policy by reinforcement learning, and tell whether it beats the kinematic controller.

    Policies see the observation of YouBot-v0 and command wheel torques.  After training both drive
    three motions at 1 rad/s on unseen seeds, and on unseen robots where the world draws them.
    Exit status 1: the policy is not better on every motion; it is written all the same.  Run it
    with make(ALGORITHM, model=..., policy=FILE).
    """
    from controllers import make
    from controllers.training.worlds import MODELS, make_world
    from youbot_env.model_file import load_model

    effect_options.load_effects(effects)
    check_words(algorithm, world, resume, checkpoints)
    need("torch", "stable_baselines3", *(["tensorboard"] if tensorboard else []))
    need(*(["onnx"] if onnx else []))
    out = (out or Path(f"runs/train/{algorithm}_{world}.json")).with_suffix(".json")
    page_file = None if report is None else report / "index.html"
    console.check_results(json_file, page_file, onnx, out, out.with_suffix(".npz"), force=force)
    check_checkpoints(checkpoints, resume or force)
    centre = load_model(model or MODELS[world])

    from controllers.training.exam import examine
    from controllers.training.export import write_onnx
    from controllers.training.learn import Run
    from controllers.training.recipe import RECIPES
    from controllers.training.trial import Trial

    recipe = RECIPES[algorithm]
    recipe = replace(
        recipe, noise=noise, steps=steps or recipe.steps, copies=copies or recipe.copies
    )
    run = Run(recipe, world, centre, seed, checkpoints, tensorboard)
    if resume:
        run.resume()
    began, cpu = time.perf_counter(), time.process_time()
    first = run.algorithm.num_timesteps
    with speedometer(f"{algorithm}, {world}", recipe.steps) as show:
        run.learn(show)
    wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    done = run.algorithm.num_timesteps - first
    controller = make(algorithm, centre, policy=run.policy())
    robots = make_world(world, centre)
    with console.progress("exam", 3, "motions") as show:
        marks = examine(
            controller, *robots, Trial(robots=seeds, seconds=seconds, noise=noise), show
        )
    passed = all(mark.passed for mark in marks)

    history = console.provenance(seed)
    record = {
        "algorithm": algorithm,
        "world": world,
        "model": centre.name,
        "recipe": recipe.as_dict(),
        "steps": run.algorithm.num_timesteps,
        "wall_seconds": run.seconds,
        "last_session": {
            "steps": done, "wall_seconds": wall, "cpu_seconds": cpu,
            "steps_per_second": done / wall, "steps_per_cpu_second": done / cpu,
            "load_average": list(os.getloadavg()),
        },
        "learning_curve": [plain(asdict(look)) for look in run.curve],
        "exam": [mark.as_dict() for mark in marks],
        "beats_kinematic": passed,
        "provenance": history,
    }  # fmt: skip
    policy = run.policy(record)
    policy.save(out)
    if onnx is not None:
        write_onnx(policy, onnx)
    console.write_json(json_file, record | {"policy": console.shown(out)})
    if report is not None:
        from youbot_cli.train_page import training_page

        training_page(record, marks).write(report)
    tell(record, marks, out)
    if not passed:
        raise console.CheckFailed(
            f"not better than the kinematic controller on every motion; train longer (--steps "
            f"{2 * recipe.steps}"
            + (" --resume)" if checkpoints else "; --checkpoints DIR lets you go on)")
        )


def check_words(algorithm: str, world: str, resume: bool, checkpoints: Path | None) -> None:
    """Refuse unknown names, and a resume without a place to resume from."""
    from controllers.training.worlds import WORLDS

    for name, value, known in (
        ("--algorithm", algorithm, ALGORITHMS),
        ("--world", world, WORLDS),
    ):
        if value not in known:
            raise ValueError(f"{name} {value}: choose one of {', '.join(known)}")
    if resume and checkpoints is None:
        raise ValueError("--resume needs --checkpoints DIR, the folder of the run to go on with")


def check_checkpoints(folder: Path | None, may: bool) -> None:
    """Refuse to begin anew over the state of a run, which hours may have gone into."""
    if folder is not None and not may and (folder / CHECKPOINT).exists():
        raise ValueError(
            f"{str(folder)!r} holds the state of a run: go on with it by --resume, choose another "
            "folder, or begin anew with --force"
        )


def need(*packages: str) -> None:
    """Refuse, before anything is computed, what an optional package would have to do."""
    for name in packages:
        if find_spec(name) is None:
            pip = name.replace("_", "-")
            raise ImportError(f"this needs the package {pip}: python -m pip install {pip}")


@contextmanager
def speedometer(title: str, total: int) -> Iterator[Callable[[int, float], None]]:
    """A bar with steps a second; the body gets a function of steps done and speed."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps"),
        TextColumn("{task.fields[speed]:,.0f} steps/s"),
        TimeRemainingColumn(),
    )
    hidden = not console.err.is_terminal
    with Progress(*columns, console=console.err, transient=True, disable=hidden) as bar:
        task = bar.add_task(title, total=total, speed=0.0)
        yield lambda done, speed: bar.update(task, completed=done, speed=speed)


def plain(look: dict[str, Any]) -> dict[str, Any]:
    """A look in numbers that JSON has: what is not known yet becomes null."""
    return {k: v if math.isfinite(v) else None for k, v in look.items()}


def tell(record: dict, marks: list, out: Path) -> None:
    """Print the verdict and the figures behind it."""
    word = "beats" if record["beats_kinematic"] else "does not beat"
    console.out.print(
        f"{record['algorithm']} {word} the kinematic controller at 1 rad/s on "
        f"{marks[0].trial.robots} unseen seeds; learned in {record['wall_seconds'] / 60:.1f} min "
        f"({record['last_session']['steps_per_second']:,.0f} steps/s)\n"
    )
    rows = [
        (
            mark.trial.motion, f"{1e3 * mark.policy.position.mean():.2f}",
            f"{1e3 * mark.kinematic.position.mean():.2f}",
            f"{mark.times.value:.1f} ({mark.times.low:.1f} ... {mark.times.high:.1f})",
            f"{100 * mark.wins:.0f}", f"{1e3 * mark.policy.run.mean():.2f}",
            f"{1e3 * mark.kinematic.run.mean():.2f}",
        )
        for mark in marks
    ]  # fmt: skip
    headings = ("motion", "policy mm", "kinematic mm", "times better (95 %)", "seeds won %",
                "with start: policy mm", "kinematic mm")  # fmt: skip
    console.table("Rms position error, settled, and with the start from rest", headings, rows)
    console.out.print(f"\nwritten: {console.shown(out)} and its .npz")


def start() -> None:
    """Run the command line."""
    console.run(train, "--algorithm ppo --out runs/my_policy.json --report runs/training")
