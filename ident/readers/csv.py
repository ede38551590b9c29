"""Logs in CSV: a header, then one row a sample."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from ident.arrays import Array
from ident.errors import InputError
from ident.log import JointLog
from ident.readers.columns import Columns, assemble, find_columns
from ident.readers.source import FileLog

DELIMITERS = ",;\t "
"""Tried in this order on the header; the contract's is the comma."""
BLOCK_BYTES = 1 << 22
EMPTY = ("", "nan", "NaN", "NAN", "NA", "N/A", "null", "NULL", "None")
"""What loggers write where they have no value."""


class CsvLog(FileLog):
    """A CSV file, parsed in blocks of a few megabytes."""

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        header, delimiter = _read_header(self.path)
        columns = find_columns(header, self.robot, self.path)
        try:
            with _open(self.path, header, delimiter, columns) as reader:
                for batch in reader:
                    arrays: dict[str, Array] = {
                        name: batch.column(k).to_numpy(zero_copy_only=False) for k, name in enumerate(columns.all)
                    }
                    yield assemble(arrays, columns, self.robot.n, self.path), columns
        except (pa.ArrowInvalid, OSError) as error:
            raise _locate(self.path, header, delimiter, columns, str(error)) from None


def _read_header(path: Path) -> tuple[list[str], str]:
    """Return the column names and the delimiter."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            line = file.readline()
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", str(path), "check the path and its permissions"
        ) from None
    except UnicodeDecodeError:
        raise InputError(
            "not a text file", str(path), "give CSV with a header, or use the suffix of its format"
        ) from None
    if not line.strip():
        raise InputError("empty file", str(path), "give a header and one row a sample")
    delimiter = next((d for d in DELIMITERS if d in line.strip()), ",")
    names = [name.strip() for name in next(csv.reader([line.strip()], delimiter=delimiter))]
    if all(_number(name) is not None for name in names):
        raise InputError("no header", f"{path} line 1", "name the columns in the first line (t, q1, ..., i1, ...)")
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise InputError(f"column {doubled[0]} appears twice", f"{path} line 1", "give every column its own name")
    return names, delimiter


def _open(path: Path, header: list[str], delimiter: str, columns: Columns) -> pyarrow.csv.CSVStreamingReader:
    wanted = columns.all
    return pyarrow.csv.open_csv(
        path,
        read_options=pyarrow.csv.ReadOptions(column_names=header, skip_rows=1, block_size=BLOCK_BYTES),
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        convert_options=pyarrow.csv.ConvertOptions(
            include_columns=wanted, column_types=dict.fromkeys(wanted, pa.float64()), null_values=list(EMPTY)
        ),
    )


def _locate(path: Path, header: list[str], delimiter: str, columns: Columns, reason: str) -> InputError:
    """Find the first row that is not one number a column; slow and exact, for files that failed the fast way."""
    wanted = [(header.index(name), name) for name in columns.all]
    row = 0
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = csv.reader(file, delimiter=delimiter)
        next(lines)
        for cells in lines:
            if not cells:
                continue
            row += 1
            if len(cells) != len(header):
                what = f"{len(cells)} values where the header names {len(header)} columns"
                why = (
                    "is the file cut off?" if len(cells) < len(header) else "a decimal comma, or a delimiter too many?"
                )
                return InputError(what, f"{path} row {row}", f"repair or remove the row ({why})")
            for k, name in wanted:
                if _number(cells[k]) is None and cells[k].strip() not in EMPTY:
                    what = f"{name} = {cells[k][:40]!r} is not a number"
                    return InputError(what, f"{path} row {row}", "repair or remove the row")
    if row == 0:
        return InputError("no rows", str(path), "give a log with at least one sample")
    return InputError(f"cannot be parsed ({reason.splitlines()[0]})", str(path), "give plain CSV with a header")


def _number(text: str) -> float | None:
    """Return the text as a number, None where it is none (NaN is none: it names no column and fills no row)."""
    try:
        value = float(text)
    except ValueError:
        return None
    return None if "_" in text or math.isnan(value) else value
