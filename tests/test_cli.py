"""The command line, run as a user runs it: one-line errors, exit codes, JSON, the README's commands."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
from material import EXAMPLES, ROOT

BOX = str(EXAMPLES / "bounding_box.py")


def run(*arguments, cwd=None, **kwargs):
    command = [sys.executable, "-m", "eigenbench", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, **kwargs)


def fails(message, *arguments, code=2, **kwargs):
    """Run a command that must fail with one line on stderr that matches, nothing on stdout, no traceback."""
    done = run(*arguments, **kwargs)
    errors = [line for line in done.stderr.splitlines() if not re.match(r"(train|test|predicting): ", line)]
    assert done.returncode == code, done.stderr
    assert len(errors) == 1, done.stderr
    assert re.search(message, errors[0]), errors[0]
    assert errors[0].startswith("error: ")
    assert done.stdout == ""
    return done


def test_a_whole_session(tmp_path):
    """Generate, info, verify, verify --deep, check, evaluate, score: in a folder of one's own."""
    done = run("generate", "--task", "tube", "--pairs", 200, "--workers", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"data/tube/train: 200 pairs, .* 0 mismatches, digest \w{16}", done.stdout)
    assert "train: 200 of 200" in done.stderr
    assert "a probe that sees only the object" in run("info", "data", cwd=tmp_path).stdout
    assert run("verify", "data", cwd=tmp_path).stdout.count(": good, 200 pairs") == 2
    deep = run("verify", "data/tube/test", "--deep", "--workers", 2, cwd=tmp_path)
    assert "all 200 made and labelled again, 0 differences" in deep.stdout
    assert "FAIL" not in run("check", BOX, cwd=tmp_path).stdout
    done = run("evaluate", BOX, "--data", "data/tube/test", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = re.search(r"^run: (\S+)$", done.stdout, re.M).group(1)
    assert folder.startswith("runs/bounding_box-tube-test-")
    assert (tmp_path / folder / "report.html").is_file()
    assert (
        "equal to the stored result, to the last digit"
        in run("score", folder, "--data", "data/tube/test", cwd=tmp_path).stdout
    )


def test_json(small, tmp_path):
    """With --json each command prints one JSON value and nothing else."""
    split = small / "tube" / "test"
    out = json.loads(run("generate", "--task", "tube", "--pairs", 300, "--out", small, "--json").stdout)
    assert [m["recipe"]["split"] for m in out] == ["train", "test"]
    assert 0.3 < out[0]["positive_rate"] < 0.7
    assert json.loads(run("info", split, "--json").stdout)[0]["probes"]["majority"] >= 0.5
    assert json.loads(run("verify", split, "--json").stdout)[str(split)]["digest"] == out[1]["digest"]
    assert {f["passed"] for f in json.loads(run("check", BOX, "--json").stdout)} == {True, None}
    done = run("evaluate", BOX, "--data", split, "--out", tmp_path / "run", "--json")
    assert done.stderr == ""
    scores = json.loads(done.stdout)["scores"]
    again = json.loads(run("score", tmp_path / "run", "--data", split, "--json").stdout)
    assert again == {"scores": scores, "difference": ""}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--task", "tub"], "Unknown task 'tub'. Did you mean 'tube'"),
        (["--task", "tube,"], "Unknown task ''"),
        (["--task", "box-11001"], "Face subset of task 'box-11001' is '11001'; it must be six digits 0 or 1"),
        (["--task", "tube,box-110x10"], "Face subset of task 'box-110x10' is '110x10'"),
        (["--task", "box-101010"], "Task 'box-101010' binds no axis: .* so everything would fit. Let at least one"),
        (["--task", "tube", "--draws", "ratios"], "Unknown draws 'ratios'. Did you mean 'ratio'"),
        (["--task", "tube", "--pairs", "0"], "Number of pairs is 0"),
        (["--task", "tube", "--pairs", "-3"], "Number of pairs is -3"),
        (["--task", "tube", "--pairs", "many"], "Invalid value for '--pairs'"),
        (["--task", "tube", "--pears", "3"], "No such option.*--pears"),
        (["--task", "tube", "--shapes", "meshes=nowhere"], "Shape folder nowhere does not exist"),
        ([], "[Mm]issing option.*--task"),
    ],
)
def test_generate_errors(tmp_path, arguments, message):
    """Bad arguments: one line, code 2, nothing written."""
    fails(message, "generate", *arguments, cwd=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("task", "lack"),
    [("fit", "none serves as environment"), ("top", "none serves as env"), ("mug", "none serves as mug")],
)
def test_tasks_that_a_source_has_no_shapes_for(mesh_folder, tmp_path, task, lack):
    """A folder of objects alone cannot serve the tasks of library environments: one line, nothing written."""
    source = f"meshes={mesh_folder}"
    message = rf"has 3 shapes \(categories: box, can, jar\), but {lack}"
    fails(message, "generate", "--task", task, "--pairs", 5, "--shapes", source, "--out", tmp_path / "o", cwd=tmp_path)
    assert not (tmp_path / "o").exists()


