"""Worker processes of scripts as people write them."""

import subprocess
import sys

import pytest

SCRIPT = """
from stimuli.batch.executors import local_processes

print("begun", flush=True)
with local_processes(1) as pool:
    print(pool.submit(abs, -3).result())
"""


@pytest.mark.slow
def test_a_script_without_a_main_guard_is_run_once(tmp_path, repository):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=repository, timeout=60,
        env={"PYTHONPATH": str(repository)},
    )  # fmt: skip
    assert done.stdout.split() == ["begun", "3"], done.stderr
