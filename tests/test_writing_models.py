"""Model files are written whole or not at all."""

import os
import stat

import pytest

from youbot_env.model import Model
from youbot_env.model_file import load_model, save_model, write_atomically
from youbot_env.parameters import Parameters
from youbot_env.platform import youbot

PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)


@pytest.mark.parametrize("failing", ["replace", "chmod", "fdopen"])
def test_failed_save_leaves_the_old_file(tmp_path, monkeypatch, failing):
    path = tmp_path / "model.yaml"
    save_model(Model(youbot(), PAPER, name="old"), path)
    before = path.read_bytes()

    def fail(*_args, **_options):
        raise OSError("disk full")

    with monkeypatch.context() as broken:
        broken.setattr(os, failing, fail)
        with pytest.raises(OSError, match="disk full"):
            save_model(Model(youbot(), PAPER, name="new"), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["model.yaml"]
    save_model(Model(youbot(), PAPER, name="new"), path)
    assert load_model(path).name == "new"


def test_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "result.txt"
    write_atomically(path, "old")
    real = os.fdopen

    class Interrupted:
        """A file that takes half of the text before the user presses Ctrl-C."""

        def __init__(self, handle, *arguments, **options):
            self.file = real(handle, *arguments, **options)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.file.close()

        def write(self, text):
            self.file.write(text[: len(text) // 2])
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "fdopen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, "something new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_model_that_cannot_be_written_leaves_the_old_file(tmp_path):
    path = tmp_path / "model.yaml"
    save_model(Model(youbot(), PAPER), path)
    before = path.read_bytes()
    with pytest.raises(Exception, match="cannot represent"):
        save_model(Model(youbot(), PAPER, provenance={"what": object()}), path)
    assert path.read_bytes() == before


def test_write_atomically_makes_folders_and_files_that_others_can_read(tmp_path):
    path = tmp_path / "a" / "b" / "text.txt"
    write_atomically(path, "Größe 5 µm\n")
    assert path.read_text(encoding="utf-8") == "Größe 5 µm\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    write_atomically(path, "shorter")
    assert path.read_text() == "shorter"
    assert list(path.parent.iterdir()) == [path]
    with pytest.raises(OSError, match=r"text\.txt"):
        write_atomically(path / "inside.txt", "no folder")
