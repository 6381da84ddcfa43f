"""The board's site: every page there, every link leads somewhere, and no markup from an entry survives."""

import re
from html.parser import HTMLParser

import pytest
from boarded import NAME

from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.boards import award_badge, challenge, open_board, read_manifests, withdraw
from eigenbench.leaderboard.site import build_site

_VOID = {"meta", "path", "rect", "circle", "line", "br", "polygon", "input"}


class Parsed(HTMLParser):
    """Names, attributes and text of a page; checks that elements nest."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags, self.links, self.open, self.said = [], [], [], ""
        self.feed(source)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        """Open an element."""
        self.tags.append(tag)
        assert not any(name.startswith("on") for name, _ in attrs)
        self.links += [value for name, value in attrs if name in ("href", "src")]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, _):
        """Note an empty element."""
        self.tags.append(tag)

    def handle_endtag(self, tag):
        """Close the innermost element."""
        assert self.open.pop() == tag

    def handle_data(self, data):
        """Keep text."""
        self.said += data


def test_pages_and_links(whole_board, tmp_path):
    """One page a task and entry; links lead to pages, anchors or https; only our scripts are in them."""
    pages = build_site(whole_board, tmp_path / "site")
    names = {p.name for p in pages}
    assert names == {"index.html", "task-tube.html", "task-sphere.html", *(f"entry-{k:05d}.html" for k in range(1, 5))}
    for path in pages:
        found = Parsed(path.read_text())
        for link in found.links:
            assert link in names or link.startswith("https://example.org/") or f'id="{link[1:]}"' in path.read_text()
        assert found.tags.count("script") == {"task-": 2, "entry": 1}.get(path.name[:5], 0)
        assert not {"b", "i", "img", "iframe", "object"} & (set(found.tags) - {"b"})


def test_markup_in_a_name_is_text(whole_board, tmp_path):
    """A name with a script in it is shown as it is, marks that turn writing around as escapes."""
    build_site(whole_board, tmp_path / "site")
    shown = NAME.replace("\u202e", "\\u202e")
    for name in ("index.html", "task-tube.html", "entry-00001.html"):
        source = (tmp_path / "site" / name).read_text()
        assert "<script>window.bad" not in source
        assert "<b onmouseover" not in source
        assert shown in Parsed(source).said


def test_entries_out_of_the_ranking(board, board_data, tmp_path):
    """Withdrawn entries stand apart with their history; challenged ones stay ranked; badges are shown."""
    challenge(board, 2, "a <reader>", "why & how", ["https://example.org/why"])
    withdraw(board, 3, "author", "a bug")
    award_badge(board, 1, "rescored", "us", [board_data])
    build_site(board, tmp_path / "site")
    task = (tmp_path / "site" / "task-tube.html").read_text()
    ranking, out = task.split('id="out"')
    assert ranking.count("entry-00003") == 0
    assert out.count("entry-00003") == 1
    assert ">challenged<" in ranking
    assert ">rescored<" in ranking
    page = (tmp_path / "site" / "entry-00002.html").read_text()
    assert "a &lt;reader&gt;" in page
    assert 'href="https://example.org/why"' in page
    assert re.search(r"withdrawn</b> by author: a bug", (tmp_path / "site" / "entry-00003.html").read_text())


def test_an_empty_board_has_a_site(board_data, tmp_path):
    """Its tasks are there, without entries and filters."""
    open_board(tmp_path / "board", "empty", read_manifests([board_data]))
    assert len(build_site(tmp_path / "board", tmp_path / "site")) == 3
    page = (tmp_path / "site" / "task-tube.html").read_text()
    assert "No entry yet." in page
    assert 'id="filters"' not in page


def test_a_site_is_built_again(board, board_data, tmp_path):
    """The same board gives the same bytes; pages of what is gone go; files and folders of other things stay."""
    first = {p.name: p.read_bytes() for p in build_site(board, tmp_path / "site")}
    site = tmp_path / "site"
    stale = [site / "entry-00099.html", site / "task-mug.html"]
    for path in stale:
        path.write_bytes(first["index.html"])
    mine = [site / name for name in ("entry-notes.html", "task-List.html", "entry-00098.html", "task-top.html")]
    for path in mine:
        path.write_text("mine")
    (site / "entry-00097.html").symlink_to(site / "index.html")
    assert {p.name: p.read_bytes() for p in build_site(board, tmp_path / "site")} == first
    assert not any(path.exists() for path in stale)
    assert [path.read_text() for path in mine] == ["mine"] * 4
    assert (site / "entry-00097.html").is_symlink()
    with pytest.raises(UsageError, match="holds something that is no site"):
        build_site(board, board_data)
    (board / "00001" / "run-1.npz").write_bytes(b"")
    with pytest.raises(DataError, match="is not in order: record 1: run-1.npz was altered"):
        build_site(board, tmp_path / "site")


@pytest.mark.parametrize("kept", ["index.html", "entry-00001.html"])
def test_what_is_no_site_is_left_alone(whole_board, tmp_path, kept):
    """A folder with a first page of somebody else's is refused, so is a site where a page would replace his file."""
    site = tmp_path / "site"
    build_site(whole_board, site)
    (site / kept).write_text("<html><head><title>mine</title></head></html>")
    (site / "entry-00099.html").write_text("mine")
    before = {p.name: p.read_bytes() for p in site.iterdir()}
    with pytest.raises(UsageError, match=r"Remove it, or choose another --out|would be replaced by one\. Move it away"):
        build_site(whole_board, site)
    assert {p.name: p.read_bytes() for p in site.iterdir()} == before
