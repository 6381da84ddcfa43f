"""The entries in leaderboard/entries: chain, schema and digests; with EIGENBENCH_BOARD_DATA every score again."""

import os
from pathlib import Path

import pytest
from material import ROOT

from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.site import build_site

BOARD = ROOT / "leaderboard" / "entries"
pytestmark = pytest.mark.skipif(not (BOARD / "00000").is_dir(), reason="leaderboard/entries holds no board yet")


def test_entries_are_good(tmp_path):
    """Nothing is wrong with any record, and the site can be made."""
    found = verify_board(BOARD)
    assert [f"record {f.number}: {f.what}" for f in found.faults] == []
    assert (build_site(BOARD, tmp_path / "site")[0]).is_file()


def test_scores_follow_from_the_predictions():
    """Every entry's numbers are found again on the public test splits."""
    data = os.environ.get("EIGENBENCH_BOARD_DATA")
    if not data:
        pytest.skip("EIGENBENCH_BOARD_DATA does not name a folder with the public test splits")
    found = verify_board(BOARD, [Path(data)])
    assert [f"record {f.number}: {f.what}" for f in found.faults] == []
