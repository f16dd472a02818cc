"""The reference for every cast: MuJoCo's `mj_ray`, and the definition of a wrong ray (see `judge`)."""

from rigcast.oracle.judge import Comparison, Verdict, compare
from rigcast.oracle.ray import Oracle, RayHits
from rigcast.oracle.things import Things
from rigcast.oracle.world import World

__all__ = ["Comparison", "Oracle", "RayHits", "Things", "Verdict", "World", "compare"]
