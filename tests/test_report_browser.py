"""Pages in headless Chromium: they load alone, draw, obey the keyboard, turn dark, print, and fit a phone."""

import base64

import pytest
from browser import CHROMIUM, browser
from reported import make_run

from eigenbench.report import write_report
from eigenbench.viewing import write_gallery, write_view

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium (apt-get install chromium)")

INKED = """[...document.querySelectorAll('canvas')].map((c) => {
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  const seen = new Set(); let inked = 0;
  for (let k = 0; k < d.length; k += 4) if (d[k + 3] > 40) { inked += 1; seen.add(d[k] >> 5 | d[k + 1] >> 5 << 3 | d[k + 2] >> 5 << 6); }
  return [inked, seen.size];
})"""
SUM = "(() => { const c = document.querySelector('canvas'); return c.toDataURL(); })()"


@pytest.fixture(scope="module")
def page():
    """Return a browser's page."""
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def report(tmp_path_factory, test_split):
    """Return a report."""
    run = make_run(tmp_path_factory.mktemp("report"), test_split)
    return write_report(run, test_split)


def test_loads_alone_and_draws(page, report):
    """No complaint in the console, no request but for the file itself, and no canvas is blank."""
    page.media("light")
    page.open(report)
    inked = page.value(INKED)
    assert len(inked) > 6
    assert all(pixels > 1500 and colours >= 3 for pixels, colours in inked)
    assert page.complaints() == []
    assert page.requested() == [report.resolve().as_uri()]
    assert page.value("document.querySelector('h1').textContent").startswith('"><b onmouseover=alert(1)>&.py on tube')
    assert page.value("document.querySelectorAll('b').length") == 0


def test_policy_stops_what_is_not_ours(page, report):
    """A script that got into the page does not run, and nothing can be fetched."""
    page.open(report)
    page.value(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.bad = 1'; document.body.append(s); })()"
    )
    assert page.value("window.bad === undefined")
    assert page.value("fetch('data:text/plain,x').then(() => 'fetched', () => 'refused')") == "refused"


def test_every_control_is_reached_by_keyboard(page, report):
    """Tab visits each link, button, switch, canvas and fold, and what has the focus shows it."""
    page.open(report)
    found = (
        "[...document.querySelectorAll('a, button, input, summary, canvas, [tabindex]')]"
        ".filter((e) => e.checkVisibility({contentVisibilityAuto: true, visibilityProperty: true}))"
    )
    look = f"[{found}.indexOf(document.activeElement), getComputedStyle(document.activeElement).outlineStyle]"
    wanted = page.value(f"{found}.length")
    assert wanted > 40
    seen = set()
    for _ in range(wanted + 3):
        page.press("Tab")
        number, outline = page.value(look)
        seen.add(number)
        assert number < 0 or outline != "none"
    assert seen - {-1} == set(range(wanted))
    unnamed = "[...document.querySelectorAll('button, input, canvas, svg')].filter((e) => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).length"
    assert page.value(unnamed) == 0


def test_keys_turn_and_zoom_a_scene(page, report):
    """Arrow keys and + change the picture, 0 brings it back to the bit; a switch takes the arrows away."""
    page.open(report)
    page.value("document.querySelector('canvas').focus()")
    start = page.value(SUM)
    pictures = [start]
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.press(key)
        pictures.append(page.value(SUM))
    assert len(set(pictures)) == 4
    page.press("0")
    assert page.value(SUM) == start
    for switch in ("vectors", "planes", "truth", "beside"):
        page.value(f"document.getElementById('show-{switch}').focus()")
        page.press(" ")
        pictures.append(page.value(SUM))
    assert len(set(pictures)) == 8


def test_tables_sort(page, report):
    """A heading's button sorts its table up, then down, and says so."""
    page.open(report)
    column = "[...document.querySelectorAll('#categories tbody tr')].map((r) => Number(r.cells[1].dataset.v))"
    button = "document.querySelectorAll('#categories thead button')[1]"
    page.value(f"{button}.focus()")
    page.press("Enter")
    assert page.value(column) == sorted(page.value(column))
    assert page.value(f"{button}.closest('th').ariaSort") == "ascending"
    page.press("Enter")
    assert page.value(column) == sorted(page.value(column), reverse=True)


def test_dark_light_and_print(page, report):
    """The two schemes differ, canvases too; a print is white in either, without controls, and has its pages."""
    page.open(report)
    back = "getComputedStyle(document.body).backgroundColor"
    looks = {}
    for scheme in ("light", "dark"):
        page.media(scheme)
        looks[scheme] = page.value(back), page.value(SUM)
    assert looks["light"][0] == "rgb(251, 251, 250)"
    assert looks["light"][0] != looks["dark"][0]
    assert looks["light"][1] != looks["dark"][1]
    page.media("dark", "print")
    assert page.value(back) == "rgb(255, 255, 255)"
    assert page.value("getComputedStyle(document.querySelector('.zoom')).display") == "none"
    page.media("dark")
    pdf = base64.b64decode(page.call("Page.printToPDF", printBackground=True, pageRanges="1-3")["data"])
    assert pdf.startswith(b"%PDF")
    assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") == 3


def test_fits_its_window(page, report):
    """The page never scrolls sideways; wide tables scroll in their own boxes."""
    page.open(report)
    for width in (400, 800, 1200):
        page.resize(width)
        assert page.value("document.documentElement.scrollWidth") <= width


def test_view_and_gallery_draw(page, every_task, tmp_path):
    """A pair's page and the contact sheet of every task draw without complaint."""
    for name, split in every_task.items():
        for path in (
            write_view(split, 3, tmp_path / f"view-{name}.html"),
            write_gallery(split, 6, out=tmp_path / f"gallery-{name}.html"),
        ):
            page.open(path, width=700, height=500)
            assert all(pixels > 800 for pixels, _ in page.value(INKED)), path
            assert page.complaints() == []
