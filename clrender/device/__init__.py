"""OpenCL devices: discovery, probing, selection and access."""

from __future__ import annotations

from clrender.device.device import Buffer, Device, Program
from clrender.device.info import DeviceInfo
from clrender.device.probe import devices, inventory
from clrender.device.select import select

__all__ = ["Buffer", "Device", "DeviceInfo", "Program", "devices", "inventory", "select"]
