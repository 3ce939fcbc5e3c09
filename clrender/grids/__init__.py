"""Grids of numbers in space, such as the density of a cloud: their files, and checks of what those hold."""

from clrender.grids.data import GridData
from clrender.grids.read import grid_names, read_grid

__all__ = ["GridData", "grid_names", "read_grid"]
