"""Is an image what it says it is: random parts of it rendered again, and their bits compared."""

from __future__ import annotations

from clrender.verification.checking import Verification, verify
from clrender.verification.confidence import detection_probability, least_detected

__all__ = ["Verification", "detection_probability", "least_detected", "verify"]
