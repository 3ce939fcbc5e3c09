"""Numbers about a render that the operating system gives."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

CHILD = "from clrender.rendering.statistics import peak_rss; print(peak_rss())"


@pytest.mark.thorough
def test_memory_is_that_of_the_program_and_not_of_who_started_it() -> None:
    large = np.ones(1 << 26)  # 512 MiB
    done = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, check=True)
    assert large[-1] == 1.0
    assert 10 << 20 < int(done.stdout) < 400 << 20
