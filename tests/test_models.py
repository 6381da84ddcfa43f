"""Submitted models: what they may do, what they may not, and how each failure is named."""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from material import EXAMPLES

import eigenbench
from eigenbench.checking import check, toy_clouds
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.hosting import HostedModel, HostOptions
from eigenbench.protocol import BadFrame, unpack_arrays
from eigenbench.results import PREDICTIONS, RESULT
from eigenbench.sandbox import landlock_abi, readable_paths
from eigenbench.scoring import rescore
from eigenbench.tasks import TASKS

TUBE = TASKS["tube"]
ENV, OBJ = toy_clouds(np.random.default_rng(1))
HONEST = "import numpy as np\nclass Model:\n    def predict(self, env, obj):\n        "
GOOD = "return {'probability': np.full(len(env), 0.5)}"


def model(tmp_path: Path, body: str, name: str = "model.py") -> Path:
    """Write a model whose predict has the given body, or a whole file if it has lines."""
    path = tmp_path / "submission" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(body if "\n" in body else HONEST + body + "\n")
    return path


def answer(path: Path, **options):
    with HostedModel(path, TUBE, HostOptions(**options)) as hosted:
        return hosted.predict(ENV, OBJ), hosted.isolation


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise ValueError('no luck')", r"failed in predict: ValueError: no luck, line 4"),
        ("return {'probability': np.full(len(env), np.nan)}", r"returned probability that is not finite \(row 0"),
        ("return {'probability': np.full(len(env), 1.5)}", r"a probability outside \[0, 1\]"),
        ("return {'probability': np.full(3, 0.5)}", r"probability of shape \(3,\), expected \(24,\)"),
        ("return {'probability': np.full((len(env), 1), 0.5)}", r"expected \(24,\)"),
        ("return {'probabilty': np.full(len(env), 0.5)}", r"Did you mean 'probability'"),
        ("return np.zeros(3)", r"predict returned ndarray; it must return a dict or a Prediction"),
        ("return {}", r"gives neither a probability nor lengths"),
        ("return {'env_lengths': np.ones((len(env), 2))}", r"gives lengths of one side only"),
        (
            "return {'env_lengths': np.ones((len(env), 2)), 'obj_lengths': np.ones((len(env), 3))}",
            r"obj_lengths of shape \(24, 3\), expected \(24, 2\)",
        ),
        ("return {'env_lengths': np.ones(len(env)), 'obj_lengths': np.ones(len(env))}", r"expected \(B, S, ...\)"),
        ("return {'probability': ['a'] * len(env)}", r"probability has type <U1; it must be numbers"),
        ("return {'probability': np.full(len(env), .5), 'groups': [[]]}", r"returned groups \[\[\]\]"),
        ("return {'probability': np.full(len(env), .5), 'groups': [[4]]}", r"name a slot beyond S = 0"),
        ("import os; os._exit(3)", r"ended its process in predict \(exit code 3\)"),
        ("import os; os._exit(0)", r"ended its process in predict \(exit code 0\)"),
        ("import os, signal; os.kill(os.getpid(), 11)", r"signal SIGSEGV"),
        ("raise SystemExit(0)", r"failed in predict: SystemExit: 0"),
        ("raise KeyboardInterrupt", r"failed in predict: KeyboardInterrupt"),
        ("import pickle; import sys; [].append(self.x)", r"AttributeError: 'Model' object has no attribute 'x'"),
        ("x = np.zeros(10**10); return {'probability': x[: len(env)]}", r"(MemoryError|Unable to allocate)"),
    ],
)
def test_failures_are_named(tmp_path, body, message):
    """Every failure in predict becomes one ModelError that says what and where."""
    with pytest.raises(ModelError, match=message):
        answer(model(tmp_path, body))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nonsense\n", r"failed in import: ModuleNotFoundError: No module named 'nonsense', line 1"),
        ("1 +\n\n", r"failed in import: SyntaxError"),
        ("x = 1\n\n", r"failed in import: AttributeError: it defines no build and no Model"),
        ("def build(task, checkpoint, device):\n    return 5\n", r"failed in build: .*int has no method predict"),
        (
            "def build(task, checkpoint, device):\n    raise OSError('gone')\n",
            r"failed in build: OSError: gone, line 2",
        ),
        ("import os\nos._exit(7)\n", r"ended its process in build \(exit code 7\)"),
    ],
)
def test_failures_before_predict(tmp_path, text, message):
    """Failing on import or in build is named with the line."""
    with pytest.raises(ModelError, match=message):
        answer(model(tmp_path, text))


