"""Read logs of any format once, and write them so that they need no option any more."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console
from youbot_cli.log_options import LogOptions, reads_logs

if TYPE_CHECKING:
    from ident.log import Log

ENDINGS = (".csv", ".parquet")


@reads_logs
def main(
    logs: Annotated[
        list[str],
        typer.Argument(metavar="LOG ...", help="Logs: files, folders, patterns in quotes."),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The log, .csv or .parquet, for one log.")
    ] = None,
    out_dir: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for one Parquet file a log.")
    ] = None,
    json_file: console.Json = None,
    force: console.Force = False,
    *,
    options: LogOptions,
) -> None:
    """Read logs of any format once, and write them so that they need no option any more.

    The files are in SI units and paper signs, and remember the robot, how they were recorded and
    what was put right.
    """
    from youbot_env.model_file import load_model

    if (out is None) == (out_dir is None):
        raise ValueError("give --out FILE for one log, or --out-dir DIR for any number")
    if out is not None and out.suffix.lower() not in ENDINGS:
        raise ValueError(f"--out {out}: end the name in {' or '.join(ENDINGS)}")
    console.check_results(out, json_file, force=force)
    read, _ = options.read(load_model("nominal"), logs, whole=True)
    if out is not None and len(read) > 1:
        raise ValueError(f"--out {out} is one file for {len(read)} logs; give --out-dir DIR")
    files = [out] if out_dir is None else [out_dir / f"{log.name}.parquet" for log in read]
    console.check_results(*files, json_file, force=force)
    written = [write(log, file, options) for log, file in zip(read, files, strict=True)]
    console.write_json(json_file, {"logs": written, "provenance": console.provenance()})


def write(log: Log, file: Path, options: LogOptions) -> dict:
    """Write one log and say so; returns what JSON shows."""
    from ident.remembered import remember
    from ident.report.findings import finding_lines, findings_json

    made = f"from {log.source}, SHA-256 {log.digest}, by {console.command_line()}"
    log.save(file, remember(log, made, options.accept or ()))
    console.out.print(f"{console.shown(file)}: {log}", soft_wrap=True)
    console.section("Log doctor", finding_lines([log]))
    return {
        "log": log.source,
        "file": console.shown(file),
        "samples": len(log.time),
        "duration": log.duration,
        "platform": log.platform.name,
        "findings": findings_json([log]),
    }


def start() -> None:
    """Run the command line."""
    console.run(main, "runs/mine.bag --platform mine.yaml --out runs/mine.parquet")
