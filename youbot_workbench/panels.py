"""The panels behind the tabs: each draws the views that its session has."""

from __future__ import annotations

import html
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from youbot_workbench.widgets import TALL, code, figure, head, percent, table

if TYPE_CHECKING:
    from youbot_workbench.page import Page

# The player draws on white; at night its picture is turned over, colours kept.
NIGHT = ".player canvas{filter:invert(.91) hue-rotate(180deg)}"
AXES = ("vx rms, m/s", "vy rms, m/s", "yaw rate rms, rad/s")


def _wait(page: Page, words: str) -> None:
    told = "being computed; the bar above says how far it is" if page.session.job else words
    ui.html(f'<div class="wait">{html.escape(told)}</div>', sanitize=False)


def compare(page: Page) -> None:
    """Measured velocities against the free run of every model of the chain."""
    view = page.session.views.get("compare")
    if not view:
        _wait(page, "open a log in Check first")
        return
    held = "; shaded: held out, nothing was fitted to it or chosen by it" if view["held"] else ""
    usual = round(view["usual"], 3)
    with ui.element("div").classes("title-row"):
        with ui.element("div"):
            head(
                "Measured against every model",
                "Velocities simulated from the measured drive alone, starting at the measured "
                f"velocity in each window{held}. Drag to zoom, double-click to go back, click a "
                "name to hide it.",
            )
        with ui.element("div").classes("panel-head"):
            ui.select(
                {w: f"{w:.3g} s" + (" (as in the bar)" if w == usual else "")
                 for w in view["windows"]},
                value=round(view["window"], 3), label="window of the free runs",
                on_change=lambda e: page.choose(window=e.value),
            ).props("dense outlined").style("min-width: 190px")  # fmt: skip
            _log_choice(page, view)
            _regime_chip(page, view["regime"])
    figure(view["figure"], page.dark.value, TALL.format(460))
    heads = ("model", *AXES, "all, held out", "all, whole log")
    table(heads, view["rows"])


def _log_choice(page: Page, view: dict[str, Any]) -> None:
    if len(view["logs"]) > 1:
        ui.select(
            dict(enumerate(view["logs"])), value=view["log"], label="log",
            on_change=lambda e: page.choose(log=e.value, regime=None),
        ).props("dense outlined").style("min-width: 150px")  # fmt: skip


def _regime_chip(page: Page, regime: str | None) -> None:
    if regime:
        ui.chip(
            f"only: {regime}", removable=True, color="primary", text_color="white",
            on_value_change=lambda e: None if e.value else page.choose(regime=None),
        )  # fmt: skip


def where(page: Page) -> None:
    """Residual torques over a signal, and the regimes in which the error gathers."""
    view = page.session.views.get("where")
    if not view:
        _wait(page, "open a log in Check first")
        return
    with ui.element("div").classes("two wide-left"):
        with ui.element("div"):
            head(
                "Torque that the equations leave on each wheel",
                _OVER[view["signal"] in ("velocity map", "floor map")],
            )
            with ui.element("div").classes("panel-head"):
                ui.toggle(
                    view["signals"], value=view["signal"],
                    on_change=lambda e: page.choose(signal=e.value),
                ).props("dense no-caps unelevated")  # fmt: skip
                _regime_chip(page, view["regime"])
            if view["words"]:
                ui.html(f'<p class="lead">{html.escape(view["words"])}</p>', sanitize=False)
            figure(view["figure"], page.dark.value, TALL.format(345))
        with ui.element("div"):
            head(
                "When the last model fails",
                "Error over time in each kind of moment; filled: more than chance at a false "
                "discovery rate of 5 %. Click one to see only its moments, here and in Compare.",
            )
            plot = figure(view["regimes"], page.dark.value, TALL.format(400))
            plot.on("plotly_click", lambda e: _regime(page, e.args), js_handler=_CLICKED)
            names = [point for point in view["regimes"]["data"][0]["y"]][::-1]
            chosen = view["regime"] if view["regime"] in names else None
            ui.select(
                names, label="or choose a kind of moment", value=chosen, clearable=True,
                on_change=lambda e: page.choose(regime=e.value),
            ).classes("w-full")  # fmt: skip
            if view["depends_on"]:
                words = ", ".join(f"{s} ({percent(g)})" for s, g in view["depends_on"])
                ui.html(f'<p class="lead">What is left depends on: {html.escape(words)}</p>',
                        sanitize=False)  # fmt: skip


_OVER = {
    False: "Mean with 95 % interval; this stage and the one before on the same axes. A step at "
    "zero speed is dry friction, a slope wrong viscous friction or gain, a wave over the roller "
    "phase ripple.",
    True: "Median force left on the body, side by side with the stage before: size as colour, "
    "arrows for its direction. Along the velocity: resistance that the model lacks; everywhere "
    "in one direction of the floor: a slope or a cable.",
}
# Plotly's event holds the whole figure; only the name goes to the server.
_CLICKED = "(event) => emit(event.points[0].y)"


