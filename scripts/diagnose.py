"""Name the physical effect that a model is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import console
import typer

from ident.diagnosis.verdict import diagnose, sizes
from ident.log import Log
from youbot_env.effects import effect_names
from youbot_env.model_file import load_model

LOGS = console.ROOT / "logs"


def main(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="Log to fit; the bundled one if left.")
    ] = None,
    test: Annotated[
        Path | None,
        typer.Option(metavar="LOG", help="Second log of the same robot, which decides."),
    ] = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
    json_file: console.Json = None,
) -> None:
    """Name the physical effect that a model is missing, or say that none is or one cannot say.

    Nothing in it is random.  First version: its rate of false alarms is not yet benchmarked.
    """
    console.check_writable(json_file)
    if log is None:
        log, test = LOGS / "youbot_fit.csv", test or LOGS / "youbot_test.csv"
    if test is None:
        raise ValueError("give a second log of the same robot with --test; it decides")
    start = load_model(model)
    for path in (log, test):
        if not path.exists():
            raise ValueError(f"no log {console.shown(path)!r}; check the name")
    records = [Log.load(path, start.platform) for path in (log, test)]
    if records[0].digest == records[1].digest:
        raise ValueError(f"{log} and {test} are the same record; the second must be another one")
    with console.progress("trying effects", len(effect_names()), "effects") as show:
        found = diagnose(*records, start, show)
    console.out.print(f"{found.verdict.replace('_', ' ')}: {found.reason}\n")
    rows = []
    for step in found.steps:
        for name, quantity in sizes(step.best).items():
            span = "" if quantity.ci95 is None else "{:.3g} ... {:.3g}".format(*quantity.ci95)
            rows.append((step.best.identifier, name, quantity.value, span, quantity.unit))
    if rows:
        console.table("Sizes", ("effect", "parameter", "value", "95 % interval", "unit"), rows)
    logs = {record.source: record.digest for record in records}
    console.write_json(json_file, found.as_dict() | {"provenance": console.provenance(None, logs)})


if __name__ == "__main__":
    console.run(main, "logs/youbot_fit.csv --test logs/youbot_test.csv")
