"""Plugins of tests: those of the tree, a texture, a sheet, and faulty ones."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from clrender.plugins import Plugin, plugin

__all__ = [
    "CORNER",
    "EVEN",
    "EXAMPLES",
    "GRAIN",
    "LED",
    "MINNAERT",
    "PAPER",
    "SEARCHLIGHT",
    "SHIRLEY",
    "SPOT",
    "WOOD",
    "edited",
    "example",
]

EXAMPLES: Final = Path(__file__).resolve().parents[2] / "scenes" / "plugins"
MINNAERT: Final = (EXAMPLES / "minnaert.cl").read_text()
SHIRLEY: Final = (EXAMPLES / "ashikhmin_shirley.cl").read_text()
WOOD: Final = (EXAMPLES / "wood.cl").read_text()
GRAIN: Final = (EXAMPLES / "grain.cl").read_text()
LED: Final = (EXAMPLES / "led.cl").read_text()
SEARCHLIGHT: Final = (EXAMPLES / "searchlight.cl").read_text()
EVEN: Final = """// A light that is the same in all directions.
// [plugin]
// name = "even"
// kind = "light"
// [parameters]
// color = { type = "color", default = [1.0, 1.0, 1.0], max = 1000.0 }
static vec3 even_intensity(const EvenParameters* p, vec3 direction) { return p->color; }
"""
SPOT: Final = """// The formula of a spot, whose directions are sampled as its own are.
// [plugin]
// name = "cone"
// kind = "light"
// [parameters]
// color = { type = "color", default = [1.0, 1.0, 1.0], max = 1000.0 }
// spread = { type = "number", default = 0.5, max = 2.0, about = "1 - cosine of half the cone" }
// blend = { type = "number", default = 0.5, about = "share of the spread in which it falls" }
static vec3 cone_intensity(const ConeParameters* p, vec3 direction) {
    const vec3 off = sub(direction, vec3_of(splat(0.0f), splat(0.0f), splat(1.0f)));
    const vfloat t = bounded(quotient(fma(inner(off, off), splat(-0.5f), p->spread), p->blend * p->spread), 0.0f, 1.0f);
    return scale(p->color, t * t * fma(t, splat(-2.0f), splat(3.0f)));
}
static vec3 cone_sample(const ConeParameters* p, vfloat u, vfloat v) { return warp_cone(u, v, p->spread); }
static vfloat cone_pdf(const ConeParameters* p, vec3 direction) {
    return 1.0f - direction.z <= p->spread ? warp_cone_pdf(p->spread) : splat(0.0f);
}
"""
CORNER: Final = """// A light that shines to the right (red), up (green) and forwards (blue) alone.
// [plugin]
// name = "corner"
// kind = "light"
static vec3 corner_intensity(const CornerParameters* p, vec3 direction) {
    const vmask there = (direction.x > 0.0f) & (direction.y > 0.0f) & (direction.z > 0.0f);
    return choose(there, direction, vec3_all(0.0f));
}
"""
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
