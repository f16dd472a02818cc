"""`python -m rigcast.bench.first_frame`: CPU seconds from a fresh Python to the demo's first frames, as JSON."""

import json
import time
from importlib import import_module
from importlib.resources import files
from pathlib import Path


def main() -> None:
    """Import, load the demo's rig, read one frame of each sensor."""
    clock = [0.0]  # of this process, so the interpreter's own start counts
    mujoco, load_rig = import_module("mujoco"), import_module("rigcast").load_rig
    clock.append(time.process_time())
    rig = load_rig(Path(str(files("rigcast.configs"))) / "demo.yaml", device="cpu")
    data = mujoco.MjData(rig.model)
    clock.append(time.process_time())
    for frame in rig.sense(data).values():
        frame.range.numpy()
    clock.append(time.process_time())
    parts = {"import": 0, "load_rig": 1, "first frames": 2}
    print(json.dumps({name: clock[k + 1] - clock[k] for name, k in parts.items()} | {"in all": clock[-1] - clock[0]}))


if __name__ == "__main__":
    main()
