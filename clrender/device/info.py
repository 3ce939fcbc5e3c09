"""Identification of a device, open or not, for messages and caches."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["DeviceInfo"]


@dataclass(frozen=True)
class DeviceInfo:
    """Identification of a device, for messages and caches.

    Attributes
    ----------
    index : int
        Index in `clrender devices`.
    name, platform, driver : str
        As reported by the driver; `driver` is its version.
    type : str
        ``cpu``, ``gpu`` or ``accelerator``.
    compute_units : int
    memory_bytes : int
    probe : str
        ``ok``, ``cannot-build``, ``wrong-result``, ``crashed``, ``timeout``, or ``unknown`` before the probe ran.
    detail : str
        Result of the probe if it is not ``ok``.
    library : str
        The driver's shared library as its ICD file names it; empty if the loader found the device by itself.
    ordinal : int
        Index among the devices of the same library.
    version : str
        Version of the platform, which names its compiler.
    """

    index: int
    name: str
    platform: str
    driver: str
    type: str
    compute_units: int
    memory_bytes: int
    probe: str = "unknown"
    detail: str = ""
    library: str = ""
    ordinal: int = 0
    version: str = ""

    @property
    def title(self) -> str:
        """Name of the device and of its driver, for messages."""
        return f"{self.name} ({self.platform} {self.driver})"

    def public(self) -> dict[str, Any]:
        """The documented keys of `clrender devices --json`."""
        keys = ("index", "name", "platform", "driver", "type", "compute_units", "memory_bytes", "probe")
        values = asdict(self)
        return {key: values[key] for key in keys}
