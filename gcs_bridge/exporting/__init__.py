"""A recording as tables for other programs: what was sent, what it was compared with, and what came of it.

conventions: frames and how columns are named · tables: which there are, and what each column holds · export: the sink
that fills them · parquet, csv, mcap: how they are written.
"""
