"""Speed of `eigenbench download` against curl, for the same files of a mirror on loopback.

    python tests/bench_download.py DATA         # DATA/<task>/<split>, finished splits: the mirror
    python tests/bench_download.py DATA --rate 125e6    # the server sends so many bytes a second in all

The server is a process of its own that sends files by sendfile. curl fetches and stores, one file after another or several
at a time (`curl -Z`); eigenbench also checks every digest and syncs, so that a third row gives curl with `sha256sum` and
`sync`. All write below --out, which is removed and the disk synced before the next begins; least of --repeats, and the
median of what each repeat gives as the ratio to its own curl.
"""

import argparse
import multiprocessing
import os
import shutil
import socket
import statistics
import subprocess
import threading
import time
from pathlib import Path

from eigenbench.bringing import JOBS, Options, bring
from eigenbench.cached_splits import files_of
from eigenbench.frozen import frozen_split
from eigenbench.manifest import Manifest
from eigenbench.shard_format import shard_name

BLOCK = 4 << 20
"""Bytes of one call of sendfile."""


class Rate:
    """Lets so many bytes a second pass, whichever connection they go through."""

    def __init__(self, rate: float) -> None:
        self._rate, self._next, self._lock = rate, 0.0, threading.Lock()

    def wait(self, size: int) -> None:
        """Wait until `size` more bytes may go."""
        with self._lock:
            now = time.monotonic()
            self._next = max(now, self._next) + size / self._rate
            until = self._next
        time.sleep(max(0.0, until - now))


def serve(folder: Path, ready: "multiprocessing.Queue[int]", rate: float) -> None:
    """Answer GET requests for files of a folder, one a connection."""
    bound = Rate(rate)
    listener = socket.create_server(("127.0.0.1", 0))
    ready.put(listener.getsockname()[1])
    while True:
        connection, _ = listener.accept()
        threading.Thread(target=_answer, args=(folder, connection, bound), daemon=True).start()


def _answer(folder: Path, connection: socket.socket, rate: Rate) -> None:
    with connection:
        request = b""
        while b"\r\n\r\n" not in request:
            request += connection.recv(65536)
        name = request.split()[1].decode().lstrip("/")
        with (folder / name).open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            head = f"HTTP/1.1 200 OK\r\nContent-Length: {size}\r\nConnection: close\r\n\r\n"
            connection.sendall(head.encode())
            done = 0
            while done < size:
                block = min(BLOCK, size - done)
                rate.wait(block)
                sent = 0
                while sent < block:
                    sent += os.sendfile(connection.fileno(), file.fileno(), done + sent, block - sent)
                done += block


def curl(address: str, manifest: Manifest, out: Path, *flags: str, keep: bool = False) -> float:
    """Return the seconds that curl takes for the files of a split."""
    recipe = manifest.recipe
    folder = f"{address}/{recipe.data_version}/{recipe.task}/{recipe.split}"
    command = ["curl", "--silent", "--no-progress-meter", "--fail", *flags]
    for shard in files_of(manifest):
        command += ["-o", str(out / shard_name(*shard)), f"{folder}/{shard_name(*shard)}"]
    out.mkdir(parents=True)
    begun = time.perf_counter()
    subprocess.run(command, check=True)
    seconds = time.perf_counter() - begun
    if not keep:
        clear(out)
    return seconds


def clear(folder: Path) -> None:
    """Remove what was fetched, and wait until the disk has forgotten it: the next one shall not wait for that."""
    shutil.rmtree(folder)
    os.sync()


def curl_checked(address: str, manifest: Manifest, out: Path) -> float:
    """Return the seconds of curl, sha256sum of what came, and fsync: what eigenbench does besides fetching."""
    begun = time.perf_counter()
    curl(address, manifest, out, keep=True)
    subprocess.run(["sha256sum", *out.iterdir()], check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["sync", *out.iterdir()], check=True)
    seconds = time.perf_counter() - begun
    clear(out)
    return seconds


def ours(address: str, manifest: Manifest, out: Path, jobs: int) -> float:
    """Return the seconds that a download into an empty cache takes."""
    os.environ["EIGENBENCH_CACHE"] = str(out)
    begun = time.perf_counter()
    brought = bring(manifest, Options([address], jobs=jobs))
    seconds = time.perf_counter() - begun
    assert brought.fetched == {address: len(files_of(manifest))}
    clear(out)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--task", default="tube")
    parser.add_argument("--split", default="test")
    parser.add_argument("--jobs", type=int, default=JOBS)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--rate", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path, default=Path("out/bench-download"))
    asked = parser.parse_args()
    manifest = frozen_split(asked.task, asked.split)
    shutil.rmtree(asked.out, ignore_errors=True)
    root = asked.out / "mirror"
    root.mkdir(parents=True)
    (root / manifest.recipe.data_version).symlink_to(asked.data.resolve())
    ready: multiprocessing.Queue[int] = multiprocessing.Queue()
    server = multiprocessing.Process(target=serve, args=(root, ready, asked.rate), daemon=True)
    server.start()
    address = f"http://127.0.0.1:{ready.get()}"
    place = asked.data / asked.task / asked.split
    size = sum((place / shard_name(*shard)).stat().st_size for shard in files_of(manifest))
    times: dict[str, list[float]] = {"curl": [], "curl -Z": [], "curl, sha256sum, sync": [], "eigenbench": []}
    for k in range(asked.repeats):
        work = asked.out / str(k)
        times["curl"].append(curl(address, manifest, work / "curl"))
        times["curl -Z"].append(curl(address, manifest, work / "curl-z", "-Z", "--parallel-max", str(asked.jobs)))
        times["curl, sha256sum, sync"].append(curl_checked(address, manifest, work / "checked"))
        times["eigenbench"].append(ours(address, manifest, work / "ours", asked.jobs))
    least = {name: min(seconds) for name, seconds in times.items()}
    print(f"{asked.task}/{asked.split}, {size / 1e6:,.0f} MB, {asked.jobs} jobs, least of {asked.repeats}")
    for name, seconds in least.items():
        ratio = least["curl"] / seconds
        median = statistics.median(a / b for a, b in zip(times["curl"], times[name], strict=True))
        rate = size / seconds / 1e6
        print(f"{name:24}{seconds:8.2f} s{rate:8,.0f} MB/s   {ratio:.2f} of the speed of curl, median {median:.2f}")
    server.terminate()
    shutil.rmtree(asked.out)


if __name__ == "__main__":
    main()
