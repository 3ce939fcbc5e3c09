"""Views of OpenColorIO: their numbers are those of the library, and what is not there is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases import for_each
from click.testing import CliRunner

import clrender
from clrender.cli import main
from clrender.errors import UsageError
from clrender.image.files import read_image, read_provenance, write_image
from clrender.image.tone_map import to_display

ocio = pytest.importorskip("PyOpenColorIO", reason="opencolorio is not installed")

_OWN = """
ocio_profile_version: 2
roles: {default: linear, scene_linear: linear}
displays:
  screen:
    - !<View> {name: plain, colorspace: out}
    - !<View> {name: raw, colorspace: linear}
colorspaces:
  - !<ColorSpace> {name: linear, aliases: [ALIAS], isdata: false}
  - !<ColorSpace>
    name: out
    isdata: false
    from_scene_reference: !<ExponentTransform> {value: 0.5}
"""


def _colors() -> np.ndarray:
    """Dark, bright and saturated colours, (16, 16, 3)."""
    return np.exp(np.random.default_rng(1).normal(-1.0, 2.0, (16, 16, 3))).astype(np.float32)


@for_each(
    ("display", "view"),
    [
        (None, None),
        ("sRGB - Display", "Un-tone-mapped"),
        ("Display P3 - Display", "ACES 2.0 - SDR 100 nits (P3 D65)"),
        ("Rec.2100-PQ - Display", "ACES 2.0 - HDR 1000 nits (P3 D65)"),
    ],
)
def test_numbers_are_those_of_the_library(display: str | None, view: str | None) -> None:
    config = ocio.Config.CreateFromBuiltinConfig("ocio://cg-config-latest")
    name = config.getDefaultDisplay() if display is None else display
    seen = config.getDefaultView(name) if view is None else view
    forward = ocio.TRANSFORM_DIR_FORWARD
    processor = config.getProcessor("Linear Rec.709 (sRGB)", name, seen, forward).getDefaultCPUProcessor()
    colors = _colors()
    wanted = 4.0 * colors
    processor.applyRGB(wanted)
    made = to_display(colors, clrender.display_view("builtin", display, view), 2.0)
    np.testing.assert_array_equal(made, np.rint(np.clip(wanted.astype(np.float64), 0, 1) * 255).astype(np.uint8))
    if display is None:
        assert "ACES 2.0" in seen
        assert np.abs(made.astype(int) - to_display(colors, "aces", 2.0)).max() > 10  # another curve


def test_a_configuration_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.ocio").write_text(_OWN.replace("ALIAS", "lin_rec709_scene"))
    view = clrender.display_view(tmp_path / "a.ocio")
    assert (view.display, view.view, view.space) == ("screen", "plain", "linear")
    np.testing.assert_allclose(view.shown(np.array([[0.25, 0.0, 1.0]])), [[0.5, 0.0, 1.0]], atol=2e-5)
    np.testing.assert_array_equal(to_display(np.array([[[np.nan, 1e30, np.inf]]]), view), [[[0, 255, 255]]])
    (tmp_path / "b.ocio").write_text(_OWN.replace("ALIAS", "acescg"))
    with pytest.raises(UsageError, match=r"no colour space that is known to be linear Rec\. 709"):
        clrender.display_view(tmp_path / "b.ocio")


@for_each(
    ("arguments", "texts"),
    [
        (["--ocio", "builtin", "--display", "sRBG"], ("no display 'sRBG'", "'sRGB - Display'")),
        (["--ocio", "builtin", "--view", "Filmic"], ("no view 'Filmic'", "'Un-tone-mapped'")),
        (["--ocio", "nothing.ocio"], ("nothing.ocio", "no configuration")),
        (["--ocio", "ocio://none"], ("ocio://none", "no configuration")),
        (["--display", "sRGB - Display"], ("--display", "is for --ocio")),
        (["--ocio", "builtin", "--tone-map", "agx"], ("--ocio", "--tone-map")),
    ],
)
def test_what_cannot_be_had_is_named(arguments: list[str], texts: tuple[str, ...], tmp_path: Path) -> None:
    write_image(tmp_path / "a.npy", _colors())
    with pytest.raises(UsageError) as error:
        CliRunner().invoke(
            main,
            ["tonemap", str(tmp_path / "a.npy"), "-o", str(tmp_path / "a.png"), *arguments],
            catch_exceptions=False,
            standalone_mode=False,
        )
    assert all(text in str(error.value) for text in texts), error.value
    assert not (tmp_path / "a.png").exists()


def test_a_file_says_how_it_was_made_and_is_not_proved(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", _colors(), {"stored": {"exr_type": "float"}})
    command = ["tonemap", str(tmp_path / "a.exr"), "--ocio", "builtin", "--exposure", "1", "-o"]
    done = CliRunner().invoke(main, [*command, str(tmp_path / "a.png")], catch_exceptions=False)
    assert "ACES 2.0 - SDR 100 nits (Rec.709), sRGB - Display, exposure 1" in done.output
    provenance = read_provenance(tmp_path / "a.png")
    assert provenance is not None
    stored = provenance["stored"]
    assert (stored["tone_map"], stored["exposure"], stored["ocio"]["display"]) == ("ocio", 1.0, "sRGB - Display")
    assert stored["ocio"]["config"].startswith("ocio://cg-config-v")
    assert stored["ocio"]["version"] == ocio.__version__
    assert read_image(tmp_path / "a.png").shape == (16, 16, 3)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.image.ocio.find_spec", lambda name: None)
    with pytest.raises(UsageError, match="OpenColorIO is not installed") as error:
        clrender.display_view()
    assert error.value.extra == "ocio"
