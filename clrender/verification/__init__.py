"""Verifies an image: renders random parts of it again and compares their bits."""

from __future__ import annotations

from clrender.verification.checking import Verification, verify
from clrender.verification.confidence import detection_probability, least_detected

__all__ = ["Verification", "detection_probability", "least_detected", "verify"]
