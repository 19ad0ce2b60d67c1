"""The documentation site builds without a warning and asks nothing of the network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("zensical", reason="make docs installs what builds the site")
pytest.importorskip("mkdocstrings", reason="make docs installs what builds the site")

ROOT = Path(__file__).resolve().parent.parent
# What a browser fetches by itself, as opposed to links that a reader may follow.
FETCHED = re.compile(r"<(?:script|link|img|iframe|source)[^>]*(?:src|href)=\"?(?:https?:)?//[^>]*>")


def build(folder):
    """Build the site of the pages in a folder; returns the finished process."""
    config = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert "paths: [.]" in config
    (folder / "mkdocs.yml").write_text(config.replace("paths: [.]", f"paths: [{ROOT}]"), "utf-8")
    command = [sys.executable, "-m", "zensical", "build", "--strict", "-f", "mkdocs.yml"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the gathered pages."""
    folder = tmp_path_factory.mktemp("site")
    gather = [sys.executable, ROOT / "docs/site_pages.py", folder / "build/pages"]
    subprocess.run(gather, cwd=ROOT, check=True)
    return folder


def test_the_site_builds_and_is_complete_without_the_network(folder):
    done = build(folder)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {page.name: page.read_text("utf-8") for page in folder.glob("build/site/**/*.html")}
    assert len(pages) > 15
    for name, text in pages.items():
        assert not FETCHED.search(text), name
        assert "$`" not in text, name
    for sheet in folder.glob("build/site/**/*.css"):
        assert not re.search(r"(@import|url\()\s*['\"]?(https?:)?//", sheet.read_text("utf-8"))
    # A formula, a heading and an argument of the reference, and an example are really there.
    assert "<math" in pages["effects.html"]
    assert "measured records of one robot" in pages["ident.html"]
    assert "quadratic drag is hidden here" in pages["examples.html"]


@pytest.mark.parametrize(
    ("page", "fault", "told"),
    [
        ("index.md", "[lost](nowhere.md)", "does not exist"),
        ("index.md", "[lost](logs.md#nowhere)", "does not exist"),
        ("reference/ident.md", "::: ident.log.Nothing", "ident.log.Nothing"),
    ],
)
def test_a_lost_link_or_name_is_an_error(folder, page, fault, told):
    file = folder / "build/pages" / page
    text = file.read_text("utf-8")
    file.write_text(f"{text}\n{fault}\n", "utf-8")
    done = build(folder)
    file.write_text(text, "utf-8")
    assert done.returncode != 0
    assert told in done.stdout + done.stderr