def _regime(page: Page, name: Any) -> None:
    page.choose(regime=name if isinstance(name, str) else None)


def which(page: Page) -> None:
    """Effects ranked by what they remove once they are fitted."""
    view = page.session.views.get("which")
    if not view:
        _wait(page, "nothing was tried yet; open a log, or press Try every effect")
        return
    with ui.element("div").classes("two wide-left"):
        with ui.element("div"):
            head(
                "What may be missing",
                "Share of the squared error that an effect removes from windows that it was not "
                "fitted to, after everything is fitted again. The held-out part of the bar is not "
                "used here. Choose a row to see its curve.",
            )
            _effects(page, view)
        with ui.element("div"):
            _preview(page)
            if view["untried"]:
                with ui.expansion(f"{len(view['untried'])} effects these logs cannot show"):
                    for one in view["untried"]:
                        ui.html(f"<div class=finding><b>{html.escape(one['title'])}</b>: "
                                f"{html.escape(one['reason'])}</div>", sanitize=False)  # fmt: skip


def _effects(page: Page, view: dict[str, Any]) -> None:
    chosen = (page.session.views.get("preview") or {}).get("effect")
    fitted = [row for row in view["rows"] if row["after"] is not None]
    others = [row for row in view["rows"] if row["after"] is None]
    with ui.element("div").classes("effects"):
        for words, side in (("effect", ""), ("removes", "right"), ("size", "right"),
                            ("would show from", "right"), ("", "")):  # fmt: skip
            ui.html(words, sanitize=False).classes(f"cell head {side}")
        for row in fitted:
            _effect(page, row, row["effect"] == chosen)
    if others:
        most = percent(max(0.0, *(row["gain"] for row in others)))
        told = f"{len(others)} more that would remove {most} or less, as their linear traces say"
        with ui.expansion(told).classes("w-full"), ui.element("div").classes("effects"):
            for row in others:
                _effect(page, row, row["effect"] == chosen)


def _effect(page: Page, row: dict[str, Any], chosen: bool) -> None:
    mood = "" if row["passes"] else " idle"
    mood += " chosen" if chosen else ""
    share = row["after"] if row["after"] is not None else row["gain"]
    told = f'<span class="name">{html.escape(row["title"])}</span>'
    told += f'<span class="equation">{row["equation"]}</span>'
    under = row["effect"]
    if row["background"]:
        under += "; every robot with rollers has some"
    if row["rivals"]:
        under += f"; fits as well: {', '.join(row['rivals']).lower()}"
    told += f'<span class="id">{html.escape(under)}</span>'
    cell = ui.html(told, sanitize=False).classes(f"cell pick{mood}")
    cell.props(f'tabindex=0 role=button aria-label="show the curve of {row["effect"]}"')
    show = lambda: page.do("preview", effect=row["effect"], log=page.choice["log"],  # noqa: E731
                           signal=page.choice["signal"])  # fmt: skip
    cell.on("click", show).on("keydown.enter", show)
    removed = percent(max(share, 0.0)) + ("" if row["after"] is not None else " *")
    width = max(0.0, min(1.0, share))
    ui.html(
        f'<span>{removed}</span><span class="gauge"><i style="width:{100 * width:.1f}%"></i></span>'
        f'<span class="id">p = {row["p"]:.2g}</span>',
        sanitize=False,
    ).classes(f"cell right{mood}").tooltip(
        "after a refit" if row["after"] is not None else "from its linear trace, not refitted"
    )
    ui.html(
        f'<span>{html.escape(row["size"])}</span><span class="id">{html.escape(row["parameter"])}'
        "</span>", sanitize=False,
    ).classes(f"cell right{mood}").tooltip(f"alone, before a refit: {row['ci95']}")  # fmt: skip
    ui.html(
        f"<span>{html.escape(row['smallest'] or 'not at all')}</span>"
        f'<span class="id">power {100 * row["power"]:.0f} %</span>', sanitize=False,
    ).classes(f"cell right{mood}").tooltip(
        "smallest size that these logs show with a chance of 80 %, and the chance for a typical one"
    )  # fmt: skip
    with ui.element("div").classes("cell chosen" if chosen else "cell"):
        ui.button(
            "Add" if row["passes"] else "Add anyway", on_click=lambda: page.add(row["effect"])
        ).props(f"{'unelevated' if row['passes'] else 'flat'} dense no-caps size=sm").mark(
            f"add-{row['effect']}"
        )


