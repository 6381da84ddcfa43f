"""Tables in a terminal of 80 columns: no cell is cut, no line is longer, every row is told by its first column."""

from contextlib import redirect_stdout
from io import StringIO

import pytest
from hypothesis import given
from hypothesis import strategies as st
from stored_scores import TASKS_STORED, expected

from eigenbench.description import describe
from eigenbench.tables import print_description, print_noise, print_result, print_statistics
from eigenbench.terminal import WIDTH, show, table_of

WORDS = st.text("abcdefgh", min_size=1, max_size=30)


def whole(printed: str) -> list[str]:
    """Return the lines of printed tables, which begin with a space, after checking that none is cut or too long."""
    assert "\u2026" not in printed
    lines = [line for line in printed.splitlines() if line.startswith(" ")]
    assert max(map(len, lines)) <= WIDTH
    return lines


def printed(table, **options) -> str:
    """Return what is printed of a table."""
    with redirect_stdout(StringIO()) as out:
        show(table, **options)
    return out.getvalue()


@given(st.lists(st.tuples(WORDS, WORDS), min_size=1, max_size=8), st.integers(80, 200))
def test_every_cell_is_there(columns, width):
    """In as many parts as needed, each within the width, each with the first column."""
    table = table_of("title", "key", *(title for title, _ in columns))
    table.add_row("k", *(cell for _, cell in columns))
    shown = printed(table, width=width).splitlines()
    assert max(map(len, shown)) <= width
    rows = [line.split() for line in shown if line.split()[:1] == ["k"]]
    heads = [line.split() for line in shown if line.split()[:1] == ["key"]]
    assert [cell for row in rows for cell in row[1:]] == [cell for _, cell in columns]
    assert [title for row in heads for title in row[1:]] == [title for title, _ in columns]


def test_what_fits_is_one_table():
    """And a column that is too wide alone is not cut."""
    narrow, wide = table_of("", "a", "b", "c"), table_of("t", "a", "b", "c")
    narrow.add_row("1", "2", "3")
    wide.add_row("1", "x" * 100, "3")
    assert [line.split() for line in printed(narrow).splitlines() if "1" in line] == [["1", "2", "3"]]
    assert [line.split() for line in printed(wide).splitlines() if "1" in line] == [["1", "x" * 100], ["1", "3"]]
    keys = table_of("t", "a", "b", "c", "d")
    keys.add_row("1", "2", "x" * 60, "y" * 60)
    assert [line.split()[:2] for line in printed(keys, keys=2).splitlines() if "1" in line] == [["1", "2"]] * 2


@pytest.mark.parametrize("task", TASKS_STORED)
def test_results_are_whole(task, capsys):
    """Lengths, angles, planes, cavities, groups and rotations of every task that has them."""
    head = {"model": {"file": "m"}, "data": {"task": task, "split": "test", "digest": "0" * 64}}
    print_result({**head, "scores": expected(task), "isolation": {"level": "none", "network": "shut"}})
    lines = whole(capsys.readouterr().out)
    own = {"fit": ("largest", "another"), "multitube": ("clause",), "tube-rotated": ("matching of axes",)}
    assert all(any(word in line for line in lines) for word in own.get(task, ()))


def test_tables_of_several_tasks_are_whole(every_task, capsys):
    """Statistics, label noise and what was made: the wide ones in parts, each with task and split."""
    descriptions = [d for name in ("box", "multitube") for d in describe(every_task[name], measured=True)]
    print_statistics(descriptions)
    print_description(descriptions[0])
    near = {"0.01": {"lost": 3, "positives": 100}, "0.1": {"lost": 3, "positives": 1000}}
    counts = {"pairs": 20_000, "positives": 10_000, "lost": 1_234, "gained": 0, "largest_lost_margin": 0.1}
    noise = {"task": "tube-rotated", "split": "train", "protocols": ("guided", "sampled"), "lost_within": near}
    print_noise([noise | counts])
    lines = whole(capsys.readouterr().out)
    assert sum(line.startswith(" multitube") for line in lines) >= 2
    assert sum(line.startswith(" tube-rotated   train") for line in lines) >= 2
