"""Arithmetic of the host that ends in the bits of a scene or an image: the same on every processor.

A BLAS, the vector units that NumPy finds, and the C library choose their own order of additions and their own rounding
of elementary functions, by the kind of processor. The functions here consist of additions, products, divisions and
square roots in a fixed order, which IEEE 754 rounds in one way.
"""

from __future__ import annotations

__all__: list[str] = []
