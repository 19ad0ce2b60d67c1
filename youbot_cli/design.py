"""Design the motion that tells most about what one wants to know."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.names import ACCELERATION, TORQUE, YAW_ACCELERATION, YAW_RATE

if TYPE_CHECKING:
    from ident.design import Design, Experiment


def design(
    target: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="NAME",
            help="m0, I0, I1, a_x, a_y, mu1, mu2, x1 to x7, x1+x3, x2+x3, A (all parameters, each "
            "in sizes of itself) or D (volume of all intervals).",
        ),
    ] = "m0",
    seconds: Annotated[float, typer.Option(max=3600, help="Length of the experiment, s.")] = 60.0,
    speed: Annotated[float, typer.Option(help="Limit of the centre's speed, m/s.")] = 0.3,
    yaw_rate: Annotated[float, typer.Option(help="Limit, rad/s.")] = YAW_RATE,
    acceleration: Annotated[
        float, typer.Option(help="Limit of the centre's acceleration, m/s^2.")
    ] = ACCELERATION,
    yaw_acceleration: Annotated[float, typer.Option(help="Limit, rad/s^2.")] = YAW_ACCELERATION,
    torque: Annotated[float, typer.Option(help="Limit of each wheel, N m.")] = TORQUE,
    model: Annotated[
        str, typer.Option(help="Robot that is expected: model file, nominal or paper.")
    ] = "nominal",
    effects: effect_options.EffectsFile = None,
    harmonics: Annotated[int, typer.Option(max=64, help="Sines on each axis.")] = 8,
    starts: Annotated[int, typer.Option(max=1000, help="Random starts of the search.")] = 8,
    runs: Annotated[
        int,
        typer.Option(max=10_000, help="Simulated experiments that check the result; 0 for none."),
    ] = 100,
    seed: console.Seed = 0,
    motion_file: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="The motion, YAML.")
    ] = Path("runs/motion.yaml"),
    json_file: console.Json = None,
    force: console.Force = False,
) -> None:
    """Design the motion that tells most about what one wants to know.

    Sines on three axes, within the limits, are chosen so that the expected 95 % interval becomes
    small.  Beside it stand the paper's motions I-IV at their best base frequencies, at equal time
    and limits.  Both are checked by simulated experiments with wheel loops and noisy sensors.
    """
    from ident.design import Limits, design_motion
    from youbot_env.model_file import load_model
    from youbot_env.references import save_motion

    effect_options.load_effects(effects)
    if motion_file.suffix.lower() not in (".yaml", ".yml"):
        raise ValueError(f"--out {motion_file}: motions are written as YAML; end the name in .yaml")
    console.check_results(motion_file, json_file, force=force)
    if runs < 0 or 0 < runs < 3:
        raise ValueError(f"--runs {runs}: give 0 for none, or 3 or more")
    limits = Limits(speed, yaw_rate, acceleration, yaw_acceleration, torque)
    robot = replace(load_model(model), effects=())
    with console.progress(f"motion for {target}", 1.0) as show:
        found = design_motion(target, robot, seconds, limits, harmonics, starts, seed, None, show)
    checks = simulated(found, runs, seed)

    about = {"expected_for": robot.name, "seconds": seconds, "limits": asdict(limits)}
    about |= {"provenance": console.provenance(seed)}
    save_motion(replace(found.motion, about=about), motion_file)
    rows = compared(found, checks)
    result = {"target": target, "seconds": seconds, "motion": console.shown(motion_file)}
    result |= {"limits": asdict(limits), "use": used(found), "quantities": rows, "runs": runs}
    result |= {"calibration_frequencies": frequencies(found), "provenance": about["provenance"]}
    console.write_json(json_file, result)
    report(found, rows, runs, motion_file)


def simulated(found: Design, runs: int, seed: int) -> dict[str, Experiment]:
    """Experiments with motions I-IV and with the designed one; empty for no runs."""
    from ident.design import simulate

    references = {"calibration": found.calibration.reference, "designed": found.motion}
    checks = {}
    for number, (name, reference) in enumerate(references.items() if runs else ()):
        with console.progress(f"simulated experiments, {name}", runs) as show:
            checks[name] = simulate(
                reference, found.model, found.seconds, runs, seed + number, None, show
            )
    return checks


def compared(found: Design, checks: dict[str, Experiment]) -> dict[str, dict]:
    """Half widths of 95 % intervals by quantity: expected, and from the scatter of experiments."""
    from ident.design import quantities

    expected, paper = found.expected(), found.expected_calibration()
    scatter = {name: check.scatter() for name, check in checks.items()}
    rows = {}
    for name, quantity in quantities(found.model).items():
        rows[name] = {
            "unit": quantity.unit,
            "calibration": paper[name],
            "designed": expected[name],
            "ratio": expected[name] / paper[name],
        }
        if scatter:
            a, b = scatter["calibration"][name], scatter["designed"][name]
            rows[name] |= {"simulated_calibration": a, "simulated_designed": b}
            rows[name] |= {"simulated_ratio": b / a}
    return rows


def used(found: Design) -> dict[str, float]:
    """Largest share of each limit that the designed motion uses."""
    return found.limits.shares(found.candidates[0].use)


def frequencies(found: Design) -> dict[str, float]:
    """Base frequency of each of the motions I-IV, rad/s."""
    from ident.sequential import CALIBRATION

    return dict(zip(CALIBRATION, found.calibration.frequencies, strict=True))


def report(found: Design, rows: dict[str, dict], runs: int, path: Path) -> None:
    """Print the comparison, how the limits are used, and what to do next."""
    from youbot_env.parameters import UNITS

    heads = ["95 %: +-", "unit", "I-IV", "designed", "ratio"]
    keys = ["unit", "calibration", "designed", "ratio"]
    if runs:
        heads += ["I-IV sim.", "designed sim.", "ratio sim."]
        keys += ["simulated_calibration", "simulated_designed", "simulated_ratio"]
    names = [*UNITS, "x1+x3", "x2+x3", *([found.target] if found.target in rows else [])]
    shown = [(name, *(rows[name][key] for key in keys)) for name in dict.fromkeys(names)]
    console.table("", heads, shown)
    shares = [f"{name.replace('_', ' ')} {100 * v:.0f} %" for name, v in used(found).items()]
    best = [f"{motion} {w:.2f}" for motion, w in frequencies(found).items()]
    sines = found.motion.harmonics[0]
    lines = [
        f"designed: {sines} sines an axis, period {found.motion.period:.3g} s, starts from rest",
        f"  of the limits it uses: {', '.join(shares)}",
        f"I-IV: the best of {found.calibration.searched} combinations of base frequencies, rad/s: "
        f"{', '.join(best)}",
    ]
    if runs:
        known = 100 / math.sqrt(2 * runs)
        lines.append(f"sim.: scatter of {runs} simulated experiments each, good to {known:.0f} %")
    place = console.shown(path)
    lines.append(f"{place}: drive it by youbot record --motion {place}")
    for line in lines:
        console.out.print(line, soft_wrap=True)


def start() -> None:
    """Run the command line."""
    console.run(design, "--for m0 --seconds 60 --speed 0.3 --out motions/m0.yaml")
