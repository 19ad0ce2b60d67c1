"""Small parts of the page: tables, figures, badges, code with a button that copies it."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

from nicegui import ui

from ident.report.themes import themed

# Class and word of a severity; ``fixed`` is a class of the framework.
SEVERITIES = {"fixed": "mended", "warning": "warning", "error": "error"}


# Height of a figure that fills what the window leaves of it.
TALL = "max(430px, calc(100vh - {}px))"


def figure(content: dict[str, Any] | None, dark: bool, height: int | str):
    """A figure of ``ident.report.interactive``; nothing where there is none.

    Args:
        content: the figure.
        dark: whether the page is.
        height: pixels, or a length of CSS.
    """
    if content is None:
        return None
    tall = f"{height}px" if isinstance(height, int) else height
    return ui.plotly(themed(content, dark)).style(f"height: {tall}").classes("w-full")


def head(title: str, lead: str = "") -> None:
    """A heading, and a sentence on what is shown."""
    ui.html(f'<h2 class="head">{html.escape(title)}</h2>', sanitize=False)
    if lead:
        ui.html(f'<p class="lead">{html.escape(lead)}</p>', sanitize=False)


def table(
    heads: Sequence[str],
    rows: Sequence[Sequence[Any]],
    words: Sequence[int] = (0,),
    narrow: bool = False,
) -> None:
    """A plain table; columns of ``words`` are set to the left."""

    def row(cells: Sequence[Any], kind: str) -> str:
        marked = [f"<{kind}{' class=words' if k in words else ''}>{html.escape(str(cell))}</{kind}>"
                  for k, cell in enumerate(cells)]  # fmt: skip
        return f"<tr>{''.join(marked)}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    kind = "plain narrow" if narrow else "plain"
    ui.html(
        f'<table class="{kind}"><thead>{row(heads, "th")}</thead><tbody>{body}</tbody></table>',
        sanitize=False,
    ).classes("w-full")


def finding(one: dict[str, Any]) -> None:
    """What the doctor noticed, with what was or can be done."""
    kind = SEVERITIES[one["severity"]]
    ui.html(
        f'<div class="finding {kind}"><span class="badge {kind}">{kind}</span>'
        f"<b>{html.escape(one['what'])}</b> ({html.escape(one['where'])}). "
        f"{html.escape(one['remedy'])}</div>",
        sanitize=False,
    ).classes("w-full")


def code(lines: Sequence[str], classes: str = "code") -> None:
    """Lines to copy."""
    text = "\n".join(lines)
    ui.html(
        f'<pre class="{classes}" tabindex="0">{html.escape(text)}</pre>', sanitize=False
    ).classes("w-full")


def percent(share: float) -> str:
    """A share with two or three digits that count."""
    value = 100 * share
    if value != value:
        return "without bound"
    return (
        f"{value:.0f} %" if value >= 99.5 else f"{value:.3g} %" if value >= 1 else f"{value:.2g} %"
    )
