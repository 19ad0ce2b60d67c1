"""Improve a model until it explains a robot: compare, diagnose, add, refit, and show the gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.log_options import (
    SEVERAL,
    LogOptions,
    Logs,
    Tests,
    digests,
    one_or_all,
    or_bundled,
    reads_logs,
    used_model,
)
from youbot_cli.pieces import Pieces, digest, place

if TYPE_CHECKING:
    from ident.improvement import Improvement
    from ident.log import Log
    from youbot_env.model import Model

# What the controllers are tried on: a figure of eight beyond the 0.5 rad/s of the paper.
TRIED = ("eight", 1.0, 0.3, 6.0)  # arguments of ``Motion``
BAR = 20  # cells


@dataclass(frozen=True)
class Tracking:
    """Errors of computed torque with two models, on a simulated robot that is the final one.

    Attributes:
        base, final: rms distance to the reference, m.
        reference, frequency, speed: what was followed, rad/s and m/s.
    """

    base: float
    final: float
    reference: str
    frequency: float
    speed: float

    def __str__(self) -> str:
        return (
            f"Computed torque along an {self.reference} at {self.frequency:g} rad/s and up to "
            f"{self.speed:g} m/s: {1000 * self.base:.2f} mm off with the base model, "
            f"{1000 * self.final:.2f} mm with the final one. This is a simulation in which the "
            "final model is the robot; the real one will differ by what is still unexplained."
        )


@reads_logs
def main(
    logs: Logs = None,
    test: Tests = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
    out: Annotated[Path, typer.Option(metavar="FILE", help="The final model, YAML.")] = Path(
        "runs/improved.yaml"
    ),
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the HTML page and its figures.")
    ] = None,
    effects: effect_options.EffectsFile = None,
    seed: console.Seed = 0,
    json_file: console.Json = None,
    force: console.Force = False,
    *,
    options: LogOptions,
) -> None:
    """Add what a model is missing until nothing is, and write the final model.

    Every fit is kept in the folder of --report, else beside --json or --out, until all is done: a
    run that was stopped goes on from there when it is called again, with the same result.
    """
    from ident.disagreement import with_disagreements
    from ident.improvement import improve
    from ident.kept import fingerprint, keeping
    from ident.report.findings import accepted, findings_json
    from ident.report.improve import improvement_page
    from youbot_env.model_file import load_model, save_model

    effect_options.load_effects(effects)
    page_file = None if report is None else report / "index.html"
    console.check_results(out, json_file, page_file, force=force)
    logs, test = or_bundled(logs, test)
    start = load_model(model)
    records, tests = options.read(start, logs, test)
    everything, held = (*records, *tests), one_or_all(tests)
    start = used_model(start, records)
    history = console.provenance(seed, digests(everything)) | accepted(everything)
    settings = {"logs": [log.digest for log in records], "tests": [log.digest for log in tests]}
    settings |= {"model": fingerprint(start), "effects": digest([effects]), "seed": seed}
    settings["options"] = {field.name: getattr(options, field.name) for field in fields(options)}
    pieces = Pieces(place("improve", report, json_file or out), settings)
    with pieces, keeping(pieces):
        with console.stages("reading") as say:
            done = improve(records, start, held, seed, say, out.stem)
            everything = (*records, *with_disagreements(tests, done.found.differs))
            usable = bool(done.stages) and not done.problems
            tracking = None
            if usable and len(done.stages) > 1:
                say("trying the controllers")
                tracking = tried(done.stages[0].model, done.model, records, seed)
            gains = [
                *([str(tracking)] if tracking else []),
                *(uses(out, records) if usable else []),
            ]
            say("drawing")
            page = None
            if report is not None:
                page = improvement_page(done, gains, console.in_words(history), everything)
        if usable:
            made = {"method": "diagnosis and free-run refinement", "start": start.name}
            save_model(replace(done.model, provenance=history | made), out)
        result = done.as_dict() | {
            "model": console.shown(out) if usable else None,
            "tracking": asdict(tracking) if tracking else None,
            "findings": findings_json(everything),
            "provenance": history,
        }
        console.write_json(json_file, result)
        address = None if page is None else page.write(report)
    tell(done, everything, gains, out if usable else None, address)
    if done.problems:
        raise console.CheckFailed(f"{out} is not written: {'; '.join(done.problems)}")
    if done.found.verdict == "cannot_say":
        kept = "holds the refitted base" if usable else "is not written"
        raise console.CheckFailed(f"nothing was added, {out} {kept}: {done.found.reason}")


def tried(base: Model, final: Model, logs: list[Log], seed: int) -> Tracking:
    """Drive a robot like the final model with a controller that believes the base or the final.

    Commands may be as large as they were in the logs, or as the controller's own limit.
    """
    from controllers import make
    from controllers.evaluation.motions import Motion
    from controllers.evaluation.run import drive, make_env, measure
    from controllers.evaluation.subjects import Subject

    tried_on = Motion(*TRIED)
    robot, largest, errors = Subject("analytic", 0, final, seed), largest_command(logs), []
    for believed in (base, final):
        controller = make("computed_torque", believed)
        limit = max(controller.settings.torque_limit, largest)
        controller = make("computed_torque", believed, torque_limit=limit)
        env = make_env(robot, controller)
        trace = drive(controller, env, tried_on, seed)
        env.close()
        errors.append(measure(trace, controller.settings.dt, limit, tried_on.speed)["position"])
    return Tracking(*errors, tried_on.name, tried_on.frequency, tried_on.speed)


def largest_command(logs: list[Log]) -> float:
    """Largest drive input in the logs, N m or V."""
    import numpy as np

    return max(float(np.abs(log.command).max()) for log in logs)


def uses(out: Path, logs: list[Log]) -> list[str]:
    """Lines that put the model to use."""
    path, limit = console.shown(out), ""
    if logs[0].drive == "voltage":
        # Torques of the environment are then volts.
        limit = f", torque_limit={largest_command(logs):.3g}"
    return [
        f'gym.make("YouBot-v0", model="{path}"{limit})',
        f'controllers.make("computed_torque", model="{path}"{limit})',
        f"youbot compare LOG --model nominal {path}",
    ]


def bar(share: float) -> str:
    """A bar of characters, of plain ones where the terminal has no others."""
    full, rest = console.drawable("\u2588\u00b7", "#.")
    count = max(1, round(BAR * share))
    return full * count + rest * (BAR - count)


def tell(
    done: Improvement,
    logs: Sequence[Log],
    gains: list[str],
    out: Path | None,
    page: Path | None,
) -> None:
    """Say what was added, how the error fell, and what to do with the model."""
    from ident.recording_words import in_words
    from ident.report.diagnose import UNTRIED, experiment_lines, untried_lines
    from ident.report.findings import finding_lines
    from ident.report.improve import (
        ERRORS_HEAD,
        base_head,
        base_note,
        base_rows,
        error_rows,
        verdict,
    )

    found = done.found
    console.out.print(verdict(done), style="bold", soft_wrap=True)
    console.section("How the logs were recorded", in_words(found.recording))
    if done.stages:
        errors = [*(stage.nrmse for stage in done.stages), found.errors.floor]
        rows = [
            (*row, bar(error / max(errors)))
            for row, error in zip(error_rows(done), errors, strict=True)
        ]
        console.out.print()
        what = found.errors.what.capitalize()
        title = f"{what} on {found.errors.windows} held-out windows, rms"
        console.table(title, (*ERRORS_HEAD, ""), rows)
        console.out.print()
        console.table(
            "Base parameters and identifiable combinations", base_head(done), base_rows(done)
        )
        if base_note(done):
            console.out.print(base_note(done), soft_wrap=True)
        sizes = [
            (f"{active.identifier}.{flat}", f"{value:.4g}", active.effect.parameter_of(flat).unit)
            for active in done.stages[-1].model.effects
            for flat, value in active.values.items()
        ]
        if sizes:
            console.out.print()
            console.table("Effects in the final model", ("", "value", "unit"), sizes)
    console.section("Effects that these logs do not tell apart", [
        " or ".join(step.group) for step in found.named if len(step.group) > 1
    ])  # fmt: skip
    console.section("What the rest depends on", [f"{s}, {100 * g:.0f} % of the squared error"
            for s, g in found.depends_on])  # fmt: skip
    console.section(UNTRIED, untried_lines(found))
    console.section("What to record next", experiment_lines(found))
    console.section("What the controllers gain", gains)
    console.section("Log doctor", finding_lines(logs))
    console.out.print()
    if out is not None:
        console.out.print(f"model: {out}", soft_wrap=True)
    hint = "add --report DIR for the page with the figures" if page is None else f"page: {page}"
    console.out.print(hint, soft_wrap=True)


def start() -> None:
    """Run the command line."""
    console.run(main, "mine.csv --test other.csv --out mine.yaml --report report/improve", SEVERAL)
