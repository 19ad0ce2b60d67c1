"""The page: a bar that stays, with the chain of models and the held-out error, and panels below."""

from __future__ import annotations

import asyncio
import html
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from ident.report.themes import stage_color
from youbot_workbench import opening, panels
from youbot_workbench.session import Session, Sessions
from youbot_workbench.widgets import SEVERITIES, figure, percent

STYLE = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
# Panels by name: what draws them, the views they show, and what there is to do in them.
PANELS: dict[str, tuple[Callable, tuple[str, ...]]] = {
    "Check": (opening.check, ("check",)),
    "Compare": (panels.compare, ("compare",)),
    "Where": (panels.where, ("where",)),
    "Which": (panels.which, ("which", "preview")),
    "Try": (panels.attempt, ("sliders",)),
    "Play": (panels.play, ("play",)),
    "Trust": (panels.trust, ("trust",)),
    "Next": (panels.next_record, ("next", "check")),
    "Use": (panels.use, ("use", "report", "answer", "control")),
}
# A figure that leaves the page while its size changes is no fault worth telling.
QUIET = (
    "<script>addEventListener('unhandledrejection', event => { if (String(event.reason).includes("
    "'Resize must be passed')) event.preventDefault(); });</script>"
)
TICK = 0.2  # s between looks at what has changed
SAID = {
    "more_to_add": "Something is missing",
    "named": "Found",
    "ambiguous": "Found, but not told apart",
    "nothing_missing": "Nothing more is missing",
    "outside_library": "Missing, and not in the library",
    "cannot_say": "These logs cannot say",
}


