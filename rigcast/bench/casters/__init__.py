"""The ray casters that are compared, each in a module of its own with its imports."""

from .caster import CASTERS, Answer, Cast, Caster, Floats, load_casters

__all__ = ["CASTERS", "Answer", "Cast", "Caster", "Floats", "load_casters"]