def test_missing_model():
    """A file that does not exist is named."""
    with pytest.raises(ModelError, match="Model file nowhere.py does not exist"):
        answer(Path("nowhere.py"))


@pytest.mark.parametrize("where", ["build", "predict"])
def test_a_hanging_model_is_stopped(tmp_path, where):
    """Silence ends at the limit, and no process is left behind."""
    mark = f"marker-{os.getpid()}-{where}"
    sleep = f"import subprocess, sys, time; '{mark}'; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60) #{mark}']); time.sleep(60)"
    text = HONEST + sleep + "\n" if where == "predict" else f"def build(task, checkpoint, device):\n    {sleep}\n"
    start = time.monotonic()
    with pytest.raises(ModelError, match=rf"gave no answer in {where} within 2 s; raise --"):
        answer(model(tmp_path, text), timeout=2.0, build_timeout=2.0 if where == "build" else 30.0)
    assert time.monotonic() - start < 20
    time.sleep(0.2)
    lines = [p.read_bytes() for p in Path("/proc").glob("[0-9]*/cmdline") if p.exists()]
    assert not any(mark.encode() in line for line in lines)


def test_printing_does_not_disturb(tmp_path, capfd):
    """A model that prints, also below Python, answers all the same, and nothing reaches the terminal."""
    body = "print('x' * 100000); import os; os.write(1, b'y' * 5000); os.write(2, b'z'); " + GOOD
    got, _ = answer(model(tmp_path, body))
    assert (got.arrays["probability"] == 0.5).all()
    assert capfd.readouterr() == ("", "")


needs_landlock = pytest.mark.skipif(landlock_abi() < 1, reason="this kernel has no Landlock")


@needs_landlock
@pytest.mark.parametrize(
    "attempt",
    [
        "open({secret!r}).read()",
        "open('/proc/{parent}/mem', 'rb').read(1)",
        "open('/proc/{parent}/environ', 'rb').read(1)",
        "open('/etc/shadow').read()",
        "open(__file__ + '.new', 'w')",
        "open({outside!r}, 'w')",
        "__import__('os').unlink({secret!r})",
        "__import__('os').listdir('/root')",
        "__import__('os').kill({parent}, 0)",
        "__import__('ctypes').CDLL(None).ptrace(16, {parent}, 0, 0) and (_ for _ in ()).throw(PermissionError('denied'))",
        "__import__('socket').create_connection(('127.0.0.1', {port}), 1)",
        "__import__('socket').socket(2, 2).sendto(b'x', ('127.0.0.1', {port}))",
        "__import__('subprocess').check_output(['/bin/cat', {secret!r}])",
        "__import__('os').chmod({secret!r}, 0)",
        "__import__('os').utime({secret!r})",
        "__import__('socket').socket(1, 1).connect({socket!r})",
        "__import__('ctypes').CDLL(None).shmget(0, 4096, 0o1600) < 0 and (_ for _ in ()).throw(PermissionError('denied'))",
    ],
)
def test_hostile_models_get_nothing(tmp_path, attempt):
    """Reading the targets, the parent or the system, writing elsewhere, the network: all denied."""
    secret = tmp_path / "targets-00000.h5"
    secret.write_text("the labels")
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1]
        names = {"secret": str(secret), "outside": str(tmp_path / "new"), "socket": str(tmp_path / "socket")}
        reads = "open({secret" in attempt
        attempt = attempt.format(**names, parent=os.getpid(), port=port)
        with pytest.raises(
            ModelError, match=r"PermissionError|OSError|CalledProcessError|ConnectionRefused|ProcessLookupError"
        ):
            answer(model(tmp_path, f"{attempt}; {GOOD}"))
    assert secret.read_text() == "the labels"
    assert not (tmp_path / "new").exists()
    if reads:  # the same attempt without isolation shows that it is the isolation that stops it
        assert answer(model(tmp_path, f"{attempt}; {GOOD}"), isolation="none")[1]["level"] == "none"


