"""A submitted model's process: how each failure is named, and what is taken for an answer."""

import os
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from material import ENV, GOOD, HONEST, answer, model

from eigenbench.errors import ModelError
from eigenbench.protocol import BadFrame, unpack_arrays


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise ValueError('no luck')", r"failed in predict: ValueError: no luck, line 4"),
        ("return {'probability': np.full(len(env), np.nan)}", r"returned probability that is not finite \(row 0"),
        ("return {'probability': np.full(len(env), 1.5)}", r"a probability outside \[0, 1\]"),
        ("return {'probability': np.full(3, 0.5)}", r"probability of shape \(3,\), expected \(24,\)"),
        ("return {'probability': np.full((len(env), 1), 0.5)}", r"expected \(24,\)"),
        ("return {'probabilty': np.full(len(env), 0.5)}", r"Did you mean 'probability'"),
        (
            "return np.zeros(3)",
            r"predict returned ndarray; it must return a dict or a Prediction, line \d+\.$|a Prediction\.$",
        ),
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


@pytest.mark.parametrize("name", ["random", "types", "json", "numpy", "torch", "eigenbench", "__main__", "model.v2"])
def test_a_model_may_have_any_name(tmp_path, name):
    """Its file is loaded by its path: an import of that name still means what it means everywhere."""
    text = (
        "import importlib, json, random, types\nimport numpy as np\nfrom beside import HALF\n"
        "own = lambda m: getattr(m, '__file__', None) == __file__\n"
        f"for other in (json, random, types, np):\n    assert not own(other)\n"
        f"if {name!r} in ('torch', 'eigenbench', 'numpy'):\n"
        f"    try:\n        assert not own(importlib.import_module({name!r}))\n"
        f"    except ModuleNotFoundError:\n        assert {name!r} == 'torch'\n"
        "class Model:\n    def predict(self, env, obj):\n"
        "        return {'probability': np.full(len(env), HALF + 0 * random.Random(1).random())}\n"
    )
    path = model(tmp_path, text, f"{name}.py")
    (path.parent / "beside.py").write_text("HALF = 0.5\n")
    assert (answer(path)[0].arrays["probability"] == 0.5).all()


def test_files_beside_a_model(tmp_path):
    """They may import the model, and one that is named like a module of Python's stands for it to nobody."""
    text = (
        "from helper import give\nimport types\nassert not hasattr(types, 'MINE')\nclass Model:\n    predict = give\n"
    )
    path = model(tmp_path, text)
    (path.parent / "types.py").write_text("MINE = 1\n")
    (path.parent / "helper.py").write_text(
        "import numpy as np\ndef give(self, env, obj):\n    import model\n    assert type(self) is model.Model\n"
        "    return {'probability': np.ones(len(env))}\n"
    )
    assert (answer(path)[0].arrays["probability"] == 1).all()


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
        ("c.send({'kind': 'answer', 'arrays': [['x' * 10**5, 'float64', [24]]]}, b'x' * 192)", "unknown field"),
        ("c.send({'kind': 'answer', 'arrays': [['x' * 10**5, 'object', [24]]]}, b'x' * 192)", "answered with an array"),
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


def test_scratch_is_writable_and_removed(tmp_path):
    """A model may write its own temporary folder, which is gone afterwards."""
    body = "import tempfile; f = tempfile.NamedTemporaryFile(delete=False); f.write(b'x'); raise ValueError(f.name)"
    with pytest.raises(ModelError) as failed:
        answer(model(tmp_path, body))
    path = Path(str(failed.value).split("ValueError: ")[1].split(",")[0])
    assert "eigenbench-model-" in str(path)
    assert not path.parent.exists()


def test_deep_scratch_is_removed(tmp_path, monkeypatch):
    """Folders nested too deep for Python's own removal are removed all the same."""
    body = "import os; [(os.mkdir('d'), os.chdir('d')) for _ in range(3000)]; " + GOOD

    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    answer(model(tmp_path, body))
    assert list(scratch.iterdir()) == []
