"""Messages about unknown names: the valid names, and the one that was probably meant."""

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    import mujoco

_SHOWN = 12  # names listed in a message before it is cut short

# Names that other simulators and drivers use for our keys, if not similar to these; as `_bare` returns them.
_ELSEWHERE = {
    "elevation_deg": ("channels", "rings", "vertical", "verticalangles", "verticalfov", "verticalfovrange", "vfov"),
    "azimuth_deg": ("horizontal", "horizontalfovrange", "minangle", "maxangle", "anglemin", "anglemax"),
    "columns": ("samples", "horizontalsamples", "horizontalres", "horizontalresolution", "width"),
    "rays": ("raydirections", "pattern", "scanpattern", "theta", "phi"),
    "geom_id": ("classid", "semantic", "semantics", "segmentation", "label", "labels", "instanceid"),
    "fov_x_deg": ("fov", "hfov", "horizontalfov", "fovh", "horizontalaperture"),
    "fov_y_deg": ("vfov", "verticalfov", "fovv"),
    "fx": ("focallength", "intrinsics", "cameramatrix", "k"),
    "resolution": ("width", "height", "imagesize", "imagewidth", "imageheight", "size"),
    "spacing": ("resolution", "gridresolution", "step"),
    "min_range": ("near", "nearplane", "clipnear", "mindistance", "mindepth", "rangemin", "blindzone"),
    "max_range": ("far", "farplane", "clipfar", "maxdistance", "maxdepth", "rangemax", "cutoff", "cutoffdist"),
    "rate_hz": ("updaterate", "updateperiod", "frequency", "freq", "fps", "framerate", "period"),
    "extends": ("include", "includes", "import", "imports", "inherits", "inherit", "base"),
    "range_std": ("std", "stddev", "sigma", "noisestd", "gaussian"),
    "pos": ("xyz", "position", "translation", "offset", "location"),
    "euler_deg": ("rpy", "orientation", "rotation", "euler"),
    "quat": ("orientation", "rotation", "rot", "quaternion"),
    "body": ("link", "parent", "frame", "parentlink", "primpath"),
    "exclude_bodies": ("bodyexclude", "ignore", "excludelinks"),
    "geom_groups": ("geomgroup", "groups"),
}


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """The end of a message that proposes the nearest of `names`; "" if none is near."""
    candidates = list(names)
    nearest = [candidate for candidate in candidates if _bare(candidate) == _bare(name)]
    nearest += [candidate for candidate in candidates if _bare(name) in _ELSEWHERE.get(candidate, ())]
    nearest += difflib.get_close_matches(name, candidates, n=1)
    nearest += [candidate for candidate in candidates if _bare(name) and _bare(name) in _bare(candidate)]
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def _bare(name: str) -> str:
    """A name's letters and digits without its unit, so that `fovy` finds `fov_y_deg` and VLP-16 `velodyne_vlp16`."""
    return re.sub(r"[\W_]", "", re.sub(r"_(deg|hz|us)$", "", name.lower()))


def expected_one_of(name: str, names: Sequence[str]) -> str:
    """The end of a message about an unknown `name`: the valid names, and the one that was probably meant."""
    if not names:
        return "and none with a name exists"
    return f"expected one of {listing(names)}{did_you_mean(name, names)}"


def listing(names: Sequence[str]) -> str:
    """The first few of `names`, and their number."""
    more = f", ... ({len(names)} in all)" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more or "(there is none)"


def require_different(what: str, names: Iterable[str]) -> None:
    """Raise InputError if two of the names are the same. what: the beginning of the message."""
    repeated = [repr(name) for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise InputError(f"{what}: names must differ, got {', '.join(repeated)} more than once")


def usable_name(name: str, taken: set[str]) -> str:
    """A valid sensor name made from `name`, with a number if it is `taken`; adds it to `taken`."""
    usable = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:56] or "sensor"
    number = 2
    free = usable
    while free in taken:
        free, number = f"{usable}_{number}", number + 1
    taken.add(free)
    return free


def model_names(model: "mujoco.MjModel", kind: "mujoco.mjtObj", count: int) -> list[str]:
    """The names of the `count` objects of one kind in a model; nameless ones are left out."""
    import mujoco  # imported here, because the command line lists its commands without it

    names = (mujoco.mj_id2name(model, kind, i) for i in range(count))
    return [name for name in names if name]