@needs_landlock
def test_model_folder_is_readable_and_data_inside_it_is_not(tmp_path, test_split):
    """A model reads its siblings and weights, but not a data folder that lies beside it."""
    import shutil

    folder = tmp_path / "submission"
    data = shutil.copytree(test_split, folder / "data" / "tube" / "test")
    (folder / "weights.txt").write_text("0.5")
    (folder / "sibling.py").write_text("def read(p):\n    return float(open(p).read())\n")
    good = "from sibling import read; from pathlib import Path; w = read(Path(__file__).parent / 'weights.txt'); "
    path = model(tmp_path, good + "return {'probability': np.full(len(env), w)}")
    eigenbench.evaluate(path, data, tmp_path / "run")
    thief = model(tmp_path, f"open({str(data / 'targets-00000.h5')!r}, 'rb').read(); {GOOD}", "thief.py")
    with pytest.raises(ModelError, match="PermissionError"):
        eigenbench.evaluate(thief, data, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_rules_never_open_what_is_hidden(tmp_path):
    """Whatever is opened, no rule reaches into a hidden folder, also through links."""
    (tmp_path / "a" / "hidden" / "deep").mkdir(parents=True)
    (tmp_path / "a" / "b").mkdir()
    (tmp_path / "a" / "link").symlink_to(tmp_path / "a" / "hidden")
    hidden = tmp_path / "a" / "hidden"
    rules = readable_paths([str(tmp_path), str(hidden / "deep"), str(tmp_path / "a")], [hidden])
    opened = [Path(p) for p, listing_only in rules if not listing_only]
    assert tmp_path / "a" / "b" in opened
    assert not any(hidden.is_relative_to(p) or p.is_relative_to(hidden) for p in opened)


def test_isolation_levels(tmp_path):
    """The level reached is reported; asking for less gives less; the environment is not passed on."""
    os.environ["EIGENBENCH_SECRET"] = "1"
    body = "import os; assert 'EIGENBENCH_SECRET' not in os.environ; " + GOOD
    for level in ("none", "rlimits"):
        assert answer(model(tmp_path, body), isolation=level)[1]["level"] == level
    best = answer(model(tmp_path, body))[1]
    assert best["level"] == ("landlock" if landlock_abi() else "rlimits")
    with pytest.raises(UsageError, match="Did you mean 'landlock'"):
        HostOptions(isolation="landlok")


def test_scratch_is_writable_and_removed(tmp_path):
    """A model may write its own temporary folder, which is gone afterwards."""
    body = "import tempfile; f = tempfile.NamedTemporaryFile(delete=False); f.write(b'x'); raise ValueError(f.name)"
    with pytest.raises(ModelError) as failed:
        answer(model(tmp_path, body))
    path = Path(str(failed.value).split("ValueError: ")[1].split(",")[0])
    assert "eigenbench-model-" in str(path)
    assert not path.parent.exists()


@pytest.mark.parametrize("dtype", ["float16", "int64", "bool"])
def test_narrow_numbers_are_widened(tmp_path, dtype):
    """float16, integers and booleans are taken as the numbers they are."""
    got, _ = answer(model(tmp_path, f"return {{'probability': np.ones(len(env), dtype='{dtype}')}}"))
    assert (got.arrays["probability"] == 1.0).all()


def test_torch_model(tmp_path):
    """A model that asks for torch gets tensors and may answer with tensors that carry gradients."""
    pytest.importorskip("torch", reason="torch is an extra")
    text = (
        "import torch\nclass Model:\n    arrays = 'torch'\n    def predict(self, env, obj):\n"
        "        w = torch.ones(1, requires_grad=True)\n"
        "        return {'env_lengths': w * (env.amax(1) - env.amin(1))[:, 1:],\n"
        "                'obj_lengths': (obj.amax(1) - obj.amin(1))[:, 1:].bfloat16()}\n"
    )
    got, _ = answer(model(tmp_path, text), timeout=120.0, build_timeout=120.0)
    assert np.allclose(got.arrays["env_lengths"], np.ptp(ENV, axis=1)[:, 1:])


def test_frames_are_not_trusted():
    """A frame that lies about its arrays is refused."""
    for listed, body in [
        ([["a", "object", [1]]], b"12345678"),
        ([["a", "float64", [2]]], b"12345678"),
        ([["a", "float64", [1]]], b"123456789"),
        ([["a", "float64", [-1]]], b"12345678"),
        ([["a", "float64"]], b"12345678"),
        (None, b""),
        (5, b""),
    ]:
        with pytest.raises(BadFrame):
            unpack_arrays(listed, bytearray(body))


def test_a_model_that_writes_the_pipe_itself(tmp_path):
    """Bytes that are no frame end the run with a sentence, whatever they are."""
    body = (
        "import os, sys; [os.write(int(fd), b'garbage' * 100) for fd in os.listdir('/proc/self/fd') if int(fd) > 2]; "
    )
    with pytest.raises(ModelError, match="instead of an answer|answered with|failed in|sent a"):
        answer(model(tmp_path, "import contextlib\n" + HONEST + body + GOOD + "\n"))


def test_checks_of_the_examples():
    """The examples pass every check that applies to them."""
    for name in ("bounding_box", "constant", "object_only"):
        findings = check(EXAMPLES / f"{name}.py")
        assert not [f for f in findings if f.passed is False]


@pytest.mark.parametrize(
    ("body", "failed"),
    [
        ("return {'probability': np.clip(obj.std() + 0 * env[:, 0, 0], 0, 1)}", "batch size"),
        ("return {'probability': np.random.rand(len(env))}", "repeatability"),
        ("return {'probability': np.arange(len(env)) / len(env)}", "order"),
        (
            "return {'env_lengths': (np.ptp(env, axis=1) + np.ptp(obj, axis=1))[:, 1:], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:]}",
            "honesty: an environment's lengths",
        ),
        (
            "return {'env_lengths': np.ptp(env, axis=1)[:, 1:], 'obj_lengths': (np.ptp(env, axis=1) + np.ptp(obj, axis=1))[:, 1:]}",
            "honesty: an object's lengths",
        ),
        (
            "return {'env_lengths': np.ptp(env, axis=1)[:, 1:], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:], 'probability': np.ones(len(env))}",
            "honesty: AND",
        ),
    ],
)
def test_checks_find_faults(tmp_path, body, failed):
    """Each fault fails its own check."""
    findings = check(model(tmp_path, body))
    assert [f.name for f in findings if f.passed is False and f.name.startswith(failed)]


def test_evaluate_bounding_box(test_split, tmp_path):
    """The model that measures is the exact measurer: the same decisions, R2 of 1 for the tube, angle 0."""
    done = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / "run", batch_size=37)
    s = done.result["scores"]
    assert s["accuracy"] == s["references"]["exact_measurer"]
    assert s["accuracy"]["value"] > 0.95
    assert s["recall"]["value"] == 1.0
    matched = s["lengths"]["all_pairs"]["matched"]
    assert {k: m["slot"] for k, m in matched.items()} == {"width": 0, "height": 1}
    assert all(m["env_r2"]["value"] > 0.999 and m["obj_r2"]["value"] > 0.99 for m in matched.values())
    assert all(a["mean_degrees"]["value"] == 0 for a in s["angles"]["by_length"].values())
    assert sum(g["pairs"] for g in s["by_margin"].values()) == 300
    assert done.result["isolation"]["level"] in ("landlock", "rlimits")