def _preview(page: Page) -> None:
    view = page.session.views.get("preview")
    if not view:
        where_view = page.session.views.get("where")
        if where_view and where_view["figure"]:
            head("Torque left on each wheel", "choose an effect to see what it would do to it")
            figure(where_view["figure"], page.dark.value, TALL.format(330))
        return
    head("With that effect", view["words"])
    figure(view["figure"], page.dark.value, TALL.format(330))


def attempt(page: Page) -> None:
    """Sliders of all values, and the free run with them."""
    session = page.session
    sliders = session.views.get("sliders")
    if not sliders:
        _wait(page, "fit a model first: open a log in Check")
        return
    view = session.views.get("attempt")
    values = dict((view or {}).get("values") or {})

    from youbot_workbench.page import background

    def moved(name: str, value: float, label) -> None:
        values[name] = value
        label.set_text(_shown(value, units[name]))
        background(session.attempt(dict(values), page.choice["log"]))

    units = {one["name"]: one["unit"] for one in sliders}
    with ui.element("div").classes("two").style("grid-template-columns: 380px minmax(0, 1fr)"):
        with ui.element("div"):
            head("Turn the values yourself", "Only the picture changes; the chain stays as it is.")
            for one in sliders:
                value = values.get(one["name"], one["value"])
                ui.label(f"{one['title']}, {one['name']}" if one["title"] else one["name"]).style(
                    "font-size: 13.5px"
                )
                with ui.element("div").classes("slider-row"):
                    step = (one["high"] - one["low"]) / 200
                    slider = ui.slider(min=one["low"], max=one["high"], step=step, value=value)
                    label = ui.label(_shown(value, one["unit"])).classes("value")
                    slider.props(f'aria-label="{one["name"]}"').on(
                        "update:model-value",
                        lambda e, name=one["name"], label=label: moved(name, e.args, label),
                        throttle=0.15,
                    )

            def reset() -> None:
                session.take({"attempt": None, "sliders": sliders})

            ui.button("As fitted", on_click=reset).props("outline dense no-caps")
        picture = ui.element("div")
    # Sliders stay as they are while a picture comes; only the picture is drawn anew.
    state = {"seen": -1}
    if not view and not session.job:
        background(session.attempt({}, page.choice["log"]))

    def draw() -> None:
        now = session.version["attempt"]
        if state["seen"] == now:
            return
        state["seen"] = now
        picture.clear()
        with picture:
            shown = session.views.get("attempt")
            if not shown:
                ui.html('<div class="wait">simulating …</div>', sanitize=False)
                return
            head("Free run with these values", shown["words"])
            figure(shown["figure"], page.dark.value, TALL.format(310))

    draw()
    ui.timer(0.15, draw)


