"""The names behind the ids of a frame."""

import json
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class IdTable:
    """What the geom and body ids of a model stand for; row i is id i.

    `geom_name` (ngeom,) and `body_name` (nbody,) are strings, `geom_body` (ngeom,) int32 body ids.
    A geom or body without a name is called by kind and id: "geom_12", "body_3".
    """

    geom_name: NDArray[np.str_]
    geom_body: NDArray[np.int32]
    body_name: NDArray[np.str_]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "IdTable":
        geoms = [model.geom(i).name or f"geom_{i}" for i in range(model.ngeom)]
        bodies = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
        return cls(
            geom_name=np.array(geoms, dtype=np.str_),
            geom_body=np.array(model.geom_bodyid, dtype=np.int32),
            body_name=np.array(bodies, dtype=np.str_),
        )

    def json(self) -> str:
        """The table as one JSON object of three lists, in plain ASCII."""
        return json.dumps(
            {
                "geom_name": self.geom_name.tolist(),
                "geom_body": self.geom_body.tolist(),
                "body_name": self.body_name.tolist(),
            }
        )
