"""The page of a closed-loop run in headless Chromium: it loads alone, draws, plays, turns dark, fits a phone."""

import pytest
from browser import CHROMIUM, browser
from material import model
from plain_rooms import course_of, furnished, robot_cloud

from eigenbench.fleets import draw_fleet
from eigenbench.navigation import navigate

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium (apt-get install chromium)")

SIDES = (
    "r, t = 2 * np.abs(obj[..., 1]).max(1), obj[..., 2].max(1); "
    "w = 2 * np.where((env[..., 2] > 0.02) & (env[..., 0] < 0.6), np.abs(env[..., 1]), 1.0).min(1); "
    "return {'env_lengths': np.stack([w, 0 * w + 1.5], 1), 'obj_lengths': np.stack([r, t], 1)}"
)
INKED = """[...document.querySelectorAll('.drive canvas')].map((c) => {
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let inked = 0;
  for (let k = 3; k < d.length; k += 4) if (d[k] > 40) inked += 1;
  return inked;
})"""
AT = "document.querySelector('.drive .robot').getAttribute('transform')"
OUTPUT = "document.querySelector('.drive output').textContent"


@pytest.fixture(scope="module")
def page():
    """Return a browser's page."""
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the page of a run whose room's name is markup."""
    place = tmp_path_factory.mktemp("loop")
    rooms = furnished()
    object.__setattr__(rooms[0], "name", "<b onmouseover=alert(1)>")

    def draws(rng):
        return rng.uniform(0.2, 0.5), rng.uniform(0.2, 1.2)

    fleet = draw_fleet(rooms, 3, 0, draws, robot_cloud)
    return navigate(model(place, SIDES), course_of(fleet), place / "run", steps=60).folder / "navigation.html"


def test_loads_alone_and_draws(page, written):
    """No complaint, no request but for the file itself; every view is drawn, every robot stands in its room."""
    page.media("light")
    page.open(written)
    assert page.complaints() == []
    assert page.requested() == [written.resolve().as_uri()]
    assert page.value("document.querySelectorAll('b').length") == 0
    assert len(inked := page.value(INKED)) == 3
    assert min(inked) > 300
    assert page.value("document.querySelectorAll('.drive .robot circle').length") == 3
    assert page.value("document.querySelectorAll('svg.room').length") == 5


def test_plays_and_steps(page, written):
    """The slider moves the robot, a click plays on, another stops; the words say what the model says."""
    page.open(written)
    first = page.value(AT)
    page.value(
        "(() => { const i = document.querySelector('.drive input'); i.value = 25; i.dispatchEvent(new Event('input')); })()"
    )
    assert page.value(AT) != first
    assert page.value(OUTPUT).startswith("step 26 of ")
    assert "m wide" in page.value(OUTPUT)
    page.value("document.querySelector('.drive button').click()")
    waited = "new Promise((done) => setTimeout(() => done(document.querySelector('.drive button').textContent), 500))"
    assert page.value(waited) == "Pause"
    assert int(page.value(OUTPUT).split()[1]) > 26
    page.value("document.querySelector('.drive button').click()")
    assert page.value("document.querySelector('.drive button').textContent") == "Play"


def test_the_bar_is_green_or_red(page, written):
    """Where the model says that the robot passes the free width is green, else red."""
    page.open(written)
    colours = page.value(
        """(() => {
  const figure = document.querySelector('.drive'), slider = figure.querySelector('input'), seen = {};
  for (let k = 0; k <= slider.max; k += 1) {
    slider.value = k; slider.dispatchEvent(new Event('input'));
    const says = figure.querySelector('output').textContent.includes('does not pass') ? 'blocked' : 'passes';
    (seen[says] ||= new Set()).add(getComputedStyle(figure.querySelector('.says')).stroke);
  }
  return Object.fromEntries(Object.entries(seen).map(([says, set]) => [says, [...set]]));
})()"""
    )
    assert colours == {"passes": ["rgb(42, 122, 72)"], "blocked": ["rgb(179, 55, 47)"]}


def test_dark_and_narrow(page, written):
    """It turns dark, and on a phone nothing is wider than the window."""
    page.media("dark")
    page.open(written)
    assert page.value("getComputedStyle(document.body).backgroundColor") == "rgb(19, 22, 25)"
    page.resize(400)
    assert page.value("document.documentElement.scrollWidth") <= 400
    page.media("light")