def _shown(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".strip()


def play(page: Page) -> None:
    """The stretches in which the model goes most astray, as motion."""
    session = page.session
    if not session.views.get("bar"):
        _wait(page, "fit a model first: open a log in Check")
        return
    view = session.views.get("play")
    if not view:
        if not session.job:
            page.do("play", log=page.choice["log"], window=page.choice["window"])
        _wait(page, "drawing the worst stretches …")
        return
    head("The worst stretches, as motion", view["caption"])
    dark = page.dark.value
    ink, paper, line, shade = (
        ("#e8eaed", "#16191d", "#3a3f47", "#20242a") if dark
        else ("#1d2127", "#ffffff", "#d9dde2", "#f4f6f8")
    )  # fmt: skip
    style = (
        f"<style>:root{{--ink:{ink};--paper:{paper};--line:{line};--shade:{shade};--soft:{ink};"
        f"--good:#0072b2}}body{{margin:0;color:{ink};background:{paper};"
        "font:14px system-ui,sans-serif}"
        ".player canvas{height:max(260px,calc(100vh - 150px))!important}"
        f"{NIGHT if dark else ''}</style>"
    )
    document = html.escape(f"<!doctype html><meta charset=utf-8>{style}{view['html']}", quote=True)
    ui.html(
        f'<iframe class="player" title="worst stretches" srcdoc="{document}"></iframe>',
        sanitize=False,
    ).classes("w-full")


def trust(page: Page) -> None:
    """Parameters with intervals at every stage, and what stands against relying on them."""
    view = page.session.views.get("trust")
    if not view:
        _wait(page, "fit a model first: open a log in Check")
        return
    if view["warning"]:
        ui.html(f'<div class="warning-box">{html.escape(view["warning"])}</div>', sanitize=False)
    with ui.element("div").classes("two"):
        with ui.element("div"):
            head(
                "Parameters at every stage, with 95 % intervals",
                "Open symbols: the logs do not determine the value alone. A model that lacks an "
                "effect bends its parameters to stand in for it.",
            )
            figure(view["figure"], page.dark.value, 480)
            if view["words"]:
                head("Combinations that the fitted log does not determine")
            for words in view["words"]:
                ui.html(f'<div class="finding warning">{html.escape(words)}</div>', sanitize=False)
        with ui.element("div"):
            head("Account of the error", f"beside {view['excuse']}")
            figure(view["account"], page.dark.value, 170)
            head("Autocorrelation of the residual", "what is left should forget itself quickly")
            figure(view["autocorrelation"], page.dark.value, 260)
    head("Values of the last model")
    heads = ("parameter", "value", "95 % interval", "unit", "shift, se", "meaning")
    rows = [
        (r["name"], r["value"], r["ci95"], r["unit"] or "–",
         "–" if r["shift"] is None else f"{r['shift']:+.1f}", r["meaning"])
        for r in view["rows"]
    ]  # fmt: skip
    table(heads, rows, words=(0, 3, 5))


def next_record(page: Page) -> None:
    """What to record next, drawn, to download or to simulate with the recorded robot."""
    session = page.session
    view = session.views.get("next")
    if not view:
        _wait(page, "fit a model first: open a log in Check")
        return
    proposed = view["proposed"]
    lead = f"Proposed: {proposed}. {view['words']}" if proposed else (
        "Nothing is proposed now: no rivals are left that another motion would tell apart. "
        "These are the motions of the menu."
    )  # fmt: skip
    head("What to record next", lead)
    with ui.element("div").classes("panel-head"):
        ui.select(
            view["motions"], value=view["motion"], label="motion",
            on_change=lambda e: page.do("plan", motion=e.value),
        ).style("min-width: 190px")  # fmt: skip
        if view["yaml"]:
            name = f"{view['motion']}.yaml"
            ui.button("Download the motion", on_click=lambda: ui.download.content(
                view["yaml"], name)).props("outline no-caps dense")  # fmt: skip
        if session.settings.get("hidden"):
            ui.button("Record this robot so", on_click=lambda: simulate(page, view["motion"])
            ).props("outline no-caps dense")  # fmt: skip
    figure(view["figure"], page.dark.value, 360)
    if view["odds"]:
        table(("motion", "odds of the true one after 60 s"), view["odds"], narrow=True)
    head(
        "On a simulated robot",
        "This records the model that you have now, not the robot of your logs: pool it with them "
        "and the two contradict each other.",
    )
    code([view["command"]])


def simulate(page: Page, motion: str) -> None:
    """Record the robot with the hidden effect once more, and fit all its logs."""
    from youbot_workbench.page import background

    async def work() -> None:
        session = page.session
        if await session.do("simulate", motion=motion):
            more = session.views["recorded_more"]
            logs = [*(p for p in session.settings["logs"] if p != more), more]
            session.settings["logs"] = logs
            added = session.added
            await session.do("start", settings=session.settings, added=added)
            await session.do("which")

    background(work())


def use(page: Page) -> None:
    """The model as a file, lines that use it, and commands that do the same."""
    session = page.session
    view = session.views.get("use")
    if not view:
        _wait(page, "fit a model first: open a log in Check")
        return
    with ui.element("div").classes("two"):
        with ui.element("div"):
            head("The model", f"{view['name']}; with intervals and where each value comes from")
            with ui.row():
                ui.button(
                    "Download model.yaml",
                    on_click=lambda: ui.download.content(view["yaml"], "model.yaml"),
                ).mark("download")
                ui.button("Write a report", on_click=lambda: page.do("report")).props("outline")
            report = session.views.get("report")
            if report:
                ui.button("Download the report", on_click=lambda: ui.download.file(
                    Path(report), "report.html")).props("flat dense")  # fmt: skip
            head("The same in Python")
            code(view["python"])
            head("The same as commands")
            code(view["shell"])
            head("What a controller gains")
            gained = session.views.get("control")
            if gained:
                ui.html(f'<p class="lead">{html.escape(gained["words"])}</p>', sanitize=False)
            else:
                ui.button("Drive both models", on_click=lambda: page.do("control")).props("outline")
            if session.settings.get("hidden"):
                _answer(page)
        with ui.element("div"):
            head("model.yaml")
            code(view["yaml"].splitlines(), "code long")


def _answer(page: Page) -> None:
    head("What was wrong?", "what was hidden in the recorded robot")
    told = page.session.views.get("answer")
    if not told:
        ui.button("Show the answer", on_click=lambda: page.do("answer")).props("outline").mark(
            "answer"
        )
        return
    for one in told["hidden"]:
        sizes = ", ".join(f"{k} {v}" for k, v in one["values"].items())
        ui.html(
            f'<div class="finding {"mended" if told["right"] else "warning"}">'
            f"<b>{html.escape(one['title'])}</b> ({html.escape(one['effect'])}): "
            f"{html.escape(sizes)}. {html.escape(told['words'])}</div>",
            sanitize=False,
        )
