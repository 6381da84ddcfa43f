"""HTML and SVG as values. Text is escaped unless it is markup already, so no name or category can become code."""

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable
from functools import cache, lru_cache
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
    return value if isinstance(value, Html) else Html(_shown(value))


def _shown(value: object) -> str:
    """Return markup as it is, and anything else escaped; the digits of plain numbers need no look."""
    if isinstance(value, str):
        return value if isinstance(value, Html) else _escaped(value)
    kind = type(value)
    return str(value) if kind is int or kind is float else _escaped(str(value))


@lru_cache(maxsize=1 << 14)
def _escaped(value: str) -> str:
    shown = printable(value)
    return html.escape(shown, quote=True) if _ESCAPED.search(shown) else shown


@cache
def _attribute(key: str) -> str:
    return key.rstrip("_").replace("_", "-")


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """Return an element. Attributes: `class_` is class, `_` becomes `-`, None and False are left out, True is bare."""
    opening = name
    for key, value in attributes.items():
        if value is True:
            opening += " " + _attribute(key)
        elif value is not None and value is not False:
            opening += f' {_attribute(key)}="{_shown(value)}"'
    if not children and name in _VOID:
        return Html(f"<{opening}>" if name in ("meta", "br", "input") else f"<{opening}/>")
    return Html(f"<{opening}>{''.join([_shown(c) for c in children if c is not None])}</{name}>")


def join(children: Iterable[object]) -> Html:
    """Return children one after the other; None is left out."""
    return Html("".join([_shown(c) for c in children if c is not None]))


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
