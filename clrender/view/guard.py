"""Who may talk to the server: whoever has the token, from a page of the server itself, by a name that is its own."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from typing import Final

__all__ = ["CONTENT_POLICY", "Guard"]

CONTENT_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of every answer."""


class Guard:
    """Decides of each request by its headers.

    Parameters
    ----------
    token : str
    port : int
    host : str
        Address that the server listens at, as the user named it.
    """

    def __init__(self, token: str, port: int, host: str) -> None:
        self.cookie = f"clrender-view-{port}"  # cookies know no ports
        self._token = token.encode()
        self._port = port
        self._names = {"localhost", host.lower().strip("[]")}

    def allows(self, headers: Mapping[str, str], token: str | None) -> bool:
        """Whether a request may be answered.

        Parameters
        ----------
        headers : mapping
            By names in lower case.
        token : str or None
            In the address.
        """
        host = headers.get("host", "")
        origin = headers.get("origin")
        if not self._is_own(host) or (origin is not None and origin.lower() != f"http://{host.lower()}"):
            return False
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return False
        given = token if token is not None else self._from_cookie(headers.get("cookie", ""))
        return given is not None and hmac.compare_digest(given.encode(errors="replace"), self._token)

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this server by a number, or by a name that no stranger can give it.

        A page of another site can have its own name resolved to this machine (DNS rebinding), and then talks to the
        server as if that were its own. The browser still tells that name here.
        """
        name, colon, port = host.rpartition(":")
        if not colon or port != str(self._port):
            return False
        name = name.lower().strip("[]")
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _from_cookie(self, text: str) -> str | None:
        try:
            found = SimpleCookie(text).get(self.cookie)
        except CookieError:
            return None
        return None if found is None else found.value
