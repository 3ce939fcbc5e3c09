"""Pages with pictures of numbers: whole, self-contained, and of the right pixels."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from cli_support import call
from PIL import Image
from view_browser import chromium

from clrender.agreement.page import compare_page
from clrender.bench.page import bench_page
from clrender.drawing.html import html_document, html_table
from clrender.drawing.pictures import diverging, shrunk
from clrender.drawing.table import Table
from clrender.image.files import write_image
from clrender.image.flip import flip_map
from clrender.image.tone_map import LUMINANCE, to_display

pytest.importorskip("matplotlib")

Floats = npt.NDArray[np.float32]


class Reader(HTMLParser):
    """Tags of a page, which have to be balanced, and what they refer to."""

    VOID = frozenset({"meta", "img", "input", "link", "br"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str]]] = []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def references(self) -> Iterator[str]:
        for _, attributes in self.seen:
            yield from (attributes[name] for name in ("src", "href", "xlink:href") if name in attributes)


def check_alone(page: str) -> Reader:
    """It is well-formed and asks for nothing from elsewhere."""
    reader = Reader(page)
    assert all(each.startswith(("data:image/", "#")) for each in reader.references())
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in reader.seen}
    assert not re.search(r"@import|url\((?!#)", page)
    return reader


def images(page: str) -> dict[str, npt.NDArray[np.uint8]]:
    """Lossless pictures of a page by their words."""
    found = {}
    for tag, attributes in Reader(page).seen:
        if tag == "img" and attributes["src"].startswith("data:image/png;base64,"):
            data = base64.b64decode(attributes["src"].partition(",")[2])
            found[attributes["alt"]] = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    return found


@pytest.fixture
def pair() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(5)
    reference = rng.lognormal(-1.0, 1.0, (30, 44, 3)).astype(np.float32)
    image = (reference * rng.uniform(0.8, 1.2, reference.shape)).astype(np.float32)
    image[10:20, 10:20] += 2.0
    return image, reference


def test_a_comparison_shows_both_images_and_their_differences(tmp_path: Path, pair: tuple[Floats, Floats]) -> None:
    write_image(tmp_path / "a <b>.exr", pair[0])
    write_image(tmp_path / "b.npy", pair[1])
    done = call("compare", "a <b>.exr", "b.npy", "-o", "page.html", folder=tmp_path)
    assert done.returncode == 0 and not done.stderr
    assert done.stdout == call("compare", "a <b>.exr", "b.npy", folder=tmp_path).stdout
    page = (tmp_path / "page.html").read_text()
    reader = check_alone(page)
    shown = images(page)
    for name, image in zip("AB", pair, strict=True):
        assert (shown[name] == to_display(image)).all()
    difference = (pair[0] - pair[1]) @ np.array(LUMINANCE)
    strongest = np.percentile(np.abs(difference), 99.0)
    assert (shown["difference of luminance"] == diverging(difference / strongest)).all()
    # A heat map: what is noticed more is brighter
    flip, heat = flip_map(*pair).ravel(), shown["FLIP"].sum(axis=2, dtype=int).ravel()
    assert np.corrcoef(flip, heat)[0, 1] > 0.9
    assert "a &lt;b&gt;.exr" in page and "<b>.exr" not in page
    for line in done.stdout.splitlines():
        assert f">{line[26:]}</td>" in page
    (border,) = [each for tag, each in reader.seen if tag == "input"]
    assert border["type"] == "range" and border["aria-label"] == "Border between A and B"


@pytest.mark.long
def test_equal_black_and_tiny_images_have_a_page(tmp_path: Path) -> None:
    for shape in ((1, 1, 3), (1, 50, 3), (3, 2, 3)):
        black = np.zeros(shape, np.float32)
        assert len(images(compare_page(("a", "b"), black, black, []))) == 4
        check_alone(compare_page(("a", "b"), black + 1.0, black, [("rmse", "1")]))


def test_large_images_are_shown_smaller() -> None:
    image = np.ones((20, 4000, 3), np.float32)
    page = compare_page(("a", "b"), image, image, [])
    assert images(page)["A"].shape == (6, 1333, 3) and "1333 × 6 pixels" in page


def test_shrinking_averages_light() -> None:
    image = np.arange(7 * 9 * 3, dtype=np.float64).reshape(7, 9, 3)
    small = shrunk(image, 4)
    assert small.shape == (2, 3, 3)
    np.testing.assert_allclose(small[1, 2], image[3:6, 6:9].mean(axis=(0, 1)))
    assert shrunk(image, 9) is image
    assert shrunk(image[:1], 2).shape == (1, 1, 3)


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("page.txt", "ends in .html"),
        ("no/page.html", "no/page.html"),
        ("a.npy", "is an input of this command"),
    ],
)
def test_a_page_that_cannot_be_is_refused(tmp_path: Path, output: str, words: str) -> None:
    write_image(tmp_path / "a.npy", np.zeros((2, 2, 3)))
    before = (tmp_path / "a.npy").read_bytes()
    done = call("compare", "a.npy", "a.npy", "-o", output, folder=tmp_path)
    assert done.returncode == 2 and words in done.stderr and done.stderr.count("\n") == 1
    assert (tmp_path / "a.npy").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_images_that_do_not_fit_leave_no_page(tmp_path: Path) -> None:
    write_image(tmp_path / "a.npy", np.zeros((2, 2, 3)))
    write_image(tmp_path / "b.npy", np.zeros((2, 3, 3)))
    done = call("compare", "a.npy", "b.npy", "-o", "page.html", folder=tmp_path)
    assert done.returncode == 2 and "one size" in done.stderr
    assert not (tmp_path / "page.html").exists()


def test_a_benchmark_has_a_page_with_its_numbers(tmp_path: Path) -> None:
    done = call("bench", "S1", "--size", "24x16", "--spp", "1", "--repeats", "2", "--plot", "b.html", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "b.html").read_text()
    check_alone(page)
    (rate,) = (line.split()[2] for line in done.stderr.splitlines() if line.split()[:2] == ["S1", "clrender"])
    assert f">{rate}</td>" in page and "24 × 16 pixels, 1 sample per pixel, 2 runs" in page


def test_a_benchmark_beside_peers_plots_all_of_them() -> None:
    own = {"scene": "S1", "renderer": "clrender", "runs": 3, "mpaths_per_second": 8.0, "lowest": 7.5, "highest": 8.2}
    peer = {**own, "renderer": "mitsuba", "mpaths_per_second": 4.0, "ratio": 2.0, "rel_mse": 0.01, "efficiency": 3.0}
    rays = {"scene": "S1", "renderer": "embree", "runs": 3, "mrays_per_second": 30.0, "lowest": 29.0, "highest": 31.0}
    page = bench_page([{**own, "rel_mse": 0.01, "efficiency": 6.0}, peer, rays], [], ["How."])
    assert len(check_alone(page).seen) and page.count("<svg") == 2
    assert "S1  mitsuba" in page and "30.000" in page and "S1  embree" not in page


@pytest.mark.long
def test_sentences_fit_the_width_of_a_phone(tmp_path: Path) -> None:
    words = "a sentence of many words, which is wider than the page of a phone is, and goes on"
    numbers = Table(words, ["name"] + [f"column {i}" for i in range(30)], [["x"] + ["0.123456"] * 30])
    table = Table(words, ["claim", "verdict", "measured"], [[words, "does not hold", words]] * 2, words=3)
    parts = [html_table(table, "prose", ["fails"]), html_table(numbers, "", [])]
    (tmp_path / "page.html").write_text(html_document("A page", parts))
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 390, "height": 844})
        page.goto((tmp_path / "page.html").as_uri())
        ends = page.evaluate("""() => [...document.querySelectorAll(".prose td, caption span")].map((each) => {
            const box = document.createRange();
            box.selectNodeContents(each);
            return box.getBoundingClientRect().right;
        })""")
        assert len(ends) == 8 and max(ends) <= 390
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        assert page.evaluate("document.querySelectorAll('.scroll')[1].scrollWidth") > 390  # which scrolls by itself
