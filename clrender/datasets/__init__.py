"""Labelled data sets: many images of varied scenes, with masks, depth and poses, proved by a manifest."""

from __future__ import annotations

from clrender.datasets.checking import DatasetVerification, verify_dataset
from clrender.datasets.making import DatasetProgress, make_dataset, merge_datasets
from clrender.datasets.spec import Spec, load_spec
from clrender.datasets.variation import DatasetPlan

__all__ = [
    "DatasetPlan",
    "DatasetProgress",
    "DatasetVerification",
    "Spec",
    "load_spec",
    "make_dataset",
    "merge_datasets",
    "verify_dataset",
]
