"""`clrender render --error` and `clrender compare` of its films, as a user has them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli_support import call

SMALL = ("--size", "24x20", "--quiet")
ASKED = ("--error", "0.3", "--confidence", "0.9", "--share", "0.9")


@pytest.mark.thorough
def test_a_render_stops_and_says_what_is_left(tmp_path: Path) -> None:
    done = call(
        "render", "cornell", *SMALL, *ASKED, "-o", "a.exr", "-o", "a.film", "--aov", "stderr,unconverged",
        "--stats", "a.json", "--checkpoint", "c.film", folder=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    numbers = json.loads((tmp_path / "a.json").read_text())
    said = re.search(
        r"converged: (\d+) of 480 pixels \([\d.]+%\) within 0.3 of their luminance at 0.9 confidence", done.stdout
    )
    assert said and 480 - int(said[1]) == numbers["unconverged_pixels"] <= 48
    assert " not " not in done.stdout.lower() and f"{numbers['spp']} samples per pixel" in done.stdout
    assert numbers["converged"] and numbers["spp"] < numbers["spp_limit"] == 16384

    again = call("render", "cornell", *SMALL, *ASKED, "-o", "b.film", "--checkpoint", "c.film", "--resume",
                "--stats", "b.json", folder=tmp_path)  # fmt: skip
    assert again.returncode == 0, again.stderr
    resumed = json.loads((tmp_path / "b.json").read_text())
    assert resumed["image_sha256"] == numbers["image_sha256"]
    assert resumed["resumed_samples"] == resumed["samples"] == numbers["samples"]

    other = call("render", "cornell", *SMALL, *ASKED, "-o", "other.film", "--seed", "1", folder=tmp_path)
    assert other.returncode == 0
    compared = call("compare", "a.film", "other.film", "--json", folder=tmp_path)
    assert json.loads(compared.stdout)["z_test"]["agree"] is True
    compared = call("compare", "a.film", "b.film", folder=tmp_path)
    assert "z-test                    none: a.film and b.film have the same seed" in compared.stdout


def test_a_render_that_reaches_its_most_samples_says_so(tmp_path: Path) -> None:
    done = call("render", "cornell", *SMALL, "--error", "0.001", "--spp", "256", "-o", "a.png", folder=tmp_path)
    assert done.returncode == 0 and done.stdout.count("NOT CONVERGED") == 1


def test_what_has_no_errors_is_refused_in_a_sentence(tmp_path: Path) -> None:
    for options in (("--integrator", "photon", "--error", "0.1"), ("--error", "0.1", "--spp", "100")):
        done = call("render", "room", *SMALL, *options, "-o", "a.png", folder=tmp_path)
        assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr
    assert not list(tmp_path.iterdir())