def test_scores_do_not_depend_on_batch_size_or_order(test_split, tmp_path):
    """Two evaluations, in two secret orders and batch sizes, store the same predictions and scores."""
    runs = [
        eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / str(b), batch_size=b).result
        for b in (300, 41)
    ]
    assert runs[0]["predictions_digest"] == runs[1]["predictions_digest"]
    assert runs[0]["scores"] == runs[1]["scores"]


def test_rescoring_gives_the_same_to_the_last_digit(test_split, tmp_path):
    """`score` needs no model and agrees with the stored result; a changed prediction is noticed."""
    run = tmp_path / "run"
    done = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, run)
    assert eigenbench.score(run, test_split) == json.loads((run / RESULT).read_text())["scores"]
    assert rescore(run, test_split) == (done.result, "")
    body = json.loads((run / RESULT).read_text())
    body["scores"]["accuracy"]["value"] += 1e-15
    (run / RESULT).write_text(json.dumps(body))
    assert rescore(run, test_split)[1] == "scores.accuracy.value"
    with np.load(run / PREDICTIONS) as stored:
        arrays = dict(stored)
    arrays["env_lengths"][3, 0] += 1
    np.savez(run / PREDICTIONS, **arrays)
    with pytest.raises(DataError, match="was changed after its result.json was written"):
        rescore(run, test_split)


