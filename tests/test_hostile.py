"""What the hostile models of tests/hostile get: nothing at a level that claims to stop them."""

import pytest
from hostile_runs import ALWAYS_ENDED, ATTACKS, NEVER, SUMS, attacks, expected_to_win, levels, run_attack, winners

LEVELS = [
    pytest.param(level, marks=pytest.mark.skipif(bool(reason), reason=f"no level {level}: {reason}"))
    for level, reason in levels().items()
]
STRONGEST = [level for level, reason in levels().items() if not reason][-1]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", ["reads", "changes", "calls"])
def test_who_wins(kind, level):
    """Reading answers, changing things, calling home: all is stopped from landlock on, and nothing below.

    That the same attempts succeed at the levels below shows that it is the isolation which stops them.
    """
    together = set(ATTACKS[kind]) - {"patched_scorer"}
    assert winners(kind, level) == {name for name in together if expected_to_win(kind, name, level)}


@pytest.mark.parametrize("name", [*ATTACKS["lies"], "patched_scorer"])
def test_lies(name):
    """No answer is believed that breaks the interface, whatever bytes it comes in."""
    outcome = run_attack("changes" if name == "patched_scorer" else "lies", name, STRONGEST, timeout=1.5)
    assert not outcome.won
    assert "model" in outcome.said.lower() or ".py" in outcome.said


def test_nothing_is_expected_of_what_does_not_exist():
    """The sets of expectations name known attacks only, and no name stands for two attacks."""
    assert set(attacks()) >= SUMS | ALWAYS_ENDED | NEVER
    names = [name for _, name in attacks()]
    assert len(set(names)) == len(names)
