"""Reports: figures with intervals, tables, and their files."""
