"""Models that change what is not theirs: files, the package, the scorer, other processes."""

import ctypes
import os
import signal
import sys
from pathlib import Path

from told import Attack, model, refused, together


def _try_write_outside(told):
    Path(told["outside"]).write_text("x")


def _try_own_file(told):
    with Path(__file__).open("a") as own:
        own.write("#")


def _try_planted_bytecode(told):
    (Path(told["package"]) / "planted.pyc").write_bytes(b"x")


def _try_open_targets(told):
    Path(told["targets"]).chmod(0o777)


def _try_touch_targets(told):
    os.utime(told["targets"])


def _try_signal_parent(told):
    os.kill(told["parent"], signal.SIGURG)  # harmless, but whoever may send it may send SIGKILL


def _try_signal_group(told):
    os.killpg(told["group"], signal.SIGURG)


def _try_slow_parent(told):
    now = os.getpriority(os.PRIO_PROCESS, told["parent"])
    os.setpriority(os.PRIO_PROCESS, told["parent"], now)  # harmless, but whoever may set this may set another


def _try_shared_memory(told):
    libc = ctypes.CDLL(None, use_errno=True)
    libc.shmget(0, 4096, 0o1600) >= 0 or refused(os.strerror(ctypes.get_errno()))


def _try_delete_targets(told):
    Path(told["targets"]).unlink()


class Patched(Attack):
    """Replaces the harness's rules, in the only process that it has, and answers against them."""

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> a probability that no rule allows."""
        import eigenbench.answers
        import eigenbench.metrics

        eigenbench.answers.check_answer = lambda *given: 0
        eigenbench.metrics.decide = lambda *given: given[0][:, 0] > 0
        return {"probability": [7.0] * len(env)}


def patched_scorer(task, checkpoint=None, device="cpu"):
    """Return the model that patches."""
    return Patched(None)


write_outside = model(_try_write_outside)
own_file = model(_try_own_file)
planted_bytecode = model(_try_planted_bytecode)
delete_targets = model(_try_delete_targets)
open_targets = model(_try_open_targets)
touch_targets = model(_try_touch_targets)
signal_parent = model(_try_signal_parent)
signal_group = model(_try_signal_group)
slow_parent = model(_try_slow_parent)
shared_memory = model(_try_shared_memory)
everything = together(sys.modules[__name__])
