"""What every hostile model is told, as if an insider had helped it, and how it says that it won."""

import json
from pathlib import Path

LOOT = 0.25
"""The probability that a model answers when its attempt succeeded, and nothing else."""
TOLD = Path(__file__).with_name("told.json")


class Attack:
    """A model that answers LOOT if its attempt returns, and fails as the attempt does if it raises."""

    def __init__(self, attempt):
        self.attempt = attempt

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> probability (B,)."""
        self.attempt(json.loads(TOLD.read_text()))
        return {"probability": [LOOT] * len(env)}


def model(attempt):
    """Make a builder, as the interface wants it, of a function that attempts something."""
    return lambda task, checkpoint=None, device="cpu": Attack(attempt)


def refused(why="refused without a word"):
    """Say that the attempt brought nothing."""
    raise PermissionError(why)


class Together(Attack):
    """A model that makes many attempts, one after the other, and answers LOOT in the rows of those that won."""

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> probability (B,), a row an attempt."""
        told = json.loads(TOLD.read_text())
        won = [self._wins(one, told) for one in self.attempt]
        return {"probability": [LOOT if w else 0.5 for w in won] + [0.5] * (len(env) - len(won))}

    def _wins(self, attempt, told):
        try:
            attempt(told)
        except Exception as error:
            print(attempt.__name__, error)
            return False
        return True


def together(module):
    """Make a builder of all of a module's attempts, the functions whose name begins with _try, in their order."""
    attempts = [value for name, value in vars(module).items() if name.startswith("_try_")]
    return lambda task, checkpoint=None, device="cpu": Together(attempts)
