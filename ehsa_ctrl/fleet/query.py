"""SQL queries of a fleet's store."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import InputError

if TYPE_CHECKING:
    import pandas

#: Folder of the tables in a store.
TABLES = "tables"
#: How to install what a store needs.
EXTRA = 'pip install "ehsa_ctrl[fleet]"'


def query_store(folder: str | Path, text: str) -> pandas.DataFrame:
    """Answer of an SQL query to the tables rigs, logs, estimates, parameters and drifts of a store.

    The query reads copies of these tables in memory, and no other file.

    Raises InputError for a folder without tables, a wrong query, and without DuckDB.
    """
    try:
        import duckdb
    except ImportError:
        raise InputError(f"a query needs DuckDB; install it with {EXTRA}") from None
    tables = sorted((Path(folder) / TABLES).glob("*.parquet"))
    if not tables:
        raise InputError(
            f"{folder}: has no tables to ask; expected the store of a fleet, which ehsa-ctrl fleet LOGS --out {folder} "
            "writes"
        )
    with duckdb.connect() as connection:
        try:
            for table in tables:
                place = str(table).replace("'", "''")
                connection.execute(f"create table {table.stem} as select * from read_parquet('{place}')")
            connection.execute("set enable_external_access = false")
            return connection.execute(text).df()
        except duckdb.Error as error:
            words = " ".join(str(error).split())
            raise InputError(f"{folder}: {words}; its tables are {', '.join(t.stem for t in tables)}") from None
