"""Strands of hair and other curves: their files, and checks of what those hold."""

from clrender.curves.data import CurveData
from clrender.curves.mitsuba_hair import read_mitsuba_hair
from clrender.curves.read import CURVE_ENDINGS, read_curves

__all__ = ["CURVE_ENDINGS", "CurveData", "read_curves", "read_mitsuba_hair"]
