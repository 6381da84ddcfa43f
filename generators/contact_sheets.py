"""Contact sheets and portraits of shapes, with captions, as PNG files. The only module that knows Pillow."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw, ImageFont

from eigenbench.errors import UsageError
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.rendering import BACKGROUND, VIEWS, Image, View, cutaway, render
from eigenbench.generators.selection import Selection
from eigenbench.generators.shapes import Shape
from eigenbench.shards import publish, temporary_beside

CELL, COLUMNS = 200, 8
"""Pixels of a shape in a sheet, and shapes a row."""
PORTRAIT = 480
"""Pixels of a view in a portrait."""
CAPTION, TITLE = 13, 20
"""Heights of the letters, pixels."""
INK, FAINT = (30, 34, 42), (112, 118, 128)
COLOURS = 255
"""Colours of a PNG's palette."""

Progress = Callable[[str, int, int], None]
"""Called with (what, shapes done, shapes in all)."""

Line = tuple[str, tuple[int, int, int]]


def draw(
    selections: Sequence[Selection], measures: bool = False, opened: bool = False, progress: Progress | None = None
) -> Image:
    """Return a portrait of a single shape, else a contact sheet; see there."""
    if sum(len(s.indices) for s in selections) == 1:
        return portrait(selections[0], measures)
    return sheet(selections, measures, opened, progress)


def sheet(
    selections: Sequence[Selection],
    measures: bool = False,
    opened: bool = False,
    progress: Progress | None = None,
) -> Image:
    """Return a contact sheet: a title a category, its shapes in rows, name and size below each.

    Parameters
    ----------
    measures : draw cavities, tops and handle gaps over the shapes
    opened : cut the shapes open
    """
    total, done = sum(len(s.indices) for s in selections), 0
    columns = max(1, min(COLUMNS, max(len(s.indices) for s in selections)))
    bands = []
    for selection in selections:
        cells = []
        for index, shape in selection.shapes():
            view = cutaway(shape, selection.role) if opened else View(VIEWS["three-quarter"])
            lines = [(f"{index}  {_printable(shape.name).removeprefix(f'{index:04d}_')}", INK), (size_of(shape), FAINT)]
            cells.append(_captioned(render(shape, selection.role, view, CELL, measures), lines))
            done += 1
            if progress:
                progress("drawing", done, total)
        blank = np.full_like(cells[0], BACKGROUND)
        cells += [blank] * (-len(cells) % columns)
        rows = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
        bands += [_text_band([(_title(selection), INK)], rows[0].shape[1], TITLE), *rows]
    return np.concatenate(bands)


def portrait(selection: Selection, measures: bool = False) -> Image:
    """Return one shape large, in four views, with its measures in words: the first of a selection."""
    index, shape = next(selection.shapes())
    views = {
        "three-quarter": View(VIEWS["three-quarter"]),
        "cut open": cutaway(shape, selection.role),
        "front": View(VIEWS["front"]),
        "top": View(VIEWS["top"]),
    }
    cells = [
        _captioned(render(shape, selection.role, view, PORTRAIT, measures), [(name, FAINT)])
        for name, view in views.items()
    ]
    rows = [np.concatenate(cells[k : k + 2], axis=1) for k in (0, 2)]
    title = f"{selection.role} {selection.category} {index}, {selection.split_of(index)}: {_printable(shape.name)}"
    width = rows[0].shape[1]
    return np.concatenate(
        [
            _text_band([(title, INK)], width, TITLE),
            *rows,
            _text_band([(line, INK) for line in describe(shape)], width, CAPTION),
        ]
    )


