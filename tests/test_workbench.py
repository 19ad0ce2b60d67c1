"""The workbench in a browser: Debian's Chromium, where it is installed, drives the whole loop."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
SOON, LONG = 30_000, 240_000  # ms; on machines that have other work

pytest.importorskip("nicegui", reason="the page needs NiceGUI: pip install -e '.[workbench]'")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="tests of the page need playwright: pip install -e '.[dev]'"
)
from short_logs import record_two  # noqa: E402

if not CHROMIUM.exists():
    pytest.skip(f"no {CHROMIUM}: apt-get install chromium", allow_module_level=True)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Address of a running workbench, and the folder it works in."""
    folder = tmp_path_factory.mktemp("served")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # The framework takes a process with pytest's variables for a test of its own.
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    command = [sys.executable, ROOT / "scripts" / "workbench.py", "--no-browser", "--port", port]
    process = subprocess.Popen(
        [str(word) for word in command], cwd=folder, stdout=subprocess.PIPE, text=True,
        env=inherited | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    line = process.stdout.readline()
    assert line.startswith("workbench: http://127.0.0.1:"), line
    yield line.split()[-1], folder, core_seconds(process.pid)
    process.terminate()
    process.wait(20)


def core_seconds(process: int) -> float:
    """Time that a process has computed, s; other work on the machine does not count."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.fixture(scope="module")
def browser():
    """Chromium."""
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        yield started
        started.close()


class Tab:
    """One tab, with what went wrong in it and where it asked for things."""

    def __init__(self, browser, address: str, width: int = 1280, height: int = 800):
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(SOON)
        self.faults, self.asked = [], []
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(address)
        self.page.wait_for_selector(".brand")
        self.page.wait_for_function("() => window.socket && window.socket.connected")

    def button(self, name: str):
        return self.page.get_by_role("button", name=name, exact=True)

    def panel(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def upload(self, *files: Path | None) -> None:
        """Give files to fit and to judge by, and open them."""
        for number, file in enumerate(files):
            self.page.locator("input[type=file]").nth(number).set_input_files(str(file))
            self.page.get_by_text(re.compile(r"100\.00%")).nth(number).wait_for()
        self.button("Open these logs").click()

    @property
    def error(self) -> float:
        """The held-out error that the bar shows, %."""
        return float(self.page.locator(".number .value").inner_text().rstrip(" %"))

    @property
    def chips(self) -> list[str]:
        return [text.split("\n")[0] for text in self.page.locator(".chip").all_inner_texts()]

    def close(self) -> None:
        """Close the tab; nothing may have failed, nor come from elsewhere."""
        outside = [u for u in self.asked if not re.match(r"(http://127\.0\.0\.1:|data:|blob:)", u)]
        self.page.close()
        assert self.faults == []
        assert outside == []


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A log to fit and one to judge by, of a robot with hidden dry friction of the wheels."""
    return record_two(tmp_path_factory.mktemp("short"))


@pytest.fixture(scope="module")
def loop(browser, server, logs):
    """A tab in which the logs were uploaded and every effect was tried."""
    tab = Tab(browser, f"{server[0]}new")
    tab.upload(*logs)
    tab.page.locator(".chip.next").wait_for(timeout=LONG)
    yield tab
    tab.close()


def test_the_page_is_there_three_seconds_after_the_command(server):
    assert server[2] < 3.0


def test_from_upload_to_the_fallen_error(loop, tmp_path):
    before = loop.error
    assert [chip.split()[0] for chip in loop.chips] == ["nominal", "refit", "Add"]
    loop.panel("Which")
    first = loop.page.locator(".effects .name").first
    assert first.inner_text() == "Dry friction of the wheels"
    loop.page.locator(".chip.next").click()
    loop.page.get_by_text("+ dry friction of the wheels").first.wait_for(timeout=LONG)
    loop.page.locator(".said .mark", has_text="Found").wait_for(timeout=LONG)
    assert loop.error < 0.4 * before
    for panel, told in (
        ("Compare", "Measured against every model"), ("Where", "Torque that the equations leave"),
        ("Trust", "Parameters at every stage"), ("Next", "What to record next"),
        ("Use", "The same in Python"), ("Check", "The record"),
    ):  # fmt: skip
        loop.panel(panel)
        loop.page.get_by_role("heading", name=re.compile(told)).wait_for()
        if panel in ("Compare", "Where", "Trust", "Next", "Check"):
            loop.page.locator(".q-tab-panel .main-svg").first.wait_for()
        loop.page.screenshot(path=tmp_path / f"{panel.lower()}.png")


def test_a_reload_keeps_the_state(loop):
    loop.panel("Use")
    error, chips = loop.error, loop.chips
    loop.page.reload()
    loop.page.locator(".number .value").wait_for()
    assert (loop.error, loop.chips) == (error, chips)
    assert "wheel_coulomb_friction" in loop.page.locator("pre.code.long").inner_text()


def test_a_regime_filters_the_other_panels(loop):
    loop.panel("Where")
    loop.page.get_by_label("or choose a kind of moment").click()
    option = loop.page.get_by_role("option").first
    name = option.inner_text()
    option.click()
    loop.panel("Compare")
    loop.page.get_by_text(f"only: {name}").wait_for()


def test_sliders_move_the_free_run(loop):
    loop.panel("Try")
    slider = loop.page.locator(".q-slider [tabindex='0']").first
    slider.focus()
    for _ in range(10):
        slider.press("ArrowRight")
    told = loop.page.get_by_text(re.compile("as fitted, .* as tried"))
    told.wait_for()
    loop.page.wait_for_function(
        "() => { const m = document.body.innerText.match(/([\\d.]+) % as fitted, ([\\d.]+) % as "
        "tried/); return m && m[1] !== m[2]; }"
    )


def test_the_worst_stretches_play(loop):
    loop.panel("Play")
    frame = loop.page.frame_locator("iframe.player")
    frame.get_by_role("button", name="play").click()
    frame.get_by_role("button", name="pause").wait_for()


def test_two_sessions_do_not_disturb_each_other(loop, browser, server):
    chips = loop.chips
    other = Tab(browser, f"{server[0]}new")
    assert other.page.url != loop.page.url
    assert other.chips == []
    other.page.get_by_text("Open a log to begin").wait_for()
    assert loop.chips == chips
    other.close()


def test_work_can_be_cancelled_and_done_again(browser, server):
    tab = Tab(browser, f"{server[0]}new")
    tab.button("Open the bundled log").click()
    tab.page.locator(".said .mark", has_text="finding out how the logs were recorded").wait_for()
    tab.button("Cancel").click()
    tab.button("Cancel").wait_for(state="detached")
    assert tab.page.locator(".said.trouble").count() == 0
    assert tab.chips == []
    tab.button("Fit the base model").click()
    tab.page.locator(".chip", has_text="refit").wait_for(timeout=LONG)
    tab.button("Cancel").click()  # of the effects, not of the model
    tab.button("Try every effect").wait_for()
    assert [chip.split()[0] for chip in tab.chips] == ["nominal", "refit"]
    tab.close()


def test_a_session_is_saved_and_opened(loop, browser, server):
    loop.button("Save").click()
    loop.page.get_by_label("new folder").fill("kept/session")
    loop.page.get_by_role("dialog").get_by_role("button", name="Save").click()
    loop.page.get_by_text("saved to kept/session").wait_for()
    assert (server[1] / "kept" / "session" / "session.json").is_file()
    other = Tab(browser, f"{server[0]}new")
    other.button("Open").click()
    other.page.get_by_label("folder").fill("kept/session")
    other.page.get_by_role("dialog").get_by_role("button", name="Open").click()
    other.page.locator(".number .value").wait_for()
    assert (other.error, other.chips) == (loop.error, loop.chips)
    # A process of its own goes on where the other one was.
    other.panel("Compare")
    other.page.get_by_label("window of the free runs").click()
    other.page.get_by_role("option", name="0.5 s").click()
    other.page.get_by_text("free runs start anew every 0.5 s").wait_for(timeout=LONG)
    assert (other.error, other.chips) == (loop.error, loop.chips)
    other.close()


def test_a_malformed_upload_gets_the_message_of_the_doctor(browser, server, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("time,a,b\n0,1,x\n1,2,3\n")
    tab = Tab(browser, f"{server[0]}new")
    tab.upload(bad)
    tab.page.get_by_text("there are no velocities of wheels or body").wait_for(timeout=LONG)
    assert tab.page.get_by_text("The logs do not pass yet").is_visible()
    assert tab.chips == []
    tab.close()


def test_panels_are_reached_by_keys_and_nothing_is_wider_than_the_window(loop):
    for width in (1280, 1920):
        loop.page.set_viewport_size({"width": width, "height": 800})
        for key, panel in enumerate(("Check", "Compare", "Where", "Which"), start=1):
            loop.page.locator("body").press(str(key))
            loop.page.locator(f".q-tab--active:has-text('{panel}')").wait_for()
            wide = loop.page.evaluate("document.documentElement.scrollWidth")
            assert wide <= width, panel
