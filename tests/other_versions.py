"""Make the first shard of every frozen split with other Pythons, library versions and processors, and compare digests.

    python tests/other_versions.py                                  # oldest and newest allowed libraries, lesser processors
    python tests/other_versions.py --python python3.12 --python python3.13 --only locked
    python tests/other_versions.py --only oldest tube fit

Each surrounding is an environment of its own below --out, with its own cache; those that are there are used again.
`locked` takes the versions of constraints.txt, `oldest` the lower bounds of setup.cfg (of `numpy>=2.0` the latest 2.0.x),
`newest` whatever the index has. The lesser processors are imitated in the first interpreter's locked versions.
Prints a row of a Markdown table for each, and ends with 1 if any differs.
"""

import argparse
import configparser
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHOWN = ("numpy", "scipy", "numba", "h5py", "trimesh", "python-fcl", "manifold3d")
"""Libraries on which the bytes of a split could depend."""
PROCESSORS = {
    "numpy without AVX2, FMA3, AVX512": {"NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX"},
    "OpenBLAS for Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "numba for a generic processor": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}
"""Environment variables that make libraries take the code of another processor."""


def requirements(choice: str) -> list[str]:
    """Return what pip shall install of the core's requirements: `locked`, `oldest` or `newest`."""
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    asked = config["options"]["install_requires"].split()
    if choice == "oldest":
        return [f"{line.replace('>=', '==')}.*" for line in asked]
    return ["-c", str(ROOT / "constraints.txt"), *asked] if choice == "locked" else ["--upgrade", *asked]


def environment(python: str, choice: str, out: Path) -> Path:
    """Make an environment with the package and its libraries, if it is not there; return its interpreter."""
    place = out / f"{Path(python).name if '/' not in python else python.strip('/').replace('/', '-')}-{choice}"
    own = place / "bin" / "python"
    if not (place / "ready").is_file():
        subprocess.run([python, "-m", "venv", "--clear", place], check=True)
        pip = [str(own), "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-compile"]
        subprocess.run([*pip, *requirements(choice)], check=True, stderr=subprocess.DEVNULL)
        (place / "ready").touch()
    again = [
        str(own),
        "-m",
        "pip",
        "--disable-pip-version-check",
        "install",
        "--quiet",
        "--no-deps",
        "--force-reinstall",
    ]
    subprocess.run([*again, str(ROOT)], check=True, stderr=subprocess.DEVNULL)
    return own


def versions(python: Path) -> str:
    """Return the interpreter's version and those of the libraries in it."""
    code = (
        "import sys, importlib.metadata as m; print('.'.join(map(str, sys.version_info[:3])), "
        f"*(m.version(n) for n in {SHOWN}), sep=' | ')"
    )
    return subprocess.run([python, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def compared(python: Path, tasks: list[str], records: Path | None, extra: dict[str, str]) -> str:
    """Make the first shards there and return what came out: equal, or what differs."""
    cache = {"EIGENBENCH_CACHE": str(python.parents[1] / "cache"), "PYTHONWARNINGS": "ignore"}
    where = ["--records", str(records)] if records else []
    command = [str(python), str(ROOT / "tests" / "freeze.py"), "--check", "--first", *where, *tasks]
    found = subprocess.run(command, env=os.environ | cache | extra, capture_output=True, text=True, check=False)
    if found.returncode == 0:
        return f"equal ({len(found.stdout.splitlines())} tasks)"
    lines = [line for line in found.stderr.splitlines() if line.strip()]
    return "**differs**: " + "; ".join(line[:160] for line in lines[-12:])


def main() -> int:
    """Run what is asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", help="default: all that are frozen")
    parser.add_argument("--python", action="append", help="an interpreter; may be repeated; default: this one")
    parser.add_argument("--only", choices=("oldest", "newest", "locked", "processors"), action="append")
    parser.add_argument("--records", type=Path, help="where the records lie, if not in the package")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "versions")
    asked = parser.parse_args()
    failed = False
    print(f"| python | {' | '.join(SHOWN)} | processor | first shards |\n|{'---|' * (len(SHOWN) + 3)}", flush=True)
    for number, python in enumerate(asked.python or [sys.executable]):
        for choice in asked.only or ("oldest", "newest", "processors"):
            masked = choice == "processors"
            if masked and number:
                continue
            own = environment(python, "locked" if masked else choice, asked.out.resolve())
            for name, extra in PROCESSORS.items() if masked else [("this one", {})]:
                told = compared(own, asked.tasks, asked.records, extra)
                failed |= not told.startswith("equal")
                print(f"| {versions(own)} | {name} | {told} |", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
