"""The casters that are compared, each behind one function `cast(model, data, origins, directions) -> Answer`."""

from peers.answer import Answer, Caster, load_casters

__all__ = ["Answer", "Caster", "load_casters"]
