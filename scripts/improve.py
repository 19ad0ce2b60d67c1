"""Improve a model until it explains a robot: compare, diagnose, add, refit, and show the gain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import console
import typer
from identify import read_log, refuse_double

from controllers import make
from controllers.evaluation.motions import Motion
from controllers.evaluation.run import drive, make_env, measure
from controllers.evaluation.subjects import Subject
from ident.improvement import Improvement, improve
from ident.log import Log
from youbot_env.model import Model
from youbot_env.model_file import load_model, save_model

LOGS = console.ROOT / "logs"
# What the controllers are tried on: a figure of eight beyond the paper's 0.5 rad/s.
TRIED = Motion("eight", 1.0, 0.3, 6.0)


def main(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[LOG]...", help="Logs to fit; the bundled one if left."),
    ] = None,
    test: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Another record of the robot; its last part is not looked at before the end.",
        ),
    ] = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
    out: Annotated[Path, typer.Option(metavar="FILE", help="The final model, YAML.")] = Path(
        "runs/improved.yaml"
    ),
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the HTML page and its figures.")
    ] = None,
    seed: console.Seed = 0,
    json_file: console.Json = None,
) -> None:
    """Add what a model is missing until nothing is, and write the final model."""
    page_file = None if report is None else report / "index.html"
    console.check_writable(out, json_file, page_file)
    if not logs:
        logs, test = [LOGS / "youbot_fit.csv"], test or LOGS / "youbot_test.csv"
    start = load_model(model)
    paths = [*logs, *([test] if test else [])]
    records = [read_log(path, start.platform, {}, None, None) for path in paths]
    refuse_double(records)
    held = records.pop() if test else None
    with console.err.status("reading") as status:
        done = improve(records, start, held, seed, status.update, out.stem)
    found = done.found
    console.out.print(f"{found.verdict.replace('_', ' ')}: {found.reason}", style="bold")
    everything = [*records, *([held] if held else [])]
    history = console.provenance(seed, {log.source: log.digest for log in everything})
    if not done.stages:
        console.write_json(json_file, done.as_dict() | {"provenance": history})
        raise console.CheckFailed(f"record more: {found.experiment.command}")
    show_errors(done)
    show_base(done, records[0])
    if found.experiment is not None and found.verdict != "cannot_say":
        e = found.experiment
        console.out.print(
            f"\nto tell {' from '.join(e.separates)}: {e.command}, odds {e.odds:.3g} to 1",
            soft_wrap=True,
        )
    problems = done.model.parameters.problems(done.model.platform)
    tracking = None
    if problems:
        console.out.print(
            "\nno model file for the environments: " + "; ".join(problems), soft_wrap=True
        )
    else:
        save_model(replace(done.model, provenance=history), out)
        console.out.print(f"\nmodel: {console.shown(out)}", soft_wrap=True)
        if records[0].drive == "torque" and len(done.stages) > 1:
            tracking = controllers_gain(done, seed)
        show_use(out)
    console.write_json(json_file, done.as_dict() | {"tracking": tracking, "provenance": history})
    if report is not None:
        from ident.report.diagnose import diagnosis_page

        used = {key: str(value) for key, value in history.items() if isinstance(value, str)}
        console.out.print(f"page: {console.shown(diagnosis_page(found, used).write(report))}")
    if found.verdict == "cannot_say":
        raise console.CheckFailed("nothing was added; see the reason above")


def show_errors(done: Improvement) -> None:
    """The error on untouched windows, falling step by step."""
    rows = [
        (stage.added, *(f"{value:.3g}" for value in stage.axes), f"{100 * stage.nrmse:.3g}",
         f"{100 * stage.covered:.0f}")
        for stage in done.stages
    ]  # fmt: skip
    rows.append(("noise of the sensors", "", "", "", f"{100 * done.found.errors.floor:.3g}", "100"))
    heads = ("with", "vx m/s", "vy m/s", "yaw rate rad/s", "free run %", "way to noise %")
    console.table("\nFree-run error on windows that nothing was fitted to", heads, rows)


def show_base(done: Improvement, log: Log) -> None:
    """What each addition did to the base parameters."""
    heads = ("", *(stage.added for stage in done.stages), "unit", "shift in s.e.")
    rows = [
        (name, *(f"{value:.4g}" for value in values), unit, f"{shift:+.1f}")
        for name, unit, values, shift in done.shifts()
    ]
    console.table("\nBase parameters", heads, rows)
    if log.drive == "voltage":
        console.out.print(
            "The drive was logged in volts: masses, inertias and frictions are in units of V per "
            "N m of the drive.",
            soft_wrap=True,
        )


def controllers_gain(done: Improvement, seed: int) -> dict[str, float]:
    """Tracking error with the base and with the final model, on a robot like the final model."""
    robot = Subject("analytic", 0, done.model, seed)

    def tracked(believed: Model) -> float:
        controller = make("computed_torque", believed)
        env = make_env(robot, controller)
        trace = drive(controller, env, TRIED, seed)
        env.close()
        limit, dt = controller.settings.torque_limit, controller.settings.dt
        return measure(trace, dt, limit, TRIED.speed)["position"]

    base = replace(done.stages[0].model, covariance=None)
    before, after = tracked(base), tracked(replace(done.model, covariance=None))
    console.out.print(
        f"tracking error of computed torque, simulated with the final model as the robot: "
        f"{1000 * before:.2f} mm with the base model, {1000 * after:.2f} mm with the final one",
        soft_wrap=True,
    )
    return {"base_m": before, "final_m": after, "reference": TRIED.name,
            "frequency": TRIED.frequency}  # fmt: skip


def show_use(out: Path) -> None:
    """How to go on."""
    path = console.shown(out)
    console.out.print(f'\n  gym.make("YouBot-v0", model="{path}")', soft_wrap=True)
    console.out.print(f'  controllers.make("computed_torque", model="{path}")', soft_wrap=True)
    console.out.print(f"  python scripts/compare.py LOG --model nominal {path}", soft_wrap=True)


if __name__ == "__main__":
    console.run(main, "logs/youbot_fit.csv --test logs/youbot_test.csv --out runs/improved.yaml")
