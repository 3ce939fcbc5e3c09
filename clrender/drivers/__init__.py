"""OpenCL drivers of a machine: discovery, probing, diagnosis, and the selection of devices."""

from __future__ import annotations

from clrender.drivers.probe import devices, inventory
from clrender.drivers.select import select

__all__ = ["devices", "inventory", "select"]
