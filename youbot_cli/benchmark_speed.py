"""Speed of the environments as ratios to Gymnasium's own, measured in turns in one process."""

from __future__ import annotations

import json as json_text
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from youbot_cli import console

ROUNDS = 15
SIZES = (1, 16, 256, 4096, 65536)
WHOLE = 4096  # copies at which all cases are measured
STEPS_A_TURN = 60_000  # of all copies together
MOST_STEPS, LEAST_STEPS = 400, 2
PREPARED = 16  # actions, used in turn
RESETS = 7
FALL = 0.3  # share of a ratio that may be lost before a check fails
RIVAL = "CartPole-v1"
THREE = ("wheel_coulomb_friction", "actuator_lag", "floor_slope")
EIGHT = (*THREE, "torque_saturation", "roller_coulomb_friction", "quadratic_drag",
         "wheel_friction_asymmetry", "yaw_scrub_friction")  # fmt: skip
SPREAD = {"m0": ("scale", 0.8, 1.2), "mu1": ("uniform", 0.05, 0.2)}


def cases() -> dict[str, dict[str, Any]]:
    """What is raced: arguments of YouBot-v0 by name; the first three at every number of copies."""
    from youbot_env.envs.randomization import Independent
    from youbot_env.model_file import load_model
    from youbot_env.references import Multisine
    from youbot_env.simulation import Sensors

    drawn = Independent(SPREAD)
    paper, moving = load_model("paper"), Multisine(speed=(0.1, 0.5), frequency=(0.3, 2.0))
    return {
        "0 effects": {},
        "3 effects": {"model": paper.with_effects(dict.fromkeys(THREE))},
        "8 effects": {"model": paper.with_effects(dict.fromkeys(EIGHT))},
        "0 effects, robots drawn": {"randomization": drawn},
        "multisine": {"reference": moving},
        "multisine, robots drawn, sensors": {
            "reference": moving, "randomization": drawn, "sensors": Sensors(),
        },
    }  # fmt: skip


def benchmark(
    copies: Annotated[
        list[int] | None,
        typer.Option(min=1, max=1_000_000, help="Copies in the vector environments; repeatable."),
    ] = None,
    rounds: Annotated[
        int, typer.Option(min=3, max=10_000, help="Turns of each environment.")
    ] = ROUNDS,
    check: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Fail where a ratio is 30 % below that of this result."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw speed over copies (PNG).")
    ] = None,
    seed: console.Seed = 0,
    json: console.Json = None,
    force: console.Force = False,
) -> None:
    """Measure steps a second; turns are short, so a busy machine slows both rivals alike.

    Actions are drawn before the clock starts: an environment that does nothing is infinitely fast.
    """
    import gymnasium as gym

    import youbot_env

    gym.register_envs(youbot_env)
    console.check_results(json, force=force)
    console.check_writable(figure)
    known = json_text.loads(check.read_text()) if check else None
    sizes = tuple(copies or SIZES)
    rows: list[dict[str, Any]] = []
    with console.progress("races", len(sizes) + 1) as show:
        single = {"YouBot-v0": gym.make("YouBot-v0"), "rival": gym.make("Pendulum-v1")}
        figures = race(single, 1, rounds, seed)
        rows.append({"case": "single, against Pendulum-v1", "copies": 1} | figures["YouBot-v0"])
        show(1)
        for done, size in enumerate(sizes):
            rows += vector_rows(size, rounds, seed)
            show(done + 2)
    result = {"rows": rows, "start_up": start_up(), "provenance": console.provenance(seed)}
    console.table(
        f"\nYouBot-v0 against {RIVAL}, actions prepared",
        ("case", "copies", "ratio", "steps/s", "rival steps/s", "reset of all, steps"),
        [
            (row["case"], row["copies"], row["ratio"], row["steps_per_s"], row["rival_per_s"],
             row.get("reset_steps", ""))
            for row in rows
        ],
    )  # fmt: skip
    console.table("\nStart-up, s", ("what", "seconds"), list(result["start_up"].items()))
    console.write_json(json, result)
    if figure is not None:
        draw(rows, figure)
    if known is not None:
        compare(rows, known["rows"])


