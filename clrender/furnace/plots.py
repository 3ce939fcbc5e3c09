"""Plots of a material: energy against angle and roughness, and lobes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from clrender.drawing.svg import BLUE, GREY, INK, ORANGE, draw
from clrender.furnace.measure import Measured

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["energy_plot", "lobe_plot", "roughness_plot"]

_RED: Final = "#c4423a"
_GREEN: Final = "#2f8f46"
_COLORS: Final = (("red", _RED), ("green", _GREEN), ("blue", BLUE))
_LINES: Final = (GREY, BLUE, ORANGE, _GREEN)
_ROUGH_ANGLES: Final = (0.0, 60.0, 80.0)
_ERRORS: Final = 3.0


def energy_plot(measured: Measured, name: str) -> str:
    """Fraction of light against the angle from the normal, as SVG.

    Parameters
    ----------
    measured : Measured
    name : str
        Name of this plot, unique within its page.
    """

    def paint(figure: Figure) -> None:
        panels = figure.subplots(1, len(measured.energies), squeeze=False, sharey=True)[0]
        for axes, energy, white in zip(panels, measured.energies, measured.white, strict=True):
            grey = bool(np.allclose(energy.sampled, energy.sampled[:, :1], atol=1e-6))
            for i, (color, drawn) in enumerate((("all colours", INK),) if grey else _COLORS):
                error = _ERRORS * energy.sampled_error[:, i]
                axes.errorbar(
                    energy.angles, energy.sampled[:, i], error, fmt="o-", color=drawn, label=f"sampled, {color}",
                    capsize=3.0, markersize=4.0,
                )  # fmt: skip
                if energy.evaluated.any():
                    total = energy.evaluated[:, i] + energy.delta[:, i]
                    label = "evaluated" if i == 0 else None
                    axes.plot(energy.angles, total, "x", color=drawn, label=label, markersize=8.0)
            if measured.transmits:
                through = energy.through.mean(axis=1)
                axes.plot(energy.angles, through, ":", color=ORANGE, label="transmitted")
            axes.plot(white.angles, white.sampled[:, 0], "--", color=GREY, label="in white")
            axes.set_title("seen from the back" if energy.below else "seen from the front")
            axes.set_xlabel("angle from the normal, degrees")
            axes.set_xlim(-2.0, 92.0)
            axes.set_ylim(bottom=0.0, top=max(1.05, 1.05 * float(energy.sampled.max())))
            axes.grid()
        panels[0].set_ylabel("fraction of the light")
        panels[0].legend(loc="lower left")

    return draw(name, f"{measured.title}: energy against angle", (8.4, 4.6), paint)


def roughness_plot(measured: Measured, name: str) -> str:
    """Fraction of light against roughness, at a few angles, as SVG.

    Parameters
    ----------
    measured : Measured
        With rows.
    name : str
        Name of this plot, unique within its page.
    """
    roughness = [row.roughness for row in measured.rows]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="roughness", ylabel="fraction of the light")
        for angle, drawn in zip(_ROUGH_ANGLES, _LINES[1:], strict=True):
            at = int(np.abs(measured.rows[0].energy.angles - angle).argmin())
            own = [float(row.energy.sampled[at].mean()) for row in measured.rows]
            error = [_ERRORS * float(row.energy.sampled_error[at].mean()) for row in measured.rows]
            white = [float(row.white.sampled[at].mean()) for row in measured.rows]
            axes.errorbar(roughness, own, error, fmt="o-", color=drawn, label=f"{angle:g}°", capsize=3.0)
            axes.plot(roughness, white, "--", color=drawn, label=f"{angle:g}°, in white")
        axes.set_ylim(0.0, 1.05)
        axes.grid()
        axes.legend(loc="lower left", ncols=3)

    return draw(name, f"{measured.title}: energy against roughness", (8.4, 4.6), paint)


def lobe_plot(measured: Measured, name: str) -> str:
    """f |cosθ| in the plane of incidence as a polar plot, as SVG.

    Parameters
    ----------
    measured : Measured
        Not only of deltas.
    name : str
        Name of this plot, unique within its page.
    """

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(projection="polar")
        for lobe, drawn in zip(measured.lobes, _LINES, strict=True):
            brightness = lobe.values.mean(axis=1)
            largest = float(brightness.max())
            if largest > 0.0:
                radius = np.cbrt(brightness / largest)
                axes.plot(np.radians(lobe.angles), radius, color=drawn, label=f"{lobe.incident:g}°: {largest:.3g} / sr")
                axes.plot([math.radians(-lobe.incident)] * 2, [1.0, 1.12], color=drawn, linewidth=3.0)
        axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
        axes.set_theta_direction(-1)  # type: ignore[attr-defined]
        if not measured.transmits:
            axes.set_thetamin(-90.0)  # type: ignore[attr-defined]
            axes.set_thetamax(90.0)  # type: ignore[attr-defined]
        axes.set_ylim(0.0, 1.12)
        axes.set_yticks([])
        figure.legend(loc="outside right upper", title="viewing angle: maximum")

    return draw(name, f"{measured.title}: lobes", (8.0, 4.0 if not measured.transmits else 6.6), paint)
