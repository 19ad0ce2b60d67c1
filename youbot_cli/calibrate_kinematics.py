"""Calibrate wheel radii, base, roller angle and the mount of the pose sensor from logs."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console
from youbot_cli.log_options import (
    SEVERAL,
    LogOptions,
    Logs,
    Tests,
    digests,
    or_bundled,
    reads_logs,
    used_model,
)

if TYPE_CHECKING:
    from ident.kinematics import Drift, KinematicCalibration
    from ident.log import Log

# What a table shows in place of a unit that no one thinks in.
SHOWN = {"m": (1e3, "mm"), "rad": (180 / math.pi, "deg"), "s": (1e3, "ms"), "": (1.0, "")}
ODOMETRIES = {
    "before": "nominal",
    "after": "calibrated",
    "followed": "following each roller",
}
HEADS = ("", "value", "95 % interval", "unit")


@reads_logs
def main(
    logs: Logs = None,
    test: Tests = None,
    model: Annotated[
        str, typer.Option(help="Model with the wheel table: model file, nominal or paper.")
    ] = "nominal",
    finite_rollers: Annotated[
        bool | None,
        typer.Option(help="Take the ripple of finite rollers out first; where it is seen, if left"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write --model with the calibrated kinematics, YAML."),
    ] = None,
    json_file: console.Json = None,
    force: console.Force = False,
    *,
    options: LogOptions,
) -> None:
    """Calibrate wheel radii, base, roller angle and the mount of the pose sensor from logs.

    The pose must be measured independently of the wheels (motion capture, lidar). Several logs give
    one calibration; each may have a pose frame of its own. Nothing in it is random: equal logs give
    equal results.
    """
    from ident.kinematics import calibrate_kinematics
    from ident.report.findings import accepted, findings_json
    from youbot_env.model_file import load_model, save_model

    console.check_results(out, json_file, force=force)
    logs, test = or_bundled(logs, test)
    before = load_model(model)
    with console.progress("calibrating", 3, "steps") as show:
        measured, tests = options.read(before, logs, test)
        before = used_model(before, measured)
        show(2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # what is open is told below
            result = calibrate_kinematics(measured, test=tests, finite_rollers=finite_rollers)
        show(3)
    everything = [*measured, *tests]
    for name, reason in result.left_out.items():
        console.err.print(f"left out: {name}: {reason}", style="yellow", soft_wrap=True)
    used = [log for log in everything if log.name not in result.left_out]
    history = console.provenance(logs=digests(used))
    history.pop("seed")
    history |= accepted(everything)
    if out is not None:
        calibrated = replace(result.model(before), name=out.stem, covariance=None)
        save_model(replace(calibrated, provenance=history), out)
    written = {"model": None if out is None else console.shown(out)}
    console.write_json(
        json_file,
        result.as_dict() | written | {"findings": findings_json(everything), "provenance": history},
    )
    tell(result, everything, out)


def tell(result: KinematicCalibration, logs: list[Log], out: Path | None) -> None:
    """Say what was found: the numbers, what they are worth, and what they leave open."""
    from ident.report.findings import finding_lines

    console.table("Motion over what nominal odometry says", HEADS, rows(result.gains))
    console.out.print()
    title = "Kinematics, beyond finite rollers" if result.finite_rollers else "Kinematics"
    console.table(title, HEADS, rows(result.parameters))
    console.out.print()
    console.table("Pose sensor", HEADS, rows(result.mount))
    console.out.print()
    heads = ("odometry", "mm per m", "deg per turn", "mm", "deg", "way m", "turns")
    for record, prefix in ((result.log, ""), (result.test, "test_")):
        if record is not None:
            drifts = {words: result.drifts[prefix + name] for name, words in ODOMETRIES.items()}
            found = [(words, *drift_row(d)) for words, d in drifts.items() if d is not None]
            console.table(f"Drift on {record}: in windows, then at the end", heads, found)
            console.out.print()
    console.section("Undetermined", list(result.undetermined))
    console.section("Remarks", list(result.remarks))
    console.section("Log doctor", finding_lines(logs))
    if out is not None:
        text = "its masses and frictions belong to the old radius, identify them again with it"
        console.out.print(f"model: {console.shown(out)}; {text}", soft_wrap=True)


def rows(table: dict) -> list[tuple]:
    """Rows of a table of quantities in the units that people read."""
    shown = []
    for name, quantity in table.items():
        factor, unit = SHOWN[quantity.unit]
        interval = "not determined"
        if quantity.ci95 is not None:
            low, high = (factor * end for end in quantity.ci95)
            interval = f"[{low:.5g}, {high:.5g}]"
        shown.append((name.replace("_", " "), f"{factor * quantity.value:.5g}", interval, unit))
    return shown


def drift_row(drift: Drift) -> tuple:
    """Drift on windows, then at the end of the whole record."""
    degrees = 180 / math.pi
    turn = drift.heading_per_turn
    return (
        1e3 * drift.position_per_metre,
        "-" if turn is None else degrees * turn,
        1e3 * drift.position,
        degrees * drift.heading,
        drift.way,
        drift.turns,
    )


def start() -> None:
    """Run the command line."""
    console.run(main, "mine.csv --test other.csv --out calibrated.yaml", SEVERAL)
