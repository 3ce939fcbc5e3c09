"""OpenCL devices: contexts, programs, buffers, and workers that render on them."""

from __future__ import annotations

from clrender.device.device import Buffer, Device, Program
from clrender.device.info import DeviceInfo

__all__ = ["Buffer", "Device", "DeviceInfo", "Program"]
