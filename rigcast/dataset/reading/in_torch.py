"""The frames of a data set for torch."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray


class TorchFrames(torch.utils.data.Dataset[dict[str, Any]]):  # type: ignore[misc]
    """Frames as {field: tensor}, for a DataLoader and its workers."""

    def __init__(self, frames: Sequence[Mapping[str, NDArray[Any]]], fields: tuple[str, ...]) -> None:
        self._frames, self._fields = frames, fields

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        frame = self._frames[index]
        return {name: torch.from_numpy(np.array(frame[name])) for name in self._fields}
