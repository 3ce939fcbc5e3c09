"""Cluster addresses: `local:N`, or the address of a Dask scheduler. Does not import Dask, which loads slowly."""

from __future__ import annotations

import importlib.util
import re
from typing import Final

from clrender.errors import UsageError
from clrender.extras import missing_extra

__all__ = ["check_address", "local_workers"]

MOST_LOCAL: Final = 256
_ADDRESS: Final = re.compile(r"(tcp|tls|ucx|ws|wss)://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):([0-9]{1,5})/?")


def local_workers(address: str) -> int | None:
    """Number of worker processes on this machine that an address requests; None if it is a scheduler's address.

    Raises
    ------
    UsageError
        When it is no address of a cluster.
    """
    if not isinstance(address, str):
        raise UsageError(f"cluster is {address!r}, but must be an address: tcp://host:8786, or local:N for N processes")
    if address.startswith("local:"):
        count = address.removeprefix("local:")
        if count.isascii() and count.isdigit() and 1 <= int(count) <= MOST_LOCAL:
            return int(count)
        raise UsageError(f"cluster is {address!r}; local:N takes a number of processes from 1 to {MOST_LOCAL}")
    found = _ADDRESS.fullmatch(address)
    if found is None or not 0 < int(found[3]) < 65536:
        raise UsageError(
            f"cluster is {address!r}; it must be the address of a Dask scheduler, such as tcp://host:8786, or local:N "
            "for N processes on this machine"
        )
    return None


def check_address(address: str) -> None:
    """Check that an address is a cluster's, and that Dask is installed.

    Raises
    ------
    UsageError
    """
    local_workers(address)
    if importlib.util.find_spec("distributed") is None:
        raise missing_extra("cluster", "a cluster needs Dask, which is not installed")
