"""Measured reflectance: the files of the RGL and MERL databases, and checks of what those hold."""

from clrender.measured.data import MeasuredFile
from clrender.measured.read import MEASURED_ENDINGS, read_measured
from clrender.measured.tables import MerlTable, RglTables

__all__ = ["MEASURED_ENDINGS", "MeasuredFile", "MerlTable", "RglTables", "read_measured"]
