"""Drive a plant through a motion and write the log."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.names import HOLDS, MOTIONS

if TYPE_CHECKING:
    from youbot_env.model import Model
    from youbot_env.references import Reference

PLANTS = ("analytic", "rollers")
MOST_ROWS = 1_000_000
RATES = (5.0, 1000.0)  # Hz
LOOP_RATES = (25.0, 10_000.0)  # Hz; below it the wheel-speed loops of the youBot go unstable
FASTEST = 3.0  # m/s; the youBot's driver stops at 0.8
HARMONICS = 5  # times the base frequency, the fastest sine of any motion
# The sensors resolve 1e-3 of everything; a log without noise is for comparing equations.
NOISY_DECIMALS, EXACT_DECIMALS = 4, 9
SATURATED = 0.2  # share of samples at the torque limit from which a log is hard to use


def record(
    plant: Annotated[
        str, typer.Option(help="analytic (the equations) or rollers (MuJoCo, real rollers).")
    ] = "analytic",
    model: Annotated[str, typer.Option(help="True robot: model file, nominal or paper.")] = "paper",
    effect: effect_options.Effects = None,
    effects: effect_options.EffectsFile = None,
    motion: Annotated[
        str, typer.Option(help=f"One of {', '.join(MOTIONS)}, or a file.")
    ] = "calibration",
    speed: Annotated[
        float | None, typer.Option(help="Peak speed of the centre, m/s; the motion's own if left.")
    ] = None,
    frequency: Annotated[
        float | None, typer.Option(help="Base frequency, rad/s; the motion's own if left.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="Length of the log, s.")] = 112.0,
    rate: Annotated[float, typer.Option(help="Rows a second, Hz.")] = 100.0,
    loop_rate: Annotated[
        float, typer.Option(help="Rate of the wheel-speed loops, Hz; a row takes whole loop steps.")
    ] = 1000.0,
    hold: Annotated[
        str,
        typer.Option(
            help="A row's torque: sampled (the command at its time), averaged (mean since the row "
            "before) or held (the loops run at the log's rate, --loop-rate is not used)."
        ),
    ] = "sampled",
    declare: Annotated[
        bool, typer.Option("--declare", help="Say in the log what a row's torque is.")
    ] = False,
    noise: Annotated[bool, typer.Option(help="Noise and resolution of the sensors.")] = True,
    floor_friction: Annotated[
        float | None, typer.Option(help="Friction coefficient of the floor (rollers): 0.8 if left.")
    ] = None,
    seed: console.Seed = 0,
    log: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="The log, CSV: runs/log.csv if left.")
    ] = Path("runs/log.csv"),
    hide: Annotated[
        bool, typer.Option("--hide", help="Keep effects and parameters out of log and JSON.")
    ] = False,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true model, effects included.")
    ] = None,
    json_file: console.Json = None,
    force: console.Force = False,
) -> None:
    """Drive a plant through a motion and write the log.

    The wheels' speed loops follow the motion; effects act and the log does not show them.
    """
    from youbot_env.measurement import instruments
    from youbot_env.model_file import load_model, model_to_dict, save_model
    from youbot_env.recording import record_motion, write_table
    from youbot_env.simulation import Sensors, WheelLoop

    check_numbers(rate, seconds, speed, frequency)
    loops = check_loops(hold, rate, loop_rate)
    options = {
        "plant": plant, "model": console.shown(model), "motion": motion, "speed": speed,
        "frequency": frequency, "seconds": seconds, "rate": rate, "loop_rate": loops, "hold": hold,
        "floor_friction": floor_friction, "seed": seed,
    }  # fmt: skip
    command = canonical_command(options, effect, effects, noise, hide, declare)
    console.check_results(log, truth, json_file, force=force, command=command)
    if log.suffix.lower() != ".csv":
        raise ValueError(f"--out {log}: logs are written as CSV; end the name in .csv")
    effect_options.load_effects(effects)
    robot = load_model(model)
    robot = robot.with_effects(effect_options.parse_effects(effect), name=log.stem)
    if any(active.identifier == "drive_hold" for active in robot.effects):
        raise ValueError("--effect drive_hold: what a row's torque is says --hold")
    # Effects of the link ``sensor`` belong to the record, the others to the robot.
    kept = tuple(active for active in robot.effects if active.effect.link != "sensor")
    spoil = instruments(robot.effects, robot.platform)
    sensors, loop = Sensors() if noise else None, WheelLoop()
    driven = make_plant(plant, replace(robot, effects=kept), 1 / rate, floor_friction)
    reference = choose_motion(motion, robot, seconds, speed, frequency)
    with console.progress(f"{plant} plant, motion {motion}", seconds, "s") as show:
        columns = record_motion(
            driven, reference, seconds, loop, sensors, seed, show, loops,
            "sampled" if loops is None else hold, spoil,
        )  # fmt: skip

    declared = [f"recording: drive_hold={hold}"] if declare else []
    decimals = NOISY_DECIMALS if noise else EXACT_DECIMALS
    write_table(
        log, columns, [command, *declared, *([] if hide else effect_lines(robot))], decimals
    )
    digest = sha256(log.read_bytes()).hexdigest()
    history = console.provenance(seed, {log.name: digest}, command)
    if truth is not None:
        save_model(replace(robot, provenance=history), truth)
    wheels = wheel_figures(columns, robot, loop.limit)
    result = {"log": console.shown(log), "samples": len(columns["time"]), **options, "noise": noise}
    result |= {"truth": None if hide else model_to_dict(robot), "wheels": wheels}
    console.write_json(json_file, result | {"provenance": history})
    report(log, columns, wheels)


def check_numbers(
    rate: float, seconds: float, speed: float | None, frequency: float | None
) -> None:
    """Refuse what no log should be made of.

    Raises:
        ValueError: names the option, its value and what to give instead.
    """
    if not RATES[0] <= rate <= RATES[1]:
        raise ValueError(f"--rate {rate:g} Hz: give {RATES[0]:g} to {RATES[1]:g} Hz")
    if not 2 / rate <= seconds <= MOST_ROWS / rate:
        raise ValueError(
            f"--seconds {seconds:g}: at {rate:g} Hz give {2 / rate:g} to {MOST_ROWS / rate:g} s"
        )
    if speed is not None and not 0 <= speed <= FASTEST:
        raise ValueError(f"--speed {speed:g} m/s: give 0 to {FASTEST:g} m/s")
    highest = math.pi * rate / HARMONICS
    if frequency is not None and not 0 < frequency <= highest:
        raise ValueError(
            f"--frequency {frequency:g} rad/s: at {rate:g} Hz give more than 0 and at most "
            f"{highest:.3g} rad/s"
        )


def check_loops(hold: str, rate: float, loop_rate: float) -> float | None:
    """Return the rate of the wheel-speed loops, Hz; None where they run at the log's.

    Raises:
        ValueError: names the option, its value and what to give instead.
    """
    if hold not in HOLDS:
        raise ValueError(f"--hold {hold}: choose one of {', '.join(HOLDS)}")
    if hold == "held":
        if rate < LOOP_RATES[0]:
            raise ValueError(
                f"--rate {rate:g} Hz with --hold held: the wheel-speed loops run at the log's rate "
                f"and go unstable below {LOOP_RATES[0]:g} Hz; give a higher --rate or --hold "
                "sampled"
            )
        return None
    if not LOOP_RATES[0] <= loop_rate <= LOOP_RATES[1]:
        raise ValueError(
            f"--loop-rate {loop_rate:g} Hz: give {LOOP_RATES[0]:g} to {LOOP_RATES[1]:g} Hz"
        )
    if rate > loop_rate:
        raise ValueError(
            f"--rate {rate:g} Hz is above --loop-rate {loop_rate:g} Hz; a log shows at most every "
            "step of its loops: lower --rate or raise --loop-rate"
        )
    return loop_rate


def make_plant(name: str, model: Model, dt: float, floor_friction: float | None):
    """The plant of that name with the true model."""
    from youbot_env.simulation import AnalyticPlant

    if name == "rollers":
        from youbot_env.rollers import RollersPlant

        friction = {} if floor_friction is None else {"floor_friction": floor_friction}
        try:
            return RollersPlant(model, dt, **friction)
        except ValueError as error:
            raise ValueError(f"--plant rollers at {1 / dt:g} Hz: {error}") from error
    if name != "analytic":
        raise ValueError(f"--plant {name}: choose one of {', '.join(PLANTS)}")
    if floor_friction is not None:
        raise ValueError(
            f"--floor-friction {floor_friction:g} belongs to --plant rollers; give the analytic "
            f"plant --effect wheel_slip={floor_friction:g}"
        )
    return AnalyticPlant(model, dt)


def choose_motion(
    name: str, model: Model, seconds: float, speed: float | None, frequency: float | None
) -> Reference:
    """The reference of that name; the calibration motions share the time of the log."""
    from youbot_env.references import make_reference
    from youbot_env.references.eased import EASE_IN

    options = {"speed": speed, "frequency": frequency}
    chosen = {key: value for key, value in options.items() if value is not None}
    if name == "calibration":
        # Each motion is eased in and out, so that it takes a quarter of the log with that.
        parts = seconds - 4 * EASE_IN
        chosen |= {"seconds": parts if parts > 0 else seconds, "platform": model.platform}
    elif name in ("I", "II"):
        chosen["platform"] = model.platform
    return make_reference(name, **chosen)


def canonical_command(
    options: dict,
    effects: list[str] | None,
    file: Path | None,
    noise: bool,
    hide: bool,
    declare: bool,
) -> str:
    """What makes the log the same again: all that shapes it, nothing about where it went."""
    words = console.called().split()
    for name, value in options.items():
        if value is not None:
            words += [
                f"--{name.replace('_', '-')}",
                f"{value:.15g}" if isinstance(value, float) else str(value),
            ]
    words += ["--noise" if noise else "--no-noise"]
    for effect in [] if hide else effects or []:
        words += ["--effect", effect]
    if file is not None and not hide:
        words += ["--effects", console.shown(file)]
    words += [flag for flag, given in (("--hide", hide), ("--declare", declare)) if given]
    return shlex.join(words)


def effect_lines(model: Model) -> list[str]:
    """Each effect of the true model in a line."""
    return [
        f"effect {active.identifier}: "
        + ", ".join(f"{name} = {value:g}" for name, value in active.values.items())
        for active in model.effects
    ]


def wheel_figures(columns: dict, model: Model, limit: float) -> dict[str, dict[str, float]]:
    """How fast each wheel turned, what torque it took, and how often that was at the limit."""
    import numpy as np

    from youbot_env.channels import channel_columns

    names, figures = channel_columns(model.platform), {}
    pairs = zip(names["wheel_velocity"], names["wheel_torque"], strict=True)
    for wheel, (velocity, torque) in zip(model.platform.wheel_names, pairs, strict=True):
        speed, moment = np.abs(columns[velocity]), np.abs(columns[torque])
        figures[wheel] = {
            "peak_velocity": float(speed.max()),
            "rms_torque": float(np.sqrt(np.mean(moment**2))),
            "peak_torque": float(moment.max()),
            "share_at_limit": float(np.mean(moment > 0.97 * limit)),
        }
    return figures


def report(path: Path, columns: dict, wheels: dict[str, dict[str, float]]) -> None:
    """Say what was recorded."""
    import numpy as np

    length = columns["time"][-1]
    reach = np.hypot(columns["reference_vx"], columns["reference_vy"]).max()
    heads = ("wheel", "peak speed rad/s", "rms torque N m", "peak torque N m", "at limit %")
    rows = [
        (name, f["peak_velocity"], f["rms_torque"], f["peak_torque"], 100 * f["share_at_limit"])
        for name, f in wheels.items()
    ]
    console.table("", heads, rows)
    saturated = max(f["share_at_limit"] for f in wheels.values())
    if saturated > SATURATED:
        console.err.print(
            f"warning: a wheel is at its torque limit in {saturated:.0%} of the samples; lower "
            "--speed or --frequency for a log to identify from",
            style="yellow",
            soft_wrap=True,
        )
    console.out.print(
        f"{path}: {len(columns['time'])} samples, {length:.4g} s, up to {reach:.3g} m/s commanded",
        soft_wrap=True,
    )


def start() -> None:
    """Run the command line."""
    console.run(record, "--plant rollers --effect torque_offset=0.1 --out runs/offset.csv")
