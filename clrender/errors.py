"""The errors clrender raises: each says, in one sentence, what is wrong, where, and what to do."""

from __future__ import annotations

__all__ = [
    "ClrenderError",
    "DeviceError",
    "DeviceFailure",
    "MemoryRefused",
    "OutOfMemory",
    "RenderError",
    "SceneError",
    "UsageError",
]


class ClrenderError(Exception):
    """Base of every error a user can meet.

    Attributes
    ----------
    exit_code : int
        Exit status of the command line when this error ends it.
    extra : str or None
        The optional packages, as in `setup.cfg`, that the operation lacks.
    """

    exit_code = 1
    extra: str | None = None


class RenderError(ClrenderError):
    """A render that had started could not be finished."""

    exit_code = 1


class DeviceFailure(RenderError):
    """A driver refused a call that it may accept later, so the device is tried again."""


class MemoryRefused(RenderError):
    """An operation would take more memory than the user allows."""

    exit_code = 2


class SceneError(ClrenderError):
    """The scene, or a file it refers to, does not conform to its format."""

    exit_code = 2


class OutOfMemory(SceneError):
    """A file of a scene needs more memory than this machine has."""


class UsageError(ClrenderError):
    """A command line or a call with invalid arguments."""

    exit_code = 2


class DeviceError(ClrenderError):
    """No OpenCL device can do the work, or the requested one cannot."""

    exit_code = 3
