"""Compare models with a measured log: how large the error is, and where it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.log_options import SEVERAL, LogOptions, Logs, digests, one_or_all, reads_logs

if TYPE_CHECKING:
    from ident.comparison import Beside, Standing
    from ident.log import Log
    from youbot_env.model import Model

DEFAULT = ("nominal", "identified")
SHOWN = 10
MODEL_FILES = ("", ".yaml", ".yml")


@reads_logs
def main(
    logs: Logs = None,
    test: Annotated[
        list[str] | None,
        typer.Option(
            "--test",
            metavar="LOG ...",
            help="Logs to judge by; errors on the others, which models were fitted to, stand "
            "beside.",
        ),
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MODEL ...",
            help="Models: files, nominal or paper; nominal and identified if left: "
            "models/identified.yaml, or the bundled one where there is none.",
        ),
    ] = None,
    window: Annotated[
        float, typer.Option(min=0.1, max=3600, help="Length of the free runs, s.")
    ] = 5.0,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the HTML page and its figures.")
    ] = None,
    json_file: console.Json = None,
    force: console.Force = False,
    effects: effect_options.EffectsFile = None,
    seed: console.Seed = 0,
    *,
    options: LogOptions,
) -> None:
    """Compare models with measured logs: errors, where they gather, and when they are worst.

    Free run: velocities simulated from the measured drive input alone, in windows.  Equation: what
    the filtered equations of motion leave of the measured forces.
    """
    import numpy as np

    from ident.comparison import beside, compare, rank
    from ident.disagreement import with_disagreements
    from ident.log import BUNDLED
    from ident.report.compare import comparison_page
    from ident.report.findings import accepted, findings_json

    effect_options.load_effects(effects)
    page_file = None if report is None else report / "index.html"
    console.check_results(json_file, page_file, force=force)
    models = read_models(model or DEFAULT)
    given, tests = options.read(
        models[0], logs or ([] if test else [BUNDLED.folder / "youbot_test.csv"]), test or ()
    )
    records = tests or given
    models = options.used_models(models, records)
    steps = len(models) + (report is not None)
    with console.progress("comparing", steps, "steps") as show:
        standings = rank(compare(one_or_all(records), models, window, seed, show), seed)
        judging = standings[0].comparison.log
        fitted = beside(given, judging, models, window) if given and tests else None
        if fitted is not None:
            records = with_disagreements(tests, fitted.differs)
        everything = records if fitted is None else [*given, *records]
        history = console.provenance(seed, digests(everything)) | accepted(everything)
        # Where every simulation runs away there is nothing to draw.
        drawable = report is not None and bool(np.isfinite(standings[0].comparison.run.nrmse))
        page = (
            comparison_page(standings, console.in_words(history), records, fitted)
            if drawable
            else None
        )
        show(steps)
    result = {
        "log": " + ".join(record.name for record in records),
        "best": standings[0].comparison.model.name,
        "models": [s.comparison.as_dict() for s in in_order(standings, models)],
        "ranking": [standing.as_dict() for standing in standings],
        "window": window,
        "fitted": None if fitted is None else {"log": fitted.log, "nrmse": fitted.errors},
        "findings": findings_json(everything),
    }
    console.write_json(json_file, result | {"provenance": history})
    tell(standings, everything, fitted, None if page is None else page.write(report))


def read_models(words: tuple[str, ...] | list[str]) -> list[Model]:
    """Load models; two of one name are told apart by their folders.

    Raises:
        ValueError: a word that is no model file, or a model given twice.
    """
    from youbot_env.model_file import find_model, load_model

    files: list[Path] = []
    for word in words:
        if Path(word).suffix not in MODEL_FILES and Path(word).exists():
            raise ValueError(
                f"--model {console.shown(word)}: no model file; put a log before --model, as in "
                f"youbot compare {console.shown(word)} --model nominal"
            )
        files.append(find_model(word).resolve())
        if files[-1] in files[:-1]:
            raise ValueError(f"--model {console.shown(word)} is given twice; leave one out")
    models = [load_model(file) for file in files]
    names = [model.name for model in models]
    models = [
        replace(model, name=f"{file.parent.name}/{model.name}")
        if names.count(model.name) > 1
        else model
        for file, model in zip(files, models, strict=True)
    ]
    if len({model.name for model in models}) < len(models):
        raise ValueError(f"--model: several models are called {names[0]!r}; rename their files")
    return models


def in_order(standings: list[Standing], models: list[Model]) -> list[Standing]:
    """Standings in the order in which the models were given."""
    at = {model.name: k for k, model in enumerate(models)}
    return sorted(standings, key=lambda standing: at[standing.comparison.model.name])


def tell(
    standings: list[Standing], logs: list[Log], fitted: Beside | None, page: Path | None
) -> None:
    """Say what was found: the verdict, then errors, then where and when they are."""
    from ident.recording_words import in_words
    from ident.report.compare_words import (
        BESIDE,
        FREE_RUN_HEAD,
        WHERE_HEAD,
        beside_table,
        equation_head,
        equation_rows,
        failing,
        free_run_rows,
        harmonic_rows,
        note,
        stretch_rows,
        verdict,
        where_rows,
    )
    from ident.report.findings import finding_lines

    best = standings[0].comparison
    console.out.print(verdict(standings), style="bold", soft_wrap=True)
    console.out.print(failing(best), soft_wrap=True)
    console.section("How the log was recorded", in_words(best.recording))
    console.section("Note", [note(best.log)] if note(best.log) else [])
    console.out.print()
    rows = free_run_rows(standings)
    window = best.worst[0].end - best.worst[0].start
    console.table(
        f"Free run in windows of {window + best.log.dt:.3g} s, rms errors", FREE_RUN_HEAD[:8],
        [row[:8] for row in rows],
    )  # fmt: skip
    if len(rows) > 1:
        console.out.print()
        head = (FREE_RUN_HEAD[0], *FREE_RUN_HEAD[7:])
        console.table("Free run, all axes", head, [(row[0], *row[7:]) for row in rows])
    if fitted is not None:
        console.out.print()
        console.table(BESIDE, *beside_table(standings, fitted))
    console.out.print()
    console.table("Equation, rms errors", equation_head(best.force_units), equation_rows(standings))
    console.out.print()
    head = f"Where the equations of {best.model.name} fail most"
    # What is left out says by less than one line more; names must not wrap.
    columns = [WHERE_HEAD.index(name) for name in WHERE_HEAD if name != "excess"]
    rows = [[row[k] for k in columns] for row in where_rows(best.where, SHOWN)]
    console.table(head, [WHERE_HEAD[k] for k in columns], rows)
    sure = [harmonic for harmonic in best.ripple if harmonic.flagged]
    if sure:
        console.out.print()
        unit = best.force_units[2]
        head = ("wheel", f"amplitude {unit}", "95 % interval", "p adjusted", "significant")
        console.table("Repeats with the wheel's angle", head, harmonic_rows(best, len(sure)))
    console.out.print()
    head = ("stretch", "time s", "vx m/s", "vy m/s", "yaw rad/s", "error %", "of all error %")
    console.table(f"When the free run of {best.model.name} is worst", head, stretch_rows(best))
    console.section("Log doctor", finding_lines(logs))
    hint = "add --report DIR for the page with the figures" if page is None else f"page: {page}"
    console.out.print(f"\n{hint}", soft_wrap=True)


def start() -> None:
    """Run the command line."""
    console.run(
        main,
        "mine.csv --test other.csv --model nominal models/identified.yaml --report report/compare",
        several=("--model", *SEVERAL),
    )
