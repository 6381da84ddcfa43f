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
CAPTION, TITLE = 13, 19
"""Heights of the letters, pixels."""
INK, FAINT = (30, 34, 42), (112, 118, 128)
COLOURS = 64
"""Colours of a PNG's palette."""

Progress = Callable[[str, int, int], None]
"""Called with (what, shapes done, shapes in all)."""

Line = tuple[str, tuple[int, int, int], int]
"""Text, colour, height of its letters."""


def draw(
    selections: Sequence[Selection], measures: bool = False, opened: bool = False, progress: Progress | None = None
) -> Image:
    """Return a portrait of a single shape, else a contact sheet; see there."""
    if sum(len(s.indices) for s in selections) == 1:
        return portrait(selections[0], measures)
    return sheet(selections, measures, opened, progress)


def sheet(
    selections: Sequence[Selection], measures: bool = False, opened: bool = False, progress: Progress | None = None
) -> Image:
    """Return a contact sheet: each category under its title, in rows; small ones share a row.

    Parameters
    ----------
    measures : draw cavities, tops and handle gaps over the shapes
    opened : cut the shapes open
    """
    total, done = sum(len(s.indices) for s in selections), 0
    columns = min(COLUMNS, total)
    rows: list[list[Image]] = [[]]
    free = columns
    for selection in selections:
        cells = []
        for index, shape in selection.shapes():
            cells.append(_cell(selection.role, index, shape, measures, opened))
            done += 1
            if progress:
                progress("drawing", done, total)
        block = _block(selection, cells, columns)
        width = block.shape[1] // CELL
        if width > free or len(cells) > columns:
            rows.append([])
            free = columns
        rows[-1].append(block)
        free = free - width if len(cells) <= columns else 0
    return _stacked([_side_by_side(row, columns * CELL) for row in rows if row])


def _cell(role: str, index: int, shape: Shape, measures: bool, opened: bool) -> Image:
    """Return one picture of a sheet with its caption: index, name, size."""
    view = cutaway(shape, role) if opened else View(VIEWS["three-quarter"])
    name = _printable(shape.name).removeprefix(f"{index:04d}_")
    lines = [(f"{index}  {name}", INK, CAPTION), (size_of(shape), FAINT, CAPTION)]
    return _stacked([render(shape, role, view, CELL, measures), _text_band(lines, CELL)])


def _block(selection: Selection, cells: list[Image], columns: int) -> Image:
    """Return the title of a category and its cells in rows."""
    wide = min(columns, len(cells))
    counts = ", ".join(f"{n} {split}" for split, n in selection.splits.items() if n)
    title = [
        (_printable(selection.category), INK, TITLE),
        (f"{selection.role}: {len(cells)} of {counts}", FAINT, CAPTION),
    ]
    rows = [_side_by_side(cells[k : k + wide], wide * CELL) for k in range(0, len(cells), wide)]
    return _stacked([_text_band(title, wide * CELL), *rows])


def _side_by_side(images: Sequence[Image], width: int) -> Image:
    """Return images of one or several heights in a row of the given width."""
    row = np.full((max(i.shape[0] for i in images), width, 3), BACKGROUND, dtype=np.uint8)
    x = 0
    for image in images:
        row[: image.shape[0], x : x + image.shape[1]] = image
        x += image.shape[1]
    return row


def _stacked(images: Sequence[Image]) -> Image:
    return np.concatenate(images)


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
        _stacked(
            [render(shape, selection.role, view, PORTRAIT, measures), _text_band([(name, FAINT, CAPTION)], PORTRAIT)]
        )
        for name, view in views.items()
    ]
    width = 2 * PORTRAIT
    rows = [_side_by_side(cells[k : k + 2], width) for k in (0, 2)]
    title = f"{selection.category}: {_printable(shape.name)}"
    place = f"{selection.role}, {selection.split_of(index)}, index {index}"
    words = [(line, INK, CAPTION) for line in describe(shape)]
    return _stacked(
        [_text_band([(title, INK, TITLE), (place, FAINT, CAPTION)], width), *rows, _text_band(words, width)]
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


def _text_band(lines: Sequence[Line], width: int) -> Image:
    """Return a band of the background with lines of text, each shortened to fit."""
    band = PillowImage.new("RGB", (width, sum(_step(size) for _, _, size in lines) + CAPTION // 2), BACKGROUND)
    draw = ImageDraw.Draw(band)
    y = 0
    for text, colour, size in lines:
        font = ImageFont.load_default(size)
        draw.text((CAPTION // 2, y), _shortened(text, font, width - CAPTION), colour, font)
        y += _step(size)
    return np.asarray(band)


def _step(size: int) -> int:
    return round(1.25 * size)


def _shortened(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> str:
    if font.getlength(text) <= width:
        return text
    # A name's end tells more than its middle. No letter is narrower than a pixel.
    for kept in range(min(len(text) - 1, width), 0, -1):
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
