"""What is printed of learning and of comparisons is whole in 80 columns."""

import pytest

from eigenbench.tables_learning import print_comparison, print_learning

METRICS = {
    "accuracy": {"value": 0.98765, "low": 0.97654, "high": 0.99876, "deviation": 0.0123},
    "auroc": {"value": 0.98765, "low": 0.97654, "high": 0.99876, "deviation": None},
    "matched_r2": {"value": 0.98765, "low": 0.97654, "high": 0.99876, "deviation": 0.0123},
    "angle_degrees": {"value": 57.29578, "low": 55.12345, "high": 59.54321, "deviation": 1.25},
}


def whole(printed: str) -> list[str]:
    """Return the printed lines after checking that no cell is cut short."""
    assert "\u2026" not in printed
    lines = printed.splitlines()
    assert max(map(len, lines)) <= 80
    return lines


def test_learning_is_whole(capsys):
    """Draws and sizes have their numbers, means their intervals and deviations."""
    draws = [{"draw": k, "learning_seconds": 1234.5, **METRICS} for k in range(10)]
    sizes = [{"pairs": n, "subsets": [{"learning_seconds": 1234.5}], **METRICS} for n in (300, 75_000)]
    print_learning(
        {
            "few_shot": {"provided": True, "pairs_per_draw": 320, "draws": draws, **METRICS},
            "data_efficiency": {"provided": True, "sizes": sizes, "area": 0.9},
        }
    )
    lines = whole(capsys.readouterr().out)
    assert lines[0] == "Few-shot: 320 pairs a draw"
    assert any(line.split() == ["10", "98.77%", "0.9877", "0.9877", "57.2958", "1234.5"] for line in lines)
    assert any(line.split() == ["accuracy", "98.77%", "[97.65%,", "99.88%]", "1.23%"] for line in lines)
    assert any(line.split()[:2] == ["75,000", "98.77%"] for line in lines)


@pytest.mark.parametrize("name", ["a", "bounding_box-tube-rotated-test-20261122T121030"])
def test_comparison_is_whole(capsys, name):
    """Long names of runs are cut in their middle; differences name the runs by number."""
    interval = {k: METRICS["accuracy"][k] for k in ("value", "low", "high")}
    standing = interval | {"rank": [1, 12], "tied_with": [0, 1]}
    difference = {"runs": [0, 1], "difference": interval, "p": 0.5, "p_holm": 0.5, "tied": True}
    accuracy = {"better": "higher", "runs": [standing] * 2, "differences": [difference]}
    data = {"task": "tube", "split": "test", "pairs": 20, "digest": "0" * 64}
    found = {
        "data": data,
        "correction": "Holm",
        "interval": {},
        "runs": [{"run": f"runs/{name}"}] * 2,
        "metrics": {"accuracy": accuracy},
    }
    print_comparison(found)
    lines = whole("\n".join(capsys.readouterr().out.splitlines()[1:]))
    assert any(line.startswith(" 1 - 2 ") and "+98.77% [+97.65%, +99.88%]" in line for line in lines)
    assert any(line.startswith(" 2: ") and line.rstrip().endswith("1, 2") for line in lines)
