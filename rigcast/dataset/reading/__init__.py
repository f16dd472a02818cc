"""Reading data sets."""

from .frames import Dataset, StoredFrame, open_dataset

__all__ = ["Dataset", "StoredFrame", "open_dataset"]
