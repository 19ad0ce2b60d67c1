"""The panel where logs are opened: bundled, uploaded or recorded, and what the doctor says."""

from __future__ import annotations

import html
import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from youbot_workbench.session import ENDINGS, LARGEST
from youbot_workbench.widgets import figure, finding, head

if TYPE_CHECKING:
    from youbot_workbench.page import Page

MODELS = ("nominal", "paper", "identified")


def check(page: Page) -> None:
    """Logs and findings; where there are none, ways to get some."""
    view = page.session.views.get("check")
    if view is None or not view["logs"]:
        if page.session.settings["logs"]:
            ui.html('<div class="wait">reading …</div>', sanitize=False)
            return
        _starts(page)
        return
    with ui.element("div").classes("two"):
        with ui.element("div"):
            if view["problem"]:
                ui.html(f'<div class="warning-box trouble-text">{html.escape(view["problem"])}'
                        "</div>", sanitize=False)  # fmt: skip
            for one in view["logs"]:
                _log(page, one)
            if view["recording"]:
                head("How they were recorded", "found from the logs, before anything else")
                for line in view["recording"]:
                    ui.html(f'<div class="finding">{html.escape(line)}</div>', sanitize=False)
            words = "Open other logs, or read these in another way"
            with ui.expansion(words, value=not view["usable"]).classes("w-full"):
                _own(page, page.session.settings)
        with ui.element("div"):
            if view["figure"]:
                head("The record", f"{view['logs'][0]['name']}, as read: SI units, paper signs")
                figure(view["figure"], page.dark.value, 470)


def _log(page: Page, one: dict[str, Any]) -> None:
    role = "to fit" if one["role"] == "fit" else "to judge by, kept out of the fit"
    head(f"{one['name']}, {role}", one["facts"])
    if one["error"]:
        ui.html(f'<div class="trouble-text">{html.escape(one["error"])}</div>', sanitize=False)
        role = "logs" if one["role"] == "fit" else "tests"
        others = [source for source in page.session.settings[role] if source != one["source"]]
        if others or role == "tests":
            ui.button(
                "Leave it out", on_click=lambda: page.begin(**{role: others})
            ).props("outline dense no-caps size=sm")  # fmt: skip
    for told in one["findings"]:
        finding(told)
        if told["severity"] == "error" and told["acceptable"]:
            accept = [*page.session.settings["accept"], told["name"]]
            ui.button(
                "Use it all the same", on_click=lambda accept=accept: page.begin(accept=accept)
            ).props("outline dense no-caps size=sm")
    if not one["findings"] and not one["error"]:
        ui.html('<div class="finding mended"><span class="badge fine">ok</span>nothing odd</div>',
                sanitize=False)  # fmt: skip


def _starts(page: Page) -> None:
    with ui.element("div").classes("starts"):
        with ui.element("div").classes("card"):
            head(
                "The bundled log",
                "A youBot with real rollers and one hidden effect: 112 s to fit, 48 s of another "
                "motion to judge by.",
            )
            ui.button(
                "Open the bundled log",
                on_click=lambda: page.begin(
                    logs=["youbot_fit"], tests=["youbot_test"], model="nominal", hidden=None
                ),
            ).mark("bundled")
        with ui.element("div").classes("card"):
            head("A log of your own", "CSV, Parquet or a ROS bag; up to 200 MB a file.")
            _own(page, page.session.settings)
        with ui.element("div").classes("card"):
            head(
                "Guess what is wrong",
                "A robot is drawn at random, something is hidden in it, and it is recorded twice. "
                "Find it; the answer is in Use.",
            )
            seed = ui.number("seed", value=random.randrange(10_000), format="%d", min=0)
            plant = ui.select(
                {"analytic": "the equations (seconds)", "rollers": "real rollers (half a minute)"},
                value="analytic", label="plant",
            )  # fmt: skip
            ui.button(
                "Record it", on_click=lambda: record(page, int(seed.value or 0), plant.value)
            ).mark("record")


def record(page: Page, seed: int, plant: str) -> None:
    """Record a robot with something hidden, and open its logs."""
    from youbot_workbench.page import background

    async def work() -> None:
        session = page.session
        if await session.do("hidden", seed=seed, plant=plant):
            made = session.views["recorded"]
            about = {"seed": seed, "plant": plant}
            session.settings |= {"logs": made["logs"], "tests": made["tests"], "hidden": about}
            session.settings |= {"model": "nominal"}
            await session.begin()

    background(work())


def _own(page: Page, settings: dict[str, Any]) -> None:
    chosen: dict[str, list[str]] = {"logs": [], "tests": []}
    endings = ",".join(ENDINGS)

    async def take(role: str, event: events.UploadEventArguments) -> None:
        name = Path(event.file.name).name
        if not name.lower().endswith(ENDINGS):
            ui.notify(f"{name}: no log; it should end in {', '.join(ENDINGS)}", type="negative")
            return
        if event.file.size() > LARGEST:
            too_large()
            return
        path = page.session.room_for(name)
        await event.file.save(path)
        chosen[role].append(str(path))

    def too_large(event=None) -> None:
        ui.notify(
            "refused: a log may have 200 MB and end in "
            f"{', '.join(ENDINGS)}; 'youbot convert LOG --out LOG.parquet' makes it smaller, or "
            "start 'youbot workbench LOG' with its file, which has no limit",
            type="negative", multi_line=True, timeout=12_000,
        )  # fmt: skip

    for role, label in (("logs", "logs to fit"), ("tests", "logs to judge by (another motion)")):
        ui.upload(
            label=label, multiple=True, auto_upload=True, max_file_size=LARGEST,
            on_upload=lambda event, role=role: take(role, event), on_rejected=too_large,
        ).props(f'accept="{endings}" flat bordered').mark(f"upload-{role}")  # fmt: skip
    model = ui.select(list(MODELS), value=settings["model"], label="model to start from",
                      with_input=True, new_value_mode="add-unique")  # fmt: skip
    with ui.expansion("Other column names, another robot").classes("w-full"):
        mapping = ui.textarea(
            "columns, a line each: NAME=COLUMN", value="\n".join(settings["mapping"]),
            placeholder="time=stamp\nwheel_velocity_fl=-left_front [rpm]",
        ).classes("w-full")  # fmt: skip
        platform = ui.input(
            "robot: a name, a file, or R=0.05 r=0.012 l=0.14 h=0.13", value=settings["platform"]
        ).classes("w-full")

    def go() -> None:
        logs, tests = chosen["logs"], chosen["tests"]
        if not logs and not settings["logs"]:
            ui.notify("upload a log to fit first", type="warning")
            return
        told: dict[str, Any] = {"model": model.value or "nominal", "accept": []}
        told["mapping"] = [x.strip() for x in (mapping.value or "").splitlines() if x.strip()]
        told["platform"] = (platform.value or "").strip() or None
        if logs:
            told |= {"logs": logs, "tests": tests, "hidden": None}
        page.begin(**told)

    ui.button("Open these logs", on_click=go).mark("open-own")
