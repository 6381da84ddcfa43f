"""Limits in sum: processes, memory, disk and time of all that a model starts."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hostile_runs import ATTACKS, expected_to_win, levels, run_attack
from material import GOOD, answer, model

from eigenbench.errors import ModelError, UsageError
from eigenbench.hosting import HostOptions
from eigenbench.watchdog import Limits, Watchdog, end_tree, over_disk, own_memory, tree_of, watchable

pytestmark = pytest.mark.skipif(not watchable(), reason="this machine does not tell which processes descend from which")
STRONGEST = [level for level, reason in levels().items() if not reason][-1]
SAID = {
    "processes": r"was ended in predict: it started \d+ processes, more than the 24 allowed",
    "memory": r"MemoryError",
    "memory_of_many": r"was ended in predict: its processes use [\d.]+ GiB of memory, more than 0.75 GiB",
    "memory_files": r"was ended in predict: its nameless files take",
    "disk": r"was ended in predict: its scratch files and output take|No space left",
    "disk_of_many": r"was ended in predict: its scratch files and output take|No space left",
    "nameless_file": r"was ended in predict: its nameless files take|No space left",
    "output": r"was ended in predict: its scratch files and output take",
    "sleep": r"gave no answer in predict within 2 s",
    "daemon": r"its daemon",
}


@pytest.mark.parametrize("name", ATTACKS["floods"])
def test_floods_are_stopped(name):
    """Each flood ends at the strongest level with a sentence that names the limit."""
    outcome = run_attack("floods", name, STRONGEST, timeout=2.0 if name == "sleep" else 20.0)
    assert outcome.won is expected_to_win("floods", name, STRONGEST)
    assert re.search(SAID[name], outcome.said), outcome.said


@pytest.mark.parametrize("name", ["disk", "memory_of_many"])
def test_sums_hold_without_a_sandbox(name):
    """The watchdog alone, where nothing else guards, stops what takes too much in sum."""
    outcome = run_attack("floods", name, "rlimits", timeout=20.0)
    assert not outcome.won
    assert "more than" in outcome.said


def test_a_tree_is_found_and_ended():
    """A process, its child and its grandchild are found from the first, and end together."""
    nested = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', sys.argv[1], '']) if len(sys.argv) > 1 and sys.argv[1] else 0; time.sleep(60)"
    deep = "import subprocess, sys, time\nsubprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\ntime.sleep(60)"
    first = subprocess.Popen([sys.executable, "-c", nested, deep])
    end = time.monotonic() + 10
    tree = tree_of(first.pid)
    while (len(tree) < 3 or min(map(own_memory, tree)) <= 1e6) and time.monotonic() < end:  # a new process is empty
        time.sleep(0.05)
        tree = tree_of(first.pid)
    assert tree[0] == first.pid
    assert len(tree) == 3
    assert all(own_memory(pid) > 1e6 for pid in tree)
    end_tree(first.pid)
    first.wait(5)
    end = time.monotonic() + 5
    while any(_runs(pid) for pid in tree) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(_runs(pid) for pid in tree)
    assert tree_of(first.pid) == []


def _runs(pid: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


def test_disk_is_counted_to_any_depth(tmp_path):
    """Files count wherever they lie; a folder below its limit, and one that is gone, are not over it."""
    here = Path.cwd()
    try:
        os.chdir(tmp_path)
        for _ in range(2500):
            Path("d").mkdir()
            os.chdir("d")
        Path("deep").write_bytes(b"x" * (3 << 20))
    finally:
        os.chdir(here)
    assert "more than 0.00 GiB" in over_disk(tmp_path, 2 << 20)
    assert over_disk(tmp_path, 1 << 30) == ""
    assert over_disk(tmp_path / "nowhere", 0) == ""
    subprocess.run(["rm", "-rf", tmp_path / "d"], check=True)


def test_a_well_behaved_model_is_left_alone(tmp_path):
    """Threads, a few processes and some memory are nothing to be ended for."""
    body = (
        "import threading; [threading.Thread(target=lambda: None).start() for _ in range(200)]; x = np.ones(10**7); "
        + GOOD
    )
    got, isolation = answer(model(tmp_path, body), memory_gib=1.5, processes=8)
    assert (got.arrays["probability"] == 0.5).all()
    assert isolation["sums"] == "watched"


def test_watching_ends(tmp_path):
    """A stopped watchdog leaves the process alone, and its thread is gone."""
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    watchdog = Watchdog(process.pid, tmp_path, Limits(1, 1, 1 << 30))
    watchdog.stop()
    broken = watchdog.broken
    process.kill()
    process.wait()
    assert broken == "" or "memory" in broken


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scratch_gib": 0.0}, "The scratch limit is 0 GiB; it must be from 0.001"),
        ({"processes": 1}, "The limit of processes is 1; it must be from 8"),
        ({"memory_gib": 0.01}, "The memory limit is 0.01 GiB"),
    ],
)
def test_limits_are_checked(options, message):
    """Limits under which no model could start are refused."""
    with pytest.raises(UsageError, match=message):
        HostOptions(**options)


def test_the_limit_is_told_in_build_too(tmp_path):
    """A model that takes too much before it is built is named with the phase."""
    text = "import os, time\nfor _ in range(30):\n    if os.fork() == 0:\n        time.sleep(5)\n        os._exit(0)\ntime.sleep(5)\n"
    with pytest.raises(ModelError, match=r"was ended in build: it started \d+ processes, more than the 16 allowed"):
        answer(model(tmp_path, text), processes=16)