def test_a_run_belongs_to_its_data(small, test_split, tmp_path):
    """Scoring a run against another split, or a folder that is no run, is refused."""
    eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run")
    with pytest.raises(DataError, match="were not made for .*train: their pair ids differ"):
        eigenbench.score(tmp_path / "run", small / "tube" / "train")
    with pytest.raises(DataError, match="holds no result.json, so it is not a run"):
        eigenbench.score(tmp_path, test_split)
    with pytest.raises(UsageError, match="holds a run already"):
        eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run")


def test_constant_model_scores_the_majority(test_split, tmp_path):
    """Accuracy is the share of positives, AUROC one half, no lengths, no angles, worst group named."""
    s = eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run").result["scores"]
    assert s["accuracy"]["value"] == pytest.approx(eigenbench.load(test_split).column("label").mean())
    assert s["auroc"] == {"value": 0.5, "low": 0.5, "high": 0.5}
    assert s["lengths"] is None
    assert s["angles"] is None
    assert s["worst_obj_category"]["name"] in ("bucket", "jar")


def test_more_slots_fewer_slots_constants_and_groups(test_split, tmp_path):
    """Spare slots get their best truth, missing lengths are listed, constants flagged, groups used."""
    text = HONEST + (
        "e, o = np.ptp(env, axis=1), np.ptp(obj, axis=1)\n"
        "        one = np.ones(len(env))\n"
        "        return {'env_lengths': np.stack([e[:, 2], one, e[:, 1]], 1),\n"
        "                'obj_lengths': np.stack([o[:, 2], 0 * one, o[:, 1]], 1), 'groups': [[0, 1, 2]]}\n"
    )
    s = eigenbench.evaluate(model(tmp_path, text), test_split, tmp_path / "a").result["scores"]
    assert {k: m["slot"] for k, m in s["lengths"]["all_pairs"]["matched"].items()} == {"width": 2, "height": 0}
    assert s["lengths"]["all_pairs"]["unmatched_slots"][0]["slot"] == 1
    assert s["lengths"]["constant_slots"] == {"env_lengths": [1], "obj_lengths": [1]}
    assert s["lengths"]["slot_use"][1]["value"] == 0
    assert s["accuracy"] == s["references"]["exact_measurer"]
    one = "return {'env_lengths': np.ptp(env, axis=1)[:, 1:2], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:2]}"
    s = eigenbench.evaluate(model(tmp_path, one), test_split, tmp_path / "b").result["scores"]
    assert s["lengths"]["all_pairs"]["unmatched_lengths"] == ["height"]


