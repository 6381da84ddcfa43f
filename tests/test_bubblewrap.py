"""The root folder that bubblewrap makes: what is in it, what can be written, and what happens without it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from material import GOOD, ROOT, answer, model

from eigenbench import bubblewrap
from eigenbench.bubblewrap import missing, symlinks_towards, wrap
from eigenbench.errors import ModelError, UsageError
from eigenbench.hosting import HostedModel, HostOptions
from eigenbench.tasks import TASKS

needs_bubblewrap = pytest.mark.skipif(bool(missing()), reason=f"no bubblewrap: {missing()}")


def test_links_on_the_way(tmp_path):
    """Every link of a chain is found: absolute, relative, to a folder above, and one that leads to itself."""
    (tmp_path / "real" / "in").mkdir(parents=True)
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to("real")
    (tmp_path / "real" / "up").symlink_to("../real/in")
    (tmp_path / "self").symlink_to("self")
    found = symlinks_towards(str(tmp_path / "a" / "up" / "file"))
    own = {k: v for k, v in found.items() if Path(k).is_relative_to(tmp_path)}
    assert own == {
        str(tmp_path / "a"): str(tmp_path / "b"),
        str(tmp_path / "b"): "real",
        str(tmp_path / "real" / "up"): "../real/in",
    }
    assert str(tmp_path / "self") in symlinks_towards(str(tmp_path / "self" / "x"))
    assert not [k for k in symlinks_towards(str(tmp_path / "real" / "in")) if Path(k).is_relative_to(tmp_path)]


def test_the_command_line(tmp_path):
    """Binds come before what lies in them, hidden folders are not named, everything ends read-only."""
    rules = [("/usr/lib/deep", False), ("/usr", False), (str(tmp_path), True), ("/proc/stat", False)]
    line = wrap(["run"], readable=rules, linked=[], devices=["/dev/x"], scratch=tmp_path / "s", scratch_bytes=5)
    text = " ".join(line)
    assert text.index("--ro-bind /usr /usr") < text.index("--ro-bind /usr/lib/deep")
    assert f"--dir {tmp_path} " in text
    assert "/proc/stat" not in text
    assert "--dev-bind /dev/x /dev/x" in text
    assert f"--size 5 --tmpfs {tmp_path / 's'}" in text
    assert text.endswith("--remount-ro /dev --remount-ro / -- run")


@needs_bubblewrap
def test_nothing_else_exists(tmp_path):
    """No home, no data, no other process; the only folder that takes a file is the scratch folder."""
    secret = tmp_path / "data"
    secret.mkdir()
    (secret / "targets").write_text("x")
    body = (
        "import os\nfrom pathlib import Path\n\n"
        "def writable(folder):\n    try:\n        (folder / 'new').write_text('x')\n    except OSError:\n        return False\n    return True\n\n"
        "class Model:\n    def predict(self, env, obj):\n"
        f"        assert not Path({str(secret)!r}).exists()\n"
        f"        assert not Path({str(ROOT / 'README.md')!r}).exists()\n"
        "        assert not Path('/etc/shadow').exists() and not Path('/var').exists() and not Path('/run').exists()\n"
        "        assert os.getpid() < 10\n"
        "        named = 'tmp usr usr/lib etc dev dev/shm proc root home sys var'.split()\n"
        "        here = [p for p in (Path('/'), *(Path('/', n) for n in named), Path.cwd().parent, Path.cwd()) if writable(p)]\n"
        "        assert here == [Path.cwd()], here\n"
        "        free = os.statvfs('.')\n"
        "        assert free.f_blocks * free.f_frsize == 1 << 26, free\n"
        "        return {'probability': [0.5] * len(env)}\n"
    )
    _, isolation = answer(model(tmp_path, body), isolation="bubblewrap", scratch_gib=1 / 16)
    assert isolation["level"] == "bubblewrap"
    assert isolation["files"] == "own root"


@needs_bubblewrap
def test_a_hidden_folder_inside_the_submission_does_not_exist(tmp_path):
    """Beside the model, through a link, and in the listing: a hidden folder is not there, its neighbours are."""
    folder = tmp_path / "submission"
    (folder / "data").mkdir(parents=True)
    (folder / "data" / "targets").write_text("x")
    (folder / "near").mkdir()
    (folder / "near" / "w").write_text("0.5")
    (folder / "way").symlink_to("data")
    (folder / "good").symlink_to("near")
    body = (
        "import os; from pathlib import Path; f = Path(__file__).parent; "
        "assert not (f / 'data').exists() and not (f / 'way' / 'targets').exists(); "
        "assert 'data' not in os.listdir(f); assert (f / 'good' / 'w').read_text() == '0.5'; " + GOOD
    )
    answer(model(tmp_path, body), isolation="bubblewrap", hidden=(folder / "data",))


@needs_bubblewrap
def test_a_submission_behind_a_link(tmp_path):
    """A model named through a symbolic link runs, and finds its checkpoint."""
    path = model(
        tmp_path,
        "def build(task, checkpoint, device):\n    return M(float(open(checkpoint).read()))\nclass M:\n    def __init__(self, p):\n        self.p = p\n    def predict(self, env, obj):\n        return {'probability': [self.p] * len(env)}\n",
    )
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "w.txt").write_text("0.75")
    (tmp_path / "link").symlink_to(path.parent)
    (tmp_path / "weights").symlink_to("other/w.txt")
    got, _ = answer(tmp_path / "link" / "model.py", isolation="bubblewrap", checkpoint=str(tmp_path / "weights"))
    assert (got.arrays["probability"] == 0.75).all()


def test_without_bubblewrap(tmp_path, monkeypatch):
    """Asked for by name, its absence is an error that says why; otherwise the next level is taken."""
    monkeypatch.setattr(bubblewrap, "missing", lambda: "bwrap is not installed")
    path = model(tmp_path, GOOD)
    with pytest.raises(
        UsageError, match=r"'bubblewrap' cannot be reached here: bwrap is not installed; pass --isolation auto"
    ):
        answer(path, isolation="bubblewrap")
    assert answer(path)[1]["level"] in ("landlock", "rlimits")


def test_why_it_is_missing(monkeypatch):
    """Not installed, and installed but not allowed, read differently."""
    monkeypatch.setenv("PATH", "/nowhere")
    assert missing.__wrapped__() == "bwrap is not installed"
    monkeypatch.undo()
    monkeypatch.setattr(bubblewrap, "PROGRAM", "false")
    assert missing.__wrapped__() == "false is not allowed to work (exit code 1)"


@needs_bubblewrap
def test_a_sandbox_that_does_not_start_is_named(tmp_path, monkeypatch):
    """If the start fails although the trial went well, bubblewrap's own words are shown."""
    monkeypatch.setattr(bubblewrap, "_FLAGS", (*bubblewrap._FLAGS, "--ro-bind", "/nowhere/at/all", "/x"))
    monkeypatch.setattr(bubblewrap, "missing", lambda: "")
    with pytest.raises(
        UsageError, match=r"could not be started \(bwrap: .*/nowhere/at/all.*; pass --isolation landlock"
    ):
        answer(model(tmp_path, GOOD))


