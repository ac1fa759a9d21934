"""Compares the table of a recording in CSV with that in Parquet, both read by DuckDB."""

import sys

import duckdb

csv, parquet = (duckdb.sql(f"FROM '{path}'") for path in sys.argv[1:3])
assert csv.columns == parquet.columns, (csv.columns, parquet.columns)
kinds = {name: str(kind) for name, kind in zip(parquet.columns, parquet.types)}
assert kinds["x_mm"] == "DOUBLE" and kinds["frame"] == "BIGINT", kinds
assert kinds["outcome"] == kinds["reason"] == "VARCHAR", kinds
assert kinds["rotation_z_deg"] == "DOUBLE", kinds
REASON = parquet.columns.index("reason")
rows = parquet.fetchall()
assert len(rows) > 20, len(rows)


def filled(row):
    # An empty quoted cell of a CSV file is NULL to DuckDB.
    return tuple("" if cell is None and index == REASON else cell
                 for index, cell in enumerate(row))


assert [filled(row) for row in csv.fetchall()] == [filled(row) for row in rows]
largest = duckdb.sql(f"SELECT max(abs(x_mm)) FROM '{sys.argv[2]}'").fetchone()[0]
assert 0.01 < largest < 10, largest
print(f"parquet: {len(rows)} rows and {len(kinds)} columns as in the CSV file")
