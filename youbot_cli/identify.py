"""Identify the parameters of a platform from measured logs."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
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

if TYPE_CHECKING:
    from ident.log import Log
    from ident.report.outcome import Outcome
    from ident.sequential import MotionIdentification
    from youbot_env.model import Model


@reads_logs
def main(
    logs: Logs = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
    add: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[=VALUE]",
            help="Estimate an effect of docs/effects.md too, from VALUE on; may be repeated.",
        ),
    ] = None,
    effects: effect_options.EffectsFile = None,
    test: Tests = None,
    method: Annotated[
        str,
        typer.Option(
            help="auto (of voltages what predicts data kept out best), ls (least squares), iv "
            "(instruments) or free-run."
        ),
    ] = "auto",
    out: Annotated[Path, typer.Option(metavar="FILE", help="The identified model, YAML.")] = Path(
        "models/identified.yaml"
    ),
    posterior: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            max=1_000_000,
            help="Draw N robots from the result and write their parameters.",
        ),
    ] = 0,
    by_motion: Annotated[
        bool,
        typer.Option(
            "--by-motion",
            help="Also identify motion by motion, as the paper does: the first log holds the "
            "motions I, III, II, IV, a quarter of the time each.",
        ),
    ] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the HTML page and its figures.")
    ] = None,
    json_file: console.Json = None,
    force: console.Force = False,
    seed: console.Seed = 0,
    *,
    options: LogOptions,
) -> None:
    """Identify the parameters of a platform from measured logs.

    Only --posterior is random: equal logs give equal estimates.
    """
    from ident.disagreement import with_disagreements
    from ident.identification import identify
    from ident.report.findings import accepted, findings_json
    from ident.report.identify import identification_page
    from ident.report.outcome import Outcome
    from ident.sequential import cut_calibration, identify_by_motion
    from youbot_env.model_file import load_model, save_model

    page_file = None if report is None else report / "index.html"
    draws_file = out.with_suffix(".posterior.csv") if posterior else None
    console.check_results(out, json_file, page_file, draws_file, force=force)
    logs, test = or_bundled(logs, test)
    effect_options.load_effects(effects)
    before = load_model(model)
    added = effect_options.parse_effects(add)
    with console.progress("identifying", 4, "steps") as show:
        measured, tests = options.read(before, logs, test)
        held_out, before = one_or_all(tests), used_model(before, measured)
        show(1)
        result = identify(measured, before, added, held_out, method, name=out.stem)
        decomposed = None
        if by_motion:
            decomposed = identify_by_motion(cut_calibration(measured[0]), result.prior)
        tests = with_disagreements(tests, result.differs)
        show(2)
        outcome = Outcome.of(result, before)
        show(3)
        history = console.provenance(logs=digests(measured))
        history = {key: value for key, value in history.items() if key != "seed"}
        history |= {"method": result.method, "start": before.name}
        if result.choice is not None:
            history["method_chosen"] = str(result.choice)
        if tests:
            history["test_log"] = digests(tests)
        history |= accepted([*measured, *tests])
        page = None
        if report is not None:
            told = console.in_words(history)
            page = identification_page(outcome, told, [*measured, *tests])
        show(4)
    usable = not outcome.problems
    if usable:
        save_model(replace(result.model, provenance=history), out)
        if draws_file is not None:
            write_posterior(result.model, posterior, seed, draws_file)
    written = {"model": console.shown(out) if usable else None}
    content = result.as_dict() | outcome.as_dict() | written
    content["findings"] = findings_json([*measured, *tests])
    if decomposed is not None:
        content["by_motion"] = asdict(decomposed)
    console.write_json(json_file, content | {"provenance": history})
    address = None if page is None else page.write(report)
    tell(outcome, [*measured, *tests], out if usable else None, address)
    if decomposed is not None:
        tell_by_motion(decomposed)
    if not usable:
        raise console.CheckFailed(
            f"{out} is not written, the identified model cannot be used: "
            + "; ".join(outcome.problems)
        )


def tell_by_motion(found: MotionIdentification) -> None:
    """Show each parameter from the motion that sees it best beside the joint fit."""
    rows = [
        (name, source or "none", f"{value:.4g} +- {error:.2g}", f"{joint:.4g} +- {spread:.2g}")
        for name, source, value, error, joint, spread in zip(
            found.names, found.source, found.decomposed, found.decomposed_errors,
            found.joint, found.joint_errors, strict=True,
        )
    ]  # fmt: skip
    console.out.print()
    head = ("", "motion", "from its motion", "joint fit")
    console.table("Motion by motion, value +- standard error, kg m^2 and N m s", head, rows)


def origin(row: tuple[str, ...]) -> str:
    """Where the value in a row of ``parameter_rows`` comes from.

    One that moved and has no interval is known in a combination with others alone.
    """
    from ident.results import AT_BOUND, UNSEEN

    if row[5] == UNSEEN:
        return "prior" if row[1] == row[2] else "in part"
    return "bound" if row[5] == AT_BOUND else "fit"


def write_posterior(model: Model, count: int, seed: int, path: Path) -> None:
    """Write robots drawn from the identified covariance, one a row, as environments draw them."""
    import numpy as np

    from youbot_env.envs.randomization import Posterior
    from youbot_env.model_file import write_atomically

    rng = np.random.default_rng(seed)
    drawn = np.array([Posterior().draw(model, rng).values() for _ in range(count)])
    lines = [",".join(model.names())]
    lines += [",".join(f"{value:.6g}" for value in row) for row in drawn]
    write_atomically(path, "\n".join(lines) + "\n")
    console.out.print(f"posterior: {console.shown(path)}, {count} robots")


def tell(outcome: Outcome, logs: list[Log], model: Path | None, page: Path | None) -> None:
    """Say what was found: the verdict, then what it rests on."""
    from ident.recording_words import in_words
    from ident.report.findings import finding_lines
    from ident.report.outcome import (
        agreement,
        agreement_note,
        effect_rows,
        error_rows,
        lump_rows,
        parameter_rows,
    )

    result = outcome.result
    console.out.print(outcome.verdict, style="bold", soft_wrap=True)
    console.section("How the logs were recorded", in_words(result.recording))
    heads = ("", outcome.label, "identified", "95 % interval", "unit")
    rows = [(*row[:5], origin(row), row[6]) for row in parameter_rows(outcome)]
    console.out.print()
    console.table(f"Parameters, by {result.method}", (*heads, "source", "doubt"), rows)
    if result.choice is not None:
        console.section("Method", [f"chosen: {result.choice}"])
    if result.effects:
        console.out.print()
        console.table("Effects", heads, [row[:5] for row in effect_rows(outcome)])
    console.section("Doubts", [f"({k}) {doubt}" for k, doubt in enumerate(outcome.doubts, 1)])
    console.out.print()
    console.table("Known better than the single inertias", heads, lump_rows(outcome))
    console.out.print()
    head, rows = agreement(outcome)
    console.table("Estimators", head, rows)
    console.out.print(agreement_note(result), soft_wrap=True)
    console.out.print()
    head = ("axis", "unit", "rms", f"error, {outcome.label}", "error, identified")
    console.table(f"Free run on {outcome.judged_on}", head, error_rows(outcome))
    seen = result.observability
    words = f"\n{seen.rank} of {len(seen.names)} parameter directions seen"
    if math.isfinite(seen.condition):
        words += f", condition number {seen.condition:.3g}"
    console.out.print(words)
    console.section("Practically unidentifiable from these logs", seen.words)
    console.section("Structurally unidentifiable from logs of this kind", result.invisible)
    console.section("Log doctor", finding_lines(logs))
    console.section("Next", next_steps(outcome, logs, model))
    console.out.print()
    if model is not None:
        console.out.print(f"model: {model}", soft_wrap=True)
    hint = "add --report DIR for the page with the figures" if page is None else f"page: {page}"
    console.out.print(hint, soft_wrap=True)


def next_steps(outcome: Outcome, logs: list[Log], model: Path | None) -> list[str]:
    """What to do with the result: judge it, look for what it lacks, use it."""
    from ident.report.outcome import percent

    result, named = outcome.result, [name_of(log) for log in logs]
    fitted, tests = named[: len(result.names)], named[len(result.names) :]
    found = []
    if not outcome.held_out:
        found.append("give a log of another motion with --test to judge by")
    error = outcome.after_run.nrmse
    if outcome.forces is None and error > outcome.floor:
        behind = " ".join([*fitted, *(["--test"] if tests else []), *tests])
        found.append(
            f"youbot improve {behind}: looks for what is missing (free-run error {percent(error)} "
            f"where noise and rolling leave {percent(outcome.floor)})"
        )
    if model is not None:
        judged = " ".join(tests or fitted)
        found.append(f"youbot compare {judged} --model {outcome.label} {console.shown(model)}")
    return found


def name_of(log: Log) -> str:
    """A log as commands are given it: a bundled one by its name."""
    from ident.log import BUNDLED

    bundled = BUNDLED.find(log.name) is not None and Path(log.source).stem == log.name
    return log.name if bundled else log.source or log.name


def start() -> None:
    """Run the command line."""
    console.run(main, "mine.csv --test other.csv --out mine.yaml --report report", SEVERAL)