def describe(shape: Shape) -> list[str]:
    """Return the measures of a shape in words, a line each."""
    mesh, measures = shape.mesh, shape.measures
    diameter = 2 * enclosing_ball(mesh.vertices[np.unique(mesh.faces)])[1]
    lines = [f"{size_of(shape)} along x, y, z; enclosing ball {_length(diameter)}; {len(mesh.faces):,} faces"]
    for k, cavity in enumerate(measures.cavities):
        kind = "box" if cavity.axis is None else f"drum along {'xyz'[cavity.axis]}"
        lines.append(f"cavity {k}: {kind}, {_lengths(cavity.sizes)}" + (", inhabited" if cavity.inhabited else ""))
    if measures.top is not None:
        outline = measures.top.outline
        across = _lengths(np.ptp(outline, axis=0).tolist())
        lines.append(f"top: {across}, {len(outline)} corners, at {_length(measures.top.height)}")
    if measures.handle is not None:
        lines.append(f"handle gap: diameter {_length(2 * measures.handle.radius)}")
    if shape.volume is not None:
        lines.append(f"material: {1e6 * shape.volume:,.4g} cm3")
    return lines


def size_of(shape: Shape) -> str:
    """Return the extents of a shape along x, y and z in words."""
    used = shape.mesh.vertices[np.unique(shape.mesh.faces)]
    return _lengths(np.ptp(used, axis=0).tolist() if len(used) else [0.0, 0.0, 0.0])


def _length(metres: float) -> str:
    return _lengths([metres])


def _lengths(metres: Sequence[float]) -> str:
    unit, factor = ("cm", 100.0) if max(metres) < 10 else ("m", 1.0)
    return " x ".join(f"{factor * m:.1f}" for m in metres) + f" {unit}"


def _title(selection: Selection) -> str:
    counts = ", ".join(f"{n} {split}" for split, n in selection.splits.items() if n)
    return f"{selection.role} {selection.category}: {len(selection.indices)} of {counts}"


def _captioned(picture: Image, lines: Sequence[Line]) -> Image:
    return np.concatenate([picture, _text_band(lines, picture.shape[1], CAPTION)])


def _text_band(lines: Sequence[Line], width: int, height: int) -> Image:
    """Return a band of the background with lines of text, each shortened to fit."""
    font = ImageFont.load_default(height)
    step = round(1.25 * height)
    band = PillowImage.new("RGB", (width, step * len(lines) + height // 2), BACKGROUND)
    draw = ImageDraw.Draw(band)
    for k, (text, colour) in enumerate(lines):
        draw.text((height // 2, k * step), _shortened(text, font, width - height), colour, font)
    return np.asarray(band)


def _shortened(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> str:
    if font.getlength(text) <= width:
        return text
    # A name's end tells more than its middle.
    for kept in range(len(text) - 1, 0, -1):
        short = f"{text[: kept - kept // 3]}…{text[len(text) - kept // 3 :]}"
        if font.getlength(short) <= width:
            return short
    return ""


def _printable(name: str) -> str:
    """Return a file's name without what cannot be drawn: line breaks, undecodable bytes."""
    return "".join(c if c.isprintable() else "?" for c in name.encode(errors="replace").decode())


def check_png(path: Path) -> None:
    """Raise UsageError unless a picture can be written to `path`: before the work, not after it."""
    if path.suffix.lower() != ".png":
        msg = f"Picture {path} does not end in .png, the only format there is."
        raise UsageError(msg)
    if path.is_dir():
        msg = f"Picture {path} is a folder. Choose another --out."
        raise UsageError(msg)


def write_png(picture: Image, path: Path) -> None:
    """Write a picture with a palette of its own colours; the file appears whole or not at all.

    UsageError where it cannot be written.
    """
    check_png(path)
    temporary = temporary_beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        palette = PillowImage.fromarray(picture).quantize(COLOURS, dither=PillowImage.Dither.NONE)
        palette.save(temporary, format="PNG", optimize=True)
        publish(temporary, path)
    except OSError as error:
        msg = f"Picture {path} cannot be written: {error.strerror or error}. Choose another --out."
        raise UsageError(msg) from error
    finally:
        _remove(temporary)


def _remove(temporary: Path) -> None:
    try:
        temporary.unlink(missing_ok=True)
    except OSError:  # below something that is no folder
        return
