"""The map in `pipelines/__init__.py`, against the import contract of pyproject.toml."""

import re

import pipelines
from tools import draw_map


def test_the_map_of_packages_equals_the_import_contract():
    drawn = pipelines.__doc__.partition(draw_map.TITLE)[2].strip()
    assert drawn == draw_map.draw_map().strip(), "run `python tools/draw_map.py`"


def test_every_stage_has_a_row_in_the_table_of_stages():
    table = pipelines.__doc__.partition(draw_map.TITLE)[0]
    rows = re.findall(r"^([a-z_]+)  +\S", table, re.MULTILINE)
    assert sorted(rows) == sorted(["stage", *draw_map.contract_layers()[0]])
