"""Plugins on the command line: what is asked for, what is refused, and what is said of faulty ones."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from cli_support import call
from plugin_files import EXAMPLES, MINNAERT, edited

MOON = str(EXAMPLES / "moon.toml")
GIVEN = ("--plugin", str(EXAMPLES / "minnaert.cl"))
SMALL = ("--size", "24x16", "--spp", "2", "-d", "pocl", "--quiet")
DARKER = edited(MINNAERT, ("(0.5f * INV_PI) * limb", "(0.25f * INV_PI) * limb"))


def refused(*arguments: str, code: int = 2) -> str:
    result = call(*arguments)
    assert result.returncode == code and not result.stdout, (result.returncode, result.stdout, result.stderr)
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, result.stderr
    return lines[0]


def made(*arguments: str) -> None:
    result = call(*arguments)
    assert result.returncode == 0, result.stderr


@pytest.fixture
def other(tmp_path: Path) -> tuple[str, str]:
    """Another text of the plugin."""
    (tmp_path / "darker.cl").write_text(DARKER)
    return "--plugin", str(tmp_path / "darker.cl")


def test_a_scene_asks_for_its_plugins(tmp_path: Path) -> None:
    for command in (("render", MOON, "-o", str(tmp_path / "a.png")), ("check", MOON), ("furnace", MOON)):
        said = refused(*command)
        assert (
            'materials.moon.plugin names the plugin "minnaert"' in said
            and f"--plugin {shlex.quote(GIVEN[1])} (" in said
        )
    assert "missing" in refused("check", MOON, "--plugin", str(tmp_path / "no.cl"))
    assert not (tmp_path / "a.png").exists()
    checked = call("check", MOON, *GIVEN, "--json")
    assert checked.returncode == 0 and json.loads(checked.stdout)["materials"] == 2


def test_the_file_of_a_plugin_is_found_beside_the_scene(tmp_path: Path) -> None:
    scene = tmp_path / "a b" / "moon.toml"
    folder = scene.parent / "scenes" / "plugins"
    folder.mkdir(parents=True)
    scene.write_text(Path(MOON).read_text())
    assert "; give its file with --plugin FILE (" in refused("check", str(scene))
    (folder / "minnaert.cl").write_text(MINNAERT)
    said = refused("check", str(scene))
    assert f"; give its file with --plugin '{folder / 'minnaert.cl'}' (in Python: plugins=[FILE])" in said


def test_a_faulty_text_is_told_at_its_line(tmp_path: Path) -> None:
    (tmp_path / "faulty.cl").write_text(edited(MINNAERT, ("power(wi.z, p->k)", "pow(wi.z, p->k)")))
    line = MINNAERT[: MINNAERT.index("power(wi.z")].count("\n") + 1
    said = refused("check", MOON, "--plugin", str(tmp_path / "faulty.cl"))
    assert f"faulty.cl:{line}: pow differs from driver to driver; write power(x, y)" in said


@pytest.mark.thorough
def test_an_image_belongs_to_the_text_of_its_plugin(tmp_path: Path, other: tuple[str, str]) -> None:
    image, film = str(tmp_path / "a.png"), str(tmp_path / "a.film")
    made("render", MOON, *GIVEN, *SMALL, "-o", image, "-o", film)
    for file in (image, film):
        made("verify", file, *GIVEN, "--fraction", "1", "-d", "pocl", "--quiet")
        assert "was made with the plugin minnaert (sha256 " in refused("verify", file, "-d", "pocl", "--quiet")
        assert "another text of the plugin minnaert" in refused("verify", file, *other, "-d", "pocl", "--quiet")
    halves = [str(tmp_path / f"{name}.film") for name in ("first", "second", "wrong")]
    made("render", MOON, *GIVEN, *SMALL, "--shard", "1/2", "-o", halves[0])
    made("render", MOON, *GIVEN, *SMALL, "--shard", "2/2", "-o", halves[1])
    made("render", MOON, *other, *SMALL, "--shard", "2/2", "-o", halves[2])
    made("merge", *halves[:2], "-o", str(tmp_path / "b.exr"))
    assert "plugins" in refused("merge", halves[0], halves[2], "-o", str(tmp_path / "c.exr"))
    kept = ("--checkpoint", str(tmp_path / "kept.film"), "-o", image)
    made("render", MOON, *GIVEN, *SMALL, *kept)
    assert "the plugins are others" in refused("render", MOON, *other, *SMALL, *kept, "--resume")
    assert "jobs carry no plugins" in refused("render", MOON, *GIVEN, *SMALL, "-o", image, "--cluster", "local:2")


@pytest.mark.long
def test_the_furnace_of_a_plugin(tmp_path: Path) -> None:
    (tmp_path / "bright.cl").write_text(edited(MINNAERT, ("(0.5f * INV_PI) * limb", "(0.5f * INV_PI) * limb * 2.5f")))
    options = ("--quick", "--quiet", "-d", "pocl", "--check")
    right = call("furnace", "minnaert", *GIVEN, *options)
    assert right.returncode == 0 and "is reciprocal" in right.stdout and "FAULT" not in right.stdout
    wrong = call("furnace", "minnaert", "--plugin", str(tmp_path / "bright.cl"), *options)
    assert wrong.returncode == 1 and "FAULT: gains energy: 125.00 % of the light" in wrong.stdout
    pytest.importorskip("matplotlib")
    made("furnace", "minnaert", *GIVEN, "--quick", "--quiet", "-d", "pocl", "-o", str(tmp_path / "page"))
    page = (tmp_path / "page" / "furnace.html").read_text()
    assert "Does not claim to keep all light" in page and "with one path a work-item" in page
    assert "did you mean" in refused("furnace", "minart", *GIVEN)
    assert "measured by its own name" in refused("furnace", "plugin", *GIVEN)
