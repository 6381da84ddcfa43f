"""Figures and tables of a run as files for a paper: PNG and PDF, CSV and LaTeX."""

from pathlib import Path

from eigenbench.errors import DataError, UsageError, printable
from eigenbench.figures import figures_of, paper_style
from eigenbench.report_cells import as_csv, as_latex
from eigenbench.report_source import read_source
from eigenbench.report_tables import tables_of
from eigenbench.shards import publish, temporary_beside, write_text_atomically

_FIGURE_TYPES = ("png", "pdf")


def export_run(run: str | Path, data: str | Path, out: str | Path, *, figures: bool = True) -> list[Path]:
    """Write the tables and figures of a run into a folder and return their paths.

    `<table>.csv` holds numbers in full, intervals as three columns; `<table>.tex` a tabular for booktabs.

    Raises
    ------
    DataError : the run or its data cannot be read
    UsageError : the folder cannot be made, or figures are wanted without matplotlib
    """
    source = read_source(run, data)
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"Folder {printable(str(folder))} cannot be made: {error.strerror}. Choose another --out."
        raise UsageError(msg) from error
    tables = tables_of(source)
    written = []
    for name, table in tables.items():
        for ending, body in (("csv", as_csv(table)), ("tex", as_latex(table))):
            path = folder / f"{name}.{ending}"
            write_text_atomically(path, body)
            written.append(path)
    if not figures:
        return written
    with paper_style():
        for name, figure in figures_of(source, tables):
            for ending in _FIGURE_TYPES:
                path = folder / f"{name}.{ending}"
                temporary = temporary_beside(path)
                metadata = {"CreationDate": None} if ending == "pdf" else {"Software": None}
                try:
                    figure.savefig(temporary, format=ending, metadata=metadata)
                    publish(temporary, path)
                except OSError as error:
                    temporary.unlink(missing_ok=True)
                    msg = f"Cannot write {printable(str(path))}: {error.strerror}. Choose another --out."
                    raise DataError(msg) from error
                written.append(path)
    return written
