"""The import of MuJoCo by the stages."""

import subprocess
import sys

CODE = """
import os, sys
from pathlib import Path
started = []
sys.addaudithook(lambda event, given: event == "subprocess.Popen" and started.append(given[0]))
import pipelines.simulate, pipelines.synthesize
print(*(Path(os.fsdecode(each)).name for each in started), os.environ.get("MUJOCO_GL"))
"""


def test_no_process_searches_for_a_renderer():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert "python" not in done.stdout
    assert done.stdout.strip().endswith("None")
