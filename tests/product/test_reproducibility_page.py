"""The commands of docs/reproducibility.md prove what the page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from forked import programs

pytestmark = pytest.mark.slow


def test_equal_commands_give_equal_bytes_as_the_page_shows(repository, tmp_path):
    text = (repository / "docs/reproducibility.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```bash\n(.*?)^```", text, flags=re.M | re.S)
    assert block.count("diff -r") == 2
    # The second of each is a process of its own, which hashes texts by another seed.
    own = Path(sys.executable).parent / "metamerlab"
    block, count = re.subn(r"^metamerlab (?=.* second )", f"{own} ", block, flags=re.M)
    assert count == 2
    path = f"{programs()}{os.pathsep}{os.environ['PATH']}"

    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=280,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "second-report" / "report.html").is_file()