def vector_rows(size: int, rounds: int, seed: int) -> list[dict[str, Any]]:
    """Race the vector environments of one number of copies."""
    import gymnasium as gym
    import numpy as np

    chosen = cases() if size == WHOLE else dict(list(cases().items())[:3])
    envs = {
        name: gym.make_vec("YouBot-v0", size, vectorization_mode="vector_entry_point", **arguments)
        for name, arguments in chosen.items()
    }
    envs["rival"] = gym.make_vec(RIVAL, size, vectorization_mode="vector_entry_point")
    figures = race(envs, size, rounds, seed)
    rows = []
    for name in chosen:
        reset = []
        for _ in range(RESETS):
            start = time.perf_counter()
            envs[name].reset()
            reset.append(time.perf_counter() - start)
        taken = float(np.median(reset)) * figures[name]["steps_per_s"] / size
        rows.append({"case": name, "copies": size} | figures[name] | {"reset_steps": taken})
    return rows


def race(envs: dict, copies: int, rounds: int, seed: int) -> dict[str, dict[str, float]]:
    """Speeds of environments that take turns: medians, and of the ratios to ``rival``."""
    import numpy as np

    steps = max(LEAST_STEPS, min(MOST_STEPS, STEPS_A_TURN // copies))
    actions = {}
    for name, env in envs.items():
        env.action_space.seed(seed)
        env.reset(seed=seed)
        actions[name] = [env.action_space.sample() for _ in range(PREPARED)]
        turn(env, actions[name], steps)
    speeds: dict[str, list[float]] = {name: [] for name in envs}
    for _ in range(rounds):
        for name, env in envs.items():
            speeds[name].append(copies * turn(env, actions[name], steps))
    rival = np.array(speeds["rival"])
    return {
        name: {
            "ratio": float(np.median(np.array(own) / rival)),
            "steps_per_s": float(np.median(own)),
            "rival_per_s": float(np.median(rival)),
        }
        for name, own in speeds.items()
    }


def turn(env, actions: list, steps: int) -> float:
    """Environment steps a second over some steps with prepared actions."""
    vector, start = hasattr(env, "num_envs"), time.perf_counter()
    for k in range(steps):
        _, _, terminated, truncated, _ = env.step(actions[k % len(actions)])
        if not vector and (terminated or truncated):
            env.reset()
    return steps / (time.perf_counter() - start)


def start_up() -> dict[str, float]:
    """Median seconds of starting Python, the environments, and the help of commands."""
    import numpy as np

    calls = {
        "python alone": ["-c", "pass"],
        "import youbot_env": ["-c", "import youbot_env"],
        "youbot --help": ["-m", "youbot_cli", "--help"],
        "youbot identify --help": ["-m", "youbot_cli", "identify", "--help"],
        "youbot benchmark speed --help": ["-m", "youbot_cli", "benchmark", "speed", "--help"],
    }
    result = {}
    for name, words in calls.items():
        taken = []
        for _ in range(3):
            start = time.perf_counter()
            subprocess.run([sys.executable, *words], check=True, capture_output=True)
            taken.append(time.perf_counter() - start)
        result[name] = float(np.median(taken))
    return result


def compare(rows: list[dict], known: list[dict]) -> None:
    """Compare ratios with those of an earlier result.

    Raises:
        CheckFailed: one is more than 30 % lower; the message names all of these.
    """
    before = {(row["case"], row["copies"]): row["ratio"] for row in known}
    slower = [
        f"{row['case']}, {row['copies']} copies: {row['ratio']:.3g} after {old:.3g}"
        for row in rows
        if (old := before.get((row["case"], row["copies"]))) and row["ratio"] < (1 - FALL) * old
    ]
    if slower:
        raise console.CheckFailed("ratios fell by more than 30 %: " + "; ".join(slower))


def draw(rows: list[dict], path: Path) -> None:
    """Draw steps a second over the number of copies, both logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    raced = [row for row in rows if "reset_steps" in row]
    lines = {name: ("steps_per_s", name) for name in list(cases())[:3]}
    lines[RIVAL] = ("rival_per_s", "0 effects")
    for label, (kind, case) in lines.items():
        points = [(row["copies"], row[kind]) for row in raced if row["case"] == case]
        style = "--" if label == RIVAL else "-"
        axes.loglog(*zip(*sorted(points), strict=True), style, marker="o", label=label)
    axes.set_xlabel("copies")
    axes.set_ylabel("environment steps a second, one core")
    axes.grid(which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def start() -> None:
    """Run the command line."""
    console.run(benchmark, "--json docs/benchmarks/speed.json --figure docs/benchmarks/speed.png")
