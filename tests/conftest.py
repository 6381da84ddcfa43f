"""Shared fixtures: one small data set, one folder of meshes, and where the real meshes lie."""

import os
import shutil
import signal
from pathlib import Path

import pytest
from boarded import make_board, make_data, make_run, noisy
from material import EVERY, box_mesh, write_obj

from eigenbench.generators.generation import generate
from eigenbench.tasks import MULTI_TASK

# A shell's background job ignores Ctrl-C, and what it starts would inherit that: tests send it to what they start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def small(tmp_path_factory) -> Path:
    """Return the output folder of 300 tube pairs a split."""
    out = tmp_path_factory.mktemp("small")
    generate("tube", pairs=300, out=out, workers=1)
    return out


@pytest.fixture(scope="session")
def test_split(small) -> Path:
    """Return the test split of the small data set."""
    return small / "tube" / "test"


@pytest.fixture(scope="session")
def every_task(tmp_path_factory) -> dict[str, Path]:
    """Return a small test split of every task and of a box with a lonely floor."""
    out = tmp_path_factory.mktemp("every")
    return {name: next(iter(generate(name, "test", 80, out, workers=1, audit=0.0))) for name in EVERY}


@pytest.fixture(scope="session")
def real_meshes() -> Path:
    """Return the folder of real third-party meshes, or skip with the reason."""
    folder = os.environ.get("EIGENBENCH_TEST_MESHES")
    if not folder:
        pytest.skip("EIGENBENCH_TEST_MESHES does not name a folder of real meshes")
    return Path(folder)


@pytest.fixture
def mesh_folder(tmp_path) -> Path:
    """Return a folder with two training and one test mesh."""
    folder = tmp_path / "meshes"
    write_obj(folder / "box" / "cube.obj", box_mesh(1, 1, 1))
    write_obj(folder / "can" / "long.obj", box_mesh(100, 30, 20))
    write_obj(folder / "jar" / "jar.obj", box_mesh(2, 1, 1))
    return folder


@pytest.fixture(scope="session")
def board_data(tmp_path_factory) -> Path:
    """Return the root of small test splits of two tasks, large enough for a board."""
    return make_data(tmp_path_factory.mktemp("board-data"), "tube", "sphere")


@pytest.fixture(scope="session")
def board_runs(tmp_path_factory, board_data) -> dict[str, Path]:
    """Return runs on them: a good and a bad measurer, a probability, three seeds, one on the other task."""
    out, tube = tmp_path_factory.mktemp("board-runs"), board_data / "tube" / "test"
    made = {
        "good": noisy(tube, 0.01, vectors=True),
        "bad": noisy(tube, 0.2),
        "chance": noisy(tube, 0.5, lengths=False),
        **{f"seed-{k}": noisy(tube, 0.1, k + 1) for k in range(3)},
    }
    runs = {name: make_run(out / name, tube, predictions) for name, predictions in made.items()}
    sphere = board_data / "sphere" / "test"
    return runs | {"sphere": make_run(out / "sphere", sphere, noisy(sphere, 0.05))}


@pytest.fixture(scope="session")
def whole_board(tmp_path_factory, board_data, board_runs) -> Path:
    """Return a board with entries 1 to 3 on one task and 4 on the other; tests that change it take a copy."""
    runs = [board_runs[name] for name in ("good", "bad", "chance", "sphere")]
    return make_board(tmp_path_factory.mktemp("boards") / "board", board_data, runs)


@pytest.fixture
def board(whole_board, tmp_path) -> Path:
    """Return a board of a test's own."""
    return Path(shutil.copytree(whole_board, tmp_path / "board"))


@pytest.fixture(scope="session")
def box_suite(tmp_path_factory) -> Path:
    """Return the output folder of 400 training pairs of each task of the multi-task suite, and 100 test pairs of box."""
    out = tmp_path_factory.mktemp("suite")
    names = (*MULTI_TASK, "box")
    generate(",".join(names), "train", 400, out, workers=1, audit=0.0)
    generate("box", "test", 100, out, workers=1, audit=0.0)
    return out
