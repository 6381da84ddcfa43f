"""HTML and SVG as values. Text is escaped unless it is markup already, so no name or category can become code."""

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any

from eigenbench.errors import printable

_ESCAPED = re.compile("[&<>\"']")
_VOID = frozenset({"meta", "path", "rect", "circle", "line", "br", "polygon", "input"})


class Html(str):
    """A piece of finished markup."""

    __slots__ = ()


def text(value: object) -> Html:
    """Return a value as text: markup and unprintable characters (line breaks, direction marks) are escaped."""
    if isinstance(value, Html):
        return value
    shown = printable(str(value))
    return Html(html.escape(shown, quote=True) if _ESCAPED.search(shown) else shown)


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """Return an element. Attributes: `class_` is class, `_` becomes `-`, None and False are left out, True is bare."""
    parts = [name]
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        attribute = key.rstrip("_").replace("_", "-")
        parts.append(attribute if value is True else f'{attribute}="{text(value)}"')
    opening = " ".join(parts)
    if name in _VOID and not children:
        return Html(f"<{opening}>" if name in ("meta", "br", "input") else f"<{opening}/>")
    return Html(f"<{opening}>{join(children)}</{name}>")


def join(children: Iterable[object]) -> Html:
    """Return children one after the other; None is left out."""
    return Html("".join(text(c) for c in children if c is not None))


def details(summary: str, *children: object, open_: bool = False) -> Html:
    """Return a block that folds away."""
    return tag("details", tag("summary", summary), *children, open=open_)


def section(name: str, title: str, *children: object) -> Html:
    """Return a titled section that the table of contents can point at."""
    heading = tag("h2", title, id=f"{name}-title")
    return tag("section", heading, *children, id=name, aria_labelledby=f"{name}-title")


def embedded_json(data: Any, name: str) -> Html:
    """Return data for a script to read by id; no `<` survives in it, so it cannot end its own element."""
    body = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return tag("script", Html(body), type="application/json", id=name)


def page(
    title: str,
    *body: object,
    scripts: Iterable[str] = ("page.js", "viewer.js"),
    styles: Iterable[str] = ("page.css",),
) -> str:
    """Return a whole offline document with scripts and style sheets of the package.

    Its content security policy lets nothing be fetched, and no script run but the ones put in here, named by hash.
    """
    sources = [asset(name) for name in scripts]
    hashes = " ".join(f"'sha256-{_sha256(source)}'" for source in sources) or "'none'"
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", Html("".join(map(asset, styles)))),
    )
    ends = [tag("script", Html(source)) for source in sources]
    return f"<!doctype html>\n{tag('html', head, tag('body', *body, *ends), lang='en')}\n"


@cache
def asset(name: str) -> str:
    """Return a style sheet or script that is installed with the package."""
    return files("eigenbench").joinpath("assets", name).read_text(encoding="utf-8")


def _sha256(source: str) -> str:
    return base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()
