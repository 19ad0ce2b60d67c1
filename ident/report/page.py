"""A report page: sections of text, tables and figures in one self-contained HTML file."""

from __future__ import annotations

import base64
import os
from dataclasses import dataclass, field
from pathlib import Path

from ident.report.look import pretty
from youbot_env.model_file import write_atomically

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Picture:
    """A figure with its caption.

    Attributes:
        name: stem of the PNG beside the page.
        png: the picture.
        caption: what it shows and what to see in it.
        wide: over the whole page; else beside its neighbour.
    """

    name: str
    png: bytes
    caption: str
    wide: bool = True
    kind: str = field(default="picture", init=False)

    @property
    def source(self) -> str:
        """The picture as an address that needs no file."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


@dataclass(frozen=True)
class Live:
    """Something that moves: a piece of HTML with its own style and script, no outside resources.

    Attributes:
        name: its address on the page.
        html: trusted markup, put in as it is.
        caption: what it shows and how to use it.
    """

    name: str
    html: str
    caption: str
    kind: str = field(default="live", init=False)


@dataclass(frozen=True)
class Grid:
    """A table: a first column of names, numbers to the right of it.

    Attributes:
        head: column titles.
        rows: cells as they are to be printed; a cell may be ``Name``.
        note: a sentence below.
        words: columns, counted from 0, that hold words and not numbers.
    """

    head: tuple[str, ...]
    rows: list[tuple]
    note: str = ""
    words: tuple[int, ...] = (0,)
    kind: str = field(default="grid", init=False)


@dataclass(frozen=True)
class Notes:
    """A list of sentences.

    Attributes:
        sentences: the items.
        otherwise: what to say when there are none.
        wide: over the whole page; else beside its neighbour.
    """

    sentences: list[str]
    otherwise: str = ""
    wide: bool = True
    kind: str = field(default="notes", init=False)


@dataclass(frozen=True)
class Name:
    """A symbol with an index, and its meaning in words: ``Name("m", "0", "total mass")``."""

    letter: str
    index: str = ""
    meaning: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading and a sentence on what it is about."""

    title: str
    blocks: list[Picture | Live | Grid | Notes]
    lead: str = ""


@dataclass(frozen=True)
class Page:
    """What a report says.

    Attributes:
        title: of the document.
        verdict: the answer in one sentence.
        good: whether the answer is good news.
        lead: what the answer rests on, in a sentence.
        figures: the few numbers that carry it: (number, what it is).
        sections: in the order in which they are read.
        provenance: how the page came about, by name.
    """

    title: str
    verdict: str
    good: bool
    lead: str
    figures: list[tuple[str, str]]
    sections: list[Section]
    provenance: dict[str, str]

    def html(self) -> str:
        """The page as one self-contained document."""
        from jinja2 import Environment, FileSystemLoader, StrictUndefined

        environment = Environment(
            loader=FileSystemLoader(HERE),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.filters["pretty"] = pretty
        style = (HERE / "style.css").read_text(encoding="utf-8")
        return environment.get_template("page.html").render(page=self, style=style)

    def write(self, folder: str | os.PathLike) -> Path:
        """Write ``index.html`` and every figure as PNG, each whole or not at all."""
        folder, html = Path(folder), self.html()
        for section in self.sections:
            for block in section.blocks:
                if block.kind == "picture":
                    write_atomically(folder / f"{block.name}.png", block.png)
        return write_atomically(folder / "index.html", html)
