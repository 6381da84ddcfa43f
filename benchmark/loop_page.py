"""`navigation.html`: one offline file that shows a closed-loop run: tables, top views, paths to play."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.errors import printable
from eigenbench.loop_drawing import top_view
from eigenbench.loop_frames import frames
from eigenbench.loop_record import Told
from eigenbench.loop_tables import difference_table, policy_table
from eigenbench.markup import Html, embedded_json, join, page, section, tag
from eigenbench.report_html import facts, table_html
from eigenbench.shape_units import why_none
from eigenbench.viewing import write_page

PLAYED = 3
"""Robots whose path is played."""
SHOWN = 12
"""Rooms that are shown from above."""
_KEY = (
    ("free", "free floor of this robot"),
    ("covered", "covered"),
    ("solid", "it can touch this"),
    ("overhead", "it goes under this"),
    ("touched", "collision"),
)


def write_loop_page(path: Path, told: Told, result: Mapping[str, Any]) -> Path:
    """Write the page of a run and return its path; UsageError or DataError where that cannot be."""
    return write_page(path, render_loop_page(told, result))


def render_loop_page(told: Told, result: Mapping[str, Any]) -> str:
    """Return the page of a run as one HTML document."""
    title = f"{result['model']['file']} in {result['scores']['rooms']} rooms"
    body = tag("main", _scores(result), _played(told), _rooms(told), _provenance(result), id="main")
    return page(
        f"{printable(title)} · eigenbench",
        join([_header(result, title), body]),
        scripts=("page.js", "navigation.js"),
        styles=("page.css", "navigation.css"),
    )


def _header(result: Mapping[str, Any], title: str) -> Html:
    model = result["scores"]["policies"]["model"]
    isolation = result["isolation"]
    reached, beside = (result["scores"]["policies"][p]["reached"]["value"] for p in ("model", "oracle"))
    said = (
        f"It covers {reached:.1%} of its free floor (an oracle {beside:.1%}), goes {model['distance']['value']:.1f} m, "
        f"and {model['collided']['value']:.1%} of its robots touch something."
    )
    policy = result["policy"]
    rule = (
        f"{result['scores']['robots']} robots, {policy['steps']} steps each: forward by {policy['forward_m']} m where "
        f"the model says that the robot passes, else clockwise by {-policy['turn_degrees']:g} degrees. After a "
        f"collision the robot {'turns' if policy['bumper'] else 'stays where it is and does the same again'}."
    )
    eyebrow = f"eigenbench {result['eigenbench']} · {result['date']} · isolation {isolation['level']}"
    lines = [
        tag("a", "Skip to the scores", href="#main", class_="skip"),
        tag("p", eyebrow, class_="eyebrow"),
        tag("h1", title),
        tag("p", said, class_="verdict"),
        tag("p", rule, class_="note"),
        *(
            tag("p", f"Check not passed: {check['name']}: {check['seen']}.", class_="note")
            for check in result.get("checks") or ()
            if check["passed"] is False
        ),
    ]
    return tag("header", *lines)


def _scores(result: Mapping[str, Any]) -> Html:
    about = result["scores"]["interval"]
    why = why_none(about["freedom"], about["least_freedom"])
    tables = [table_html(policy_table(result)), table_html(difference_table(result))]
    return section("scores", "Scores", tag("p", why, class_="note") if why else None, *tables)


def _played(told: Told) -> Html:
    chosen = told.chosen(PLAYED)
    lines = [
        f"{side}: slot {line.slot}, {line.slope:.3g} times its length {line.offset:+.3g} m, R2 {line.r2:.2f} on robots"
        for side, line in told.lines.items()
    ]
    words = (
        f"The free rectangle as the model's lengths tell it, mapped to metres by its robots ({'; '.join(lines)}). "
        if lines
        else "The model tells no lengths that a line maps to metres: no rectangle is drawn. "
    )
    words += "Green where it says that the robot passes, red where not. The robots stand in the middle of "
    words += f"{len(chosen)} equal shares, ordered by what they covered."
    figures = [_figure(told, robot, number) for number, robot in enumerate(chosen)]
    data = embedded_json([frames(told, robot) for robot in chosen], "frames")
    return section("paths", "Paths to play", tag("p", words, class_="note"), _keys(), *figures, data)


def _figure(told: Told, robot: int, number: int) -> Html:
    controls = tag(
        "div",
        tag("button", "Play", type="button", class_="play"),
        tag("input", type="range", min=0, max=0, value=0, aria_label="Step"),
        tag("output", "", class_="step"),
        class_="tools",
    )
    picture = tag("canvas", width=480, height=360, role="img", aria_label="What the depth camera sees")
    views = tag("div", top_view(told, robot, live=True), picture, class_="views")
    return tag("figure", _caption(told, robot), views, controls, class_="drive", data_number=number)


def _caption(told: Told, robot: int) -> Html:
    diameter, height = told.fleet.sizes[robot].tolist()
    counts, beside = told.counts["model"], told.counts["oracle"]
    room = told.fleet.rooms[int(told.fleet.room[robot])]
    stuck = ", stuck" if counts.stuck[robot] else ""
    words = (
        f"{room.name} · robot {diameter:.2f} m wide, {height:.2f} m high · {counts.distance[robot]:.1f} m, "
        f"{counts.reached[robot]:.0%} of {told.floors[robot].area:.1f} m2 covered "
        f"(oracle {beside.reached[robot]:.0%}), {counts.collisions[robot]:.0f} collisions{stuck}"
    )
    return tag("figcaption", words)


def _rooms(told: Told) -> Html:
    rooms = np.unique(told.fleet.room)[:SHOWN]
    figures = []
    for room in rooms:
        robots = np.flatnonzero(told.fleet.room == room)
        order = np.argsort(told.counts["model"].reached[robots], kind="stable")
        robot = int(robots[order[(len(order) - 1) // 2]])
        figures.append(tag("figure", top_view(told, robot), _caption(told, robot), class_="top"))
    of = f"{len(rooms)} rooms of {len(told.fleet.rooms)}"
    note = f"In each room the robot in the middle, ordered by what it covered; {of}."
    return section("rooms", "From above", tag("p", note, class_="note"), _keys(), tag("div", *figures, class_="tops"))


def _keys() -> Html:
    keys = (tag("span", tag("span", class_=f"swatch {name}"), words) for name, words in _KEY)
    return tag("p", *keys, class_="keys")


def _provenance(result: Mapping[str, Any]) -> Html:
    told = ("model", "policy", "isolation", "limits", "hardware", "seeds", "seconds")
    tables = [facts(result[name], name) for name in told]
    course = {k: v for k, v in result["course"].items() if not isinstance(v, dict)}
    tables.append(facts(course | {"paths_digest": result["paths_digest"]}, "course"))
    return section("provenance", "Provenance", tag("div", *tables, class_="columns"))
