"""The import rule, the installed packages, light imports, documents that match their tables."""

import ast
import configparser
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from material import EXAMPLES, ROOT

from eigenbench.shard_format import FIELDS, FILES, REASONS, fields_of

FOLDERS = {"benchmark": "eigenbench", "generators": "eigenbench.generators"}
FOLDERS |= {name: f"eigenbench.{name}" for name in ("baselines", "leaderboard")}
FOLDERS["baselines/experiments"] = "eigenbench.baselines.experiments"
ASKS_GENERATORS = "benchmark/shape_cavities.py"
"""The one module of benchmark/, beside the command line, that reaches into generators, inside a function."""
COMMAND_LINE = tuple(
    f"cli{name}.py"
    for name in (
        "",
        "_data",
        "_hidden",
        "_host",
        "_leaderboard",
        "_navigate",
        "_report",
        "_shapes",
        "_splits",
        "_train",
    )
)
TARGETS = ["help", "demo", "test", "check", "bench", "freeze", "verify-splits", "clean"]
HEAVY = ("torch", "numba", "fcl", "trimesh", "pandas", "plotly", "scipy", "h5py", "numpy", "rich", "PIL")
HEAVY += ("distributed", "fsspec", "matplotlib")


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return {name for name in found if name.split(".")[0] == "eigenbench"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_imports_follow_the_flow(folder):
    """Each folder imports itself and benchmark/; only the command line reaches into the others."""
    others = [f for f in FOLDERS if f not in (folder, "benchmark") and not folder.startswith(f"{f}/")]
    for path in (ROOT / folder).glob("*.py"):
        command_line = path.name in COMMAND_LINE
        if command_line or f"{folder}/{path.name}" == ASKS_GENERATORS:
            continue
        for name in imports_of(path):
            assert not any(name.startswith(FOLDERS[o]) for o in others), f"{path.name} imports {name}"


def test_cli_imports_inside_its_commands():
    """The modules of the command line load other folders only when a command runs."""
    light = {
        "eigenbench._version",
        "eigenbench.cli_data",
        "eigenbench.cli_hidden",
        "eigenbench.cli_host",
        "eigenbench.cli_leaderboard",
        "eigenbench.cli_navigate",
        "eigenbench.cli_report",
        "eigenbench.cli_shapes",
        "eigenbench.cli_splits",
        "eigenbench.cli_train",
        "eigenbench.console",
        "eigenbench.errors",
        "eigenbench.tasks",
    }
    for name in (*COMMAND_LINE, "console.py"):
        top = ast.parse((ROOT / "benchmark" / name).read_text()).body
        names = [n.module for n in top if isinstance(n, ast.ImportFrom)]
        assert {n for n in names if n and n.startswith("eigenbench.")} <= light


def test_cavities_of_shapes_are_asked_for_inside_a_function():
    """The module that asks generators for cavities imports them only where it does, and nothing but the library."""
    path = ROOT / ASKS_GENERATORS
    top = {n.module or "" for n in ast.parse(path.read_text()).body if isinstance(n, ast.ImportFrom)}
    assert not any(name.startswith("eigenbench.generators") for name in top)
    inside = {name for name in imports_of(path) if name.startswith("eigenbench.generators")}
    assert inside == {"eigenbench.generators.library"}


def test_engines_live_behind_one_module_each():
    """python-fcl, manifold3d, trimesh, numba, h5py, Pillow, Dask and fsspec are imported by one module each."""
    homes: dict[str, set[str]] = {}
    for folder in FOLDERS:
        for path in (ROOT / folder).glob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                modules += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
                for module in modules:
                    homes.setdefault(module.split(".")[0], set()).add(path.name)
    expected = {"fcl": "fcl_engine.py", "manifold3d": "solids.py", "trimesh": "meshes.py"}
    expected |= {"numba": "compiled.py", "h5py": "shards.py"}
    expected |= {
        "PIL": "contact_sheets.py",
        "matplotlib": "figures.py",
        "distributed": "cluster.py",
    }
    for engine, home in expected.items():
        assert homes[engine] == {home}
    assert homes["fsspec"] == {"addresses.py", "mirrors.py"}  # one writes, the other reads
    learners = {path.name for path in (ROOT / "baselines").rglob("*.py")}
    assert homes["torch"] - learners == {"model_host.py", "checkpoints.py"}


def test_every_source_folder_is_installed():
    """setup.cfg lists each folder that holds modules, and nothing else."""
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    mapping = dict(line.split(" = ") for line in config["options"]["package_dir"].split("\n") if line)
    assert mapping == {v: k for k, v in FOLDERS.items()}
    assert set(config["options"]["packages"].split()) == {"eigenbench"} | set(mapping)
    for folder in FOLDERS:
        nested = {p.parent for p in (ROOT / folder).rglob("*.py")} - {ROOT / f for f in FOLDERS}
        assert not nested, f"{nested} would be missing from the wheel: list them in setup.cfg"


def test_wheel_holds_only_eigenbench(tmp_path):
    """A built wheel installs one top-level package, with every module."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        tmp_path,
        ROOT,
    ]
    subprocess.run(command, check=True, capture_output=True)
    names = zipfile.ZipFile(next(tmp_path.glob("*.whl"))).namelist()
    assert {n.split("/")[0] for n in names if ".dist-info/" not in n} == {"eigenbench"}
    assert {"eigenbench/cli.py", "eigenbench/generators/tube.py", "eigenbench/py.typed"} <= set(names)
    assets = {f"eigenbench/assets/{p.name}" for p in (ROOT / "benchmark" / "assets").iterdir()}
    assert assets
    assert assets <= set(names)


def test_import_is_light():
    """`import eigenbench` and the command line's module load no heavy library."""
    code = f"import sys, eigenbench, eigenbench.cli; print([m for m in {HEAVY} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert shown.stdout.strip() == "[]"


def test_public_names_exist():
    """Every name in __all__ can be fetched, and no module shadows a function."""
    import eigenbench

    for name in eigenbench.__all__:
        assert getattr(eigenbench, name) is not None
    for name in ("evaluate", "score", "check", "load", "verify", "generate"):
        assert callable(getattr(eigenbench, name))
        assert not (ROOT / "benchmark" / f"{name}.py").exists()
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = eigenbench.nothing


def test_data_md_lists_every_field():
    """DATA.md's tables are the format table: names, types, rows, units and meanings."""
    text = (ROOT / "DATA.md").read_text()
    for file in FILES:
        for field in fields_of(file):
            row = "(" + ", ".join(["n", *map(str, field.row)]) + ")"
            bits = "" if field.bits is None else f"2^-{field.bits}"
            line = f"| `{field.name}` | `{field.dtype}` | {row} | {field.unit} | {bits} | {field.meaning} |"
            assert line in text, f"DATA.md lacks: {line}"
    for name, code in REASONS.items():
        assert f"| {code} | `{name}` |" in text
    assert len(re.findall(r"^\| `\w+` \| `[<|]", text, re.M)) == len(FIELDS)


def test_readme_names_the_commands_that_exist():
    """README, DATA.md and docs mention every command and none that the program lacks; every example file exists."""
    from eigenbench.cli import app

    groups = {group.name: group.typer_instance for group in app.registered_groups}
    known = {(c.name or c.callback.__name__) for c in app.registered_commands}
    known |= {f"{name} {c.name}" for name, group in groups.items() for c in group.registered_commands}
    text = (ROOT / "README.md").read_text() + (ROOT / "DATA.md").read_text()
    text += "".join(p.read_text() for p in sorted((ROOT / "docs").glob("*.md")))
    words = re.findall(r"^(?:\$ )?eigenbench (\w+)(?: (\w+))?", text, re.M)
    used = {f"{first} {second}" if first in groups else first for first, second in words}
    assert used <= known
    assert known <= used
    for name in re.findall(r"examples/([a-z_]+\.py)", text):
        assert (EXAMPLES / name).is_file()


def test_makefile_targets():
    """`make help` lists the targets of the contract."""
    command = ["make", "--silent", "--no-print-directory", "help"]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}  # this may run below a make
    shown = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout
    assert [line.split()[0] for line in shown.splitlines()] == TARGETS
