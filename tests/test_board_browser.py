"""The site in headless Chromium: alone, by keyboard, light and dark, on a phone, and deaf to what entries say."""

import pytest
from browser import CHROMIUM, browser

from eigenbench.leaderboard.site import build_site

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium (apt-get install chromium)")
_ROWS = "[...document.querySelectorAll('#content table.board tbody tr')].filter((r) => !r.hidden)"


@pytest.fixture(scope="module")
def page():
    """Return a browser's page."""
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def site(whole_board, tmp_path_factory):
    """Return the folder of a site."""
    out = tmp_path_factory.mktemp("site") / "site"
    build_site(whole_board, out)
    return out


def test_pages_load_alone_and_no_entry_runs(page, site):
    """No complaint, no request but for the page, no script from a name; what is put in later does not run either."""
    for path in sorted(site.iterdir()):
        page.open(path)
        assert page.complaints() == [], path
        assert page.requested() == [path.resolve().as_uri()]
        assert page.value("window.bad === undefined && document.querySelectorAll('[onmouseover]').length === 0")
    page.value(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.bad = 1'; document.body.append(s); })()"
    )
    assert page.value("window.bad === undefined")


def test_rows_sort_and_filter_by_keyboard(page, site):
    """Headings sort by what they say, the badge and the words leave out rows, and the count says how many are left."""
    page.open(site / "task-tube.html")
    assert page.value("document.getElementById('filters').hidden") is False
    assert page.value("document.getElementById('count').textContent") == "3 of 3 entries"
    column = f"{_ROWS}.map((r) => Number(r.cells[2].dataset.v))"
    assert page.value(column) == sorted(page.value(column), reverse=True)
    page.value("document.querySelectorAll('#content thead button')[2].focus()")
    page.press("Enter")
    assert page.value(column) == sorted(page.value(column))
    for value, left in (("1", 0), ("0", 3)):
        page.value(
            f"(() => {{ const e = document.getElementById('least'); e.value = '{value}'; e.dispatchEvent(new Event('input', {{bubbles: true}})); }})()"
        )
        assert page.value(f"{_ROWS}.length") == left
    page.value("document.getElementById('words').focus()")
    for letter in "model 2":
        page.call("Input.insertText", text=letter)
    assert page.value(f"{_ROWS}.length") == 1
    assert page.value("document.getElementById('count').textContent") == "1 of 3 entries"


def test_every_control_is_reached_and_named(page, site):
    """Tab visits each link, button, field and scrolling table, with an outline."""
    page.open(site / "task-tube.html")
    found = "[...document.querySelectorAll('a, button, input, select, summary, [tabindex]')].filter((e) => e.checkVisibility())"
    wanted = page.value(f"{found}.length")
    seen = set()
    for _ in range(wanted + 3):
        page.press("Tab")
        number, outline = page.value(
            f"[{found}.indexOf(document.activeElement), getComputedStyle(document.activeElement).outlineStyle]"
        )
        seen.add(number)
        assert number < 0 or outline != "none"
    assert seen - {-1} == set(range(wanted))
    unnamed = "[...document.querySelectorAll('button, input, select, svg')].filter((e) => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).length"
    assert page.value(unnamed) == 0


@pytest.mark.parametrize("width", [380, 800, 1200])
def test_pages_fit_their_window(page, site, width):
    """No page scrolls sideways, in light or dark."""
    for path in sorted(site.iterdir()):
        page.open(path, width=width)
        assert page.value("document.documentElement.scrollWidth") <= width, path


def test_light_and_dark(page, site):
    """The two schemes differ."""
    looks = []
    for scheme in ("light", "dark"):
        page.media(scheme)
        page.open(site / "index.html")
        looks.append(page.value("getComputedStyle(document.body).backgroundColor"))
    assert looks[0] != looks[1]


def test_a_long_board_shows_its_first_rows(page, site):
    """Of many rows the first 200 are shown, in the order that they were sorted to, and all on demand."""
    page.open(site / "task-tube.html")
    page.value(
        "(() => { const b = document.querySelector('table.board').tBodies[0]; const r = b.rows[0];"
        " for (let k = 0; k < 300; k += 1) { const c = r.cloneNode(true); c.cells[2].dataset.v = k / 1000; b.append(c); }"
        " document.getElementById('words').dispatchEvent(new Event('input', {bubbles: true})); })()"
    )
    assert page.value(f"{_ROWS}.length") == 200
    page.value("document.querySelectorAll('#content thead button')[2].click()")
    assert page.value(f"{_ROWS}.length") == 200
    assert page.value(f"Number({_ROWS}[0].cells[2].dataset.v)") == 0
    page.value("document.getElementById('all').focus()")
    page.press("Enter")
    assert page.value(f"{_ROWS}.length") == 303
    assert page.value("document.getElementById('all').hidden")
