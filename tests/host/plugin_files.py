"""Plugins of tests: those of the tree, a texture, a sheet, and faulty ones."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from clrender.plugins import Plugin, plugin

__all__ = ["EXAMPLES", "GRAIN", "MINNAERT", "PAPER", "SHIRLEY", "WOOD", "edited", "example"]

EXAMPLES: Final = Path(__file__).resolve().parents[2] / "scenes" / "plugins"
MINNAERT: Final = (EXAMPLES / "minnaert.cl").read_text()
SHIRLEY: Final = (EXAMPLES / "ashikhmin_shirley.cl").read_text()
WOOD: Final = (EXAMPLES / "wood.cl").read_text()
GRAIN: Final = (EXAMPLES / "grain.cl").read_text()
PAPER: Final = """// Paper: light is scattered evenly to both sides.
// [plugin]
// name = "paper"
// kind = "bsdf"
// transmits = true
// claims = ["reciprocal", "lossless"]
// [parameters]
// tint = { type = "color", default = [1.0, 1.0, 1.0] }
// share = { type = "number", default = 0.4, about = "of light that goes through" }
static vfloat paper_share(const PaperParameters* p, vec3 wi) { return wi.z > 0.0f ? splat(1.0f) - p->share : p->share; }
static vec3 paper_eval(const PaperParameters* p, vec3 wo, vec3 wi) {
    return scale(p->tint, paper_share(p, wi) * INV_PI);
}
static vfloat paper_pdf(const PaperParameters* p, vec3 wo, vec3 wi) {
    return paper_share(p, wi) * absolute(wi.z) * INV_PI;
}
static vec3 paper_sample(const PaperParameters* p, vec3 wo, vfloat u, vfloat v, vfloat w) {
    const vec3 up = warp_cosine_hemisphere(u, v);
    return vec3_of(up.x, up.y, w < p->share ? -up.z : up.z);
}
"""


def example(name: str) -> Plugin:
    """A plugin of ``scenes/plugins``."""
    return plugin(EXAMPLES / f"{name}.cl")


def edited(text: str, *changes: tuple[str, str]) -> str:
    """A plugin's text with other words in the places of some, which are there once."""
    for old, new in changes:
        assert text.count(old) == 1, (text.count(old), old)
        text = text.replace(old, new)
    return text
