"""The results database: results of all runs in a folder, in SQLite; of several stations, in PostgreSQL.

Only the run directories are authoritative: `filling` makes the database from them, again at any time, and `delivery`
copies it to a server. `schema` defines the tables, `reader` reads rows, `run_index` is the list of runs in the same
file, which loads no database library. Nothing here measures, evaluates or fits.
"""