def test_several_tasks_end_with_a_table(tmp_path):
    """Laws and faces by option, one row a split, one JSON record a split."""
    options = ("--split", "test", "--pairs", 20, "--draws", "independent", "--workers", 1)
    done = run("generate", "--task", "tube,box-110010,tube", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith(" data/")]
    first, second = rows[:2], rows[2:]  # the table is too wide for 80 columns
    assert [r[0] for r in second] == [r[0] for r in first]
    assert [(r[0], r[1], r[5]) for r in first] == [(f"data/{t}/test", "20", "0") for t in ("tube", "box-110010")]
    done = run("generate", "--task", "box-110010", *options, "--json", cwd=tmp_path)
    (found,) = json.loads(done.stdout)
    assert found["recipe"] | {"task": "box-110010", "draws": "independent"} == found["recipe"]
    assert found["digest"].startswith(second[1][-1])
    assert run("verify", "data", cwd=tmp_path).stdout.count(": good, 20 pairs") == 2


def test_what_a_task_does_not_draw_is_counted(tmp_path):
    """Environments without a countertop are named in the manifest, and the summary says how many and where."""
    done = run("generate", "--task", "top", "--split", "test", "--pairs", 20, "--workers", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    left_out = json.loads((tmp_path / "data/top/test/manifest.json").read_text())["shapes_left_out"]
    line = done.stdout.splitlines()[1]
    assert line.startswith(f"  left out: {len(left_out)} shape")
    assert line.endswith("that the task does not draw; data/top/test/manifest.json names each with the reason")
    assert all("has no countertop" in reason for reason in left_out.values())


def test_mesh_folder_errors(tmp_path):
    """A folder without meshes; a folder whose last mesh cannot be read, or is empty."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    argument = ("generate", "--task", "tube", "--pairs", 5, "--split", "train", "--shapes", f"meshes={folder}")
    fails("holds no shapes for meshes=", *argument, cwd=tmp_path)
    (folder / "mug").mkdir()
    fails("holds no shapes for meshes=", *argument, cwd=tmp_path)
    for name, text in (("bad.stl", "solid nothing"), ("bad.glb", "glTF"), ("bad.obj", ""), ("bad.ply", "ply\nbroken")):
        (folder / "mug" / name).write_text(text)
        fails(rf"None of the 1 train object shapes .* mug/{name}: ", *argument, cwd=tmp_path)
        (folder / "mug" / name).unlink()
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nothing_at_all\n", "failed in import: ModuleNotFoundError"),
        (
            "class Model:\n    def predict(self, env, obj):\n        return {'probability': [float('nan')] * len(env)}\n",
            "not finite",
        ),
        ("class Model:\n    def predict(self, env, obj):\n        return {'probability': [0.5]}\n", "of shape"),
        ("class Model:\n    def predict(self, env, obj):\n        import time; time.sleep(99)\n", "within 1 s"),
        ("class Model:\n    def predict(self, env, obj):\n        import os; os._exit(1)\n", "ended its process"),
        (
            "class Model:\n    def predict(self, env, obj):\n        raise ValueError('a\\nb' * 900)\n",
            "ValueError: a ba b",
        ),
    ],
)
def test_model_errors(test_split, tmp_path, text, message):
    """Each fault of a model: one line, code 2, no run folder."""
    (tmp_path / "m.py").write_text(text)
    fails(message, "evaluate", "m.py", "--data", test_split, "--timeout", 1, cwd=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["m.py"]


def test_data_errors(test_split, tmp_path):
    """A missing model, missing data, missing targets, truncated shards, foreign folders."""
    fails("Model file none.py does not exist", "evaluate", "none.py", "--data", test_split)
    fails("does not exist", "evaluate", BOX, "--data", tmp_path / "none")
    fails("holds no finished split", "verify", tmp_path)
    fails("holds no finished split", "info", tmp_path)
    copy = shutil.copytree(test_split, tmp_path / "copy")
    inputs = copy / "inputs-00000.h5"
    inputs.write_bytes(inputs.read_bytes()[:100_000])
    fails("inputs-00000.h5", "evaluate", BOX, "--data", copy, cwd=tmp_path)
    fails("inputs-00000.h5", "verify", copy)
    (copy / "targets-00000.h5").unlink()
    fails("Targets are missing", "evaluate", BOX, "--data", copy, cwd=tmp_path)
    fails("Batch size is 0", "evaluate", BOX, "--data", test_split, "--batch-size", 0, cwd=tmp_path)
    fails("The timeout is -1", "evaluate", BOX, "--data", test_split, "--timeout", -1, cwd=tmp_path)
    fails("Unknown isolation level", "evaluate", BOX, "--data", test_split, "--isolation", "full", cwd=tmp_path)
    assert not (tmp_path / "runs").exists()


def test_a_failed_check_is_an_error(tmp_path):
    """`check` prints its findings, then one line that names the first fault."""
    (tmp_path / "m.py").write_text(
        "import numpy as np\nclass Model:\n    def predict(self, env, obj):\n"
        "        return {'probability': np.random.rand(len(env))}\n"
    )
    done = run("check", "m.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "FAIL  repeatability" in done.stdout
    assert done.stderr.startswith("error: Check failed: repeatability")


def test_debug_shows_the_traceback(tmp_path):
    """--debug adds the model's traceback below the line."""
    (tmp_path / "m.py").write_text("raise RuntimeError('here')\n")
    done = run("check", "m.py", "--debug", cwd=tmp_path)
    assert "Traceback" in done.stderr
    assert "RuntimeError: here" in done.stderr


def test_without_torch(test_split, tmp_path):
    """Generating, verifying, loading and scoring need no torch: here its import fails."""
    hook = tmp_path / "sitecustomize.py"
    hook.write_text(
        "import sys\nclass No:\n    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] == 'torch':\n            raise ImportError('no torch here')\n"
        "sys.meta_path.insert(0, No())\n"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    probe = subprocess.run([sys.executable, "-c", "import torch"], env=environment, capture_output=True, check=False)
    assert probe.returncode != 0
    commands = [
        ("generate", "--task", "tube", "--pairs", 20, "--workers", 1, "--out", tmp_path / "d"),
        ("verify", tmp_path / "d", "--deep", "--workers", 1),
        ("evaluate", BOX, "--data", test_split, "--out", tmp_path / "run"),
        ("score", tmp_path / "run", "--data", test_split),
        ("check", BOX),
    ]
    for command in commands:
        done = run(*command, env=environment)
        assert done.returncode == 0, done.stderr


def test_readme_python_runs(test_split, tmp_path):
    """The Python shown in the README runs as it stands."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert blocks
    (tmp_path / "data" / "tube").mkdir(parents=True)
    (tmp_path / "data" / "tube" / "test").symlink_to(test_split)
    (tmp_path / "data" / "tube" / "train").symlink_to(test_split.parent / "train")
    (tmp_path / "examples").symlink_to(EXAMPLES)
    for block in blocks:
        done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_cache_that_cannot_be_written(tmp_path, place):
    """A cache place that cannot be used is named, with the variable that chooses another."""
    (tmp_path / "file").touch()
    environment = os.environ | {"EIGENBENCH_CACHE": str(tmp_path / place)}
    fails("cannot be written: .* Set EIGENBENCH_CACHE", "generate", "--task", "tube", cwd=tmp_path, env=environment)


@pytest.mark.parametrize("command", ["generate", "evaluate"])
def test_ctrl_c(tmp_path, test_split, command):
    """Ctrl-C ends with one line and code 130; generating goes on later, evaluating leaves nothing."""
    slow = tmp_path / "slow.py"
    slow.write_text("import time\nclass Model:\n    def predict(self, env, obj):\n        time.sleep(60)\n")
    arguments = {
        "generate": ("--task", "tube", "--split", "train", "--pairs", 30_000, "--workers", 2),
        "evaluate": (slow, "--data", test_split),
    }[command]
    line = [sys.executable, "-m", "eigenbench", command, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(line, cwd=tmp_path, start_new_session=True, **pipes) as process:
        end = time.monotonic() + 60
        while not list(tmp_path.rglob("targets-*.h5")) and time.monotonic() < end and command == "generate":
            time.sleep(0.01)
        time.sleep(0 if command == "generate" else 4)
        os.killpg(process.pid, signal.SIGINT)
        printed, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert printed == ""
    assert errors.splitlines()[-1].startswith("error: interrupted. Finished shards are kept")
    assert "Traceback" not in errors
    assert not (tmp_path / "runs").exists()
    assert not list(tmp_path.rglob("manifest.json"))
