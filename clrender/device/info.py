"""What identifies a device, to people and to caches, whether it is open or not."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["DeviceInfo"]


@dataclass(frozen=True)
class DeviceInfo:
    """What identifies a device to people and to caches.

    Attributes
    ----------
    index : int
        Place in `clrender devices`.
    name, platform, driver : str
        As the driver gives them; `driver` is its version.
    type : str
        ``cpu``, ``gpu`` or ``accelerator``.
    compute_units : int
    memory_bytes : int
    probe : str
        ``ok``, ``cannot-build``, ``wrong-result``, ``crashed``, ``timeout``, or ``unknown`` before the probe ran.
    detail : str
        What the probe saw when it is not ``ok``.
    library : str
        The driver's shared library as its ICD file names it; empty when the loader found the device by itself.
    ordinal : int
        Place among the devices of the same library.
    version : str
        Version of the platform, which names the compiler inside.
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
        """The keys that `clrender devices --json` promises."""
        keys = ("index", "name", "platform", "driver", "type", "compute_units", "memory_bytes", "probe")
        values = asdict(self)
        return {key: values[key] for key in keys}