@needs_bubblewrap
def test_crashes_are_named_as_without(tmp_path):
    """A model that dies by a signal is named by it, also from within its own process namespace."""
    with pytest.raises(ModelError, match="signal SIGSEGV"):
        answer(model(tmp_path, "import os; os.kill(os.getpid(), 11)"), isolation="bubblewrap")


@pytest.mark.parametrize("level", ["rlimits", "auto"])
def test_the_model_ends_with_a_killed_harness(tmp_path, level):
    """A harness that is killed without a chance to clean up takes the model with it."""
    mark = f"orphan-{os.getpid()}-{level}"
    path = model(
        tmp_path,
        f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60) #{mark}']); open('started', 'w'); time.sleep(60)",
    )
    run = f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r}); from material import *; from pathlib import Path; answer(Path({str(path)!r}), isolation={level!r})"
    harness = subprocess.Popen([sys.executable, "-c", run])
    end = time.monotonic() + 20
    while not _running(mark) and time.monotonic() < end:
        time.sleep(0.05)
    assert _running(mark)
    harness.send_signal(signal.SIGKILL)
    harness.wait()
    end = time.monotonic() + 5
    while _running(mark) and time.monotonic() < end and level != "rlimits":
        time.sleep(0.05)
    left = _running(mark)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    with HostedModel(path, TASKS["tube"], HostOptions(isolation=level)) as hosted:
        apart = hosted.isolation["processes"] == "namespace"
    assert not (left and apart)


def _running(mark: str) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if len(line) > 2 and line[1] == b"-c" and line[2].endswith(mark.encode()):
            found.append(int(path.parent.name))
    return found
