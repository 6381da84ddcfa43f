"""Shards on a Dask cluster of real processes: the same bytes, whoever dies, and one sentence for each trouble."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from eigenbench.errors import EigenbenchError, GenerationError, UsageError
from eigenbench.generators import cluster
from eigenbench.generators.cluster import Cluster
from eigenbench.generators.generation import generate
from eigenbench.generators.installation import differences, installation
from eigenbench.generators.library import LibraryReference, find_library
from eigenbench.generators.workers import open_pool
from eigenbench.manifest import read_manifest

PAIRS = 7_500


class Processes:
    """A scheduler and its workers, killed at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        self.workers: list[subprocess.Popen] = []

    def start(self, role: str, *arguments: str, flags: tuple[str, ...] = (), **environment: str) -> subprocess.Popen:
        """Start a scheduler or a worker."""
        command = [sys.executable, *flags, "-m", "distributed.cli.dask_" + role, "--no-dashboard", *arguments]
        with (self.folder / f"{role}.log").open("a") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | environment)

    def work(self, *arguments: str, **options) -> subprocess.Popen:
        """Start one more worker."""
        worker = self.start("worker", self.address, "--nthreads", "1", "--no-nanny", *arguments, **options)
        self.workers.append(worker)
        return worker

    def end(self) -> None:
        """Kill them all."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def processes(tmp_path, monkeypatch):
    """Give a scheduler without workers; the workers start elsewhere than the command."""
    monkeypatch.setenv("DASK_TEMPORARY_DIRECTORY", str(tmp_path))
    started = Processes(tmp_path)
    yield started
    started.end()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return the digest of the split that a single machine makes."""
    out = tmp_path_factory.mktemp("alone")
    generate("tube", "train", PAIRS, out, workers=2)
    return read_manifest(out / "tube" / "train").digest


def wait_for(condition, seconds: float = 90.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened in time"
        time.sleep(0.01)


def test_a_killed_worker_changes_no_byte(processes, alone, tmp_path, monkeypatch):
    """Of two workers one is killed in the middle: the other makes its shards too, and the digest is the same."""
    monkeypatch.chdir(tmp_path)
    processes.work()
    processes.work()
    seen = []

    def progress(_split: str, done: int, _total: int) -> None:
        if not seen:
            processes.workers[0].kill()
        seen.append(done)

    made = generate("tube", "train", PAIRS, "out", scheduler=processes.address, progress=progress)
    assert made[Path("out/tube/train")].digest == alone
    assert seen[-1] == PAIRS
    assert processes.workers[0].wait() == -signal.SIGKILL
    assert processes.workers[1].poll() is None, "the worker belongs to the cluster and stays"


def test_a_killed_scheduler_is_one_line_and_the_command_goes_on(processes, alone, tmp_path):
    """Dask's log stays off the terminal, finished shards stay, and the same split can be ended anywhere."""
    processes.work()
    out = tmp_path / "out"
    command = ["generate", "--task", "tube", "--split", "train", "--pairs", str(PAIRS), "--out", str(out)]
    command = [sys.executable, "-m", "eigenbench", *command, "--scheduler", processes.address]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: list(out.rglob("targets-*.h5")))
    processes.scheduler.kill()
    printed, errors = running.communicate(timeout=60)
    lines = [line for line in errors.splitlines() if not line.startswith("train: ")]
    assert (running.returncode, printed, len(lines)) == (2, "", 1), errors
    assert re.match(r"error: The Dask scheduler tcp://\S+ is gone or no longer answers\. What is finished", lines[0])
    processes.workers[0].kill()
    processes.workers[0].wait()
    finished = {p: p.stat().st_mtime_ns for p in out.rglob("targets-*.h5")}
    assert generate("tube", "train", PAIRS, out, workers=1)[out / "tube" / "train"].digest == alone
    assert all(p.stat().st_mtime_ns == t for p, t in finished.items())


def test_ctrl_c_leaves_the_cluster(processes, tmp_path):
    """An interruption is one line and exit code 130, and the workers serve the next run."""
    processes.work()
    command = ["generate", "--task", "tube", "--split", "train", "--pairs", "20000", "--out", str(tmp_path / "out")]
    command = [sys.executable, "-m", "eigenbench", *command, "--scheduler", processes.address]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: list(tmp_path.rglob("targets-*.h5")))
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=30)
    lines = [line for line in errors.splitlines() if not line.startswith("train: ")]
    assert (running.returncode, len(lines)) == (130, 1), errors
    assert lines[0].startswith("error: interrupted. Finished shards are kept")
    with open_pool(scheduler=processes.address) as pool:
        assert list(pool.run(len, ["abc"])) == [3]


def test_a_cluster_without_workers(processes, tmp_path, monkeypatch):
    """None at the start, or all lost on the way: an error in bounded time."""
    monkeypatch.setattr(cluster, "PATIENCE_SECONDS", 3.0)
    with pytest.raises(GenerationError, match="has no worker, for 3 s now.*dask worker tcp://"):
        Cluster(processes.address)
    processes.work()
    monkeypatch.setattr(cluster, "PATIENCE_SECONDS", 30.0)
    with open_pool(scheduler=processes.address) as pool:
        monkeypatch.setattr(cluster, "PATIENCE_SECONDS", 3.0)
        processes.workers[0].kill()
        with pytest.raises(GenerationError, match="has lost all its workers, for 3 s now. What is finished is kept"):
            list(pool.run(len, ["job"]))


