"""A model of image sensors: shot noise, read noise, mosaic and quantisation, with the same bits on every machine."""

from __future__ import annotations

from clrender.sensor.sensor import Sensor

__all__ = ["Sensor"]
