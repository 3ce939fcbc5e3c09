"""What a writer is to the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import IO, Any, Protocol

from clrender.datasets.files import ImageFiles
from clrender.datasets.rendered import Rendered
from clrender.datasets.variation import DatasetPlan

__all__ = ["Records", "Writer"]

Records = Callable[[], Iterable[Mapping[str, Any]]]
"""Returns an iterator over the records of all images, in their order."""


class Writer(Protocol):
    """A form in which data sets are written. Each has a folder of its own name."""

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers that it needs, besides those of the data set."""

    @property
    def amodal(self) -> bool:
        """Whether it needs amodal masks."""

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """Write the files of one image.

        Parameters
        ----------
        rendered : Rendered
        files : ImageFiles

        Returns
        -------
        JSON-able
            What `summary` needs of it.
        """

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """Files of the whole data set, when all images are there.

        Parameters
        ----------
        plan : DatasetPlan
        records : callable
            Each record has ``image``, its number, and in ``told`` what `write` returned.

        Returns
        -------
        dict of str to callable
            Functions that write to a file, by the file's name in the data set. Their bytes are the same for the same
            data set.
        """