def test_what_a_job_raises_comes_back(processes):
    """An error of ours is raised as it was on the worker; a folder of shapes that it does not see is named."""
    processes.work()
    missing = LibraryReference(Path("/none.npz"), "meshes=/nowhere", "train", "object", "0" * 64)
    other = LibraryReference(Path("/none.npz"), "default", "train", "object", "0" * 64)
    with open_pool(scheduler=processes.address) as pool:
        with pytest.raises(GenerationError, match="has no object shapes: Shape folder /nowhere.*at the same path"):
            list(pool.run(find_library, [missing]))
        with pytest.raises(GenerationError, match="makes other object shapes from 'default': digest .* 000000000000"):
            list(pool.run(find_library, [other]))
        assert sorted(pool.run(len, ["a", "bb", "ccc"])) == [1, 2, 3]


def test_a_worker_with_another_installation(processes, tmp_path):
    """A worker that lacks the package, or has another version of a library that decides bytes, is named."""
    libraries = next(p for p in sys.path if p.endswith("site-packages"))
    bare = processes.work(flags=("-S",), PYTHONPATH=libraries)  # its .pth files are not read there
    with pytest.raises(
        GenerationError,
        match=r"Worker tcp://\S+ cannot load eigenbench: ModuleNotFoundError.*eigenbench.*Install eigenbench",
    ):
        Cluster(processes.address)
    bare.kill()
    bare.wait()
    preload = tmp_path / "other.py"
    preload.write_text("import numba\nnumba.__version__ = '0.0.1'\n")
    preload.write_text(
        "from eigenbench.generators import installation\nversions = installation._versions()\n"
        "installation._versions = lambda: versions | {'numba': '0.0.1'}\n"
    )
    processes.work("--preload", str(preload))
    rule = f"Worker tcp://\\S+ would make other bytes: numba 0.0.1 instead of {installation()['numba']}. Install"
    with pytest.raises(GenerationError, match=rule):
        wait_until_refused(processes.address)


def wait_until_refused(address: str) -> None:
    """Try again while the killed worker is still on the scheduler's list."""
    for _ in range(20):
        try:
            Cluster(address).close()
        except GenerationError as error:
            if "other bytes" in str(error):
                raise
        time.sleep(0.5)


def test_differences_name_versions_before_sources():
    """Sources differ with the versions; alone they are named."""
    mine = {"numba": "1", "sources of eigenbench.generators": "a"}
    assert differences(mine, mine) == []
    assert differences(mine, {"numba": "2", "sources of eigenbench.generators": "b"}) == ["numba 2 instead of 1"]
    assert differences(mine, {"numba": "1"}) == ["sources of eigenbench.generators missing instead of a"]


def test_a_scheduler_that_does_not_answer(monkeypatch):
    """A closed port, a silent one, a name that is none, and certificates that are missing."""
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 1.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        addresses = [f"tcp://127.0.0.1:{free_port()}", f"tcp://127.0.0.1:{silent.getsockname()[1]}"]
        addresses += ["tcp://no.such.host.invalid:8786", f"tls://127.0.0.1:{free_port()}"]
        for address in addresses:
            start = time.monotonic()
            with pytest.raises(GenerationError, match=f"No Dask scheduler answers at {address} within 1.5 s"):
                Cluster(address)
            assert time.monotonic() - start < 6


@pytest.mark.parametrize("address", ["localhost", "localhost:8786", "http://host:1", "tcp://host", "tcp://:1", ""])
def test_what_is_no_address(address):
    """An address is written as Dask prints it."""
    with pytest.raises(UsageError, match=f"Scheduler '{address}' is not an address; write it as"):
        Cluster(address)


def test_workers_belong_to_the_cluster(tmp_path):
    """A number of workers beside a scheduler is refused, before anything is asked or made."""
    with pytest.raises(UsageError, match="--workers 2 with --scheduler tcp://h:1: a cluster has its own workers"):
        generate("tube", "test", 10, tmp_path / "o", workers=2, scheduler="tcp://h:1")
    assert not (tmp_path / "o").exists()


def test_dask_is_an_extra(monkeypatch):
    """Without it --scheduler says what to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"needs Dask .*pip install 'eigenbench\[cluster\]'"):
        Cluster("tcp://localhost:1")


def test_a_lost_job_is_told(monkeypatch):
    """A job that took several workers with it ends the run with the likely cause."""
    from concurrent.futures import Future

    from distributed import KilledWorker

    future: Future[int] = Future()
    future.set_exception(KilledWorker("job", SimpleNamespace(address="tcp://w:1"), 3))
    pool = Cluster.__new__(Cluster)
    pool._address = "tcp://h:1"
    with pytest.raises(EigenbenchError, match="lost with its worker again and again.*out of memory"):
        pool._result(future)
