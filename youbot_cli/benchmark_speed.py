"""Speed of the environments as ratios to Gymnasium's own, measured in turns in one process."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from youbot_cli import console

ROUNDS = 40


def benchmark(
    copies: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Copies in the vector environments.")
    ] = 4096,
    rounds: Annotated[
        int, typer.Option(min=3, max=10_000, help="Turns of each environment.")
    ] = ROUNDS,
    seed: console.Seed = 0,
    json: console.Json = None,
    force: console.Force = False,
) -> None:
    """Measure steps a second; turns are short, so a busy machine slows both rivals alike."""
    import gymnasium as gym

    import youbot_env

    gym.register_envs(youbot_env)

    console.check_results(json, force=force)
    result = {}
    with console.progress("rounds", 2 * rounds) as show:
        single = [gym.make(name) for name in ("YouBot-v0", "Pendulum-v1")]
        result["single"] = race(single, 400, 1, rounds, seed, show)
        vector = [
            gym.make_vec(name, copies, vectorization_mode="vector_entry_point")
            for name in ("YouBot-v0", "CartPole-v1")
        ]
        result["vector"] = race(vector, 15, copies, rounds, seed, lambda done: show(rounds + done))
    rivals = {"single": "Pendulum-v1", "vector": f"CartPole-v1, {copies} copies"}
    rows = [(rivals[kind], *figures.values()) for kind, figures in result.items()]
    console.table(
        "\nYouBot-v0 against Gymnasium", ("rival", "ratio", "YouBot steps/s", "rival steps/s"), rows
    )
    console.write_json(json, {**result, "provenance": console.provenance(seed)})


def race(envs: list, steps: int, copies: int, rounds: int, seed: int, show) -> dict[str, float]:
    """Median ratio of the first environment's speed to the second's, and both speeds, 1/s."""
    import numpy as np

    for env in envs:
        env.action_space.seed(seed)
        env.reset(seed=seed)
    speeds = []
    for number in range(rounds):
        speeds.append([copies * turn(env, steps) for env in envs])
        show(number + 1)
    ours, theirs = np.array(speeds).T
    return {
        "ratio": float(np.median(ours / theirs)),
        "youbot": float(np.median(ours)),
        "rival": float(np.median(theirs)),
    }


def turn(env, steps: int) -> float:
    """Environment steps a second over some steps with random actions, sampling included."""
    vector, start = hasattr(env, "num_envs"), time.perf_counter()
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if not vector and (terminated or truncated):
            env.reset()
    return steps / (time.perf_counter() - start)


def start() -> None:
    """Run the command line."""
    console.run(benchmark, "--json docs/benchmarks/speed.json")
