"""A board of 1,000 entries on one task: seconds to verify it without scores, to build its site, until a page is usable.

    PYTHONPATH=tests python tests/bench_leaderboard.py --run runs/x --data data [--entries 1000] [--browser]

The entries are copies of a real run's with other lengths, so their files have real sizes.
"""

import argparse
import json
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from eigenbench.frozen_subsets import ANALYSIS_PAIRS
from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.boards import open_board, read_manifests
from eigenbench.leaderboard.chain import RECORD, append_record, read_chain
from eigenbench.leaderboard.pack_scores import replicates_bytes
from eigenbench.leaderboard.packing import pack_bytes, read_pack
from eigenbench.leaderboard.records import sha256
from eigenbench.leaderboard.site import build_site
from eigenbench.leaderboard.submission import About, submit

USABLE = """(() => {
  const started = performance.now();
  const button = document.querySelectorAll('#content thead button')[2];
  button.click();
  document.body.offsetHeight;
  const sorted = performance.now();
  const least = document.getElementById('words');
  least.value = '7'; least.dispatchEvent(new Event('input', {bubbles: true}));
  document.body.offsetHeight;
  const t = performance.getEntriesByType('navigation')[0];
  return [t.domInteractive, t.loadEventEnd, sorted - started, performance.now() - sorted];
})()"""


def fill(board: Path, count: int) -> None:
    """Append copies of entry 1 that differ in their name, the scale of their lengths, accuracy and replicates."""
    links = read_chain(board)
    first = links[1]
    content = (first.folder / "run-1.npz").read_bytes()
    pack = read_pack(content, "entry 1", first.record.body["data"]["pairs"], ANALYSIS_PAIRS)
    result = json.loads((first.folder / "run-1.json").read_text())
    rng = np.random.default_rng(0)
    shared = rng.normal(0, 0.004, 1000)
    for k in range(len(links), count + 1):
        value = float(rng.uniform(0.6, 0.99))
        body = json.loads(json.dumps(first.record.body))
        digest = sha256(str(k).encode())
        own = json.dumps(result | {"predictions_digest": digest}, indent=1).encode()
        replicates = {name: value + shared + rng.normal(0, 0.003, 1000) for name in body["scores"]}
        scaled = {name: values * (1 + k * 1e-4) for name, values in pack.analysis.items()}
        packed = pack_bytes(replace(pack, analysis=scaled))
        files = {"run-1.json": own, "run-1.npz": packed, "replicates.npz": replicates_bytes(replicates)}
        body["model"] |= {"name": f"model number {k}", "parameters": k * 1000}
        body["runs"][0] |= {"predictions": digest, "result": sha256(own), "pack": sha256(packed)}
        body["replicates"] = sha256(files["replicates.npz"])
        body["scores"]["accuracy"] = {"value": value, "low": value - 0.01, "high": value + 0.01, "deviation": None}
        links.append(append_record(board, links, "entry", body, files))


def best_of(what, times: int = 3) -> float:
    """Return the least seconds of several calls."""
    found = []
    for _ in range(times):
        started = time.perf_counter()
        what()
        found.append(time.perf_counter() - started)
    return min(found)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--browser", action="store_true", help="also open the page in Chromium")
    parser.add_argument("--keep", type=Path, help="leave board and site in this folder")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = asked.keep or Path(scratch)
        board, site = place / "board", place / "site"
        if not (board / "00000").is_dir():
            open_board(board, "bench", read_manifests([asked.data]))
            submit([asked.run], board, About("model number 1", "bench"), [asked.data])
            fill(board, asked.entries)
        bytes_of_it = sum(p.stat().st_size for p in board.rglob("*") if p.is_file())
        one = sum(p.stat().st_size for p in (board / "00001").glob("run-*.npz"))
        print(f"{len(read_chain(board)) - 1} entries, {bytes_of_it / 1e6:.0f} MB, predictions {one / 1e3:.0f} kB each")
        assert (board / "00001" / RECORD).is_file()
        print(f"verify without scores  {best_of(lambda: verify_board(board)):6.2f} s (aim 5)")
        print(f"site                   {best_of(lambda: build_site(board, site), 2):6.2f} s (aim 10)")
        print(f"largest memory         {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:6.0f} MiB")
        if asked.browser:
            _look(max(site.glob("task-*.html"), key=lambda p: p.stat().st_size))


def _look(path: Path) -> None:
    from browser import browser

    with browser() as page:
        found = []
        for _ in range(3):
            page.open(path)
            found.append(page.value(USABLE))
    usable, loaded, sort, search = np.min(found, axis=0) / 1000
    print(
        f"{path.name}, {path.stat().st_size / 1e6:.2f} MB: usable after {usable:.2f} s, loaded {loaded:.2f} s (aim 1)"
    )
    print(f"sorting {sort:.2f} s, filtering {search:.2f} s")


if __name__ == "__main__":
    main()
