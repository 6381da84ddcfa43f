"""Show that frozen splits arrive whole: two mirrors of which one lies, two kills, and no network at all.

    python tests/show_download.py DATA --task mug      # DATA/<task>/test, finished: what the mirrors send

Runs the command line as a user does, below a scratch folder that is removed. Ends with 1 if the digests are not the frozen
ones in the end, or if a byte that the good mirror sent before a kill was asked for again.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mirror

from eigenbench.cached_splits import files_of
from eigenbench.frozen import frozen_split
from eigenbench.shard_format import shard_name

EXAMPLE = Path(__file__).parents[1] / "examples" / "bounding_box.py"
EIGENBENCH = (sys.executable, "-m", "eigenbench")
RATE = 40e6
"""Bytes a second that the good mirror sends through each connection."""


def typed(*arguments: str, cache: Path, before: tuple[str, ...] = ()) -> float:
    """Run a command, show it and what it says, and return its seconds."""
    print(f"\n$ {' '.join((*before, 'eigenbench', *arguments))}", flush=True)
    begun = time.monotonic()
    environment = os.environ | {"EIGENBENCH_CACHE": str(cache), "no_proxy": "*", "EIGENBENCH_MIRRORS": ""}
    subprocess.run([*before, *EIGENBENCH, *arguments], env=environment, check=True)
    print(f"({time.monotonic() - begun:.1f} s)", flush=True)
    return time.monotonic() - begun


def killed(arguments: list[str], good: mirror.Server, share: int, cache: Path) -> None:
    """Start a download and kill it when the good mirror has sent so many bytes more."""
    environment = os.environ | {"EIGENBENCH_CACHE": str(cache), "no_proxy": "*"}
    before = good.total
    with subprocess.Popen([*EIGENBENCH, *arguments], env=environment, stderr=subprocess.DEVNULL) as process:
        while good.total - before < share and process.poll() is None:
            time.sleep(0.02)
        process.kill()
    parts = sorted(cache.rglob("*.part"))
    arrived = sum(p.stat().st_size for p in parts) / 1e6
    print(
        f"killed with {len(parts)} parts of {arrived:,.0f} MB, {len(list(cache.rglob('inputs-*.h5')))} inputs",
        flush=True,
    )


def from_two_mirrors(data: Path, task: str, scratch: Path) -> bool:
    """Download from a liar and a good mirror, killed twice; return whether nothing came twice."""
    manifest, cache = frozen_split(task, "test"), scratch / "cache"
    (scratch / "mirror").mkdir()
    (scratch / "mirror" / manifest.recipe.data_version).symlink_to(data.resolve())
    size = sum((data / task / "test" / shard_name(*shard)).stat().st_size for shard in files_of(manifest))
    with (
        mirror.serving(scratch / "mirror", mirror.lies) as liar,
        mirror.serving(scratch / "mirror", mirror.slowly(RATE)) as good,
    ):
        arguments = ["download", "--task", task, "--split", "test", "--mirror", liar.address, "--mirror", good.address]
        for _ in range(2):
            killed(arguments, good, size // 4, cache)
        typed(*arguments, cache=cache)
        # what a killed process had not read yet was sent, but never arrived
        lost = 2 * 4 * (8 << 20)
        print(
            f"{size / 1e6:,.1f} MB in all; the good mirror sent {good.total / 1e6:,.1f} MB, the liar {liar.total / 1e6:,.1f} MB"
        )
        typed("data", "verify", cache=cache)
        return good.total <= size + lost


def without_network(task: str, scratch: Path) -> None:
    """Evaluate on an empty cache where no network is: the split is made here."""
    cut_off = ("unshare", "--map-root-user", "--net") if shutil.which("unshare") else ()
    out = scratch / "run"
    typed("evaluate", str(EXAMPLE), "--task", task, "--out", str(out), cache=scratch / "empty", before=cut_off)
    typed("data", "list", cache=scratch / "empty")
    typed("score", str(out), cache=scratch / "empty", before=cut_off)


def main() -> int:
    """Show both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--task", default="tube")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        once = from_two_mirrors(asked.data, asked.task, Path(scratch))
        without_network(asked.task, Path(scratch))
    return 0 if once else 1


if __name__ == "__main__":
    sys.exit(main())
