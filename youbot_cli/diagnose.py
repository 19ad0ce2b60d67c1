"""Name the physical effect that a model is missing."""

from __future__ import annotations

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
    from ident.diagnosis.diagnose import Diagnosis

SHOWN = 8


@reads_logs
def main(
    logs: Logs = None,
    test: Tests = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
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
    """Name the physical effect that a model is missing, or say that none is or one cannot say."""
    from ident.diagnosis.diagnose import diagnose
    from ident.disagreement import with_disagreements
    from ident.report.diagnose import diagnosis_page
    from ident.report.findings import accepted, finding_lines, findings_json
    from youbot_env.model_file import load_model

    page_file = None if report is None else report / "index.html"
    console.check_results(json_file, page_file, force=force)
    logs, test = or_bundled(logs, test)
    effect_options.load_effects(effects)
    start = load_model(model)
    records, tests = options.read(start, logs, test)
    everything, held = (*records, *tests), one_or_all(tests)
    start = used_model(start, records)
    with console.stages("reading") as tell:
        found = diagnose(records, start, held, seed, tell)
    everything = (*records, *with_disagreements(tests, found.differs))
    show(found)
    console.section("Log doctor", finding_lines(everything))
    history = console.provenance(seed, digests(everything)) | accepted(everything)
    result = found.as_dict() | {"findings": findings_json(everything), "provenance": history}
    console.write_json(json_file, result)
    if report is not None:
        page = diagnosis_page(found, console.in_words(history), everything)
        console.out.print(f"\npage: {page.write(report)}", soft_wrap=True)


def show(found: Diagnosis) -> None:
    """Print the verdict, sizes and what else was tried."""
    from ident.recording_words import in_words
    from ident.report.diagnose import UNTRIED, experiment_lines, untried_lines

    console.out.print(f"{found.verdict.replace('_', ' ')}: {found.reason}")
    console.section("How the logs were recorded", in_words(found.recording))
    console.out.print()
    rows = []
    for step in found.named:
        for name, q in step.sizes(found.model).items():
            span = "" if q.ci95 is None else "{:.3g} ... {:.3g}".format(*q.ci95)
            rows.append((step.best.identifier, name, q.value, span, q.unit))
    if rows:
        console.table("Sizes", ("effect", "parameter", "value", "95 % interval", "unit"), rows)
    tried = [
        (r.effect, f"{r.p:.3f}", f"{100 * r.gain:.1f}", f"{r.parameter}={r.size:.3g}", r.unit,
         "-" if r.smallest is None else f"{r.smallest:.3g}", f"{100 * r.power:.0f}")
        for r in found.minimum_detectable[:SHOWN]
    ]  # fmt: skip
    if tried:
        console.table(
            "\nOn top of the base model",
            (
                "effect",
                "p adjusted",
                "held-out reduction %",
                "size",
                "unit",
                "minimum detectable",
                "power %",
            ),
            tried,
        )
    console.section(UNTRIED, untried_lines(found))
    console.section("What to record next", experiment_lines(found))


def start() -> None:
    """Run the command line."""
    console.run(main, "youbot_fit --test youbot_test", SEVERAL)
