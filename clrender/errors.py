"""The errors clrender raises: each says, in one sentence, what is wrong, where, and what to do."""

from __future__ import annotations

__all__ = ["ClrenderError", "DeviceError", "DeviceFailure", "MemoryRefused", "RenderError", "SceneError", "UsageError"]


class ClrenderError(Exception):
    """Base of every error a user can meet.

    Attributes
    ----------
    exit_code : int
        What the command line exits with when this error ends it.
    """

    exit_code = 1


class RenderError(ClrenderError):
    """A render that had started could not be finished."""

    exit_code = 1


class DeviceFailure(RenderError):
    """A driver refused a call that it may well accept later: the device is worth another try."""


class MemoryRefused(RenderError):
    """Something would take more memory than the user allows."""

    exit_code = 2


class SceneError(ClrenderError):
    """The scene, or a file it names, is not what the format asks for."""

    exit_code = 2


class UsageError(ClrenderError):
    """A command line or a call with arguments that make no sense."""

    exit_code = 2


class DeviceError(ClrenderError):
    """No OpenCL device can do the work, or the one asked for cannot."""

    exit_code = 3