def test_named_builder_and_checkpoint(test_split, tmp_path):
    """`model.py:name` picks another builder, which gets the task, the checkpoint and the device."""
    weights = tmp_path / "weights.json"
    weights.write_text("0.75")
    text = (
        "import json\nimport numpy as np\nclass M:\n    def __init__(self, p):\n        self.p = p\n"
        "    def predict(self, env, obj):\n        return {'probability': np.full(len(env), self.p)}\n"
        "def mine(task, checkpoint=None, device='cpu'):\n"
        "    assert (task.name, task.slots, device) == ('tube', 2, 'cpu')\n"
        "    return M(json.load(open(checkpoint)))\n"
    )
    path = model(tmp_path, text)
    options = HostOptions(checkpoint=str(weights))
    done = eigenbench.evaluate(f"{path}:mine", test_split, tmp_path / "run", options=options)
    assert done.result["model"]["name"] == "mine"
    assert done.result["model"]["checkpoint_digest"]
    with np.load(tmp_path / "run" / PREDICTIONS) as stored:
        assert (stored["probability"] == 0.75).all()


def test_object_only_can_be_fitted_again(small, tmp_path):
    """The probe's weights come from its own command, on training pairs only."""
    copy = tmp_path / "object_only.py"
    copy.write_text((EXAMPLES / "object_only.py").read_text())
    command = [sys.executable, copy, str(small / "tube" / "train")]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert "accuracy on its training pairs 0." in shown
    assert len(json.loads(copy.with_suffix(".json").read_text())["weights"]) == 10
    refused = subprocess.run([*command[:2], str(small / "tube" / "test")], capture_output=True, text=True, check=False)
    assert "fit on train" in refused.stderr


@needs_landlock
@pytest.mark.parametrize("escape", ["os.setsid()", "ctypes.CDLL(None).prctl(1, 0, 0, 0, 0); os.setsid()"])
def test_no_process_outlives_the_model(tmp_path, escape):
    """A daemon that leaves the session and its parent's death signal ends with the model all the same."""
    mark = f"daemon-{os.getpid()}-{abs(hash(escape))}"
    body = (
        "import ctypes, os, subprocess, sys, time\n"
        "class Model:\n    def predict(self, env, obj):\n"
        f"        if os.fork() == 0:\n            {escape}\n"
        f"            subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60) #{mark}'], start_new_session=True)\n"
        "            time.sleep(60)\n        time.sleep(1)\n        return {'probability': [0.5] * len(env)}\n"
    )
    _, isolation = answer(model(tmp_path, body))
    if isolation["processes"] != "namespace":
        pytest.skip("this machine allows no process namespace")
    time.sleep(0.2)
    assert not [p for p in Path("/proc").glob("[0-9]*/cmdline") if mark.encode() in p.read_bytes()]


