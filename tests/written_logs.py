"""Logs as ``youbot record`` writes them, read back."""

from pathlib import Path

import polars as pl


def read(path):
    return pl.read_csv(path, comment_prefix="#")


def comments(path):
    return [line for line in Path(path).read_text().splitlines() if line.startswith("#")]
