"""Compare models with a measured log: how large the error is, and where it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import console
import typer

from ident.comparison import Comparison, compare
from ident.log import Log
from youbot_env.model_file import load_model

LOG = console.ROOT / "logs" / "youbot_test.csv"
SHOWN = 6


def main(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="The log; a bundled one if left.")
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(help="Model file, nominal or paper; may be repeated."),
    ] = None,
    window: Annotated[float, typer.Option(min=0.1, help="Length of the free runs, s.")] = 5.0,
    seed: console.Seed = 0,
    json_file: console.Json = None,
) -> None:
    """Compare models with a measured log."""
    console.check_writable(json_file)
    models = [load_model(name) for name in model or ("nominal", "paper")]
    path = log or LOG
    if not path.exists():
        raise ValueError(f"no log {console.shown(path)!r}; check the name")
    record = Log.load(path, models[0].platform)
    with console.progress("comparing", len(models), "models") as show:
        found: list[Comparison] = []
        for number, one in enumerate(models, start=1):
            found += compare(record, [one], window, seed)
            show(number)
    best = min(found, key=lambda comparison: comparison.run.nrmse)
    console.out.print(
        f"{best.model.name} explains {record.name} best, "
        f"free-run error {100 * best.run.nrmse:.3g} %\n"
    )
    rows = [
        (c.model.name, *(f"{v:.3g}" for v in c.run.rmse), f"{100 * c.run.nrmse:.3g}",
         *(f"{100 * v:.3g}" for v in c.equation))
        for c in found
    ]  # fmt: skip
    headings = ("model", "vx m/s", "vy m/s", "yaw rad/s", "free run %", "X %", "Y %", "yaw %",
                "equations %")  # fmt: skip
    console.table("Errors", headings, rows)
    where = [
        (r.name, f"{100 * r.share_of_error:.0f}",
         f"{100 * r.ci95[0]:.0f} ... {100 * r.ci95[1]:.0f}", f"{100 * r.share_of_time:.0f}")
        for r in best.where[:SHOWN]
    ]  # fmt: skip
    console.table(
        f"\nWhere the equations of {best.model.name} fail most",
        ("regime", "share of error %", "95 % interval", "share of time %"),
        where,
    )
    result = {"log": record.name, "models": [comparison.as_dict() for comparison in found]}
    history = console.provenance(seed, {record.source: record.digest})
    console.write_json(json_file, result | {"provenance": history})


if __name__ == "__main__":
    console.run(main, "logs/youbot_test.csv --model nominal --model models/identified.yaml")