@pytest.mark.parametrize(
    ("forged", "message"),
    [
        (
            "c.send({'kind': 'error', 'phase': '\\x1b[2J\\nrun: all good', 'type': 'X', 'message': 'y' * 9000})",
            "failed in",
        ),
        ("c.send({'kind': 'answer', 'arrays': [['probability', 'float64', [2**62, 2**62]]]})", "do not match"),
        (
            "c.send({'kind': 'answer', 'arrays': [['probability', 'float64', [24]]], 'groups': [[0]] * 10**5}, b'x' * 192)",
            "groups",
        ),
        ("os.write(c._write_fd, struct.pack('<QQ', 10, 1 << 32))", "sent a frame of"),
        ("os.write(c._write_fd, struct.pack('<QQ', 900000, 0) + b'[' * 900000 + b']' * 0)", "not JSON"),
        ("c.send({'kind': 'ready'})", "sent a 'ready' instead of its 'answer'"),
        ("c.send({'kind': '\\x1b]0;x'})", "instead of its 'answer'"),
        ("os.kill(os.getpid(), 40)", "signal 40"),
    ],
)
def test_forged_frames(tmp_path, forged, message):
    """Whatever a model writes to the pipe itself, the harness answers with one printable line."""
    body = (
        "import gc, os, struct, time\nfrom eigenbench.protocol import Channel\n"
        "class Model:\n    def predict(self, env, obj):\n"
        "        c = next(o for o in gc.get_objects() if isinstance(o, Channel))\n"
        f"        os.set_blocking(c._write_fd, True)\n        {forged}\n        time.sleep(60)\n"
    )
    with pytest.raises(ModelError, match=message) as failed:
        answer(model(tmp_path, body), timeout=20.0)
    assert str(failed.value).isprintable()
    assert len(str(failed.value)) < 2500


def test_a_model_cannot_name_itself(test_split, tmp_path):
    """What a model says of itself does not reach the result's account of what was run."""
    text = (
        "import sys\nimport numpy as np\n"
        "sys.modules['__main__']._capabilities = lambda m: {'digest': '0' * 64, 'file': 'famous.py', 'can': ['fit', 'fly']}\n"
        "class Model:\n    def predict(self, env, obj):\n        return {'probability': np.full(len(env), 0.5)}\n"
    )
    done = eigenbench.evaluate(model(tmp_path, text), test_split, tmp_path / "run").result["model"]
    assert done["file"] == "model.py"
    assert done["digest"] != "0" * 64
    assert done["can"] == ["fit"]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return {'env_lengths': np.ones((len(env), 65)), 'obj_lengths': np.ones((len(env), 65))}", "S from 1 to 64"),
        ("return {'env_lengths': np.full((len(env), 2), 1e300), 'obj_lengths': np.ones((len(env), 2))}", "beyond 1e"),
        (
            "return {'env_lengths': np.ones((len(env), 2)), 'obj_lengths': np.ones((len(env), 2)), 'groups': [[0, 0]]}",
            "lists of different slot numbers",
        ),
    ],
)
def test_answers_are_bounded(tmp_path, body, message):
    """Too many slots, numbers too large, groups that repeat a slot: refused."""
    with pytest.raises(ModelError, match=message):
        answer(model(tmp_path, body))


def test_deep_scratch_is_removed(tmp_path):
    """Folders nested too deep for Python's own removal are removed all the same."""
    body = "import os; [(os.mkdir('d'), os.chdir('d')) for _ in range(3000)]; " + GOOD
    import tempfile

    before = set(Path(tempfile.gettempdir()).glob("eigenbench-model-*"))
    answer(model(tmp_path, body))
    assert set(Path(tempfile.gettempdir()).glob("eigenbench-model-*")) <= before


def test_options_are_checked_before_anything_runs(tmp_path, test_split):
    """Limits that are no numbers, a missing checkpoint, a run folder that cannot be: refused at once."""
    for options in (
        {"timeout": float("inf")},
        {"timeout": float("nan")},
        {"memory_gib": float("nan")},
        {"memory_gib": 1e12},
    ):
        with pytest.raises(UsageError, match="it must be"):
            HostOptions(**options)
    with pytest.raises(UsageError, match=r"Checkpoint nowhere.pt does not exist"):
        HostOptions(checkpoint="nowhere.pt")
    (tmp_path / "file").touch()
    bad = model(tmp_path, "raise SystemError('it ran')")
    for out in (tmp_path / "file", tmp_path / "file" / "x", tmp_path / ("n" * 300), Path("/proc/x")):
        with pytest.raises(UsageError, match="cannot be made"):
            eigenbench.evaluate(bad, test_split, out)
    with pytest.raises(UsageError, match="holds the model itself"):
        eigenbench.evaluate(bad, test_split, bad.parent)