class Page:
    """One browser tab.

    Attributes:
        session: what it shows.
        choice: window, log, signal and regime that panels share.
    """

    def __init__(self, session: Session, sessions: Sessions, local: bool):
        self.session, self.sessions, self.local = session, sessions, local
        self.dark = ui.dark_mode(bool(session.settings.get("dark")))
        self.choice: dict[str, Any] = session.settings.setdefault(
            "choice", {"window": None, "log": None, "signal": "wheel speed", "regime": None}
        )
        self._seen: dict[str, int] = {}
        self._bodies: dict[str, ui.element] = {}
        ui.add_css(STYLE)
        ui.add_head_html(QUIET)
        ui.colors(primary="#0072b2")
        ui.page_title("youBot workbench")
        self._build()
        ui.timer(TICK, self.look)

    # What the page is made of

    def _build(self) -> None:
        with ui.header().classes("bar"), ui.element("div").classes("all"):
            self._top = ui.element("div").classes("bar-row")
            with ui.element("div").classes("bar-row state"):
                with ui.element("div").classes("left"):
                    self._chain = ui.element("div").classes("w-full")
                    self._said = ui.element("div").classes("said").props('aria-live="polite"')
                self._fallen = ui.element("div").classes("fallen")
            with ui.tabs().classes("panels w-full").props("align=left dense no-caps") as self.tabs:
                for number, name in enumerate(PANELS, start=1):
                    ui.tab(name, label=name).props(f'title="key {number}"')
        first = self.session.settings.get("panel", "Check")
        panels = ui.tab_panels(self.tabs, value=first, on_change=self._entered)
        with panels.props("animated=false").classes("w-full"):
            for name in PANELS:
                with ui.tab_panel(name):
                    self._bodies[name] = ui.element("div").classes("w-full")
        self.panels = panels
        self._dialogs = ui.element("div")  # what is drawn anew must not take a dialog with it
        ui.keyboard(on_key=self._key)
        self.look()

    def _key(self, event) -> None:
        digit = event.key.number
        plain = not (event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta)
        if event.action.keydown and plain and digit and digit <= len(PANELS):
            self.go(list(PANELS)[digit - 1])

    def go(self, panel: str) -> None:
        """Show a panel."""
        self.panels.set_value(panel)

    @property
    def panel(self) -> str:
        """The panel that is shown."""
        return str(self.panels.value)

    def _entered(self) -> None:
        self.session.settings["panel"] = self.panel
        ui.run_javascript("window.scrollTo(0, 0)")
        self.look()

    # What has changed

    def look(self) -> None:
        """Redraw what has changed since the last look."""
        self.session.seen = time.monotonic()
        version = self.session.version
        now = {name: version[name] for name in ("check", "bar", "verdict", "which", "dark")}
        now["job"] = version["job"] * 2 + self.session.busy
        if self._differs(now, "check", "dark"):
            self._draw(self._top, self._logs)
        if self._differs(now, "bar", "which", "verdict", "dark"):
            self._draw(self._chain, self._chips)
        if self._differs(now, "bar", "dark"):
            self._draw(self._fallen, self._number)
        if self._differs(now, "job", "verdict", "bar", "check"):
            self._draw(self._said, self._saying)
        self._seen |= now
        for name, (draw, views) in PANELS.items():
            stamp = tuple(version[view] for view in (*views, "dark"))
            if name == self.panel and self._seen.get(f"panel {name}") != stamp:
                self._seen[f"panel {name}"] = stamp
                self._draw(self._bodies[name], lambda draw=draw: draw(self))

    def _differs(self, now: dict[str, int], *names: str) -> bool:
        return any(self._seen.get(name) != now[name] for name in names)

    def _draw(self, place: ui.element, content: Callable[[], None]) -> None:
        place.clear()
        with place:
            content()

    # The bar

    def _logs(self) -> None:
        ui.html('<span class="brand">youBot workbench</span>', sanitize=False)
        with ui.element("div").classes("logs"):
            for one in (self.session.views.get("check") or {}).get("logs", ()):
                self._log_chip(one)
        with ui.row().classes("no-wrap gap-1"):
            self._plain("New", self._new, "another session, beside this one")
            self._plain("Save", self._save, "the session into a folder")
            self._plain("Open", self._open, "a session that was saved")
            self._plain("Light" if self.dark.value else "Dark", self._turn, "colours of the page")

    def _log_chip(self, one: dict[str, Any]) -> None:
        kinds = [SEVERITIES[f["severity"]] for f in one["findings"]]
        worst = next((k for k in ("error", "warning", "mended") if k in kinds), "fine")
        worst = "error" if one["error"] else worst
        counted = f"{kinds.count(worst)} {worst}" if worst in kinds else "ok"
        counted = "cannot be used" if one["error"] else counted
        role = "fit" if one["role"] == "fit" else "test"
        ui.html(
            f'<span class="log">{role}: <b>{html.escape(one["name"])}</b> '
            f'<span class="badge {worst}">{counted}</span></span>',
            sanitize=False,
        )

    def _chips(self) -> None:
        bar = self.session.views.get("bar")
        if not bar:
            return
        last = len(bar["names"]) - 1
        with ui.element("div").classes("chain").props('role="list" aria-label="chain of models"'):
            for k, (name, error) in enumerate(zip(bar["names"], bar["errors"], strict=True)):
                if k:
                    ui.html('<span class="arrow">›</span>', sanitize=False)
                self._chip(k, name, error, last)
            best = self._best()
            if best:
                ui.html('<span class="arrow">›</span>', sanitize=False)
                ui.button(
                    f"Add {best['title'].lower()}",
                    on_click=lambda: self.add(best["effect"]), color=None,
                ).props("flat no-caps").classes("chip next").mark("add-best")  # fmt: skip
            if best:
                told = "the whole loop: add the best, fit again, until nothing passes"
                self._plain("Add all that pass", lambda: self.do("loop"), told)
            if last > 1:
                told = "take the last effect out again"
                self._plain("Undo", lambda: self.do("back", stage=last - 1), told)

    @staticmethod
    def _plain(name: str, call: Callable[[], None], told: str) -> None:
        button = ui.button(name, on_click=call, color=None).props("flat dense no-caps")
        button.classes("plain").tooltip(told)

    def _number(self) -> None:
        bar = self.session.views.get("bar")
        if not bar:
            return
        with ui.element("div").classes("stairs"):
            figure(bar["figure"], self.dark.value, 88)
        told = f"{bar['words']}; {bar['excuse']} would be left by a model that is right"
        ui.html(
            f'<div class="number" title="{html.escape(told)}"><div class="value">'
            f'{percent(bar["errors"][-1])}</div><div class="what">held-out error</div>'
            f'<div class="what">noise leaves {percent(bar["floor"])}</div></div>',
            sanitize=False,
        )

    def _chip(self, k: int, name: str, error: float, last: int) -> None:
        button = ui.button(on_click=lambda: self._step_back(k, last), color=None)
        button.props("flat no-caps")
        with button.classes("chip now" if k == last else "chip"):
            ui.html(
                f'<span class="dot" style="background:{stage_color(k, self.dark.value)}"></span>'
                f"{html.escape(name)}<span class=err>{percent(error)}</span>",
                sanitize=False,
            ).style("display:flex; align-items:center")
        if 0 < k < last:
            button.tooltip("step back to this model")

    def _step_back(self, k: int, last: int) -> None:
        if 0 < k < last:
            self.do("back", stage=k)

    def _best(self) -> dict[str, Any] | None:
        rows = (self.session.views.get("which") or {}).get("rows", ())
        return next((row for row in rows if row["passes"]), None)

    def _saying(self) -> None:
        session = self.session
        self._said.classes(replace=f"said{' trouble' if session.trouble else ''}")
        if session.busy:
            ui.spinner(size="18px")
            seconds = time.monotonic() - session.since
            ui.html(f'<span class="mark">{html.escape(session.doing)} …</span>', sanitize=False)
            if session.job not in ("show", "preview", "attempt"):
                ui.button("Cancel", on_click=session.cancel).props("outline dense no-caps size=sm")
                if seconds > 3:
                    ui.html(f'<span class="why">{seconds:.0f} s</span>', sanitize=False)
            return
        if session.trouble:
            ui.html(f'<span class="mark">That did not work</span><span class="trouble-text">'
                    f"{html.escape(session.trouble)}</span>", sanitize=False)  # fmt: skip
            return
        told = session.views.get("verdict")
        check = session.views.get("check")
        if told:
            said, why = SAID[told["verdict"]], told["reason"]
        elif session.views.get("bar"):
            said, why = "The base model is fitted", "see what may be added in Which"
            if not session.job:
                ui.button("Try every effect", on_click=lambda: self.do("which")).props(
                    "outline dense no-caps size=sm"
                )
        elif check and not check["usable"]:
            said, why = "The logs do not pass yet", check["problem"] or "see Check"
        elif check and check["logs"]:
            said, why = "The logs pass", "nothing is fitted yet"
            ui.button("Fit the base model", on_click=self.begin).props(
                "outline dense no-caps size=sm"
            )
        else:
            said, why = "Open a log to begin", ""
        ui.html(
            f'<span class="mark">{html.escape(said)}</span>'
            f'<span class="why" title="{html.escape(why)}">{html.escape(why)}</span>',
            sanitize=False,
        ).classes("line")

    # What buttons do

    def do(self, name: str, then: str | None = None, **arguments: Any) -> None:
        """Call the views in the background; one thing at a time, others wait or are refused."""
        if self.session.job and name not in ("show", "preview", "plan", "play"):
            ui.notify("one thing at a time: wait, or cancel what is being done", type="warning")
            return

        async def work() -> None:
            done = await self.session.do(name, **arguments)
            if done and then:
                await self.session.do(then)

        background(work())

    def add(self, effect: str) -> None:
        """Add an effect to the model."""
        self.do("add", effect=effect)

    def begin(self, **settings: Any) -> None:
        """Open logs and fit the base model, then try every effect."""
        session = self.session
        if session.job:
            ui.notify("one thing at a time: wait, or cancel what is being done", type="warning")
            return
        session.settings |= settings
        self.choice |= {"window": None, "log": None, "regime": None, "signal": "wheel speed"}
        session.take(dict.fromkeys(("bar", "report", "answer", "added", "sliders")))
        background(session.begin())

    def choose(self, **choice: Any) -> None:
        """Change what panels share, and draw them again."""
        self.choice |= choice
        shown = {k: self.choice[k] for k in ("window", "log", "signal", "regime")}
        self.do("show", **shown)

    def _turn(self) -> None:
        self.dark.value = not self.dark.value
        self.session.settings["dark"] = self.dark.value
        self.session.version["dark"] += 1
        self._seen.clear()

    def _new(self) -> None:
        ui.navigate.to("/new")

    def _save(self) -> None:
        def save() -> None:
            try:
                self.session.save(self._folder(place.value))
            except (ValueError, OSError) as error:
                told.set_text(str(error))
                return
            dialog.close()
            ui.notify(f"saved to {place.value}")

        with self._dialogs, ui.dialog() as dialog, ui.card().style("min-width: 480px"):
            ui.label("Save the session: logs, model, views and finished work").classes("text-bold")
            place = ui.input("new folder", value="runs/session").classes("w-full")
            told = ui.label().classes("trouble-text")
            with ui.row():
                ui.button("Save", on_click=save)
                ui.button("Cancel", on_click=dialog.close).props("flat")
        dialog.open()

    def _open(self) -> None:
        def go() -> None:
            try:
                session = self.sessions.open(self._folder(place.value))
            except (ValueError, OSError) as error:
                told.set_text(str(error))
                return
            ui.navigate.to(f"/s/{session.name}")

        with self._dialogs, ui.dialog() as dialog, ui.card().style("min-width: 480px"):
            ui.label("Open a session that was saved").classes("text-bold")
            place = ui.input("folder", value="runs/session").classes("w-full")
            told = ui.label().classes("trouble-text")
            with ui.row():
                ui.button("Open", on_click=go)
                ui.button("Cancel", on_click=dialog.close).props("flat")
        dialog.open()

    def _folder(self, text: str) -> Path:
        """A folder that a user names; from another machine only inside the working folder."""
        folder = Path(text).expanduser()
        inside = folder.resolve().is_relative_to(Path.cwd().resolve())
        if not (self.local or inside):
            raise ValueError("from another machine give a folder inside the working folder")
        return folder


_TASKS: set[asyncio.Task] = set()


def background(work) -> None:
    """Start work that outlives the click that asked for it, and the tab."""
    task = asyncio.create_task(work)
    _TASKS.add(task)
    task.add_done_callback(_TASKS.discard)
