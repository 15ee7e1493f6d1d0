"""Results as columns: for pandas, and as files of comma-separated values or Parquet."""

from __future__ import annotations

import csv
import io
from os import PathLike
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from jaxpound._checks import require_folder
from jaxpound._extras import require

if TYPE_CHECKING:
    from pandas import DataFrame


class Columnar:
    """A result that is a table, with a row for each instant, run or sample.

    The names of columns end with the SI unit where the numbers are SI (``x1_m``, ``v1_m_per_s``),
    and have no ending where they are dimensionless. The columns that identify a row (run, instant,
    sample) come first, and are the index of a data frame.
    """

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        raise NotImplementedError

    def to_columns(self) -> dict[str, np.ndarray]:
        """All columns by name, of one length, as NumPy arrays."""
        index, columns = self._index_and_columns()
        return index | columns

    def to_pandas(self) -> DataFrame:
        """All columns as a data frame; an ``ImportError`` without pandas (extra ``tables``)."""
        pandas = require("to_pandas", "pandas")
        index, columns = self._index_and_columns()
        return pandas.DataFrame(index | columns).set_index([*index])

    def to_csv(self, file: str | PathLike[str] | BinaryIO) -> None:
        """All columns as comma-separated values, below a line of their names.

        Numbers have 17 digits, so that the same numbers are read back. ``file`` is open for binary
        writing, or a path, whose folder exists (else ``FileNotFoundError``).
        """
        if isinstance(file, str | PathLike):
            require_folder(file)
            with open(file, "wb") as opened:
                self.to_csv(opened)
            return
        columns, heading = self.to_columns(), io.StringIO()
        csv.writer(heading, lineterminator="\n").writerow(columns)
        file.write(heading.getvalue().encode())
        np.savetxt(file, np.column_stack(list(columns.values())), "%.17g", delimiter=",")

    def to_parquet(self, path: str | PathLike[str]) -> None:
        """All columns as a Parquet file, which is smaller and faster than text.

        An ``ImportError`` without pandas or pyarrow (extra ``tables``), a ``FileNotFoundError`` if
        the folder is missing.
        """
        for library in ("pandas", "pyarrow"):
            require("to_parquet", library)
        require_folder(path)
        self.to_pandas().to_parquet(path, engine="pyarrow")
