"""How long the built-in library takes to build on one core, kernels compiled: `make bench`."""

import os
import tempfile
import time
from pathlib import Path


def main() -> None:
    """Build every role and split into an empty shape cache and print the seconds."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    from eigenbench.generators import library
    from eigenbench.generators.catalogue import make_shape
    from eigenbench.generators.holdings import ROLES
    from eigenbench.tasks import SPLITS

    library.normalise(make_shape("mug", "mug", 0))  # compiles or fetches the kernels
    total = 0.0
    with tempfile.TemporaryDirectory() as folder:
        library.cache_folder = lambda: Path(folder)
        for role in ROLES:
            for split in SPLITS:
                start = time.perf_counter()
                shapes = library.load_library("default", split, role)
                seconds = time.perf_counter() - start
                total += seconds
                print(f"{role:12} {split:6} {len(shapes.names):5} shapes {seconds:6.2f} s  digest {shapes.digest[:16]}")
    print(f"the whole library, one core: {total:.1f} s")


if __name__ == "__main__":
    main()
